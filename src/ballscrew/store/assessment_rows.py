"""Rows of an assessment: states, epochs, alarms, explanation and checkpoint of an axis."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import delete, insert, select
from sqlalchemy.orm import Session

from ballscrew._version import __version__
from ballscrew.base.jsonfile import plain
from ballscrew.base.provenance import digest
from ballscrew.base.quantity import Quantity
from ballscrew.monitoring.checkpoint import Checkpoint
from ballscrew.monitoring.detection.chart import Chart
from ballscrew.monitoring.epochs import moment
from ballscrew.monitoring.state import HealthState, RunState
from ballscrew.prognosis.monitor import Monitored
from ballscrew.store.explaining import explanation
from ballscrew.store.folder import now
from ballscrew.store.histories import StoredHistory, history_key, settings_of
from ballscrew.store.opened import record
from ballscrew.store.reading import find_axis
from ballscrew.store.rows import batched, checksum_of_values, pack
from ballscrew.store.tables import AlarmRow, Assessment, Axis, CheckpointRow, EpochRow, Explanation, StateRow

_REASONS = 10  # of an assessment that are stored
_DIGITS_OF_AN_END = 4  # of the interval of a nut


@dataclass(frozen=True)
class MadeAssessment:
    """Result of :func:`~ballscrew.store.assessing.compute_assessment`, which another process may store.

    Parameters
    ----------
    history : StoredHistory
        What it was made from.
    monitored : Monitored
        Health state and remaining life.
    stated : dict
        Settings.
    """

    history: StoredHistory
    monitored: Monitored
    stated: dict[str, Any]


def inputs_of(history: str, stated: Mapping[str, Any]) -> str:
    """Digest of all that an assessment follows from."""
    return digest({"history": history, "version": __version__, "stated": plain(stated)})


def store_assessment(session: Session, made: MadeAssessment) -> bool:
    """Store an assessment, unless the history of its axis has changed.

    Parameters
    ----------
    session : Session
        Writing.
    made : MadeAssessment
        Not stored yet.

    Returns
    -------
    bool
        Whether it was stored.
    """
    history = made.history
    if history_key(session, find_axis(session, history.axis.name)) != history.key:
        return False
    _store(session, history, made.monitored, inputs_of(history.key, made.stated), made.stated)
    return True


def _store(
    session: Session, history: StoredHistory, monitored: Monitored, inputs: str, stated: dict[str, Any]
) -> None:
    """Rows of an assessment, unless they are there."""
    axis = session.get_one(Axis, history.axis.id)
    row = session.scalar(select(Assessment).where(Assessment.axis_id == axis.id, Assessment.inputs == inputs))
    action = "assess" if row is None else "assess again"
    axis.changed_at = None
    if row is not None and axis.assessment_id == row.id:
        return
    if row is None:
        row = _assessment(history, monitored, inputs, stated)
        session.add(row)
        session.flush()
    former = None if axis.assessment_id is None else session.get_one(Assessment, axis.assessment_id).state
    axis.assessment_id = row.id
    state = monitored.state
    _store_states(session, state, axis.id, history.rows)
    _update_alarms(session, state, axis)
    _store_explanation(session, row, monitored)
    _store_checkpoint(session, history, monitored.checkpoint)
    changed = {"state": [former, state.state]}
    record(session, action, f"axis {axis.name}", state=state.state, inputs=inputs, changed=changed)


def _store_explanation(session: Session, row: Assessment, monitored: Monitored) -> None:
    """Replace the explanation of an axis by that of an assessment."""
    document = explanation(monitored)
    session.merge(
        Explanation(axis_id=row.axis_id, assessment_id=row.id, lamp=document["lamp"], document=pack(document))
    )


def _assessment(
    history: StoredHistory, monitored: Monitored, inputs: str, stated: dict[str, Any]
) -> Assessment:
    state, quantiles = monitored.state, {}
    if monitored.prognosis is not None:
        quantiles = monitored.prognosis.to_json()["rul_days"]["quantiles"]
    stiffness = None
    if state.assessed is not None:
        stiffness = _numbers(state.assessed.stiffness)
    return Assessment(
        axis_id=history.axis.id,
        inputs=inputs,
        made_at=now(),
        version=__version__,
        method_id=history.method.id,
        model_digest=history.model_digest,
        settings=plain(stated),
        runs=len(history.rows),
        newest_at=state.runs[-1].reading.measured_at,
        state=state.state,
        urgency=state.urgency,
        verdict=state.verdict,
        alarm_at=state.alarm_at,
        stiffness=stiffness,
        rul_days=quantiles,
        reasons=list(state.reasons[:_REASONS]) or None,
    )


def _store_states(session: Session, state: HealthState, axis: int, numbers: dict[str, int]) -> None:
    """Write the epochs and the rows of the runs that have changed; the others stay as they are."""
    for epoch in _epoch_rows(state, axis):
        session.merge(epoch)
    session.flush()
    rows = _state_rows(state, axis, numbers)
    stored: dict[int, int] = {}
    found = select(StateRow.run_id, StateRow.checksum).where(StateRow.axis_id == axis)
    stored.update((number, checksum) for number, checksum in session.execute(found))
    changed = [row for row in rows if stored.get(row["run_id"]) != row["checksum"]]
    outdated = stored.keys() - {row["run_id"] for row in rows} | {row["run_id"] for row in changed}
    for batch in batched(sorted(outdated)):
        session.execute(delete(StateRow).where(StateRow.run_id.in_(batch)))
    if changed:
        session.execute(insert(StateRow), changed)
    session.execute(delete(EpochRow).where(EpochRow.axis_id == axis, EpochRow.number >= len(state.epochs)))


def _epoch_rows(state: HealthState, axis: int) -> list[EpochRow]:
    rows = []
    for epoch, chart in zip(state.epochs, state.charts, strict=True):
        row = EpochRow(
            axis_id=axis,
            number=epoch.number,
            begins=epoch.begins,
            ends=epoch.ends,
            cause=epoch.cause,
            reference=epoch.reference,
            alarm_at=epoch.alarm_at,
            coefficients=None,
            covariance=None,
            scale=None,
            share_uncertainty=state.scale_uncertainty,
        )
        if chart is not None:
            row.coefficients = chart.coefficients.tolist()
            row.covariance = chart.covariance.tolist()
            row.scale = float(chart.scale[-1])
        rows.append(row)
    return rows


def _state_rows(state: HealthState, axis: int, numbers: dict[str, int]) -> list[dict[str, Any]]:
    """Columns of the rows of the runs; a good one has the next row of its epoch's chart."""
    charted = [0] * len(state.epochs)
    rows = []
    for run in state.runs:
        reading = run.reading
        nut, low, high = _numbers(run.relative) or (None, None, None)
        # The noise, which is estimated anew by each run, changes further digits of all ends.
        low, high = plain([low, high], _DIGITS_OF_AN_END)
        row = {
            "run_id": numbers[reading.run],
            "axis_id": axis,
            "epoch": reading.epoch,
            "time": moment(reading.measured_at, "a run").timestamp(),
            "state": run.state,
            "verdict": reading.verdict,
            "level": _finite(reading.level),
            "random": _finite(reading.random),
            "systematic": _finite(reading.systematic),
            "unknown_temperature": None,
            "design": None,
            "ramp": _finite(run.ramp),
            "ramp_limit": _finite(run.ramp_limit),
            "odds": _finite(run.odds),
            "odds_limit": _finite(run.odds_limit),
            "nut": nut,
            "nut_low": low,
            "nut_high": high,
            "reasons": list(reading.reasons) or None,
        }
        chart = state.charts[reading.epoch]
        if chart is not None and reading.verdict == "good":
            _set_design(row, run, chart, charted[reading.epoch])
            charted[reading.epoch] += 1
        row["checksum"] = checksum_of_values(row)
        rows.append(row)
    return rows


