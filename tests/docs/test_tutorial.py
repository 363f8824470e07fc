"""The tutorial works and its outputs are correct."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from tests.docs.pages import DOCS, WALK, alike, blocks, load, page, words

import ballscrew
from ballscrew.cli.shell import run

TUTORIAL = "docs/tutorial/first-run.md"


def run_here(line: str, folder: Path) -> tuple[int, str]:
    """Run a command of the tutorial in this process, which has loaded what it needs."""
    program, *arguments = line.split()
    if program != "ballscrew":
        done: tuple[int, str] = WALK.run_process(line, folder)
        return done
    out = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        status = run(arguments)
    return status, "".join(f"{row.rstrip()}\n" for row in out.getvalue().splitlines())


@pytest.mark.usefixtures("fitted_once")
def test_the_outputs_of_the_tutorial_are_correct(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    text = page(TUTORIAL)
    for step in WALK.walk(text, tmp_path, run_here):
        assert step.status == (2 if step.shown.startswith("ballscrew: ") else 0), step.printed
        printed, expected = words(step.printed), words(step.shown)
        assert len(printed) == len(expected), f"run docs/tutorial/walk.py:\n{step.printed}"
        assert alike(printed, expected) == [], "run docs/tutorial/walk.py"
    for block in blocks(text):
        if block.language == "text":
            lines = (tmp_path / block.options["caption"]).read_text(encoding="utf-8").splitlines()
            assert lines[: len(block.body.splitlines())] == block.body.splitlines()
    assert (tmp_path / "run.png").stat().st_size > 10_000
    _compare_with_the_truth(load(DOCS / "tutorial" / "make_recording.py"), tmp_path)


def _compare_with_the_truth(maker: ModuleType, folder: Path) -> None:
    """Compare the frequencies with the true values on the page."""
    run = ballscrew.analyze(folder / "run.toml")
    pole = 1 / maker.TABLE + 1 / maker.ROTOR
    truth = {x: (maker.stiffness(x) * pole) ** 0.5 / (2 * np.pi) for x in maker.STOPS}
    claimed = "176.9, 167.3, 159.1 and 152.1 Hz"
    assert claimed in page(TUTORIAL)
    assert [f"{value:.1f}" for value in truth.values()] == re.findall(r"\d+\.\d", claimed)
    assert len(run.cells) == 12
    off = [
        abs(cell.frequency_Hz - truth[round(cell.position_m, 3)]) / cell.standard_uncertainty_Hz
        for cell in run.cells
        if cell.frequency_Hz is not None and cell.standard_uncertainty_Hz is not None
    ]
    assert sum(value <= 2 for value in off) >= 11
