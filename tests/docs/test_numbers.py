"""Numbers that pages tell are those that the code gives today."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.docs.pages import DOCS, alike, blocks, load, page, words

from ballscrew.modal.run import Run

AGAIN = "run docs/bench_numbers.py"
NUMBERS = load(DOCS / "bench_numbers.py")


@pytest.fixture(scope="module")
def states(bench: Path) -> dict[str, Run]:
    runs: dict[str, Run] = NUMBERS.analyse(bench)
    return runs


def test_the_numbers_of_the_uncertainty_page(bench: Path, states: dict[str, Run]) -> None:
    text = page("docs/explanation/uncertainty.md")
    for name, values in NUMBERS.table(bench, states).items():
        row = re.search(rf"^\| {re.escape(name)} \|([^|]*)\|([^|]*)\|", text, re.M)
        assert row is not None, name
        for shown, value in zip(row.groups(), values, strict=True):
            assert alike(value.split(), shown.split()) == [], f"{name}: {AGAIN}"


def test_the_numbers_of_the_readme(states: dict[str, Run]) -> None:
    text = page("README.md")
    told = NUMBERS.readme_lines(states["4"])
    shown = next(block.body for block in blocks(text) if block.body.startswith("bench,"))
    assert alike(words("\n".join(told)), words(shown)) == [], AGAIN
    own = page("docs/explanation/uncertainty.md").replace("\xa0", " ")
    medians = re.search(r"absolute error \| ([\d.]+ Hz) \| ([\d.]+ Hz)", own)
    held = re.search(r"holds the truth \| \*\*(\d+) of 40\*\* \| \*\*(\d+) of 40", own)
    assert medians is not None
    assert held is not None
    assert f"{medians[1]} at 4 % preload and {medians[2]} at 2 %" in text
    assert f"{held[1]} and {held[2]} of 40 cells" in text
