"""Channels that stand still while the axis does not: a sensor, plug or counter that gave up."""

from __future__ import annotations

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.recording.quality.samples import Clip, holds

__all__ = ["held_position", "held_signal"]


_LEAST = 0.05  # s: a shorter one is judged by the noise that it lacks
_RINGING = 0.15  # s after a stop, in which sensors still move and a coarse encoder no longer
_BLOCK = 0.01  # s
_STANDS, _GOES = 0.1, 0.5  # of the highest speed
_BUSY = 0.3  # of an acceleration's level
_BUSY_DRIVE = 0.5  # of a torque's range
_BUSY_BLOCKS = 3

Span = tuple[int, int]


def held_signal(x: Array, position: Array, rate: float, clip: Clip | None) -> Span | None:
    """Longest span of one value of a torque or an acceleration in which the axis starts or stops.

    Parameters
    ----------
    x, position : ndarray, shape (n,)
        The signal, and the position in m.
    rate : float
        Of both, Hz.
    clip : Clip, optional
        Limits at which it rests because it is clipped.

    Returns
    -------
    first, last : int
        Or None: an axis that keeps its speed may have one and the same torque, coarsely told.
    """
    limits = () if clip is None else (clip.low, clip.high)
    near = 1e-7 * float(np.ptp(x))
    speed = np.abs(np.gradient(_blocks(position, rate))) if len(position) > 2 * _BLOCK * rate else np.empty(0)
    top = float(np.percentile(speed, 99)) if len(speed) else 0.0
    size = max(1, round(_BLOCK * rate))
    for first, last in holds(x, _LEAST * rate) if top > 0 else ():
        if any(limit is not None and abs(x[first] - limit) <= near for limit in limits):
            continue
        inside = speed[first // size + 2 : last // size - 1]  # a gradient sees one block beyond
        if len(inside) and inside.min() < _STANDS * top and inside.max() > _GOES * top:
            return first, last
    return None


def held_position(position: Array, other: Array, rate: float, *, drive: bool) -> Span | None:
    """Longest span of one position in which acceleration or torque tell that the axis moves.

    Parameters
    ----------
    position, other : ndarray, shape (n,)
        The position, and an acceleration or a torque.
    rate : float
        Of both, Hz.
    drive : bool
        Whether the other one is a torque, which an axis that stands may keep.

    Returns
    -------
    first, last : int
        Or None: an axis that stands has one position.
    """
    found = holds(position, _LEAST * rate)
    blocks = _blocks(other, rate)
    if not found or len(blocks) < _BUSY_BLOCKS:
        return None
    low, high = (float(value) for value in np.percentile(blocks, [1, 99]))
    off = np.abs(blocks - np.median(blocks))
    level = float(np.percentile(off, 99))
    size, skip = max(1, round(_BLOCK * rate)), round(_RINGING * rate)
    for first, last in found:
        if _came_fast(position, first, rate):
            return first, last
        part = slice((first + skip) // size + 1, last // size)
        if len(blocks[part]) < _BUSY_BLOCKS:
            continue
        if drive:
            busy = bool(np.ptp(blocks[part]) > _BUSY_DRIVE * (high - low) > 0)
        else:
            busy = bool(level > 0 and np.count_nonzero(off[part] > _BUSY * level) >= _BUSY_BLOCKS)
        if busy:
            return first, last
    return None


def _came_fast(position: Array, first: int, rate: float) -> bool:
    """Whether the axis was in full motion just before: nothing stops at once."""
    size = max(1, round(_BLOCK * rate))
    if first < size:
        return False
    fastest = float(np.percentile(np.abs(np.diff(_blocks(position, rate))), 99))
    return bool(abs(position[first] - position[first - size]) > _GOES * fastest > 0)


def _blocks(x: Array, rate: float) -> Array:
    size = max(1, round(_BLOCK * rate))
    return np.asarray(x[: len(x) // size * size].reshape(-1, size).mean(axis=1))
