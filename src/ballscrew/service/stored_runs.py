"""A run of the store by its id: its result, its neighbours in the history, and its raw files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, Select, or_, select
from sqlalchemy.orm import InstrumentedAttribute, Session

from ballscrew.base.errors import shown
from ballscrew.service.runs import CONFLICT, document_texts
from ballscrew.service.serving import RefusedError
from ballscrew.store.methods import used_result
from ballscrew.store.reading import current_rows, run_versions
from ballscrew.store.rows import unpack
from ballscrew.store.service_tables import Upload
from ballscrew.store.tables import Axis, EpochRow, RawFile, RecordingRow, ResultRow, RunRow, Source, StateRow

AMBIGUOUS = 409
RAW_GONE = "the raw data of this run were not kept"
_MOST = 10  # runs that begin alike
_SHORTEST = 8  # characters of the beginning of an id


@dataclass(frozen=True, slots=True)
class StoredRun:
    """A run that was analysed, or that was sent and has no result.

    Parameters
    ----------
    axis : Axis
        Its axis.
    row : RunRow or None
        None without a result.
    sent : tuple of Upload
        What was sent, if it was sent.
    """

    axis: Axis
    row: RunRow | None
    sent: tuple[Upload, ...]

    @property
    def id(self) -> str:
        """Id of the run, or of its content where it has no result."""
        return self.sent[0].content if self.row is None else self.row.run


@dataclass(frozen=True, slots=True)
class RawRecording:
    """A recording of a run.

    Parameters
    ----------
    name, sha256 : str
        Name and hash of the file.
    compression : str or None
        As it is stored; None where the store has it no more, or never had it.
    """

    name: str
    sha256: str
    compression: str | None


def locate_run(
    session: Session, text: str, *, axis: Axis | None = None, machine: int | None = None
) -> StoredRun:
    """Run whose id, or id of its content, is a text or begins with it.

    Parameters
    ----------
    session : Session
        Reading.
    text : str
        The id, or a beginning of at least 8 characters.
    axis : Axis, optional
        The run is of this axis, and has a result, whose id it is.
    machine : int, optional
        The run is of this machine.

    Returns
    -------
    StoredRun
        The run.

    Raises
    ------
    RefusedError
        404 if there is none; 409 with ``runs`` if there are several.
    """
    of_axes = select(Axis.id)
    if axis is not None:
        of_axes = of_axes.where(Axis.id == axis.id)
    if machine is not None:
        of_axes = of_axes.where(Axis.machine_id == machine)
    names = _names(session, text, of_axes, of_contents=axis is None, whole=True)
    if not names and len(text) >= _SHORTEST:  # slower: no index finds a beginning
        names = _names(session, text, of_axes, of_contents=axis is None, whole=False)
    if not names:
        raise RefusedError(
            404, f"there is no run {shown(text)}; an id may be its first {_SHORTEST} characters or more."
        )
    if len(names) > 1:
        sentence = f"several runs have an id that begins with {shown(text)}; give more of it."
        raise RefusedError(AMBIGUOUS, sentence, document={"runs": names})
    return _stored_run(session, names[0], of_axes)


def _names(session: Session, text: str, of_axes: Select[int], *, of_contents: bool, whole: bool) -> list[str]:
    """Ids of runs, and where asked for of contents without a result, that are a text or begin with it."""
    found = select(RunRow.run).where(_matches(RunRow.run, text, whole=whole), RunRow.axis_id.in_(of_axes))
    names = dict.fromkeys(session.scalars(found.order_by(RunRow.id).limit(_MOST)))
    if of_contents:
        names |= dict.fromkeys(_names_of_contents(session, text, of_axes, whole=whole))
    return list(names)


def _names_of_contents(session: Session, text: str, of_axes: Select[int], *, whole: bool) -> list[str]:
    """Ids of the runs of contents, and of contents without a result: a conflict is not the run it names."""
    found = select(Upload).where(_matches(Upload.content, text, whole=whole), Upload.axis_id.in_(of_axes))
    runs: dict[str, str | None] = {}
    for upload in session.scalars(found.order_by(Upload.id).limit(_MOST)):
        run = upload.run if upload.status != CONFLICT else None
        runs[upload.content] = runs.get(upload.content) or run
    return [run or content for content, run in runs.items()]


def _matches(column: InstrumentedAttribute[str], text: str, *, whole: bool) -> ColumnElement[bool]:
    if whole:
        return column == text
    return column.startswith(text, autoescape=True)


def _stored_run(session: Session, name: str, of_axes: Select[int]) -> StoredRun:
    """Run of a name with what was sent, of these axes alone: another axis can have sent its id."""
    row = session.scalar(select(RunRow).where(RunRow.run == name, RunRow.axis_id.in_(of_axes)))
    of_run = or_(Upload.content == name, Upload.run == name)
    found = select(Upload).where(of_run, Upload.axis_id.in_(of_axes))
    sent = tuple(session.scalars(found.order_by(Upload.id)))
    axis = row.axis_id if row is not None else sent[0].axis_id
    return StoredRun(session.get_one(Axis, axis), row, sent)


def result_document(session: Session, axis: Axis, row: RunRow) -> Any:
    """RUN.json of a run by the method of the history of its axis, or else by any."""
    any_result = select(ResultRow).where(ResultRow.run_id == row.id).order_by(ResultRow.id)
    result = used_result(session, axis, row.id) or session.scalars(any_result).all()[0]
    return unpack(result.document)


def neighbours(session: Session, found: StoredRun) -> dict[str, str | None]:
    """Ids of the previous and the next run that count, and of the one that is the baseline of its epoch."""
    names: dict[str, str | None] = {"previous": None, "next": None, "baseline": None}
    if found.row is None:
        return names
    if found.row.time is not None:
        for row in current_rows(session, found.axis):
            if row.time is None or row.id == found.row.id:
                continue
            if row.time < found.row.time:
                names["previous"] = row.run
            elif names["next"] is None and row.time > found.row.time:
                names["next"] = row.run
    state = session.get(StateRow, found.row.id)
    if state is not None:
        names["baseline"] = session.get_one(EpochRow, (state.axis_id, state.epoch)).reference
    return names


def recordings_of(session: Session, found: StoredRun) -> tuple[RawRecording, ...]:
    """Recordings of a run in the order in which its result numbers them."""
    if found.row is None:
        named = [(file["name"], file["sha256"]) for file in found.sent[0].files or ()]
    else:
        rows = select(RecordingRow).where(RecordingRow.run_id == found.row.id).order_by(RecordingRow.place)
        named = [(row.name, row.sha256) for row in session.scalars(rows)]
    recordings = []
    for name, sha256 in named:
        file = session.get(RawFile, sha256)
        compression = None
        if file is not None and file.is_stored:
            compression = file.compression
        recordings.append(RawRecording(name, sha256, compression))
    return tuple(recordings)


def stated_of(session: Session, found: StoredRun) -> tuple[dict[str, Any], dict[str, str]] | None:
    """Content of RUN.toml of a run, and the text of each of its documents; None where it is not known."""
    if found.row is None:
        stated = found.sent[0].stated
    else:
        source = source_of(session, found.row)
        stated = {} if source is None else source.stated
    if "documents" not in stated:
        return None
    return stated, document_texts(session, stated)


def has_raw_files(session: Session, found: StoredRun, *, whole: bool = False) -> bool:
    """Whether the store can read a recording of a run, or all of them."""
    stored = [recording.compression is not None for recording in recordings_of(session, found)]
    if not stored or stated_of(session, found) is None:
        return False
    return all(stored) if whole else any(stored)


def source_of(session: Session, row: RunRow) -> Source | None:
    """RUN.toml of a run; of a corrected one, that of the run as it was."""
    versions: Sequence[int] = [row.id]
    if row.supersedes is not None:
        versions = run_versions(session, row)
    return session.scalars(select(Source).where(Source.run_id.in_(versions)).order_by(Source.digest)).first()
