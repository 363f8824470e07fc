from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from ballscrew.base.errors import InputError
from ballscrew.testbed.pace import Pace, worn_days

EVEN = Pace(running_in=0.0, dry=0.0)


def rate(pace: Pace, day: float) -> float:
    since = day - max([0.0, *(g for g in pace.greased if g <= day)])
    new = 1 + pace.running_in * np.exp(-day / pace.running_in_days)
    return float(new * (1 + pace.dry * -np.expm1(-since / pace.dry_days)))


def test_without_anything_days_are_days():
    np.testing.assert_allclose(worn_days(EVEN, [0.0, 1.5, 80.0]), [0, 1.5, 80])


@given(
    running_in=st.floats(0, 2), run=st.floats(0.5, 30), dry=st.floats(0, 2), spent=st.floats(1, 90),
    greased=st.lists(st.floats(0.5, 90), max_size=4, unique=True), day=st.floats(0, 100),
)  # fmt: skip
def test_it_is_the_rates_integral(running_in, run, dry, spent, greased, day):
    pace = Pace(running_in, run, dry, spent, tuple(sorted(greased)))
    marks = [0.0, *(g for g in pace.greased if g < day), day]
    wanted = sum(quad(lambda t: rate(pace, t), a, b - 1e-9)[0] for a, b in pairwise(marks) if b > a)
    assert float(worn_days(pace, day)) == pytest.approx(wanted, rel=1e-6, abs=1e-6)


def test_running_in_is_faster_and_greasing_slows():
    early, late = np.diff(worn_days(Pace(dry=0.0), [0.0, 1.0, 50.0, 51.0]))[[0, 2]]
    assert early > 1.3 * late
    dry, fresh = Pace(running_in=0.0), Pace(running_in=0.0, greased=(60.0,))
    np.testing.assert_array_equal(worn_days(dry, [30.0, 60.0]), worn_days(fresh, [30.0, 60.0]))
    spent, slow = (np.diff(worn_days(p, [60.0, 65.0]))[0] for p in (dry, fresh))
    assert slow < 0.85 * spent


def test_chance_is_the_same_whatever_days_are_asked_for():
    rough = Pace(roughness=0.5, seed=3)
    days = np.linspace(0, 200, 401)
    whole = worn_days(rough, days)
    assert np.all(np.diff(whole) >= 0)
    np.testing.assert_array_equal(worn_days(rough, days[::-1])[::-1], whole)
    np.testing.assert_array_equal(worn_days(rough, days[:50]), whole[:50])
    assert not np.allclose(worn_days(Pace(roughness=0.5, seed=4), days), whole)
    many = [float(worn_days(Pace(roughness=0.5, seed=k), 100.0)) for k in range(200)]
    smooth = float(worn_days(Pace(), 100.0))
    assert np.mean(many) == pytest.approx(smooth, rel=0.02)
    assert np.std(many) / smooth == pytest.approx(0.05, rel=0.25)


@pytest.mark.parametrize(
    "change",
    [
        {"running_in": -0.1},
        {"dry": float("nan")},
        {"roughness": -1.0},
        {"running_in_days": 0.0},
        {"dry_days": -1.0},
        {"greased": (5.0, 4.0)},
        {"greased": (0.0,)},
        {"greased": (float("nan"),)},
    ],
)
def test_paces_that_cannot_be(change):
    with pytest.raises(InputError):
        Pace(**change)


@pytest.mark.parametrize("day", [-1.0, float("nan"), 1e9])
def test_days_that_cannot_be(day):
    with pytest.raises(InputError, match="day"):
        worn_days(Pace(roughness=0.1), day)


def test_no_days_at_all():
    assert worn_days(Pace(roughness=0.1), []).shape == (0,)
