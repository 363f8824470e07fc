"""History of an axis: its runs in time order, in epochs, each judged relative to its epoch's reference.

It is a recursion over the runs: :func:`add_run` takes the estimates from the runs before, and gives those
with one more. Of each run a row remains. The rest does not grow with the number of runs: the chart
of each epoch, its reference, and the newest three good runs.
"""

from __future__ import annotations

import hashlib
import json
import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from ballscrew.base.errors import InputError, shown
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.frequency_table import frequency_table
from ballscrew.calibration.method import common_method
from ballscrew.estimation.nut import bearing_over_nut, log_preload_by_softening
from ballscrew.modal.amend import SUPERSEDES, current_runs
from ballscrew.modal.run import Run
from ballscrew.monitoring.assessment import AssessedRun, MeasuredRun, agree, assess_run, unassessed_reading
from ballscrew.monitoring.detection.chart_state import ChartedRun, ChartState, chart_run
from ballscrew.monitoring.detection.design import LevelStep
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import METHOD_CHANGED, STEPS, Epoch, Event, epochs_of, moment
from ballscrew.monitoring.reading import Reading

_DAY = 86400.0  # s
_LONGEST_HISTORY = 50 * 365  # days; no screw is in use for longer
_FIRST_RUNS = 3  # good runs of an epoch that determine its reference: statistics begin after them
_SAME_TIME = 1e-6  # days
_NEWEST = 3  # good runs that are compared with the reference cell by cell


@dataclass(frozen=True, slots=True, eq=False)
class HistoryRow:
    """Row of a run: all that later runs, and the health state, need of it.

    Parameters
    ----------
    reading : Reading
        Its quantities.
    name : str
        Of the run.
    digest : str
        Of its document.
    files : tuple of str
        Digests of its recordings.
    doubts : tuple of str
        See :class:`~ballscrew.monitoring.assessment.AssessedRun`.
    limit : float or None
        See the same.
    bearing_over_nut : float
        Compliance of the support bearing over that of the nut; nan where the change is not known.
    softening : tuple of float or None
        As :func:`~ballscrew.estimation.nut.log_preload_by_softening` returns it.
    charted : ChartedRun or None
        None where the run does not count.
    """

    reading: Reading
    name: str
    digest: str
    files: tuple[str, ...]
    doubts: tuple[str, ...] = ()
    limit: float | None = None
    bearing_over_nut: float = math.nan
    softening: tuple[float, float] | None = None
    charted: ChartedRun | None = None


@dataclass(frozen=True, slots=True, eq=False)
class EpochState:
    """Estimates from the runs of an epoch.

    Parameters
    ----------
    chart : ChartState
        Of its good runs.
    learning : tuple of Run
        All its runs, until the first good ones have determined the reference; then none.
    good_first : int
        Number of good runs among these.
    reference : Run or None
        Run that its levels are relative to.
    newest : tuple of Run
        Its newest good runs, three at most.
    rows : tuple of HistoryRow
        A row for each run.
    """

    chart: ChartState
    learning: tuple[Run, ...] = ()
    good_first: int = 0
    reference: Run | None = None
    newest: tuple[Run, ...] = ()
    rows: tuple[HistoryRow, ...] = ()

    @property
    def good(self) -> list[HistoryRow]:
        """Rows of its good runs."""
        return [row for row in self.rows if row.charted is not None]


@dataclass(frozen=True, slots=True, eq=False)
class HistoryState:
    """Estimates from the runs of an axis.

    Parameters
    ----------
    begin : str
        Time of the first run.
    newest : str
        Time of the newest run.
    axis, method : str or None
        Of the runs.
    epochs : tuple of EpochState
        One for each epoch until the newest run.
    """

    begin: str
    newest: str
    axis: str | None
    method: str | None
    epochs: tuple[EpochState, ...]

    @property
    def rows(self) -> list[HistoryRow]:
        """Rows of all runs, in time order."""
        return [row for epoch in self.epochs for row in epoch.rows]


