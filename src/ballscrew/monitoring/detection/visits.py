"""Visits of one run or two: an outlying run is repeated on the same day, before anything is concluded.

A chart with a varying sampling interval (Reynolds, Amin, Arnold and Nachlas, 1988, DOI
10.1080/00401706.1988.10488366) samples again soon where the newest point is neither clearly in control nor
clearly out of control. Here that is a second run on the same day: wear is still there, an outlier is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import LevelStep

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


def group_visits(
    days: Array,
    uncertainty: Array,
    temperature: Array,
    steps: Sequence[LevelStep] = (),
    repeats: bool = True,
) -> Visits:
    """Group runs by visit.

    Parameters
    ----------
    days, uncertainty, temperature : ndarray, shape (n,)
        Day, standard uncertainty of the level and temperature in °C (nan where not recorded), in time order.
    steps : sequence of LevelStep
        After an event between two runs the second is no repeat; nor is a run that is much less certain.
    repeats : bool
        False if every run is a visit of its own.

    Returns
    -------
    Visits
        Visits of one run or two; a third run on the same day is a visit of its own. Later runs change no
        earlier visit.
    """
    known = np.isfinite(temperature)
    event_days = np.sort([step.day for step in steps])
    events = np.searchsorted(event_days, days, side="right")

    def repeats_run(k: int, j: int) -> bool:
        same_day = days[k] - days[j] < SAME_DAY
        same_state = known[k] == known[j] and events[k] == events[j]
        return bool(same_day and same_state and uncertainty[k] <= _LARGEST_RATIO * uncertainty[j])

    first: list[int] = []
    again: list[int] = []
    for k in range(len(days)):
        single = repeats and len(first) > 0 and again[-1] < 0
        if single and repeats_run(k, first[-1]):
            again[-1] = k
        else:
            first.append(k)
            again.append(-1)
    return Visits(np.array(first, dtype=int), np.array(again, dtype=int))
