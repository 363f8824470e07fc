"""Every measure of a forecast, in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from benchmarks.forecast_metrics import (
    asymmetric_score,
    coverage,
    crps,
    mass_within,
    meets_alpha_lambda,
    pit,
    prognostic_horizon,
    relative_accuracy,
    uniformity,
)
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from ballscrew.base.errors import InputError

NORMAL = norm.ppf((np.arange(4000) + 0.5) / 4000)


@pytest.mark.parametrize("truth", [0.0, 1.0, -2.5])
def test_crps_of_a_normal_forecast(truth: float) -> None:
    exact = truth * (2 * norm.cdf(truth) - 1) + 2 * norm.pdf(truth) - 1 / math.sqrt(math.pi)
    assert crps(NORMAL, truth) == pytest.approx(exact, abs=1e-3)


@given(st.floats(-100, 100), st.floats(-100, 100))
def test_crps_of_a_point_is_its_error(point: float, truth: float) -> None:
    assert crps([point], truth) == pytest.approx(abs(point - truth), abs=1e-9)


@given(st.lists(st.floats(0, 100), min_size=1, max_size=20), st.floats(0, 100))
def test_crps_is_the_double_sum(samples: list[float], truth: float) -> None:
    x = np.array(samples)
    exact = np.mean(np.abs(x - truth)) - np.mean(np.abs(x[:, None] - x)) / 2
    assert crps(samples, truth) == pytest.approx(exact, abs=1e-9)


def test_an_open_forecast_has_a_score_with_a_limit_only() -> None:
    assert crps([100.0, math.inf], 100.0, limit=300.0) == pytest.approx(100 - 50)
    with pytest.raises(InputError, match="limit"):
        crps([100.0, math.inf], 100.0)


def test_transform_and_coverage() -> None:
    assert pit([1.0, 2.0, 3.0, math.inf], 2.0) == 0.375
    even = (np.arange(100) + 0.5) / 100
    assert coverage(even, 0.9) == 0.9
    assert uniformity(even) == pytest.approx(0.005)
    assert uniformity([0.01] * 10) == pytest.approx(0.99)
    assert coverage([0.01, 0.5], 0.9) == 0.5


def test_alpha_lambda() -> None:
    samples = [70.0, 85.0, 110.0, 130.0]
    assert mass_within(samples, 80, 120) == 0.5
    assert meets_alpha_lambda(samples, 100.0)
    assert not meets_alpha_lambda(samples, 100.0, beta=0.6)


def test_a_horizon_counts_only_where_the_criterion_stays_met() -> None:
    right, wrong = [0.0], [1000.0]
    days = [10.0, 50.0, 80.0, 95.0]
    forecasts = [[90.0], [50.0], [20.0], [5.0]]
    assert prognostic_horizon(days, forecasts, 100.0) == 90
    assert prognostic_horizon(days, [[90.0], wrong, [20.0], [5.0]], 100.0) == 20
    assert prognostic_horizon(days, [*forecasts[:3], wrong], 100.0) == 0
    assert prognostic_horizon([95.0], [right], 100.0) == 5


def test_relative_accuracy() -> None:
    assert relative_accuracy(80, 100) == pytest.approx(0.8)
    assert relative_accuracy(math.inf, 100) == -math.inf
    with pytest.raises(InputError, match="more than 0"):
        relative_accuracy(1, 0)


def test_late_costs_more_than_early() -> None:
    assert asymmetric_score(110, 100) == pytest.approx(math.e - 1)
    assert asymmetric_score(87, 100) == pytest.approx(math.e - 1)
    assert asymmetric_score(100, 100) == 0
    assert asymmetric_score(math.inf, 100) == math.inf


@pytest.mark.parametrize("samples", [[], [math.nan]])
def test_no_samples_no_score(samples: list[float]) -> None:
    for measure in (crps, pit):
        with pytest.raises(InputError, match="no samples"):
            measure(samples, 1.0)


def test_a_level_is_a_probability() -> None:
    with pytest.raises(InputError, match="level"):
        coverage([0.5], 1.0)


def test_one_forecast_a_day() -> None:
    with pytest.raises(InputError, match="one a day"):
        prognostic_horizon([1.0], [], 10.0)