def _set_design(row: dict[str, Any], run: RunState, chart: Chart, index: int) -> None:
    """Design of a run, where it has a stiffness."""
    if run.stiffness is not None:
        row["random"] = float(chart.design.uncertainty[index])
        row["unknown_temperature"] = float(chart.design.unknown_temperature[index])
        row["design"] = chart.design.columns[index].astype("<f8").tobytes()


def _store_checkpoint(session: Session, history: StoredHistory, checkpoint: Checkpoint | None) -> None:
    """Store a checkpoint; of the older ones, fewer the older they are, for late runs and corrections.

    Of each of the other settings the newest stays.
    """
    if checkpoint is None:
        return
    axis, newest, key = history.axis.id, len(history.prefixes), history.prefixes[-1]
    found = select(CheckpointRow.runs, CheckpointRow.key).where(CheckpointRow.axis_id == axis)
    stored = [(runs, known) for runs, known in session.execute(found)]
    if (newest, key) not in stored:
        stored.append((newest, key))
        session.add(CheckpointRow(axis_id=axis, key=key, runs=newest, document=checkpoint.to_bytes()))
        session.flush()
    former: dict[str, str] = {}
    ages: set[int] = set()
    outdated = []
    for runs, known in sorted(stored):
        age = ((newest - runs).bit_length() + 1) // 2
        settings = settings_of(known)
        if settings != settings_of(key):
            outdated.append(former.get(settings, ""))
            former[settings] = known
        elif known not in history.prefixes or age in ages:
            outdated.append(known)
        else:
            ages.add(age)
    session.execute(
        delete(CheckpointRow).where(CheckpointRow.axis_id == axis, CheckpointRow.key.in_(outdated))
    )


def _update_alarms(session: Session, state: HealthState, axis: Axis) -> None:
    """Raise the alarms that are new, and retract those that no longer follow from the runs."""
    standing = set(_alarms(state))
    for row in session.scalars(select(AlarmRow).where(AlarmRow.axis_id == axis.id)):
        key = (row.epoch, row.began_at)
        if key in standing:
            standing.discard(key)
            if row.retracted_at is not None:
                row.retracted_at = None
                record(session, "raise again", f"alarm of {axis.name}", began_at=row.began_at)
        elif row.retracted_at is None:
            row.retracted_at = now()
            record(session, "retract", f"alarm of {axis.name}", began_at=row.began_at)
    for epoch, began_at in sorted(standing):
        session.add(
            AlarmRow(axis_id=axis.id, epoch=epoch, began_at=began_at, raised_at=now(), retracted_at=None)
        )
        record(session, "raise", f"alarm of {axis.name}", began_at=began_at)


def _alarms(state: HealthState) -> list[tuple[int, str]]:
    """Epoch and start of every alarm in the history."""
    found, before = [], ""
    for run in state.runs:
        if run.state == "alarm" and before != "alarm":
            found.append((run.reading.epoch, run.reading.measured_at))
        if run.state != "suspect":
            before = run.state
    newest = state.epochs[-1]
    if newest.alarm_at is not None and (newest.number, newest.alarm_at) not in found:
        found.append((newest.number, newest.alarm_at))
    return found


def _numbers(quantity: Quantity | None) -> list[float] | None:
    """Value and both ends of the 95 % interval."""
    if quantity is None:
        return None
    low, high = quantity.interval
    return plain([quantity.value, low, high])  # type: ignore[no-any-return]


def _finite(value: float) -> float | None:
    """The number; None for NaN, which SQLite does not store."""
    return None if math.isnan(value) else value
