"""End of life by the criterion that is met first."""

from __future__ import annotations

import math

import pytest

from ballscrew.base.errors import InputError
from ballscrew.prognosis.failure import Failure

APPROACH = 1e-5


def test_half_of_the_preload_by_default() -> None:
    assert Failure().remaining(APPROACH) == pytest.approx(0.5 ** (2 / 3))
    assert Failure().mode(APPROACH) == ("preload", "the preload falls below 50 % of what it was")


def test_a_large_load_ends_life_sooner() -> None:
    failure = Failure(0.3, largest_load=1000.0, preload=600.0)
    assert failure.remaining(APPROACH) ** 1.5 == pytest.approx(1000 / 600 / math.sqrt(8))
    assert failure.mode(APPROACH)[0] == "load"
    assert Failure(0.7, largest_load=1000.0, preload=600.0).mode(APPROACH)[0] == "preload"


def test_backlash_comes_last() -> None:
    alone = Failure(None, backlash=2e-6)
    assert alone.remaining(APPROACH) == pytest.approx(-0.1)
    assert alone.mode(APPROACH) == ("backlash", "backlash exceeds 2 µm")
    assert Failure(0.1, backlash=2e-6).mode(APPROACH)[0] == "preload"


def test_a_load_that_unloads_a_new_nut_ends_its_life() -> None:
    assert Failure(0.5, largest_load=1e5, preload=600.0).remaining(APPROACH) == 1.0


@pytest.mark.parametrize(
    "given",
    [
        {"preload_ratio": 1.0},
        {"preload_ratio": 0.0},
        {"preload_ratio": math.nan},
        {"preload_ratio": "half"},
        {"preload_ratio": True},
        {"preload_ratio": None},
        {"largest_load": 100.0},
        {"backlash": -1e-6},
        {"backlash": math.inf},
    ],
)
def test_criteria_out_of_range_are_refused(given: dict[str, object]) -> None:
    with pytest.raises(InputError, match="failure"):
        Failure(**given)  # type: ignore[arg-type]
