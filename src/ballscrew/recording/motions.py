"""Which trip of a plan a phase belongs to, and which of its motions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ballscrew.fcft.expected import executed
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.recording.phases import Phase
from ballscrew.recording.stops import nearest

__all__ = [
    "assign_motions",
    "look_alike",
    "nearest_motion",
    "number_trips",
    "order_matters",
    "seen_acceleration",
    "warm_up_trips",
]

Indices = NDArray[np.int64]

_SPEED_GAP = 0.15  # of the speed: phases of speeds nearer than this are one motion
_ALIKE = 0.15  # in the logarithm of speed and acceleration together: nearer ones need a whole trip to tell
_CLEAR = 0.03  # by which one motion must fit a whole trip better than the next; medians know a per cent
_VARIANTS = 64  # repetitions that are enough to know how far a motion varies


def number_trips(
    file: Sequence[int], position: NDArray[np.float64], condition: Sequence[str], first: float
) -> Indices:
    """Number the round trips: one ends where the first stop is reached, or with its file.

    Parameters
    ----------
    file : sequence of int
        Of each phase, in the order of time.
    position : ndarray, shape (n,)
        Stop of each, m.
    condition : sequence of str
        Of each.
    first : float
        The plan's first stop, m.

    Returns
    -------
    ndarray of int, shape (n,)
        From 0.
    """
    numbers = np.zeros(len(file), np.int64)
    for row in range(1, len(file)):
        home = (position[row - 1] == first and condition[row - 1] == "ND") or (
            position[row] == first and condition[row] == "PA"
        )
        numbers[row] = numbers[row - 1] + (file[row] != file[row - 1] or home)
    return numbers


def warm_up_trips(count: int, plan: Plan) -> int:
    """How many of the recorded trips are warm-up: all, where they were recorded too, else none."""
    return plan.warm_up if count == plan.warm_up + plan.repetitions * len(plan.motions) else 0


def assign_motions(phases: Sequence[Phase], trip: Indices, plan: Plan | None) -> Indices:
    """Which motion each phase belongs to: the nearest of the plan, or a cluster of speeds.

    Motions that differ by little look alike in a single phase. All phases of a trip are of one motion, so
    their medians tell them apart; where even those do not, as with motions that differ in jerk alone, the
    order does in which the plan runs its motions, one trip of each a repetition.

    Parameters
    ----------
    phases : sequence of Phase
        Of all recordings of a run, in the order of time.
    trip : ndarray of int, shape (n,)
        Of each, from :func:`number_trips`.
    plan : Plan, optional
        Gives the motions; without one, speeds are clustered.

    Returns
    -------
    ndarray of int, shape (n,)
        From 0.
    """
    if len(phases) == 0 or (plan is not None and len(plan.motions) == 1):
        return np.zeros(len(phases), np.int64)
    if plan is None:
        speeds = np.array([phase.speed for phase in phases])
        return nearest(speeds, _clusters(speeds)).astype(np.int64)
    group_of = _groups(plan)
    group = [group_of[nearest_motion(phase, plan)] for phase in phases]
    found = np.array([members[0] for members in group], np.int64)
    warm = warm_up_trips(int(trip.max()) + 1, plan)
    for members in set(group):
        if len(members) == 1:
            continue
        own = np.array([each == members for each in group])
        for turn, number in enumerate(np.unique(trip[own & (trip >= warm)])):
            rows = np.flatnonzero(own & (trip == number))
            found[rows] = _of_trip([phases[int(row)] for row in rows], members, turn, plan)
        found[own & (trip < warm)] = members[0]
    return found


def nearest_motion(phase: Phase, plan: Plan) -> int:
    """The motion of a plan whose speed and acceleration are nearest to a phase's."""
    fits = [_fit(phase.speed, phase.acceleration, plan, index) for index in range(len(plan.motions))]
    return int(np.argmin(fits))


def seen_acceleration(motion: Motion) -> float:
    """Median of the acceleration over the middle half of a phase, m/s², as :class:`Phase` has it.

    It is the peak, but where the jerk takes much of the time: 3/4 of it where nothing is held.
    """
    return motion.peak_acceleration * min(1.0, 0.375 * motion.acceleration_time / motion.jerk_time)


def _of_trip(phases: Sequence[Phase], members: tuple[int, ...], turn: int, plan: Plan) -> int:
    """Which of some motions that look alike the phases of one trip are."""
    whole = [phase for phase in phases if phase.complete]
    if whole:
        speed = float(np.median([phase.speed for phase in whole]))
        acceleration = float(np.median([phase.acceleration for phase in whole]))
        fit = np.array([_fit(speed, acceleration, plan, index) for index in members])
        best, second = np.argsort(fit)[:2]
        if fit[second] - fit[best] > _CLEAR:
            return members[int(best)]
    return members[turn % len(members)]


def look_alike(plan: Plan) -> tuple[int, ...]:
    """Motions of a plan that no recording can tell from another one, so that only their order does."""
    return tuple(
        index
        for index, motion in enumerate(plan.motions)
        if any(
            _fit(motion.speed, seen_acceleration(motion), plan, other) < _CLEAR
            for other in range(len(plan.motions))
            if other != index
        )
    )


def order_matters(plan: Plan | None) -> bool:
    """Whether only the order of the recordings says which of them is a warm-up, or of which motion.

    Parameters
    ----------
    plan : Plan or None
        Of the run.

    Returns
    -------
    bool
        False without a plan.
    """
    return plan is not None and (plan.warm_up > 0 or bool(look_alike(plan)))


def _fit(speed: float, acceleration: float, plan: Plan, index: int) -> float:
    return min(_distance(speed, acceleration, one) for one in _variants(plan, index))


def _distance(speed: float, acceleration: float, motion: Motion) -> float:
    seen = max(speed, 1e-12) / motion.speed, max(acceleration, 1e-12) / seen_acceleration(motion)
    return float(np.abs(np.log(seen)).sum())


@lru_cache(maxsize=32)
def _variants(plan: Plan, index: int) -> tuple[Motion, ...]:
    """A motion as the repetitions run it: without a reached acceleration, its peak follows the jerk."""
    motion = plan.motions[index]
    return executed(plan, index)[:_VARIANTS] if motion.jerk_spread else (motion,)


def _groups(plan: Plan) -> dict[int, tuple[int, ...]]:
    """Motion to all that look like it, and like those in turn: every motion is in one group."""
    count = len(plan.motions)
    label = list(range(count))
    for one in range(count):
        for other in range(one):
            near = min(
                _distance(a.speed, seen_acceleration(a), b)
                for a in _variants(plan, one)
                for b in _variants(plan, other)
            )
            if near < _ALIKE:
                merged, gone = sorted((label[one], label[other]))
                label = [merged if each == gone else each for each in label]
    return {index: tuple(i for i in range(count) if label[i] == label[index]) for index in range(count)}


def _clusters(seen: NDArray[np.float64]) -> NDArray[np.float64]:
    ordered = np.sort(seen)
    gaps = np.flatnonzero(np.diff(ordered) > _SPEED_GAP * ordered[1:]) + 1
    return np.array([np.median(group) for group in np.split(ordered, gaps)])