def read_history(
    runs: Sequence[Run],
    model: CalibratedAxis,
    events: Sequence[Event],
    settings: MonitorSettings,
    known: HistoryState | None = None,
) -> HistoryState:
    """Judge runs of an axis, relative to the references of their epochs.

    Parameters
    ----------
    runs, model, events, settings
        As for :func:`ballscrew.monitoring.health.health_state`.
    known : HistoryState, optional
        Of earlier runs.

    Returns
    -------
    HistoryState
        It does not depend on the order of the runs.

    Raises
    ------
    InputError
        As :func:`ballscrew.monitoring.health.health_state` does, or if a run is not later than the newest
        known one.
    """
    if not runs and known is None:
        raise InputError("no run was given; a history needs one or more.")
    method = common_method(runs)
    ordered = sorted(_distinct_runs(runs), key=lambda run: (_time(run, model), run.id))
    if known is not None:
        _check_method(method, known.method)
        ordered = _later_runs(ordered, known, model)
    _check_recordings(ordered, known)
    if not ordered and known is not None:
        return known
    state = known or _no_history(ordered[0])
    begin, newest = moment(state.begin, "the first run"), _time(ordered[-1], model)
    _check_span(begin, ordered, model)
    divided = epochs_of(events, newest)
    drift = settings.assumptions.bearing_daily_spread * model.bearing_share / model.model.share
    more = len(divided) - len(state.epochs)
    epochs = list(state.epochs) + more * [EpochState(ChartState(settings, drift))]
    starts = [moment(epoch.begins, "an event: at") for epoch in divided[1:]]
    for run in ordered:
        time = _time(run, model)
        number = bisect_right(starts, time)
        day = (time - begin).total_seconds() / _DAY
        steps = level_steps(divided[number], state.begin, settings)
        epochs[number] = add_run(epochs[number], run, day, number, steps, model)
    return HistoryState(
        begin=state.begin,
        newest=str(ordered[-1].measured_at),
        axis=state.axis or next((run.axis for run in ordered if run.axis is not None), None),
        method=method or state.method,
        epochs=tuple(epochs),
    )


def _no_history(first: Run) -> HistoryState:
    """History before its first run."""
    begin = str(first.measured_at)
    return HistoryState(begin, begin, None, None, ())


def level_steps(epoch: Epoch, begin: str, settings: MonitorSettings) -> list[LevelStep]:
    """Steps of the level by the events of an epoch.

    Parameters
    ----------
    epoch : Epoch
        With its events.
    begin : str
        Time of the first run of the history.
    settings : MonitorSettings
        Sizes of steps.

    Returns
    -------
    list of LevelStep
        In time order.
    """
    sizes = {"greased": settings.greased, "sensor remounted": settings.remounted}
    steps = []
    for event in epoch.events:
        day = (event.when - moment(begin, "the first run")).total_seconds() / _DAY
        if event.kind in STEPS:
            steps.append(LevelStep(day, sizes[event.kind]))
        if event.kind == METHOD_CHANGED:
            steps.append(LevelStep(day, event.step_uncertainty or 0.0, event.step or 0.0))
    return steps


