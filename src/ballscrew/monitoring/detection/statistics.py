"""Statistics of visits: evidence of a ramp, and odds that wear began lately.

Both are recursions of bounded state, over the visits of m histories at once: the history of an axis is one,
and those simulated for the limits are many.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import Design
from ballscrew.monitoring.detection.odds import (
    OddsState,
    Threshold,
    add_odds,
    known_coefficients,
    no_odds,
    prepare_odds,
    repeat_odds,
)
from ballscrew.monitoring.detection.ramp import RampState, Slopes, add_ramp, no_ramp
from ballscrew.monitoring.detection.residuals import (
    ResidualState,
    VisitResidual,
    add_residual,
    no_residuals,
)

BEGIN = 3
"""Good runs before the first with a statistic."""


@dataclass(frozen=True, slots=True, eq=False)
class StatisticsState:
    """State of both statistics after some visits.

    Parameters
    ----------
    odds : OddsState
        Of the odds.
    single, robust : ResidualState
        Residuals without any repeat, by which a run is far off, and with the repeats that count.
    ramp : RampState
        Of the ramp.
    """

    odds: OddsState
    single: ResidualState
    robust: ResidualState
    ramp: RampState

    def part(self, rows: NDArray[np.int_]) -> StatisticsState:
        """State with some of the visits of the design."""
        return replace(self, single=self.single.part(rows), robust=self.robust.part(rows))


@dataclass(frozen=True, slots=True, eq=False)
class VisitStatistics:
    """Statistics of a visit in m histories, each array of shape (m,).

    Parameters
    ----------
    ramp_first, odds_first : ndarray
        After the first run.
    ramp, odds : ndarray
        After the repeat; the same where there was none.
    repeated : ndarray of bool
        Where there is a repeat that counts.
    far_off : ndarray of bool
        Where the first run is too far up to count in full, before any repeat.
    falling : ndarray
        Statistic of a ramp downwards.
    onset : ndarray of int
        Visit at which the ramp seems to begin.
    residual : VisitResidual
        Levels with outliers limited, and scatter.
    """

    ramp_first: Array
    odds_first: Array
    ramp: Array
    odds: Array
    repeated: NDArray[np.bool_]
    far_off: NDArray[np.bool_]
    falling: Array
    onset: NDArray[np.int_]
    residual: VisitResidual


def no_statistics(design: Design, draws: int) -> StatisticsState:
    """State before the first visit.

    Parameters
    ----------
    design : Design
        With the first visit.
    draws : int
        Number of histories.

    Returns
    -------
    StatisticsState
        By the priors.
    """
    residuals = no_residuals(design, draws)
    return StatisticsState(no_odds(design, draws), residuals, residuals, no_ramp(design, draws))


def add_visit(
    design: Design,
    k: int,
    number: int,
    state: StatisticsState,
    levels: Array,
    again: Array | None = None,
    threshold: Threshold | None = None,
) -> tuple[StatisticsState, VisitStatistics]:
    """Add a visit to both statistics.

    Parameters
    ----------
    design : Design
        With the visit.
    k : int
        Its row.
    number : int
        Its number in the epoch.
    state : StatisticsState
        Before the visit.
    levels : ndarray, shape (m,)
        Level of its first run.
    again : ndarray, shape (m,), optional
        Levels of repeats; nan where there is none.
    threshold : callable, optional
        From the odds after the first run: odds above which a repeat counts. It also counts where the first
        run is far off. By default every repeat counts.

    Returns
    -------
    StatisticsState
        After the visit.
    VisitStatistics
        Of the visit.
    """
    begun = number >= BEGIN
    prepared = prepare_odds(design, k, state.odds, begun=begun)
    known = known_coefficients(prepared)
    single, alone = add_residual(design, k, known, state.single, levels)
    far = np.asarray(alone.first < levels)
    odds_state, odds_first = add_odds(design, k, prepared, levels, begun=begun)
    odds_after, repeated = odds_first, np.zeros(len(levels), dtype=bool)
    if not begun:
        again = None
    if again is not None:
        repeated = np.isfinite(again)
        if threshold is not None:
            repeated &= (odds_first > threshold(odds_first)) | far
        odds_state, odds_after = repeat_odds(
            design, k, prepared, odds_state, odds_first, levels, np.where(repeated, again, np.nan)
        )
        again = np.where(repeated, again, np.nan)
    robust, residual = add_residual(design, k, known, state.robust, levels, again)
    ramp, slopes = add_ramp(design, k, state.ramp, residual.level, residual.scale, residual.first)
    if not begun:
        none = np.zeros_like(levels)
        slopes = Slopes(none, none, none.astype(int), none)
    return StatisticsState(odds_state, single, robust, ramp), VisitStatistics(
        ramp_first=slopes.first,
        odds_first=odds_first,
        ramp=slopes.largest,
        odds=odds_after,
        repeated=repeated,
        far_off=far,
        falling=-slopes.smallest,
        onset=slopes.onset,
        residual=residual,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Statistics:
    """Statistics of n visits in m histories.

    Parameters
    ----------
    ramp_first, odds_first : ndarray, shape (n, m)
        After the first run of each visit.
    ramp, odds : ndarray, shape (n, m)
        After its repeat; the same where there was none.
    repeated : ndarray of bool, shape (n, m)
        Visits with a repeat.
    """

    ramp_first: Array
    odds_first: Array
    ramp: Array
    odds: Array
    repeated: NDArray[np.bool_]


def statistics(
    design: Design,
    levels: Array,
    again: Array | None = None,
    threshold: Callable[[int, Array], float] | None = None,
) -> Statistics:
    """Both statistics of histories.

    Parameters
    ----------
    design : Design
        The epoch, a row per visit.
    levels : ndarray, shape (n, m)
        Its levels in m histories.
    again : ndarray, shape (n, m), optional
        Levels of repeats; nan where there is none.
    threshold : callable, optional
        From a visit's number and the odds after its first run: odds above which a repeat counts. It also
        counts where the first run is far off. By default every repeat counts.

    Returns
    -------
    Statistics
        Later runs do not change them.
    """
    count, draws = levels.shape
    state = no_statistics(design, draws)
    numbers, repeated = np.zeros((4, count, draws)), np.zeros((count, draws), dtype=bool)
    for k in range(count):
        limit, second = None, None
        if threshold is not None:
            limit = _Limit(threshold, k)
        if again is not None:
            second = again[k]
        state, found = add_visit(design, k, k, state, levels[k], second, limit)
        numbers[:, k] = found.ramp_first, found.odds_first, found.ramp, found.odds
        repeated[k] = found.repeated
    ramp_first, odds_first, ramp, odds = numbers
    return Statistics(ramp_first, odds_first, ramp, odds, repeated)


@dataclass(frozen=True, slots=True)
class _Limit:
    """Limit of repeats of one visit."""

    threshold: Callable[[int, Array], float]
    number: int

    def __call__(self, odds: Array) -> float:
        return self.threshold(self.number, odds)
