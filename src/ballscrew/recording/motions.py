"""Stops of an axis, and assignment of phases to the trips and motions of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballscrew.base.arrays import Array
from ballscrew.fcft.expected import executed
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.recording.phases import MotionPhase

Indices = NDArray[np.int64]

_STOP_GAP = 0.005  # of the travel: nearer positions are of one stop
_LEAST_GAP = 0.5e-3  # m
_SPEED_GAP = 0.15  # of the speed: phases of nearer speeds are of one motion
_ALIKE = 0.15  # in the logarithms of speed and acceleration together: nearer motions need a whole trip
_CLEAR = 0.03  # by which a motion must fit a whole trip better than the next; medians are good to 1 %
_VARIANTS = 64  # repetitions that suffice for the range of a motion


def cluster(positions: ArrayLike) -> Array:
    """Find the stops of an axis from its positions at standstill, without a plan.

    Positions that differ by more than 0.5 % of the travel, and half a millimetre, are two stops.

    Parameters
    ----------
    positions : array_like
        Positions at standstill, m.

    Returns
    -------
    ndarray, shape (n_stops,)
        The median of each cluster, ascending, m.
    """
    ordered = np.sort(np.asarray(positions, dtype=np.float64))
    if len(ordered) == 0:
        return ordered
    return _medians(ordered, max(_STOP_GAP * (ordered[-1] - ordered[0]), _LEAST_GAP))


def _medians(ordered: Array, gap: float | Array) -> Array:
    """Median of each group of ascending values, between which there are larger gaps."""
    groups = np.split(ordered, np.flatnonzero(np.diff(ordered) > gap) + 1)
    return np.array([np.median(group) for group in groups])


def nearest(positions: ArrayLike, stops: ArrayLike) -> NDArray[np.intp]:
    """Index of the stop nearest to each position.

    Parameters
    ----------
    positions : array_like
        Positions at standstill, m.
    stops : array_like
        Positions of one stop or more, m.

    Returns
    -------
    ndarray of int, shape of ``positions``
        Indices into ``stops``.
    """
    distance = np.abs(np.subtract.outer(np.asarray(positions, dtype=np.float64), np.asarray(stops)))
    return np.asarray(distance.argmin(axis=-1), dtype=np.intp)


def number_trips(file: ArrayLike, position: Array, condition: ArrayLike, first: float) -> Indices:
    """Number the round trips: a trip ends where the first stop is reached, or with its file.

    Parameters
    ----------
    file : array_like of int, shape (n,)
        File of each phase, in the order of time.
    position : ndarray, shape (n,)
        Stop of each phase, m.
    condition : array_like of str, shape (n,)
        Condition of each phase.
    first : float
        The plan's first stop, m.

    Returns
    -------
    ndarray of int, shape (n,)
        Number of the trip, from 0.
    """
    files, kinds = np.asarray(file), np.asarray(condition)
    if len(files) == 0:
        return np.zeros(0, np.int64)
    returns = (position == first) & (kinds == "ND")
    departs = (position == first) & (kinds == "PA")
    begins = (np.diff(files) != 0) | returns[:-1] | departs[1:]
    return np.concatenate([[0], np.cumsum(begins)])


def warm_up_trips(count: int, plan: Plan) -> int:
    """Number of warm-up trips among the recorded trips: all, where they were recorded too, or none."""
    recorded_too = count == plan.warm_up + plan.repetitions * len(plan.motions)
    return plan.warm_up if recorded_too else 0


def assign_motions(phases: Sequence[MotionPhase], trip: Indices, plan: Plan | None) -> Indices:
    """Assign each phase to the nearest motion of the plan, or to a cluster of speeds.

    Single phases of similar motions look alike. All phases of a trip are of one motion, so their medians
    separate similar motions; where even those do not, as with motions that differ in jerk alone, the order
    does in which the plan runs its motions, a trip of each per repetition.

    Parameters
    ----------
    phases : sequence of MotionPhase
        Phases of all recordings of a run, in the order of time.
    trip : ndarray of int, shape (n,)
        Trip of each phase, from :func:`number_trips`.
    plan : Plan, optional
        Gives the motions; without it, speeds are clustered.

    Returns
    -------
    ndarray of int, shape (n,)
        Index of the motion, from 0.
    """
    if len(phases) == 0 or (plan is not None and len(plan.motions) == 1):
        return np.zeros(len(phases), np.int64)
    if plan is None:
        speeds = np.array([phase.speed for phase in phases])
        ordered = np.sort(speeds)
        return nearest(speeds, _medians(ordered, _SPEED_GAP * ordered[1:])).astype(np.int64)
    groups = _groups(plan)
    group = groups[[nearest_motion(phase, plan) for phase in phases]]
    found = group.copy()
    warm = warm_up_trips(int(trip.max()) + 1, plan)
    for label in np.unique(group):
        members = np.flatnonzero(groups == label)
        if len(members) == 1:
            continue
        for turn, number in enumerate(np.unique(trip[(group == label) & (trip >= warm)])):
            rows = np.flatnonzero((group == label) & (trip == number))
            found[rows] = _motion_of_trip([phases[row] for row in rows.tolist()], members, turn, plan)
    return found


def nearest_motion(phase: MotionPhase, plan: Plan) -> int:
    """Index of the plan's motion that is nearest to a phase in speed and acceleration."""
    motions = np.arange(len(plan.motions))
    return int(np.argmin(_distances(phase.speed, phase.acceleration, plan, motions)))


