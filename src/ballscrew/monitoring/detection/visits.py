"""Visits of one run or two: an outlying run is repeated on the same day, before anything is concluded.

A chart with a varying sampling interval (Reynolds, Amin, Arnold and Nachlas, 1988, DOI
10.1080/00401706.1988.10488366) samples again soon where the newest point is neither clearly in control nor
clearly out of control. Here that is a second run on the same day: wear is still there, an outlier is not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_LARGEST_RATIO = 2.0  # of the uncertainty of a repeat over that of the first run

SAME_DAY = 0.5
"""Days from a run to its repeat are less than this."""


@dataclass(frozen=True, slots=True, eq=False)
class Visits:
    """Runs by visit, in time order.

    Parameters
    ----------
    first : ndarray of int, shape (v,)
        First run of each visit.
    again : ndarray of int, shape (v,)
        Its repeat; -1 where there is none.
    """

    first: NDArray[np.int_]
    again: NDArray[np.int_]

    @property
    def of_run(self) -> NDArray[np.int_]:
        """Visit of each run, shape (n,)."""
        return np.repeat(np.arange(len(self.first)), 1 + self.repeated)

    @property
    def repeated(self) -> NDArray[np.bool_]:
        """Visits with a repeat, shape (v,)."""
        return self.again >= 0

    def runs(self, which: NDArray[np.int_]) -> NDArray[np.int_]:
        """All runs of some visits, ascending."""
        return np.sort(np.concatenate([self.first[which], self.again[which][self.repeated[which]]]))


def visits_of(repeats: Sequence[bool]) -> Visits:
    """Group runs by visit.

    Parameters
    ----------
    repeats : sequence of bool
        Whether each run repeats the one before, in time order.

    Returns
    -------
    Visits
        Visits of one run or two.
    """
    first: list[int] = []
    again: list[int] = []
    for run, repeat in enumerate(repeats):
        if repeat:
            again[-1] = run
        else:
            first.append(run)
            again.append(-1)
    return Visits(np.array(first, dtype=int), np.array(again, dtype=int))


@dataclass(frozen=True, slots=True)
class VisitRun:
    """Run of a visit.

    Parameters
    ----------
    day, lost, uncertainty, temperature : float
        Day, 1 − (P/P₀)^(1/3), its standard uncertainty, and temperature in °C (nan where not recorded).
    events : int
        Number of events of the epoch before it.
    """

    day: float
    lost: float
    uncertainty: float
    temperature: float
    events: int


def repeats_run(run: VisitRun, first: VisitRun) -> bool:
    """Check whether a run repeats an earlier one.

    Parameters
    ----------
    run, first : VisitRun
        In time order.

    Returns
    -------
    bool
        True on the same day; not after an event between the two, nor if the run is much less certain.
    """
    same_day = run.day - first.day < SAME_DAY
    same_kind = math.isfinite(run.temperature) == math.isfinite(first.temperature)
    same_state = same_kind and run.events == first.events
    return same_day and same_state and run.uncertainty <= _LARGEST_RATIO * first.uncertainty
