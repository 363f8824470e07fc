"""Runs, events and model from which the history of an axis is made."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError, shown
from ballscrew.base.provenance import digest
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.modelfile import model_from_json
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import Event
from ballscrew.store.reading import current_rows, find_axis, find_method, find_model
from ballscrew.store.tables import Axis, EventRow, Exclusion, Method, ResultRow, RunRow, unpack


@dataclass(frozen=True)
class StoredHistory:
    """What the history of an axis is made from.

    Parameters
    ----------
    axis : Axis
        Its row.
    method : Method
        Of the results.
    model_digest : str
        Digest of the model.
    model : CalibratedAxis
        The model.
    runs : tuple of Run
        In time order, without excluded, corrected and untimed ones.
    rows : dict of str to int
        Number of each of their rows, by id.
    events : tuple of Event
        By time, without excluded ones.
    key : str
        Digest of what it is made from, see :func:`history_key`.
    missing : int
        Runs without a result by the method.
    untimed : int
        Runs without a time.
    """

    axis: Axis
    method: Method
    model_digest: str
    model: CalibratedAxis
    runs: tuple[Run, ...]
    rows: dict[str, int]
    events: tuple[Event, ...]
    key: str
    missing: int
    untimed: int


def read_stored_history(session: Session, name: str) -> StoredHistory:
    """Read what the history of an axis is made from.

    Parameters
    ----------
    session : Session
        Reading.
    name : str
        Name of the axis.

    Returns
    -------
    StoredHistory
        It does not depend on the order in which its parts were added.

    Raises
    ------
    InputError
        If there is no such axis, or it has no model or no run.
    """
    axis = find_axis(session, name)
    model = find_model(session, axis)
    method = find_method(session, axis)
    current = current_rows(session, axis)
    timed = [row for row in current if row.time is not None]
    runs, rows = [], {}
    if method is not None:
        documents = result_documents(session, axis, method)
        for row in timed:
            if row.id in documents:
                runs.append(Run.from_json(unpack(documents[row.id]), f"run {row.run[:12]}"))
                rows[row.run] = row.id
    if method is None or not runs:
        raise InputError(f"the store has no run of the axis {shown(name)} with a time.")
    return StoredHistory(
        axis=axis,
        method=method,
        model_digest=model.digest,
        model=model_from_json(unpack(model.document), f"model {model.digest[:12]}"),
        runs=tuple(runs),
        rows=rows,
        events=current_events(session, axis),
        key=history_key(session, axis),
        missing=len(timed) - len(runs),
        untimed=len(current) - len(timed),
    )


def result_documents(session: Session, axis: Axis, method: Method) -> dict[int, bytes]:
    """RUN.json, packed, of each run of an axis by a method."""
    found = session.execute(
        select(ResultRow.run_id, ResultRow.document)
        .join(RunRow, RunRow.id == ResultRow.run_id)
        .where(RunRow.axis_id == axis.id, ResultRow.method_id == method.id)
    )
    return {number: document for number, document in found}  # noqa: C416  rows are no pairs to mypy


def history_key(session: Session, axis: Axis) -> str:
    """Digest of what the history of an axis is made from, without reading its documents."""
    method = find_method(session, axis)
    checksums: dict[int, int] = {}
    if method is not None:
        found = session.execute(
            select(ResultRow.run_id, ResultRow.checksum)
            .join(RunRow, RunRow.id == ResultRow.run_id)
            .where(RunRow.axis_id == axis.id, ResultRow.method_id == method.id)
        )
        checksums = {number: checksum for number, checksum in found}  # noqa: C416
    runs = [(row.run, checksums.get(row.id)) for row in current_rows(session, axis)]
    events = [(event.at, event.kind, event.text) for event in current_events(session, axis)]
    return digest({"runs": runs, "events": events, "model": find_model(session, axis).digest})


def current_events(session: Session, axis: Axis) -> tuple[Event, ...]:
    """Events on an axis by time, without excluded ones."""
    excluded = select(Exclusion.event_id).where(Exclusion.event_id.is_not(None), Exclusion.ended_at.is_(None))
    rows = session.scalars(
        select(EventRow)
        .where(EventRow.axis_id == axis.id, EventRow.id.not_in(excluded))
        .order_by(EventRow.time, EventRow.digest)
    )
    return tuple(Event(row.at, row.kind, row.text) for row in rows)
