"""Which of a plan's motions a phase belongs to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballscrew.fcft.plan import Motion, Plan
from ballscrew.recording.phases import Phase
from ballscrew.recording.stops import nearest

__all__ = ["assign_motions", "nearest_motion", "seen_acceleration"]

Indices = NDArray[np.int64]

_SPEED_GAP = 0.15  # of the speed: phases of speeds nearer than this are one motion
_ALIKE = 0.15  # in the logarithm of speed and acceleration together: nearer ones are told apart by order only


def assign_motions(
    phases: Sequence[Phase],
    position: NDArray[np.float64],
    condition: Sequence[str],
    plan: Plan | None,
) -> Indices:
    """Which motion each phase belongs to: the nearest of the plan, or a cluster of speeds.

    Motions that differ in jerk alone look alike in a recording. They are told apart by the order in which
    the plan runs them: each repetition all motions once, so at every stop and in every condition they take
    turns.

    Parameters
    ----------
    phases : sequence of Phase
        Of all recordings of a run, in the order of time.
    position : ndarray, shape (n,)
        Stop of each, m.
    condition : sequence of str
        Of each.
    plan : Plan, optional
        Gives the motions; without one, speeds are clustered.

    Returns
    -------
    ndarray of int, shape (n,)
        From 0.
    """
    speeds = np.array([phase.speed for phase in phases])
    if len(phases) == 0 or (plan is not None and len(plan.motions) == 1):
        return np.zeros(len(phases), np.int64)
    if plan is None:
        return nearest(speeds, _clusters(speeds)).astype(np.int64)
    groups = [_group(motion, plan) for motion in plan.motions]
    turns: dict[tuple[float, str, tuple[int, ...]], int] = {}
    found = []
    for row, phase in enumerate(phases):
        group = groups[nearest_motion(phase, plan)]
        key = (float(position[row]), condition[row], group)
        found.append(group[turns.get(key, 0) % len(group)])
        turns[key] = turns.get(key, 0) + phase.complete
    return np.array(found, np.int64)


def nearest_motion(phase: Phase, plan: Plan) -> int:
    """The motion of a plan whose speed and acceleration are nearest to a phase's."""
    return int(np.argmin([_distance(phase.speed, phase.acceleration, motion) for motion in plan.motions]))


def seen_acceleration(motion: Motion) -> float:
    """Median of the acceleration over the middle half of a phase, m/s², as :class:`Phase` has it.

    It is the peak, but where the jerk takes much of the time: 3/4 of it where nothing is held.
    """
    return motion.peak_acceleration * min(1.0, 0.375 * motion.acceleration_time / motion.jerk_time)


def _distance(speed: float, acceleration: float, motion: Motion) -> float:
    seen = max(speed, 1e-12) / motion.speed, max(acceleration, 1e-12) / seen_acceleration(motion)
    return float(np.abs(np.log(seen)).sum())


def _group(motion: Motion, plan: Plan) -> tuple[int, ...]:
    """All motions of the plan that look like this one, itself among them."""
    return tuple(
        index
        for index, other in enumerate(plan.motions)
        if _distance(motion.speed, seen_acceleration(motion), other) < _ALIKE
    )


def _clusters(seen: NDArray[np.float64]) -> NDArray[np.float64]:
    ordered = np.sort(seen)
    gaps = np.flatnonzero(np.diff(ordered) > _SPEED_GAP * ordered[1:]) + 1
    return np.array([np.median(group) for group in np.split(ordered, gaps)])
