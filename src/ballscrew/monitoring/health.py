"""Health state of an axis from its runs: epochs, assessment of each run, chart, stage and causes.

Runs are ordered by time, divided into epochs, and assessed relative to the reference of their epoch. Only
good runs are charted. The order in which runs and events are given does not matter. A later run changes no
earlier state once the first three good runs of an epoch have determined its reference; the preload ratio
relative to the baseline, however, uses all runs of the baseline.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from ballscrew.base.provenance import Made
from ballscrew.base.quantity import NORMAL_95, Quantity
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.estimation.nut import (
    bearing_over_nut,
    below,
    contradiction,
    describe_release,
    not_identifiable,
    nut_quantity,
)
from ballscrew.estimation.samples import share_uncertainty
from ballscrew.estimation.verdict import doubts_of_calibration, notes_of_calibration
from ballscrew.modal.run import Run
from ballscrew.monitoring.assessment import AssessedRun
from ballscrew.monitoring.detection.chart import Chart, chart_of
from ballscrew.monitoring.detection.design import LevelStep
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.visits import SAME_DAY
from ballscrew.monitoring.epochs import STEPS, Epoch, Event, moment
from ballscrew.monitoring.history import History, read_history
from ballscrew.monitoring.history_causes import evidence_of_nut, history_causes
from ballscrew.monitoring.stage import Stage, stage
from ballscrew.monitoring.state import HealthState, RunState

_DAY = 86400.0  # s
_CONFIRMED = 2  # runs that make an alarm where a single one may be an outlier
_LEAST_U = 0.2  # (P/P₀)^(−1/3): a preload of 125 times the baseline is no measurement


def health_state(
    runs: Sequence[Run],
    model: CalibratedAxis,
    *,
    events: Sequence[Event] = (),
    settings: MonitorSettings | None = None,
    accept: Sequence[str] = (),
) -> HealthState:
    """Health state of an axis from its runs.

    Parameters
    ----------
    runs : sequence of Run
        Runs of one axis by one method and plan, in any order, each with its time; a run given twice counts
        once.
    model : CalibratedAxis
        The axis.
    events : sequence of Event
        Events on the axis, see :func:`ballscrew.monitoring.epochs.read_events`.
    settings : MonitorSettings, optional
        Rate of false alarms, and priors.
    accept : sequence of str
        Names of reasons to doubt the calibration that are accepted.

    Returns
    -------
    HealthState
        It does not depend on the order of the runs.

    Raises
    ------
    InputError
        If there is no run, one has no time, they are not of one axis and method, two different runs have the
        same id, or an accepted reason is none of the model's.
    """
    settings = settings or MonitorSettings()
    model.check_accepted(accept)
    history = read_history(runs, model, events, settings)
    scale = share_uncertainty(model, settings.assumptions)
    states: dict[str, RunState] = {}
    epochs: list[Epoch] = []
    charts: list[Chart | None] = []
    for epoch in history.epochs:
        good = history.good_runs(epoch.number)
        chart, charted = None, {}
        if good:
            drift = settings.assumptions.bearing_daily_spread * model.bearing_share / model.model.share
            chart = _chart(good, epoch, history, settings, drift)
            charted = _run_states(good, chart, scale, model, settings)
        for assessed in history.in_epoch(epoch.number):
            states[assessed.run.id] = charted.get(assessed.run.id) or _uncharted(assessed)
        epochs.append(replace(epoch, alarm_at=_alarm_at(charted)))
        charts.append(chart)
    ordered = tuple(states[assessed.run.id] for assessed in history.runs)
    newest_good = history.good_runs(epochs[-1].number)[-1:]
    doubts = [f"the newest good run: {doubt}" for assessed in newest_good for doubt in assessed.doubts]
    health = HealthState(
        axis=model.axis or runs[0].axis,
        runs=ordered,
        epochs=tuple(epochs),
        state="learning",
        alarm_at=epochs[-1].alarm_at,
        stage=None,
        causes=(),
        scale_uncertainty=scale,
        made=_made(ordered, settings, accept),
        reasons=(*doubts, *doubts_of_calibration(model, accept)),
        notes=(*_notes(epochs[-1], history, charts[-1]), *notes_of_calibration(model, accept)),
        charts=tuple(charts),
    )
    return _with_newest_epoch(health, history, states, model, settings)


def _with_newest_epoch(
    health: HealthState,
    history: History,
    states: Mapping[str, RunState],
    model: CalibratedAxis,
    settings: MonitorSettings,
) -> HealthState:
    """State, stage and causes by the newest epoch; unchanged before its first good run."""
    good, reference = history.good_runs(health.epochs[-1].number), history.references[-1]
    chart, ordered = health.charts[-1], health.runs
    if chart is None or reference is None:
        return health
    newest = states[good[-1].run.id]
    health = replace(health, nut_reasons=_nut_reasons(newest, good, chart, model, settings))
    if newest.state in ("watch", "alarm"):
        causes = history_causes(good, reference.run, chart, model, settings)
        health = replace(health, stage=_stage(newest, good, chart, ordered), causes=causes)
    # A repeat is requested only on the day of the newest good run; the runs after it are not good.
    same_day = ordered[-1].reading.day - newest.reading.day < SAME_DAY
    health = replace(health, state=newest.state, repeat_asked=same_day and chart.repeat_asked)
    unloaded = [run for run in health.epoch_runs if run.state == "unloaded" and _later(run, newest)]
    return _with_unloaded(health, unloaded, good, chart, settings) if unloaded else health


def _later(run: RunState, other: RunState) -> bool:
    return run.reading.day > other.reading.day


def _with_unloaded(
    health: HealthState,
    unloaded: Sequence[RunState],
    good: Sequence[AssessedRun],
    chart: Chart,
    settings: MonitorSettings,
) -> HealthState:
    """State by runs after the newest good one whose own load unloads the nut.

    Two of them are an alarm, as one is that follows an alarm; a single one is a watch, to be repeated.
    """
    newest = unloaded[-1]
    if health.state != "alarm" and len(unloaded) < _CONFIRMED:
        last = health.runs[-1] is newest
        health = replace(health, state="watch", repeat_asked=last and settings.repeats_per_year > 0)
    elif health.state != "alarm":
        begun = unloaded[_CONFIRMED - 1].reading.measured_at
        epochs = (*health.epochs[:-1], replace(health.epochs[-1], alarm_at=begun))
        health = replace(health, state="alarm", alarm_at=begun, epochs=epochs, repeat_asked=False)
    reason = describe_release(newest.preload_below or 1.0)
    return replace(
        health,
        stage=_stage(newest, good, chart, health.runs),
        nut_reasons=(reason,),
    )


def _uncharted(assessed: AssessedRun) -> RunState:
    """State of a run that is not charted: by the load that unloads its nut, or set aside."""
    if assessed.limit is None:
        return RunState(assessed.reading, "suspect")
    return RunState(assessed.reading, "unloaded", relative=below(assessed.limit))


def _made(runs: Sequence[RunState], settings: MonitorSettings, accept: Sequence[str]) -> Made:
    inputs = {}
    for number, run in enumerate(runs, 1):
        inputs[f"run {number}"] = run.reading.run
    return Made(settings=asdict(settings) | {"accept": sorted(set(accept))}, inputs=inputs)


def _nut_reasons(
    state: RunState,
    good: Sequence[AssessedRun],
    chart: Chart,
    model: CalibratedAxis,
    settings: MonitorSettings,
) -> tuple[str, ...]:
    """Reasons to doubt the nut's preload of the newest good run, in its state."""
    newest = good[-1]
    if newest.change is None or newest.fused is None:
        return ()
    evidence = evidence_of_nut(newest, good, chart, model, settings)
    ratio = bearing_over_nut(newest.change, newest.fused)
    if state.stiffness is not None and (reason := contradiction(state.stiffness, ratio, evidence)):
        return (reason,)
    if evidence.separates or state.state not in ("watch", "alarm"):
        return ()
    return (not_identifiable(ratio),)


