"""Residuals against the baseline, in which one odd run counts for little, and how much runs really scatter.

A run that stands far off its baseline counts in full only where the run before it says about the same: else
it is drawn back to a few standard deviations beyond that. Wear goes on; an odd run does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import Design, Told, coefficients, told_by

__all__ = ["Residuals", "residuals"]

_LINE = 0.51  # what a run off the line through its neighbours is worth: each run is in three
_LAG = 2  # the newest runs do not yet count in the scatter that they are judged by
_FAR = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Of n runs in m histories.

    Parameters
    ----------
    first : ndarray, shape (n, m)
        Levels after the first run of each visit, odd runs drawn back.
    level : ndarray, shape (n, m)
        The same after its repeat.
    taught : ndarray, shape (n, m)
        Levels that coefficients are told from: odd runs of the baseline drawn back. Runs around a later step
        are as they were, since steep wear is drawn back too, and the first run after a step is not.
    scale : ndarray, shape (n, m)
        Scatter over the told one, as the runs before the newest show it.
    """

    first: Array
    level: Array
    taught: Array
    scale: Array


def residuals(of: Design, levels: Array, again: Array | None = None) -> Residuals:
    """Take levels apart, run by run; what comes later changes nothing.

    Parameters
    ----------
    of : Design
        The epoch.
    levels : ndarray, shape (n, m)
        m histories of it.
    again : ndarray, shape (n, m), optional
        Levels of repeats; nan where there is none. Of two that agree the mean is the visit's, else the lower;
        it is not drawn back.

    Returns
    -------
    Residuals
        The same for a history alone and among others.
    """
    kept = of.settings
    count, draws = levels.shape
    first, whole, clean, taught = (np.array(levels) for _ in range(4))
    scale = np.empty_like(levels)
    before = np.zeros(draws)
    total, weight = np.full(draws, kept.scale_degrees * kept.scale**2), np.full(draws, kept.scale_degrees)
    waiting: list[tuple[Array, Array]] = []
    for k in range(count):
        rows = of.baseline[k]
        while len(waiting) >= _LAG:
            square, worth = waiting.pop(0)
            total = total + worth * np.minimum(square, _FAR**2 * total / weight)
            weight = weight + worth
        scale[k] = np.sqrt(total / weight)
        if not len(rows):
            continue
        told = told_by(of, rows, k)
        x = of.columns[k]
        off = levels[k] - x @ coefficients(of, told, taught)
        wider = (scale[k] / kept.scale) ** 2
        noise, prior = told.doubt(x)
        doubt = wider * noise + prior + of.loose[k] ** 2
        own = of.told[k] ** 2
        spread = np.sqrt(scale[k] ** 2 * own + doubt)
        low = np.minimum(before, 0.0) - kept.clip * spread
        high = np.maximum(before, 0.0) + kept.clip * spread
        first[k] += np.clip(off, low, high) - off
        if again is not None and np.isfinite(again[k]).any():
            apart = again[k] - levels[k]
            more = np.where(np.abs(apart) <= kept.clip * spread, apart / 2, np.fmin(apart, 0.0))
            more = np.where(np.isfinite(apart), more, 0.0)
            whole[k] = clean[k] = taught[k] = levels[k] + more
            off, high = off + more, np.where(np.isfinite(apart), np.inf, high)
        clean[k] += np.clip(off, low, high) - off
        if k < kept.baseline_runs:
            taught[k] = clean[k]
        if k >= 2:
            waiting.append(_off_the_line(of, told, whole, k, scale[k]))
        before = off
    return Residuals(first, clean, taught, scale)


def _off_the_line(of: Design, told: Told, levels: Array, k: int, scale: Array) -> tuple[Array, Array]:
    """How far a run stands off the line through its neighbours, squared over the told; and its worth.

    Wear that goes on does not count as scatter.
    """
    gap = of.days[k] - of.days[k - 2]
    part = (of.days[k - 1] - of.days[k - 2]) / gap if gap > 0 else 0.5
    parts = np.array([-(1 - part), 1.0, -part])
    rows = slice(k - 2, k + 1)
    turn = parts @ of.columns[rows]
    apart = parts @ levels[rows] - (turn @ told.how) @ levels[told.rows]
    own = float(parts**2 @ of.told[rows] ** 2)
    noise, prior = told.doubt(turn)
    whole = own + noise / of.settings.scale**2 + (prior + float(parts**2 @ of.loose[rows] ** 2)) / scale**2
    return apart**2 / whole, _LINE * own / whole
