"""Samples at a constant interval, from values with times of which some are absent."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import gammaincc

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.recording.readers.guard import check_size

_OFF_GRID = 0.25  # of the interval: rounded times are nearer, those of another interval soon are not
_CHANCE = math.exp(-20)  # that a recorded signal is taken for one that was written on change
_CHANCE_BESIDE = 0.5  # the same beside a signal that certainly was: its gaps rather lie where it rests
_FEW, _WHOLE = 4.5, 0.9  # changes up to so many steps are whole numbers of them, of a signal in steps
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


def written_on_change(signals: Sequence[tuple[Array, Array, float]]) -> list[bool]:
    """Whether signals of one file were written only when they changed, and absent samples were not lost.

    A recorded signal in steps has at least as many equal neighbours as neighbours of one step up, or of one
    down: with n such steps, their number is at least that of a Poisson distribution of mean n. One that was
    written on change has hardly any. It also lacks samples only where it rests, so that its values differ
    less across its gaps than between most neighbours. Where one signal shows it beyond doubt, another that
    rests only a few times need not: signals of a file are written alike.

    Parameters
    ----------
    signals : sequence of (times, values, interval)
        As of :func:`at_interval`.

    Returns
    -------
    list of bool
        False also for a signal that lacks no sample.
    """
    chances = [_chance_of_loss(*signal) for signal in signals]
    limit = _CHANCE
    if min(chances, default=1.0) <= _CHANCE:
        limit = _CHANCE_BESIDE
    return [chance <= limit for chance in chances]


def _chance_of_loss(times: Array, values: Array, interval: float) -> float:
    """Probability of such samples, or of fewer signs of a loss, if samples were lost at random."""
    neighbours = np.diff(times) < 1.5 * interval
    changes = np.abs(np.diff(values))
    steps = np.diff(values)[neighbours]
    moved = steps[steps != 0]
    equal = steps.size - moved.size
    if neighbours.all() or not moved.size or equal > _REPEATED * steps.size:
        return 1.0
    counts = moved / np.abs(moved).min()
    few = np.abs(counts[np.abs(counts) < _FEW])
    expected = 0.0
    if np.mean(np.abs(few - np.rint(few)) < _OFF_GRID) > _WHOLE:
        expected = min(np.sum(np.rint(counts) == 1), np.sum(np.rint(counts) == -1))
    by_steps = gammaincc(equal + 1, expected)  # of a Poisson distribution, up to that number
    # Were samples lost at random, the ranks of the changes across gaps among the others would be uniform or
    # higher; by Fisher's method the sum of their logarithms is then of a gamma distribution.
    ranks = np.searchsorted(np.sort(changes[neighbours]), changes[~neighbours], side="right") + 1
    by_gaps = gammaincc(ranks.size, -np.sum(np.log(ranks / (steps.size + 1))))
    return float(min(by_steps, by_gaps))


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
