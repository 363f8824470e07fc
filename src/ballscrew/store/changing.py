"""Corrections and exclusions: the old values stay, with reason, time and author."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError, shown
from ballscrew.fcft.plan import read_plan
from ballscrew.modal.amend import amend
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import moment
from ballscrew.store.exclusions import SERVER, end_exclusions, id_of, insert_exclusion
from ballscrew.store.folder import actor, now
from ballscrew.store.inserting import check_added, check_text, insert_run
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.parts import is_part, update_parts
from ballscrew.store.reading import find_axis, find_run, newest_version
from ballscrew.store.rows import unpack
from ballscrew.store.tables import (
    Axis,
    Correction,
    Document,
    EventRow,
    Method,
    Model,
    ResultRow,
    RunRow,
)


def correct_run(
    store: OpenStore,
    run: str,
    *,
    measured_at: str | None = None,
    mass: str | float | None = None,
    reason: str = "",
    by: str | None = None,
) -> str:
    """Correct the time or the load of a run; the run as it was stays in the store.

    Parameters
    ----------
    store : OpenStore
        The store.
    run : str
        Id of the run, or its beginning.
    measured_at, mass
        As for :func:`ballscrew.amend`; data sheet and plan are those in the store.
    reason : str
        Why.
    by : str, optional
        Who wants it; by default who runs this process.

    Returns
    -------
    str
        Id of the corrected run.

    Raises
    ------
    InputError
        If there is no such run, it was corrected already, or as :func:`ballscrew.amend` raises.
    """
    check_text("the reason", reason)
    with store.write("store correct") as session:
        row = find_run(session, run)
        new = ""
        for method in session.scalars(
            select(Method).join(ResultRow, ResultRow.method_id == Method.id).where(ResultRow.run_id == row.id)
        ).all():
            corrected = amend_result(session, row, method, measured_at=measured_at, mass=mass)
            new = corrected.id
            if _time(corrected.measured_at) == row.time and corrected.mass_kg == row.mass_kg:
                raise InputError(f"the run {shown(row.run[:12])} has this time and load already.")
            newest = newest_version(session, row)
            if newest not in (row.run, new):
                what = shown(row.run[:12])
                raise InputError(
                    f"the run {what} was corrected already; correct the run {shown(newest[:12])}."
                )
            check_added(insert_run(session, corrected, method.revision), f"the run {new[:12]}")
        if session.scalar(select(Correction.id).where(Correction.subject == new)) is None:
            _record_corrections(session, row, new, reason, by or actor())
        if measured_at is not None:
            end_exclusions(session, row, "its time was corrected.", by or actor(), (SERVER,))
        update_parts(session, new, by or actor())
    return new


def _time(measured_at: str | None) -> float | None:
    return None if measured_at is None else moment(measured_at, "measured_at").timestamp()


def amend_result(
    session: Session, row: RunRow, method: Method, *, measured_at: str | None, mass: str | float | None
) -> Run:
    """Result of a corrected run, by the result of the run as it was.

    Parameters
    ----------
    session : Session
        Reading.
    row : RunRow
        The run as it was.
    method : Method
        Method of the result.
    measured_at, mass
        As for :func:`ballscrew.amend`.

    Returns
    -------
    Run
        The corrected run.
    """
    found = select(ResultRow).where(ResultRow.run_id == row.id, ResultRow.method_id == method.id)
    former = Run.from_json(unpack(session.scalars(found).all()[0].document), f"run {row.run[:12]}")
    axis, plan = None, None
    if mass is not None:
        axis = _document(session, former, "axis", read_axis)
        plan = _document(session, former, "plan", read_plan)
    return amend(former, measured_at=measured_at, mass=mass, axis=axis, plan=plan)


def _document(session: Session, run: Run, kind: str, read: Callable[[Path], Any]) -> Any:
    """Data sheet or plan of a run's analysis; None if it had none."""
    key = run.made.inputs.get(kind)
    if key is None:
        return None
    row = session.get(Document, key)
    if row is None:
        what = "data sheet" if kind == "axis" else kind
        raise InputError(f"the store does not have the {what} of the run; add it with its RUN.toml.")
    with tempfile.TemporaryDirectory(prefix="ballscrew-") as folder:
        path = Path(folder) / f"{kind}.toml"
        path.write_text(row.text, encoding="utf-8", newline="")
        return read(path)


