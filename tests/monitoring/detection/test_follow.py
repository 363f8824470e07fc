"""One visit later: each step against plain arithmetic."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ballscrew.monitoring.detection.follow import apart, met, teach, weigh

F = np.float32


@pytest.fixture
def some() -> Callable[..., np.ndarray]:
    random = np.random.default_rng(3)
    return lambda *shape: random.standard_normal(shape).astype(F)


def test_how_far_a_visit_is_off(some: Callable[..., np.ndarray]) -> None:
    level, lost, row, middle, off = some(9), some(3), some(4), some(4, 3, 9), np.empty((3, 9), F)
    apart(level, lost, row, middle, off)
    expected = level - lost[:, None] - np.einsum("p,prm->rm", row, middle)
    np.testing.assert_allclose(off, expected, atol=1e-5)


def test_two_runs_that_agree_are_their_mean_and_else_the_lower(some: Callable[..., np.ndarray]) -> None:
    off, other = some(2, 50), some(2, 50)
    expected = np.where(np.abs(off - other) <= 1, (off + other) / 2, np.minimum(off, other))
    assert 20 < (np.abs(off - other) <= 1).sum() < 80
    met(off, other, F(1.0))
    np.testing.assert_allclose(off, expected, atol=1e-6)


def test_what_is_far_off_teaches_no_more_than_what_is_less_far(some: Callable[..., np.ndarray]) -> None:
    off, gain, middle = 3 * some(2, 50), some(4), some(4, 2, 50)
    taught = np.empty_like(middle)
    teach(off, gain, F(1.5), middle, taught)
    np.testing.assert_allclose(taught, middle + gain[:, None, None] * np.clip(off, -1.5, 1.5), atol=1e-5)


def test_the_ratio_goes_on_and_one_run_counts_no_more_than_its_most(some: Callable[..., np.ndarray]) -> None:
    density, sound, ratio = np.abs(some(3, 20)) + F(0.1), np.abs(some(20)) + F(0.1), np.abs(some(3, 20))
    largest, later, peak = np.abs(some(3, 20)), np.empty((3, 20), F), np.empty((3, 20), F)
    for twice, part in ((False, 1.0), (True, 4.0)):
        summed = np.ones(20)
        weigh(density, sound, twice, np.array([2, 4, 5], F), F(0.5), ratio, largest, later, peak, summed)
        now = density / sound
        np.testing.assert_allclose(later, np.minimum(ratio * now, 5), rtol=1e-5)
        np.testing.assert_allclose(peak, np.maximum(largest, now / part), rtol=1e-5)
        expected = 1 + 0.5 * (later / np.maximum(peak / 2, 1)).mean(axis=0)
        np.testing.assert_allclose(summed, expected, rtol=1e-5)
