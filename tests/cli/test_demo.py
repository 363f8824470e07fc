"""``ballscrew demo``, with a few tests of one small trip in place of a life."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from tests.estimation.made_runs import calibrated
from tests.monitoring.histories import history, worn

from ballscrew.base.jsonfile import write_json
from ballscrew.reproduction import demo as module
from ballscrew.reproduction.experiment import Measured

DAYS = (0, 3, 6, 36, 60, 96)


@pytest.fixture
def short(monkeypatch):
    """Six tests of three stops: three new ones, two worn, one with backlash."""
    pytest.importorskip("matplotlib")
    plan = replace(module.PLAN, positions=module.PLAN.positions[:3], repetitions=2)
    monkeypatch.setattr(module, "PLAN", plan)
    monkeypatch.setattr(module, "_DAYS", DAYS)


@pytest.mark.usefixtures("short", "few_members")
def test_it_leaves_a_report_and_no_recordings(ballscrew, tmp_path):
    outcome = ballscrew("demo", "--out", tmp_path / "out")
    assert outcome.status == 0, outcome.err
    assert outcome.out.splitlines()[-1].startswith("Look at ")
    found = {path.name for path in (tmp_path / "out").iterdir()}
    pictures = {"life.png", "monitor.png", "new.png", "worn.png"}
    assert found == {"report.html", "model.json", "monitor.json", "runs"} | pictures
    assert len(list((tmp_path / "out" / "runs").iterdir())) == len(DAYS)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count("<tr>") == len(DAYS) + 1
    assert "A ball screw loses its preload" in page
    # What the report says can be had again by the commands that it names.
    runs = sorted((tmp_path / "out" / "runs").iterdir())
    again = ballscrew("monitor", *runs, "--model", tmp_path / "out" / "model.json", "--json")
    states = [run["state"] for run in again.document["runs"]]
    assert states[:3] == ["learning"] * 3
    assert "normal" not in states[4:]
    ratio = again.document["runs"][3]["stiffness_relative_to_baseline"]
    assert ratio["interval95"][0] < 0.586 < ratio["interval95"][1]


def test_estimates_beside_true_values_and_the_forecast_of_that_day():
    days = tuple(range(0, 99, 6))
    runs = history(days, worn(12.0, 90.0))
    tests = [Measured(module._planned_test(float(day)), run, {}) for day, run in zip(days, runs, strict=True)]
    found = module.monitor_tests(tests, calibrated())
    assert found.backlash_day == 96.0
    assert found.alarm_day is not None
    assert 12 < found.alarm_day <= 24
    assert len(found.at_alarm.state.runs) == days.index(found.alarm_day) + 1
    assert found.points[0].preload_ratio == 1
    document = json.loads(json.dumps(found.to_json()))
    assert document["alarm_day"] == found.alarm_day
    assert document["tests"][3]["estimate"]["interval95"][0] < 1
    words = " ".join(module.describe(found))
    assert f"Alarm on day {found.alarm_day:g}" in words
    assert "true value" in words


def test_the_printed_document_is_that_of_the_result(ballscrew, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    runs = history((0, 3, 6))
    tests = [Measured(module._planned_test(3.0 * number), run, {}) for number, run in enumerate(runs)]
    found = module.monitor_tests(tests, calibrated())
    monkeypatch.setattr("ballscrew.cli.experiments.demo", lambda *_, **__: found)
    outcome = ballscrew("demo", "--out", tmp_path, "--json")
    assert (outcome.status, outcome.err) == (0, "")
    assert outcome.document == json.loads(write_json(found.to_json()))
    assert len(outcome.document["tests"]) == 3


def test_half_of_the_preload():
    planned = module._planned_test(module.half_day())
    new = module._planned_test(0.0)
    assert planned.rig.machine.preload == pytest.approx(new.rig.machine.preload / 2)


def test_a_life_without_an_alarm():
    days = (0, 3, 6)
    tests = [
        Measured(module._planned_test(float(day)), run, {})
        for day, run in zip(days, history(days), strict=True)
    ]
    found = module.monitor_tests(tests, calibrated())
    assert found.alarm_day is None
    first, *ending = module.describe(found)
    assert first == "No alarm was raised."
    assert ending[0].startswith(
        "Day 0: bench: NOT JUDGED: learning, 1 of 3 good runs: axial stiffness as with"
    )
    assert len(ending) == 3


def test_a_folder_that_cannot_be(ballscrew, tmp_path):
    (tmp_path / "file").write_text("x", encoding="utf-8")
    outcome = ballscrew("demo", "--out", tmp_path / "file")
    assert outcome.status == 2
    assert outcome.err.count("\n") == 1
