"""Backup, restoration, archive and export of a store."""

from __future__ import annotations

import json
import secrets
import shutil
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, create_engine, insert, select, text
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError
from ballscrew.base.files import move_file, sync_folder, write_text
from ballscrew.base.jsonfile import SCHEMA, write_json
from ballscrew.base.provenance import digest
from ballscrew.store.checking import verify
from ballscrew.store.database import connect_sqlite, make_engine, sqlite_url, translated, undisturbed
from ballscrew.store.folder import DataFolder, check_outside_stores
from ballscrew.store.histories import axis_events
from ballscrew.store.methods import used_result
from ballscrew.store.migrating import copy_sqlite, settle, upgrade
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.raw_files import clone_file, copy_out, make_folder, path_of
from ballscrew.store.reading import current_rows, find_axis
from ballscrew.store.retention import dispensable_files
from ballscrew.store.rows import unpack
from ballscrew.store.service_tables import all_tables
from ballscrew.store.showing import run_document
from ballscrew.store.tables import Axis, Document, Model, RawFile, RecordingRow, RunRow, Source

_ATTEMPTS = 5  # files may be removed meanwhile
_BATCH = 1000  # rows in memory


class _RemovedError(Exception):
    """Files were archived or deleted while they were copied: the copy is made again."""


def backup(store: OpenStore, to: str | Path) -> Path:
    """Copy a store as it is at one moment, while others add to it.

    Parameters
    ----------
    store : OpenStore
        The store.
    to : path-like
        New folder. It is a store with SQLite, whatever the database of the original.

    Returns
    -------
    Path
        The folder, complete and durable.

    Raises
    ------
    InputError
        If the folder exists, a file is damaged, or something cannot be written.
    """
    for _ in range(_ATTEMPTS):
        is_complete = False
        with suppress(_RemovedError), translated(store.path), _new_folder(Path(to)) as temporary:
            copy = DataFolder(temporary)
            copy.files.mkdir()
            _copy_database(store, copy.sqlite)
            _copy_files(_stored_files(copy.sqlite), store.folder, copy.files)
            copy.create(None)
            is_complete = True
        if is_complete:
            store.folder.note_check("backup")
            return Path(to)
    raise InputError(f"{store.path}: files are archived or deleted all the time; try again.")


@contextmanager
def _new_folder(final: Path) -> Iterator[Path]:
    """Temporary folder that becomes ``final`` at the end, complete and durable, or does not exist."""
    check_outside_stores(final.parent)
    if final.exists():
        raise InputError(f"{final}: exists; give a new folder.")
    temporary = None
    try:
        # Folders of tempfile stay closed to other users on Windows.
        new = final.with_name(f".{final.name[:40]}-{secrets.token_hex(4)}")
        new.mkdir()
        temporary = new
        yield temporary
        for path in sorted(temporary.rglob("*")):
            if path.is_dir():
                sync_folder(path)
        sync_folder(temporary)
        temporary.chmod(0o755)
        move_file(temporary, final)
        sync_folder(final.parent)
    except OSError as error:
        raise InputError(f"{final}: cannot be written ({error.strerror or error}).") from None
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def _copy_database(store: OpenStore, target: Path) -> None:
    """Copy all rows into a new SQLite database."""
    if store.folder.database_url() is None:
        path = store.folder.sqlite
        with undisturbed(path), closing(connect_sqlite(path)) as source:
            copy_sqlite(source, target)
    else:
        target.touch()
        engine = make_engine(sqlite_url(target), writing=True)
        with store.engine(writing=False).connect() as rows, engine.begin() as copied:
            upgrade(copied, target, new=True)
            _copy_rows(rows, copied)
    settle(target)


def _copy_rows(source: Connection, target: Connection) -> None:
    """Copy all rows of a database into one without rows."""
    for table in all_tables():
        rows = source.execute(select(table).execution_options(yield_per=_BATCH)).mappings()
        for batch in rows.partitions():
            target.execute(insert(table), list(map(dict, batch)))
        if "id" in table.c and target.dialect.name == "postgresql":
            sequence = f"pg_get_serial_sequence('{table.name}', 'id')"
            newest = f"(SELECT max(id) FROM {table.name})"  # noqa: S608  names of the schema
            target.execute(text(f"SELECT setval({sequence}, {newest}) WHERE {newest} IS NOT NULL"))


