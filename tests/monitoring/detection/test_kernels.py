"""Compiled kernels of the odds: density, exponential and each step of the update against plain arithmetic."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import norm

from ballscrew.monitoring.detection import kernels as module
from ballscrew.monitoring.detection.kernels import (
    accumulate_ratio,
    innovation,
    mean_or_lower,
    put_histories,
    update_coefficients,
)
from ballscrew.monitoring.detection.settings import MonitorSettings

SETTINGS = MonitorSettings()


def density_of(error: np.ndarray, noise: float, doubt: float) -> np.ndarray:
    values = np.atleast_2d(error).astype(np.float32)
    found = np.empty_like(values)
    module.run_density(values, module.run_mixture(noise, doubt, SETTINGS), found)
    return found[0]


def test_the_exponential_is_that_of_the_library() -> None:
    x = -np.linspace(0, 59, 5000, dtype=np.float32)
    found = np.array([module._exp(value) for value in x], np.float64)
    np.testing.assert_allclose(found, np.exp(x.astype(np.float64)), rtol=3e-7)
    assert 0 < module._exp(np.float32(-1e30)) < 1e-25


def test_a_run_is_ordinary_or_an_outlier(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_ANYTHING", 0.0)
    error = np.linspace(-6, 6, 41)
    wide = np.sqrt(SETTINGS.odd_size**2 * 0.7 + 0.3)
    expected = (1 - SETTINGS.odd) * norm.pdf(error) + SETTINGS.odd * norm.pdf(error, scale=wide)
    np.testing.assert_allclose(density_of(error, 0.7, 0.3) / np.sqrt(2 * np.pi), expected, rtol=1e-5)


def test_the_density_has_a_floor_however_far_off_a_run_is() -> None:
    found = density_of(np.array([50.0, 1e6, 1e12]), 0.7, 0.3)
    assert found == pytest.approx(module._ANYTHING, rel=1e-3)


F = np.float32


@pytest.fixture
def sample() -> Callable[..., np.ndarray]:
    random = np.random.default_rng(3)
    return lambda *shape: random.standard_normal(shape).astype(F)


def test_the_innovation_of_a_visit(sample: Callable[..., np.ndarray]) -> None:
    level, wear, row, mean, error = sample(9), sample(3), sample(4), sample(4, 3, 9), np.empty((3, 9), F)
    innovation(level, wear, row, mean, error)
    expected = level - wear[:, None] - np.einsum("p,prm->rm", row, mean)
    np.testing.assert_allclose(error, expected, atol=1e-5)


def test_two_runs_that_agree_are_their_mean_and_else_the_lower(sample: Callable[..., np.ndarray]) -> None:
    error, repeat = sample(2, 50), sample(2, 50)
    expected = np.where(np.abs(error - repeat) <= 1, (error + repeat) / 2, np.minimum(error, repeat))
    assert 20 < (np.abs(error - repeat) <= 1).sum() < 80
    mean_or_lower(error, repeat, F(1.0))
    np.testing.assert_allclose(error, expected, atol=1e-6)


def test_a_large_innovation_updates_no_more_than_the_bound(sample: Callable[..., np.ndarray]) -> None:
    error, gain, mean = 3 * sample(2, 50), sample(4), sample(4, 2, 50)
    updated = np.empty_like(mean)
    update_coefficients(error, gain, F(1.5), mean, updated)
    np.testing.assert_allclose(updated, mean + gain[:, None, None] * np.clip(error, -1.5, 1.5), atol=1e-5)


def test_the_ratio_of_a_single_run_is_bounded(sample: Callable[..., np.ndarray]) -> None:
    density, healthy, ratio = (
        np.abs(sample(3, 20)) + F(0.1),
        np.abs(sample(20)) + F(0.1),
        np.abs(sample(3, 20)),
    )
    largest, later, peak = np.abs(sample(3, 20)), np.empty((3, 20), F), np.empty((3, 20), F)
    caps = np.array([1 / 2, 1 / 4, 5], F)
    for repeated, part in ((False, 1.0), (True, 4.0)):
        summed = np.ones(20)
        accumulate_ratio(density, healthy, repeated, caps, F(0.5), ratio, largest, later, peak, summed)
        now = density / healthy
        np.testing.assert_allclose(later, np.minimum(ratio * now, 5), rtol=1e-5)
        np.testing.assert_allclose(peak, np.maximum(largest, now / part), rtol=1e-5)
        expected = 1 + 0.5 * (later / np.maximum(peak / 2, 1)).mean(axis=0)
        np.testing.assert_allclose(summed, expected, rtol=1e-5)


def test_numbers_that_all_rates_share_are_broadcast(sample: Callable[..., np.ndarray]) -> None:
    mean, gain, error = sample(2, 1, 20), sample(2), sample(3, 20)
    repeated = np.repeat(mean, 3, axis=1)
    found = np.empty((2, 2, 3, 20), F)
    for number, each in enumerate((mean, repeated)):
        update_coefficients(error, gain, F(1.5), each, found[number])
    np.testing.assert_array_equal(found[0], found[1])
    density, healthy = np.abs(sample(3, 20)) + F(0.1), np.abs(sample(20)) + F(0.1)
    caps, later, peak = np.array([1 / 2, 1 / 4, 5], F), np.empty((3, 20), F), np.empty((3, 20), F)
    ones = np.ones((1, 20), F)
    accumulate_ratio(density, healthy, False, caps, F(0.5), ones, ones, later, peak, np.ones(20))
    np.testing.assert_allclose(later, np.minimum(density / healthy, 5), rtol=1e-5)
    np.testing.assert_allclose(peak, np.maximum(density / healthy, 1), rtol=1e-5)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_histories_are_overwritten(dtype: type) -> None:
    whole = np.random.default_rng(2).standard_normal((6, 20)).astype(dtype)
    which, changed = np.array([1, 4, 19]), whole.copy()
    put_histories(2 * whole[:, which], which, changed)
    whole[:, which] *= 2
    np.testing.assert_array_equal(changed, whole)
