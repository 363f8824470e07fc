"""Versions of the schema: creation of a store, and migration of an older one on a copy."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from pathlib import Path

from alembic import command
from alembic.config import Config
from sqlalchemy import Connection
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError
from ballscrew.base.files import sync_folder
from ballscrew.store.database import (
    connect_sqlite,
    make_engine,
    schema_of,
    sqlite_url,
    translated,
    undisturbed,
)
from ballscrew.store.folder import DataFolder
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.raw_files import make_folder
from ballscrew.store.tables import SCHEMA, SCHEMAS

_MIGRATIONS = Path(__file__).parent / "migrations"


def upgrade(connection: Connection, where: object, *, new: bool = False) -> None:
    """Bring the schema of a database to that of this version, in the transaction of a connection.

    Parameters
    ----------
    connection : Connection
        Writing.
    where : object
        The store, for messages.
    new : bool
        Whether the database must be without a store.

    Raises
    ------
    InputError
        If there is a store where there must be none, none where there must be one, or a newer one.
    """
    found = schema_of(connection)
    if new and found is not None:
        raise InputError(f"{where}: the database contains a store already.")
    if not new and found is None:
        raise InputError(f"{where}: the database contains no store.")
    if found is not None and found not in SCHEMAS:
        raise InputError(f"{where}: was written by a later version of ballscrew (schema {found}).")
    config = Config()
    config.set_main_option("script_location", str(_MIGRATIONS).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    config.attributes["connection"] = connection
    command.upgrade(config, SCHEMA)


def _record(connection: Connection, action: str, found: str | None) -> None:
    """Add the change of the schema to the audit."""
    with Session(connection) as session:
        record(session, action, "store", changed={"schema": [found, SCHEMA]})
        session.flush()


def create_store(path: str | Path, *, database: str | None = None) -> OpenStore:
    """Create an empty store.

    Parameters
    ----------
    path : path-like
        Data folder: created, or empty.
    database : str, optional
        URL of an empty PostgreSQL database; by default SQLite in the folder.

    Returns
    -------
    OpenStore
        The store.

    Raises
    ------
    InputError
        If there is a store already, the folder contains other files, or something cannot be written.
    """
    folder = DataFolder(Path(path))
    _check_new(folder)
    try:
        make_folder(folder.path)
        others = [each.name for each in folder.path.iterdir() if not _is_own(each.name)]
    except OSError as error:
        raise InputError(f"{path}: cannot be created ({error.strerror or error}).") from None
    if others:
        raise InputError(f"{path}: contains other files ({sorted(others)[0]}); give a new folder.")
    with translated(path), folder.locked("store init"):
        _check_new(folder)  # another process may have created one meanwhile
        if database is None:
            # Of a creation that was killed: a store has store.toml, which is written last.
            for part in folder.path.glob("store.sqlite*"):
                part.unlink()
            folder.sqlite.touch()
        engine = make_engine(database or sqlite_url(folder.sqlite), writing=True)
        with engine.begin() as connection:
            upgrade(connection, path, new=True)
            _record(connection, "create", None)
        folder.create(database)
    return OpenStore(path)


def _check_new(folder: DataFolder) -> None:
    if folder.exists():
        raise InputError(f"{folder.path}: is a store already.")


def _is_own(name: str) -> bool:
    """Whether a file is of a creation of a store that was interrupted."""
    return name in ("files", "server.toml") or name.startswith(("store.", ".store-"))


def migrate(path: str | Path) -> str:
    """Migrate a store to the schema of this version.

    SQLite: on a copy, which is checked and then replaces the database. PostgreSQL: in a transaction.

    Parameters
    ----------
    path : path-like
        Data folder of the store.

    Returns
    -------
    str
        Version that it had.

    Raises
    ------
    InputError
        If the store is damaged or of a later version; it is then as it was.
    """
    folder = DataFolder(Path(path))
    url = folder.database_url()
    folder.check_writable()
    with translated(path), folder.locked("store migrate"):
        engine = make_engine(url or sqlite_url(folder.sqlite), writing=True)
        with engine.begin() as connection:
            found = schema_of(connection)
            if url is not None and found != SCHEMA:
                upgrade(connection, path)
                _record(connection, "migrate", found)
        if url is None and found != SCHEMA:
            _migrate_copy(folder, found)
    return str(found)


def _migrate_copy(folder: DataFolder, found: str | None) -> None:
    copy = folder.path / "store.migrating"
    for name in (copy.name, f"{copy.name}-wal", f"{copy.name}-journal"):
        (folder.path / name).unlink(missing_ok=True)  # of a migration that was killed
    source = connect_sqlite(folder.sqlite, writing=True)
    try:
        # The old database must have no write-ahead log, which would be applied to the new one.
        if source.execute("PRAGMA journal_mode = DELETE").fetchone()[0] != "delete":
            raise InputError(f"{folder.path}: the store is being read; try again.")
        copy_sqlite(source, copy)
    finally:
        source.close()
    engine = make_engine(sqlite_url(copy), writing=True)
    with engine.begin() as connection:
        upgrade(connection, folder.path)
        _record(connection, "migrate", found)
    faults = sqlite_faults(copy)
    if faults:
        raise InputError(f"{folder.path}: the migration was abandoned: {faults[0]}.")
    settle(copy)
    try:
        copy.replace(folder.sqlite)
    except OSError:  # on Windows, while another process has it open
        raise InputError(f"{folder.path}: the store is being read; try again.") from None
    sync_folder(folder.path)


def copy_sqlite(source: sqlite3.Connection, target: Path) -> None:
    """Copy a database as it is at one moment, while others use it."""
    copied = sqlite3.connect(target)
    try:
        source.backup(copied)
    finally:
        copied.close()


def sqlite_faults(path: Path) -> list[str]:
    """Faults of a SQLite database by its own checks."""
    faults = []
    try:
        with undisturbed(path), closing(connect_sqlite(path)) as connection:
            for (line,) in connection.execute("PRAGMA integrity_check(20)"):
                if line != "ok":
                    faults.append(f"database: {line}")
            for table, row, parent, _ in connection.execute("PRAGMA foreign_key_check"):
                faults.append(f"database: row {row} of {table} refers to a row of {parent} that is missing")
    except sqlite3.DatabaseError as error:
        faults.append(f"database: {error}")
    return faults


def settle(path: Path) -> None:
    """Make a SQLite database one durable file, without a write-ahead log."""
    connection = sqlite3.connect(path, isolation_level=None)
    try:
        connection.execute("PRAGMA journal_mode = DELETE")
    finally:
        connection.close()
    with path.open("rb+") as stream:
        os.fsync(stream.fileno())
