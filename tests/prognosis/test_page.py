"""Page of the prognosis: its claims by its tables, and the command that made each table."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from benchmarks.xjtu_forecast import main

from ballscrew.prognosis.life_prior import LifePrior

PAGE = Path(__file__).parent.parent.parent / "docs" / "explanation" / "prognosis.md"
TEXT = PAGE.read_text(encoding="utf-8")


def table(name: str) -> list[list[str]]:
    """Rows of a marked table without its head."""
    block = re.search(rf"<!-- {name} -->\n(.*?)<!-- end of {name} -->", TEXT, re.S)
    assert block is not None, name
    rows = [line.strip("| ").split(" | ") for line in block[1].splitlines() if line.startswith("| ")]
    return rows[1:]


@pytest.mark.parametrize("name", ["half", "way", "others", "rubs", "xjtu"])
def test_every_table_names_its_command(name: str) -> None:
    block = TEXT.split(f"<!-- {name} -->\n")[1]
    assert re.match(r"`python -m benchmarks\.[^`]*`, \d{4}-\d\d-\d\d, \S+, \d+ cores, Python \S+\n", block)


def test_at_half_of_the_life_the_coverage_is_the_stated_one() -> None:
    ours, wiener, *_ = table("half")
    assert ours[0].startswith("200")
    assert 85 <= float(ours[4].removesuffix(" %")) <= 95
    assert float(ours[8]) <= 0.75 * float(wiener[8])


def test_the_page_states_the_results_of_the_fair_reference() -> None:
    """The page claims only the gain in the tables, which is that of the intervals."""
    for name, least in (("half", 85), ("rubs", 80)):
        ours, *_, fair = table(name)
        assert fair[1] == "Wiener since the wear's onset"
        assert f"{ours[8]} days against {fair[8]}" in TEXT
        assert float(ours[4].removesuffix(" %")) >= least
        assert float(ours[4].removesuffix(" %")) > float(fair[4].removesuffix(" %"))


def test_the_horizon_is_longer_than_the_references() -> None:
    """Except for the process since the onset, whose intervals have less than the stated coverage."""
    ours, *others, fair = table("way")
    assert [other[0] for other in others] == ["Wiener process", "exponential, particle filter"]
    assert all(float(ours[k]) > float(other[k]) for other in others for k in (1, 2, 3))
    assert fair[0] == "Wiener since the wear's onset"
    assert f"{float(fair[1]):.2f} and {float(fair[2]):.2f}" in TEXT
    assert f"{fair[9]} days against the filter's {ours[9]}" in TEXT
    least, _, most = ours[10].removesuffix(" %").split()
    assert int(least) >= 85
    assert int(most) <= 98


def test_the_forecasts_of_the_wear_test_are_those_of_the_page(
    data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("BALLSCREW_DATA", str(data))
    assert main(["--data", str(data)]) == 0
    result = [line.strip("| ").split(" | ") for line in capsys.readouterr().out.splitlines() if "|" in line][
        2:
    ]
    for now, shown in zip(result, table("xjtu"), strict=True):
        assert now[0] == shown[0]
        assert float(now[5]) == pytest.approx(float(shown[5]), rel=0.1)
        assert int(now[3].split()[0]) == 10


def test_the_table_of_the_prior_is_the_prior() -> None:
    prior = LifePrior()
    result = [row for row in TEXT.split("| unknown |")[1].split("\n\n")[0].splitlines()[2:] if row]
    assert len(result) == 11
    assert (prior.rate, prior.onset, prior.wander, prior.load) == (1e-3, 20.0, 0.8, 0.15)
    assert (prior.noise, prior.temperature, prior.bearing, prior.bearing_days) == (0.7, 0.0033, 0.004, 60)
