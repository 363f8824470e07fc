"""Limits after the baseline: quantiles of both statistics in healthy histories that go on as it did.

They are computed once for a baseline, from histories that are continued with its days, temperatures and
uncertainties, and hold for every later visit: a limit is read at the probability of a false alarm that the
visit may spend, so pauses and other cadences need no limits of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array

Floats = NDArray[np.floating[Any]]

BLOCKS = (20, 60)
"""Visits after the baseline until which each row of a table holds; the last one holds for ever."""

_SURVIVAL = np.concatenate([[0.95, 0.9, 0.8, 0.7, 0.6], np.geomspace(0.5, 1e-9, 60)])
_LOG = -np.log(_SURVIVAL)  # ascending
_EMPIRICAL = 10.0  # values above a quantile from which on it is an empirical one
_TAIL = 300  # largest values, to which the tail is fitted
_LEAST_SHAPE, _LARGEST_SHAPE = -0.5, 0.9  # ξ of the tail


@dataclass(frozen=True, slots=True, eq=False)
class LimitTable:
    """Quantiles of the statistics, a row for each of b blocks of visits.

    Parameters
    ----------
    ramp, odds : ndarray, shape (b, q)
        After the first run of a visit, exceeded with q probabilities.
    ramp_again, odds_again : ndarray, shape (b, q)
        After a repeat, exceeded and repeated with these probabilities.
    either, either_again : ndarray, shape (b,)
        Probability that any of the two is large over that of one of them, 1 to 2.
    far_off : ndarray, shape (b,)
        Probability of a repeat that the odds do not request.
    span : float
        Days between the newest six visits, on average.
    longest : float
        Days between them beyond which longer ones hardly change the odds.
    """

    ramp: Array
    odds: Array
    ramp_again: Array
    odds_again: Array
    either: Array
    either_again: Array
    far_off: Array
    span: float
    longest: float


def block_of(later: int) -> int:
    """Row of a table.

    Parameters
    ----------
    later : int
        Visits since the baseline.

    Returns
    -------
    int
        From 0.
    """
    return min(sum(later >= end for end in BLOCKS), len(BLOCKS) - 1)


def quantiles(values: Floats, total: float) -> Array:
    """Values that are exceeded with the probabilities of a table.

    Parameters
    ----------
    values : ndarray
        Of a statistic.
    total : float
        Number of visits; more than there are values where some have none.

    Returns
    -------
    ndarray, shape (q,)
        Ascending. Beyond the largest values they are those of a generalised Pareto distribution.
    """
    if not len(values):
        return np.full(len(_SURVIVAL), np.inf)
    ordered = np.sort(np.asarray(values, dtype=float))
    rank = _SURVIVAL * total
    found = np.interp(len(ordered) - rank, np.arange(len(ordered)), ordered)
    count = min(_TAIL, len(ordered) // 2)
    few = np.flatnonzero(rank < _EMPIRICAL)
    if count > 2 and len(few):
        top = ordered[-count - 1]
        excess = (ordered[-count:] - top) / (1 + top)
        for index in few:
            found[index] = top + (1 + top) * pareto_quantile(excess, math.log(count / rank[index]))
    return np.maximum.accumulate(found)


def quantile_of(row: Array, probability: float) -> float:
    """Value that is exceeded with a probability.

    Parameters
    ----------
    row : ndarray, shape (q,)
        As :func:`quantiles` returns it.
    probability : float
        0 to 1.

    Returns
    -------
    float
        Infinite where the probability is 0.
    """
    if probability <= 0:
        return math.inf
    return float(np.interp(-math.log(probability), _LOG, row))


def pareto_quantile(excess: Floats, log_ratio: float) -> float:
    """Quantile of a generalised Pareto distribution.

    Its two parameters are by probability weighted moments (Hosking and Wallis, 1987, DOI
    10.1080/00401706.1987.10488243).

    Parameters
    ----------
    excess : ndarray
        Values, ascending.
    log_ratio : float
        −ln of the probability to exceed the quantile.

    Returns
    -------
    float
        The quantile.
    """
    mean = float(excess.mean())
    part = (np.arange(1, len(excess) + 1) - 0.35) / len(excess)
    lower = float(np.mean((1 - part) * excess))
    shape = mean / max(mean - 2 * lower, 1e-12) - 2
    shape = min(max(shape, _LEAST_SHAPE), _LARGEST_SHAPE)
    size = mean * (1 - shape)
    if abs(shape) > 1e-6:
        return size * math.expm1(shape * log_ratio) / shape
    return size * log_ratio
