"""Levels of visits with outliers limited, and their scatter: a recursion over the visits of m histories.

Its state is the levels of the visits that later ones refer to, and sums: those of the baseline, around steps,
and the newest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import Design
from ballscrew.monitoring.detection.odds import Coefficients

_LINE = 0.51  # weight of a deviation from the line through the neighbours: each run is in three
_LAG = 2  # newest runs that do not yet count in their own scatter
_FAR = 3.0  # standard deviations of a deviation that counts in full in the scatter


@dataclass(frozen=True, slots=True, eq=False)
class ResidualState:
    """State of the recursion after r visits of a design, in m histories.

    Parameters
    ----------
    visit, baseline : tuple of ndarray, r arrays of shape (m,)
        Level of each visit after its repeat, and the level from which coefficients are estimated: outliers of
        the baseline are limited. Runs around a later step are as measured, since steep wear is limited too,
        and the first run after a step is not.
    total, weight : ndarray, shape (m,)
        Weighted sum of squared deviations for the scatter, and the sum of its weights.
    pending : tuple of tuple of ndarray
        Deviations of the newest visits, which do not count yet, and their weights.
    """

    visit: tuple[Array, ...]
    baseline: tuple[Array, ...]
    total: Array
    weight: Array
    pending: tuple[tuple[Array, Array], ...] = ()

    def part(self, rows: NDArray[np.int_]) -> ResidualState:
        """Select visits."""
        visit, baseline = (tuple(levels[i] for i in rows) for levels in (self.visit, self.baseline))
        return replace(self, visit=visit, baseline=baseline)


@dataclass(frozen=True, slots=True, eq=False)
class VisitResidual:
    """Levels of a visit in m histories, each array of shape (m,).

    Parameters
    ----------
    first, level : ndarray
        After its first run, and after its repeat; outliers limited.
    scale : ndarray
        Scatter over the stated uncertainty, from the visits before.
    """

    first: Array
    level: Array
    scale: Array


def no_residuals(design: Design, draws: int) -> ResidualState:
    """State before the first visit, by the prior of the scatter."""
    settings = design.settings
    degrees = settings.scale_degrees
    total, weight = np.full(draws, degrees * settings.scale**2), np.full(draws, degrees)
    return ResidualState((), (), total, weight)


def add_residual(
    design: Design,
    k: int,
    coefficients: Coefficients,
    state: ResidualState,
    levels: Array,
    again: Array | None = None,
) -> tuple[ResidualState, VisitResidual]:
    """Limit the outliers of a visit, and estimate the scatter of those before.

    Parameters
    ----------
    design : Design
        With the k earlier visits of the state.
    k : int
        Row of the visit.
    coefficients : Coefficients
        As known before the visit.
    state : ResidualState
        Before the visit.
    levels : ndarray, shape (m,)
        As measured.
    again : ndarray, shape (m,), optional
        Levels of repeats; nan where there is none. The mean of two that agree is the visit's level, else the
        lower; it is not limited.

    Returns
    -------
    ResidualState
        After the visit.
    VisitResidual
        Each history is treated independently of the others.
    """
    settings, pending = design.settings, state.pending
    total, weight = state.total, state.weight
    if len(pending) >= _LAG:
        (square, information), *pending_later = pending
        total = total + information * np.minimum(square, _FAR**2 * total / weight)
        weight, pending = weight + information, tuple(pending_later)
    scale = np.sqrt(total / weight)
    state = replace(state, total=total, weight=weight, pending=pending)
    if not k:
        return _with_level(state, levels, levels), VisitResidual(levels, levels, scale)
    error = levels - coefficients.expected(design.columns[k])
    neighbours = [state.visit[j] - coefficients.expected(design.columns[j]) for j in range(max(k - 2, 0), k)]
    change = coefficients.variance(design.columns[k] - design.columns[k - 1])
    doubt = change + design.unknown_temperature[k] ** 2
    limit = settings.clip * np.sqrt(scale**2 * design.uncertainty[k] ** 2 + doubt)
    low, high = np.min(neighbours, axis=0) - limit, np.max(neighbours, axis=0) + limit
    first = levels + (np.clip(error, low, high) - error)
    visit = levels
    if again is not None and np.isfinite(again).any():
        shift = _repeat_shift(again - levels, limit)
        visit, error = levels + shift, error + shift
        high = np.where(np.isfinite(again), np.inf, high)
    limited = visit + (np.clip(error, low, high) - error)
    baseline = visit
    if k < settings.baseline_runs:
        baseline = limited
    state = _with_level(state, visit, baseline)
    if k >= 2:
        deviation = _deviation_from_line(design, coefficients, state.visit, k, scale)
        state = replace(state, pending=(*state.pending, deviation))
    return state, VisitResidual(first, limited, scale)


def _with_level(state: ResidualState, visit: Array, baseline: Array) -> ResidualState:
    return replace(state, visit=(*state.visit, visit), baseline=(*state.baseline, baseline))


def _repeat_shift(difference: Array, limit: Array) -> Array:
    """Shift of a visit's level by a repeat: to the mean of two runs that agree, else to the lower."""
    shift = np.where(np.abs(difference) <= limit, difference / 2, np.fmin(difference, 0.0))
    return np.where(np.isfinite(difference), shift, 0.0)


def _deviation_from_line(
    design: Design, coefficients: Coefficients, levels: tuple[Array, ...], k: int, scale: Array
) -> tuple[Array, Array]:
    """Squared deviation of a run from the line through its neighbours over its variance, and its weight.

    Steady wear does not count as scatter.
    """
    gap = design.days[k] - design.days[k - 2]
    part = 0.5
    if gap > 0:
        part = (design.days[k - 1] - design.days[k - 2]) / gap
    parts = np.array([-(1 - part), 1.0, -part])
    rows = np.arange(k - 2, k + 1)
    x = parts @ design.columns[rows]
    deviation = parts @ np.stack([levels[row] for row in rows]) - coefficients.expected(x)
    own = float(parts**2 @ design.uncertainty[rows] ** 2)
    unknown = float(parts**2 @ design.unknown_temperature[rows] ** 2)
    whole = own + (coefficients.variance(x) + unknown) / scale**2
    return deviation**2 / whole, _LINE * own / whole
