"""Speed and acceleration of an axis from its position alone, smoothed to suit its motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array

_SMOOTHING = 0.05  # of the time an acceleration takes: edges stay, the ringing of the axis goes
_LEAST, _MOST = 0.5e-3, 6e-3  # s; the longest still separates two phases of 50 ms
_FEWEST_SAMPLES = 1.5  # a Gaussian narrower than this is no filter
_LEAST_MOTION = 0.03  # s
_MOVING = 0.1  # of the speed reached
_PASSES = 3  # the smoothing depends on the acceleration that it shows; three passes settle it


@dataclass(frozen=True, slots=True)
class Kinematics:
    """Smoothed motion of one recording.

    Parameters
    ----------
    position, speed, acceleration : ndarray, shape (n,)
        In m, m/s and m/s².
    rate : float
        Samples per second, Hz.
    smoothing : float
        Standard deviation of the Gaussian that smoothed them, s.
    cruise : float
        Cruising speed, m/s: the 99th percentile of the speed while the axis moves.
    """

    position: Array
    speed: Array
    acceleration: Array
    rate: float
    smoothing: float
    cruise: float


def differentiate(x: Array, rate: float, smoothing: float, order: int) -> Array:
    """Derivative of a signal convolved with a Gaussian.

    The signal is continued at its ends by point reflection, which keeps the slope: a record may start in
    motion.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Signal.
    rate : float
        Samples per second, Hz.
    smoothing : float
        Standard deviation of the Gaussian, s.
    order : int
        0 smooths, 1 and 2 differentiate as often.

    Returns
    -------
    ndarray, shape (n,)
        In units of ``x`` per second to the power of ``order``.
    """
    smooth = _smoothed(x, rate, smoothing, order, 0)
    return np.asarray(smooth + (x[0] if order == 0 else 0.0), dtype=np.float64)


def rates(x: Array, rate: float, smoothing: float) -> tuple[Array, Array]:
    """First and second derivative of a signal convolved with a Gaussian, at the cost of one.

    Parameters
    ----------
    x, rate, smoothing
        As of :func:`differentiate`.

    Returns
    -------
    ndarray, ndarray, shape (n,)
        In units of ``x`` per second and per second squared.
    """
    beyond = _smoothed(x, rate, smoothing, 1, 1)
    return beyond[1:-1].copy(), (beyond[2:] - beyond[:-2]) * (0.5 * rate)


def _smoothed(x: Array, rate: float, smoothing: float, order: int, beyond: int) -> Array:
    """Derivative less the signal's first value, with samples beyond both ends."""
    from scipy.signal import oaconvolve

    sigma = max(smoothing * rate, _FEWEST_SAMPLES)
    pad = min(int(np.ceil(5 * sigma)) + beyond, len(x) - 1)
    head = 2 * x[0] - x[pad:0:-1]
    tail = 2 * x[-1] - x[-2 : -pad - 2 : -1]
    padded = np.concatenate([head, x, tail]) - x[0]
    # Differences first, a plain Gaussian after: the sampled derivative of a Gaussian does not sum to
    # zero, and would make an acceleration of a position of half a metre.
    for _ in range(order):
        padded = np.gradient(padded) * rate
    half = max(pad - beyond, 0)
    offsets = np.arange(-half, half + 1)
    kernel = np.exp(-0.5 * (offsets / sigma) ** 2)
    return np.asarray(oaconvolve(padded, kernel / kernel.sum(), mode="valid"))


def _moving(speed: Array, rate: float) -> NDArray[np.bool_]:
    """True where the axis moves, relative to its highest speed for 30 ms: a spike is no motion."""
    size = np.abs(speed)
    rank = min(len(size), max(1, round(_LEAST_MOTION * rate)))
    return np.asarray(size >= _MOVING * np.partition(size, -rank)[-rank])


def high_level(values: Array, speed: Array, rate: float) -> float:
    """Level of a signal while the axis moves, which does not depend on the duration of standstill.

    Parameters
    ----------
    values, speed : ndarray, shape (n,)
        Signal, and the axis' speed, m/s.
    rate : float
        Samples per second, Hz.

    Returns
    -------
    float
        99th percentile of the magnitude over the moving samples, in units of ``values``.
    """
    return _high(values, _moving(speed, rate))


def _high(values: Array, moving: NDArray[np.bool_]) -> float:
    return float(np.percentile(np.abs(values[moving]), 99))


def kinematics(position: Array, rate: float) -> Kinematics:
    """Speed and acceleration, smoothed over a twentieth of the time that an acceleration takes.

    Parameters
    ----------
    position : ndarray, shape (n,)
        Position, m.
    rate : float
        Samples per second, Hz.

    Returns
    -------
    Kinematics
        Motion of the recording; ``cruise`` is 0 for an axis that stands.
    """
    smoothing = _MOST
    for _ in range(_PASSES):
        speed, acceleration = rates(position, rate, smoothing)
        moving = _moving(speed, rate)
        cruise, hardest = _high(speed, moving), _high(acceleration, moving)
        time = cruise / hardest if hardest > 0 else np.inf
        wanted = float(np.clip(_SMOOTHING * time, _LEAST, _MOST))
        if abs(wanted - smoothing) < 0.05 * smoothing:
            break
        smoothing = wanted
    return Kinematics(position, speed, acceleration, rate, smoothing, cruise)
