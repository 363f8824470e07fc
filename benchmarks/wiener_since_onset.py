"""The Wiener process that :mod:`benchmarks.remaining_life` counts: fitted since the wear's onset."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.forecast import Forecast
from ballscrew.prognosis.preload_history import PreloadHistory, preload_cube_root
from ballscrew.prognosis.wiener import WienerProcess

__all__ = ["WienerSinceOnset"]

SCALES = (-1.73, -1.0, -0.54, -0.17, 0.17, 0.54, 1.0, 1.73)  # standard deviations, alike in probability
FEWEST = 8  # runs since an onset that a line with motion is fitted to


@dataclass(frozen=True, slots=True)
class WienerSinceOnset:
    """A Wiener process that is fitted to the runs since wear began, as far as a ramp finds that day.

    The uncertainty of the scale that all runs share is propagated: the model forecasts the apparent end for
    each of several scales, and the forecasts are pooled.
    """

    def forecast(self, history: PreloadHistory, failure: Failure, *, at: float | None = None) -> Forecast:
        """As of every life model."""
        day = float(history.days[-1]) if at is None else at
        known = history.until(day)
        since = known.part(known.days >= ramp_onset(known))
        level = failure.remaining(history.approach) ** -0.5 - 1
        scales = 1 + history.scale * np.asarray(SCALES)
        forecasts = [
            WienerProcess().forecast(since, Failure(float((1 + level * scale) ** -3.0)), at=day)
            for scale in scales
        ]
        lives = np.sort(np.concatenate([forecast.rul_days for forecast in forecasts]))
        return replace(forecasts[len(forecasts) // 2], rul_days=lives)


def ramp_onset(known: PreloadHistory) -> float:
    """The day from which on (P/P₀)^(1/3) falls, by the ramp of least squares beside the temperature."""
    days, value, spread, warmer = preload_cube_root(known)
    best, found = math.inf, float(days[0])
    for begin in days[: max(len(days) - FEWEST, 1)]:
        columns = np.column_stack([np.ones_like(days), warmer, np.maximum(days - begin, 0.0)])
        off = (value - columns @ _solved(columns, value, spread)) / spread
        cost = float(np.minimum(off**2, 9.0).sum())  # odd runs count no more than three standard deviations
        if cost < best:
            best, found = cost, float(begin)
    return found


def _solved(columns: Array, value: Array, spread: Array) -> Array:
    weight: Array = np.ones_like(value)
    beta: Array = np.zeros(columns.shape[1])
    for _ in range(3):
        scaled = columns * (weight / spread)[:, None]
        beta = np.asarray(np.linalg.lstsq(scaled, value * weight / spread, rcond=None)[0], dtype=np.float64)
        weight = np.sqrt(1 / np.maximum(np.abs(value - columns @ beta) / (1.5 * spread), 1.0))
    return np.asarray(beta)
