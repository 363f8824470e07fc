"""Keeps of a signal no more samples than the frequencies that are wanted of it take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

__all__ = ["Decimator", "decimator"]

_ROOM = 3.2  # samples kept for each period of the highest frequency
_REJECTION_DB = 108.0  # asked of Kaiser's formula, which is a few short


@dataclass(frozen=True, slots=True, eq=False)
class Decimator:
    """A filter without delay, and how far one may decimate after it.

    Parameters
    ----------
    step : int
        Every so many samples are kept; 1 for all of them, which are not filtered then.
    taps : ndarray, shape (2 * half + 1,)
        Symmetric, of sum 1.
    """

    step: int
    taps: Array

    def __call__(self, lines: Sequence[Array], first: int, last: int) -> Array:
        """Samples ``first``, ``first + step`` ... below ``last`` of some signals, filtered; always a copy.

        What lies beside the span is filtered with it; beyond its own ends a signal is taken to stay.

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
        if any(not 0 <= first < last <= len(line) for line in lines):
            raise IndexError(f"samples {first} to {last} of signals of {[len(line) for line in lines]}")
        out = np.empty((len(lines), -(-(last - first) // self.step)))
        if self.step == 1:
            for line, kept in zip(lines, out, strict=True):
                kept[:] = line[first:last]
            return out
        from ballscrew.recording.thinning import filtered

        for line, kept in zip(lines, out, strict=True):
            filtered(np.ascontiguousarray(line, dtype=np.float64), first, self.taps, self.step, kept)
        return out


@lru_cache(maxsize=16)
def decimator(rate: float, top: float | None) -> Decimator:
    """Of a rate down to the least one that holds a frequency.

    Parameters
    ----------
    rate : float
        Samples per second, Hz.
    top : float or None
        Highest frequency wanted, Hz; None for all.

    Returns
    -------
    Decimator
        Flat up to ``top`` and 100 dB down where it would be folded onto that.

    Raises
    ------
    InputError
        If the highest frequency is not more than 0.
    """
    if top is not None and not 0 < top < float("inf"):
        raise InputError(f"the highest frequency is {top:g} Hz; it must be finite and more than 0.")
    step = 1 if top is None else _step(rate, int(rate / (_ROOM * top)))
    if top is None or step == 1:
        return Decimator(1, np.ones(1))
    from scipy.signal import firwin, kaiserord

    edges = (top, rate / step - top)
    count, beta = kaiserord(_REJECTION_DB, (edges[1] - edges[0]) / (rate / 2))
    taps = firwin(count | 1, sum(edges) / 2, window=("kaiser", beta), fs=rate)
    taps.setflags(write=False)
    return Decimator(step, taps)


def _step(rate: float, most: int) -> int:
    """The largest that leaves a whole rate whole, so that spectra keep their lines; or the largest at all."""
    whole = [step for step in range(most // 2 + 1, most + 1) if step and rate % step == 0]
    return max(1, *whole, most if not whole else 1)
