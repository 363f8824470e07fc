"""Faults that show in the samples of one channel, or of one channel beside the position."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array

Span: TypeAlias = tuple[int, int]

# A smooth peak that is sampled with a coarse step has at most 2.4 times as many samples on its highest
# level as on the next (arcsine distribution); a saturated signal has far more.
_PILE = 4.0
_LEAST_PILE = 4  # samples: two or three equal ones are common by chance in 100 000
_LEVELS = 50  # fewer different values are a switch or a coarse converter, which rests on its ends
_NEXT_LEVELS = 5
_BELOW = 10  # levels with which the highest is compared: five may all have a single sample by chance
_LEAST_STAY = 3  # samples

# Of the range: an overflow jumps over all of it, a sample interval of a good signal over a few per cent.
_WRAP = 0.75
_WRAP_TYPICAL = 15.0  # times the 99th percentile of all steps; good records have 2.5 at most
_SPIKE = 0.10  # of the range; good records have 3 % at 12.8 kHz
_SPIKE_TYPICAL = 12.0  # times the 99th percentile; good records have 3 at most

_CHANCE = 1e-6  # probability of a false "stuck" in a good record
_LONGEST_CHANCE = 0.2  # share of equal neighbours above which a signal is quantised more than noisy
_LEAST_RUN = 5
_BLOCK = 64  # samples over which the share of equal neighbours is counted
_LEAST_BLOCKS = 8

# Behind a dead band of 0.01 to 0.1 N m, at least 0.078 of a torque's changes are followed by a hold, of
# irregular lengths (0.85 and more), and the changes are at least 5 times the smallest ones. Rounded signals
# with holds as irregular (10 bits: 0.6) change by one or two steps; holds of a fixed length vary by 0.24.
_HOLDS, _IRREGULAR, _OVER_SMALLEST = 0.06, 0.5, 4.0
_SMALLEST = 1.0  # percentile of the changes
_LONGEST_HOLD = 500  # samples: a signal may be constant at standstill

_LEAST_FROZEN = 0.05  # s: shorter spans are found by their missing noise
_RINGING = 0.15  # s after a stop, in which sensors still move and a coarse encoder no longer does
_FROZEN_BLOCK = 0.01  # s
_STANDS, _MOVES = 0.1, 0.5  # of the highest speed
_BUSY = 0.3  # of an acceleration's level
_BUSY_DRIVE = 0.5  # of a torque's range
_BUSY_BLOCKS = 3


@dataclass(frozen=True, slots=True)
class Clip:
    """Limits at which a signal is clipped.

    Parameters
    ----------
    low, high : float, optional
        Limits; None on a side that is not clipped.
    share : float
        Clipped samples among those at least half as far from the middle as the limit.
    count : int
        Clipped samples.
    """

    low: float | None
    high: float | None
    share: float
    count: int


@dataclass(frozen=True, slots=True)
class Stuck:
    """Spans in which a noisy signal has no noise.

    Parameters
    ----------
    count : int
        Number of spans.
    samples : int
        Number of samples in all spans together.
    first : int
        First sample of the first span.
    """

    count: int
    samples: int
    first: int


def not_finite(x: Array) -> tuple[int, int]:
    """Number of NaN and number of infinite samples."""
    if np.isfinite(x).all():
        return 0, 0
    return int(np.isnan(x).sum()), int(np.isinf(x).sum())


def is_flat(x: Array) -> bool:
    """True if all samples have one value, except for rounding."""
    return float(np.ptp(x)) <= 1e-9 * float(np.abs(x).max())


def clipping(x: Array) -> Clip | None:
    """Find limits at which many samples pile up.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Finite samples.

    Returns
    -------
    Clip or None
        None where no side is clipped.
    """
    middle = float(np.median(x))
    high = low = None
    count = near = 0
    top = _pile(x)
    if top is not None:
        high, count = top
        near = int(np.count_nonzero(x > middle + 0.5 * (high - middle)))
    bottom = _pile(-x)
    if bottom is not None:
        low = -bottom[0]
        count += bottom[1]
        near += int(np.count_nonzero(x < middle - 0.5 * (middle - low)))
    if count == 0:
        return None
    return Clip(low, high, count / max(near, 1), count)


def _pile(x: Array) -> tuple[float, int] | None:
    """Highest value and its count, where far more samples have it than the values below."""
    top, span = float(x.max()), float(np.ptp(x))
    if top == 0.0:  # a signal that never exceeds zero rests there
        return None
    # Scaling and resampling change equal values by rounding only.
    levels, counts = np.unique(np.round(x[x > top - 0.1 * span] / (1e-7 * span)), return_counts=True)
    if len(levels) < _NEXT_LEVELS + 1 and len(np.unique(x[:: max(1, len(x) // 5000)])) < _LEVELS:
        return None
    count = int(counts[-1])
    next_count = max(counts[-1 - _BELOW : -1], default=1)
    if count < _LEAST_PILE or count <= _PILE * next_count:
        return None
    return (top, count) if _stays(x > top - 1e-7 * span) else None


def _stays(at_top: NDArray[np.bool_]) -> bool:
    """True if a signal stays at its limit, as in saturation; rounded noise only touches it."""
    starts, stops = true_spans(at_top)
    lengths = stops - starts
    together = int(lengths[lengths > 1].sum())
    return bool(len(starts) and lengths.max() >= _LEAST_STAY and 2 * together >= lengths.sum())


def true_spans(mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First sample of each span of true values, and the sample after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return edges[::2], edges[1::2]


def block_means(x: Array, size: int) -> Array:
    """Means over blocks of ``size`` samples along the last axis; an incomplete last block is dropped."""
    whole = x.shape[-1] // size * size
    return np.asarray(x[..., :whole].reshape(*x.shape[:-1], -1, size).mean(axis=-1))


def wraps(x: Array) -> NDArray[np.intp]:
    """Samples before which an integer overflowed: the signal jumps over three quarters of its range."""
    step = np.abs(np.diff(x))
    most = _WRAP * float(np.ptp(x))
    if not (step > most).any():
        return np.empty(0, np.intp)
    small = step[step <= most]  # without the overflows themselves, which may be many
    limit = most
    if len(small):
        limit = max(most, _WRAP_TYPICAL * float(np.percentile(small, 99)))
    return np.flatnonzero(step > limit) + 1


def spikes(x: Array) -> NDArray[np.intp]:
    """Single samples far from both neighbours."""
    off = np.abs(x[1:-1] - 0.5 * (x[:-2] + x[2:]))
    # A spike adds half of itself to both its neighbours' deviation: the largest of the three is the spike.
    least = _SPIKE * float(np.ptp(x))
    if not (off > least).any():
        return np.empty(0, np.intp)
    limit = max(least, _SPIKE_TYPICAL * float(np.percentile(off, 99)))
    neighbours = np.abs(x[2:] - x[:-2])
    return np.flatnonzero((off > limit) & (neighbours < off)) + 1


def has_dead_band(x: Array) -> bool:
    """True if a signal holds its value until the measured quantity leaves a band around it."""
    change = np.abs(np.diff(x))
    at = np.flatnonzero(change > 1e-9 * float(np.ptp(x)))
    lengths = np.diff(at)
    lengths = lengths[lengths < _LONGEST_HOLD]
    if len(lengths) < _LEAST_RUN or np.mean(lengths > 1) < _HOLDS:
        return False
    if np.std(lengths) < _IRREGULAR * np.mean(lengths):
        return False
    changes = change[at]
    return bool(np.median(changes) >= _OVER_SMALLEST * np.percentile(changes, _SMALLEST))


def stuck(x: Array, moving: NDArray[np.bool_] | None = None, clip: Clip | None = None) -> Stuck | None:
    """Spans that are constant or straight in a signal that is noisy elsewhere: filled-in samples.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Finite samples.
    moving : ndarray of bool, shape (n,), optional
        True where the axis moves: signals at standstill may be quiet and are compared among themselves.
    clip : Clip, optional
        Limits at which it is constant because it is clipped.

    Returns
    -------
    Stuck or None
        None where the signal has noise everywhere, or nowhere.
    """
    bend = np.abs(np.diff(x, 2))
    rounding = 4e-7 * float(np.abs(x).max())
    if 1e-6 * float(bend.max()) > rounding:  # else the median is below it, too
        rounding = max(1e-6 * float(np.median(bend)), rounding)
    straight = bend <= rounding
    if clip is not None:
        inner = x[1:-1]
        if clip.low is not None:
            straight &= inner > clip.low
        if clip.high is not None:
            straight &= inner < clip.high
    starts, stops = true_spans(straight)
    lengths = stops - starts
    state = np.zeros(len(straight), bool)
    if moving is not None:
        state = moving[1 : 1 + len(straight)]
    long = np.zeros(len(starts), dtype=bool)
    for kind in (False, True):
        longest = _longest_by_chance(straight, state == kind)
        if longest is not None:
            long |= (state[starts + lengths // 2] == kind) & (lengths >= longest)
    if not long.any():
        return None
    return Stuck(int(long.sum()), int((lengths[long] + 2).sum()), int(starts[long][0]))


def _longest_by_chance(straight: NDArray[np.bool_], where: NDArray[np.bool_]) -> int | None:
    """Length of a run that occurs by chance in one of a million records; None for a signal without noise."""
    size = len(straight) // _BLOCK * _BLOCK
    shares = straight[:size].reshape(-1, _BLOCK).mean(axis=1)
    shares = shares[where[:size].reshape(-1, _BLOCK).all(axis=1)]
    if len(shares) < _LEAST_BLOCKS:
        return None
    # The noisiest three quarters determine how often it is straight by chance; the rest may be filled in.
    chance = max(float(np.percentile(shares, 75)), 1.0 / len(straight))
    if chance > _LONGEST_CHANCE:
        return None
    return max(_LEAST_RUN, int(np.ceil(np.log(_CHANCE / len(straight)) / np.log(chance))))


def constant_spans(x: Array, least: float) -> list[Span]:
    """Spans of one value, the longest first.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Finite samples; values that differ by rounding only count as equal.
    least : float
        Least number of samples of a span.

    Returns
    -------
    list of (first, last)
        First sample of each span, and the sample after its last.
    """
    starts, stops = true_spans(np.abs(np.diff(x)) <= 1e-9 * float(np.ptp(x)))
    lengths = stops - starts
    long = np.flatnonzero(lengths + 1 >= least)
    long = long[np.argsort(-lengths[long], kind="stable")]
    return list(zip(starts[long].tolist(), (stops[long] + 1).tolist(), strict=True))


def frozen_signal(x: Array, position: Array, rate: float, clip: Clip | None) -> Span | None:
    """Longest constant span of a torque or an acceleration in which the axis starts or stops.

    Parameters
    ----------
    x, position : ndarray, shape (n,)
        The signal, and the position in m.
    rate : float
        Sample rate of both, Hz.
    clip : Clip, optional
        Limits at which the signal is constant because it is clipped.

    Returns
    -------
    first, last : int
        None where there is no such span. At constant speed a coarsely resolved torque may be constant.
    """
    size = _frozen_block(rate)
    if len(position) <= 2 * _FROZEN_BLOCK * rate:
        return None
    speed = np.abs(np.gradient(block_means(position, size)))
    top = float(np.percentile(speed, 99))
    if top <= 0:
        return None
    rounding = 1e-7 * float(np.ptp(x))
    for first, last in constant_spans(x, _LEAST_FROZEN * rate):
        if clip is not None and _is_limit(clip, float(x[first]), rounding):
            continue
        inside = speed[first // size + 2 : last // size - 1]  # a gradient extends over one block more
        if len(inside) and inside.min() < _STANDS * top and inside.max() > _MOVES * top:
            return first, last
    return None


def _is_limit(clip: Clip, value: float, rounding: float) -> bool:
    at_low = clip.low is not None and abs(value - clip.low) <= rounding
    at_high = clip.high is not None and abs(value - clip.high) <= rounding
    return at_low or at_high


def frozen_position(position: Array, other: Array, rate: float, *, drive: bool) -> Span | None:
    """Longest span of constant position in which acceleration or torque show a moving axis.

    Parameters
    ----------
    position, other : ndarray, shape (n,)
        The position, and an acceleration or a torque.
    rate : float
        Sample rate of both, Hz.
    drive : bool
        Whether ``other`` is a torque, which may be constant while the axis stands.

    Returns
    -------
    first, last : int
        None where there is no such span.
    """
    spans = constant_spans(position, _LEAST_FROZEN * rate)
    size, skip = _frozen_block(rate), round(_RINGING * rate)
    blocks = block_means(other, size)
    if not spans or len(blocks) < _BUSY_BLOCKS:
        return None
    low, high = np.percentile(blocks, [1, 99])
    deviation = np.abs(blocks - np.median(blocks))
    level = float(np.percentile(deviation, 99))
    for first, last in spans:
        if _was_moving(position, first, rate):
            return first, last
        part = slice((first + skip) // size + 1, last // size)
        if len(blocks[part]) < _BUSY_BLOCKS:
            continue
        if drive:
            busy = np.ptp(blocks[part]) > _BUSY_DRIVE * (high - low) > 0
        else:
            busy = level > 0 and np.count_nonzero(deviation[part] > _BUSY * level) >= _BUSY_BLOCKS
        if busy:
            return first, last
    return None


def _was_moving(position: Array, first: int, rate: float) -> bool:
    """True if the axis was in full motion just before: no axis stops at once."""
    size = _frozen_block(rate)
    if first < size:
        return False
    fastest = float(np.percentile(np.abs(np.diff(block_means(position, size))), 99))
    return bool(abs(position[first] - position[first - size]) > _MOVES * fastest > 0)


def _frozen_block(rate: float) -> int:
    return max(1, round(_FROZEN_BLOCK * rate))
