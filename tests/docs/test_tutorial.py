"""The tutorial works and its outputs are correct."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from tests.docs.pages import WALK, alike, blocks, load, page, words

import ballscrew

TUTORIAL = "docs/tutorial/first-run.md"


@pytest.mark.usefixtures("fitted_once")
def test_the_outputs_of_the_first_part_are_correct(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    _check_outputs(TUTORIAL, tmp_path)
    assert (tmp_path / "run.png").stat().st_size > 10_000
    _compare_with_the_truth(load(WALK.FOLDER / "make_recording.py"), tmp_path)


@pytest.mark.slow
@pytest.mark.usefixtures("fitted_once")
def test_the_outputs_of_the_other_parts_are_correct(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    for block in blocks(page(TUTORIAL)):
        WALK.write_file(block, tmp_path)
    for part in WALK.PAGES[1:]:
        _check_outputs(f"docs/tutorial/{part.name}", tmp_path)
    assert (tmp_path / "axis.png").stat().st_size > 10_000
    assert "ALARM" in (tmp_path / "axis-1" / "axis.html").read_text(encoding="utf-8")
    truth = json.loads((tmp_path / "axis-1" / "2026-01-25" / "truth.json").read_text(encoding="utf-8"))
    assert truth["preload_N"] == 510
    _compare_with_the_true_preloads(tmp_path)


def _check_outputs(name: str, folder: Path) -> None:
    """Run a part of the tutorial and compare what it prints with the page."""
    text = page(name)
    for step in WALK.walk(text, folder):
        assert step.status == (2 if step.shown.startswith("ballscrew: ") else 0), step.printed
        printed, expected = words(step.printed), words(step.shown)
        assert len(printed) == len(expected), f"run docs/tutorial/walk.py:\n{step.printed}"
        assert alike(printed, expected) == [], "run docs/tutorial/walk.py"
    for block in blocks(text):
        if block.language == "text":
            lines = (folder / block.options["caption"]).read_text(encoding="utf-8").splitlines()
            assert lines[: len(block.body.splitlines())] == block.body.splitlines()


def _compare_with_the_true_preloads(folder: Path) -> None:
    """Compare the interval of every test with the true value, and these with the pages."""
    preloads = load(WALK.FOLDER / "make_runs.py").PRELOADS
    percent = [round(100 * preload / preloads[0]) for preload in preloads]
    assert percent[:3] == [100] * 3
    assert "{}, {} and {} %".format(*percent[3:]) in page("docs/tutorial/remaining-life.md")
    assert f"{preloads[-1]} N, which is {percent[-1]} %" in page("docs/tutorial/calibrated.md")
    runs = [ballscrew.Run.read(path) for path in sorted(folder.glob("axis-1/*/run.json"))]
    found = ballscrew.monitor(runs, ballscrew.read_model(folder / "model.json"))
    for run, true in zip(found.state.runs, preloads, strict=True):
        assert run.stiffness is not None
        low, high = run.stiffness.interval
        assert low <= true / preloads[0] <= high


def _compare_with_the_truth(maker: ModuleType, folder: Path) -> None:
    """Compare the frequencies with the true values on the page."""
    run = ballscrew.analyze(folder / "run.toml")
    pole = 1 / maker.TABLE + 1 / maker.ROTOR
    truth = {x: (maker.stiffness(x) * pole) ** 0.5 / (2 * np.pi) for x in maker.STOPS}
    claimed = "176.9, 163.1 and 152.1 Hz"
    assert claimed in page(TUTORIAL)
    assert [f"{value:.1f}" for value in truth.values()] == re.findall(r"\d+\.\d", claimed)
    assert len(run.cells) == 8
    off = [
        abs(cell.frequency_Hz - truth[round(cell.position_m, 3)]) / cell.standard_uncertainty_Hz
        for cell in run.cells
        if cell.frequency_Hz is not None and cell.standard_uncertainty_Hz is not None
    ]
    assert sum(value <= 2 for value in off) >= 7
