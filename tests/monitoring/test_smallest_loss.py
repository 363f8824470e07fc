"""Shift of a mean that a test detects, and the loss that causes it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ballscrew.axis.axial import PARAMETERS, AxialModel, frequency
from ballscrew.monitoring.smallest_loss import log_odds_variance, needed_shift, smallest_loss

MODEL = AxialModel(0.2, 3e-8, 0.8, 0.0, 40.0, 120.0, 0.25, 600.0)
X = np.linspace(0.0, 0.4, 5)
EVEN = np.full(5, 0.2)


@pytest.mark.parametrize("degrees", [3.0, 8.0, 30.0])
@pytest.mark.parametrize(("false_alarm", "power"), [(0.05, 0.9), (0.01, 0.5)])
def test_the_test_has_the_stated_false_alarms_and_power(degrees, false_alarm, power):
    """Student's test on samples: false alarms and detections occur at the stated rates."""
    from scipy.stats import t

    rng = np.random.default_rng(2)
    spread = np.sqrt(rng.chisquare(degrees, 40_000) / degrees)
    noise = rng.normal(size=40_000)
    limit = t.isf(false_alarm, degrees)
    shift = needed_shift(degrees, false_alarm, power)
    assert np.mean(noise / spread > limit) == pytest.approx(false_alarm, rel=0.15)
    assert np.mean((noise + shift) / spread > limit) == pytest.approx(power, abs=0.01)


def test_a_known_scatter_needs_the_sum_of_two_normal_quantiles():
    assert needed_shift(math.inf, 0.001, 0.9) == pytest.approx(3.0902 + 1.2816, abs=1e-3)
    assert needed_shift(9e3, 0.001, 0.9) == pytest.approx(needed_shift(math.inf, 0.001, 0.9), rel=1e-3)


def test_fewer_degrees_need_a_larger_shift():
    shifts = [needed_shift(degrees, 0.001, 0.9) for degrees in (2.0, 4.0, 8.0, 100.0)]
    assert shifts == sorted(shifts, reverse=True)


def test_the_loss_causes_the_shift():
    loss = smallest_loss(MODEL, 50.0, X, EVEN, 0.002)
    assert loss is not None
    fallen = np.log(frequency(MODEL, X, 50.0)) - np.log(frequency(MODEL, X, 50.0, 1 - loss))
    assert fallen @ EVEN == pytest.approx(0.002, rel=1e-6)


def test_a_small_share_needs_a_larger_loss():
    soft = AxialModel(0.2, 3e-8, 0.8, 0.0, 40.0, 120.0, 0.10, 600.0)
    assert smallest_loss(soft, 50.0, X, EVEN, 0.002) > 2 * smallest_loss(MODEL, 50.0, X, EVEN, 0.002)


def test_a_shift_beyond_every_loss_is_not_reported():
    assert smallest_loss(MODEL, 50.0, X, EVEN, 1.0) is None


def test_the_variance_is_that_of_samples_of_the_share():
    covariance = np.zeros((7, 7))
    at = PARAMETERS.index("share")
    covariance[at, at] = 0.15**2
    rng = np.random.default_rng(4)
    samples = []
    for logit in math.log(1 / 3) + 0.15 * rng.normal(size=400):
        model = AxialModel(0.2, 3e-8, 0.8, 0.0, 40.0, 120.0, 1 / (1 + math.exp(-logit)), 600.0)
        loss = smallest_loss(model, 50.0, X, EVEN, 0.002)
        samples.append(math.log(loss / (1 - loss)))
    variance = log_odds_variance(MODEL, covariance, 50.0, X, EVEN, 0.002)
    assert math.sqrt(variance) == pytest.approx(np.std(samples), rel=0.1)
    assert log_odds_variance(MODEL, np.zeros((7, 7)), 50.0, X, EVEN, 0.002) == 0.0