def median_acceleration(motion: Motion) -> float:
    """Median of the acceleration over the middle half of a phase, m/s², as in :class:`MotionPhase`.

    It is the peak, unless the jerk takes most of the time: 3/4 of the peak without constant acceleration.
    """
    return motion.peak_acceleration * min(1.0, 0.375 * motion.acceleration_time / motion.jerk_time)


def _motion_of_trip(phases: Sequence[MotionPhase], members: Indices, turn: int, plan: Plan) -> int:
    """Motion of a trip, among motions that look alike."""
    whole = [(phase.speed, phase.acceleration) for phase in phases if phase.complete]
    if whole:
        speed, acceleration = np.median(whole, axis=0).tolist()
        distance = _distances(speed, acceleration, plan, members)
        best, second = np.argsort(distance)[:2]
        if distance[second] - distance[best] > _CLEAR:
            return int(members[best])
    return int(members[turn % len(members)])


def indistinguishable_motions(plan: Plan) -> tuple[int, ...]:
    """Motions of a plan that differ from another in their order only, as far as a recording shows."""
    indices = np.arange(len(plan.motions))
    found = []
    for index, motion in enumerate(plan.motions):
        distance = _distances(motion.speed, median_acceleration(motion), plan, indices[indices != index])
        if distance.min(initial=np.inf) < _CLEAR:
            found.append(index)
    return tuple(found)


def order_matters(plan: Plan | None) -> bool:
    """True if only the order of the recordings determines warm-up trips, or the motion of a trip.

    Parameters
    ----------
    plan : Plan or None
        Plan of the run.

    Returns
    -------
    bool
        False without a plan.
    """
    return plan is not None and (plan.warm_up > 0 or bool(indistinguishable_motions(plan)))


def _distances(speed: float, acceleration: float, plan: Plan, motions: Indices) -> Array:
    """Distances of a speed and an acceleration from motions of a plan, in their logarithms."""
    measured = np.log([max(speed, 1e-12), max(acceleration, 1e-12)])
    found = np.empty(len(motions))
    for row, index in enumerate(motions.tolist()):
        found[row] = np.abs(measured - _logarithms(plan, index)).sum(axis=1).min()
    return found


@lru_cache(maxsize=32)
def _logarithms(plan: Plan, index: int) -> Array:
    """Logarithms of speed and acceleration of a motion in each repetition, shape (n, 2).

    Where the acceleration is not reached, its peak depends on the jerk, which differs between repetitions.
    """
    motions: Sequence[Motion] = (plan.motions[index],)
    if plan.motions[index].jerk_spread:
        motions = executed(plan, index)[:_VARIANTS]
    return np.log([(motion.speed, median_acceleration(motion)) for motion in motions])


def _groups(plan: Plan) -> Indices:
    """First motion of the group of each motion: motions that look alike, and those that look like these."""
    label = np.arange(len(plan.motions))
    for first in range(len(label)):
        for second in range(first):
            difference = _logarithms(plan, first)[:, None] - _logarithms(plan, second)
            if np.abs(difference).sum(axis=2).min() < _ALIKE:
                low, high = sorted((label[first], label[second]))
                label[label == high] = low
    return label
