"""Addition of runs, models, events and data sheets: the same content any number of times counts once."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError
from ballscrew.base.files import Progress, read_whole
from ballscrew.base.jsonfile import plain, read_json
from ballscrew.base.provenance import digest, hash_file
from ballscrew.base.tomlfile import read_toml
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.modelfile import KIND, model_from_json, model_json
from ballscrew.modal.job import Job, read_run
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import METHOD_CHANGED, Event, read_events
from ballscrew.recording.readers import version_of
from ballscrew.recording.readers.process import opened
from ballscrew.store.folder import actor, now
from ballscrew.store.inserting import Added, axis_row, check_added, check_name, check_text, insert_run
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.parts import count_parts
from ballscrew.store.raw_files import StoredFile, path_of, put_file
from ballscrew.store.rows import pack
from ballscrew.store.tables import (
    Axis,
    Document,
    EventRow,
    MachineRow,
    Method,
    Model,
    RawFile,
    ResultRow,
    RunRow,
    Source,
)

_DAY = 86400.0  # s: clocks of two computers may differ
METHOD_REVISION = 1
"""Raised only when a method gives other numbers for the same recordings and settings."""


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
        added = insert_run(session, run, METHOD_REVISION)
        if added.is_new and not added.conflict:
            count_parts(session, added.subject, actor())
    return check_added(added, name)


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

    job = Job.read(path)
    options = AnalysisOptions(method=method)
    recordings = job.inputs_read[len(job.documents) :]
    hashes = list(map(hash_file, recordings))
    stated: dict[str, Any] = {
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
    stated["readers"] = [reader_of(Path(file)) for file in recordings]
    by_hash = dict(zip(hashes, recordings, strict=True))
    # Files are copied and durable before the lock is taken: others write meanwhile.
    stored = _put_files(store, by_hash)
    with store.write("store add") as session:
        added = insert_run(session, run, METHOD_REVISION)
        if not added.conflict:
            for sha256, file in by_hash.items():
                _insert_file(session, store, sha256, file, stored.get(sha256))
            insert_source(session, added.subject, key, stated, texts)
        if added.is_new and not added.conflict:
            count_parts(session, added.subject, actor())
    return check_added(added, path.name)


def reader_of(path: Path) -> str | None:
    """Name of the reader of a recording, with its package and version."""
    with suppress(InputError), opened(path) as file:
        return f"{file.reader}, {version_of(file.reader)}".rstrip(", ")
    return None


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


def _put_files(store: OpenStore, files: Mapping[str, str | Path]) -> dict[str, StoredFile]:
    """Store the raw files that the store does not have yet, by their hashes."""
    stored = {}
    for sha256, path in files.items():
        with store.read() as session:
            row = session.get(RawFile, sha256)
        if row is None or not row.is_stored:
            stored[sha256] = put_file(store.folder.files, Path(path), sha256)
    return stored


def _insert_file(
    session: Session, store: OpenStore, sha256: str, path: str | Path, stored: StoredFile | None
) -> None:
    """Insert the row of a raw file, unless it is there."""
    row = session.get(RawFile, sha256)
    if row is not None and row.is_stored:
        return
    folder = store.folder.files
    if stored is None or not path_of(folder, sha256, stored.compression).is_file():
        stored = put_file(folder, Path(path), sha256)  # it was archived or, without a row, removed meanwhile
    if row is not None:
        row.archived_to = row.deleted_at = None
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


def insert_source(
    session: Session, run: str, key: str, stated: Mapping[str, Any], texts: Mapping[str, tuple[str, str]]
) -> None:
    """Add what a run was analysed from, and its documents: digest and text by kind."""
    row = session.scalars(select(RunRow).where(RunRow.run == run)).all()[0]
    for kind, (document, text) in texts.items():
        insert_document(session, kind, document, text, row.axis_id if kind == "axis" else None)
    if session.get(Source, key) is None:
        session.add(Source(digest=key, run_id=row.id, stated=dict(stated)))
        axis = session.get_one(Axis, row.axis_id).name
        record(session, "keep", f"run {run}", axis=axis, files=list(stated["files"]))


def insert_document(session: Session, kind: str, key: str, text: str, axis: int | None) -> bool:
    """Add a data sheet, plan or channel map; False if it is there."""
    if session.get(Document, key) is not None:
        return False
    session.add(Document(digest=key, kind=kind, axis_id=axis, text=text, added_at=now()))
    session.flush()
    return True


def add_model(store: OpenStore, model: CalibratedAxis) -> Added:
    """Add the model of an axis: the only one is used; of several, one must be chosen.

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
    with store.write("store add") as session:
        _, is_new = insert_events(session, axis_row(session, axis), events)
    return Added("events", axis, axis, is_new=is_new)


def insert_events(session: Session, axis: Axis, events: tuple[Event, ...]) -> tuple[list[str], bool]:
    """Add events on an axis in a transaction that has begun.

    Parameters
    ----------
    session : Session
        Writing.
    axis : Axis
        The axis.
    events : tuple of Event
        Events.

    Returns
    -------
    tuple
        Digest of each event, and whether one of them is new.
    """
    digests, is_new = [], False
    for event in events:
        check_text("the text of an event", event.text)
        if event.kind == METHOD_CHANGED:
            raise InputError(f"an event {event.kind!r} is not added: 'reprocess --switch' makes it.")
        if event.when.timestamp() > time.time() + _DAY:
            raise InputError(f"{event.kind} at {event.at} lies in the future; check its date.")
        key = digest({"axis": axis.name, "at": event.at, "kind": event.kind, "text": event.text})
        digests.append(key)
        if session.scalar(select(EventRow.id).where(EventRow.digest == key)) is None:
            session.add(
                EventRow(
                    digest=key,
                    axis_id=axis.id,
                    at=event.at,
                    time=event.when.timestamp(),
                    kind=event.kind,
                    text=event.text,
                    added_at=now(),
                )
            )
            session.flush()
            axis.changed_at = now()
            record(session, "add", f"event {key}", axis=axis.name, at=event.at, kind=event.kind)
            is_new = True
    return digests, is_new


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
        changed = {}
        if machine is not None:
            place = _machine_row(session, machine, site or "")
            if axis.machine_id != place.id:
                former = (
                    None if axis.machine_id is None else session.get_one(MachineRow, axis.machine_id).name
                )
                is_new, changed = True, {"machine": [former, machine]}
            axis.machine_id = place.id
        if is_new:
            detail = {"axis": axis.name, "machine": machine, "site": site, "changed": changed}
            record(session, "add", f"data sheet {key}", **detail)
    return Added("data sheet", key, sheet.name, is_new=is_new)


def _machine_row(session: Session, name: str, site: str) -> MachineRow:
    row = session.scalar(select(MachineRow).where(MachineRow.name == name, MachineRow.site == site))
    if row is None:
        check_name("the name of the machine", name)
        if site:
            check_name("the name of the site", site)
        row = MachineRow(name=name, site=site)
        session.add(row)
        session.flush()
    return row
