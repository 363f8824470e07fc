"""Runs to readings: in time order, parted into epochs, each against its epoch's reference and judged twice.

The first verdict is the run's own. The second is against the epoch's reference: its masses, its whole FRF
against its own rigid body, and whether any change of the nut explains its cells. Runs that fail are shown,
and nothing is learnt from them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from ballscrew.base.errors import InputError, shown
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.frequency_table import FrequencyTable, frequency_table
from ballscrew.calibration.method import common_method
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import Epoch, Event, epochs_of, moment
from ballscrew.monitoring.judged import Judged, agree, judge, with_masses
from ballscrew.monitoring.reading import Reading

__all__ = ["History", "read_history"]

_DAY = 86400.0
_FIRST = 3  # good runs of an epoch that choose its reference: as many as there are before one is judged


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """All runs of an axis.

    Parameters
    ----------
    runs : tuple of Judged
        In time order, each once.
    epochs : tuple of Epoch
        With their references.
    references : tuple of Run or None
        Of each epoch.
    begin : datetime
        Of day 0.
    """

    runs: tuple[Judged, ...]
    epochs: tuple[Epoch, ...]
    references: tuple[Run | None, ...]
    begin: datetime


def read_history(
    runs: Sequence[Run], model: CalibratedAxis, events: Sequence[Event], settings: MonitorSettings
) -> History:
    """Read runs of one axis, in any order.

    Parameters
    ----------
    runs : sequence of Run
        Analysed by one method; one that is given twice counts once.
    model : CalibratedAxis
        Of the axis.
    events : sequence of Event
        What was done to it.
    settings : MonitorSettings
        What is plausible.

    Returns
    -------
    History
        The same whatever the order.

    Raises
    ------
    InputError
        If there is none, one tells no time, they are not of one axis and method, or two that differ have one
        id.
    """
    if not runs:
        raise InputError("no run was given; a history takes one or more.")
    common_method(runs)
    timed = sorted(((_when(one, model), one.id, one) for one in _once(runs)), key=lambda t: t[:2])
    _each_recording_once([one for *_, one in timed])
    epochs = list(epochs_of(events, timed[-1][0]))
    begins = [None if one.begins is None else moment(one.begins, "an event: at") for one in epochs]
    begin = timed[0][0]
    tables = [frequency_table(run, rotor=model.rotor) for _, _, run in timed]
    within = [
        max(i for i, start in enumerate(begins) if start is None or when >= start) for when, _, _ in timed
    ]
    firsts: list[list[tuple[Run, FrequencyTable]]] = [[] for _ in epochs]
    for (_, _, run), table, number in zip(timed, tables, within, strict=True):
        if len(firsts[number]) < _FIRST and run.quality.verdict == "good" and len(table.frequency):
            firsts[number].append((run, table))
    chosen = [_reference(some, model, settings) for some in firsts]
    epochs = [
        one if of is None else replace(one, reference=of[0].id, reference_at=of[0].measured_at)
        for one, of in zip(epochs, chosen, strict=True)
    ]
    references: list[tuple[Run, FrequencyTable] | None] = [None] * len(epochs)
    judged = []
    for (when, _, run), table, number in zip(timed, tables, within, strict=True):
        if firsts[number] and run is firsts[number][0][0]:
            references[number] = chosen[number]
        start = Reading(
            run=run.id,
            measured_at=str(run.measured_at),
            day=(when - begin).total_seconds() / _DAY,
            epoch=number,
            temperature=math.nan if run.temperature_C is None else float(run.temperature_C),
            level=math.nan,
            random=math.nan,
            verdict="good",
        )
        judged.append(judge(run, table, with_masses(start, run), references[number], model, settings))
    return History(
        tuple(judged), tuple(epochs), tuple(None if one is None else one[0] for one in chosen), begin
    )


def _reference(
    firsts: Sequence[tuple[Run, FrequencyTable]], model: CalibratedAxis, settings: MonitorSettings
) -> tuple[Run, FrequencyTable] | None:
    """The first good run, but where the next two agree with each other and neither with it.

    No run is judged before there are three, so this knows nothing that an alarm could have waited for.
    """
    if len(firsts) < _FIRST:
        return firsts[0] if firsts else None
    odd, second, third = firsts[:_FIRST]
    if agree(second, odd, model, settings) or agree(third, odd, model, settings):
        return odd
    return second if agree(third, second, model, settings) else odd


def _once(runs: Sequence[Run]) -> tuple[Run, ...]:
    found: dict[str, Run] = {}
    for one in runs:
        known = found.setdefault(one.id, one)
        if known is not one and known.to_json() != one.to_json():
            raise InputError(
                f"run {shown(one.id)[1:13]} was given twice and says two things; give one of the two files."
            )
    return tuple(found.values())


def _each_recording_once(runs: Sequence[Run]) -> None:
    found: dict[str, Run] = {}
    for one in runs:
        for file in one.files:
            other = found.setdefault(file.sha256, one)
            if other is not one:
                raise InputError(
                    f"runs {shown(other.id)[1:13]} and {shown(one.id)[1:13]} are made of the same "
                    f"recording, {shown(file.name)}: it would count twice. Give one of the two."
                )


def _when(run: Run, model: CalibratedAxis) -> datetime:
    name = f"run {shown(run.id)[1:13]}"
    if run.axis is not None and model.axis and run.axis != model.axis:
        raise InputError(
            f"{name} is of the axis {shown(run.axis)}, the model of {shown(model.axis)}; they must be of one "
            "axis."
        )
    if run.measured_at is None:
        raise InputError(f"{name} tells no time; analyse it with --measured-at, a history goes by time.")
    return moment(run.measured_at, f"{name}: measured_at")
