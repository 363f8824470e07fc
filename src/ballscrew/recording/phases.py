"""Acceleration phases, found in the position alone.

A phase takes the axis from standstill to a speed, or back. An acceleration that neither starts nor ends near
standstill, or hardly changes the speed (an overshoot of the control loop), is no phase.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.fcft.conditions import Condition
from ballscrew.recording.kinematics import Kinematics, high_level

_SEED = 0.2  # of the hardest acceleration: two acceleration levels may differ by a factor of three
_LEAST_SPEED = 0.12  # of the cruising speed that a phase must reach: below lie overshoots
_STANDSTILL = 0.25  # of a phase's higher speed that its lower one may be
_LEAST_CHANGE = 0.02  # of a phase's higher speed: smaller changes are noise of a constant speed
_EDGE = 3.0  # standard deviations of the smoothing: nearer to the record's end, a phase may be cut
_SMOOTHED_STEP = 1.349  # a step under a Gaussian goes from 25 to 75 % in this many standard deviations
_CONDITIONS = {  # by acceleration and direction
    (True, True): Condition.PA,
    (True, False): Condition.NA,
    (False, True): Condition.PD,
    (False, False): Condition.ND,
}


@dataclass(frozen=True, slots=True)
class MotionPhase:
    """One acceleration or deceleration.

    Parameters
    ----------
    start, stop : int
        First sample, and the sample after the last.
    condition : Condition
        PA, PD, NA or ND.
    stop_position : float
        Position of the stop before (PA, NA) or after (PD, ND), m.
    speed : float
        Highest speed, m/s, without sign.
    acceleration : float
        Median over the middle of the phase, m/s², without sign.
    complete : bool
        False where the record's start or end cuts the phase.
    """

    start: int
    stop: int
    condition: Condition
    stop_position: float
    speed: float
    acceleration: float
    complete: bool


def find_phases(motion: Kinematics, *, least_speed: float | None = None) -> tuple[MotionPhase, ...]:
    """Find every acceleration and deceleration between standstill and a speed.

    Parameters
    ----------
    motion : Kinematics
        Smoothed motion of one recording.
    least_speed : float, optional
        Speed that a phase must reach, m/s; by default 12 % of the cruising speed.

    Returns
    -------
    tuple of MotionPhase
        In the order of time. A reversal without a stop is a deceleration and an acceleration.
    """
    if motion.cruise <= 0:
        return ()
    least = least_speed
    if least is None:
        least = _LEAST_SPEED * motion.cruise
    edges = []
    for first, last in _seeds(motion):
        edges.append(_edges(first, last, motion))
    phases = []
    previous = 0
    following = [start for start, _ in edges[1:]]
    following.append(len(motion.speed))
    for (start, stop), after in zip(edges, following, strict=False):
        phase = _phase(start, stop, min(previous, start), max(after, stop), motion, least)
        if phase is not None:
            phases.append(phase)
        previous = stop
    return tuple(phases)


def pauses(phases: Sequence[MotionPhase]) -> list[tuple[int, int]]:
    """First sample, and sample after the last, of each standstill between two moves."""
    found = []
    for before, after in pairwise(phases):
        if after.condition.accelerating and not before.condition.accelerating:
            found.append((before.stop, after.start))
    return found


def _seeds(motion: Kinematics) -> list[tuple[int, int]]:
    """Spans of acceleration of one sign above the noise, cut where the speed changes its sign.

    The acceleration of a reversal without a stop keeps its sign.
    """
    acceleration, speed = motion.acceleration, motion.speed
    hardest = high_level(acceleration, speed, motion.rate)
    sign = np.where(np.abs(acceleration) > _SEED * hardest, np.sign(acceleration), 0).astype(np.int8)
    bounds = [0, *(np.flatnonzero(np.diff(sign)) + 1).tolist(), len(sign)]
    spans: list[tuple[int, int]] = []
    for first, last in pairwise(bounds):
        if sign[first] == 0:
            continue
        reversals = np.flatnonzero(np.diff(np.signbit(speed[first:last])))[:1] + first + 1
        spans += pairwise([first, *reversals.tolist(), last])
    return spans


def _edges(first: int, last: int, motion: Kinematics) -> tuple[int, int]:
    """Samples at which the acceleration leaves zero and returns to it.

    A jerk-limited ramp that passes 25 and 75 % of its height at t1 and t2 starts (t2 - t1) before its half;
    the contribution of the smoothing to t2 - t1 is subtracted in quadrature.
    """
    size = np.abs(motion.acceleration[first:last])
    level = float(np.percentile(size, 80))
    smoothing = _SMOOTHED_STEP * motion.smoothing * motion.rate

    def ramp_start(values: Array) -> int:
        quarter = int(np.argmax(values >= 0.25 * level))
        half = int(np.argmax(values >= 0.5 * level))
        most = int(np.argmax(values >= 0.75 * level))
        return round(half - math.sqrt(max(0.0, (most - quarter) ** 2 - smoothing**2)))

    return max(0, first + ramp_start(size)), min(len(motion.speed), last - ramp_start(size[::-1]))


def _phase(
    start: int, stop: int, before: int, after: int, motion: Kinematics, least: float
) -> MotionPhase | None:
    """Phase between two samples, None for an overshoot; the axis may stand from ``before`` to ``after``."""
    speed = motion.speed
    first, last = float(speed[start]), float(speed[min(stop, len(speed) - 1)])
    accelerates = abs(last) > abs(first)
    high, low = first, last
    if accelerates:
        high, low = last, first
    margin = round(_EDGE * motion.smoothing * motion.rate)
    cut = start <= margin or stop >= len(speed) - margin
    if abs(high) < least or (abs(low) > _STANDSTILL * abs(high) and not cut):
        return None
    if abs(high) - abs(low) < _LEAST_CHANGE * abs(high):
        return None
    pause, edge = slice(stop, after), stop - 1
    if accelerates:
        pause, edge = slice(before, start), start
    rest = motion.position[pause][np.abs(speed[pause]) < 0.02 * least]
    if not len(rest):  # an axis that reverses at once never stands
        rest = motion.position[edge : edge + 1]
    quarter = (stop - start) // 4
    middle = motion.acceleration[start + quarter : stop - quarter]
    return MotionPhase(
        start=start,
        stop=stop,
        condition=_CONDITIONS[accelerates, high > 0],
        stop_position=float(np.median(rest)),
        speed=abs(high),
        acceleration=float(np.median(np.abs(middle))) if len(middle) else 0.0,
        complete=not cut,
    )
