"""Rows of analysed runs: which are duplicates, which contradict the store, and which correct others."""

from __future__ import annotations

import math
import unicodedata
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError, printable, shown
from ballscrew.base.provenance import digest
from ballscrew.calibration.method import method_of
from ballscrew.modal.amend import SUPERSEDES
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import moment
from ballscrew.store.folder import now
from ballscrew.store.opened import record
from ballscrew.store.rows import pack, unpack
from ballscrew.store.same_recordings import RecordedRun, check_recordings
from ballscrew.store.tables import Axis, CellRow, Conflict, Method, RecordingRow, ResultRow, RunRow

_LONGEST_NAME = 200  # characters of a name or an id, which are keys
_SAME = 1e-6  # relative: the same recordings on another processor


@dataclass(frozen=True, slots=True)
class Added:
    """What was added.

    Parameters
    ----------
    kind : str
        run, model, events or data sheet.
    subject : str
        Its id, digest or name.
    axis : str
        Name of the axis.
    is_new : bool
        False if the store contained all of it.
    conflict : bool
        Whether the store has another result of the same run, method and settings: this one was refused, and
        is stored among the conflicts.
    notes : tuple of str
        Sentences.
    """

    kind: str
    subject: str
    axis: str
    is_new: bool
    conflict: bool = False
    notes: tuple[str, ...] = field(default=())


def check_added(added: Added, name: str) -> Added:
    """Check that a run was not refused.

    Raises
    ------
    InputError
        If it was.
    """
    if added.conflict:
        raise InputError(
            f"{name}: the store has another result of the run {shown(added.subject[:12])} by the same method "
            "and settings, which stays; this one is stored among the conflicts, which 'ballscrew store show' "
            "lists."
        )
    return added


def insert_run(session: Session, run: Run, revision: int) -> Added:
    """Add the rows of an analysed run.

    Parameters
    ----------
    session : Session
        Writing.
    run : Run
        Analysed.
    revision : int
        Of its method.

    Returns
    -------
    Added
        Not new if the same result is there; a conflict if there is another one.

    Raises
    ------
    InputError
        If it names no axis, has no usable id or time, or is new and has a recording of another run that
        counts.
    """
    if run.axis is None:
        raise InputError(f"{run.name}: names no axis; analyse it with a data sheet (--axis).")
    check_key("the run's id", run.id)
    check_key("the name of the axis", str(run.axis))
    document = run.to_json()
    run = Run.from_json(document, run.name)  # nine digits, as RUN.json has them
    row = session.scalar(select(RunRow).where(RunRow.run == run.id))
    content = pack(document)
    notes: tuple[str, ...] = ()
    is_new = row is None
    if row is None:
        check_recordings(session, RecordedRun.of(run, str(run.axis)))
        notes = _notes(session, run)
        row = _insert_run_row(session, run, axis_row(session, str(run.axis)))
    axis = session.get_one(Axis, row.axis_id)
    if (axis.name, row.measured_at, row.mass_kg) != (run.axis, run.measured_at, run.mass_kg):
        return _conflict(session, run, content)
    method = method_row(session, run, revision)
    of_method = (ResultRow.run_id == row.id, ResultRow.method_id == method.id)
    known = None if is_new else session.scalar(select(ResultRow).where(*of_method))
    if known is not None:
        if _agree(_content(unpack(known.document)), _content(document)):
            return Added("run", run.id, axis.name, is_new=False)
        return _conflict(session, run, content)
    result = ResultRow(
        run_id=row.id,
        method_id=method.id,
        version=run.made.version,
        verdict=run.quality.verdict,
        reasons=list(run.quality.reasons) or None,
        document=content,
        added_at=now(),
    )
    session.add(result)
    session.flush()
    session.add_all(cell_rows(run, result.id))
    axis.changed_at = now()
    record(session, "add", f"run {run.id}", axis=axis.name, result=digest(document))
    return Added("run", run.id, axis.name, is_new=True, notes=notes)


def cell_rows(run: Run, result: int) -> list[CellRow]:
    """Rows of the cells of a result."""
    rows = []
    for place, cell in enumerate(run.cells):
        reasons = [list(doubt) for doubt in cell.doubts()]
        rows.append(
            CellRow(
                result_id=result,
                place=place,
                position_m=cell.position_m,
                condition=cell.condition,
                motion=cell.motion,
                frequency_Hz=cell.frequency_Hz,
                standard_uncertainty_Hz=cell.standard_uncertainty_Hz,
                verdict=cell.verdict,
                reasons=reasons or None,
            )
        )
    return rows


def _insert_run_row(session: Session, run: Run, axis: Axis) -> RunRow:
    time = None
    if run.measured_at is not None:
        time = moment(run.measured_at, f"{run.name}: measured_at").timestamp()
    row = RunRow(
        run=run.id,
        axis_id=axis.id,
        measured_at=run.measured_at,
        time=time,
        mass_kg=run.mass_kg,
        temperature_C=run.temperature_C,
        supersedes=run.made.inputs.get(SUPERSEDES),
        received_at=now(),
    )
    session.add(row)
    axis.runs += 1
    session.flush()
    for place, file in enumerate(run.files):
        check_key("the hash of a recording", file.sha256)
        session.add(RecordingRow(run_id=row.id, place=place, name=file.name, sha256=file.sha256))
    return row


