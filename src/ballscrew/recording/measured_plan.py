"""Plan of a run as measured by its position channel: stops, speed, acceleration, dwell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import BallscrewError
from ballscrew.fcft.conditions import Condition
from ballscrew.recording.kinematics import Kinematics, kinematics
from ballscrew.recording.motions import cluster, nearest
from ballscrew.recording.phases import MotionPhase, find_phases, pauses
from ballscrew.recording.quality.clock import cruising_speed

_UNEVEN = 0.02  # of a step: deviation of measured stops from even spacing


@dataclass(frozen=True, slots=True)
class MeasuredPlan:
    """A plan as far as the position shows it.

    Parameters
    ----------
    stops : tuple of float
        Ascending, m.
    step : float, optional
        Distance of the stops where they are evenly spaced, m.
    repetitions : int
        Forward departures from the most visited stop.
    speed, acceleration, dwell : float
        In m/s, m/s² and s; dwell is NaN where the axis never stood.
    """

    stops: tuple[float, ...]
    step: float | None
    repetitions: int
    speed: float
    acceleration: float
    dwell: float


def measure_plan(position: Array, rate: float) -> MeasuredPlan | None:
    """Measure the plan from a position channel.

    Parameters
    ----------
    position : ndarray of shape (samples,)
        Position, m.
    rate : float
        Sample rate, Hz.

    Returns
    -------
    MeasuredPlan or None
        None where the motion is not clear enough.
    """
    if not np.all(np.isfinite(position)) or np.ptp(position) <= 0:
        return None
    try:
        motion = kinematics(position, rate)
        phases = find_phases(motion)
    except (BallscrewError, ValueError, IndexError):
        return None  # a proposal is not worth an error: the user fills it in
    if not _is_clear(phases, rate, len(position)):
        return None
    places = np.array([phase.stop_position for phase in phases])
    found = _settled(phases, cluster(places))
    stops = tuple(round(stop, 5) for stop in found.tolist())
    if len(stops) < 2 or len(set(stops)) < len(stops):
        return None
    return MeasuredPlan(
        stops=stops,
        step=_even_step(stops),
        repetitions=_repetitions(phases, nearest(places, found)),
        speed=_speed(motion, phases),
        acceleration=_rounded(np.median([phase.acceleration for phase in phases]), 2),
        dwell=_dwell(phases, rate),
    )


def _settled(phases: Sequence[MotionPhase], found: Array) -> Array:
    """Stops as the axis leaves them, where it leaves each of them: after it has settled."""
    settled = cluster([phase.stop_position for phase in phases if phase.condition.accelerating])
    if len(settled) == len(found):
        return settled
    return found


def _even_step(stops: Sequence[float]) -> float | None:
    """Distance of evenly spaced stops, m; None for other stops."""
    steps = np.diff(stops)
    if np.any(np.abs(steps - np.median(steps)) >= _UNEVEN * np.median(steps)):
        return None
    return round((stops[-1] - stops[0]) / len(steps), 5)


def _is_clear(phases: tuple[MotionPhase, ...], rate: float, samples: int) -> bool:
    """True if there are at least four phases, longer than five samples and much shorter than the record."""
    if len(phases) < 4:
        return False
    speed = np.array([phase.speed for phase in phases])
    acceleration = np.array([phase.acceleration for phase in phases])
    durations = np.divide(speed, acceleration, out=np.full_like(speed, np.inf), where=acceleration > 0)
    return bool(5 < np.median(durations) * rate < samples / len(phases))


def _repetitions(phases: tuple[MotionPhase, ...], stops: NDArray[np.intp]) -> int:
    """Forward departures from the most visited of the stops, to each of which a phase belongs."""
    departs = np.array([phase.condition is Condition.PA for phase in phases])
    return int(np.bincount(stops[departs]).max(initial=1))


def _dwell(phases: tuple[MotionPhase, ...], rate: float) -> float:
    """Median standstill between two moves, s; NaN without any."""
    found = np.array(pauses(phases))
    if not len(found):
        return math.nan
    return round(float(np.median((found[:, 1] - found[:, 0]) / rate)), 2)


def _speed(motion: Kinematics, phases: Sequence[MotionPhase]) -> float:
    """Cruising speed, which no overshoot raises; the highest where no move cruises."""
    cruising = []
    for start, end in pairwise(phases):
        if start.condition.accelerating and not end.condition.accelerating:
            speed = cruising_speed(motion, start, end)
            if speed is not None:
                cruising.append(speed)
    return _rounded(np.median(cruising or [phase.speed for phase in phases]), 3)


def _rounded(value: float | np.floating, digits: int) -> float:
    """Value to a number of significant digits."""
    return float(f"{float(value):.{digits}g}")
