"""Verification of a store against its hashes, and removal of files that no row refers to."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

from sqlalchemy import func, inspect, select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.modal.run import Run
from ballscrew.store.folder import DataFolder
from ballscrew.store.inserting import cell_rows
from ballscrew.store.migrating import sqlite_faults
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.raw_files import hash_of, path_of
from ballscrew.store.rows import Base, checksum_of, unpack
from ballscrew.store.service_tables import all_rows
from ballscrew.store.tables import (
    Assessment,
    Audit,
    Axis,
    CellRow,
    Document,
    RawFile,
    RecordingRow,
    ResultRow,
    RunRow,
    Source,
    StateRow,
)

_BATCH = 500  # rows in memory
_MOST = 1000  # faults that are reported
# Table into which an action of the audit inserts one row; the first word of the subject of an addition too.
_INSERTED = {
    "refuse": "conflicts", "assess": "assessments", "exclude": "exclusions", "raise": "alarms",
    "keep": "sources", "switch": "corrections", "add run": "results", "add model": "models",
    "add event": "events",
}  # fmt: skip
_CORRECTED = {"measured_at", "mass_kg", "model"}  # fields of which a correction has a row each


@dataclass(frozen=True, slots=True)
class Verification:
    """Result of :func:`verify`.

    Parameters
    ----------
    faults : tuple of str
        What is damaged or missing, a sentence each; the store is then only read.
    files, rows : int
        Raw files and rows that were verified.
    orphans : tuple of str
        Files that no row refers to, which ``gc`` removes.
    """

    faults: tuple[str, ...]
    files: int
    rows: int
    orphans: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Document of ``store verify --json``."""
        return {
            "schema": SCHEMA,
            "faults": list(self.faults),
            "files": self.files,
            "rows": self.rows,
            "orphans": list(self.orphans),
        }


def verify(path: str | Path) -> Verification:
    """Read every file and row of a store back, and compare it with its hash.

    A store with a fault is only read from then on, until a verification finds none.

    Parameters
    ----------
    path : path-like
        Data folder of the store.

    Returns
    -------
    Verification
        Its faults.

    Raises
    ------
    InputError
        If there is no store, or its database server cannot be reached.
    """
    folder = DataFolder(Path(path))
    faults: list[str] = []
    if folder.database_url() is None:
        if not folder.sqlite.exists():
            faults.append("database: store.sqlite is missing")
        else:
            faults += sqlite_faults(folder.sqlite)
    counts, orphans = [0, 0], []
    try:
        store = OpenStore(path)
        with store.read() as session:
            for fault in _row_faults(session, counts):
                faults.append(fault)
            files = session.execute(
                select(RawFile.sha256, RawFile.compression).where(RawFile.is_stored).order_by(RawFile.sha256)
            ).all()
            orphans = [str(orphan.relative_to(folder.path)) for orphan in _orphans(session, folder)]
        # Without an open reader: it takes hours for many files, and others add meanwhile.
        counts[1] = len(files)
        for sha256, compression in files:
            faults += _file_faults(store, sha256, compression)
    except InputError as error:
        if not faults and not re.search("damaged|contains no store", str(error)):
            raise
        faults.append(str(error))
    except ValueError as error:  # of a column with JSON
        faults.append(f"database: a row cannot be read ({error})")
    found = Verification(tuple(faults[:_MOST]), counts[1], counts[0], tuple(orphans))
    with suppress(InputError):  # a folder that cannot be written needs no mark
        folder.mark_damaged(list(found.faults))
    folder.note_check("verification", faults=len(found.faults), files=found.files, rows=found.rows)
    return found


def _row_faults(session: Session, counts: list[int]) -> Iterator[str]:
    """Faults of rows: by their checksums, of a result by its RUN.json."""
    for kind in all_rows():
        for row in session.scalars(select(kind).execution_options(yield_per=_BATCH)):
            counts[0] += 1
            if row.checksum != checksum_of(row):
                key = inspect(row).identity
                yield f"database: the row {key} of {kind.__name__} is not that of its checksum"
            if row in session:  # a damaged table may have a row twice
                session.expunge(row)
    query = select(ResultRow, RunRow).join(RunRow, RunRow.id == ResultRow.run_id)
    for result, run in session.execute(query.execution_options(yield_per=_BATCH)):
        if not _has_its_rows(session, result, run):
            yield f"database: cells or recordings of the run {run.run[:12]} are not those of its result"
    yield from _axis_faults(session)
    yield from _audit_faults(session)
    yield from _source_faults(session)


def _audit_faults(session: Session) -> Iterator[str]:
    """Missing rows of the audit, each of which has the checksum of the one before; what contradicts it."""
    inserted: Counter[str] = Counter()
    former = None
    query = select(Audit.id, Audit.checksum, Audit.action, Audit.subject, Audit.detail).order_by(Audit.id)
    for number, checksum, action, subject, detail in session.execute(
        query.execution_options(yield_per=_BATCH)
    ):
        if detail.get("after") != former:
            yield f"database: rows of the audit before its row {number} are missing or were changed"
        former = checksum
        inserted += _inserted_by(action, subject, detail)
    for name in sorted({*_INSERTED.values(), "method_changes"}):
        count = session.scalar(select(func.count()).select_from(Base.metadata.tables[name]))
        if count != inserted[name]:
            yield f"database: {name} has {count} rows, and by the audit {inserted[name]} were inserted"


