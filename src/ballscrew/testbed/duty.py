"""Duty of an axis: production moves, a jittering motion that accelerates its wear, and travel by place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.given import finite, not_negative
from ballscrew.axis.model import guide_friction, weight_on_nut
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError


@dataclass(frozen=True, slots=True)
class Stroke:
    """Move from standstill to standstill.

    Parameters
    ----------
    start, stop : float
        Positions, m; not equal.
    speed, acceleration : float
        Highest values, m/s and m/s²; a short stroke does not reach the speed.
    per_day : float
        Number of strokes per day.
    load : float
        Load on the table, kg.
    """

    start: float
    stop: float
    speed: float
    acceleration: float
    per_day: float
    load: float = 0.0

    @property
    def length(self) -> float:
        """Length of the stroke, m."""
        return abs(self.stop - self.start)

    @property
    def ramp(self) -> float:
        """Distance of the acceleration, and of the deceleration, m."""
        return min(self.speed**2 / (2 * self.acceleration), self.length / 2)


@dataclass(frozen=True, slots=True)
class LoadPhase:
    """Part of a stroke with constant nut load.

    Parameters
    ----------
    low, high : float
        Range of axis positions, m.
    per_day : float
        Number per day.
    nut_load : float
        Magnitude of the nut load, N.
    """

    low: float
    high: float
    per_day: float
    nut_load: float


def production(
    positions: Sequence[float], speed: float, acceleration: float, cycles: float, load: float
) -> tuple[Stroke, ...]:
    """Strokes of a cycle that visits positions in their order and goes back to the first.

    Parameters
    ----------
    positions : sequence of float
        Two or more, m; neighbours differ, and so do the last and the first.
    speed, acceleration : float
        m/s, m/s².
    cycles : float
        Cycles per day.
    load : float
        Load on the table, kg.

    Returns
    -------
    tuple of Stroke
        A stroke for each position.
    """
    ways = [*pairwise(positions), (positions[-1], positions[0])]
    return tuple(Stroke(start, stop, speed, acceleration, cycles, load) for start, stop in ways)


def jitter(
    places: Sequence[float], stroke: float, speed: float, acceleration: float, per_day: float, load: float
) -> tuple[Stroke, ...]:
    """The jittering motion of an accelerated life: short strokes to and fro about places.

    Parameters
    ----------
    places : sequence of float
        Centres of the motion, m; one or more.
    stroke : float
        Distance from end to end, m.
    speed, acceleration : float
        m/s, m/s².
    per_day : float
        Strokes to and fro a day, at all places together.
    load : float
        Load on the table, kg.

    Returns
    -------
    tuple of Stroke
        Two strokes for each place.
    """
    each = per_day / len(places)
    return tuple(
        Stroke(place - way, place + way, speed, acceleration, each, load)
        for place in places
        for way in (stroke / 2, -stroke / 2)
    )


def phases(duty: Sequence[Stroke], sheet: DataSheet) -> tuple[LoadPhase, ...]:
    r"""Nut loads of a duty: acceleration, constant speed and deceleration of every stroke.

    \|W + M a + F_f\|, \|W + F_f\|, \|W − M a + F_f\|: friction opposes the motion, the mass the
    acceleration. The weight W counts as positive on the way up.

    Parameters
    ----------
    duty : sequence of Stroke
        Strokes of a day.
    sheet : DataSheet
        Gives table, nut, inclination and the guides' friction F_f.

    Returns
    -------
    tuple of LoadPhase
        Phases whose lengths sum to the day's travel.
    """
    found: list[LoadPhase] = []
    for stroke in duty:
        ahead = 1 if stroke.stop > stroke.start else -1
        steady = float(guide_friction(sheet, stroke.load)) + ahead * float(weight_on_nut(sheet, stroke.load))
        inertia = (sheet.table.mass + stroke.load) * stroke.acceleration
        marks = [
            stroke.start,
            stroke.start + ahead * stroke.ramp,
            stroke.stop - ahead * stroke.ramp,
            stroke.stop,
        ]
        forces = (abs(steady + inertia), abs(steady), abs(steady - inertia))
        for (here, there), force in zip(pairwise(marks), forces, strict=True):
            if abs(there - here) > 1e-12 * stroke.length:
                found.append(LoadPhase(min(here, there), max(here, there), stroke.per_day, force))
    return tuple(found)


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """Travel of a duty over the axis.

    Parameters
    ----------
    edges : ndarray, shape (n + 1,)
        Edges of the cells of a grid over the axis position, m.
    travel : ndarray, shape (n,)
        Travel per day over the threads in each cell, m.
    nut_load : ndarray, shape (n,)
        Magnitude of the nut load, mean over that travel, N; 0 where there is none.
    travel_per_day : float
        Travel of the whole duty, m; more than the cells' sum where the nut reaches beyond the grid.
    mean_nut_load : float
        Mean over the whole travel, N.
    """

    edges: Array
    travel: Array
    nut_load: Array
    travel_per_day: float
    mean_nut_load: float

    @property
    def x(self) -> Array:
        """Centres of the cells, m, shape (n,)."""
        return np.asarray((self.edges[1:] + self.edges[:-1]) / 2)

    @property
    def density(self) -> Array:
        """Travel in each cell over that of a duty spread evenly, shape (n,)."""
        even = self.travel_per_day * np.diff(self.edges) / (self.edges[-1] - self.edges[0])
        return np.asarray(self.travel / even)


def exposure(
    duty: Sequence[Stroke], sheet: DataSheet, edges: ArrayLike, nut_length: float = 0.05
) -> Exposure:
    """Histogram of a day's travel over the axis.

    The nut wears all threads that it covers, and its play is the mean over all threads that it covers: travel
    is spread by its length twice.

    Parameters
    ----------
    duty : sequence of Stroke
        Strokes of a day.
    sheet : DataSheet
        Gives masses, friction and inclination.
    edges : array_like, shape (n + 1,)
        Edges of the cells, ascending, m.
    nut_length : float
        Loaded length of the nut, m; 0 gives the plain histogram.

    Returns
    -------
    Exposure
        Exact, not sampled.

    Raises
    ------
    InputError
        If the edges do not ascend, or the length is negative.
    """
    marks = finite("edge of the grid", edges, "m")
    if marks.ndim != 1 or len(marks) < 2 or not np.all(np.diff(marks) > 0):
        raise InputError("the edges of the grid must be a list of two positions or more in ascending order.")
    length = float(not_negative("length of the nut", nut_length, "m"))
    travel_per_day = sum(stroke.length * stroke.per_day for stroke in duty)
    travel = np.zeros(len(marks) - 1)
    weighted = np.zeros_like(travel)
    total = 0.0
    for phase in phases(duty, sheet):
        part = phase.per_day * np.diff(_reach(marks - phase.low, length) - _reach(marks - phase.high, length))
        travel += part
        weighted += part * phase.nut_load
        total += phase.per_day * (phase.high - phase.low) * phase.nut_load
    some = travel > 1e-12 * travel_per_day
    travel = np.where(some, travel, 0.0)
    load = np.divide(weighted, travel, out=np.zeros_like(travel), where=some)
    return Exposure(marks, travel, load, travel_per_day, total / travel_per_day)


def _reach(y: Array, length: float) -> Array:
    """Second antiderivative of the triangle that a box of the nut's length makes when spread by itself."""
    if length == 0:
        return np.maximum(y, 0.0)
    ahead, behind = np.maximum(y + length, 0.0) ** 3, np.maximum(y - length, 0.0) ** 3
    spread = (ahead - 2 * np.maximum(y, 0.0) ** 3 + behind) / (6 * length**2)
    return np.asarray(np.where(y < length, spread, y))  # beyond the spread exactly, without cancellation
