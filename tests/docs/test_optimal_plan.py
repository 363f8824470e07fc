"""The page of the optimised plan tells what it gives today."""

from __future__ import annotations

import re

import pytest
from benchmarks.optimal_plan import cases, realised, row
from tests.docs.pages import page

from ballscrew.axis.axial import PARAMETERS
from ballscrew.fcft.optimise import optimise

TEXT = page("docs/explanation/optimal-plan.md")
AGAIN = "python -m benchmarks.optimal_plan --page docs/explanation/optimal-plan.md"


def table(name: str) -> list[list[str]]:
    block = re.search(rf"<!-- {name} -->\n(.*?)<!-- end of {name} -->", TEXT, re.S)
    assert block is not None, name
    return [line.strip("| ").split(" | ") for line in block[1].splitlines() if line.startswith("| ")][1:]


def test_the_first_row_is_todays() -> None:
    (case,) = [case for case in cases(0) if case.name.startswith("25 × 10")]
    printed = row(case)[0].strip("| ").split(" | ")
    shown = table("information per minute")[0]
    assert shown[:3] == printed[:3], AGAIN
    numbers = [[float(v) for v in cells[5:]] for cells in (printed, shown)]
    assert numbers[0] == pytest.approx(numbers[1], rel=0.02), AGAIN


def test_the_optimised_plan_beats_the_papers_on_every_axis() -> None:
    rows = [cells for cells in table("information per minute") if "of all" not in cells[0]]
    assert len(rows) >= 20
    assert all(float(v) > 1.2 for cells in rows for v in cells[5:10])


def test_what_is_expected_is_what_fits_give() -> None:
    for *_, expected, fitted in table("expected accuracy"):
        assert float(fitted.rstrip(" %")) == pytest.approx(float(expected.rstrip(" %")), rel=0.1)


def test_a_few_fits_agree_with_it_today() -> None:
    (case,) = [case for case in cases(0) if case.name.startswith("25 × 10")]
    best = optimise(case.plan, case.sheet)
    got = dict(zip(PARAMETERS, realised(best.plan, case.sheet, 150, seed=5), strict=True))
    expected = {parameter.name: parameter.after for parameter in best.chosen.accuracy}
    assert got["compliance"] == pytest.approx(expected["compliance"], rel=0.25)
    assert got["mass"] == pytest.approx(expected["mass"], rel=0.25)


@pytest.mark.parametrize("name", ["information per minute", "expected accuracy"])
def test_every_table_says_what_made_it(name: str) -> None:
    block = TEXT.split(f"<!-- {name} -->\n")[1]
    assert re.match(r"`python -m benchmarks\.\w+[^`]*`, \d{4}-\d\d-\d\d, \S+, \d+ cores, Python \S+\n", block)
