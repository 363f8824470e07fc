"""State of a chart, and the recursion over the runs of an epoch: statistics, limits, states with hysteresis.

:func:`chart_run` takes the state that the runs before have left, of bounded size, and gives the next one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballscrew.monitoring.detection.design import LevelStep
from ballscrew.monitoring.detection.growing_design import GrowingDesign, first_design
from ballscrew.monitoring.detection.limit_table import LimitTable
from ballscrew.monitoring.detection.limit_values import RunLimits, VisitLimits
from ballscrew.monitoring.detection.limits import limits_of_visit
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.statistics import (
    BEGIN,
    StatisticsState,
    VisitStatistics,
    add_visit,
    no_statistics,
)
from ballscrew.monitoring.detection.visits import VisitRun, repeats_run

_STIFFEST = -0.5  # level of P/P₀ = 8: less is no measurement
State = Literal["learning", "normal", "watch", "alarm"]


def relative_loss_of(level: float, uncertainty: float, before: float) -> tuple[float, float, float]:
    """Charted quantity of a run, 1 − (P/P₀)^(1/3), its standard uncertainty, and its softness.

    Parameters
    ----------
    level, uncertainty : float
        Change of the nut's compliance, and the random part of its standard uncertainty.
    before : float
        Softness of the run before it, 1 plus its level; nan where there is none.

    Returns
    -------
    lost, uncertainty, softness : float
        An outlier is not the more certain for it: it counts as no further up than the run before it.
    """
    softness = 1 + max(level, _STIFFEST)
    bounded = softness
    if not math.isnan(before):
        bounded = min(softness, max(before, 1.0))
    return 1 - 1 / softness, uncertainty / bounded**2, softness


@dataclass(frozen=True, slots=True)
class ChartedRun:
    """Run in a chart.

    Parameters
    ----------
    visit : int
        Number of its visit in the epoch.
    repeat : bool
        True if it is the second run of its visit.
    state : str
        learning, normal, watch or alarm.
    ramp, odds : float
        The two statistics.
    limits : RunLimits
        Limits of both.
    spent, repeat_limit : float
        Probability of a false alarm of its visit, and odds above which a repeat is requested.
    lost : float
        1 − (P/P₀)^(1/3), outliers limited.
    scale : float
        Scatter from run to run over the stated uncertainty, as known at the run.
    stiffer : bool
        True where a ramp downwards exceeds the limit of one upwards: the axis became stiffer, not worn.
    far_off : bool
        True if it is no repeat, and too far up to count in full.
    """

    visit: int
    repeat: bool
    state: State
    ramp: float
    odds: float
    limits: RunLimits
    spent: float
    repeat_limit: float
    lost: float
    scale: float
    stiffer: bool
    far_off: bool

    @property
    def repeat_asked(self) -> bool:
        """True if the run should be repeated on the same day.

        Its odds exceed the limit of repeats, or it is too far off to count in full; there is no alarm, and it
        is no repeat itself.
        """
        if self.repeat or self.state == "alarm" or not math.isfinite(self.repeat_limit):
            return False
        return self.odds > self.repeat_limit or self.far_off


@dataclass(frozen=True, slots=True)
class BaselineVisits:
    """Visits of the baseline: the first ones; where an alarm began among them, only those before it.

    Those contain no wear. A watch that leads to no alarm does not shorten the baseline: a healthy axis has
    one now and then.

    Parameters
    ----------
    most : int
        Largest number of visits.
    count : int
        Visits so far, until these are as many.
    worn : int or None
        Visits before the alarm; None where there is none.
    onset : int or None
        Visit at which the ramp of a watch began that has not ended yet.
    """

    most: int
    count: int = 0
    worn: int | None = None
    onset: int | None = None

    @property
    def visits(self) -> NDArray[np.int_]:
        """Numbers of the visits."""
        return np.arange(self.count if self.worn is None else self.worn)

    def after(self, number: int, state: State, onset: int) -> BaselineVisits:
        """Baseline after the next visit, given its state and the visit at which its ramp seems to begin."""
        among, pending, worn = BEGIN <= number < self.most, self.onset, self.worn
        if among and pending is None and state in ("watch", "alarm"):
            pending = onset
        if state == "alarm" and pending is not None and worn is None:
            worn = min(pending + 1, BEGIN)
        if state in ("alarm", "normal"):
            pending = None
        return BaselineVisits(self.most, min(number + 1, self.most), worn, pending)


@dataclass(frozen=True, slots=True, eq=False)
class VisitedState:
    """State after a visit.

    Parameters
    ----------
    grown : GrowingDesign
        Design of the r visits that later ones refer to.
    statistics : StatisticsState
        Both statistics.
    lost : tuple of float
        Level of the first run of each of these visits, as measured.
    table : LimitTable or None
        Limits of later visits; None while they are simulated.
    state : str
        State of the axis.
    calm : int
        Visits in a row below the limits of watch.
    baseline : BaselineVisits
        Visits of the baseline.
    scale : float
        Scatter over the stated uncertainty.
    """

    grown: GrowingDesign
    statistics: StatisticsState
    lost: tuple[float, ...]
    table: LimitTable | None
    state: State
    calm: int
    baseline: BaselineVisits
    scale: float


@dataclass(frozen=True, slots=True, eq=False)
class ChartState:
    """State of a chart after some runs of an epoch.

    Parameters
    ----------
    settings : MonitorSettings
        Rate of false alarms, and priors.
    drift : float
        Standard deviation of the level by the drift of a healthy support bearing.
    before, now : VisitedState or None
        Before the newest visit, and after it; None before the first.
    first : VisitRun or None
        First run of the newest visit.
    repeated : bool
        True if that visit has a second run.
    softness : float
        1 plus the level of the newest run; nan before the first.
    members : tuple of tuple of int
        Numbers of the runs of each of the first visits.
    runs : int
        Runs so far.
    """

    settings: MonitorSettings = field(default_factory=MonitorSettings)
    drift: float = 0.0
    before: VisitedState | None = None
    now: VisitedState | None = None
    first: VisitRun | None = None
    repeated: bool = False
    softness: float = math.nan
    members: tuple[tuple[int, ...], ...] = ()
    runs: int = 0

    @property
    def baseline(self) -> NDArray[np.int_]:
        """Numbers of the runs of the baseline."""
        if self.now is None:
            return np.zeros(0, dtype=int)
        runs = [run for visit in self.now.baseline.visits for run in self.members[visit]]
        return np.array(runs, dtype=int)


def chart_run(
    state: ChartState,
    day: float,
    level: float,
    uncertainty: float,
    temperature: float,
    steps: Sequence[LevelStep] = (),
) -> tuple[ChartState, ChartedRun]:
    """Chart the next good run of an epoch.

    Parameters
    ----------
    state : ChartState
        As the run before has left it.
    day, level, uncertainty, temperature : float
        Day, change of the nut's compliance, random part of its standard uncertainty, and temperature in °C
        (nan where not recorded).
    steps : sequence of LevelStep
        Events of the epoch that begin no new one; only those since the run before matter.

    Returns
    -------
    ChartState
        For the run after it.
    ChartedRun
        The run.
    """
    lost, lost_uncertainty, softness = relative_loss_of(level, uncertainty, state.softness)
    events = sum(step.day <= day for step in steps)
    run = VisitRun(day, lost, lost_uncertainty, temperature, events)
    again = (
        state.settings.repeats_per_year > 0
        and state.first is not None
        and not state.repeated
        and repeats_run(run, state.first)
    )
    before, first, second = state.now, run, None
    if again and state.first is not None:
        before, first, second = state.before, state.first, run.lost
    now, found, limits = _visited(state, before, first, second, steps)
    counted = bool(found.repeated[0])
    known = limits.first
    if counted:
        known = limits.again
    number = now.grown.count - 1
    charted = ChartedRun(
        visit=number,
        repeat=again,
        state=now.state,
        ramp=float(found.ramp[0]),
        odds=float(found.odds[0]),
        limits=known,
        spent=limits.spent,
        repeat_limit=limits.repeat,
        lost=float(found.residual.level[0]),
        scale=now.scale,
        stiffer=float(found.falling[0]) > known.ramp,
        far_off=bool(found.far_off[0]) and not again,
    )
    after = replace(
        state,
        before=before,
        now=now,
        first=first,
        repeated=again,
        softness=softness,
        members=_members(state, repeat=again),
        runs=state.runs + 1,
    )
    return after, charted


def _members(state: ChartState, *, repeat: bool) -> tuple[tuple[int, ...], ...]:
    """Runs of each of the first visits, with one more run."""
    members, number = state.members, state.runs
    if repeat:
        if state.now is not None and state.now.grown.count == len(members):
            return (*members[:-1], (*members[-1], number))
        return members
    if len(members) < state.settings.baseline_runs:
        return (*members, (number,))
    return members


def _visited(
    state: ChartState,
    before: VisitedState | None,
    first: VisitRun,
    again: float | None,
    steps: Sequence[LevelStep],
) -> tuple[VisitedState, VisitStatistics, VisitLimits]:
    """State after a visit, given its first run and the level of its repeat."""
    settings = state.settings
    if before is None:
        grown = first_design(first.day, first.uncertainty, first.temperature, settings, state.drift)
        statistics, table = no_statistics(grown.design, 1), None
        earlier: tuple[float, ...] = ()
        phase: tuple[State, int] = ("learning", 0)
        baseline = BaselineVisits(settings.baseline_runs)
    else:
        grown = before.grown.extended(first.day, first.uncertainty, first.temperature, steps)
        statistics, table, earlier = before.statistics, before.table, before.lost
        phase, baseline = (before.state, before.calm), before.baseline
    k, number = len(grown.design.days) - 1, grown.count - 1
    limits, table = limits_of_visit(grown.design, k, number, table, grown.since_step)
    statistics, found = add_visit(
        grown.design,
        k,
        number,
        statistics,
        np.array([first.lost]),
        None if again is None else np.array([again]),
        lambda _: limits.repeat,
    )
    name, calm = _phase_after(phase, number, found, limits, settings, repeat=again is not None)
    rows = grown.retained()
    lost = (*earlier, first.lost)
    return (
        VisitedState(
            grown=grown.part(rows),
            statistics=statistics.part(rows),
            lost=tuple(lost[row] for row in rows),
            table=table,
            state=name,
            calm=calm,
            baseline=baseline.after(number, name, int(found.onset[0])),
            scale=float(found.residual.scale[0]),
        ),
        found,
        limits,
    )


def _phase_after(
    phase: tuple[State, int],
    number: int,
    found: VisitStatistics,
    limits: VisitLimits,
    settings: MonitorSettings,
    *,
    repeat: bool,
) -> tuple[State, int]:
    """State of the axis and calm visits in a row, after a visit; a repeat replaces its run."""
    if number < BEGIN:
        return "learning", 0
    once = _next_phase(
        phase, float(found.ramp_first[0]), float(found.odds_first[0]), limits.first, settings.calm_runs
    )
    if not repeat:
        return once
    if once[0] == "alarm":
        phase = once
    known = limits.first
    if found.repeated[0]:
        known = limits.again
    return _next_phase(phase, float(found.ramp[0]), float(found.odds[0]), known, settings.calm_runs)


def _next_phase(
    phase: tuple[State, int], ramp: float, odds: float, limits: RunLimits, calm_runs: int
) -> tuple[State, int]:
    state, calm = phase
    alarmed = ramp > limits.ramp or odds > limits.odds
    watched = ramp > limits.watch_ramp or odds > limits.watch_odds
    calm = 0 if watched else calm + 1
    return _next_state(state, alarmed, watched, calm, calm_runs), calm


def _next_state(state: State, alarmed: bool, watched: bool, calm: int, calm_runs: int) -> State:
    if alarmed:
        return "alarm"
    if state == "alarm":
        return "alarm" if calm < calm_runs else "normal"
    if watched:
        return "watch"
    if state == "learning" or calm >= min(calm_runs, 2):
        return "normal"
    return state
