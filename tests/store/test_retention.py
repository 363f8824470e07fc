"""Deletion of raw files by a policy: what stays, what is recorded, and what others then do."""

from __future__ import annotations

import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select
from tests.store.stored import MODEL, imitate_analysis, write_recordings

from ballscrew.base.errors import InputError
from ballscrew.store.adding import add, add_model
from ballscrew.store.assessing import monitor_axis
from ballscrew.store.checking import gc, verify
from ballscrew.store.copying import backup
from ballscrew.store.folder import at_time
from ballscrew.store.migrating import create_store
from ballscrew.store.opened import OpenStore
from ballscrew.store.reprocessing import reprocess
from ballscrew.store.retention import RetentionPolicy, retain
from ballscrew.store.service_tables import Upload
from ballscrew.store.showing import show_run
from ballscrew.store.tables import AlarmRow, Audit, Axis, RawFile, RecordingRow, RunRow

RECEIVED = datetime(2026, 1, 1, tzinfo=UTC)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of eight runs, three days apart, with two raw files each; assessed."""
    folder = tmp_path_factory.mktemp("retention")
    with pytest.MonkeyPatch.context() as patched:
        imitate_analysis(patched)
        store = create_store(folder / "store")
        for number in range(8):
            with at_time(RECEIVED + timedelta(days=3 * number)):
                add(store, write_recordings(folder / f"run{number}", 3.0 * number))
        add_model(store, MODEL)
        monitor_axis(store, "bench")
    return folder


@pytest.fixture
def store(tmp_path: Path, made: Path) -> OpenStore:
    shutil.copytree(made / "store", tmp_path / "store")
    return OpenStore(tmp_path / "store")


def files_of_runs(store: OpenStore) -> list[list[bool]]:
    """Whether each raw file of each run is stored, by time."""
    with store.read() as session:
        found: list[list[bool]] = []
        for run in session.scalars(select(RunRow).order_by(RunRow.time)):
            hashes = select(RecordingRow.sha256).where(RecordingRow.run_id == run.id)
            rows = session.scalars(select(RawFile).where(RawFile.sha256.in_(hashes)))
            found.append([row.is_stored for row in rows])
        return found


def stored_runs(store: OpenStore) -> list[int]:
    return [number for number, stored in enumerate(files_of_runs(store)) if all(stored)]


def test_baseline_newest_and_young_runs_keep_their_files(store: OpenStore) -> None:
    with at_time(RECEIVED + timedelta(days=30)):
        listed = retain(store, RetentionPolicy(days=10.0, newest=1), dry_run=True)
        assert stored_runs(store) == list(range(8))
        assert retain(store, RetentionPolicy(days=10.0, newest=1)) == listed | {"dry_run": False}
    assert stored_runs(store) == [0, 1, 2, 7]  # three that the baseline was learned from, and the newest
    assert [len(each["files"]) for each in listed["axes"]] == [8]
    with at_time(RECEIVED + timedelta(days=30)):
        assert retain(store, RetentionPolicy(days=10.0, newest=1))["axes"] == []


def test_files_of_young_runs_stay(store: OpenStore) -> None:
    with at_time(RECEIVED + timedelta(days=22)):
        retain(store, RetentionPolicy(days=10.0, newest=0))
    assert stored_runs(store) == [0, 1, 2, 4, 5, 6, 7]  # the fifth came ten days before


def test_an_alarm_keeps_the_files_of_the_run_at_which_it_began(store: OpenStore) -> None:
    with store.write("test") as session:
        row = session.scalars(select(RunRow).order_by(RunRow.time)).all()[5]
        session.add(
            AlarmRow(
                axis_id=row.axis_id,
                epoch=0,
                began_at=row.measured_at,
                raised_at=row.received_at,
                retracted_at=row.received_at,
            )
        )
    retain(store, RetentionPolicy(days=0.0, newest=0))
    assert stored_runs(store) == [0, 1, 2, 5]


def test_an_axis_whose_baseline_is_not_known_keeps_all(store: OpenStore) -> None:
    with store.write("test") as session:
        session.scalars(select(Axis)).one().changed_at = "2026-02-01T00:00Z"
    assert retain(store, RetentionPolicy(days=0.0, newest=0))["axes"] == []
    with store.write("test") as session:
        axis = session.scalars(select(Axis)).one()
        axis.changed_at = axis.assessment_id = None
    assert retain(store, RetentionPolicy(days=0.0, newest=0))["axes"] == []


def test_a_file_that_another_run_or_upload_needs_stays(store: OpenStore) -> None:
    with store.write("test") as session:
        rows = session.scalars(select(RunRow).order_by(RunRow.time)).all()
        shared, waiting = (
            session.scalars(select(RecordingRow.sha256).where(RecordingRow.run_id == rows[n].id)).all()[0]
            for n in (4, 5)
        )
        session.add(RecordingRow(run_id=rows[0].id, place=9, name="shared", sha256=shared))
        sent = {"key": "k", "sent": "s", "content": "c", "status": "queued", "stated": {}, "sender": "m"}
        files = [{"name": "a", "sha256": waiting}]
        other = Axis(name="another", runs=0)
        session.add(other)
        session.flush()
        session.add(Upload(axis_id=other.id, files=files, received_at=rows[0].received_at, **sent))
    retain(store, RetentionPolicy(days=0.0, newest=0))
    stored = files_of_runs(store)
    assert [sorted(each) for each in stored[3:6]] == [[False, False], [False, True], [False, True]]


@pytest.fixture
def thinned(store: OpenStore) -> OpenStore:
    """The store without the raw files of the runs 3, 4 and 5."""
    retain(store, RetentionPolicy(days=0.0, newest=2))
    assert stored_runs(store) == [0, 1, 2, 6, 7]
    return store


def test_a_deletion_is_in_the_audit_and_no_damage(thinned: OpenStore, tmp_path: Path) -> None:
    with thinned.read() as session:
        (row,) = session.scalars(select(Audit).where(Audit.action == "delete"))
        gone = session.scalars(select(RawFile.sha256).where(RawFile.deleted_at.is_not(None))).all()
    assert sorted(row.detail["files"]) == sorted(gone)
    assert row.detail["policy"] == {"days": 0.0, "newest": 2}
    found = verify(thinned.path)
    assert (found.faults, found.files, found.orphans) == ((), 10, ())
    assert len([path for path in thinned.folder.files.rglob("*") if path.is_file()]) == 10
    assert verify(backup(thinned, tmp_path / "backup")).faults == ()


def test_a_run_says_when_its_raw_files_were_deleted_and_is_not_analysed_again(
    thinned: OpenStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)
    with thinned.read() as session:
        runs = session.scalars(select(RunRow.run).order_by(RunRow.time)).all()
    recordings = show_run(thinned, runs[3])["recordings"]
    assert all(each["deleted_at"] is not None and not each["stored"] for each in recordings)
    assert show_run(thinned, runs[0])["recordings"][0]["deleted_at"] is None
    document = reprocess(thinned, ["bench", "bench"], method="paper")
    assert (document["analyzed"], len(document["failures"])) == (len(runs) - 3, 3)
    assert [axis["axis"] for axis in document["axes"]] == ["bench"]
    assert all("archived or deleted" in each for each in document["failures"])


def test_files_that_are_added_again_are_there_again(
    thinned: OpenStore, made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)
    folder = made / "run4"
    assert not add(thinned, folder / "run.toml").is_new
    assert add(thinned, folder / "run.toml", method="paper").is_new
    assert stored_runs(thinned) == [0, 1, 2, 4, 6, 7]
    assert verify(thinned.path).faults == ()


def test_a_kill_after_the_rows_leaves_files_that_gc_removes(
    store: OpenStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(Path, "unlink", fail)
        with pytest.raises(KeyboardInterrupt):
            retain(store, RetentionPolicy(days=0.0, newest=2))
    found = verify(store.path)
    assert (found.faults, len(found.orphans)) == ((), 6)
    assert len(gc(store)["removed"]) == 6


def test_a_kill_before_the_commit_deletes_nothing(store: OpenStore, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("ballscrew.store.retention.record", fail)
    with pytest.raises(KeyboardInterrupt):
        retain(store, RetentionPolicy(days=0.0, newest=2))
    assert stored_runs(store) == list(range(8))
    assert verify(store.path).faults == ()


@pytest.mark.parametrize(("days", "newest"), [(-1.0, 3), (1.0, -1), (float("nan"), 3)])
def test_a_policy_has_no_negative_number(days: float, newest: int) -> None:
    with pytest.raises(InputError, match="must be 0 or more"):
        RetentionPolicy(days, newest)
