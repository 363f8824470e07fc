"""Statistics of a chart: robust residuals against the baseline, ramp, and odds of wear.

*Residuals.* A run far from its baseline counts in full only where the run before it is about as far:
otherwise it is limited to a few standard deviations beyond that. Wear persists; an outlier does not.

*Ramp.* Generalised likelihood ratio for a ramp of unknown onset: for every onset τ the slope is estimated by
generalised least squares over all runs so far, with level, temperature and steps and their priors; the
statistic is the largest of slope over its standard deviation (Willsky and Jones, 1976, DOI
10.1109/TAC.1976.1101146). Onsets lie on a grid that is finer towards the newest run: a ramp is found about as
well from an onset that is a little off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import CoefficientFit, Design, coefficients, fit_coefficients
from ballscrew.monitoring.detection.odds import odds

BEGIN = 3
"""Good runs before the first with a statistic."""

_LINE = 0.51  # weight of a deviation from the line through the neighbours: each run is in three
_LAG = 2  # newest runs that do not yet count in their own scatter
_FAR = 3.0  # standard deviations of a deviation that counts in full in the scatter
_LEAST_INFORMATION = 1e-9  # on a slope, relative to that without other coefficients


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Levels of n visits in m histories, robust against outliers.

    Parameters
    ----------
    first : ndarray, shape (n, m)
        Levels after the first run of each visit, outliers limited.
    level : ndarray, shape (n, m)
        The same after its repeat.
    baseline : ndarray, shape (n, m)
        Levels from which coefficients are estimated: outliers of the baseline are limited. Runs around a
        later step are as measured, since steep wear is limited too, and the first run after a step is not.
    scale : ndarray, shape (n, m)
        Scatter over the stated uncertainty, from the runs before the newest.
    """

    first: Array
    level: Array
    baseline: Array
    scale: Array


@dataclass(frozen=True, slots=True, eq=False)
class Statistics:
    """Statistics of n visits in m histories.

    Parameters
    ----------
    ramp_first, odds_first : ndarray, shape (n, m)
        After the first run of each visit.
    ramp, odds : ndarray, shape (n, m)
        After its repeat; the same where there was none.
    repeated : ndarray of bool, shape (n, m)
        Visits with a repeat.
    onset : ndarray of int, shape (n, m)
        Visit at which the ramp seems to begin.
    residuals : Residuals
        Levels with outliers limited, and scatter.
    """

    ramp_first: Array
    odds_first: Array
    ramp: Array
    odds: Array
    repeated: NDArray[np.bool_]
    onset: NDArray[np.int_]
    residuals: Residuals


def statistics(
    design: Design,
    levels: Array,
    again: Array | None = None,
    threshold: Callable[[int, Array], float] | None = None,
) -> Statistics:
    """Both statistics of histories.

    Parameters
    ----------
    design : Design
        The epoch, a row per visit.
    levels : ndarray, shape (n, m)
        Its levels in m histories.
    again : ndarray, shape (n, m), optional
        Levels of repeats; nan where there is none.
    threshold : callable, optional
        See :func:`~ballscrew.monitoring.detection.odds.odds`: repeats count only where the odds exceed it, or
        where the first run is far off.

    Returns
    -------
    Statistics
        Later runs do not change them.
    """
    far = None
    if again is not None and threshold is not None:
        far = far_off(design, levels)
    worn = odds(design, levels, BEGIN, again, threshold, far)
    if again is not None:
        again = np.where(worn.repeated, again, np.nan)
    robust = residuals(design, levels, again)
    grown, onset, first = ramp(design, robust.level, robust.scale, BEGIN, robust.first)
    return Statistics(first, worn.first, grown, worn.all, worn.repeated, onset, robust)