def add_run(
    state: EpochState, run: Run, day: float, number: int, steps: Sequence[LevelStep], model: CalibratedAxis
) -> EpochState:
    """Judge the next run of an epoch.

    Parameters
    ----------
    state : EpochState
        Estimates from the runs before.
    run : Run
        Analysed.
    day : float
        Since the first run of the history.
    number : int
        Of the epoch.
    steps : sequence of LevelStep
        Of the epoch.
    model : CalibratedAxis
        The axis.

    Returns
    -------
    EpochState
        With the run. While the reference is not determined, the runs so far are judged again.
    """
    if state.good_first == _FIRST_RUNS:
        return _with_run(state, run, unassessed_reading(run, day, number), state.reference, steps, model)
    learning = (*state.learning, run)
    days = [*(row.reading.day for row in state.rows), day]
    measured = [MeasuredRun(each, frequency_table(each)) for each in learning]
    first = [each for each in measured if _is_good(each)]
    reference = None
    if first:
        reference = _reference(first, model, state.chart.settings).run
    state = EpochState(ChartState(state.chart.settings, state.chart.drift))
    # A run before the first good one has no reference: a later run changes no earlier state.
    current: Run | None = None
    for each, when in zip(measured, days, strict=True):
        if each in first[:1]:
            current = reference
        reading = unassessed_reading(each.run, when, number)
        state = _with_run(state, each.run, reading, current, steps, model)
    if len(first) == _FIRST_RUNS:
        learning = ()
    return replace(state, learning=learning, good_first=len(first), reference=reference)


def newest_assessed(
    state: EpochState, number: int, model: CalibratedAxis, settings: MonitorSettings
) -> list[AssessedRun]:
    """Newest good runs of an epoch, with the change of their cells since the reference.

    Parameters
    ----------
    state : EpochState
        The epoch.
    number : int
        Of the epoch.
    model : CalibratedAxis
        The axis.
    settings : MonitorSettings
        Limits of plausibility.

    Returns
    -------
    list of AssessedRun
        Three at most, in time order.
    """
    if state.reference is None:
        return []
    reference = MeasuredRun(state.reference, frequency_table(state.reference))
    found = []
    for run in state.newest:
        measured = MeasuredRun(run, frequency_table(run))
        reading = unassessed_reading(run, math.nan, number)
        found.append(assess_run(measured, reading, reference, model, settings))
    return found


def _with_run(
    state: EpochState,
    run: Run,
    reading: Reading,
    reference: Run | None,
    steps: Sequence[LevelStep],
    model: CalibratedAxis,
) -> EpochState:
    """Epoch with one more run, judged relative to a reference."""
    known = None
    if reference is not None:
        known = MeasuredRun(reference, frequency_table(reference))
    measured = MeasuredRun(run, frequency_table(run))
    assessed = assess_run(measured, reading, known, model, state.chart.settings)
    reading, ratio = assessed.reading, math.nan
    if assessed.change is not None and assessed.fused is not None:
        ratio = bearing_over_nut(assessed.change, assessed.fused)
    if reference is not None:
        expected = _expected_step(run, reference, reading.day, steps)
        reading = replace(reading, level=reading.level - expected)
    chart, charted, newest = state.chart, None, state.newest
    if reading.verdict == "good":
        chart, charted = chart_run(
            chart, reading.day, reading.level, reading.random, reading.temperature, steps
        )
        newest = (*newest, run)[-_NEWEST:]
    row = HistoryRow(
        reading=reading,
        name=run.name,
        digest=run_digest(run),
        files=tuple(file.sha256 for file in run.files),
        doubts=assessed.doubts,
        limit=assessed.limit,
        bearing_over_nut=ratio,
        softening=log_preload_by_softening(run, model.nut_mass),
        charted=charted,
    )
    return replace(state, chart=chart, newest=newest, rows=(*state.rows, row))


def _expected_step(run: Run, reference: Run, day: float, steps: Sequence[LevelStep]) -> float:
    """Expected steps of the level from the reference to a run of a day."""
    times = [moment(each.measured_at, f"{each.name}: measured_at") for each in (run, reference)]
    days = [day, day - (times[0] - times[1]).total_seconds() / _DAY]
    difference = 0.0
    for step in steps:
        after = [step.day <= each + _SAME_TIME for each in days]
        difference += step.expected * (after[0] - after[1])
    return difference


def run_digest(run: Run) -> str:
    """Digest of a run's document."""
    return hashlib.sha256(json.dumps(run.to_json(), sort_keys=True).encode()).hexdigest()


