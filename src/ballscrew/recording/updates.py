"""Signals that are recorded more often than they are updated, as a position by its loop's cycle."""

from __future__ import annotations

import numpy as np

from ballscrew.base.arrays import Array

_FEWEST = 20  # intervals between changes: all even by chance once in 2²⁰ signals
_LONGEST = 1024  # samples: 16 ms at 62.5 µs, and beyond what drives and their controls differ by
_REGULAR = 0.99  # of the intervals that are multiples of one number: a lost sample makes one that is not
_COARSE = 4.0  # steps of its resolution in the median change, below which a signal is coarse and not slow


def update_interval(values: Array) -> tuple[int, int]:
    """Number of samples after which a signal is updated, and its first update.

    A signal that is updated every k samples changes only at samples that are multiples of k apart, at any
    speed. A coarse one changes by one step at a time, at intervals that depend on the speed.

    Parameters
    ----------
    values : ndarray, shape (samples,)
        Samples.

    Returns
    -------
    interval : int
        In samples; 1 for a signal that is updated with every sample or is coarse, 0 for one that is updated
        less often at no constant interval.
    first : int
        Index of the first sample at an update, less than ``interval``; 0 unless that is above 1.
    """
    changes = np.flatnonzero(values[1:] != values[:-1]) + 1
    gaps = np.diff(changes)
    short = gaps[gaps <= _LONGEST]
    if short.size < _FEWEST:
        return 1, 0
    interval = int(np.bincount(short).argmax())
    if interval == 1:
        return 1, 0
    if np.mean(gaps % interval == 0) >= _REGULAR:
        return interval, int(np.bincount(changes % interval).argmax())
    with np.errstate(invalid="ignore"):  # infinite samples, which the quality gate names
        steps = np.abs(values[changes] - values[changes - 1])
    return int(np.median(steps) < _COARSE * steps.min()), 0


def in_words(interval: int, rate: float) -> str:
    """Clause on a signal that is updated every few samples of a file's rate (Hz)."""
    ms = 1e3 * interval / rate
    updated = f"is updated every {interval} samples ({ms:.3g} ms)"
    return f"{updated} and used at that rate, {rate / interval:.6g} Hz"