def _notes(session: Session, run: Run) -> tuple[str, ...]:
    """Sentences about a run that is not in the store yet."""
    former = run.made.inputs.get(SUPERSEDES)
    if former is not None:
        earlier = session.scalars(select(RunRow.run).where(RunRow.supersedes == former)).all()
        if earlier:
            text = f"The run {former[:12]} was corrected before, as {earlier[-1][:12]}"
            return (f"{text}: of several corrections the one that was added last counts, which is this one.",)
    if run.measured_at is None:
        return ("The run has no time and is part of no history: 'ballscrew store correct --measured-at'.",)
    if moment(run.measured_at, "measured_at") > moment(now(), "now"):
        return (f"The run's time, {run.measured_at}, is in the future: is the clock right?",)
    return ()


def _conflict(session: Session, run: Run, content: bytes) -> Added:
    key = digest(run.to_json())
    is_new = session.get(Conflict, key) is None
    if is_new:
        session.add(Conflict(digest=key, run=run.id, document=content, received_at=now()))
        record(session, "refuse", f"run {run.id}", axis=run.axis, result=key)
    return Added("run", run.id, str(run.axis), is_new=is_new, conflict=True)


def _content(document: dict[str, Any]) -> dict[str, Any]:
    """What makes two results of a run different: neither names of files nor the version of the program."""
    files = [file["sha256"] for file in document["run"]["files"]]
    made = document["made"] | {"version": ""}
    return document | {"run": document["run"] | {"files": files}, "made": made}


def _agree(first: Any, other: Any) -> bool:
    """Whether two documents are equal but for the last digits of their numbers."""
    if isinstance(first, dict) and isinstance(other, dict):
        return first.keys() == other.keys() and all(_agree(first[key], other[key]) for key in first)
    if isinstance(first, list) and isinstance(other, list):
        return len(first) == len(other) and all(map(_agree, first, other))
    if isinstance(first, float) and isinstance(other, float):
        return math.isclose(first, other, rel_tol=_SAME, abs_tol=1e-12)
    return bool(first == other)


def axis_row(session: Session, name: str) -> Axis:
    """Row of an axis, new where there is none."""
    row = session.scalar(select(Axis).where(Axis.name == name))
    if row is None:
        check_name("the name of the axis", name)
        if "/" in name or not name.strip(". "):
            raise InputError(
                f"the name of the axis is {shown(name)}; it may have any characters but '/' and control "
                "characters, and not dots alone, since it is a part of URLs: change it in the data sheet."
            )
        row = Axis(name=name, runs=0)
        session.add(row)
        session.flush()
    return row


def method_row(session: Session, run: Run, revision: int) -> Method:
    """Row of the method, the settings and the revision of a run's result."""
    settings = run.made.settings
    name = str(settings.get("method") or method_of(run) or "unknown")
    key = digest(settings)
    row = session.scalar(
        select(Method).where(Method.name == name, Method.settings_digest == key, Method.revision == revision)
    )
    if row is None:
        check_key("the method", name)
        row = Method(name=name, settings_digest=key, revision=revision, settings=settings)
        session.add(row)
        session.flush()
    return row


def check_key(what: str, value: str) -> None:
    """Check that a text can be a key: not too long, not blank, without control characters.

    Parameters
    ----------
    what : str
        What it is, for the message.
    value : str
        The text.

    Raises
    ------
    InputError
        If it cannot.
    """
    if len(value) > _LONGEST_NAME:
        raise InputError(f"{what} has {len(value)} characters; it must have {_LONGEST_NAME} at most.")
    if not value.strip():
        raise InputError(f"{what} is {value!r}; it must not be blank.")
    if printable(value) != value:
        raise InputError(f"{what} is {shown(value)}; it must not contain control characters.")


def check_name(what: str, value: str) -> None:
    """Check that a text can be a new name: a key that does not look like another; parameters as above."""
    check_key(what, value)
    if any(unicodedata.category(character) == "Cf" for character in value):
        raise InputError(f"{what} is {shown(value)}; it must not contain invisible characters.")
    if " ".join(value.split()) != value:
        blanks = "begin or end with blanks, or have two in a row"
        raise InputError(f"{what} is {shown(value)}; it must not {blanks}.")


def check_text(what: str, text: str) -> None:
    """Check that both databases can store a text.

    Raises
    ------
    InputError
        If it contains NUL, or was no valid Unicode where it was read.
    """
    if "\0" in text or any("\ud800" <= letter <= "\udfff" for letter in text):
        raise InputError(f"{what} is {shown(text)}; it must be valid Unicode without NUL.")
