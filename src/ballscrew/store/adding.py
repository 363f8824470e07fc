"""Addition of runs, models, events and data sheets: the same content any number of times counts once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError, shown
from ballscrew.base.files import Progress, read_whole
from ballscrew.base.jsonfile import plain, read_json
from ballscrew.base.provenance import digest, hash_file
from ballscrew.base.tomlfile import read_toml
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.method import method_of
from ballscrew.calibration.modelfile import KIND, model_from_json, model_json
from ballscrew.modal.amend import SUPERSEDES
from ballscrew.modal.job import Job, read_run
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import Event, moment, read_events
from ballscrew.store.folder import now
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.raw_files import put_file
from ballscrew.store.tables import (
    Axis,
    CellRow,
    Conflict,
    Document,
    EventRow,
    MachineRow,
    Method,
    Model,
    RawFile,
    RecordingRow,
    ResultRow,
    RunRow,
    Source,
    pack,
    unpack,
)

METHOD_REVISION = 1
"""Raised only when a method gives other numbers for the same recordings and settings."""

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


def add(
    store: OpenStore,
    path: str | Path,
    *,
    axis: str | None = None,
    machine: str | None = None,
    site: str | None = None,
    method: str = "joint",
    progress: Progress | None = None,
) -> Added:
    """Add a file to a store, whole or not at all.

    Parameters
    ----------
    store : OpenStore
        The store.
    path : path-like
        RUN.toml (it is analysed, and its raw files are stored), RUN.json, MODEL.json, EVENTS.toml or a data
        sheet.
    axis : str, optional
        Name of the axis, for EVENTS.toml.
    machine, site : str, optional
        Machine of the axis and its site, for a data sheet.
    method : {"joint", "paper"}
        Method of the analysis of RUN.toml.
    progress : callable, optional
        As for :func:`ballscrew.analyze`.

    Returns
    -------
    Added
        What was added.

    Raises
    ------
    InputError
        If the file is none of these, or contradicts what the store contains.
    """
    path = Path(path)
    if path.suffix.lower() == ".json":
        document = read_json(path)
        if document.get("kind") == KIND:
            return add_model(store, model_from_json(document, path.name))
        return add_run(store, Run.from_json(document, path.name), name=path.name)
    fields = read_toml(path)
    if "files" in fields:
        return add_recordings(store, path, method=method, progress=progress)
    if "events" in fields:
        if axis is None:
            raise InputError(f"{path}: does not state the axis of its events; give its name (--axis).")
        return add_events(store, read_events(path), axis)
    if "screw" in fields:
        return add_sheet(store, path, machine=machine, site=site)
    raise InputError(f"{path}: is none of RUN.toml, RUN.json, MODEL.json, EVENTS.toml and a data sheet.")


def add_run(store: OpenStore, run: Run, *, name: str = "the run") -> Added:
    """Add an analysed run, without its raw files.

    Parameters
    ----------
    store : OpenStore
        The store.
    run : Run
        Analysed.
    name : str
        Its file, for messages.

    Returns
    -------
    Added
        The run.

    Raises
    ------
    InputError
        If it names no axis, or the store has another result of it, which stays; this one is stored among the
        conflicts.
    """
    with store.write("store add") as session:
        added = insert_run(session, run)
    return _checked(added, name)


def add_recordings(
    store: OpenStore, path: Path, *, method: str = "joint", progress: Progress | None = None
) -> Added:
    """Analyse RUN.toml, and add the run with its raw files.

    Parameters
    ----------
    store : OpenStore
        The store.
    path : Path
        RUN.toml.
    method : {"joint", "paper"}
        Method of the analysis.
    progress : callable, optional
        As for :func:`ballscrew.analyze`.

    Returns
    -------
    Added
        The run.

    Raises
    ------
    InputError
        If it cannot be analysed or stored; nothing was added.
    """
    from ballscrew.modal.analyze import AnalysisOptions, examine

    job = Job.of(path, None, None, None, None, None, None)
    options = AnalysisOptions(method=method)
    recordings = job.inputs_read[len(job.documents) :]
    hashes = list(map(hash_file, recordings))
    stated = {
        "documents": job.inputs(),
        "mass_kg": job.mass,
        "measured_at": job.measured_at,
        "temperature_C": job.temperature,
        "files": hashes,
    }
    key = digest(stated)
    with store.read() as session:
        known = _analysed_before(session, key, digest(plain(options.to_settings())))
    if known is not None:
        return known
    run = examine(job, options, progress=progress).run
    if sorted(file.sha256 for file in run.files) != sorted(hashes):
        raise InputError(f"{path}: its recordings have changed during the analysis; nothing was added.")
    texts = _document_texts(path, job)
    by_hash = dict(zip(hashes, recordings, strict=True))
    with store.write("store add") as session:
        added = insert_run(session, run)
        if not added.conflict:
            for sha256, file in by_hash.items():
                _keep_file(session, store, sha256, file)
            _insert_source(session, added.subject, key, stated, texts)
    return _checked(added, path.name)


def _checked(added: Added, name: str) -> Added:
    if added.conflict:
        raise InputError(
            f"{name}: the store has another result of the run {shown(added.subject[:12])} by the same method "
            "and settings, which stays; this one is stored among the conflicts."
        )
    return added


def _analysed_before(session: Session, key: str, settings: str) -> Added | None:
    """The run of a RUN.toml that was analysed by this method and revision; None if it was not."""
    found = session.execute(
        select(RunRow.run, Axis.name)
        .join(Source, Source.run_id == RunRow.id)
        .join(Axis, Axis.id == RunRow.axis_id)
        .join(ResultRow, ResultRow.run_id == RunRow.id)
        .join(Method, Method.id == ResultRow.method_id)
        .where(
            Source.digest == key,
            Method.settings_digest == settings,
            Method.revision == METHOD_REVISION,
        )
    ).first()
    return None if found is None else Added("run", found[0], found[1], is_new=False)


def insert_run(session: Session, run: Run, revision: int = METHOD_REVISION) -> Added:
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
        If it names no axis, or has no usable id or time.
    """
    if run.axis is None:
        raise InputError(f"{run.name}: names no axis; analyse it with a data sheet (--axis).")
    check_key("the run's id", run.id)
    run = Run.from_json(run.to_json(), run.name)  # nine digits, as RUN.json has them
    row = session.scalar(select(RunRow).where(RunRow.run == run.id))
    content = pack(run.to_json())
    if row is None:
        row = _insert_run_row(session, run, axis_row(session, str(run.axis)))
    axis = session.get_one(Axis, row.axis_id)
    if (axis.name, row.measured_at, row.mass_kg) != (run.axis, run.measured_at, run.mass_kg):
        return _conflict(session, run, content)
    method = method_row(session, run, revision)
    known = session.scalar(
        select(ResultRow).where(ResultRow.run_id == row.id, ResultRow.method_id == method.id)
    )
    if known is not None:
        if _agree(_content(unpack(known.document)), _content(run.to_json())):
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
    record(session, "add", f"run {run.id}", axis=axis.name, result=digest(run.to_json()))
    return Added("run", run.id, axis.name, is_new=True, notes=_notes(run))


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


