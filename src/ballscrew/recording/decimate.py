"""Decimation of signals to the rate that the highest frequency of interest needs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

_SAMPLES_PER_PERIOD = 3.2  # of the highest frequency
_REJECTION_DB = 108.0  # asked of Kaiser's formula, which is a few dB short


@dataclass(frozen=True, slots=True, eq=False)
class Decimator:
    """A filter without delay, followed by decimation.

    Parameters
    ----------
    step : int
        Samples from each output sample to the next; 1 for all samples, which are not filtered then.
    taps : ndarray, shape (2 * half + 1,)
        Filter coefficients, symmetric, of sum 1.
    """

    step: int
    taps: Array

    def __call__(self, lines: Sequence[Array], first: int, last: int) -> Array:
        """Samples ``first``, ``first + step`` ... below ``last`` of filtered signals; always a copy.

        The filter uses samples outside the span; a signal is continued by its first and last sample.

        Parameters
        ----------
        lines : sequence of ndarray, shape (n,)
            Signals of one length.
        first, last : int
            The span.

        Returns
        -------
        ndarray, shape (lines, m)
            With m samples, ``(last - first) / step`` rounded up.

        Raises
        ------
        IndexError
            If the span lies outside a signal.
        """
        size = min(map(len, lines), default=0)
        if not 0 <= first < last <= size:
            raise IndexError(f"samples {first} to {last} of signals of {size} samples")
        out = np.empty((len(lines), -(-(last - first) // self.step)))
        for line, samples in zip(lines, out, strict=True):
            if self.step == 1:
                samples[:] = line[first:last]
            else:
                x = np.ascontiguousarray(line, dtype=np.float64)
                _compiled_filter()(x, first, self.taps, self.step, samples)
        return out


@lru_cache(maxsize=16)
def decimator(rate: float, top: float | None) -> Decimator:
    """Decimator to the lowest rate that preserves a frequency.

    Parameters
    ----------
    rate : float
        Samples per second, Hz.
    top : float or None
        Highest frequency to preserve, Hz; None for all.

    Returns
    -------
    Decimator
        Flat up to ``top`` and 100 dB down where it would be folded onto that.

    Raises
    ------
    InputError
        If the highest frequency is not more than 0.
    """
    if top is None:
        return Decimator(1, np.ones(1))
    if not 0 < top < float("inf"):
        raise InputError(f"the highest frequency is {top:g} Hz; it must be finite and more than 0.")
    step = _step(rate, int(rate / (_SAMPLES_PER_PERIOD * top)))
    if step == 1:
        return Decimator(1, np.ones(1))
    from scipy.signal import firwin, kaiserord

    edges = (top, rate / step - top)
    count, beta = kaiserord(_REJECTION_DB, (edges[1] - edges[0]) / (rate / 2))
    taps = firwin(count | 1, sum(edges) / 2, window=("kaiser", beta), fs=rate)
    taps.setflags(write=False)
    return Decimator(step, taps)


def _step(rate: float, most: int) -> int:
    """Largest step to a whole rate, so that spectra have the same lines; else the largest step at all."""
    for step in range(most, most // 2, -1):
        if rate % step == 0:
            return step
    return max(1, most)


def _filter(line: Array, first: int, taps: Array, step: int, out: Array) -> None:
    """Every ``step``-th sample of a filtered signal, which is continued by its first and last sample.

    Parameters
    ----------
    line : ndarray, shape (n,)
        Signal.
    first : int
        Sample of the signal at the first output.
    taps : ndarray, shape (2 * half + 1,)
        Symmetric, of sum 1.
    step : int
        Samples from each output to the next.
    out : ndarray, shape (m,)
        Output, overwritten.
    """
    half, last = taps.size // 2, line.size - 1
    level = line[first]  # so that a position of half a metre does not lose its last digits
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


@lru_cache(maxsize=1)
def _compiled_filter() -> Callable[[Array, int, Array, int, Array], None]:
    """Compiled inner loop; numba is imported only where a signal is decimated."""
    from ballscrew.base.compilation import compiled

    return compiled(fastmath={"reassoc", "contract", "nsz"})(_filter)
