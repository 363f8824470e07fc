"""The failure that comes first is the one that leaves most."""

from __future__ import annotations

import math

import pytest

from ballscrew.base.errors import InputError
from ballscrew.prognosis.failure import Failure

PRESSED = 1e-5


def test_half_of_the_preload_by_default() -> None:
    assert Failure().remaining(PRESSED) == pytest.approx(0.5 ** (2 / 3))
    assert Failure().mode(PRESSED) == ("preload", "the preload falls below 50 % of what it was")


def test_a_large_load_ends_it_sooner() -> None:
    one = Failure(0.3, largest_load=1000.0, preload=600.0)
    assert one.remaining(PRESSED) ** 1.5 == pytest.approx(1000 / 600 / math.sqrt(8))
    assert one.mode(PRESSED)[0] == "load"
    assert Failure(0.7, largest_load=1000.0, preload=600.0).mode(PRESSED)[0] == "preload"


def test_backlash_comes_last() -> None:
    alone = Failure(None, backlash=2e-6)
    assert alone.remaining(PRESSED) == pytest.approx(-0.1)
    assert alone.mode(PRESSED) == ("backlash", "backlash exceeds 2 µm")
    assert Failure(0.1, backlash=2e-6).mode(PRESSED)[0] == "preload"


def test_a_load_that_lifts_a_new_nut_has_ended_it() -> None:
    assert Failure(0.5, largest_load=1e5, preload=600.0).remaining(PRESSED) == 1.0


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
def test_what_cannot_be_is_refused(given: dict[str, object]) -> None:
    with pytest.raises(InputError, match="failure"):
        Failure(**given)  # type: ignore[arg-type]
