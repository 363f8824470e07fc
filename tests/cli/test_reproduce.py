"""``ballscrew reproduce``, with four stops, two loads and four days in place of the paper's."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest
from tests.monitoring.histories import history, worn

from ballscrew.reproduction import reproduce as module
from ballscrew.reproduction.demo import _planned_test
from ballscrew.reproduction.experiment import Measured
from ballscrew.reproduction.results import Claim, Experiments


@pytest.fixture
def short(monkeypatch):
    pytest.importorskip("matplotlib")
    plan = replace(module.PLAN, positions=(0.0, 0.09, 0.225, 0.45))
    monkeypatch.setattr(module, "PLAN", plan)
    monkeypatch.setattr(module, "_LOADS", (30.0, 50.0))
    monkeypatch.setattr(module, "_INTERVAL", 13.0)
    monkeypatch.setattr(module, "_WORN", 60.0)


FIGURES = {"01", "02", "03", "05", "08", "09", "10", "09-10", "11", "11-cells", "12", "12-monitor"}


@pytest.mark.slow
@pytest.mark.usefixtures("short", "few_members", "fitted_once")
def test_it_leaves_figures_claims_no_recordings_and_what_was_there_before(ballscrew, tmp_path):
    out = tmp_path / "paper"
    mine = out / "recordings" / "day-00"
    mine.mkdir(parents=True)
    (mine / "bench.h5").write_text("precious", encoding="utf-8")
    outcome = ballscrew("reproduce", "--out", out, "--quick")
    assert outcome.status == 0, outcome.err
    lines = outcome.out.splitlines()
    assert lines[0].startswith("24 recordings, ")
    assert lines[0].endswith("they are deleted as they are analysed.")
    assert lines[-1].endswith("report.html")
    days = [line.split(":")[0] for line in lines if line.startswith("Day ")]
    assert days == ["Day 26", "Day 52", "Day 78"]
    assert (mine / "bench.h5").read_text(encoding="utf-8") == "precious"
    assert [path.name for path in (out / "recordings").rglob("*")] == ["day-00", "bench.h5"]
    names = {path.name for path in out.iterdir()}
    assert names == {"figures", "runs", "report.html", "reproduce.json", "recordings"}
    names = {path.name for path in (out / "figures").iterdir()}
    assert names == {f"figure-{name}.{ending}" for name in FIGURES for ending in ("png", "svg")}
    assert len(list((out / "runs").iterdir())) == 8
    page = (out / "report.html").read_text(encoding="utf-8")
    for name in FIGURES:
        assert f'src="figures/figure-{name}.png"' in page
    document = json.loads((out / "reproduce.json").read_text(encoding="utf-8"))
    assert len(document["claims"]) == page.count("<tr>") - 1
    assert {claim["holds"] for claim in document["claims"]} <= {"yes", "partly", "no", "open"}
    assert document["backlash_day"] == 78.0
    # The paper's message: several hertz are lost while there is no backlash yet.
    falls = [fall["fall_Hz"] for fall in document["falls_before_backlash"]]
    assert len(falls) >= 10
    assert min(falls) > 3


@pytest.mark.slow
@pytest.mark.usefixtures("short", "few_members", "fitted_once")
def test_recordings_are_kept_on_request(ballscrew, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "draw_figures", lambda *_, **__: ())
    # But for one day, the recordings of the test above.
    monkeypatch.setattr(module, "_INTERVAL", 20.0)
    monkeypatch.setattr(module, "_LOADS", (30.0,))
    outcome = ballscrew("reproduce", "--out", tmp_path, "--quick", "--keep", "--json")
    assert outcome.status == 0, outcome.err
    document = json.loads(outcome.out)
    assert [run["name"] for run in document["runs"]] == ["load-30kg", "day-00", "day-40", "gentle-day-00"]
    for run in document["runs"]:
        folder = tmp_path / "recordings" / run["name"]
        assert ballscrew("quality", folder / "run.toml").status == 0
        assert json.loads((folder / "truth.json").read_text(encoding="utf-8")) == run["truth"]


def test_a_full_disk_is_refused(ballscrew, tmp_path, monkeypatch):
    from collections import namedtuple

    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage(10, 9, 1_000_000))
    outcome = ballscrew("reproduce", "--out", tmp_path / "x")
    assert outcome.status == 2
    assert "are needed and 1 MB are free" in outcome.err


def test_a_folder_that_cannot_be(ballscrew, tmp_path):
    (tmp_path / "file").write_text("x", encoding="utf-8")
    outcome = ballscrew("reproduce", "--quick", "--out", tmp_path / "file")
    assert outcome.status == 2
    assert outcome.err.count("\n") == 1


@pytest.mark.usefixtures("short")
def test_recordings_of_another_experiment_are_not_overwritten(ballscrew, tmp_path):
    mine = tmp_path / "recordings" / "day-00"
    mine.mkdir(parents=True)
    (mine / "bench.h5").write_text("precious", encoding="utf-8")
    outcome = ballscrew("reproduce", "--out", tmp_path, "--quick", "--keep")
    assert outcome.status == 2
    assert "exists already" in outcome.err
    assert (mine / "bench.h5").read_text(encoding="utf-8") == "precious"


@pytest.fixture
def done(monkeypatch):
    """Both experiments as if they had been run, without a recording, in 125.4 s."""
    pytest.importorskip("matplotlib")
    days = (0.0, 26.0, 52.0, 78.0)
    runs = history(days, worn(0.0, 90.0))
    truth = {"local_backlash_m": {"0.0": 0.0}}
    life = tuple(Measured(_planned_test(day), run, truth) for day, run in zip(days, runs, strict=True))
    claims = (
        Claim("The frequency falls.", "It fell.", "yes", ""),
        Claim("It is linear.", "It is not.", "no", ""),
    )
    experiments = Experiments(module.AXIS, (), life)
    monkeypatch.setattr("ballscrew.cli.experiments.reproduce", lambda *_, **__: (experiments, claims))
    monkeypatch.setattr("ballscrew.cli.experiments.end_of_life", lambda _: ["Day 78: bench: ALARM"])
    clock = SimpleNamespace(monotonic=iter((100.0, 225.4)).__next__)
    monkeypatch.setattr("ballscrew.cli.experiments.time", clock)


@pytest.mark.usefixtures("done")
def test_each_claim_is_printed_with_whether_it_holds_and_the_end_of_the_life(ballscrew, tmp_path):
    outcome = ballscrew("reproduce", "--out", tmp_path)
    assert outcome.status == 0, outcome.err
    assert outcome.out.splitlines() == [
        "    yes  The frequency falls.",
        "     no  It is linear.",
        "Day 78: bench: ALARM",
        "Done in 2 min 5 s.",
        f"Look at {tmp_path / 'report.html'}",
    ]


@pytest.mark.usefixtures("done")
def test_the_printed_document_has_the_claims_and_the_runs_and_nothing_else_is_printed(ballscrew, tmp_path):
    outcome = ballscrew("reproduce", "--out", tmp_path, "--json")
    assert (outcome.status, outcome.err) == (0, "")
    assert [claim["holds"] for claim in outcome.document["claims"]] == ["yes", "no"]
    assert [run["day"] for run in outcome.document["runs"]] == [0.0, 26.0, 52.0, 78.0]
