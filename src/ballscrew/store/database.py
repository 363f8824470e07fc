"""Databases of a store: SQLite in the data folder, or PostgreSQL by URL."""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath

from sqlalchemy import Connection, Engine, create_engine, event, text
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError
from sqlalchemy.pool import NullPool, QueuePool

from ballscrew.base.errors import InputError, shown
from ballscrew.store.tables import SCHEMA, SCHEMAS

_WRITERS = 0x62616C6C  # advisory lock of PostgreSQL: one writer at a time
_BUSY = 60_000  # ms
_IMMUTABLE = "ro&immutable=1"
_WAL_BYTE = 19  # of the file: 2 for a database with a write-ahead log
_WAL_LIMIT = 64 << 20  # bytes that the write-ahead log keeps after a checkpoint

# Sentence for what databases report, by a part of their message.
_SENTENCES = (
    (
        "malformed|not a database|disk image|Could not decode",
        "the database is damaged; restore a backup to another folder",
    ),
    ("database or disk is full|No space left", "the disk is full; nothing was added"),
    ("readonly database|read-only", "the database is read-only"),
    ("database is locked", "the database is in use by another process; try again"),
    ("no such (table|column)", "the database lacks a table or a column: it is damaged"),
    ("unable to open database|no such file", "the database cannot be opened"),
    ("invalid byte sequence", "a text contains NUL or is not valid Unicode"),
    ("disk I/O error", "the disk reported an error; nothing was added"),
    (
        "[Cc]onnect|network|password|28P01|role .* does not exist|terminating|57P0|3D000|server closed",
        "the database server cannot be reached or refuses the user",
    ),
)


def sqlite_url(path: Path) -> str:
    """URL of a SQLite database."""
    return URL.create("sqlite", database=str(path)).render_as_string()


def make_engine(url: str, *, writing: bool, pooled: bool = False) -> Engine:
    """Engine whose transactions are those of one writer, or read a consistent state.

    Parameters
    ----------
    url : str
        Of SQLite or PostgreSQL.
    writing : bool
        Whether it may write.
    pooled : bool
        Whether connections to PostgreSQL stay open for the next transaction: to connect takes 30 ms.

    Returns
    -------
    Engine
        Connections to SQLite are closed after use: a reader that is left open keeps the write-ahead log
        growing.

    Raises
    ------
    InputError
        If the URL is not valid, or its driver is not installed.
    """
    try:
        parsed = make_url(url)
        if parsed.get_backend_name() == "sqlite":
            return _sqlite_engine(str(parsed.database), writing=writing)
        if parsed.get_backend_name() != "postgresql":
            raise InputError("the database must be a URL of PostgreSQL: postgresql://user@host/name.")
        level = "READ COMMITTED" if writing else "REPEATABLE READ"
        engine = create_engine(
            parsed.set(drivername="postgresql+pg8000"),
            poolclass=QueuePool if pooled else NullPool,
            pool_pre_ping=pooled,  # a server that was restarted has closed them
            isolation_level=level,
            hide_parameters=True,  # hashes, in the message of an error
        )
    except (ArgumentError, NoSuchModuleError):
        raise InputError("the database is no URL such as postgresql://user@host/name.") from None
    except ModuleNotFoundError:
        raise InputError('PostgreSQL needs pg8000: python -m pip install "ballscrew[postgresql]".') from None
    if writing:

        @event.listens_for(engine, "begin")
        def _wait_for_writers(connection: Connection) -> None:
            connection.execute(text(f"SELECT pg_advisory_xact_lock({_WRITERS})"))

    return engine


def _sqlite_engine(path: str, *, writing: bool) -> Engine:
    def connect() -> sqlite3.Connection:
        connection = connect_sqlite(Path(path), writing=writing)
        if writing:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = FULL")
            connection.execute(f"PRAGMA journal_size_limit = {_WAL_LIMIT}")
        return connection

    engine = create_engine("sqlite://", creator=connect, poolclass=NullPool, hide_parameters=True)

    @event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        # A read that becomes a write fails at once, whatever the timeout.
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writing else "BEGIN")

    return engine


