"""Transactions, locks and versions of the schema, on both databases."""

from __future__ import annotations

import errno
import os
import shutil
import sqlite3
import sys
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path, PureWindowsPath

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import text
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session
from tests.store.stored import RUNS, count, fill, text_of

from ballscrew.base.errors import InputError
from ballscrew.store import database, migrating, raw_files
from ballscrew.store.adding import METHOD_REVISION, add_run
from ballscrew.store.database import schema_of
from ballscrew.store.folder import DataFolder
from ballscrew.store.inserting import insert_run
from ballscrew.store.rows import Base
from ballscrew.store.store import Store
from ballscrew.store.tables import SCHEMA, RunRow


def test_the_migrations_make_the_tables(store: Store) -> None:
    with store.engine(writing=True).connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, Base.metadata) == []


@pytest.mark.usefixtures("with_fsync")
def test_sqlite_is_durable_and_checks_its_references(tmp_path: Path) -> None:
    Store.init(tmp_path / "a")
    store = Store(tmp_path / "a")
    with store.write("test") as session:
        found = {}
        for name in ("journal_mode", "synchronous", "foreign_keys", "journal_size_limit"):
            found[name] = session.execute(text(f"PRAGMA {name}")).scalar()
    assert found == {
        "journal_mode": "wal", "synchronous": 2, "foreign_keys": 1, "journal_size_limit": 64 << 20
    }  # fmt: skip


def test_half_a_transaction_is_none(store: Store) -> None:
    def fail() -> None:
        with store.write("test") as session:
            add_rows(session)
            raise RuntimeError

    def add_rows(session: Session) -> None:
        insert_run(session, RUNS[0], METHOD_REVISION)
        session.flush()

    with pytest.raises(RuntimeError):
        fail()
    assert count(store, RunRow) == 0


def test_writers_of_several_threads_wait_for_each_other(store: Store) -> None:
    add_run(store, RUNS[0])
    threads = [threading.Thread(target=add_run, args=(Store(store.path), run)) for run in RUNS[1:6]]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert count(store, RunRow) == 6


def test_writing_is_refused_while_a_server_holds_the_lock_and_reading_is_not(store: Store) -> None:
    add_run(store, RUNS[0])
    with DataFolder(store.path).locked("ballscrew serve", serving=True):
        with pytest.raises(
            InputError, match=r"in use by ballscrew serve, process .* it can be read meanwhile"
        ):
            add_run(store, RUNS[1])
        assert count(Store(store.path), RunRow) == 1
    add_run(store, RUNS[1])


