"""Page of the prognosis: its claims by its tables, and the command that made each table."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from benchmarks.forecast_shapes import SHAPES
from benchmarks.forecasts import main
from scipy.special import ndtr

from ballscrew.prognosis.families import FAMILIES, FamilyPrior

PAGE = Path(__file__).parent.parent.parent / "docs" / "explanation" / "prognosis.md"
TEXT = PAGE.read_text(encoding="utf-8")


def table(name: str) -> list[list[str]]:
    """Rows of a marked table without its head."""
    block = re.search(rf"<!-- {name} -->\n(.*?)<!-- end of {name} -->", TEXT, re.S)
    assert block is not None, name
    rows = [line.strip("| ").split(" | ") for line in block[1].splitlines() if line.startswith("| ")]
    return rows[1:]


@pytest.mark.parametrize("name", ["preload shapes", "torque shapes", "xjtu", "half"])
def test_every_table_names_its_command(name: str) -> None:
    block = TEXT.split(f"<!-- {name} -->\n")[1]
    assert re.match(r"`python -m benchmarks\.[^`]*`, \d{4}-\d\d-\d\d, \S+, \d+ cores, Python \S+\n", block)


def test_the_tables_have_every_shape() -> None:
    for name in ("preload shapes", "torque shapes"):
        assert [row[0] for row in table(name)] == list(SHAPES)


def test_the_forecasts_of_the_wear_test_are_those_of_the_page(
    data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("benchmarks.forecasts.PARTS", (20,))
    assert main(["--data", str(data), "--show", "xjtu"]) == 0
    result = [line.strip("| ").split(" | ") for line in capsys.readouterr().out.splitlines()[2:] if line]
    shown = [row for row in table("xjtu") if row[0] == "20"]
    for now, row in zip(result, shown, strict=True):
        assert now[:3] == row[:3]
        assert float(now[3]) == pytest.approx(float(row[3]), rel=0.1)


def test_the_tables_of_families_and_prior_are_those_of_the_program() -> None:
    prior = FamilyPrior()
    rows = [row for row in TEXT.split("| unknown |")[1].split("\n\n")[0].splitlines()[2:] if row]
    assert len(rows) == 13
    assert (prior.rate, prior.onset, prior.noise, prior.walk) == (1e-3, 20.0, 0.7, 0.3)
    assert (prior.growth, prior.factor, prior.relaxation) == (1.2, 2.5, 5.0)
    doubling = 1 - 2**-prior.hazard
    assert f"doubles | {doubling:.2f} ({prior.hazard:g} per e-fold) |" in TEXT
    factor = math.exp(prior.later_spread)
    assert f"| its factor | {prior.later:g}, times or divided by {factor:.1g}: three in ten" in TEXT
    assert ndtr(-math.log(prior.later) / prior.later_spread) == pytest.approx(0.3, abs=0.05)
    lines = TEXT.split("| family |")[1].split("\n\n")[0].splitlines()
    for family in FAMILIES:
        (row,) = [line for line in lines if line.startswith(f"| {family.name} |")]
        assert row.endswith(f"| {family.weight:g} |")