def _notes(run: Run) -> tuple[str, ...]:
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
        record(session, "refuse", f"run {run.id}", result=key)
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


def _keep_file(session: Session, store: OpenStore, sha256: str, path: Path) -> None:
    """Store a raw file, unless it is there."""
    row = session.get(RawFile, sha256)
    if row is not None and row.archived_to is None:
        return
    stored = put_file(store.folder.files, path, sha256)
    if row is not None:
        row.archived_to = None
        row.stored_size, row.compression = stored.stored_size, stored.compression
        return
    session.add(
        RawFile(
            sha256=sha256,
            size=stored.size,
            stored_size=stored.stored_size,
            compression=stored.compression,
            archived_to=None,
            added_at=now(),
        )
    )


def _document_texts(path: Path, job: Job) -> dict[str, tuple[str, str]]:
    """Digest and text of each document of a RUN.toml, by its kind."""
    files, digests = read_run(path), job.inputs()
    texts = {}
    for kind, file in (("axis", files.axis), ("plan", files.plan), ("channels", files.channels)):
        if file is not None:
            texts[kind] = (digests[kind], read_whole(file).decode("utf-8-sig"))
    return texts


def _insert_source(
    session: Session, run: str, key: str, stated: Mapping[str, Any], texts: Mapping[str, tuple[str, str]]
) -> None:
    row = session.scalars(select(RunRow).where(RunRow.run == run)).all()[0]
    for kind, (document, text) in texts.items():
        insert_document(session, kind, document, text, row.axis_id if kind == "axis" else None)
    if session.get(Source, key) is None:
        session.add(Source(digest=key, run_id=row.id, stated=dict(stated)))
        record(session, "keep", f"run {run}", files=list(stated["files"]))


