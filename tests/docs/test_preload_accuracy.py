"""The page of the preload's accuracy shows what was asked for, and its tables say what made them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from benchmarks.preload import bench as estimate_bench
from tests.conftest import BENCH_STATES, BenchRun
from tests.docs.pages import page

TEXT = page("docs/explanation/preload-accuracy.md")
NAMES = ["wear", "imitations", "local wear", "bench", "recorded"]


def lines_of(name: str) -> list[list[str]]:
    """Rows of a table of the page."""
    block = re.search(rf"<!-- {name} -->\n(.*?)<!-- end of {name} -->", TEXT, re.S)
    assert block is not None, name
    return [line.strip("| ").split(" | ") for line in block[1].splitlines() if line.startswith("| ")]


def table(name: str) -> list[list[str]]:
    """Rows of a table of the page, without its head."""
    rows = lines_of(name)
    return rows[1:] if name != "bench" else rows


def columns(name: str, *headings: str) -> list[int]:
    """Columns of the first of the headings that the table has."""
    head = lines_of(name)[0]
    present = next(heading for heading in headings if heading in head)
    return [index for index, heading in enumerate(head) if heading == present]


STIFFNESS = columns("wear", "stiffness: error, rms", "P/P₀: error, rms")[0]
RATIO = columns("wear", "nut's P/P₀: error, rms", "P/P₀: error, rms")[0]
BOUND = columns("wear", "at best")[0]


def row(name: str, *begin: str) -> list[str]:
    return next(row for row in table(name) if row[: len(begin)] == list(begin))


@pytest.mark.parametrize("name", NAMES)
def test_every_table_says_what_made_it(name: str) -> None:
    block = TEXT.split(f"<!-- {name} -->\n")[1]
    assert re.match(
        r"`python -m benchmarks\.preload[^`]*`, \d{4}-\d\d-\d\d, \S+, \d+ cores, Python \S+\n", block
    )


@pytest.mark.parametrize(
    ("anchor", "most"), [("none", 0.04), ("both preloads known", 0.02), ("two acceleration levels", 0.04)]
)
def test_the_ratio_errs_no_more_than_was_asked_for(anchor: str, most: float) -> None:
    assert float(row("wear", anchor, "all")[STIFFNESS]) <= most


def coverage(cells: list[str]) -> list[float]:
    """How often the intervals contain the true values, %."""
    return [float(cells[k].removesuffix(" %")) for k in columns("wear", "coverage")]


SETTLED = "a second preload known, a quarter; the first not; the bearing assumed rigid, and it is"


@pytest.mark.parametrize("anchor", [row[0] for row in table("wear") if row[1] == "all"])
def test_intervals_have_their_coverage_where_the_assumptions_hold(anchor: str) -> None:
    covered = coverage(row("wear", anchor, "all"))
    assert min(covered) >= 90
    # Else they allow for what does not happen, or for more of it.
    if not any(words in anchor for words in ("nothing changes", "has not changed", "lost a tenth", "two")):
        assert max(covered) <= 98


@pytest.mark.parametrize(
    "cells", [pytest.param(row, id="; ".join(row[:2])) for row in table("wear") if row[BOUND] != "–"]
)
def test_the_ratio_errs_no_more_than_it_must(cells: list[str]) -> None:
    assert float(cells[RATIO]) <= 1.2 * float(cells[BOUND])


def test_a_second_preload_alone_settles_what_the_page_says() -> None:
    quarter, half = (
        row("wear", f"a second preload known, a {which}; the first not; but nothing changes", "all")
        for which in ("quarter", "half")
    )
    assert float(quarter[RATIO]) <= 0.02
    assert float(half[BOUND]) > 0.02  # nobody can do what was asked of it
    assert float(row("wear", SETTLED, "all")[RATIO]) <= 0.02


def test_no_loss_is_reported_of_an_axis_that_lost_nothing() -> None:
    good, suspect, refused = (int(n) for n in row("imitations", "nothing")[2].split(" / "))
    assert good >= 0.98 * (good + suspect + refused)


def test_a_softer_bearing_is_a_softer_axis() -> None:
    cells = row("imitations", "bearing −10 %")
    column = columns("imitations", "true value in the interval", "bearing named")[0]
    assert float(cells[column].removesuffix(" %")) >= 95


def test_a_torque_constant_is_not_read_as_preload() -> None:
    assert float(row("imitations", "torque constant +1 %")[5].split()[0]) == pytest.approx(1, abs=0.01)


def test_a_worn_place_is_found_within_one_stop() -> None:
    worn, even = table("local wear")
    assert int(worn[2]) >= 0.95 * int(worn[0].split()[0])
    assert int(even[1]) <= 0.02 * int(even[0].split()[0])


def test_the_bench_is_estimated() -> None:
    cells = row("bench", "axial stiffness as P/P₀")
    low, high = (float(end) for end in cells[2].split(" to "))
    assert low <= float(cells[3]) <= high
    assert (high - low) / 2 <= 0.15  # 0.087 with the stated convention of K alone, 0.145 with others probable


def test_the_bench_on_the_page_is_what_the_program_prints(foreign_bench: Path, bench_run: BenchRun) -> None:
    estimate, _, true = estimate_bench(foreign_bench, [bench_run(state) for state in BENCH_STATES])
    force = estimate.preload_N
    assert force is not None
    for name, ratio in (
        ("axial stiffness as P/P₀", estimate.stiffness_relative_to_baseline),
        ("P/P₀ of the nut", estimate.relative_to_baseline),
    ):
        shown = row("bench", name)
        assert ratio is not None
        assert ratio.value == pytest.approx(float(shown[1]), abs=2e-3)
        assert ratio.interval == pytest.approx([float(end) for end in shown[2].split(" to ")], abs=4e-3)
        assert true == float(shown[3])
    newtons = row("bench", "P, N")
    assert force.interval == pytest.approx([float(end) for end in newtons[2].split(" to ")], abs=3)
