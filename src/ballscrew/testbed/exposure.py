"""Where along the axis a duty travels, and with what load on the nut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.given import finite, not_negative
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.testbed.duty import Duty, phases


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """A duty's travel over the axis.

    Parameters
    ----------
    edges : ndarray, shape (n + 1,)
        Of the cells of a grid over the axis position, m.
    travel : ndarray, shape (n,)
        A day's in each cell, m, as the threads see it that the nut covers there.
    nut_load : ndarray, shape (n,)
        Size, the mean over that travel, N; 0 where there is none.
    travel_per_day : float
        All of it, m; more than the cells' sum where the nut reaches beyond the grid.
    mean_nut_load : float
        Over all travel, N.
    """

    edges: Array
    travel: Array
    nut_load: Array
    travel_per_day: float
    mean_nut_load: float

    @property
    def x(self) -> Array:
        """Middles of the cells, m, shape (n,)."""
        return np.asarray((self.edges[1:] + self.edges[:-1]) / 2)

    @property
    def density(self) -> Array:
        """Travel in each cell over what it were if the day's travel were spread evenly, shape (n,)."""
        even = self.travel_per_day * np.diff(self.edges) / (self.edges[-1] - self.edges[0])
        return np.asarray(self.travel / even)


def exposure(duty: Duty, sheet: DataSheet, edges: ArrayLike, nut_length: float = 0.05) -> Exposure:
    """Histogram of a day's travel over the axis.

    The nut wears all threads that it covers, and feels the mean of all threads that it covers: travel is
    spread by its length twice.

    Parameters
    ----------
    duty : Duty
        The day's work.
    sheet : DataSheet
        Gives masses and friction.
    edges : array_like, shape (n + 1,)
        Of the cells, ascending, m.
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
    marks = _ascending(edges)
    length = float(not_negative("length of the nut", nut_length, "m"))
    travel = np.zeros(len(marks) - 1)
    weighted = np.zeros_like(travel)
    total = 0.0
    for phase in phases(duty, sheet):
        part = phase.per_day * np.diff(_reach(marks - phase.low, length) - _reach(marks - phase.high, length))
        travel += part
        weighted += part * phase.nut_load
        total += phase.per_day * (phase.high - phase.low) * phase.nut_load
    some = travel > 1e-12 * duty.travel_per_day
    travel = np.where(some, travel, 0.0)
    load = np.divide(weighted, travel, out=np.zeros_like(travel), where=some)
    return Exposure(marks, travel, load, duty.travel_per_day, total / duty.travel_per_day)


def uniform_exposure(edges: ArrayLike, travel_per_day: float, nut_load: float = 0.0) -> Exposure:
    """The same travel everywhere, with the same nut load.

    Parameters
    ----------
    edges : array_like, shape (n + 1,)
        Of the cells, ascending, m.
    travel_per_day : float
        m; more than 0.
    nut_load : float
        N.

    Returns
    -------
    Exposure
        Of density 1.

    Raises
    ------
    InputError
        If the edges do not ascend, or a number cannot be.
    """
    marks = _ascending(edges)
    if not float(finite("travel per day", travel_per_day, "m")) > 0:
        raise InputError(f"a travel per day of {travel_per_day:g} was given; it must be more than 0 m.")
    load = float(not_negative("nut load", nut_load, "N"))
    width = np.diff(marks)
    travel = travel_per_day * width / (marks[-1] - marks[0])
    return Exposure(marks, travel, np.full_like(travel, load), float(travel_per_day), load)


def _ascending(edges: ArrayLike) -> Array:
    marks = finite("edge of the grid", edges, "m")
    if marks.ndim != 1 or len(marks) < 2 or not np.all(np.diff(marks) > 0):
        raise InputError("the edges of the grid must be a list of two positions or more in ascending order.")
    return marks


def _reach(y: Array, length: float) -> Array:
    """Second antiderivative of the triangle in which a box of the nut's length is spread by itself."""
    if length == 0:
        return np.maximum(y, 0.0)
    ahead, behind = np.maximum(y + length, 0.0) ** 3, np.maximum(y - length, 0.0) ** 3
    spread = (ahead - 2 * np.maximum(y, 0.0) ** 3 + behind) / (6 * length**2)
    return np.asarray(np.where(y < length, spread, y))  # beyond the spread exactly, without cancellation