def _is_good(measured: MeasuredRun) -> bool:
    return measured.run.quality.verdict == "good" and len(measured.table.frequency) > 0


def _reference(first: Sequence[MeasuredRun], model: CalibratedAxis, settings: MonitorSettings) -> MeasuredRun:
    """First good run, but the second where the third agrees with it and neither agrees with the first.

    Statistics begin after three runs, so this uses nothing for which an alarm could have waited.
    """
    if len(first) < _FIRST_RUNS:
        return first[0]
    candidate, second, third = first
    if agree(second, candidate, model, settings) or agree(third, candidate, model, settings):
        return candidate
    return second if agree(third, second, model, settings) else candidate


def _distinct_runs(runs: Sequence[Run]) -> list[Run]:
    distinct: dict[str, Run] = {}
    for run in current_runs(runs):
        known = distinct.setdefault(run.id, run)
        if known is not run and known.to_json() != run.to_json():
            raise InputError(_given_twice(known.name, run.name))
    return list(distinct.values())


def _given_twice(name: str, other: str) -> str:
    return f"{name} and {other} are one run, given twice with different content; give one of the files."


def _check_method(method: str | None, known: str | None) -> None:
    """Check that runs are by the method of those before."""
    if method is not None and known is not None and method != known:
        raise InputError(
            f"the runs are by method {method}, those of the checkpoint by method {known}; runs that are "
            "compared must be by the same method: analyse them again."
        )


def _later_runs(runs: Sequence[Run], known: HistoryState, model: CalibratedAxis) -> list[Run]:
    """Runs that are not known yet; all of them must be later than the newest known one."""
    rows = {row.reading.run: row for row in known.rows}
    last = known.rows[-1].reading
    later = []
    for run in runs:
        row = rows.get(run.id)
        if row is not None and row.digest == run_digest(run):
            continue
        superseded = rows.get(run.made.inputs.get(SUPERSEDES, ""))
        time = _time(run, model)
        is_later = (time, run.id) > (moment(last.measured_at, "a run"), last.run)
        if row is not None or superseded is not None or not is_later:
            raise InputError(
                f"{run.name} of {run.measured_at} is a late run or corrects one, and the checkpoint has runs "
                f"until {last.measured_at}: judge again from a checkpoint before it."
            )
        later.append(run)
    return later


def _check_recordings(runs: Sequence[Run], known: HistoryState | None) -> None:
    """Check that no recording counts twice."""
    owner: dict[str, tuple[str, str]] = {}
    rows = known.rows if known is not None else ()
    for row in rows:
        for digest in row.files:
            owner[digest] = row.reading.run, row.name
    for run in runs:
        for file in run.files:
            other, name = owner.setdefault(file.sha256, (run.id, run.name))
            if other != run.id:
                raise InputError(
                    f"{name} and {run.name} are made of the same "
                    f"recording, {shown(file.name)}: it would count twice. Give one of the two."
                )


def _check_span(begin: datetime, runs: Sequence[Run], model: CalibratedAxis) -> None:
    """Check that a clock cannot be wrong by decades."""
    last = runs[-1]
    if (_time(last, model) - begin).days > _LONGEST_HISTORY:
        raise InputError(
            f"{runs[0].name} and {last.name} are more than {_LONGEST_HISTORY // 365} years apart "
            f"({runs[0].measured_at}, {last.measured_at}): correct the wrong time with 'ballscrew amend'."
        )


def _time(run: Run, model: CalibratedAxis) -> datetime:
    name = run.name
    if run.axis is not None and model.axis and run.axis != model.axis:
        raise InputError(
            f"{name} is of the axis {shown(run.axis)}, the model of {shown(model.axis)}; they must be of one "
            "axis."
        )
    if run.measured_at is None:
        raise InputError(
            f"{name} has no time, by which a history is ordered: add it with 'ballscrew amend --measured-at'."
        )
    return moment(run.measured_at, f"{name}: measured_at")
