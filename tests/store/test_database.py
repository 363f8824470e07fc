"""Transactions, locks and versions of the schema, on both databases."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import text
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
