"""The tables of the estimator's page are its results on the bench."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from tests.conftest import BENCH_STATES, BenchRun
from tests.docs.pages import page

TEXT = page("docs/explanation/identification.md")
AGAIN = "make the page's tables anew, as it says"


def table(name: str) -> list[list[str]]:
    """Rows of a table of the page, without its head."""
    block = re.search(rf"<!-- {name} -->\n(.*?)<!-- end of {name} -->", TEXT, re.S)
    assert block is not None, name
    rows = [line.strip("| ").split(" | ") for line in block[1].splitlines() if line.startswith("| ")]
    return rows[1:]


@pytest.fixture(scope="module")
def errors(foreign_bench: Path, bench_run: BenchRun) -> list[np.ndarray]:
    """Errors of all cells of both states, Hz."""
    truth = json.loads((foreign_bench / "truth.json").read_text(encoding="utf-8"))
    found = []
    for state in BENCH_STATES:
        run = bench_run(state)
        true = truth[state]["axial_natural_frequency_Hz"]
        found.append(
            np.array(
                [
                    c.frequency_Hz - true[f"{c.position_m:.3f}"]
                    for c in run.cells
                    if c.frequency_Hz is not None
                ]
            )
        )
    return found


def test_the_numbers_of_the_bench(errors: list[np.ndarray]) -> None:
    row = next(row for row in table("bench") if row[:2] == ["ballscrew, joint", "as is"])
    for shown, error in zip(row[2:4], errors, strict=True):
        printed = np.median(abs(error)), np.quantile(abs(error), 0.9)
        assert [float(part) for part in shown.split(" / ")] == pytest.approx(printed, abs=0.03), AGAIN
    assert row[4] == f"{sum(map(len, errors))}/80", AGAIN


def test_both_tables_have_the_same_methods() -> None:
    of_bench, of_axes = ([row[0] for row in table(name)] for name in ("bench", "random axes"))
    assert len(of_axes) >= 6
    assert set(of_axes) <= set(of_bench)


@pytest.mark.parametrize("name", ["bench", "random axes"])
def test_every_table_says_what_made_it(name: str) -> None:
    block = TEXT.split(f"<!-- {name} -->\n")[1]
    assert re.match(r"`python -m benchmarks\.\w+[^`]*`, \d{4}-\d\d-\d\d, \S+, \d+ cores, Python \S+\n", block)
