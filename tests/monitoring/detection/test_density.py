"""The density of a run, and the exponential that it is made of."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from ballscrew.monitoring.detection import density as module
from ballscrew.monitoring.detection.settings import MonitorSettings

KEPT = MonitorSettings()


def of(off: np.ndarray, noise: float, doubt: float) -> np.ndarray:
    values = np.atleast_2d(off).astype(np.float32)
    found = np.empty_like(values)
    module.single(values, module.ordinary(noise, doubt, KEPT), found)
    return found[0]


def test_the_exponential_is_that_of_the_library() -> None:
    x = -np.linspace(0, 59, 5000, dtype=np.float32)
    found = np.array([module._exp(one) for one in x], np.float64)
    np.testing.assert_allclose(found, np.exp(x.astype(np.float64)), rtol=3e-7)
    assert 0 < module._exp(np.float32(-1e30)) < 1e-25


def test_a_run_is_ordinary_or_odd(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_ANYTHING", 0.0)
    off = np.linspace(-6, 6, 41)
    wide = np.sqrt(KEPT.odd_size**2 * 0.7 + 0.3)
    expected = (1 - KEPT.odd) * norm.pdf(off) + KEPT.odd * norm.pdf(off, scale=wide)
    np.testing.assert_allclose(of(off, 0.7, 0.3) / np.sqrt(2 * np.pi), expected, rtol=1e-5)


def test_of_a_run_that_may_be_anything_something_is_left_however_far_off() -> None:
    found = of(np.array([50.0, 1e6, 1e12]), 0.7, 0.3)
    assert found == pytest.approx(module._ANYTHING, rel=1e-3)
