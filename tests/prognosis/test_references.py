"""The two reference models behave as in their papers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import invgauss, kstest
from tests.prognosis.lives import QUICK, healthy, made

from ballscrew.base.errors import InputError
from ballscrew.prognosis.exponential import ExponentialFilter, _scatter
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.forecast import LifeModel
from ballscrew.prognosis.preload_history import PreloadHistory, preload_history
from ballscrew.prognosis.wiener import WienerProcess, first_passages

HALF = Failure()
CUBE = 1 - 0.5 ** (1 / 3)


def line(slope: float, walk: float = 0.0, noise: float = 1e-3, n: int = 120, seed: int = 1) -> PreloadHistory:
    """P^(1/3) falls by a slope a day and Brownian motion."""
    random = np.random.default_rng(seed)
    days = np.arange(float(n))
    motion = np.concatenate([[0], np.cumsum(walk * random.standard_normal(n - 1))])
    value = 1 - slope * days - motion + noise * random.standard_normal(n)
    return preload_history(days, 1 / value - 1, noise)


def test_first_passages_are_inverse_gaussian() -> None:
    random = np.random.default_rng(2)
    d, v, s = 0.2, 0.002, 0.01
    lives = first_passages(np.full(5000, d), np.full(5000, v), s, random)
    shape = (d / s) ** 2
    assert kstest(lives, invgauss(d / v / shape, scale=shape).cdf).pvalue > 0.01


def test_a_drift_away_never_arrives_and_a_crossed_distance_takes_no_time() -> None:
    result = first_passages(np.array([1.0, -1.0]), np.array([-1.0, -1.0]), 0.1, np.random.default_rng(1))
    assert result.tolist() == [math.inf, 0]


def test_a_straight_line_is_extrapolated() -> None:
    result = WienerProcess().forecast(line(0.001), HALF)
    assert result.quantile(0.5) == pytest.approx(CUBE / 0.001 - 119, rel=0.05)
    assert result.ratio[0, 4] == pytest.approx((1 - 0.119) ** 3, abs=0.01)


def test_diffusion_widens_the_first_passage() -> None:
    still, walking = (
        WienerProcess().forecast(line(0.001, walk), HALF).quantile([0.05, 0.95]) for walk in (0.0, 0.004)
    )
    assert np.diff(walking) > 3 * np.diff(still)


@pytest.mark.slow
def test_the_intervals_cover_a_wiener_process() -> None:
    covered = []
    for seed in range(40):
        days = np.arange(400.0)
        random = np.random.default_rng([seed, 5])
        path = np.cumsum(0.002 + 0.004 * random.standard_normal(400))
        crossed = int(np.argmax(path > CUBE))
        history = preload_history(
            days[:50], 1 / (1 - path[:50] + 0.002 * random.standard_normal(50)) - 1, 0.002
        )
        low, high = WienerProcess().forecast(history, HALF).quantile([0.05, 0.95]).tolist()
        covered.append(low <= crossed - 49 <= high)
    assert 0.75 <= np.mean(covered) <= 1.0


def test_an_exponential_is_extrapolated() -> None:
    days = np.arange(100.0)
    level = np.exp(0.004 * days / 3) - 1 + 0.002 * np.random.default_rng(1).standard_normal(100)
    result = ExponentialFilter().forecast(preload_history(days, level, 0.002), HALF)
    assert result.quantile(0.5) == pytest.approx(math.log(2) / 0.004 - 99, rel=0.1)


def test_a_temperature_that_only_drifts_is_not_separated_from_the_wear() -> None:
    plain = line(0.001)
    drifting = preload_history(
        plain.days, plain.level, plain.level_uncertainty, temperature=20 + 0.1 * plain.days
    )
    expected = WienerProcess().forecast(plain, HALF).quantile([0.05, 0.5, 0.95])
    assert WienerProcess().forecast(drifting, HALF).quantile([0.05, 0.5, 0.95]) == pytest.approx(expected)


@pytest.mark.parametrize("model", [WienerProcess(), ExponentialFilter(), QUICK])
def test_all_models_have_one_interface(model: LifeModel) -> None:
    result = model.forecast(made(90), HALF, at=80)
    assert result.at == 80
    assert (result.rul_days[1:] >= result.rul_days[:-1]).all()
    assert result.ratio.shape == (len(result.days), 9)
    assert result.text.endswith(".")


@pytest.mark.parametrize("model", [WienerProcess(), ExponentialFilter()])
def test_a_healthy_axis_has_an_open_end(model: LifeModel) -> None:
    assert model.forecast(healthy(60), HALF).quantile(0.95) == math.inf


@pytest.mark.parametrize("model", [WienerProcess(), ExponentialFilter()])
def test_too_few_runs_are_refused(model: LifeModel) -> None:
    with pytest.raises(InputError, match="3 at least"):
        model.forecast(made(1), HALF)
    with pytest.raises(InputError, match="3 at least"):
        model.forecast(preload_history([]), HALF)


@pytest.mark.parametrize("model", [WienerProcess(), ExponentialFilter()])
def test_friction_replaces_the_level(model: LifeModel) -> None:
    days = np.arange(60.0)
    force = 100 * np.exp(-0.004 * days) + np.random.default_rng(1).standard_normal(60)
    result = model.forecast(preload_history(days, friction=force, friction_uncertainty=1.0), HALF)
    assert result.quantile(0.5) == pytest.approx(math.log(2) / 0.004 - 59, rel=0.4)


@pytest.mark.parametrize("model", [WienerProcess(), ExponentialFilter()])
def test_the_effect_of_the_temperature_is_no_wear(model: LifeModel) -> None:
    """The last runs are 8 K warmer, and softer by the warmth."""
    days = np.arange(60.0)
    warmer, noise = 8.0 * (days > 45), 1e-3 * np.random.default_rng(1).standard_normal(60)
    level = np.exp(0.004 * days / 3) - 1 + noise
    lives = {}
    for effect in (0.0, 2e-3):
        for name, temperature in (("known", warmer), ("unknown", np.full(60, np.nan))):
            history = preload_history(days, level + effect * warmer, 1e-3, temperature=temperature)
            lives[name, effect] = float(model.forecast(history, HALF).quantile(0.5))
    assert lives["known", 2e-3] == pytest.approx(lives["known", 0.0], rel=0.03)
    assert lives["unknown", 2e-3] < 0.85 * lives["unknown", 0.0]


def test_few_runs_scatter_as_they_state() -> None:
    """Two second differences do not show a scatter."""
    assert _scatter(np.array([0.0, 9.0, 0.0, 9.0])) == 1.0
    assert _scatter(np.array([0.0, 9.0, 0.0, 9.0, 0.0])) > 9.0
    assert _scatter(np.random.default_rng(1).standard_normal(2000)) == pytest.approx(1.0, abs=0.05)