def _stored_files(database: Path) -> list[tuple[str, str]]:
    """Hash and compression of the raw files that are in a store with SQLite."""
    engine = create_engine(sqlite_url(database))
    with Session(engine) as session:
        rows = session.execute(select(RawFile.sha256, RawFile.compression).where(RawFile.is_stored)).all()
    engine.dispose()
    return [(sha256, compression) for sha256, compression in rows]


def _copy_files(files: list[tuple[str, str]], original: DataFolder, to: Path) -> None:
    """Copy the raw files that the rows of a copy refer to."""
    for sha256, compression in files:
        source = path_of(original.files, sha256, compression)
        if source.is_file():
            clone_file(source, to, sha256, compression)
        elif _is_removed(original, sha256):
            raise _RemovedError
        else:
            raise InputError(f"{source}: the file is missing: the store is damaged, see 'store verify'.")


def _is_removed(folder: DataFolder, sha256: str) -> bool:
    with OpenStore(folder.path).read() as session:
        row = session.get(RawFile, sha256)
        return row is not None and not row.is_stored


def restore(backup_folder: str | Path, to: str | Path, *, database: str | None = None) -> OpenStore:
    """Restore a backup to a new folder, after it was verified.

    Parameters
    ----------
    backup_folder : path-like
        The backup, which stays.
    to : path-like
        New folder.
    database : str, optional
        URL of an empty PostgreSQL database; by default SQLite in the folder.

    Returns
    -------
    OpenStore
        The restored store.

    Raises
    ------
    InputError
        If the backup is damaged, or the folder or the database is not empty.
    """
    found = verify(backup_folder)
    if found.faults:
        raise InputError(f"{backup_folder}: the backup is damaged and was not restored: {found.faults[0]}.")
    source = OpenStore(backup_folder)
    if database is None:
        return OpenStore(backup(source, to))
    with translated(to), _new_folder(Path(to)) as temporary:
        copy = DataFolder(temporary)
        copy.files.mkdir()
        _copy_files(_stored_files(source.folder.sqlite), source.folder, copy.files)
        engine = make_engine(database, writing=True)
        with source.engine(writing=False).connect() as rows, engine.begin() as connection:
            upgrade(connection, to, new=True)
            _copy_rows(rows, connection)
        copy.create(database)
    return OpenStore(to)


def archive(store: OpenStore, axis: str, to: str | Path, *, newest: int = 30) -> dict[str, Any]:
    """Move raw files of an axis to another folder; results stay, and are no longer reprocessed.

    Raw files stay of the newest runs, of the references of epochs, and of runs at which an alarm began.

    Parameters
    ----------
    store : OpenStore
        The store.
    axis : str
        Name of the axis.
    to : path-like
        Folder, which may contain other archived files.
    newest : int
        Runs whose raw files stay.

    Returns
    -------
    dict
        Document of ``store archive --json``.

    Raises
    ------
    InputError
        If there is no such axis, or a file cannot be copied; it then stays in the store.
    """
    target = Path(to)
    check_outside_stores(target)
    if newest < 0:
        raise InputError(f"the number of newest runs is {newest}; it must be 0 or more.")
    try:
        make_folder(target)
    except OSError as error:
        raise InputError(f"{target}: cannot be created ({error.strerror or error}).") from None
    moved, size = [], 0
    files = _clone_files(store, axis, target, newest)
    with store.write("store archive") as session:
        for row in dispensable_files(session, find_axis(session, axis), newest):
            if (row.sha256, row.compression) in files:
                row.archived_to = str(target.resolve())
                moved.append((row.sha256, row.compression))
                size += row.stored_size
        if moved:
            files_moved = [sha256 for sha256, _ in moved]
            record(session, "archive", f"axis {axis}", axis=axis, to=str(target), files=files_moved)
    with store.write("store archive") as session:  # what is left here by a kill, gc removes
        for sha256, compression in moved:
            if not session.get_one(RawFile, sha256).is_stored:  # it was not added again
                path_of(store.folder.files, sha256, compression).unlink(missing_ok=True)
    return {"schema": SCHEMA, "axis": axis, "to": str(target), "files": len(moved), "bytes": size}


def _clone_files(store: OpenStore, axis: str, target: Path, newest: int) -> set[tuple[str, str]]:
    """Copy the raw files that are to be moved, durably, before the lock is taken: others write meanwhile."""
    with store.read() as session:
        rows = dispensable_files(session, find_axis(session, axis), newest)
        files = {(row.sha256, row.compression) for row in rows}
    for sha256, compression in sorted(files):
        clone_file(path_of(store.folder.files, sha256, compression), target, sha256, compression)
    return files


