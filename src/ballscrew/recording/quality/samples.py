"""Faults that the samples of one channel show by themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array

__all__ = ["Clip", "Stuck", "clipping", "holds", "is_flat", "not_finite", "spikes", "stuck", "wraps"]


# A smooth peak that is sampled with a coarse step has at most 2.4 times as many samples on its highest
# level as on the next (the arcsine law); what saturates has them all there.
_PILE = 4.0
_LEAST_PILE = 4  # samples: two or three that are equal by chance are common in 100 000
_LEVELS = 50  # fewer different values than this are a switch or a coarse converter, which sits on its ends
_NEXT_LEVELS = 5
_BELOW = 10  # levels with which the highest is compared: none of five may have two samples by chance
_LEAST_STAY = 3  # samples

_WRAP = (
    0.75  # of the range: an overflow jumps over all of it, one sample of a good signal over a few per cent
)
_WRAP_TYPICAL = 15.0  # times the 99th percentile of all steps; good records have 2.5 at most
_SPIKE = 0.10  # of the range; good records have 3 % at 12.8 kHz
_SPIKE_TYPICAL = 12.0  # times the 99th percentile; good records have 3 at most

_CHANCE = 1e-6  # of calling a run in a good record stuck
_LONGEST_CHANCE = 0.2  # share of equal neighbours above which its steps, not its noise, shape a signal
_LEAST_RUN = 5
_BLOCK = 64  # samples over which the share of equal neighbours is counted
_LEAST_BLOCKS = 8


@dataclass(frozen=True, slots=True)
class Clip:
    """Where a signal is cut off.

    Parameters
    ----------
    low, high : float, optional
        The limits; ``None`` on a side that is not clipped.
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
    """Spans in which a noisy signal suddenly has no noise.

    Parameters
    ----------
    count : int
        How many.
    samples : int
        In all of them together.
    first : int
        First sample of the first.
    """

    count: int
    samples: int
    first: int


def not_finite(x: Array) -> tuple[int, int]:
    """How many samples are NaN, and how many infinite."""
    if np.isfinite(x).all():
        return 0, 0
    return int(np.isnan(x).sum()), int(np.isinf(x).sum())


def is_flat(x: Array) -> bool:
    """Whether all samples have one value, but for the rounding of their numbers."""
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
    high, low = _pile(x), _pile(-x)
    if high is None and low is None:
        return None
    middle = float(np.median(x))
    count = sum(side[1] for side in (high, low) if side)
    near = 0
    if high is not None:
        near += int(np.count_nonzero(x > middle + 0.5 * (high[0] - middle)))
    if low is not None:
        near += int(np.count_nonzero(x < middle - 0.5 * (middle + low[0])))
    return Clip(-low[0] if low else None, high[0] if high else None, count / max(near, 1), count)


