"""Lives of known end."""

from __future__ import annotations

from typing import Any

import numpy as np

from ballscrew.prognosis.family_average import FamilyAverage
from ballscrew.prognosis.preload_history import PreloadHistory, preload_history

QUICK = FamilyAverage(samples=1000, most=30)
ONSET, RATE = 15.0, 0.003  # part of the approach that wear by the contact pressure takes a day


def end(remaining: float = 0.5 ** (2 / 3)) -> float:
    return ONSET + 2 * (1 - remaining**0.5) / RATE


def remaining(days: np.ndarray) -> np.ndarray:
    """x, by −dx/dt = RATE √x."""
    return np.asarray(np.maximum(1 - RATE * np.maximum(days - ONSET, 0.0) / 2, 0.0) ** 2)


def made(last: float, seed: int = 1, noise: float = 0.004, **more: Any) -> PreloadHistory:
    """A run a day."""
    random = np.random.default_rng(seed)
    days = np.arange(0.0, last + 1)
    level = np.maximum(remaining(days), 1e-3) ** -0.5 - 1 + noise * random.standard_normal(len(days))
    return preload_history(days, level, 1.4 * noise, **more)


def healthy(last: float, seed: int = 1, noise: float = 0.004) -> PreloadHistory:
    random = np.random.default_rng(seed)
    days = np.arange(0.0, last + 1)
    return preload_history(days, noise * random.standard_normal(len(days)), 1.4 * noise)
