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
    describe_contradiction,
    describe_release,
    describe_unidentifiable,
    nut_quantity,
    ratio_below,
)
from ballscrew.estimation.samples import share_uncertainty
from ballscrew.estimation.verdict import doubts_of_calibration, notes_of_calibration
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.chart import Chart, completed_chart
from ballscrew.monitoring.detection.design import LevelStep
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.visits import SAME_DAY
from ballscrew.monitoring.epochs import Epoch, Event, epochs_of, moment
from ballscrew.monitoring.history import (
    EpochState,
    HistoryRow,
    HistoryState,
    level_steps,
    newest_assessed,
    read_history,
)
from ballscrew.monitoring.history_causes import evidence_of_nut, history_causes
from ballscrew.monitoring.stage import Stage, stage
from ballscrew.monitoring.state import HealthState, RunState

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
    return health_of(read_history(runs, model, events, settings), model, events, settings, accept)


def health_of(
    history: HistoryState,
    model: CalibratedAxis,
    events: Sequence[Event],
    settings: MonitorSettings,
    accept: Sequence[str] = (),
) -> HealthState:
    """Health state of an axis from its judged runs.

    Parameters
    ----------
    history : HistoryState
        Assessed runs.
    model, events, settings, accept
        As for :func:`health_state`.

    Returns
    -------
    HealthState
        As of the newest run.
    """
    scale = share_uncertainty(model, settings.assumptions)
    divided = epochs_of(events, moment(history.newest, "a run: measured_at"))
    ordered: list[RunState] = []
    epochs: list[Epoch] = []
    charts: list[Chart | None] = []
    for epoch, known in zip(divided, history.epochs, strict=True):
        good = known.good
        chart, charted = None, {}
        if good:
            chart = _chart(known, level_steps(epoch, history.begin, settings))
            charted = _run_states(good, chart, scale, settings)
        ordered += [charted.get(row.reading.run) or _uncharted(row) for row in known.rows]
        if known.reference is not None:
            epoch = replace(epoch, reference=known.reference.id, reference_at=known.reference.measured_at)
        epochs.append(replace(epoch, alarm_at=_alarm_at(charted)))
        charts.append(chart)
    newest_good = history.epochs[-1].good[-1:]
    doubts = [f"the newest good run: {doubt}" for row in newest_good for doubt in row.doubts]
    health = HealthState(
        axis=model.axis or history.axis,
        runs=tuple(ordered),
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
    return _with_newest_epoch(health, history.epochs[-1], model, settings)


def _with_newest_epoch(
    health: HealthState, epoch: EpochState, model: CalibratedAxis, settings: MonitorSettings
) -> HealthState:
    """State, stage and causes by the newest epoch; unchanged before its first good run."""
    good, reference = epoch.good, epoch.reference
    chart, ordered = health.charts[-1], health.runs
    if chart is None or reference is None:
        return health
    newest = next(run for run in reversed(ordered) if run.reading.run == good[-1].reading.run)
    health = replace(health, nut_reasons=_nut_reasons(newest, good, chart, settings))
    if newest.state in ("watch", "alarm"):
        assessed = newest_assessed(epoch, health.epochs[-1].number, model, settings)
        causes = history_causes(good, assessed, reference, chart, model, settings)
        health = replace(health, stage=_stage(newest, good, chart, ordered), causes=causes)
    # A repeat is requested only on the day of the newest good run; the runs after it are not good.
    same_day = ordered[-1].reading.day - newest.reading.day < SAME_DAY
    health = replace(health, state=newest.state, repeat_asked=same_day and chart.repeat_asked)
    unloaded = _unloaded_after(newest, health.epoch_runs)
    if not unloaded:
        return health
    return _with_unloaded(health, unloaded, good, chart, settings)


def _unloaded_after(newest: RunState, runs: Sequence[RunState]) -> list[RunState]:
    """Runs after the newest good one whose own load unloads the nut."""
    return [run for run in runs if run.state == "unloaded" and run.reading.day > newest.reading.day]


def _with_unloaded(
    health: HealthState,
    unloaded: Sequence[RunState],
    good: Sequence[HistoryRow],
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


def _uncharted(row: HistoryRow) -> RunState:
    """State of a run that is not charted: by the load that unloads its nut, or set aside."""
    if row.limit is None:
        return RunState(row.reading, "suspect")
    return RunState(row.reading, "unloaded", relative=ratio_below(row.limit))


def _made(runs: Sequence[RunState], settings: MonitorSettings, accept: Sequence[str]) -> Made:
    inputs = {}
    for number, run in enumerate(runs, 1):
        inputs[f"run {number}"] = run.reading.run
    return Made(settings=asdict(settings) | {"accept": sorted(set(accept))}, inputs=inputs)


def _nut_reasons(
    state: RunState, good: Sequence[HistoryRow], chart: Chart, settings: MonitorSettings
) -> tuple[str, ...]:
    """Reasons to doubt the nut's preload of the newest good run, in its state."""
    ratio = good[-1].bearing_over_nut
    if math.isnan(ratio):
        return ()
    evidence = evidence_of_nut(good[-1], good, chart, settings)
    if state.stiffness is not None and (reason := describe_contradiction(state.stiffness, ratio, evidence)):
        return (reason,)
    if evidence.separates or state.state not in ("watch", "alarm"):
        return ()
    return (describe_unidentifiable(ratio),)


def _stage(
    newest: RunState, good: Sequence[HistoryRow], chart: Chart, runs: Sequence[RunState]
) -> Stage | None:
    """Stage at a run in watch or alarm, or one whose own load unloads the nut."""
    if chart.newest_stiffer and newest.stiffness is not None:
        return None
    readings = [row.reading for row in good]
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


def _notes(newest: Epoch, history: HistoryState, chart: Chart | None) -> tuple[str, ...]:
    last = moment(history.newest, "a run: measured_at")
    later = [event for event in newest.events if event.kind != "note" and event.when > last]
    notes = [
        f"{event.kind} at {event.at} is later than the newest run: it takes effect with the first run after "
        "it."
        for event in later
    ]
    if chart is not None and chart.newest_stiffer:
        notes.append(
            "The newest runs are stiffer than the baseline, which wear does not cause: was something done to "
            "the axis? Record it in EVENTS.toml."
        )
    newest_run = history.rows[-1]
    if newest_run.reading.verdict == "good":
        remarks = newest_run.reading.reasons[len(newest_run.doubts) :]
        notes += [f"The newest run: {remark}." for remark in remarks]
    return tuple(notes)


def _chart(epoch: EpochState, steps: Sequence[LevelStep]) -> Chart:
    """Chart of an epoch's good runs."""
    readings, charted = [], []
    for row in epoch.rows:
        if row.charted is not None:
            readings.append(row.reading)
            charted.append(row.charted)
    table = np.array([(r.day, r.level, r.random, r.temperature) for r in readings])
    days, level, uncertainty, temperature = table.T
    return completed_chart(epoch.chart, charted, days, level, uncertainty, temperature, steps)


def _run_states(
    good: Sequence[HistoryRow], chart: Chart, scale: float, settings: MonitorSettings
) -> dict[str, RunState]:
    """State of each charted run by its id, in time order."""
    states = {}
    for k, row in enumerate(good):
        reading = row.reading
        stiffness, random = _relative_stiffness(chart, k, reading.level, scale, reading.systematic)
        nut = None
        if stiffness is not None and not math.isnan(row.bearing_over_nut):
            evidence = evidence_of_nut(row, good, chart, settings)
            nut = nut_quantity(stiffness, row.bearing_over_nut, evidence)
        if row.limit is not None:
            nut = ratio_below(row.limit, nut)
        states[reading.run] = RunState(
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
