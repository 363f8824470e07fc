"""The compiled inner loop of :mod:`~ballscrew.recording.decimate`: importing this module loads numba."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["filtered"]

Array = NDArray[np.float64]


@njit(cache=True, fastmath={"reassoc", "contract", "nsz"}, nogil=True)
def filtered(rows: Array, taps: Array, step: int, out: Array) -> None:
    """Every so many samples of filtered rows.

    Parameters
    ----------
    rows : ndarray, shape (n_rows, n)
        Signals, with as many samples beside those wanted as the filter reaches.
    taps : ndarray, shape (k,)
        Symmetric.
    step : int
        Samples from one that is kept to the next.
    out : ndarray, shape (n_rows, m)
        Filled; ``(m - 1) * step + k`` is ``n`` at most.
    """
    for row in range(rows.shape[0]):
        line = rows[row]
        for j in range(out.shape[1]):
            part = line[j * step : j * step + taps.size]  # a slice of its own is six times as fast
            total = 0.0
            for k in range(taps.size):
                total += taps[k] * part[k]
            out[row, j] = total
