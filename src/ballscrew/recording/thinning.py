"""The compiled inner loop of :mod:`~ballscrew.recording.decimate`: importing this module loads numba."""

from __future__ import annotations

from numba import njit

from ballscrew.base.arrays import Array

__all__ = ["filtered"]


@njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def filtered(line: Array, first: int, taps: Array, step: int, out: Array) -> None:
    """Every so many samples of a filtered signal, which beyond its ends is taken to stay.

    Parameters
    ----------
    line : ndarray, shape (n,)
        Signal.
    first : int
        Of it, the sample that is kept first.
    taps : ndarray, shape (2 * half + 1,)
        Symmetric, of sum 1.
    step : int
        Samples from one that is kept to the next.
    out : ndarray, shape (m,)
        Filled.
    """
    half, last = taps.size // 2, line.size - 1
    level = line[first]  # a position of half a metre must not cost its last digits
    for j in range(out.size):
        begin = first + j * step - half
        total = 0.0
        if begin >= 0 and begin + taps.size <= line.size:
            part = line[begin : begin + taps.size]  # a slice of its own is six times as fast
            for k in range(taps.size):
                total += taps[k] * (part[k] - level)
        else:
            for k in range(taps.size):
                total += taps[k] * (line[min(max(begin + k, 0), last)] - level)
        out[j] = total + level
