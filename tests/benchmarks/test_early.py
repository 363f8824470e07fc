"""The benchmark of detection: its lives, its levels and its counting."""

from __future__ import annotations

import math

import numpy as np
import pytest
from benchmarks.early_axes import Curve, course, draw_life, fitted, levels, of_day
from benchmarks.early_signatures import three_sigma
from benchmarks.early_tables import Alarm, rate, table

from ballscrew.axis.wear import WEAR_LAWS

ONE = Curve(3, 1.0, 0.0, 0.003, 0.0012, 0.25, 0.4)


def test_a_life_is_whole_until_its_onset_and_worn_out_at_its_end() -> None:
    laws = set()
    for seed in range(40):
        life = draw_life(seed)
        laws.add(life.law)
        ratio = of_day(life, np.array([0.0, life.onset, life.onset + life.days]))
        assert ratio[:2].tolist() == [1.0, 1.0]
        assert ratio[2] == pytest.approx(0.05 if life.law in ("preload", "exponential") else 0.0, abs=1e-3)
        assert 10 <= life.onset <= 30
        assert 80 <= life.days <= 300
    assert laws == set(WEAR_LAWS)


def test_some_runs_are_missed_and_temperatures_are_recorded_within_their_error() -> None:
    when = course(1, 300.0)
    assert 270 < len(when.days) < 295
    assert np.abs(when.temperature).max() <= 10
    assert np.std(when.read - when.temperature) == pytest.approx(0.2, rel=0.2)


def test_levels_are_those_of_the_preload() -> None:
    life, when = draw_life(2), course(2, 200.0)
    new = levels(ONE, life, when, np.ones(len(when.days)))
    worn = levels(ONE, life, when, np.full(len(when.days), 0.5))
    assert float(np.mean(worn - new)) == pytest.approx(0.5 ** (-1 / 3) - 1, rel=0.05)


def test_a_curve_is_fitted_through_the_nominal_preload() -> None:
    log = np.log([1.2, 1.0, 0.8, 0.5])
    assert fitted(log, 1.1 * np.expm1(-log / 3)) == pytest.approx((1.1, 0.0), abs=1e-9)


def test_false_alarms_are_counted_by_time_at_risk() -> None:
    year = 365.25
    none, early = Alarm(None, None, math.nan, math.inf, year), Alarm(year / 2, 100, 0.0, math.inf, year)
    count, risk, (low, high) = rate([none, early, none])
    assert (count, risk) == (1, 2.5)
    assert low < 1 / 2.5 < high
    assert rate([none])[2][0] == 0.0
    assert rate([none])[2][1] == pytest.approx(-math.log(0.025), rel=1e-6)


def test_a_life_that_never_alarms_counts_as_lost() -> None:
    worn = [Alarm(30.0, 30, 0.04, 20.0, 60.0), Alarm(None, None, math.nan, 20.0, 60.0)]
    row = table({"x": (worn, worn)})[2]
    assert "> 55" in row
    assert "| 50 % | 1 |" in row


def test_three_sigma_takes_two_in_a_row() -> None:
    base = [1.0, 1.1, 0.9, 1.05, 0.95]
    assert three_sigma([*base, 2.0, 1.0, 2.0, 2.0], 5) == 8
    assert three_sigma([*base, 0.1, 0.1], 5) is None
    assert three_sigma([*base, 0.1, 0.1], 5, sign=-1) == 6