def insert_document(session: Session, kind: str, key: str, text: str, axis: int | None) -> bool:
    """Add a data sheet, plan or channel map; False if it is there."""
    if session.get(Document, key) is not None:
        return False
    session.add(Document(digest=key, kind=kind, axis_id=axis, text=text, added_at=now()))
    session.flush()
    return True


def add_model(store: OpenStore, model: CalibratedAxis) -> Added:
    """Add the model of an axis; the first is used until another one is chosen.

    Parameters
    ----------
    store : OpenStore
        The store.
    model : CalibratedAxis
        Calibrated.

    Returns
    -------
    Added
        The model.

    Raises
    ------
    InputError
        If it names no axis.
    """
    if not model.axis:
        raise InputError("the model names no axis; calibrate it with runs that do.")
    document = model_json(model)
    key = digest(document)
    with store.write("store add") as session:
        axis = axis_row(session, model.axis)
        is_new = session.get(Model, key) is None
        if is_new:
            session.add(Model(digest=key, axis_id=axis.id, document=pack(document), added_at=now()))
            axis.changed_at = now()
            record(session, "add", f"model {key}", axis=axis.name)
    return Added("model", key, model.axis, is_new=is_new)


def add_events(store: OpenStore, events: tuple[Event, ...], axis: str) -> Added:
    """Add events on an axis, each once.

    Parameters
    ----------
    store : OpenStore
        The store.
    events : tuple of Event
        Events.
    axis : str
        Name of the axis.

    Returns
    -------
    Added
        New if one of them is.
    """
    is_new = False
    with store.write("store add") as session:
        row = axis_row(session, axis)
        for event in events:
            key = digest({"axis": axis, "at": event.at, "kind": event.kind, "text": event.text})
            if session.scalar(select(EventRow.id).where(EventRow.digest == key)) is None:
                session.add(
                    EventRow(
                        digest=key,
                        axis_id=row.id,
                        at=event.at,
                        time=event.when.timestamp(),
                        kind=event.kind,
                        text=event.text,
                        added_at=now(),
                    )
                )
                session.flush()
                row.changed_at = now()
                record(session, "add", f"event {key}", axis=axis, at=event.at, kind=event.kind)
                is_new = True
    return Added("events", axis, axis, is_new=is_new)


def add_sheet(store: OpenStore, path: Path, *, machine: str | None = None, site: str | None = None) -> Added:
    """Add a version of the data sheet of an axis, and say on which machine the axis is.

    Parameters
    ----------
    store : OpenStore
        The store.
    path : Path
        The data sheet.
    machine, site : str, optional
        Machine of the axis, and its site.

    Returns
    -------
    Added
        New if this version is, or the machine changes.
    """
    sheet = read_axis(path)
    text, key = read_whole(path).decode("utf-8-sig"), digest(sheet.to_settings())
    with store.write("store add") as session:
        axis = axis_row(session, sheet.name)
        is_new = insert_document(session, "axis", key, text, axis.id)
        if machine is not None:
            place = _machine_row(session, machine, site or "")
            is_new = is_new or axis.machine_id != place.id
            axis.machine_id = place.id
        if is_new:
            record(session, "add", f"data sheet {key}", axis=axis.name, machine=machine, site=site)
    return Added("data sheet", key, sheet.name, is_new=is_new)


def axis_row(session: Session, name: str) -> Axis:
    """Row of an axis, new where there is none."""
    row = session.scalar(select(Axis).where(Axis.name == name))
    if row is None:
        check_key("the name of the axis", name)
        row = Axis(name=name, runs=0)
        session.add(row)
        session.flush()
    return row


def _machine_row(session: Session, name: str, site: str) -> MachineRow:
    row = session.scalar(select(MachineRow).where(MachineRow.name == name, MachineRow.site == site))
    if row is None:
        check_key("the name of the machine", name)
        check_key("the name of the site", site)
        row = MachineRow(name=name, site=site)
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
    """Check that a text is short enough for a key."""
    if len(value) > _LONGEST_NAME:
        raise InputError(f"{what} has {len(value)} characters; it must have {_LONGEST_NAME} at most.")
