"""Laws of any exponent: the named laws among them, and their inverses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.axis.wear import WEAR_LAWS
from ballscrew.prognosis.wear_path import (
    LAW_EXPONENTS,
    day_of,
    named_laws,
    remaining_after,
    travel_until,
    worn_time,
)

NO_LOAD = np.array(1e-9)


@pytest.mark.parametrize("law", WEAR_LAWS)
def test_named_laws(law: str) -> None:
    p = np.array(LAW_EXPONENTS[law])
    half = travel_until(0.5 ** (2 / 3), p, NO_LOAD)
    travel = np.linspace(0, 1.6, 9)
    remaining = remaining_after(travel * half, p, NO_LOAD)
    known = remaining > 0.01  # below it wear continues under the load
    assert np.maximum(remaining, 0)[known] ** 1.5 == pytest.approx(
        WEAR_LAWS[law](travel, 1.0, 1.0)[known], rel=1e-4
    )


@given(st.floats(-0.5, 1), st.floats(0, 1.5), st.floats(0.02, 0.9))
def test_travel_and_remaining_part_are_inverse(x: float, p: float, load: float) -> None:
    exponent, force = np.array(p), np.array(load)
    travel = travel_until(x, exponent, force)
    assert remaining_after(travel, exponent, force) == pytest.approx(x, abs=1e-6)


@given(st.floats(0, 1.5), st.floats(0.02, 0.9))
def test_wear_never_heals_and_is_continuous(p: float, load: float) -> None:
    spent = np.linspace(0, 30, 6001)
    remaining = remaining_after(spent, np.array(p), np.array(load))
    steps = np.diff(remaining)
    assert (steps <= 0).all()
    assert steps.min() >= -1.01 * spent[1]


@given(st.floats(0, 1e4), st.floats(-0.6, 3), st.floats(1, 100))
def test_days_of_a_relaxing_pace(days: float, relaxing: float, relaxation: float) -> None:
    a, tau = np.array(relaxing), np.array(relaxation)
    assert day_of(worn_time(np.array(days), a, tau), a, tau) == pytest.approx(days, rel=1e-6, abs=1e-6)


def test_there_is_no_wear_before_its_onset_and_an_infinite_day_stays_infinite() -> None:
    unit = np.array(1.0)
    assert worn_time(np.array([-5.0, 0.0]), unit, unit).tolist() == [0, 0]
    assert day_of(np.array([np.inf]), unit, unit).tolist() == [np.inf]


def test_the_nearest_law_is_named() -> None:
    result = named_laws(np.array([0.1, 0.4, 0.5, 1.4]))
    assert result == {"external-load": 0.25, "contact-pressure": 0.5, "exponential": 0, "preload": 0.25}