def _inserted_by(action: str, subject: str, detail: Mapping[str, Any]) -> Counter[str]:
    """Number of rows that were inserted into each table, by a row of the audit."""
    if action == "simulate":
        return Counter(results=detail["runs"], models=1, assessments=1)
    if action == "switch" and "step" in detail and "replaced" not in detail:
        return Counter(corrections=1, method_changes=1)
    if action == "correct":
        return Counter(corrections=len(_CORRECTED & detail.keys()))
    if action == "add":
        action = f"add {subject.split()[0]}"
    table = _INSERTED.get(action)
    return Counter() if table is None else Counter([table])


def _source_faults(session: Session) -> Iterator[str]:
    """Raw files and documents of runs that have no row."""
    for source, run in session.execute(
        select(Source, RunRow.run)
        .join(RunRow, RunRow.id == Source.run_id)
        .execution_options(yield_per=_BATCH)
    ):
        needed: list[tuple[type[Base], str]] = []
        needed += [(RawFile, key) for key in source.stated["files"]]
        needed += [(Document, key) for key in source.stated["documents"].values()]
        for kind, key in needed:
            if session.get(kind, key) is None:
                yield f"database: {key[:12]}, which the run {run[:12]} was analysed from, has no row"


def _axis_faults(session: Session) -> Iterator[str]:
    """Axes whose runs, states, assessment or model are not in the store, and runs without a result."""
    for run in session.scalars(select(RunRow.run).where(RunRow.id.not_in(select(ResultRow.run_id)))):
        yield f"database: the result of the run {run[:12]} is missing"
    numbers = _counts(session, RunRow.axis_id)
    states = _counts(session, StateRow.axis_id)
    newest = select(Axis.id, Axis.name, Assessment.runs).join(Assessment, Assessment.id == Axis.assessment_id)
    for axis, name, assessed in session.execute(newest):
        if assessed != states.get(axis, 0):
            yield f"database: states of the runs of the axis {name} are missing"
    axes = select(Axis.id, Axis.name, Axis.runs, Axis.assessment_id, Axis.model_digest)
    for axis, name, runs, assessment, model in session.execute(axes):
        if runs != numbers.get(axis, 0):
            yield f"database: runs of the axis {name} are missing"
        if not _exists(session, "assessments", "id", assessment) or not _exists(
            session, "models", "digest", model
        ):
            yield f"database: the assessment or the model of the axis {name} is missing"


def _counts(session: Session, axis: Any) -> dict[int, int]:
    """Number of rows of each axis."""
    found = session.execute(select(axis, func.count()).group_by(axis))
    return {number: count for number, count in found}  # noqa: C416  rows are no pairs to mypy


def _exists(session: Session, table: str, column: str, key: Any) -> bool:
    """Whether there is a row of a key, or no key."""
    rows = Base.metadata.tables[table]
    found = select(rows.c[column]).where(rows.c[column] == key)
    return key is None or session.execute(found).first() is not None


def _has_its_rows(session: Session, result: ResultRow, run: RunRow) -> bool:
    """Whether cells and recordings are those of RUN.json."""
    try:
        document = Run.from_json(unpack(result.document))
    except InputError:
        return False
    names = [column.key for column in inspect(CellRow).columns]
    stored = session.execute(
        select(*(getattr(CellRow, name) for name in names))
        .where(CellRow.result_id == result.id)
        .order_by(CellRow.place)
    ).all()
    values = attrgetter(*names)
    if list(map(tuple, stored)) != list(map(values, cell_rows(document, result.id))):
        return False
    recordings = session.scalars(
        select(RecordingRow).where(RecordingRow.run_id == run.id).order_by(RecordingRow.place)
    ).all()
    hashes = sorted(row.sha256 for row in recordings)
    return document.id == run.run and hashes == sorted(file.sha256 for file in document.files)


def _file_faults(store: OpenStore, sha256: str, compression: str) -> list[str]:
    """Fault of a raw file: missing, or of another content."""
    path = path_of(store.folder.files, sha256, compression)
    name = path.relative_to(store.path)
    try:
        if hash_of(path, compression) == sha256:
            return []
        return [f"{name}: the content is not that of its hash"]
    except InputError:
        if path.exists():
            return [f"{name}: the file cannot be read"]
    with store.read() as session:
        row = session.get(RawFile, sha256)
    if row is None or row.is_stored:
        return [f"{name}: the file is missing"]
    return []


def _orphans(session: Session, folder: DataFolder) -> list[Path]:
    """Files that no row refers to."""
    known = set()
    rows = select(RawFile.sha256, RawFile.compression).where(RawFile.is_stored)
    for sha256, compression in session.execute(rows):
        known.add(path_of(folder.files, sha256, compression))
    found = {path for path in folder.files.rglob("*") if path.is_file()}
    return sorted(found - known) + sorted(folder.path.glob("store.migrating*"))


def gc(store: OpenStore, *, dry_run: bool = False) -> dict[str, Any]:
    """Remove the files that no row refers to: of additions that were interrupted, and archived ones.

    Parameters
    ----------
    store : OpenStore
        The store.
    dry_run : bool
        Whether they are only listed.

    Returns
    -------
    dict
        Document of ``store gc --json``.

    Raises
    ------
    InputError
        If the store is damaged or in use.
    """
    removed, size = [], 0
    with store.write("store gc") as session:
        for path in _orphans(session, store.folder):
            size += path.stat().st_size
            removed.append(str(path.relative_to(store.path)))
            if not dry_run:
                path.unlink()
        if removed and not dry_run:
            record(session, "gc", "files", removed=removed, bytes=size)
    return {"schema": SCHEMA, "removed": removed, "bytes": size, "dry_run": dry_run}
