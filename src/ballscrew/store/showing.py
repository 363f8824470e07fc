"""An axis and a run with all that the store has about them, and where each number comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.provenance import digest
from ballscrew.modal.amend import SUPERSEDES
from ballscrew.monitoring.epochs import METHOD_CHANGED, moment
from ballscrew.store.alarms import alarm_over_at
from ballscrew.store.histories import axis_events
from ballscrew.store.lamps import add_lamps
from ballscrew.store.methods import used_result, used_results
from ballscrew.store.opened import OpenStore
from ballscrew.store.reading import (
    assessment_document,
    current_rows,
    find_axis,
    find_method,
    find_run,
    newest_runs,
    run_rows,
    run_versions,
    shared_recordings,
    trend,
)
from ballscrew.store.rows import named_columns, unpack
from ballscrew.store.tables import (
    AlarmRow,
    Assessment,
    Axis,
    Conflict,
    Correction,
    EpochRow,
    EventRow,
    Exclusion,
    Method,
    RawFile,
    RecordingRow,
    ResultRow,
    RunRow,
    Source,
    StateRow,
)


def show_axis(store: OpenStore, name: str) -> dict[str, Any]:
    """An axis: assessment and trend, what to do, alarms, events, exclusions, corrections and conflicts.

    Parameters
    ----------
    store : OpenStore
        The store.
    name : str
        Name of the axis.

    Returns
    -------
    dict
        Document of ``store show --json``.

    Raises
    ------
    InputError
        If there is no such axis.
    """
    with store.read() as session:
        document = axis_document(session, find_axis(session, name))
        add_lamps(session, [document], datetime.now(UTC))
        return document


def axis_document(session: Session, axis: Axis) -> dict[str, Any]:
    """As :func:`show_axis`, in a transaction that has begun, and without its lamps."""
    assessment = None
    if axis.assessment_id is not None:
        assessment = session.get(Assessment, axis.assessment_id)
    method = find_method(session, axis)
    alarms = session.scalars(select(AlarmRow).where(AlarmRow.axis_id == axis.id).order_by(AlarmRow.id)).all()
    of_run, of_event = Exclusion.run_id == RunRow.id, Exclusion.event_id == EventRow.id
    excluded = session.execute(
        select(RunRow.run, EventRow.digest, Exclusion)
        .select_from(Exclusion)
        .outerjoin(RunRow, of_run)
        .outerjoin(EventRow, of_event)
        .where(or_(RunRow.axis_id == axis.id, EventRow.axis_id == axis.id))
        .order_by(Exclusion.id)
    ).all()
    events = session.scalars(
        select(EventRow).where(EventRow.axis_id == axis.id).order_by(EventRow.time, EventRow.digest)
    ).all()
    return {
        "schema": SCHEMA,
        "axis": axis.name,
        "method": None if method is None else {"name": method.name, "revision": method.revision},
        **assessment_document(assessment, axis.changed_at, newest_runs(session, axis).get(axis.id)),
        "runs": _runs_document(session, axis, trend(session, axis)),
        "alarms": [
            named_columns(row, "epoch", "began_at", "raised_at", "retracted_at")
            | {"over_at": alarm_over_at(session, row)}
            for row in alarms
        ],
        "events": _events_document(session, axis, events),
        "exclusions": [
            {"run": run, "event": event} | named_columns(row, "reason", "actor", "begun_at", "ended_at")
            for run, event, row in excluded
        ],
        "corrections": _corrections(session, axis),
        **_conflicts(session, axis),
    }


def _events_document(session: Session, axis: Axis, rows: Sequence[EventRow]) -> list[dict[str, Any]]:
    """Events that were added, and changes of the method, by time."""
    documents = [named_columns(row, "digest", "at", "kind", "text") for row in rows]
    changes = [event for event in axis_events(session, axis) if event.kind == METHOD_CHANGED]
    documents += [{"digest": None} | event.to_json() for event in changes]
    return sorted(documents, key=lambda document: moment(document["at"], "an event: at"))


def _runs_document(session: Session, axis: Axis, states: Mapping[int, Any]) -> list[dict[str, Any]]:
    """Every run of an axis in time order, with its verdict and state."""
    results = used_results(session, axis)
    rows = run_rows(session, axis.id)
    current = {row.id for row in current_rows(session, axis, rows)}
    unknown = {"state": "unknown", "stiffness": None, "nut": None}
    runs = []
    for number, run, measured_at, _, mass, temperature, supersedes in rows:
        result = results.get(number)
        document = {
            "run": run, "measured_at": measured_at, "mass_kg": mass, "temperature_C": temperature,
            "supersedes": supersedes, "counts": number in current, "quality": result and result.verdict,
        }  # fmt: skip
        runs.append(document | states.get(number, unknown))
    return runs


def _corrections(session: Session, axis: Axis) -> list[dict[str, Any]]:
    """Corrections of the runs of an axis, and of its model and method, a row for each field, by time.

    One that was added as a file has no reason and no author.
    """
    runs = session.scalars(select(RunRow).where(RunRow.axis_id == axis.id).order_by(RunRow.id)).all()
    by_id = {run.run: run for run in runs}
    stated: dict[tuple[str, str], Correction] = {}
    documents = []
    of_runs = Correction.subject.in_(select(RunRow.run).where(RunRow.axis_id == axis.id))
    of_axis = Correction.subject == f"axis {axis.name}"
    for row in session.scalars(select(Correction).where(of_runs | of_axis).order_by(Correction.id)):
        if row.subject not in by_id:
            fields = named_columns(row, "field", "old", "new", "reason", "actor", "at")
            documents.append({"run": None, "supersedes": None} | fields)
        else:
            stated[row.subject, row.field] = row
    for run in runs:
        former = by_id.get(str(run.supersedes))
        for field in ("measured_at", "mass_kg"):
            old, new = getattr(former, field, None), getattr(run, field)
            if run.supersedes is not None and (former is None or old != new):
                known = stated.get((run.run, field))
                documents.append(
                    {
                        "run": run.run, "supersedes": run.supersedes, "field": field, "old": old, "new": new,
                        "reason": getattr(known, "reason", ""), "actor": getattr(known, "actor", None),
                        "at": run.received_at,
                    }
                )  # fmt: skip
    return sorted(documents, key=lambda document: str(document["at"]))


def _conflicts(session: Session, axis: Axis) -> dict[str, Any]:
    """Refused results of the runs of an axis, and pairs of runs of which only one may count."""
    refused = []
    rows = (
        select(Conflict, RunRow)
        .join(RunRow, RunRow.run == Conflict.run)
        .where(RunRow.axis_id == axis.id)
        .order_by(Conflict.received_at, Conflict.digest)
    )
    for conflict, run in session.execute(rows):
        given = unpack(conflict.document)["run"]
        differs = []
        for field, value in (("axis", axis.name), ("measured_at", run.measured_at), ("mass_kg", run.mass_kg)):
            if given.get(field) != value:
                differs.append(field)
        refused.append(
            named_columns(conflict, "run", "digest", "received_at") | {"differs": differs or ["result"]}
        )
    pairs = []
    for first, second, name in shared_recordings(session, axis, current_rows(session, axis)):
        pairs.append({"runs": [first, second], "recording": name})
    return {"conflicts": refused, "shared_recordings": pairs}


def show_run(store: OpenStore, beginning: str) -> dict[str, Any]:
    """A run with what its numbers come from: recordings, documents, settings, method and versions.

    Parameters
    ----------
    store : OpenStore
        The store.
    beginning : str
        Id of the run, or its beginning.

    Returns
    -------
    dict
        Document of ``store show RUN --json``.

    Raises
    ------
    InputError
        If there is no such run, or more than one.
    """
    with store.read() as session:
        run = find_run(session, beginning)
        axis = session.get_one(Axis, run.axis_id)
        current = {row.id for row in current_rows(session, axis)}
        document = run_document(session, run, axis)
        return {"schema": SCHEMA, "counts": run.id in current, **document}


def show(store: OpenStore, subject: str) -> dict[str, Any]:
    """An axis by its name, or a run by its id.

    Parameters
    ----------
    store : OpenStore
        The store.
    subject : str
        Name of the axis; id of the run, or its beginning.

    Returns
    -------
    dict
        As by :func:`show_axis` or :func:`show_run`.

    Raises
    ------
    InputError
        If there is neither, or more than one run.
    """
    with store.read() as session:
        is_axis = session.scalar(select(Axis.id).where(Axis.name == subject)) is not None
        matches = RunRow.run.startswith(subject, autoescape=True)
        is_run = session.scalars(select(RunRow.id).where(matches).limit(1)).first() is not None
    if subject and is_run and not is_axis:
        return show_run(store, subject)
    return show_axis(store, subject)


def run_document(session: Session, run: RunRow, axis: Axis) -> dict[str, Any]:
    """A run, and what its numbers come from.

    Parameters
    ----------
    session : Session
        Reading.
    run : RunRow
        Its row.
    axis : Axis
        Its axis.

    Returns
    -------
    dict
        See :func:`show_run`.
    """
    later = session.scalars(select(RunRow.run).where(RunRow.supersedes == run.run).order_by(RunRow.id))
    results, counts = [], used_result(session, axis, run.id)
    documents: dict[str, str] = {}
    rows = select(ResultRow, Method).join(Method, Method.id == ResultRow.method_id)
    for result, used in session.execute(rows.where(ResultRow.run_id == run.id).order_by(ResultRow.id)):
        content = unpack(result.document)
        documents |= content["made"]["inputs"]
        results.append(
            {
                "method": used.name, "revision": used.revision, "version": result.version,
                "settings": used.settings, "quality": result.verdict, "added_at": result.added_at,
                "digest": digest(content), "history": counts is not None and counts.id == result.id,
            }
        )  # fmt: skip
    documents.pop(SUPERSEDES, None)
    return {
        "axis": axis.name,
        **named_columns(run, "run", "measured_at", "mass_kg", "temperature_C", "received_at", "supersedes"),
        "corrected_as": list(later),
        "recordings": _recordings(session, run),
        "documents": documents,
        "results": results,
        "state": _state_document(session, run, axis),
    }


def _recordings(session: Session, run: RunRow) -> list[dict[str, Any]]:
    """Recordings of a run with their hashes, their readers, and where they are."""
    readers: dict[str, str | None] = {}
    versions = [run.id]
    if run.supersedes is not None:  # it is made of the recordings of the run before
        versions = run_versions(session, run)
    for source in session.scalars(select(Source).where(Source.run_id.in_(versions))):
        stated = source.stated
        readers |= dict(zip(stated["files"], stated.get("readers", ()), strict=False))
    documents = []
    rows = select(RecordingRow).where(RecordingRow.run_id == run.id).order_by(RecordingRow.place)
    for row in session.scalars(rows):
        file = session.get(RawFile, row.sha256)
        documents.append(
            {
                "name": row.name, "sha256": row.sha256, "reader": readers.get(row.sha256),
                "stored": file is not None and file.is_stored,
                "archived_to": None if file is None else file.archived_to,
                "deleted_at": None if file is None else file.deleted_at,
            }
        )  # fmt: skip
    return documents


def _state_document(session: Session, run: RunRow, axis: Axis) -> dict[str, Any] | None:
    """State of a run by the newest assessment, and the epoch and reference that it is relative to."""
    row = session.get(StateRow, run.id)
    if row is None:
        return None
    epoch = session.get_one(EpochRow, (row.axis_id, row.epoch))
    assessment = session.get_one(Assessment, axis.assessment_id)
    return {
        "state": row.state,
        "epoch": row.epoch,
        "begins": epoch.begins,
        "reference": epoch.reference,
        **named_columns(assessment, "model_digest", "version", "made_at"),
    }
