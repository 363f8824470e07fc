"""Simulation of healthy histories with the visits of an epoch, and the limits of each by their tails."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import Design
from ballscrew.monitoring.detection.healthy_axes import HealthyAxes
from ballscrew.monitoring.detection.limit_table import pareto_quantile
from ballscrew.monitoring.detection.limit_values import RunLimits, VisitLimits
from ballscrew.monitoring.detection.statistics import (
    BEGIN,
    StatisticsState,
    VisitStatistics,
    add_visit,
    no_statistics,
)

Floats = NDArray[np.floating[Any]]
FIRST_SHARE = 0.5
"""Least share of the first run in a visit's false alarms, and largest part of the repeats that alarm."""

MOST_WATCHES = 0.5
"""Largest probability of a watch at a visit."""

TAIL, REPEAT_TAIL = 0.02, 0.1
"""Tail that is fitted: part of the histories, and of those with a repeat."""

_YEAR = 365.25
_LONGEST_GAP = 14.0  # d: a longer pause spends no more false alarms
_POOLED_RUNS = 15  # runs whose tails are pooled, at most
_EMPIRICAL = 2.0  # histories above a limit from which on it is an empirical quantile
_SAFETY = 0.6  # of the rate: limits from finitely many histories err towards too many alarms
_LEAST_ALIVE = 0.1  # of the histories; where fewer have no alarm all count again


def spent_at_visit(design: Design, k: int, number: int, safety: float) -> tuple[float, float]:
    """Probabilities that a visit may spend.

    Parameters
    ----------
    design : Design
        With the visit.
    k : int
        Its row.
    number : int
        Its number in the epoch, from :data:`~.statistics.BEGIN` on.
    safety : float
        Part of the stated rate of false alarms.

    Returns
    -------
    false_alarm, repeat : float
        Of a false alarm, and of a requested repeat.
    """
    settings = design.settings
    gap = design.days[k] - design.days[k - 1]
    if number == BEGIN:
        gap = design.days[BEGIN] - design.days[0]
    years = min(float(gap), _LONGEST_GAP) / _YEAR
    spent = -math.expm1(-safety * settings.false_alarms_per_year * years)
    return spent, -math.expm1(-settings.repeats_per_year * years)


def share_of_first(spent: float, repeats: float) -> float:
    """Part of a visit's false alarms that its first run spends; its repeat spends the rest.

    Parameters
    ----------
    spent, repeats : float
        As :func:`spent_at_visit` returns them.

    Returns
    -------
    float
        One half at least.
    """
    if repeats <= 0:
        return 1.0
    return max(FIRST_SHARE, 1 - FIRST_SHARE * repeats / spent)


class HealthySimulation:
    """Healthy histories up to a visit.

    Parameters
    ----------
    design : Design
        With the first visit.
    """

    def __init__(self, design: Design) -> None:
        settings = design.settings
        self.count = 0
        self.axes = HealthyAxes(design, settings.draws, (settings.seed, 0xA1A3, 0))
        self.state: StatisticsState = no_statistics(design, settings.draws)
        self.alive = np.ones(settings.draws, dtype=bool)
        self.first_tails = _Tail(TAIL), _Tail(TAIL)
        self.again_tails = _Tail(REPEAT_TAIL), _Tail(REPEAT_TAIL)

    def add(self, design: Design) -> tuple[VisitLimits, VisitStatistics]:
        """Simulate the next visit, and set its limits.

        Parameters
        ----------
        design : Design
            With the visit, its last row but for those of later visits.

        Returns
        -------
        VisitLimits
            Of the visit.
        VisitStatistics
            Of all histories.
        """
        k = self.count
        spent, repeats = spent_at_visit(design, k, k, _SAFETY) if k >= BEGIN else (0.0, 0.0)
        threshold = math.inf

        def exceeded(odds: Array) -> float:
            nonlocal threshold
            if repeats > 0:
                threshold = float(np.quantile(odds, 1 - repeats))
            return threshold

        levels, second = self.axes.visit(design, k)
        again = second if design.settings.repeats_per_year > 0 else None
        self.state, found = add_visit(design, k, k, self.state, levels, again, exceeded)
        self.count += 1
        if k < BEGIN:
            return VisitLimits(RunLimits(), RunLimits(), spent, math.inf), found
        share, watch = share_of_first(spent, repeats), design.settings.watch
        alive = self.alive if self.alive.mean() >= _LEAST_ALIVE else np.ones_like(self.alive)
        before, after = np.stack([found.ramp_first, found.odds_first]), np.stack([found.ramp, found.odds])
        first, second_run = _limits_of(self.first_tails, before[:, alive], share * spent, watch), RunLimits()
        alarmed = (before[0] > first.ramp) | (before[1] > first.odds)
        part_repeated = float(found.repeated[alive].mean())
        if part_repeated > 0:
            of_repeat = min((1 - share) * spent / part_repeated, FIRST_SHARE)
            second_run = _limits_of(self.again_tails, after[:, found.repeated & alive], of_repeat, watch)
            alarmed_again = (after[0] > second_run.ramp) | (after[1] > second_run.odds)
            alarmed |= found.repeated & alarmed_again
        self.alive = alive & ~alarmed
        return VisitLimits(first, second_run, spent, threshold), found


def _limits_of(tails: tuple[_Tail, _Tail], values: Floats, spent: float, watch: float) -> RunLimits:
    """Limits of a simulated visit; both statistics share the probability of a false alarm evenly."""
    ramp, odds = tails
    ramp.add(values[0])
    odds.add(values[1])
    either = float(np.mean((values[0] > ramp.top) | (values[1] > odds.top))) / ramp.part
    each = spent / min(max(either, 1.0), 2.0)
    alarm = ramp.limit(each), odds.limit(each)
    watched = min(each * watch, MOST_WATCHES)
    return RunLimits(*alarm, min(ramp.limit(watched), alarm[0]), min(odds.limit(watched), alarm[1]))


@dataclass(slots=True, eq=False)
class _Tail:
    """Upper tail of a statistic among the histories without an alarm, pooled over the newest runs.

    Above its top quantile the tail is a generalised Pareto distribution.
    """

    part: float
    values: Floats = field(default_factory=lambda: np.zeros(0))
    top: float = 0.0
    runs: int = 0
    pooled: list[Floats] = field(default_factory=list)

    def add(self, values: Floats) -> None:
        """Add the values of the next run."""
        self.values = values
        self.top = float(np.quantile(values, 1 - self.part))
        excess = (values[values > self.top] - self.top) / (1 + self.top)
        self.runs += 1
        newest = min(1 + self.runs // 2, _POOLED_RUNS)
        self.pooled = [*self.pooled, excess][-newest:]

    def limit(self, probability: float) -> float:
        """Value that is exceeded with a probability."""
        if probability <= 0:
            return math.inf
        if probability >= self.part:
            return float(np.quantile(self.values, 1 - probability))
        excess = np.sort(np.concatenate(self.pooled))
        if len(excess) < 2:
            return self.top
        rank = len(excess) * probability / self.part
        if rank >= _EMPIRICAL:
            # Exceeded by the rank plus one.
            quantile = float(np.interp(len(excess) - rank, np.arange(len(excess)), excess))
        else:
            quantile = pareto_quantile(excess, math.log(self.part / probability))
        return self.top + (1 + self.top) * quantile
