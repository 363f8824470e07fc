from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from ballscrew.modal.joint.whitening import free_responses, whiten_windows

RATE = 2000.0
FIRST = np.array([0, 300, 500])
TAPS = np.array([1.0, -0.7, 0.2, 0.05])
OMEGA = np.array([2 * math.pi * 100, 2 * math.pi * 150])


@pytest.fixture
def keep() -> np.ndarray:
    keep = np.ones(500, bool)
    keep[:20], keep[250:320], keep[480:] = False, False, False
    return keep


def rings(keep: np.ndarray, taps: np.ndarray = TAPS) -> np.ndarray:
    out = np.full((500, 2), np.nan)
    free_responses(
        FIRST, np.array([20, 320]), OMEGA[:, None], np.full((2, 1), 0.03), 1 / RATE, taps, keep, out
    )
    return out


def test_ringing_is_orthonormal_and_spans_every_phase(keep) -> None:
    out = rings(keep)
    for start, begin, stop, omega in ((0, 20, 300, OMEGA[0]), (300, 320, 500, OMEGA[1])):
        own = out[start:stop]
        np.testing.assert_allclose(own.T @ own, np.eye(2), atol=1e-12)
        time = (np.arange(start, stop) - begin) / RATE
        swing = omega * math.sqrt(1 - 0.03**2) * time
        free = np.exp(-0.03 * omega * np.maximum(time, 0)) * np.cos(swing + 0.7)
        free = lfilter(TAPS, [1.0], free) * keep[start:stop]
        np.testing.assert_allclose(own @ (own.T @ free), free, atol=1e-12)


def test_a_window_of_which_nothing_counts_rings_not() -> None:
    assert not rings(np.zeros(500, bool)).any()


@pytest.mark.parametrize("taps", [np.ones(1), TAPS])
def test_prepared_as_by_filter_mask_and_projection(keep, taps) -> None:
    values = np.random.default_rng(1).normal(size=(500, 3))
    free = rings(keep, taps)
    out = np.full_like(values, np.nan)
    whiten_windows(values, FIRST, taps, keep, free, out)
    for start, stop in ((0, 300), (300, 500)):
        part = lfilter(taps, [1.0], values[start:stop], axis=0) * keep[start:stop, None]
        own = free[start:stop]
        np.testing.assert_allclose(out[start:stop], part - own @ (own.T @ part), atol=1e-12)
