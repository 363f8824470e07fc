"""Samples at a constant interval, from values with times of which some are absent."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import gammaincc

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.recording.readers.guard import check_size

_OFF_GRID = 0.25  # of the interval: rounded times are nearer, those of another interval soon are not
_CHANCE = math.exp(-20)  # that a recorded signal is taken for one that was written on change
# Of the neighbours, that may be equal by digits that an export omits, or since the value is also sent when an
# optional time expires (Beckhoff, ADS.NET, AdsTransMode.OnChange).
_REPEATED = 0.01


@dataclass(frozen=True, slots=True)
class Series:
    """Samples of one channel.

    Parameters
    ----------
    start : float
        Time of the first sample, s.
    interval : float
        s.
    values : ndarray, shape (samples,)
        Samples.
    """

    start: float
    interval: float
    values: Array


def at_interval(path: Path, name: str, times: Array, values: Array, interval: float) -> Series:
    """Put values at the multiples of an interval; those that are absent are NaN.

    Parameters
    ----------
    path : Path
        The file, for messages.
    name : str
        The channel, for messages.
    times, values : ndarray, shape (values,)
        Times in s, and the value at each of them.
    interval : float
        s.

    Returns
    -------
    Series
        From the first time to the last.

    Raises
    ------
    InputError
        If the times do not increase by multiples of the interval, or there are more samples than a file of
        this size can contain.
    """
    indices = _indices(path, name, times, interval)
    count = int(indices[-1]) + 1
    check_size(path, name, 8 * count)
    samples = np.full(count, np.nan)
    samples[indices] = values
    return Series(float(times[0]), interval, samples)


def on_change(
    path: Path, name: str, times: Array, values: Array, interval: float, records: Array, lost: bool
) -> Series:
    """Samples of a signal that was written only when it changed.

    Parameters
    ----------
    path, name, times, values, interval
        As of :func:`at_interval`.
    records : ndarray, shape (records,)
        Times of all records of the file, s; the last value is valid until the last record.
    lost : bool
        Whether the file states that it lost records; samples without a record are then NaN.

    Returns
    -------
    Series
        From the first value to the last record; a value is valid until the next.

    Raises
    ------
    InputError
        As of :func:`at_interval`.
    """
    indices = _indices(path, name, times, interval)
    last = max(float(records[-1]), float(times[-1]))
    count = int((last - times[0]) / interval + _OFF_GRID) + 1
    check_size(path, name, 8 * count)
    samples = np.repeat(values, np.diff(np.append(indices, count)))
    if lost:
        present = np.rint((records - times[0]) / interval)
        present = present[(present >= 0) & (present < count)].astype(np.intp)
        absent = np.ones(count, dtype=bool)
        absent[present] = False
        samples[absent] = np.nan
    return Series(float(times[0]), interval, samples)


def is_on_change(times: Array, values: Array, interval: float) -> bool:
    """Whether a signal was written only when it changed, and its absent samples were not lost.

    A recorded signal in steps has at least as many equal neighbours as neighbours of one step up, or of one
    down: with n such steps, their number is at least that of a Poisson distribution of mean n. One that was
    written on change has hardly any. It also lacks samples only where it rests, so that its values differ
    less across its gaps than between most neighbours.

    Parameters
    ----------
    times, values, interval
        As of :func:`at_interval`.

    Returns
    -------
    bool
        False also for a signal without steps, which may have no equal neighbours in any case.
    """
    neighbours = np.diff(times) < 1.5 * interval
    changes = np.abs(np.diff(values))
    steps = np.diff(values)[neighbours]
    moved = steps[steps != 0]
    equal = steps.size - moved.size
    if neighbours.all() or not moved.size or equal > _REPEATED * steps.size:
        return False
    single = moved[np.abs(moved) < 1.5 * np.abs(moved).min()]
    expected = min(np.sum(single > 0), np.sum(single < 0))
    if gammaincc(equal + 1, expected) <= _CHANCE:  # of a Poisson distribution, up to that number
        return True
    # Were samples lost at random, the ranks of the changes across gaps among the others would be uniform or
    # higher; by Fisher's method the sum of their logarithms is then of a gamma distribution.
    ranks = np.searchsorted(np.sort(changes[neighbours]), changes[~neighbours], side="right") + 1
    sum_of_logs = -float(np.sum(np.log(ranks / (steps.size + 1))))
    return bool(gammaincc(ranks.size, sum_of_logs) < _CHANCE)


def _indices(path: Path, name: str, times: Array, interval: float) -> Array:
    """Whole numbers of intervals since the first time."""
    if not (np.isfinite(interval) and interval > 0):
        raise InputError(f"{path}: {name!r} has the interval {interval:g} s; it must be more than 0.")
    with np.errstate(over="ignore", invalid="ignore"):
        steps = (times - times[0]) / interval
        nearest = np.rint(steps)
        regular = np.abs(steps - nearest) <= _OFF_GRID
    if not regular.all():
        at = float(times[int(np.argmin(regular))])
        raise InputError(
            f"{path}: {name!r} has a value at {at:g} s, which is no multiple of its interval"
            f" of {interval:g} s after the first."
        )
    if np.any(np.diff(nearest) < 1):
        raise InputError(f"{path}: the times of {name!r} do not increase.")
    if nearest[-1] >= 2**53:
        raise InputError(f"{path}: {name!r} lasts {times[-1] - times[0]:g} s; its times are damaged.")
    return np.asarray(nearest, dtype=np.intp)