def _stage(
    newest: RunState, good: Sequence[AssessedRun], chart: Chart, runs: Sequence[RunState]
) -> Stage | None:
    """Stage at a run in watch or alarm, or one whose own load unloads the nut."""
    if chart.newest_stiffer and newest.stiffness is not None:
        return None
    readings = [assessed.reading for assessed in good]
    baseline = [readings[i] for i in chart.baseline]
    later = [run.reading for run in runs if run.reading.day > readings[-1].day]
    if newest.stiffness is None:
        return stage(newest.relative, (), baseline, later or readings[-1:])
    return stage(newest.stiffness, readings, baseline, later)


def _alarm_at(states: Mapping[str, RunState]) -> str | None:
    """Time at which the newest alarm began."""
    begun = None
    before = ""
    for run in states.values():
        if run.state == "alarm" and before != "alarm":
            begun = run.reading.measured_at
        before = run.state
    return begun


def _notes(newest: Epoch, history: History, chart: Chart | None) -> tuple[str, ...]:
    last = moment(history.runs[-1].run.measured_at, "a run: measured_at")
    later = [event for event in newest.events if event.kind != "note" and event.when > last]
    notes = [
        f"{event.kind} at {event.at} is later than the newest run: it takes effect with the next run."
        for event in later
    ]
    if chart is not None and chart.newest_stiffer:
        notes.append(
            "The newest runs are stiffer than the baseline, which wear does not cause: was something done to "
            "the axis? Record it in EVENTS.toml."
        )
    newest_run = history.runs[-1]
    if newest_run.reading.verdict == "good":
        remarks = newest_run.reading.reasons[len(newest_run.doubts) :]
        notes += [f"The newest run: {remark}." for remark in remarks]
    return tuple(notes)