def test_a_folder_with_other_files_and_a_store_are_not_overwritten(
    new_url: Callable[[], str | None], tmp_path: Path
) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="contains other files"):
        Store.init(tmp_path / "other", database=new_url())
    url = new_url()
    Store.init(tmp_path / "a", database=url)
    with pytest.raises(InputError, match="is a store already"):
        Store.init(tmp_path / "a", database=url)
    if url is not None:
        with pytest.raises(InputError, match="the database contains a store already"):
            Store.init(tmp_path / "b", database=url)
        assert not (tmp_path / "b" / "store.toml").exists()


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("nonsense", "the database is no URL"),
        ("mysql://user@host/name", "must be a URL of PostgreSQL"),
        ("postgresql://user@127.0.0.1:1/name", "the database server cannot be reached"),
    ],
)
def test_a_wrong_database_is_a_sentence(tmp_path: Path, url: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Store.init(tmp_path / "a", database=url)


NEXT = f"{int(SCHEMA) + 1:04d}"


def test_a_store_whose_settings_are_empty_says_so(tmp_path: Path) -> None:
    store = Store.init(tmp_path / "a")
    (store.path / "store.toml").write_bytes(b"")
    with pytest.raises(InputError, match=r"store\.toml: is empty or cut"):
        Store(store.path)


LATER = f"""
import sqlalchemy as sa
from alembic import op

revision = "{NEXT}"
down_revision = "{SCHEMA}"


def upgrade():
    op.add_column("machines", sa.Column("serial", sa.Text()))
"""


@pytest.fixture
def later_version(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[bool], None]:
    """Switches to a version of the program with another schema, and back."""
    migrations = tmp_path / "migrations"
    shutil.copytree(migrating._MIGRATIONS, migrations)
    (migrations / "versions" / f"{NEXT}_later.py").write_text(LATER)

    def switch(later: bool) -> None:
        monkeypatch.undo()
        if later:
            monkeypatch.setattr(migrating, "_MIGRATIONS", migrations)
            for module in (database, migrating):
                monkeypatch.setattr(module, "SCHEMA", NEXT)
                monkeypatch.setattr(module, "SCHEMAS", (SCHEMA, NEXT))

    return switch


def schema(store: Store) -> str | None:
    with store.engine(writing=False).connect() as connection:
        return schema_of(connection)


def test_an_older_store_is_migrated_and_a_newer_one_is_refused(
    filled: Store, later_version: Callable[[bool], None]
) -> None:
    before = text_of(filled.monitor("bench").monitored)
    later_version(True)
    with pytest.raises(
        InputError, match=f"has schema {SCHEMA}, this version needs {NEXT}: run 'ballscrew store mig"
    ):
        Store(filled.path)
    assert Store.migrate(filled.path) == SCHEMA
    assert Store.migrate(filled.path) == NEXT
    migrated = Store(filled.path)
    assert schema(migrated) == NEXT
    assert text_of(migrated.monitor("bench").monitored) == before
    later_version(False)
    with pytest.raises(InputError, match="was written by a later version of ballscrew"):
        Store(filled.path)
    with pytest.raises(InputError, match="was written by a later version of ballscrew"):
        Store.migrate(filled.path)


def test_a_migration_that_fails_changes_nothing(filled: Store, later_version: Callable[[bool], None]) -> None:
    later_version(True)
    broken = migrating._MIGRATIONS / "versions" / f"{NEXT}_later.py"
    broken.write_text(LATER + "    op.execute('DROP TABLE nothing')\n")
    with pytest.raises(Exception, match="nothing"):
        Store.migrate(filled.path)
    later_version(False)
    assert count(Store(filled.path), RunRow) == len(RUNS)


def test_a_creation_that_was_interrupted_is_begun_again(tmp_path: Path) -> None:
    (tmp_path / "a" / "files").mkdir(parents=True)
    for name in ("store.sqlite", "store.sqlite-journal", "store.lock", ".store-abcdefgh.toml"):
        (tmp_path / "a" / name).write_bytes(b"half")
    Store.init(tmp_path / "a")
    assert Store.verify(tmp_path / "a").faults == ()


def test_the_folders_of_a_new_store_are_durable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[Path] = []
    monkeypatch.setattr(raw_files, "sync_folder", synced.append)
    Store.init(tmp_path / "a" / "b")
    assert synced[:2] == [tmp_path / "a", tmp_path]


def test_what_was_read_while_another_process_wrote_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the right to write in the folder, and so without a lock."""
    Store.init(tmp_path / "a")
    store = Store(tmp_path / "a")
    fill(store, RUNS[:3])
    store.monitor("bench")
    for name in ("store.sqlite-wal", "store.sqlite-shm"):
        assert not (tmp_path / "a" / name).exists()
    monkeypatch.setattr(database.os, "access", lambda *_: False)
    assert count(store, RunRow) == 3

    def read_and_write() -> None:
        with store.read() as session:
            session.connection()
            monkeypatch.undo()
            add_run(Store(store.path), RUNS[3])
            monkeypatch.setattr(database.os, "access", lambda *_: False)

    with pytest.raises(InputError, match="was written while it was read; try again"):
        read_and_write()
    assert count(store, RunRow) == 4
    backup = Store(tmp_path / "a").backup(tmp_path / "b")
    assert database._mode(backup / "store.sqlite") == "ro"  # which has locks


def test_without_its_driver_a_database_is_refused_with_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pg8000", None)
    with pytest.raises(InputError, match=r'pip install "ballscrew\[postgresql\]"'):
        Store.init(tmp_path / "a", database="postgresql://user@127.0.0.1:1/name")


def test_a_database_with_a_log_is_read_with_locks_where_the_folder_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else what is only in the log would not be read."""
    path = Store.init(tmp_path / "a").folder.sqlite
    monkeypatch.setattr(database.os, "access", lambda *_: False)
    log = path.with_name("store.sqlite-wal")
    assert database._mode(path) == database._IMMUTABLE
    log.write_bytes(b"")
    assert database._mode(path) == database._IMMUTABLE
    log.write_bytes(b"rows")
    assert database._mode(path) == "ro"


def test_an_error_of_a_named_file_is_none_of_the_database() -> None:
    with pytest.raises(FileNotFoundError), database.translated("store"):
        raise FileNotFoundError(errno.ENOENT, "there is none", "a.bin")


def test_a_connection_that_was_lost_is_a_sentence() -> None:
    for lost in (True, False):
        error = OperationalError("SELECT 1", None, Exception("SSL is off"), connection_invalidated=lost)
        with pytest.raises((InputError, OperationalError)) as caught, database.translated("store"):
            raise error
        assert isinstance(caught.value, InputError) is lost


def test_a_store_with_another_layout_is_refused_with_both(tmp_path: Path) -> None:
    store = Store.init(tmp_path / "a")
    config = store.path / "store.toml"
    config.write_text(config.read_text().replace("layout = 1", "layout = 7"))
    with pytest.raises(InputError, match="the layout of the store is 7; this version reads 1"):
        Store(store.path)


def test_a_check_of_a_folder_without_a_store_is_not_noted(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path / "none")
    folder.note_check("backup")
    assert list(tmp_path.iterdir()) == []
    assert not folder.is_served()
    with pytest.raises(InputError, match="none: cannot be written"), folder.locked("test"):
        pytest.fail("it is locked")


def test_a_lock_that_cannot_be_tried_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> bool:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    store = Store.init(tmp_path / "a")
    monkeypatch.setattr("ballscrew.store.folder.try_lock", fail)
    with pytest.raises(InputError, match=f"a: cannot be written .*{os.strerror(errno.ENOLCK)}"):
        DataFolder(store.path).is_served()


def test_a_database_without_a_store_is_not_migrated(
    new_url: Callable[[], str | None], tmp_path: Path
) -> None:
    path = tmp_path / "a.sqlite"
    path.touch()
    engine = database.make_engine(new_url() or database.sqlite_url(path), writing=True)
    with engine.begin() as connection:
        with pytest.raises(InputError, match="a: the database contains no store"):
            migrating.upgrade(connection, "a")
        assert schema_of(connection) is None
    engine.dispose()


def test_a_folder_that_cannot_be_created_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("mine")
    with pytest.raises(InputError, match="store: cannot be created"):
        Store.init(tmp_path / "letter.txt" / "store")


@pytest.mark.parametrize("fault", ["faults", "replace"])
def test_a_migration_whose_result_is_damaged_or_not_put_in_place_changes_nothing(
    tmp_path: Path, later_version: Callable[[bool], None], monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    store = Store.init(tmp_path / "a")
    content = store.folder.sqlite.read_bytes()
    later_version(True)

    def refuse(self: Path, target: Path) -> Path:
        raise PermissionError(errno.EACCES, "in use", str(self), None, str(target))

    if fault == "faults":
        monkeypatch.setattr(migrating, "sqlite_faults", lambda _: ["database: a row is missing"])
    else:
        monkeypatch.setattr(Path, "replace", refuse)
    sentence = {
        "faults": "the migration was abandoned: database: a row",
        "replace": "is being read; try again",
    }
    with pytest.raises(InputError, match=sentence[fault]):
        Store.migrate(store.path)
    later_version(False)
    assert schema(Store(store.path)) == SCHEMA
    assert len(content) == store.folder.sqlite.stat().st_size


def test_faults_of_a_database_are_rows_without_their_parents_and_values_that_are_not_allowed(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.sqlite"
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("CREATE TABLE axes (id INTEGER PRIMARY KEY)")
        connection.execute("CREATE TABLE runs (id INTEGER PRIMARY KEY, axis REFERENCES axes(id), time TEXT)")
        connection.execute("INSERT INTO axes VALUES (1)")
        connection.execute("INSERT INTO runs VALUES (1, 1, 'now')")
        connection.execute("INSERT INTO runs VALUES (2, 1, NULL)")
    assert migrating.sqlite_faults(path) == []
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("DELETE FROM axes")
        connection.execute("PRAGMA writable_schema = ON")
        connection.execute("UPDATE sqlite_master SET sql = replace(sql, 'time TEXT', 'time TEXT NOT NULL')")
    assert migrating.sqlite_faults(path) == [
        "database: NULL value in runs.time",
        "database: row 1 of runs refers to a row of axes that is missing",
        "database: row 2 of runs refers to a row of axes that is missing",
    ]


def test_a_store_on_a_network_drive_is_refused() -> None:
    with pytest.raises(InputError, match="is on a network drive"):
        database._address(PureWindowsPath("//server/share/store.sqlite"))
    assert database._address(PureWindowsPath("C:/a b/store.sqlite")) == "file:///C:/a%20b/store.sqlite"
    long = PureWindowsPath("//?/C:/store.sqlite")
    assert database._address(long).endswith("store.sqlite")
