"""The clock of a run's recordings against the plan: dwell and speed together.

A rate declared too high by a part r makes every time shorter by r and every speed higher by r. A speed
override scales the speed and leaves the dwell; a drive that waits for its position lengthens the dwell and
leaves the speed. Only a clock changes both, in opposite directions.

From the start of one move to the start of the next in the same direction, a drive needs the way over the
speed, one acceleration and the dwell. The lag of the servo is the same at both ends and cancels, unless one
of them follows a reversal: friction has turned the axis and the screw the other way, and the start of the
first move is detected 1 to 4 ms late. So a move counts if the one before it had the same direction too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.fcft.plan import Plan
from ballscrew.recording.kinematics import Kinematics
from ballscrew.recording.motions import nearest_motion
from ballscrew.recording.phases import MotionPhase
from ballscrew.recording.quality.finding import Finding

_FEWEST = 6  # pairs of moves
_SETTLING, _BRAKING = 0.45, 0.1  # of a cruise, at its start and end, where the speed may not be the planned
_LEAST_CRUISE = 0.03  # s
# Error of a dwell by a servo that has not settled, standard uncertainty in s: 0.14 ms rms over
# 150 runs of ten axes of the testbed with different servos and loads. It changes with friction and so with
# wear, by up to 0.3 ms where 40 % of the preload is lost.
_SERVO = 0.15e-3
_PLAN = 1.5e-3  # 3 of these, from which on the rate contradicts the plan
_BASELINE = 6e-4  # of the rate, from which on the clocks of two runs differ
_SIGMAS = 2.6
_LEAST_SPREAD = 5e-5  # of dwell and speed: a drive's cycle over all dwells of a run
_TRIPS = 3  # from which on their scatter shows how well an override repeats
_WAIT = 0.35  # of the clock's error, by which the speed may contradict it


@dataclass(frozen=True, slots=True)
class MoveTimes:
    """Dwell and speed of every pair of moves of one recording, as natural logarithms over the plan's.

    Parameters
    ----------
    dwell : ndarray, shape (n,)
        Dwell; an acceleration takes less time by as much as the speed is higher.
    speed : ndarray, shape (n,)
        Speed between two stops.
    planned : float
        Mean of the plan's dwells, s.
    """

    dwell: Array
    speed: Array
    planned: float


@dataclass(frozen=True, slots=True)
class Clock:
    """Sample rate of a run against the plan's times.

    Parameters
    ----------
    rate_error : float
        Declared rate over that which fits the plan, less 1.
    rate_error_uncertainty : float
        Standard uncertainty by the scatter of the run.
    servo_uncertainty : float
        Standard uncertainty by the servo, mostly the same in every run of the axis.
    """

    rate_error: float
    rate_error_uncertainty: float
    servo_uncertainty: float = 5e-4


def measure_move_times(motion: Kinematics, phases: Sequence[MotionPhase], plan: Plan) -> MoveTimes:
    """Dwell and speed of each move between two others in the same direction.

    Parameters
    ----------
    motion : Kinematics
        Motion of the recording.
    phases : sequence of MotionPhase
        Phases of the recording.
    plan : Plan
        A move is compared with the motion that is nearest in speed and acceleration.

    Returns
    -------
    MoveTimes
        Empty where the axis does not dwell or does not reach a constant speed.
    """
    dwells, speeds, times = [], [], []
    for start, end, following in _unidirectional(phases):
        planned = plan.motions[nearest_motion(start, plan)]
        speed = cruising_speed(motion, start, end)
        in_plan = planned.dwell > planned.acceleration_time and not planned.start_spread
        if speed is None or not in_plan:
            continue
        distance = abs(end.stop_position - start.stop_position)
        moving = distance / speed + planned.acceleration_time * planned.speed / speed
        dwell = (following.start - start.start) / motion.rate - moving
        if dwell > 0:
            times.append(planned.dwell)
            dwells.append(math.log(dwell / planned.dwell))
            speeds.append(math.log(speed / planned.speed))
    return MoveTimes(np.array(dwells), np.array(speeds), float(np.mean(times)) if times else math.nan)


def _unidirectional(
    phases: Sequence[MotionPhase],
) -> Iterator[tuple[MotionPhase, MotionPhase, MotionPhase]]:
    """Start and end of each complete move between two in the same direction, and the start of the next."""
    moves = []
    for start, end in pairwise(phases):
        if start.condition.accelerating and not end.condition.accelerating:
            moves.append((start, end))
    for (before, _), (start, end), (following, _) in zip(moves, moves[1:], moves[2:], strict=False):
        same = before.condition == start.condition == following.condition
        if same and start.complete and end.complete:
            yield start, end, following


def cruising_speed(motion: Kinematics, start: MotionPhase, end: MotionPhase) -> float | None:
    """Mean speed between the start and the end of a move, where a servo has settled.

    Parameters
    ----------
    motion : Kinematics
        Motion of the recording.
    start, end : MotionPhase
        Acceleration and deceleration of one move.

    Returns
    -------
    float or None
        m/s; None where the speed is constant too briefly.
    """
    cruise = end.start - start.stop
    first, last = start.stop + int(_SETTLING * cruise), end.start - int(_BRAKING * cruise)
    if last - first <= _LEAST_CRUISE * motion.rate:
        return None
    distance = abs(float(motion.position[last] - motion.position[first]))
    return distance * motion.rate / (last - first) if distance > 0 else None


def estimate_clock(trips: Sequence[MoveTimes]) -> Clock | None:
    """Estimate the error of the declared rate from the recordings of a run.

    Parameters
    ----------
    trips : sequence of MoveTimes
        One per recording.

    Returns
    -------
    Clock or None
        None where there are fewer than six pairs of moves, or where dwell and speed contradict each other:
        then an override, or a wait for position, changed one of them.
    """
    by_dwell = _mean([-trip.dwell for trip in trips])
    by_speed = _mean([trip.speed for trip in trips])
    if by_dwell is None or by_speed is None:
        return None
    (dwell, u_dwell), (speed, u_speed) = by_dwell, by_speed
    servo = _SERVO / float(np.mean([trip.planned for trip in trips if len(trip.dwell)]))
    allowed = max(_SIGMAS * math.hypot(u_dwell, u_speed, servo), _WAIT * abs(dwell))
    if abs(dwell - speed) > allowed:
        return None
    weights = np.array([1 / max(u_dwell, _LEAST_SPREAD) ** 2, 1 / max(u_speed, _LEAST_SPREAD) ** 2])
    if sum(len(trip.speed) > 0 for trip in trips) < _TRIPS:
        weights[1] = 0.0
    error = float(weights @ np.array([dwell, speed]) / weights.sum())
    return Clock(math.expm1(error), float(weights.sum() ** -0.5), servo)


def _mean(trips: Sequence[Array]) -> tuple[float, float] | None:
    """Mean over trips and its standard uncertainty by the scatter of moves or of trips."""
    trips = [trip for trip in trips if len(trip)]
    values = np.concatenate([*trips, np.empty(0)])
    if len(values) < _FEWEST:
        return None
    spread = float(values.std(ddof=1)) / math.sqrt(len(values))
    if len(trips) > 1:
        means = [float(trip.mean()) for trip in trips]
        spread = max(spread, float(np.std(means, ddof=1)) / math.sqrt(len(trips)))
    return float(values.mean()), spread


def check_clock(clock: Clock | None, rate: float) -> list[Finding]:
    """Check the declared rate of a run against the plan's dwell and speed.

    Parameters
    ----------
    clock : Clock or None
        From :func:`estimate_clock`.
    rate : float
        Declared, Hz.

    Returns
    -------
    list of Finding
        One from 0.15 % on, or three standard uncertainties.
    """
    if clock is None:
        return []
    error, spread = clock.rate_error, math.hypot(clock.rate_error_uncertainty, clock.servo_uncertainty)
    if abs(error) < max(_PLAN, _SIGMAS * spread):
        return []
    text = (
        f"dwell and speed fit a sample rate of {rate / (1 + error):.5g} Hz, not {rate:.5g} Hz: if the plan's "
        f"times are right, every frequency is wrong by {100 * error:+.2f} % ± {100 * spread:.2f} %"
    )
    return [Finding("suspect", "rate", text)]


def clock_difference(clock: Clock | None, baseline: Clock | None) -> str | None:
    """Difference between the clocks of two runs of one plan, in words; None where there is none.

    Parameters
    ----------
    clock, baseline : Clock or None
        From :func:`estimate_clock`.
    """
    if clock is None or baseline is None:
        return None
    difference = (1 + clock.rate_error) / (1 + baseline.rate_error) - 1
    servo = max(clock.servo_uncertainty, baseline.servo_uncertainty)
    spread = math.hypot(clock.rate_error_uncertainty, baseline.rate_error_uncertainty, servo)
    if abs(difference) < max(_BASELINE, _SIGMAS * spread):
        return None
    return (
        f"the clock of the recordings differs from the baseline's by {100 * difference:+.2f} % ± "
        f"{100 * spread:.2f} % by dwell and speed, and every frequency by as much: check the sample rate"
    )
