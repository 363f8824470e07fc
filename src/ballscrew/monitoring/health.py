"""Health state of an axis from its runs: epochs, assessment of each run, chart, stage and causes.

Runs are ordered by time, divided into epochs, and assessed relative to the reference of their epoch. Only
good runs are charted. The order in which runs and events are given does not matter. A later run changes no
earlier state once the first three good runs of an epoch have determined its reference; the preload ratio
relative to the baseline, however, uses all runs of the baseline.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime

import numpy as np

from ballscrew.base.errors import InputError, shown
from ballscrew.base.provenance import Made
from ballscrew.base.quantity import NORMAL_95, Quantity
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.frequency_table import frequency_table
from ballscrew.calibration.method import common_method
from ballscrew.estimation.nut import bearing_over_nut, contradiction, not_identifiable, nut_quantity
from ballscrew.estimation.samples import share_uncertainty
from ballscrew.estimation.verdict import doubts_of_calibration, notes_of_calibration
from ballscrew.modal.run import Run
from ballscrew.monitoring.assessment import AssessedRun, MeasuredRun, agree, assess_run, unassessed_reading
from ballscrew.monitoring.detection.chart import Chart, chart_of
from ballscrew.monitoring.detection.design import LevelStep
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.visits import SAME_DAY
from ballscrew.monitoring.epochs import STEPS, Epoch, Event, epochs_of, moment
from ballscrew.monitoring.history_causes import evidence_of_nut, history_causes
from ballscrew.monitoring.stage import Stage, stage
from ballscrew.monitoring.state import HealthState, RunState

_DAY = 86400.0  # s
_FIRST_RUNS = 3  # good runs of an epoch that determine its reference: statistics begin after them
_LEAST_U = 0.2  # (P/P₀)^(−1/3): a preload of 125 times the baseline is no measurement


@dataclass(frozen=True, slots=True, eq=False)
class _History:
    """Assessed runs in time order, epochs and their references, and the time of the first run."""

    runs: tuple[AssessedRun, ...]
    epochs: tuple[Epoch, ...]
    references: tuple[MeasuredRun | None, ...]
    begin: datetime

    def in_epoch(self, number: int) -> list[AssessedRun]:
        return [assessed for assessed in self.runs if assessed.reading.epoch == number]

    def good_runs(self, number: int) -> list[AssessedRun]:
        return [assessed for assessed in self.in_epoch(number) if assessed.reading.verdict == "good"]


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
    history = _read_history(runs, model, events, settings)
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
            states[assessed.run.id] = charted.get(assessed.run.id, RunState(assessed.reading, "suspect"))
        epochs.append(replace(epoch, alarm_at=_alarm_at(charted)))
        charts.append(chart)
    ordered = tuple(states[assessed.run.id] for assessed in history.runs)
    good, chart, reference = history.good_runs(epochs[-1].number), charts[-1], history.references[-1]
    doubts = [f"the newest good run: {doubt}" for assessed in good[-1:] for doubt in assessed.doubts]
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
    if chart is None or reference is None:
        return health
    newest = states[good[-1].run.id]
    health = replace(health, nut_reasons=_nut_reasons(newest, good, chart, model, settings))
    if newest.state in ("watch", "alarm"):
        causes = history_causes(good, reference.run, chart, model, settings)
        health = replace(
            health,
            stage=_stage(newest, good, chart, ordered),
            causes=causes,
        )
    # A repeat is requested only on the day of the newest good run; the runs after it are not good.
    same_day = ordered[-1].reading.day - newest.reading.day < SAME_DAY
    return replace(health, state=newest.state, repeat_asked=same_day and chart.repeat_asked)


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
    """Stage at the newest good run, where preload is being lost."""
    if chart.newest_stiffer:
        return None
    readings = [assessed.reading for assessed in good]
    baseline = [readings[i] for i in chart.baseline]
    later = [run.reading for run in runs if run.reading.day > readings[-1].day]
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


def _notes(newest: Epoch, history: _History, chart: Chart | None) -> tuple[str, ...]:
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
    good: Sequence[AssessedRun], epoch: Epoch, history: _History, settings: MonitorSettings, drift: float
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


def _read_history(
    runs: Sequence[Run], model: CalibratedAxis, events: Sequence[Event], settings: MonitorSettings
) -> _History:
    """Assess all runs of an axis relative to the references of their epochs."""
    if not runs:
        raise InputError("no run was given; a history needs one or more.")
    common_method(runs)
    ordered = sorted(_distinct_runs(runs), key=lambda run: (_time(run, model), run.id))
    _check_recordings(ordered)
    times = [_time(run, model) for run in ordered]
    measured = [MeasuredRun(run, frequency_table(run)) for run in ordered]
    epochs = list(epochs_of(events, times[-1]))
    starts = [moment(epoch.begins, "an event: at") for epoch in epochs[1:]]
    epoch_of_run = [bisect_right(starts, time) for time in times]
    first_runs = _first_good_runs(measured, epoch_of_run, len(epochs))
    references = [_reference(first, model, settings) for first in first_runs]
    for number, reference in enumerate(references):
        if reference is not None:
            run = reference.run
            epochs[number] = replace(epochs[number], reference=run.id, reference_at=run.measured_at)
    assessed = []
    # A run before the first good one of its epoch has no reference: a later run changes no earlier state.
    current: list[MeasuredRun | None] = [None] * len(epochs)
    for candidate, time, number in zip(measured, times, epoch_of_run, strict=True):
        if candidate in first_runs[number][:1]:
            current[number] = references[number]
        reading = unassessed_reading(candidate.run, (time - times[0]).total_seconds() / _DAY, number)
        assessed.append(assess_run(candidate, reading, current[number], model, settings))
    return _History(tuple(assessed), tuple(epochs), tuple(references), times[0])


def _first_good_runs(
    measured: Sequence[MeasuredRun], epoch_of_run: Sequence[int], epochs: int
) -> list[list[MeasuredRun]]:
    """First good runs of each epoch."""
    first: list[list[MeasuredRun]] = [[] for _ in range(epochs)]
    for candidate, number in zip(measured, epoch_of_run, strict=True):
        good = candidate.run.quality.verdict == "good" and len(candidate.table.frequency) > 0
        if good and len(first[number]) < _FIRST_RUNS:
            first[number].append(candidate)
    return first


def _reference(
    first: Sequence[MeasuredRun], model: CalibratedAxis, settings: MonitorSettings
) -> MeasuredRun | None:
    """First good run, but the second where the third agrees with it and neither agrees with the first.

    Statistics begin after three runs, so this uses nothing for which an alarm could have waited.
    """
    if not first:
        return None
    if len(first) < _FIRST_RUNS:
        return first[0]
    candidate, second, third = first
    if agree(second, candidate, model, settings) or agree(third, candidate, model, settings):
        return candidate
    return second if agree(third, second, model, settings) else candidate


def _distinct_runs(runs: Sequence[Run]) -> list[Run]:
    distinct: dict[str, Run] = {}
    for run in runs:
        known = distinct.setdefault(run.id, run)
        if known is not run and known.to_json() != run.to_json():
            raise InputError(
                f"run {shown(run.id)[1:13]} was given twice with different content; give one of the files."
            )
    return list(distinct.values())


def _check_recordings(runs: Sequence[Run]) -> None:
    """Check that no recording counts twice."""
    run_of: dict[str, Run] = {}
    for run in runs:
        for file in run.files:
            other = run_of.setdefault(file.sha256, run)
            if other is not run:
                raise InputError(
                    f"runs {shown(other.id)[1:13]} and {shown(run.id)[1:13]} are made of the same "
                    f"recording, {shown(file.name)}: it would count twice. Give one of the two."
                )


def _time(run: Run, model: CalibratedAxis) -> datetime:
    name = f"run {shown(run.id)[1:13]}"
    if run.axis is not None and model.axis and run.axis != model.axis:
        raise InputError(
            f"{name} is of the axis {shown(run.axis)}, the model of {shown(model.axis)}; they must be of one "
            "axis."
        )
    if run.measured_at is None:
        raise InputError(f"{name} has no time, by which a history is ordered: analyse it with --measured-at.")
    return moment(run.measured_at, f"{name}: measured_at")
