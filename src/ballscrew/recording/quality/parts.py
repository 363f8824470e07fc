"""Whether a channel keeps its delay through a record: lost samples step it, another clock lets it drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array

__all__ = ["Change", "change", "lags"]


_LONGEST = 0.1  # s
_ALIKE = 0.95  # correlation below which a part tells no lag
_LEAST_PARTS = 8
_LEAST_SIDE = 3  # parts on either side of a step, so that a single odd one is none
_SIGMAS = 6.0
_LEAST = 0.25e-3  # s; below 0.3 ms a delay moves the frequency by less than 0.01 %
_STEADY = 0.5  # of what a step leaves, that a line may leave to be a drift


@dataclass(frozen=True, slots=True)
class Change:
    """A delay that does not stay.

    Parameters
    ----------
    by : float
        Later in the end than in the beginning, s.
    time : float
        Where it steps, s; NaN for a drift.
    """

    by: float
    time: float


def lags(signal: Array, model: Array, parts: Sequence[NDArray[np.intp]], rate: float) -> Array:
    """By how much a signal is later than its model in each part of a record.

    Parameters
    ----------
    signal, model : ndarray, shape (n,)
        At one rate.
    parts : sequence of ndarray of int
        Samples of each part, one after the other without a gap.
    rate : float
        Hz.

    Returns
    -------
    ndarray, shape (n_parts,)
        s, from the peak of the correlation; NaN where they are not alike.
    """
    reach = round(_LONGEST * rate)
    found = np.full(len(parts), np.nan)
    for index, part in enumerate(parts):
        first, last = int(part[0]), int(part[-1]) + 1
        # What a filter makes of the record's own ends is no measurement.
        if first < 2 * reach or last + 2 * reach > len(signal) or last - first < 3:
            continue
        around = signal[first - reach : last + reach]
        around = around - around.mean()
        own = model[first:last] - model[first:last].mean()
        size = _spreads(around, last - first) * np.sqrt(np.sum(own**2) * (last - first))
        alike = np.correlate(around, own) / np.where(size > 0, size, np.inf)
        best = int(np.argmax(alike))
        if alike[best] < _ALIKE or not 0 < best < len(alike) - 1:
            continue
        before, here, after = alike[best - 1 : best + 2]
        bend = before - 2 * here + after
        found[index] = (best - reach + (0.5 * (before - after) / bend if bend < 0 else 0.0)) / rate
    return found


def _spreads(x: Array, size: int) -> Array:
    """Standard deviation of every span of so many samples."""
    sums, squares = (np.concatenate([[0.0], np.cumsum(y)]) for y in (x, x**2))
    mean = (sums[size:] - sums[:-size]) / size
    return np.asarray(np.sqrt(np.maximum((squares[size:] - squares[:-size]) / size - mean**2, 0.0)))


def change(lag: Array, time: Array) -> Change | None:
    """Find a step or a drift in the lags of a record's parts.

    Parameters
    ----------
    lag, time : ndarray, shape (n,)
        s; lags may be NaN.

    Returns
    -------
    Change or None
        None where the lags scatter about one value, or too few are known.
    """
    known = np.isfinite(lag)
    if np.count_nonzero(known) < max(_LEAST_PARTS, len(lag) / 2):
        return None
    lag, time = lag[known], time[known]
    # Neighbours share a drift, and all but one pair of them a step: what they differ by is scatter.
    scatter = 1.05 * float(np.median(np.abs(np.diff(lag))))
    splits = range(_LEAST_SIDE, len(lag) - _LEAST_SIDE + 1)
    lefts = [len(lag[:at]) * np.var(lag[:at]) + len(lag[at:]) * np.var(lag[at:]) for at in splits]
    left = float(np.min(lefts))
    at = splits[int(np.argmin(lefts))]
    step = float(np.median(lag[at:]) - np.median(lag[:at]))
    if abs(step) <= max(_LEAST, _SIGMAS * scatter):
        return None
    line = np.polynomial.Polynomial.fit(time, lag, 1)
    if np.sum((lag - line(time)) ** 2) < _STEADY * left:
        return Change(float(line(time[-1]) - line(time[0])), float("nan"))
    return Change(step, float(0.5 * (time[at - 1] + time[at])))