def connect_sqlite(path: Path, *, writing: bool = False) -> sqlite3.Connection:
    """Connection to a SQLite database.

    Parameters
    ----------
    path : Path
        The database, which must exist.
    writing : bool
        Whether it may write.

    Returns
    -------
    sqlite3.Connection
        A reader too opens a database so that it can roll back what a killed process left half written.
    """
    address = f"{_address(path.resolve())}?mode={_mode(path)}"
    # SQLAlchemy begins the transactions; Python's sqlite3 would begin others.
    connection = sqlite3.connect(address, uri=True, isolation_level=None, check_same_thread=False)
    connection.execute(f"PRAGMA busy_timeout = {_BUSY}")
    connection.execute("PRAGMA foreign_keys = ON")
    if not writing:
        connection.execute("PRAGMA query_only = ON")
    return connection


def _address(path: PurePath) -> str:
    """URI of a database, refused on a network drive of Windows, where SQLite cannot share it."""
    if path.drive.startswith("\\\\") and not path.drive.startswith("\\\\?\\"):  # a long local path
        raise InputError(f"{path}: is on a network drive; keep a store on a disk of this computer.")
    return path.as_uri()


def _mode(path: Path) -> str:
    """How a database is opened.

    In a folder that cannot be written, SQLite can open one with a write-ahead log only if the log is there,
    or without any lock, as immutable. Another user may write to it meanwhile: see :func:`undisturbed`. A
    backup has no write-ahead log.
    """
    if os.access(path.parent, os.W_OK):
        return "rw"
    log = path.with_name(f"{path.name}-wal")
    if log.exists() and log.stat().st_size > 0:
        return "ro"
    with path.open("rb") as stream:
        has_log = stream.read(_WAL_BYTE + 1)[_WAL_BYTE:] == b"\2"
    return _IMMUTABLE if has_log else "ro"


@contextmanager
def undisturbed(path: Path) -> Iterator[None]:
    """Refuse what was read without a lock if another process has written to the database meanwhile.

    Parameters
    ----------
    path : Path
        Of a SQLite database, which need not exist.

    Yields
    ------
    None
        While it is read.

    Raises
    ------
    InputError
        If it was written; whatever was read may be wrong.
    """
    if not path.is_file() or _mode(path) != _IMMUTABLE:
        yield
        return
    before = path.stat()
    try:
        yield
    finally:
        after = path.stat()
        if (after.st_mtime_ns, after.st_size) != (before.st_mtime_ns, before.st_size):
            raise InputError(f"{path}: was written while it was read; try again.")


@contextmanager
def translated(where: object) -> Iterator[None]:
    """Errors of a database as sentences.

    Parameters
    ----------
    where : object
        The store, for the message.

    Yields
    ------
    None
        While the database is used.

    Raises
    ------
    InputError
        For what a user can act upon; any other error stays as it is.
    """
    try:
        yield
    except UnicodeEncodeError as error:
        text = error.object[max(error.start - 20, 0) : error.end]
        raise InputError(f"{where}: the text {shown(text)} is not valid Unicode.") from None
    except (DBAPIError, sqlite3.Error, OSError) as error:
        if isinstance(error, OSError) and error.filename is not None:
            raise
        message = str(getattr(error, "orig", None) or error)
        if isinstance(error, DBAPIError) and error.connection_invalidated:
            message = f"connection lost: {message}"
        for pattern, sentence in _SENTENCES:
            if re.search(pattern, message):
                raise InputError(f"{where}: {sentence}.") from error
        raise


def check_schema(connection: Connection, where: object) -> None:
    """Check that a database has the schema of this version.

    Raises
    ------
    InputError
        If it is older, newer or no store.
    """
    found = schema_of(connection)
    if found == SCHEMA:
        return
    if found is None:
        raise InputError(f"{where}: the database contains no store.")
    if found in SCHEMAS:
        raise InputError(
            f"{where}: has schema {found}, this version needs {SCHEMA}: run 'ballscrew store migrate'."
        )
    raise InputError(
        f"{where}: was written by a later version of ballscrew (schema {found}; this one reads {SCHEMA}); "
        "use that version."
    )


def schema_of(connection: Connection) -> str | None:
    """Version of the schema of a database; None where it contains no store."""
    exists = "SELECT count(*) FROM sqlite_master WHERE name = 'alembic_version'"
    if connection.dialect.name == "postgresql":
        exists = "SELECT count(*) FROM pg_tables WHERE tablename = 'alembic_version'"
    if not connection.execute(text(exists)).scalar():
        return None
    return str(connection.execute(text("SELECT version_num FROM alembic_version")).scalar())
