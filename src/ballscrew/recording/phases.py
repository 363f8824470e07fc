"""Acceleration phases, found in the position alone.

A phase takes the axis from standstill to a speed, or back. What looks like one, but neither starts nor
ends near standstill, or changes the speed too little (an overshoot of the control loop), is none.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.fcft.conditions import Condition
from ballscrew.recording.kinematics import Kinematics, high_level

__all__ = ["Phase", "find_phases"]

_SEED = 0.2  # of the hardest acceleration held: two acceleration levels may differ by a factor of three
_LEAST_SPEED = 0.12  # of the cruising speed that a phase must reach: below lie overshoots
_STANDSTILL = 0.25  # of a phase's higher speed that its lower one may be
_LEAST_CHANGE = 0.02  # of a phase's higher speed that it must change it by: less is noise of an even motion
_EDGE = 3.0  # standard deviations of the smoothing: nearer to the record's end, a phase may be cut by it
_SMOOTHED_STEP = 1.349  # a step under a Gaussian goes from 25 to 75 % in this many standard deviations


@dataclass(frozen=True, slots=True)
class Phase:
    """One acceleration or deceleration.

    Parameters
    ----------
    start, stop : int
        First sample and the one after the last.
    condition : Condition
        PA, PD, NA or ND.
    stop_position : float
        Where the axis stood before (PA, NA) or came to stand (PD, ND), m.
    speed : float
        The speed reached or left, m/s, without sign.
    acceleration : float
        Median over the middle of the phase, m/s², without sign.
    complete : bool
        False where the record's start or end cuts it.
    """

    start: int
    stop: int
    condition: Condition
    stop_position: float
    speed: float
    acceleration: float
    complete: bool


def find_phases(motion: Kinematics, *, least_speed: float | None = None) -> tuple[Phase, ...]:
    """Find every acceleration and deceleration between standstill and a speed.

    Parameters
    ----------
    motion : Kinematics
        Smoothed motion of one recording.
    least_speed : float, optional
        Speed that a phase must reach, m/s; by default 12 % of the cruising speed. A plan knows better.

    Returns
    -------
    tuple of Phase
        In the order of time. A reversal without a stop is two: the deceleration and the acceleration.
    """
    if motion.cruise <= 0:
        return ()
    least = _LEAST_SPEED * motion.cruise if least_speed is None else least_speed
    spans = [
        part for first, last in _seeds(motion) for part in _split_at_standstill(first, last, motion.speed)
    ]
    edges = [_edges(first, last, motion) for first, last in spans]
    phases = []
    for index, (start, stop) in enumerate(edges):
        before = edges[index - 1][1] if index else 0
        after = edges[index + 1][0] if index + 1 < len(edges) else len(motion.speed)
        phase = _phase(start, stop, min(before, start), max(after, stop), motion, least)
        if phase is not None:
            phases.append(phase)
    return tuple(phases)


def _seeds(motion: Kinematics) -> list[tuple[int, int]]:
    """Spans of one sign in which the acceleration is no noise."""
    hardest = high_level(motion.acceleration, motion.speed, motion.rate)
    acceleration = motion.acceleration
    hard = np.abs(acceleration) > _SEED * hardest
    sign = np.where(hard, np.sign(acceleration), 0).astype(np.int8)
    cuts = np.flatnonzero(np.diff(sign)) + 1
    bounds = [0, *cuts.tolist(), len(sign)]
    return [(a, b) for a, b in itertools.pairwise(bounds) if sign[a] != 0]


def _split_at_standstill(first: int, last: int, speed: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Part a reversal, whose acceleration keeps its sign, where the speed changes its own."""
    crossing = np.flatnonzero(np.diff(np.signbit(speed[first:last])))
    if len(crossing) == 0:
        return [(first, last)]
    middle = first + int(crossing[0]) + 1
    return [(a, b) for a, b in ((first, middle), (middle, last)) if b > a]


def _edges(first: int, last: int, motion: Kinematics) -> tuple[int, int]:
    """Where the acceleration leaves zero and comes back to it.

    A jerk-limited ramp that passes 25 and 75 % of its height at t1 and t2 starts (t2 - t1) before its half;
    what the smoothing adds to t2 - t1 is taken out in quadrature.
    """
    size = np.abs(motion.acceleration[first:last])
    level = float(np.percentile(size, 80))
    widening = _SMOOTHED_STEP * motion.smoothing * motion.rate

    def inwards(values: NDArray[np.float64]) -> int:
        quarter, half, most = (int(np.argmax(values >= part * level)) for part in (0.25, 0.5, 0.75))
        return round(half - math.sqrt(max(0.0, (most - quarter) ** 2 - widening**2)))

    return max(0, first + inwards(size)), min(len(motion.speed), last - inwards(size[::-1]))


def _phase(start: int, stop: int, before: int, after: int, motion: Kinematics, least: float) -> Phase | None:
    """The phase between two samples, or None where it is only an overshoot."""
    speed = motion.speed
    ends = speed[start], speed[min(stop, len(speed) - 1)]
    departs = abs(ends[1]) > abs(ends[0])
    high, low = (ends[1], ends[0]) if departs else ends
    margin = round(_EDGE * motion.smoothing * motion.rate)
    at_edge = start <= margin or stop >= len(speed) - margin
    if abs(high) < least or (abs(low) > _STANDSTILL * abs(high) and not at_edge):
        return None
    if abs(high) - abs(low) < _LEAST_CHANGE * abs(high):
        return None
    if departs:
        condition = Condition.PA if high > 0 else Condition.NA
        rest = motion.position[_standing(before, start, speed, least)]
    else:
        condition = Condition.PD if high > 0 else Condition.ND
        rest = motion.position[_standing(stop, after, speed, least)]
    middle = motion.acceleration[start + (stop - start) // 4 : stop - (stop - start) // 4]
    position = float(np.median(rest)) if len(rest) else float(motion.position[start if departs else stop - 1])
    hardness = float(np.median(np.abs(middle))) if len(middle) else 0.0
    return Phase(start, stop, condition, position, float(abs(high)), hardness, not at_edge)


def _standing(first: int, last: int, speed: NDArray[np.float64], least: float) -> NDArray[np.intp]:
    """Samples of a pause in which the axis stands; none where it turns at once."""
    return first + np.flatnonzero(np.abs(speed[first:last]) < 0.02 * least)
