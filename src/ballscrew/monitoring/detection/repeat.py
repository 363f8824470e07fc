"""Visits of one run or two: a run that stands out is repeated on the same day, before anything is concluded.

A chart with a varying sampling interval (Reynolds, Amin, Arnold and Nachlas, 1988, DOI
10.1080/00401706.1988.10488366) looks again soon where the newest point is neither clearly well nor clearly
not, and as usual elsewhere. Here that is a second run on the day: wear is still there, an odd run is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import Step

if TYPE_CHECKING:
    from ballscrew.monitoring.detection.chart import Chart

__all__ = ["SAME_DAY", "Visits", "repeat_asked", "visits"]

_ROUGHER = 2.0  # times the uncertainty of the first run

SAME_DAY = 0.5
"""Days from a run to its repeat, at most: less than this."""


@dataclass(frozen=True, slots=True, eq=False)
class Visits:
    """Runs by visit, in time order.

    Parameters
    ----------
    first : ndarray of int, shape (v,)
        The first run of each.
    again : ndarray of int, shape (v,)
        Its repeat; -1 where there is none.
    """

    first: NDArray[np.int_]
    again: NDArray[np.int_]

    @property
    def of_run(self) -> NDArray[np.int_]:
        """The visit of each run, shape (n,)."""
        return np.repeat(np.arange(len(self.first)), 1 + self.repeated)

    @property
    def repeated(self) -> NDArray[np.bool_]:
        """Which have one, shape (v,)."""
        return self.again >= 0

    def runs(self, which: NDArray[np.int_]) -> NDArray[np.int_]:
        """All runs of some visits, ascending."""
        return np.sort(np.concatenate([self.first[which], self.again[which][self.repeated[which]]]))


def visits(
    days: Array, told: Array, temperature: Array, steps: Sequence[Step] = (), pairs: bool = True
) -> Visits:
    """Tell which runs are repeats of the run before them.

    Parameters
    ----------
    days, told, temperature : ndarray, shape (n,)
        In time order; d, standard uncertainty of the level, °C (nan where not recorded).
    steps : sequence of Step
        What was done between two runs makes no repeat of the second; nor does a run that tells much less.
    pairs : bool
        Whether there are repeats at all.

    Returns
    -------
    Visits
        Of one run or two; a third on the same day is a visit of its own. Later runs change nothing.
    """
    known, when = np.isfinite(temperature), sorted(one.day for one in steps)
    done = np.searchsorted(when, days, side="right")
    first: list[int] = []
    again: list[int] = []
    for k in range(len(days)):
        j = first[-1] if first else k
        near = pairs and j < k and again[-1] < 0 and days[k] - days[j] < SAME_DAY
        if near and known[k] == known[j] and done[k] == done[j] and told[k] <= _ROUGHER * told[j]:
            again[-1] = k
        else:
            first.append(k)
            again.append(-1)
    return Visits(np.array(first, dtype=int), np.array(again, dtype=int))


def repeat_asked(drawn: Chart) -> bool:
    """Tell whether the newest run is to be repeated on the same day.

    Parameters
    ----------
    drawn : Chart
        Of the epoch.

    Returns
    -------
    bool
        The odds stand above what healthy axes exceed as often as the settings allow, or the newest run is
        off by so much that it does not count in full; there is no alarm, and it is no repeat itself.
    """
    if not len(drawn.states) or drawn.visits.repeated[-1] or drawn.states[-1] == "alarm":
        return False
    limit = drawn.limits.repeat[-1]
    return bool(np.isfinite(limit) and (drawn.odds[-1] > limit or drawn.far_off[-1]))
