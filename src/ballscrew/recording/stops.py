"""Stops of an axis: clusters of positions, and the nearest stop to a position."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array

_GAP = 0.005  # of the travel: nearer positions are of one stop
_LEAST_GAP = 0.5e-3  # m

Positions = Sequence[float] | Array


def cluster(positions: Positions) -> Array:
    """Find the stops of an axis from its positions at standstill, without a plan.

    Positions that differ by more than 0.5 % of the travel, and half a millimetre, are two stops.

    Parameters
    ----------
    positions : sequence of float
        Positions at standstill, m.

    Returns
    -------
    ndarray, shape (n_stops,)
        The median of each cluster, ascending, m.
    """
    if len(positions) == 0:
        return np.empty(0)
    ordered = np.sort(np.asarray(positions, dtype=np.float64))
    gap = max(_GAP * (ordered[-1] - ordered[0]), _LEAST_GAP)
    groups = np.split(ordered, np.flatnonzero(np.diff(ordered) > gap) + 1)
    return np.array([np.median(group) for group in groups])


def nearest(positions: Positions, stops: Positions) -> NDArray[np.intp]:
    """Index of the stop nearest to each position.

    Parameters
    ----------
    positions : sequence of float
        Positions at standstill, m.
    stops : sequence of float
        Positions of one stop or more, m.

    Returns
    -------
    ndarray of int, shape of ``positions``
        Indices into ``stops``.
    """
    distance = np.abs(np.subtract.outer(np.asarray(positions, dtype=np.float64), np.asarray(stops)))
    return np.asarray(distance.argmin(axis=-1), dtype=np.intp)