def far_off(design: Design, levels: Array) -> NDArray[np.bool_]:
    """Runs that are too far up to count in full, before any repeat.

    Parameters
    ----------
    design : Design
        The epoch, a row per visit.
    levels : ndarray, shape (n, m)
        Its levels in m histories.

    Returns
    -------
    ndarray of bool, shape (n, m)
        They are to be repeated, however small the odds: far beyond the effect of wear these decrease again.
    """
    return np.asarray(residuals(design, levels).first < levels)


def residuals(design: Design, levels: Array, again: Array | None = None) -> Residuals:
    """Limit the outliers of histories, and estimate their scatter, run by run; later runs change nothing.

    Parameters
    ----------
    design : Design
        The epoch.
    levels : ndarray, shape (n, m)
        m histories of the epoch.
    again : ndarray, shape (n, m), optional
        Levels of repeats; nan where there is none. The mean of two that agree is the visit's level, else the
        lower; it is not limited.

    Returns
    -------
    Residuals
        Each history is treated independently of the others.
    """
    settings = design.settings
    count, draws = levels.shape
    # ``visit`` is the level after a repeat, ``limited`` the same with outliers limited.
    first, visit, limited, baseline = np.array([levels] * 4)
    scale = np.empty_like(levels)
    error_before = np.zeros(draws)
    degrees = settings.scale_degrees
    total, weight = np.full(draws, degrees * settings.scale**2), np.full(draws, degrees)
    deviations: list[tuple[Array, Array]] = []
    for k in range(count):
        if len(deviations) >= _LAG:
            square, information = deviations.pop(0)
            total = total + information * np.minimum(square, _FAR**2 * total / weight)
            weight = weight + information
        scale[k] = np.sqrt(total / weight)
        rows = design.baseline[k]
        if not len(rows):
            continue
        fit = fit_coefficients(design, rows, k)
        x = design.columns[k]
        error = levels[k] - x @ coefficients(design, fit, baseline)
        limit = settings.clip * _spread(design, fit, k, scale[k])
        low, high = np.minimum(error_before, 0.0) - limit, np.maximum(error_before, 0.0) + limit
        first[k] += np.clip(error, low, high) - error
        if again is not None and np.isfinite(again[k]).any():
            repeated = np.isfinite(again[k])
            shift = _repeat_shift(again[k] - levels[k], limit)
            visit[k] = limited[k] = baseline[k] = levels[k] + shift
            error, high = error + shift, np.where(repeated, np.inf, high)
        limited[k] += np.clip(error, low, high) - error
        if k < settings.baseline_runs:
            baseline[k] = limited[k]
        if k >= 2:
            deviations.append(_deviation_from_line(design, fit, visit, k, scale[k]))
        error_before = error
    return Residuals(first, limited, baseline, scale)


def _repeat_shift(difference: Array, limit: Array) -> Array:
    """Shift of a visit's level by a repeat: to the mean of two runs that agree, else to the lower."""
    shift = np.where(np.abs(difference) <= limit, difference / 2, np.fmin(difference, 0.0))
    return np.where(np.isfinite(difference), shift, 0.0)


def _spread(design: Design, fit: CoefficientFit, k: int, scale: Array) -> Array:
    """Standard deviation of a run about its expected level."""
    noise, prior = fit.variances(design.columns[k])
    inflation = (scale / design.settings.scale) ** 2
    doubt = inflation * noise + prior + design.unknown_temperature[k] ** 2
    return np.asarray(np.sqrt(scale**2 * design.uncertainty[k] ** 2 + doubt))


def _deviation_from_line(
    design: Design, fit: CoefficientFit, levels: Array, k: int, scale: Array
) -> tuple[Array, Array]:
    """Squared deviation of a run from the line through its neighbours over its variance, and its weight.

    Steady wear does not count as scatter.
    """
    gap = design.days[k] - design.days[k - 2]
    part = 0.5
    if gap > 0:
        part = (design.days[k - 1] - design.days[k - 2]) / gap
    parts = np.array([-(1 - part), 1.0, -part])
    rows = slice(k - 2, k + 1)
    x = parts @ design.columns[rows]
    deviation = parts @ levels[rows] - (x @ fit.gain) @ levels[fit.rows]
    own = float(parts**2 @ design.uncertainty[rows] ** 2)
    noise, prior = fit.variances(x)
    unknown = float(parts**2 @ design.unknown_temperature[rows] ** 2)
    whole = own + noise / design.settings.scale**2 + (prior + unknown) / scale**2
    return deviation**2 / whole, _LINE * own / whole


