"""Numbers on the pages are those that the code gives."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.conftest import BenchRun
from tests.docs.pages import DOCS, alike, blocks, load, page, words

from ballscrew.modal.run import Run

AGAIN = "run docs/bench_numbers.py"
NUMBERS = load(DOCS / "bench_numbers.py")


@pytest.fixture(scope="module")
def states(bench_run: BenchRun) -> dict[str, Run]:
    return {state: bench_run(f"preload-{state}-percent", "paper") for state in NUMBERS.STATES}


def test_the_numbers_of_the_uncertainty_page_and_the_readme(
    foreign_bench: Path, bench_run: BenchRun, states: dict[str, Run]
) -> None:
    text = page("docs/explanation/uncertainty.md")
    for name, values in NUMBERS.table(foreign_bench, states).items():
        row = re.search(rf"^\| {re.escape(name)} \|([^|]*)\|([^|]*)\|", text, re.M)
        assert row is not None, name
        for shown, value in zip(row.groups(), values, strict=True):
            assert alike(value.split(), shown.split()) == [], f"{name}: {AGAIN}"
    text = page("README.md")
    ours = {state: bench_run(f"preload-{state}-percent") for state in NUMBERS.STATES}
    printed = NUMBERS.readme_lines(ours["4"])
    shown = next(block.body for block in blocks(text) if block.body.startswith("bench:"))
    assert alike(words("\n".join(printed)), words(shown)) == [], AGAIN
    assert (
        alike(
            words(NUMBERS.readme_claim(foreign_bench, ours)),
            words(text[text.index("the median error is") :].split(" cells")[0] + " cells"),
        )
        == []
    ), AGAIN