def _pile(x: Array) -> tuple[float, int] | None:
    """The highest value and its count, where far more samples have it than the values below."""
    top, span = float(x.max()), float(np.ptp(x))
    if top == 0.0:  # what never falls below zero rests there
        return None
    # Scaling and resampling leave equal values equal but for rounding.
    levels, counts = np.unique(np.round(x[x > top - 0.1 * span] / (1e-7 * span)), return_counts=True)
    if len(levels) < _NEXT_LEVELS + 1 and len(np.unique(x[:: max(1, len(x) // 5000)])) < _LEVELS:
        return None
    count, below = int(counts[-1]), counts[-1 - _BELOW : -1]
    pile = count >= _LEAST_PILE and count > _PILE * (below.max() if len(below) else 1)
    return (top, count) if pile and _stays(x > top - 1e-7 * span) else None


def _stays(at_top: NDArray[np.bool_]) -> bool:
    """Whether a signal stays at its limit, as what saturates does; noise that is rounded only touches it."""
    starts, lengths = _runs(at_top)
    together = int(lengths[lengths > 1].sum())
    return bool(len(starts) and lengths.max() >= _LEAST_STAY and 2 * together >= lengths.sum())


def _runs(mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Where spans of true values start, and how long they are."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return edges[::2], edges[1::2] - edges[::2]


def wraps(x: Array) -> NDArray[np.intp]:
    """Samples before which an integer overflowed: the signal jumps over three quarters of its range."""
    step = np.abs(np.diff(x))
    most = _WRAP * float(np.ptp(x))
    if not (step > most).any():
        return np.empty(0, np.intp)
    small = step[step <= most]  # a signal that overflows often must not make that typical
    limit = max(most, _WRAP_TYPICAL * float(np.percentile(small, 99))) if len(small) else most
    return np.flatnonzero(step > limit) + 1


def spikes(x: Array) -> NDArray[np.intp]:
    """Single samples far off both their neighbours."""
    off = np.abs(x[1:-1] - 0.5 * (x[:-2] + x[2:]))
    # Of a single sample, both neighbours see half: the largest of three is the spike itself.
    least = _SPIKE * float(np.ptp(x))
    if not (off > least).any():
        return np.empty(0, np.intp)
    limit = max(least, _SPIKE_TYPICAL * float(np.percentile(off, 99)))
    between = np.abs(x[2:] - x[:-2])
    return np.flatnonzero((off > limit) & (between < off)) + 1


def stuck(x: Array, moving: NDArray[np.bool_] | None = None, clip: Clip | None = None) -> Stuck | None:
    """Spans that are constant or straight in a signal that is noisy elsewhere: replaced samples.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Finite samples.
    moving : ndarray of bool, shape (n,), optional
        Where the axis moves: the signal of an axis that stands may be quiet, and is compared with itself.

    clip : Clip, optional
        Limits at which it is constant because it is clipped.

    Returns
    -------
    Stuck or None
        None where the signal has no noise to miss, or misses none.
    """
    bend = np.abs(np.diff(x, 2))
    rounded = 4e-7 * float(np.abs(x).max())
    if 1e-6 * float(bend.max()) > rounded:  # else the median is below it, too
        rounded = max(1e-6 * float(np.median(bend)), rounded)
    straight = bend <= rounded
    if clip is not None:
        inner = x[1:-1]
        straight &= inner > (-np.inf if clip.low is None else clip.low)
        straight &= inner < (np.inf if clip.high is None else clip.high)
    starts, lengths = _runs(straight)
    long = np.zeros(len(starts), dtype=bool)
    state = np.zeros(len(straight), bool) if moving is None else moving[1 : 1 + len(straight)]
    for kind in (False, True):
        longest = _longest_by_chance(straight, state == kind)
        if longest is not None:
            long |= (state[starts + lengths // 2] == kind) & (lengths >= longest)
    if not long.any():
        return None
    return Stuck(int(long.sum()), int((lengths[long] + 2).sum()), int(starts[long][0]))


def holds(x: Array, least: float) -> list[tuple[int, int]]:
    """Spans of one value, the longest first.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Finite samples; what differs by the rounding of their numbers alone is one value.
    least : float
        Samples that a span must have.

    Returns
    -------
    list of (first, last)
        The first sample of each, and the one after its last.
    """
    starts, lengths = _runs(np.abs(np.diff(x)) <= 1e-9 * float(np.ptp(x)))
    long = np.flatnonzero(lengths + 1 >= least)
    long = long[np.argsort(-lengths[long], kind="stable")]
    return [(int(starts[at]), int(starts[at] + lengths[at]) + 1) for at in long]


def _longest_by_chance(straight: NDArray[np.bool_], where: NDArray[np.bool_]) -> int | None:
    """Run that a quantised signal has by chance once in a million records; None where it has no noise."""
    size = len(straight) // _BLOCK * _BLOCK
    shares = straight[:size].reshape(-1, _BLOCK).mean(axis=1)
    shares = shares[where[:size].reshape(-1, _BLOCK).all(axis=1)]
    if len(shares) < _LEAST_BLOCKS:
        return None
    # The noisiest three quarters say how often it is straight by chance; the rest may be what is sought.
    chance = max(float(np.percentile(shares, 75)), 1.0 / len(straight))
    if chance > _LONGEST_CHANCE:
        return None
    return max(_LEAST_RUN, int(np.ceil(np.log(_CHANCE / len(straight)) / np.log(chance))))