def _chart(
    good: Sequence[AssessedRun], epoch: Epoch, history: History, settings: MonitorSettings, drift: float
) -> Chart:
    sizes = {"greased": settings.greased, "sensor remounted": settings.remounted}
    steps = []
    for event in epoch.events:
        if event.kind in STEPS:
            day = (event.when - history.begin).total_seconds() / _DAY
            steps.append(LevelStep(day, sizes[event.kind]))
    readings = [assessed.reading for assessed in good]
    table = np.array([(r.day, r.level, r.random, r.temperature) for r in readings])
    days, level, uncertainty, temperature = table.T
    return chart_of(days, level, uncertainty, temperature, steps, settings, drift)


def _run_states(
    good: Sequence[AssessedRun],
    chart: Chart,
    scale: float,
    model: CalibratedAxis,
    settings: MonitorSettings,
) -> dict[str, RunState]:
    """State of each charted run by its id, in time order."""
    states = {}
    for k, assessed in enumerate(good):
        reading = assessed.reading
        stiffness, random = _relative_stiffness(chart, k, reading.level, scale, reading.systematic)
        nut = None
        if stiffness is not None and assessed.change is not None and assessed.fused is not None:
            evidence = evidence_of_nut(assessed, good, chart, model, settings)
            nut = nut_quantity(stiffness, bearing_over_nut(assessed.change, assessed.fused), evidence)
        if assessed.limit is not None:
            nut = below(assessed.limit, nut)
        states[assessed.run.id] = RunState(
            reading=reading,
            state=chart.states[k],
            stiffness=stiffness,
            relative=nut,
            ramp=float(chart.ramp[k]),
            ramp_limit=float(chart.limits.ramp[k]),
            odds=float(chart.odds[k]),
            odds_limit=float(chart.limits.odds[k]),
            relative_random=random,
        )
    return states


def _relative_stiffness(
    chart: Chart, k: int, level: float, scale: float, systematic: float
) -> tuple[Quantity | None, float]:
    """Stiffness of a run as P/P₀ by its epoch's baseline, without the effects of temperature and steps.

    Parameters
    ----------
    chart : Chart
        Chart of the epoch.
    k : int
        Index of the run.
    level : float
        As measured.
    scale : float
        Relative standard deviation of the change, from the nut's share.
    systematic : float
        Systematic standard uncertainty of the level.

    Returns
    -------
    Quantity or None
        None if no preload of a nut gives such a level.
    float
        Random part of its standard uncertainty, by the run and the baseline.
    """
    design = chart.design
    x, u = design.columns[k], 1 + level
    if not u > _LEAST_U:
        return None, math.nan
    root = (1 / u + float(x[1:] @ chart.coefficients[1:])) / (1 - float(chart.coefficients[0]))
    if not root > 0:
        return None, math.nan
    noise = (float(chart.scale[-1]) * design.uncertainty[k]) ** 2 + design.unknown_temperature[k] ** 2
    random = math.sqrt(noise + float(x @ chart.covariance @ x))
    by_share = scale * root * abs(1 - root)
    spread = math.sqrt(random**2 + by_share**2 + (systematic / u**2) ** 2)
    low, high = max(root - NORMAL_95 * spread, 0.0), root + NORMAL_95 * spread
    slope = 3 * root**2
    return Quantity(root**3, slope * spread, "", (low**3, high**3)), slope * random