def export(store: OpenStore, axis: str, to: str | Path, *, raw: bool = False) -> Path:
    """Write the history of an axis as files for the other commands.

    Parameters
    ----------
    store : OpenStore
        The store.
    axis : str
        Name of the axis.
    to : path-like
        New folder: ``runs/*.json``, ``events.toml``, ``models/*.json``, ``sheets/*.toml`` and
        ``provenance.json``, which states for each run what :func:`~ballscrew.store.showing.show_run` does.
    raw : bool
        Whether the raw files that the store has are written too, with the documents of their runs.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    InputError
        If there is no such axis, or the folder exists or cannot be written.
    """
    with store.read() as session, _new_folder(Path(to)) as folder:
        row = find_axis(session, axis)
        _export_results(session, row, folder)
        for model in session.scalars(select(Model).where(Model.axis_id == row.id)):
            _write(folder / "models" / f"{model.digest[:12]}.json", write_json(unpack(model.document)) + "\n")
        for sheet in session.scalars(select(Document).where(Document.axis_id == row.id)):
            _write(folder / "sheets" / f"{sheet.digest[:12]}.toml", sheet.text)
        events = ["[[events]]\n" + _toml(event.to_json().items()) for event in axis_events(session, row)]
        _write(folder / "events.toml", "\n".join(events))
        if raw:
            _export_raw(session, store, row, folder)
    return Path(to)


def _export_results(session: Session, axis: Axis, folder: Path) -> None:
    provenance = []
    for row in current_rows(session, axis):
        provenance.append(run_document(session, session.get_one(RunRow, row.id), axis))
        result = used_result(session, axis, row.id)
        if result is not None:
            document = unpack(result.document)
            _write(folder / "runs" / f"{file_name(row)}.json", write_json(document) + "\n")
    document = {"schema": SCHEMA, "axis": axis.name, "runs": provenance}
    _write(folder / "provenance.json", write_json(document) + "\n")


def _export_raw(session: Session, store: OpenStore, axis: Axis, folder: Path) -> None:
    """Each run with its RUN.toml, the documents that it names and its raw files."""
    sources = session.execute(
        select(Source, RunRow).join(RunRow, RunRow.id == Source.run_id).where(RunRow.axis_id == axis.id)
    ).all()
    for source, run in sources:
        place = folder / "recordings" / file_name(run)
        stated = source.stated
        names = []
        for number, sha256 in enumerate(stated["files"]):
            file = session.get(RawFile, sha256)
            if file is not None and file.is_stored:
                name = f"{number:03d}-{Path(_name(session, run, sha256)).name or 'recording'}"
                place.mkdir(parents=True, exist_ok=True)
                path = path_of(store.folder.files, sha256, file.compression)
                copy_out(path, file.compression, place / name, sha256)
                names.append(name)
        fields: list[tuple[str, Any]] = [("files", names)]
        for kind, key in stated["documents"].items():
            document = session.get(Document, key)
            if document is not None:
                _write(place / f"{kind}.toml", document.text)
                fields.append((kind, f"{kind}.toml"))
        fields += stated_fields(stated)
        _write(place / "run.toml", _toml(fields))


def stated_fields(stated: dict[str, Any]) -> list[tuple[str, Any]]:
    """Load, time and temperature as RUN.toml states them."""
    fields = []
    if stated["mass_kg"] is not None:
        fields.append(("load", f"{stated['mass_kg']!r} kg"))
    if stated["measured_at"] is not None:
        fields.append(("measured_at", stated["measured_at"]))
    if stated["temperature_C"] is not None:
        fields.append(("temperature", f"{stated['temperature_C']!r} degC"))
    return fields


def _name(session: Session, run: RunRow, sha256: str) -> str:
    """Name of a recording of a run."""
    found = select(RecordingRow.name).where(RecordingRow.run_id == run.id, RecordingRow.sha256 == sha256)
    return session.scalars(found).first() or "recording"


def file_name(row: Any) -> str:
    """Name of a run in an export: its day and the digest of its id, which may be any text."""
    day = (row.measured_at or "no-time")[:10]
    return f"{day}-{digest(row.run)[:12]}"


def _toml(fields: Any) -> str:
    """Lines of TOML; a text or a list of texts has the same form as in JSON."""
    lines = []
    for name, value in fields:
        text = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        lines.append(f"{name} = {text}\n")
    return "".join(lines)


def _write(path: Path, content: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, content)
