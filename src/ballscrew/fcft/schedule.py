"""The order of a test: its round trips, and how each differs from the others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

from ballscrew.base.errors import InputError, shown
from ballscrew.fcft.plan import Motion, Plan

_MOST_TRIPS = 100_000  # a slip in the repetitions must not fill the memory


@dataclass(frozen=True, slots=True)
class Trip:
    """One round trip of a plan.

    Parameters
    ----------
    repetition : int
        Which, from 1; 0 for a warm-up trip, which is not measured.
    motion : int
        Which of the plan's motions, from 0.
    executed : Motion
        That motion as this trip runs it: its jerk and dwell varied where the plan asks for it.
    """

    repetition: int
    motion: int
    executed: Motion


@lru_cache(maxsize=16)
def trips(plan: Plan) -> tuple[Trip, ...]:
    """All round trips with one load, in the order in which they are run.

    Warm-up trips come first. Then each repetition runs every motion once. Where the plan varies jerk and
    start, repetition k takes the k-th point of Halton's sequence (bases 2 and 3), less a half: the first has
    the nominal jerk, and any number of repetitions is spread evenly.

    Parameters
    ----------
    plan : Plan
        The test.

    Returns
    -------
    tuple of Trip
        ``warm_up + repetitions × motions`` of them.

    Raises
    ------
    InputError
        If there are more than 100 000.
    """
    count = plan.warm_up + plan.repetitions * len(plan.motions)
    if count > _MOST_TRIPS:
        raise InputError(
            f"{plan.source}: warm_up and repetitions make {shown(count)} round trips; "
            f"they must make {_MOST_TRIPS} or fewer."
        )
    warm = (Trip(0, 0, plan.motions[0]),) * plan.warm_up
    return warm + tuple(
        Trip(repetition, index, _varied(motion, repetition))
        for repetition in range(1, plan.repetitions + 1)
        for index, motion in enumerate(plan.motions)
    )


def settings_change(before: Motion, after: Motion) -> bool:
    """Return True if the controller needs new settings: no program sets acceleration and jerk."""
    return (before.acceleration, before.jerk) != (after.acceleration, after.jerk)


def settings_changes(plan: Plan) -> int:
    """Number of trips of a test before which acceleration or jerk change."""
    return sum(settings_change(before.executed, after.executed) for before, after in pairwise(trips(plan)))


def move_time(distance: float, motion: Motion) -> float:
    """Time from standstill to standstill over a distance that lets the speed be reached, s."""
    return distance / motion.speed + motion.acceleration_time


def trip_time(plan: Plan, motion: Motion) -> float:
    """Time of one round trip, s.

    It begins and ends with the standstill of a stop, so that each trip is a recording by itself.
    """
    there = sum(move_time(b - a, motion) + motion.dwell for a, b in pairwise(plan.positions))
    return 2 * there + motion.dwell


def duration(plan: Plan) -> float:
    """Time of the whole test with one load, warm-up included, s."""
    return sum(trip_time(plan, trip.executed) for trip in trips(plan))


def _varied(motion: Motion, repetition: int) -> Motion:
    if not (motion.jerk_spread or motion.start_spread):
        return motion
    exponent = 2 * _radical_inverse(repetition, 2) - 1
    return replace(
        motion,
        jerk=motion.jerk * (1 + motion.jerk_spread) ** exponent,
        dwell=motion.dwell + motion.start_spread * _radical_inverse(repetition, 3),
    )


def _radical_inverse(number: int, base: int) -> float:
    """The digits of a number mirrored at the point: 1, 2, 3 in base 2 are 0.5, 0.25, 0.75."""
    value, part = 0.0, 1.0 / base
    while number:
        number, digit = divmod(number, base)
        value += digit * part
        part /= base
    return value
