"""The round trip as jerk-limited set-points: position, speed and acceleration at any time, exactly."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.plan import Motion, Plan


@dataclass(frozen=True, slots=True, eq=False)
class MotionProfile:
    """A motion of piecewise constant jerk; each array holds what is true where a piece begins.

    Parameters
    ----------
    time : ndarray, shape (n + 1,)
        Where the n pieces begin, s; last, the end.
    position, speed, acceleration, jerk : ndarray, shape (n + 1,)
        m, m/s, m/s², m/s³; at the end, standstill.
    """

    time: Array
    position: Array
    speed: Array
    acceleration: Array
    jerk: Array

    @property
    def duration(self) -> float:
        """From the first piece to the end, s."""
        return float(self.time[-1])


@dataclass(frozen=True, slots=True, eq=False)
class SetPoints:
    """Set-points of an axis.

    Parameters
    ----------
    time, position, speed, acceleration : ndarray, shape (n,)
        s, m, m/s, m/s².
    """

    time: Array
    position: Array
    speed: Array
    acceleration: Array


@dataclass(frozen=True, slots=True)
class PlannedTransient:
    """One acceleration phase of a trip.

    Parameters
    ----------
    start_s, stop_s : float
        When it starts and stops, s from the trip's start.
    position : float
        The stop that it leaves or reaches, m.
    condition : Condition
        In which direction, and which of the two.
    """

    start_s: float
    stop_s: float
    position: float
    condition: Condition


def route(plan: Plan) -> tuple[float, ...]:
    """The stops of one round trip in the order in which they are visited, m."""
    return plan.positions + plan.positions[-2::-1]


def profile(plan: Plan, motion: Motion) -> MotionProfile:
    """Motion of one round trip: standstill, move, standstill, …, move, standstill.

    Each move is seven pieces: the jerk up, the acceleration held, the jerk down, the speed held, and the same
    mirrored. Where the speed is too low for the acceleration to be reached, nothing is held.

    Parameters
    ----------
    plan : Plan
        Gives the stops.
    motion : Motion
        How this trip moves, as :func:`~ballscrew.fcft.schedule.trips` has it.

    Returns
    -------
    MotionProfile
        From standstill at the first stop to standstill there.

    Raises
    ------
    InputError
        If two neighbouring stops lie too close for the speed to be reached.
    """
    stops = np.asarray(route(plan))
    steps = np.diff(stops)
    cruise = np.abs(steps) / motion.speed - motion.acceleration_time
    if np.any(cruise < -1e-9 * motion.acceleration_time):
        raise InputError(
            f"{plan.source}: two stops lie {np.abs(steps).min():g} m apart; the motion needs "
            f"{2 * motion.acceleration_distance:g} m to reach {motion.speed:g} m/s and stop again."
        )
    rise = motion.jerk_time
    hold = max(0.0, motion.acceleration_time - 2 * rise)
    times = np.empty((len(steps), 8))
    times[:] = [rise, hold, rise, 0.0, rise, hold, rise, motion.dwell]
    times[:, 3] = np.maximum(cruise, 0.0)
    sign = np.sign(steps)[:, None]
    jerk = sign * np.array([1, 0, -1, 0, -1, 0, 1, 0]) * motion.jerk
    peak, speed = motion.peak_acceleration, motion.speed
    acceleration = sign * np.array([0, peak, peak, 0, 0, -peak, -peak, 0])
    low = motion.jerk * rise**2 / 2
    velocity = sign * np.array([0, low, speed - low, speed, speed, speed - low, low, 0])
    # Each move starts at its own stop: what is summed up does not drift along the trip.
    ways = np.cumsum(velocity * times + acceleration * times**2 / 2 + jerk * times**3 / 6, axis=1)
    place = stops[:-1, None] + np.concatenate([np.zeros((len(steps), 1)), ways[:, :-1]], axis=1)
    place[:, 7] = stops[1:]
    start = np.concatenate([[0.0, motion.dwell], motion.dwell + np.cumsum(times.ravel())])
    return MotionProfile(
        time=start,
        position=np.concatenate([stops[:1], place.ravel(), stops[-1:]]),
        speed=np.concatenate([[0.0], velocity.ravel(), [0.0]]),
        acceleration=np.concatenate([[0.0], acceleration.ravel(), [0.0]]),
        jerk=np.concatenate([[0.0], jerk.ravel(), [0.0]]),
    )


def set_points(motion: MotionProfile, time: ArrayLike) -> SetPoints:
    """Set-points at given times; before its start and after its end a trip stands still.

    Parameters
    ----------
    motion : MotionProfile
        Motion of a trip.
    time : array_like, shape (n,)
        s from the trip's start.

    Returns
    -------
    SetPoints
        Set points, each of the same length.
    """
    when = np.asarray(time, dtype=np.float64)
    clipped = np.clip(when, 0.0, motion.duration)
    piece = np.searchsorted(motion.time, clipped, side="right") - 1
    t = clipped - motion.time[piece]
    a, j, v = motion.acceleration[piece], motion.jerk[piece], motion.speed[piece]
    return SetPoints(
        time=when,
        position=motion.position[piece] + t * (v + t * (a / 2 + t * j / 6)),
        speed=v + t * (a + t * j / 2),
        acceleration=a + t * j,
    )


def planned_transients(plan: Plan, motion: Motion) -> tuple[PlannedTransient, ...]:
    """Every acceleration phase of one round trip, in the order of time.

    Parameters
    ----------
    plan : Plan
        Gives the stops.
    motion : Motion
        How this trip moves.

    Returns
    -------
    tuple of PlannedTransient
        Two a move: 4 n − 4 for n stops.
    """
    stops = route(plan)
    found: list[PlannedTransient] = []
    start = motion.dwell
    for here, there in pairwise(stops):
        up = there > here
        stop = start + abs(there - here) / motion.speed + motion.acceleration_time
        leave, arrive = (Condition.PA, Condition.PD) if up else (Condition.NA, Condition.ND)
        found += [
            PlannedTransient(start, start + motion.acceleration_time, here, leave),
            PlannedTransient(stop - motion.acceleration_time, stop, there, arrive),
        ]
        start = stop + motion.dwell
    return tuple(found)
