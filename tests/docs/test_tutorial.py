"""The tutorial can be walked."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from tests.docs.pages import DOCS, WALK, alike, blocks, load, page, words

import ballscrew

TUTORIAL = "docs/tutorial/first-run.md"


def test_the_tutorial_can_be_walked(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    text = page(TUTORIAL)
    for step in WALK.walk(text, tmp_path):
        assert step.status == (2 if step.shown.startswith("ballscrew: ") else 0), step.said
        told, expected = words(step.said), words(step.shown)
        assert len(told) == len(expected), f"run docs/tutorial/walk.py:\n{step.said}"
        assert alike(told, expected) == [], "run docs/tutorial/walk.py"
    for block in blocks(text):
        if block.language == "text":
            lines = (tmp_path / block.options["caption"]).read_text(encoding="utf-8").splitlines()
            assert lines[: len(block.body.splitlines())] == block.body.splitlines()
    assert (tmp_path / "run.png").stat().st_size > 10_000
    _compare_with_the_truth(load(DOCS / "tutorial" / "make_recording.py"), tmp_path)


def _compare_with_the_truth(maker: ModuleType, folder: Path) -> None:
    """The tutorial asks the reader to compare; so do we."""
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
