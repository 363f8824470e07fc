"""``ballscrew demo``, with three tests of one small trip in place of a life."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from ballscrew.base.provenance import Made
from ballscrew.cli import demo as module
from ballscrew.cli.demo import Test as DemoTest
from ballscrew.cli.demo import alarm_day, life_points
from ballscrew.modal.run import CellResult, RigidBodyResult, Run
from ballscrew.recording.quality.finding import Quality
from ballscrew.report.life_figure import LifePoint


def a_run(*frequencies):
    cells = tuple(
        CellResult(0.1 * i, "PA", 0, 3, f, None, None, "paper", "refused" if f is None else "good", ())
        for i, f in enumerate(frequencies)
    )
    return Run("id", None, None, None, None, (), Quality("good"), RigidBodyResult(), (), cells, Made())


def points(*shifts, u=0.1):
    return [LifePoint(float(3 * i), s, u, 40, 0.04, 0.0) for i, s in enumerate(shifts)]


def test_the_change_is_the_mean_of_the_cells_that_both_have(monkeypatch):
    monkeypatch.setattr(module, "_BASELINE", 2)
    tests = [
        DemoTest(0.0, a_run(100.0, 200.0, 300.0), 680.0, 0.0),
        DemoTest(3.0, a_run(101.0, 201.0, None), 680.0, 0.0),
        DemoTest(6.0, a_run(95.0, None, 1.0), 340.0, 0.0),
        DemoTest(9.0, a_run(None, None, 1.0), 0.0, 1e-6),
    ]
    first, second, third, last = life_points(tests)
    assert (first.shift_Hz, second.shift_Hz, third.shift_Hz) == (-0.5, 0.5, -5.5)
    assert (first.cells, third.cells) == (2, 1)
    assert last.shift_Hz is None
    assert first.standard_uncertainty_Hz == pytest.approx(0.5**0.5)
    assert third.preload_ratio == pytest.approx(0.02)


def test_sure_is_twice_in_a_row():
    quiet = (0.0, 0.1, -0.1, 0.0, 0.0)
    assert alarm_day(points(*quiet, -0.5, -0.2, -0.5, -0.6)) == 24.0
    assert alarm_day(points(*quiet, -0.3, -0.3, -0.3)) is None
    assert alarm_day(points(*quiet, -0.5, None, -0.5)) is None


@pytest.fixture
def short(monkeypatch):
    """Five tests of five stops: two new ones, two worn, one with backlash."""
    pytest.importorskip("matplotlib")
    plan = replace(module.PLAN, positions=module.PLAN.positions[:5], repetitions=3)
    monkeypatch.setattr(module, "PLAN", plan)
    monkeypatch.setattr(module, "_DAYS", (0, 3, 60, 63, 96))
    monkeypatch.setattr(module, "_BASELINE", 2)
    monkeypatch.setattr(module, "_REPORTED", 60)


@pytest.mark.usefixtures("short")
def test_it_leaves_a_report_and_no_recordings(ballscrew, tmp_path):
    said = ballscrew("demo", "--out", tmp_path / "out")
    assert said.status == 0, said.err
    assert said.out.splitlines()[-1].startswith("Look at ")
    assert "report.html" in said.out
    found = {path.name for path in (tmp_path / "out").iterdir()}
    assert found == {"report.html", "life.png", "new.png", "worn.png", "runs"}
    assert len(list((tmp_path / "out" / "runs").iterdir())) == 5
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count("<tr>") == 6
    assert "A ball screw loses its preload" in page


@pytest.mark.usefixtures("short")
def test_as_json(ballscrew, tmp_path):
    said = ballscrew("demo", "--out", tmp_path, "--json")
    document = json.loads(said.out)
    assert document["backlash_day"] == 96.0
    shifts = [test["shift_Hz"] for test in document["tests"]]
    assert shifts[2] < -3
    assert abs(shifts[0]) < 1


def test_a_folder_that_cannot_be(ballscrew, tmp_path):
    (tmp_path / "file").write_text("x", encoding="utf-8")
    said = ballscrew("demo", "--out", tmp_path / "file")
    assert said.status == 2
    assert said.err.count("\n") == 1
