"""A damaged store is reported and only read; what is damaged is found by its hash."""

from __future__ import annotations

import random
import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import select, text
from tests.monitoring.histories import at
from tests.store.conftest import CopyStore
from tests.store.stored import RUNS, fill, imitate_analysis, write_recordings

from ballscrew.base.errors import InputError
from ballscrew.store import checking
from ballscrew.store.adding import add_run
from ballscrew.store.opened import record
from ballscrew.store.raw_files import path_of
from ballscrew.store.store import Store
from ballscrew.store.tables import Model, RawFile


def add_all(store: Store) -> None:
    """Add rows of all kinds and raw files."""
    fill(store)
    store.add(write_recordings(store.path.parent / "run", 50.0))
    store.monitor("bench")


@pytest.fixture
def with_files(copy_store: CopyStore, monkeypatch: pytest.MonkeyPatch) -> Store:
    """A store with rows of all kinds and raw files."""
    imitate_analysis(monkeypatch)
    return copy_store(add_all)


def change_all(store: Store) -> None:
    """Add to :func:`add_all` what people change."""
    add_all(store)
    with store.write("test") as session:
        session.add(Model(digest="a second model", axis_id=1, document=b"", added_at=""))
        record(session, "add", "model a second model")
    with pytest.raises(InputError, match="another result"):
        add_run(store, replace(RUNS[0], cells=RUNS[0].cells[1:]))
    store.correct(RUNS[1].id, measured_at=at(4.0), reason="clock")
    store.exclude(RUNS[2].id, reason="sensor")
    assert store.verify(store.path).faults == ()


def raw_files(store: Store) -> list[Path]:
    return sorted(path for path in store.folder.files.rglob("*") if path.is_file())


def test_a_whole_store_has_no_fault(with_files: Store) -> None:
    found = with_files.verify(with_files.path)
    assert found.faults == ()
    assert found.files == 2
    assert found.orphans == ()


def test_every_flipped_byte_of_a_raw_file_is_found(with_files: Store) -> None:
    (path, _) = raw_files(with_files)
    content = path.read_bytes()
    for place in (0, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        (fault,) = with_files.verify(with_files.path).faults
        assert path.name in fault
    path.write_bytes(content)
    assert with_files.verify(with_files.path).faults == ()


def test_a_damaged_store_is_read_and_not_written_until_it_is_repaired(with_files: Store) -> None:
    (path, _) = raw_files(with_files)
    content = path.read_bytes()
    path.unlink()
    (fault,) = with_files.verify(with_files.path).faults
    assert fault.endswith("the file is missing")
    store = Store(with_files.path)
    assert len(store.show("bench")["runs"]) == len(RUNS) + 1
    with pytest.raises(InputError, match="the store is damaged and only read"):
        add_run(store, RUNS[0])
    with pytest.raises(InputError, match="the store is damaged and only read"):
        store.gc()
    path.write_bytes(content)
    store.verify(store.path)
    assert not add_run(store, RUNS[0]).is_new


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ("UPDATE runs SET mass_kg = 101 WHERE id = 1", "of RunRow"),
        ("UPDATE events SET kind = 'nut replaced' WHERE id = 1", "of EventRow"),
        ("UPDATE audit SET actor = 'nobody' WHERE id = 1", "of Audit"),
        ("UPDATE states SET level = 0.5", "of StateRow"),
        ('UPDATE cells SET "frequency_Hz" = 1 WHERE result_id = 2 AND place = 3', "cells or recordings"),
        ("DELETE FROM cells WHERE result_id = 2 AND place = 3", "cells or recordings"),
        ("DELETE FROM recordings WHERE run_id = 2", "cells or recordings"),
        ("UPDATE axes SET assessment_id = 99", "the assessment or the model"),
        ("DELETE FROM audit WHERE id = 3", "of the audit before its row 4 are missing"),
        ("DELETE FROM audit WHERE id < 3", "of the audit before its row 3 are missing"),
        ("DELETE FROM audit WHERE id > 3", "by the audit"),
        ("DELETE FROM audit", "by the audit"),
        ("DELETE FROM models WHERE digest = 'a second model'", "models has 1 rows"),
        ("DELETE FROM events WHERE id = 2", "events has 1 rows"),
        ("DELETE FROM conflicts", "conflicts has 0 rows"),
        ("DELETE FROM corrections", "corrections has 0 rows"),
        ("DELETE FROM exclusions", "exclusions has 0 rows"),
        ("DELETE FROM alarms", "alarms has 0 rows"),
        ("DELETE FROM explanations; DELETE FROM assessments WHERE id = 1", "assessments has"),
        ("DELETE FROM sources", "sources has 0 rows"),
        ("DELETE FROM files", "has no row"),
        ("DELETE FROM documents", "has no row"),
        ("DELETE FROM states WHERE run_id = 3", "states of the runs of the axis bench are missing"),
        ("UPDATE axes SET runs = 99", "runs of the axis bench are missing"),
        (
            "DELETE FROM cells WHERE result_id = 2; DELETE FROM results WHERE id = 2",
            "the result of the run run 0 001 is missing",
        ),
        (
            "UPDATE results SET document = (SELECT document FROM models LIMIT 1) WHERE id = 2",
            "cells or recordings",
        ),
    ],
)
def test_a_changed_row_is_found(
    copy_store: CopyStore, monkeypatch: pytest.MonkeyPatch, change: str, fault: str
) -> None:
    imitate_analysis(monkeypatch)
    changed = copy_store(change_all)
    with changed.engine(writing=True).begin() as connection:
        for statement in change.split("; "):
            connection.execute(text(statement))
    assert fault in " ".join(changed.verify(changed.path).faults)


