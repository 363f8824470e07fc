"""Whitens windows and takes their free ringing out; compiled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ballscrew.base.arrays import Array

__all__ = ["prepare", "ringing"]


@njit(cache=True)
def prepare(
    values: Array,
    first: NDArray[np.int64],
    taps: Array,
    keep: NDArray[np.bool_],
    free: Array,
    out: Array,
) -> None:
    """Filter every window from rest, keep what counts, and make it orthogonal to two columns.

    Parameters
    ----------
    values : ndarray, shape (n, columns)
        Of all windows, one after the other.
    first : ndarray, shape (windows + 1,)
        First sample of each.
    taps : ndarray
        Of the filter.
    keep : ndarray of bool, shape (n,)
        Samples that count.
    free : ndarray, shape (n, 2)
        Orthonormal in every window.
    out : ndarray, shape (n, columns)
        Filled.
    """
    columns = values.shape[1]
    for window in range(first.shape[0] - 1):
        start, stop = first[window], first[window + 1]
        parts = np.zeros((2, columns))
        for i in range(start, stop):
            if not keep[i]:
                out[i] = 0.0
                continue
            for c in range(columns):
                out[i, c] = taps[0] * values[i, c]
            for k in range(1, min(len(taps), i - start + 1)):
                for c in range(columns):
                    out[i, c] += taps[k] * values[i - k, c]
            for c in range(columns):
                parts[0, c] += free[i, 0] * out[i, c]
                parts[1, c] += free[i, 1] * out[i, c]
        for i in range(start, stop):
            if keep[i]:
                for c in range(columns):
                    out[i, c] -= free[i, 0] * parts[0, c] + free[i, 1] * parts[1, c]


@njit(cache=True)
def ringing(
    first: NDArray[np.int64],
    begin: NDArray[np.int64],
    omega: Array,
    damping: Array,
    dt: float,
    taps: Array,
    keep: NDArray[np.bool_],
    out: Array,
) -> None:
    """Orthonormal free ringing of every window, filtered and cut to what counts.

    Parameters
    ----------
    first : ndarray, shape (windows + 1,)
        First sample of each window.
    begin : ndarray, shape (windows,)
        Sample of each at which it begins to ring.
    omega : ndarray, shape (windows,)
        Angular frequency, rad/s.
    damping : ndarray, shape (windows,)
        Ratio.
    dt : float
        s.
    taps, keep
        As for :func:`prepare`.
    out : ndarray, shape (n, 2)
        Filled; 0 where nothing counts.
    """
    for window in range(first.shape[0] - 1):
        start, stop = first[window], first[window + 1]
        pair = np.empty((stop - start, 2))
        for i in range(stop - start):
            time = (start + i - begin[window]) * dt
            zeta = damping[window]
            swing = omega[window] * math.sqrt(1 - zeta * zeta) * time
            fade = math.exp(-zeta * omega[window] * max(time, 0.0))
            pair[i, 0], pair[i, 1] = fade * math.cos(swing), fade * math.sin(swing)
        for i in range(stop - start):
            a = b = 0.0
            if keep[start + i]:
                for k in range(min(len(taps), i + 1)):
                    a += taps[k] * pair[i - k, 0]
                    b += taps[k] * pair[i - k, 1]
            out[start + i, 0], out[start + i, 1] = a, b
        _normalised(out[start:stop, 0])
        for _ in range(2):  # once more, since rounding leaves a little
            part = 0.0
            for i in range(start, stop):
                part += out[i, 0] * out[i, 1]
            for i in range(start, stop):
                out[i, 1] -= part * out[i, 0]
            _normalised(out[start:stop, 1])


@njit(cache=True)
def _normalised(x: Array) -> None:
    total = 0.0
    for i in range(x.shape[0]):
        total += x[i] * x[i]
    size = math.sqrt(total)
    for i in range(x.shape[0]):
        x[i] = x[i] / size if size > 0 else 0.0
