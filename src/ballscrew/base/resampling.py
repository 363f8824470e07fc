"""Systematic resampling: of weighted draws as many of each as its weight says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def systematic(weight: NDArray[np.float64], start: float, size: int | None = None) -> NDArray[np.intp]:
    """Systematic resampling.

    Parameters
    ----------
    weight : ndarray, shape (m,)
        Sums to 1.
    start : float
        From 0 to 1.
    size : int, optional
        How many; by default m.

    Returns
    -------
    ndarray of int
        Indices, ascending.
    """
    count = size or len(weight)
    edges = np.cumsum(weight)
    edges[-1] = 1.0
    places = np.searchsorted(edges, (start + np.arange(count)) / count, side="right")
    return np.asarray(np.minimum(places, len(weight) - 1))
