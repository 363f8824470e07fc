"""History of an axis: its runs in time order, in epochs, each assessed relative to its epoch's reference."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from ballscrew.base.errors import InputError, shown
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.frequency_table import frequency_table
from ballscrew.calibration.method import common_method
from ballscrew.modal.amend import current_runs
from ballscrew.modal.run import Run
from ballscrew.monitoring.assessment import AssessedRun, MeasuredRun, agree, assess_run, unassessed_reading
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import Epoch, Event, epochs_of, moment

_DAY = 86400.0  # s
_LONGEST_HISTORY = 50 * 365  # days; no screw is in use for longer
_FIRST_RUNS = 3  # good runs of an epoch that determine its reference: statistics begin after them


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Assessed runs of an axis.

    Parameters
    ----------
    runs : tuple of AssessedRun
        In time order.
    epochs : tuple of Epoch
        By time.
    references : tuple of MeasuredRun or None
        One for each epoch; None where no run is good.
    begin : datetime
        Time of the first run.
    """

    runs: tuple[AssessedRun, ...]
    epochs: tuple[Epoch, ...]
    references: tuple[MeasuredRun | None, ...]
    begin: datetime

    def in_epoch(self, number: int) -> list[AssessedRun]:
        """Runs of an epoch."""
        return [assessed for assessed in self.runs if assessed.reading.epoch == number]

    def good_runs(self, number: int) -> list[AssessedRun]:
        """Good runs of an epoch."""
        return [assessed for assessed in self.in_epoch(number) if assessed.reading.verdict == "good"]


def read_history(
    runs: Sequence[Run], model: CalibratedAxis, events: Sequence[Event], settings: MonitorSettings
) -> History:
    """Assess all runs of an axis relative to the references of their epochs.

    Parameters
    ----------
    runs, model, events, settings
        As for :func:`ballscrew.monitoring.health.health_state`.

    Returns
    -------
    History
        It does not depend on the order of the runs.

    Raises
    ------
    InputError
        As :func:`ballscrew.monitoring.health.health_state` does.
    """
    if not runs:
        raise InputError("no run was given; a history needs one or more.")
    common_method(runs)
    ordered = sorted(_distinct_runs(runs), key=lambda run: (_time(run, model), run.id))
    _check_recordings(ordered)
    _check_span(ordered[0], ordered[-1], model)
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
    return History(tuple(assessed), tuple(epochs), tuple(references), times[0])


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
    for run in current_runs(runs):
        known = distinct.setdefault(run.id, run)
        if known is not run and known.to_json() != run.to_json():
            raise InputError(
                f"{known.name} and {run.name} are one run, given twice with different content; "
                "give one of the files."
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
                    f"{other.name} and {run.name} are made of the same "
                    f"recording, {shown(file.name)}: it would count twice. Give one of the two."
                )


def _check_span(first: Run, last: Run, model: CalibratedAxis) -> None:
    """Check that a clock cannot be wrong by decades."""
    if (_time(last, model) - _time(first, model)).days > _LONGEST_HISTORY:
        raise InputError(
            f"{first.name} and {last.name} are more than {_LONGEST_HISTORY // 365} years apart "
            f"({first.measured_at}, {last.measured_at}): correct the wrong time with 'ballscrew amend'."
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