def onsets(k: int) -> NDArray[np.int_]:
    """Runs at which a ramp may have begun, before run k.

    Parameters
    ----------
    k : int
        From 1.

    Returns
    -------
    ndarray of int
        Descending; 1, 2, 3, 4, 6, 8, 12, … runs back, and the first.
    """
    back = [1, 2, 3]
    while back[-1] < k:
        back.append(back[-2] * 2)
    return np.unique(np.maximum(k - np.array(back), 0))[::-1]


def ramp(
    design: Design, level: Array, scale: Array, begin: int, first: Array | None = None
) -> tuple[Array, NDArray[np.int_], Array]:
    """Evidence of a ramp at each run.

    Parameters
    ----------
    design : Design
        The epoch.
    level : ndarray, shape (n, m)
        Levels of m histories, outliers limited.
    scale : ndarray, shape (n, m)
        Scatter over the stated uncertainty.
    begin : int
        First run with a statistic.
    first : ndarray, shape (n, m), optional
        Levels after the first run of each visit, where its repeat changed them.

    Returns
    -------
    ndarray, shape (n, m)
        Largest slope over its standard deviation; 0 before ``begin``.
    ndarray of int, shape (n, m)
        Its onset.
    ndarray, shape (n, m)
        The statistic after the first run of each visit.
    """
    count = len(design.days)
    weight = 1 / design.noise
    when = design.days - design.days[:1].sum()
    statistic, at = np.zeros_like(level), np.zeros(level.shape, dtype=int)
    statistic_first = np.zeros_like(level)
    weighted = weight[:, None] * level
    zeroth, moment = np.cumsum(weighted, axis=0), np.cumsum(when[:, None] * weighted, axis=0)
    columns = design.columns * weight[:, None]
    inner = np.cumsum(columns[:, :, None] * design.columns[:, None, :], axis=0)
    projected = columns[:begin].T @ level[:begin]
    for k in range(begin, count):
        projected = projected + columns[k][:, None] * level[k]
        start = onsets(k)
        slopes = np.maximum(when[: k + 1, None] - when[start], 0.0)  # (k + 1, w)
        across = columns[: k + 1].T @ slopes  # (p, w)
        profile = np.linalg.solve(inner[k] + np.diag(design.information), across)
        alone = (weight[: k + 1, None] * slopes**2).sum(axis=0)
        information = alone - (across * profile).sum(axis=0)
        usable = information > _LEAST_INFORMATION * alone
        if not usable.any():
            continue
        start, profile, information = start[usable], profile[:, usable], information[usable]
        offset = when[start, None] * (zeroth[k] - zeroth[start])
        sums = moment[k] - moment[start] - offset - profile.T @ projected
        values = sums / np.sqrt(information)[:, None]
        best = np.argmax(values, axis=0)
        statistic[k] = values[best, range(values.shape[1])] * design.settings.scale / scale[k]
        at[k] = start[best]
        statistic_first[k] = statistic[k]
        if first is None:
            continue
        changed = np.flatnonzero(first[k] != level[k])
        if len(changed):
            effect = weight[k] * (when[k] - when[start]) - profile.T @ columns[k]
            shift = (effect / np.sqrt(information))[:, None] * (first[k, changed] - level[k, changed])
            highest = (values[:, changed] + shift).max(axis=0)
            statistic_first[k, changed] = highest * design.settings.scale / scale[k, changed]
    return statistic, at, statistic_first