@pytest.mark.slow
def test_flipped_bytes_of_the_database_are_found_or_change_nothing(tmp_path: Path) -> None:
    Store.init(tmp_path / "a")
    store = Store(tmp_path / "a")
    fill(store)
    answers = store.show("bench")
    path = store.folder.sqlite
    sqlite3.connect(path).execute("PRAGMA wal_checkpoint(TRUNCATE)")
    content = path.read_bytes()
    chance = random.Random(1)  # noqa: S311
    found = 0
    for _ in range(60):
        place = chance.randrange(len(content))
        path.write_bytes(
            content[:place] + bytes([content[place] ^ (1 << chance.randrange(8))]) + content[place + 1 :]
        )
        if store.verify(store.path).faults:
            found += 1
        else:
            assert Store(store.path).show("bench") == answers, place
    assert found > 10
    path.write_bytes(content)
    assert store.verify(store.path).faults == ()


def test_a_damaged_column_that_cannot_be_read_is_a_fault(tmp_path: Path) -> None:
    Store.init(tmp_path / "a")
    store = Store(tmp_path / "a")
    add_run(store, RUNS[0])
    with sqlite3.connect(store.folder.sqlite) as connection:
        connection.execute("UPDATE audit SET detail = '{\"axis' WHERE id = 1")
    (fault,) = store.verify(store.path).faults
    assert fault.startswith("database: a row cannot be read")


@pytest.mark.parametrize("content", [b"", b"no database at all" * 1000])
def test_no_database_is_a_sentence_and_stays(tmp_path: Path, content: bytes) -> None:
    Store.init(tmp_path / "a")
    path = tmp_path / "a" / "store.sqlite"
    for name in ("store.sqlite", "store.sqlite-wal", "store.sqlite-shm"):
        (tmp_path / "a" / name).unlink(missing_ok=True)
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"the database is damaged|contains no store"):
        Store(tmp_path / "a")
    assert Store.verify(tmp_path / "a").faults
    assert path.read_bytes() == content


def test_files_without_a_row_are_removed_and_no_others(with_files: Store) -> None:
    files = raw_files(with_files)
    orphan = path_of(with_files.folder.files, "ab" * 32, "none")
    orphan.parent.mkdir(exist_ok=True)
    orphan.write_bytes(b"12345")
    (with_files.folder.files / ".incoming-x").write_bytes(b"123")
    assert len(with_files.verify(with_files.path).orphans) == 2
    assert with_files.gc(dry_run=True)["bytes"] == 8
    assert len(with_files.gc()["removed"]) == 2
    assert raw_files(with_files) == files
    assert with_files.verify(with_files.path).faults == ()


def test_a_missing_database_is_a_fault(tmp_path: Path) -> None:
    Store.init(tmp_path / "a")
    (tmp_path / "a" / "store.sqlite").unlink()
    assert Store.verify(tmp_path / "a").faults[0] == "database: store.sqlite is missing"


def test_a_server_that_cannot_be_reached_is_no_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: object) -> None:
        raise InputError("the database server cannot be reached.")

    Store.init(tmp_path / "a")
    with monkeypatch.context() as patch:
        patch.setattr(checking, "OpenStore", fail)
        with pytest.raises(InputError, match="cannot be reached"):
            Store.verify(tmp_path / "a")
    add_run(Store(tmp_path / "a"), RUNS[0])


def test_a_raw_file_with_the_content_of_another_is_found(with_files: Store) -> None:
    path, other = raw_files(with_files)
    assert path.suffix == other.suffix
    path.write_bytes(other.read_bytes())
    (fault,) = with_files.verify(with_files.path).faults
    assert fault.endswith("the content is not that of its hash")
    assert path.name in fault


def test_a_file_that_is_archived_during_the_check_is_not_missing(with_files: Store, tmp_path: Path) -> None:
    with with_files.read() as session:
        rows = session.execute(select(RawFile.sha256, RawFile.compression)).all()
    with_files.archive("bench", tmp_path / "archive", newest=0)
    for sha256, compression in rows:
        assert checking._file_faults(with_files, sha256, compression) == []
