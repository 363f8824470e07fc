"""Readings of a history in one quantity: the remaining part x = 1 − w/δ₀ of the flanks' approach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.prognosis.preload_history import PreloadHistory, pool_runs

_BY_KELVIN = 0.0033  # standard deviation of the level's change by 1 K, 1/K
_FRICTION_START = 0.1  # standard deviation of x by the first readings of the friction
_FIRST_FRICTIONS = 5  # readings whose median is the initial friction
_NEIGHBOURS = 2  # readings before and after, of the running median
_ODD = 4.0  # standard deviations from its neighbours of an outlier
_FEWEST_ON_LINE = 3  # readings: two and the newest
_FARTHEST = 2.0  # spacings of the two readings before the newest that their line is continued by
_FASTER = 4.0  # pace of the newest over that of the two before: a change of regime, no outlier
_TRUE = 0.7  # usual scatter of a run over its stated uncertainty
_SATURATED = 0.9  # of the ceiling: above it the level says nothing


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """n readings of x, from level, backlash or friction.

    Parameters
    ----------
    days, remaining, uncertainty : ndarray, shape (n,)
        Day, x, and its standard uncertainty as stated; an outlier has its distance from its neighbours.
    smoothed : ndarray, shape (n,)
        Running median of x.
    temperature : ndarray, shape (n,)
        Temperature relative to the reference, K; their mean where not known, 0 where none is.
    kelvin_deviation : float
        Standard deviation of the change of x by 1 K, 1/K.
    start_deviation : float
        Standard deviation of x at the start.
    known_start : bool
        True where x is 1 at the start, so that its deviation is an error of all readings.
    initial_friction : float
        Friction at x = 1; 1 where x is not by friction.
    """

    days: Array
    remaining: Array
    uncertainty: Array
    smoothed: Array
    temperature: Array
    kelvin_deviation: float
    start_deviation: float
    known_start: bool
    initial_friction: float = 1.0

    @property
    def typical(self) -> float:
        """Median standard uncertainty of x."""
        return float(np.median(self.uncertainty))


def readings_of(history: PreloadHistory, most: int) -> Readings:
    """Readings of a history.

    Parameters
    ----------
    history : PreloadHistory
        Levels, replaced by the backlash where it is observed; or else friction, then in proportion to P.
    most : int
        Readings that are taken singly; older ones of more are pooled.

    Returns
    -------
    Readings
        Without runs that show neither.
    """
    pooled = pool_runs(history, most)
    if np.isfinite(pooled.level).any() or not np.isfinite(pooled.friction).any():
        x, spread, observed = _by_stiffness(pooled)
        kelvin_deviation, initial_friction, known_start = 2 * _BY_KELVIN, 1.0, True
    else:
        observed = np.isfinite(pooled.friction) & (pooled.friction > 0)
        initial_friction = float(np.median(pooled.friction[observed][:_FIRST_FRICTIONS]))
        x = (pooled.friction / initial_friction) ** (2 / 3)
        spread = 2 / 3 * x * pooled.friction_uncertainty / pooled.friction
        kelvin_deviation, known_start = 0.0, False
    x, spread, days = x[observed], spread[observed], pooled.days[observed]
    smoothed = _running_median(x)
    scatter = 1.4826 * np.median(np.abs(x - smoothed)) if len(x) else 0.0
    limit = _ODD * np.maximum(_TRUE * spread, scatter)
    off = _distance(days, x, smoothed)
    spread = np.where(off > limit, np.maximum(spread, off), spread)
    start_deviation = _FRICTION_START
    if known_start and len(spread):
        start_deviation = _TRUE * float(np.median(spread))
    return Readings(
        days=days,
        remaining=x,
        uncertainty=spread,
        smoothed=smoothed,
        temperature=_warmer(pooled.temperature[observed]),
        kelvin_deviation=kelvin_deviation,
        start_deviation=start_deviation,
        known_start=known_start,
        initial_friction=initial_friction,
    )


def _by_stiffness(history: PreloadHistory) -> tuple[Array, Array, NDArray[np.bool_]]:
    """X and its standard uncertainty by level and backlash, and which runs show it."""
    softer = 1 + history.level
    x, spread = softer**-2.0, 2 * softer**-3.0 * history.level_uncertainty
    lost = history.backlash > history.resolution
    x = np.where(lost, -history.backlash / 2 / history.approach, x)
    spread = np.where(lost, history.backlash_uncertainty / 2 / history.approach, spread)
    return x, spread, lost | (history.level < _SATURATED * history.ceiling)


def _warmer(temperature: Array) -> Array:
    known = temperature[np.isfinite(temperature)]
    mean = float(known.mean()) if len(known) else 0.0
    return np.asarray(np.where(np.isfinite(temperature), temperature, mean))


def _distance(days: Array, x: Array, smoothed: Array) -> Array:
    """Distance of each reading from its neighbours.

    They are the running median, but for the two newest readings, which would be off it wherever wear goes on:
    the last but one is compared with the median of itself and the readings beside it, and the newest also
    with the line through the two before it.
    """
    off = np.abs(x - smoothed)
    if len(x) < _FEWEST_ON_LINE:
        return off
    second_last, previous, newest = x[-3:]
    off[-2] = abs(previous - np.median(x[-3:]))
    first_gap, gap = np.diff(days[-3:])
    spacings = min(gap / max(first_gap, 1e-9), _FARTHEST)
    line = previous + _FASTER * spacings * min(previous - second_last, 0.0)
    low, high = sorted((smoothed[-1], line))
    off[-1] = max(low - newest, newest - high, 0.0)
    return off


def _running_median(values: Array) -> Array:
    neighbours = range(len(values))
    windows = (values[max(i - _NEIGHBOURS, 0) : i + _NEIGHBOURS + 1] for i in neighbours)
    return np.array([np.median(window) for window in windows])
