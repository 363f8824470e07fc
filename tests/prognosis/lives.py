"""Lives of known end."""

from __future__ import annotations

from typing import Any

import numpy as np

from ballscrew.prognosis.particle_filter import ParticleFilter
from ballscrew.prognosis.preload_history import PreloadHistory, preload_history
from ballscrew.prognosis.wear_path import day_of, remaining_after, travel_until, worn_time

QUICK = ParticleFilter(particles=800, moves=5)
ONSET, RATE, EXPONENT = 15.0, 0.003, np.array(0.5)
LOAD, RELAXING, RELAXATION = np.array(0.1), np.array(0.3), np.array(6.0)


def end(remaining: float = 0.5 ** (2 / 3)) -> float:
    worn = travel_until(remaining, EXPONENT, LOAD) / RATE
    return ONSET + float(day_of(worn, RELAXING, RELAXATION))


def remaining(days: np.ndarray) -> np.ndarray:
    return remaining_after(RATE * worn_time(days - ONSET, RELAXING, RELAXATION), EXPONENT, LOAD)


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