def _record_corrections(session: Session, former: RunRow, new: str, reason: str, by: str) -> None:
    """Rows of the values that differ between a run and its correction."""
    row = session.scalars(select(RunRow).where(RunRow.run == new)).all()[0]
    changed: dict[str, Any] = {}
    for field in ("measured_at", "mass_kg"):
        old, value = getattr(former, field), getattr(row, field)
        if old != value:
            changed[field] = value
            session.add(
                Correction(
                    subject=new,
                    field=field,
                    old=None if old is None else str(old),
                    new=str(value),
                    reason=reason,
                    actor=by,
                    at=now(),
                )
            )
    axis = session.get_one(Axis, former.axis_id).name
    values = {field: [getattr(former, field), value] for field, value in changed.items()}
    record(
        session,
        "correct",
        f"run {former.run}",
        axis=axis,
        new_run=new,
        reason=reason,
        by=by,
        changed=values,
        **changed,
    )


def choose_model(store: OpenStore, axis: str, model: str, *, reason: str = "") -> str:
    """Choose the model of an axis.

    Parameters
    ----------
    store : OpenStore
        The store.
    axis : str
        Name of the axis.
    model : str
        Digest of the model, or its beginning.
    reason : str
        Why.

    Returns
    -------
    str
        Its digest.

    Raises
    ------
    InputError
        If there is no such axis, or not one model of it with this digest.
    """
    check_text("the reason", reason)
    with store.write("store correct") as session:
        row = find_axis(session, axis)
        matches = Model.digest.startswith(model, autoescape=True)
        found = session.scalars(select(Model.digest).where(Model.axis_id == row.id, matches)).all()
        if not model or len(found) != 1:
            raise InputError(
                f"{len(found)} models of the axis {shown(axis)} begin with {shown(model)}; give one."
            )
        if row.model_digest != found[0]:
            session.add(
                Correction(
                    subject=f"axis {axis}",
                    field="model",
                    old=row.model_digest,
                    new=found[0],
                    reason=reason,
                    actor=actor(),
                    at=now(),
                )
            )
            changed = {"model": [row.model_digest, found[0]]}
            row.model_digest, row.changed_at = found[0], now()
            record(
                session, "correct", f"axis {axis}", axis=axis, model=found[0], reason=reason, changed=changed
            )
        return found[0]


def _find_event(session: Session, subject: str) -> EventRow | None:
    """Event whose id begins so; None where no event's does."""
    of_event = EventRow.digest.startswith(subject, autoescape=True)
    of_run = RunRow.run.startswith(subject, autoescape=True)
    events = session.scalars(select(EventRow).where(of_event).limit(2)).all()
    runs = session.scalars(select(RunRow.run).where(of_run).limit(1)).all()
    if not subject or not events:
        return None
    if runs or len(events) > 1:
        raise InputError(f"several runs or events begin with {shown(subject)}; give more of the id.")
    return events[0]


def exclude(
    store: OpenStore, subject: str, *, reason: str = "", undo: bool = False, by: str | None = None
) -> str:
    """Exclude a run or an event from the history, or include it again; it stays in the store.

    Parameters
    ----------
    store : OpenStore
        The store.
    subject : str
        Id of a run or of an event, or its beginning.
    reason : str
        Why; needed for an exclusion.
    undo : bool
        Whether it counts again.
    by : str, optional
        Who wants it; by default who runs this process.

    Returns
    -------
    str
        Its id.

    Raises
    ------
    InputError
        If there is no such run or event, or no reason.
    """
    if not undo and not reason.strip():
        raise InputError("an exclusion needs a reason (--reason).")
    check_text("the reason", reason)
    by = by or actor()
    with store.write("store exclude") as session:
        found: EventRow | RunRow | None = _find_event(session, subject)
        if found is None:
            found = find_run(session, subject)
        identity = id_of(found)
        was_part = is_part(session, identity)
        if undo or was_part:
            end_exclusions(session, found, reason, by, decided=undo)
        if not undo:
            insert_exclusion(session, found, reason, by)
        if not (undo and was_part):  # else a person wants a part to count too
            update_parts(session, identity, by)
        return identity
