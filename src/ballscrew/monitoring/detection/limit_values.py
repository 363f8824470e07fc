"""Values of control limits: of a run, of a visit, and of all visits of an epoch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.statistics import Statistics


@dataclass(frozen=True, slots=True)
class RunLimits:
    """Limits of a run; infinite before the first with a statistic.

    Parameters
    ----------
    ramp, odds : float
        Limits of an alarm.
    watch_ramp, watch_odds : float
        Limits of a watch.
    """

    ramp: float = math.inf
    odds: float = math.inf
    watch_ramp: float = math.inf
    watch_odds: float = math.inf


@dataclass(frozen=True, slots=True)
class VisitLimits:
    """Limits of a visit.

    Parameters
    ----------
    first, again : RunLimits
        Of its first run, and of a repeat.
    spent : float
        Probability of a false alarm.
    repeat : float
        Odds above which a repeat is requested.
    """

    first: RunLimits
    again: RunLimits
    spent: float
    repeat: float


@dataclass(frozen=True, slots=True, eq=False)
class ControlLimits:
    """Limits of n visits, or of n runs; infinite before the first with a statistic.

    Parameters
    ----------
    ramp, odds : ndarray, shape (n,)
        Limits of an alarm.
    watch_ramp, watch_odds : ndarray, shape (n,)
        Limits of a watch.
    spent : ndarray, shape (n,)
        Probability of a false alarm at each visit.
    repeat : ndarray, shape (n,)
        Odds above which a repeat is requested.
    again : ControlLimits or None
        Limits of the visits after their repeats; None for limits of runs.
    """

    ramp: Array
    odds: Array
    watch_ramp: Array
    watch_odds: Array
    spent: Array
    repeat: Array
    again: ControlLimits | None = None

    def alarms(self, values: Statistics) -> NDArray[np.bool_]:
        """Visits at which histories alarm, before or after a repeat; shape (n, m)."""
        after = self.again or self
        first = (values.ramp_first > self.ramp[:, None]) | (values.odds_first > self.odds[:, None])
        last = (values.ramp > after.ramp[:, None]) | (values.odds > after.odds[:, None])
        return np.asarray(first | (values.repeated & last))


def stacked_limits(limits: Sequence[RunLimits], spent: ArrayLike, repeat: ArrayLike) -> ControlLimits:
    """Limits of runs, in arrays.

    Parameters
    ----------
    limits : sequence of RunLimits
        n runs or visits.
    spent, repeat : array_like, shape (n,)
        As in :class:`VisitLimits`.

    Returns
    -------
    ControlLimits
        Without limits of repeats.
    """
    table = np.array([astuple(each) for each in limits]).reshape(-1, 4)
    ramp, odds, watch_ramp, watch_odds = table.T
    return ControlLimits(ramp, odds, watch_ramp, watch_odds, np.asarray(spent), np.asarray(repeat))
