"""Backups, restored stores, exports and archives."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from tests.monitoring.histories import at
from tests.store.conftest import CopyStore, NewStore
from tests.store.stored import EVENTS, MODEL, RUNS, count, fill, imitate_analysis, text_of, write_recordings

import ballscrew
from ballscrew.base.errors import InputError
from ballscrew.store import copying
from ballscrew.store.adding import add_run
from ballscrew.store.copying import _new_folder
from ballscrew.store.opened import OpenStore
from ballscrew.store.store import Store
from ballscrew.store.tables import RawFile, RunRow


def answers(store: Store) -> list[object]:
    shown = store.show("bench")
    return [shown, store.list(), text_of(store.monitor("bench").monitored)]


def add_all(store: Store) -> None:
    """Add rows of all kinds, and the raw files of three runs."""
    fill(store)
    for day in (50.0, 60.0, 70.0):
        store.add(write_recordings(store.path.parent / f"run{day:.0f}", day))
    store.monitor("bench")


@pytest.fixture
def with_files(copy_store: CopyStore, monkeypatch: pytest.MonkeyPatch) -> Store:
    """A store with rows of all kinds and raw files."""
    imitate_analysis(monkeypatch)
    return copy_store(add_all)


def test_a_restored_backup_gives_the_same_answers(
    with_files: Store, new_url: Callable[[], str | None], tmp_path: Path
) -> None:
    folder = with_files.backup(tmp_path / "backup")
    expected = answers(with_files)
    assert answers(Store(folder)) == expected
    restored = Store(Store.restore(folder, tmp_path / "restored", database=new_url()).path)
    assert answers(restored) == expected
    assert restored.verify(restored.path).faults == ()
    assert restored.verify(restored.path).files == 6
    add_run(restored, ballscrew.amend(RUNS[0], measured_at="2027-01-01T00:00Z"))
    assert count(restored, RunRow) == count(with_files, RunRow) + 1


@pytest.mark.slow
def test_a_backup_while_others_add_is_consistent(store: Store, tmp_path: Path) -> None:
    add_run(store, RUNS[0])
    done = threading.Event()

    def add_all() -> None:
        for run in RUNS[1:]:
            add_run(Store(store.path), run)
        done.set()

    thread = threading.Thread(target=add_all)
    thread.start()
    sizes = []
    while not done.is_set() or not sizes:
        folder = store.backup(tmp_path / f"backup{len(sizes)}")
        assert Store.verify(folder).faults == ()
        sizes.append(count(Store(folder), RunRow))
    thread.join()
    assert sizes == sorted(sizes)
    assert count(store, RunRow) == len(RUNS)


def test_a_backup_is_whole_or_not_there(with_files: Store, tmp_path: Path) -> None:
    (path, *_) = sorted(with_files.folder.files.rglob("*.zst")) or sorted(with_files.folder.files.rglob("*"))
    path.write_bytes(path.read_bytes()[:-3] + b"abc")
    with pytest.raises(InputError, match=r"damaged|cannot be read"):
        with_files.backup(tmp_path / "backup")
    assert not (tmp_path / "backup").exists()
    assert not list(tmp_path.glob(".backup*"))


def test_a_damaged_backup_is_not_restored_and_no_folder_overwritten(
    with_files: Store, tmp_path: Path
) -> None:
    folder = with_files.backup(tmp_path / "backup")
    with pytest.raises(InputError, match="exists; give a new folder"):
        with_files.backup(tmp_path / "backup")
    next(path for path in folder.joinpath("files").rglob("*") if path.is_file()).unlink()
    with pytest.raises(InputError, match="the backup is damaged and was not restored"):
        Store.restore(folder, tmp_path / "restored")
    assert not (tmp_path / "restored").exists()


def test_a_folder_that_cannot_be_made_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"), _new_folder(tmp_path / "no" / "folder"):
        pass


def test_an_export_is_what_the_other_commands_read(filled: Store, tmp_path: Path) -> None:
    filled.exclude(RUNS[3].id, reason="test")
    folder = filled.export("bench", tmp_path / "bench")
    runs = [ballscrew.Run.read(path) for path in sorted(folder.glob("runs/*.json"))]
    (model,) = folder.glob("models/*.json")
    found = ballscrew.monitor(
        runs, ballscrew.read_model(model), events=ballscrew.read_events(folder / "events.toml")
    )
    others = [run for run in RUNS if run is not RUNS[3]]
    assert text_of(found) == text_of(ballscrew.monitor(others, MODEL, events=EVENTS))


def test_exported_raw_files_are_the_same_run(with_files: Store, new_store: NewStore, tmp_path: Path) -> None:
    folder = with_files.export("bench", tmp_path / "bench", raw=True)
    other = new_store()
    runs = sorted(folder.glob("recordings/*/run.toml"))
    assert len(runs) == 3
    for path in runs:
        other.add(path)
    known = {run["run"] for run in with_files.show("bench")["runs"]}
    assert {run["run"] for run in other.show("bench")["runs"]} < known


def test_archived_files_are_elsewhere_and_results_stay(with_files: Store, tmp_path: Path) -> None:
    before = answers(with_files)
    document = with_files.archive("bench", tmp_path / "archive", newest=2)
    assert document["files"] == 2
    assert with_files.archive("bench", tmp_path / "archive", newest=2)["files"] == 0
    found = with_files.verify(with_files.path)
    assert (found.faults, found.files, found.orphans) == ((), 4, ())
    assert count(with_files, RawFile) == 6
    assert answers(with_files) == before
    assert len([path for path in (tmp_path / "archive").rglob("*") if path.is_file()]) == 2
    folder = with_files.backup(tmp_path / "backup")
    assert Store.verify(folder).faults == ()


def test_nothing_is_written_into_a_store(filled: Store) -> None:
    inside = filled.path / "files" / "more"
    archive, export = partial(filled.archive, "bench"), partial(filled.export, "bench")
    for write in (filled.backup, archive, export):
        with pytest.raises(InputError, match="is in the store"):
            write(inside)
    assert not inside.exists()


on_sqlite = pytest.mark.parametrize("new_url", ["sqlite"], indirect=True)


@on_sqlite
def test_a_backup_during_which_files_are_archived_is_made_again(
    with_files: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copies: list[int] = []
    copy_database = copying._copy_database

    def copy_and_archive(store: OpenStore, path: Path) -> None:
        copy_database(store, path)
        copies.append(len(copies))
        with_files.archive("bench", tmp_path / "archive", newest=2)

    monkeypatch.setattr(copying, "_copy_database", copy_and_archive)
    folder = with_files.backup(tmp_path / "backup")
    assert len(copies) == 2
    assert Store.verify(folder).faults == ()
    assert Store.verify(folder).files == 4
    assert not list(tmp_path.glob(".backup*"))


@on_sqlite
def test_a_backup_is_given_up_where_files_are_archived_all_the_time(
    with_files: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(copying, "_is_removed", lambda *_: True)
    next(path for path in with_files.folder.files.rglob("*") if path.is_file()).unlink()
    with pytest.raises(InputError, match="archived or deleted all the time; try again"):
        with_files.backup(tmp_path / "backup")
    monkeypatch.undo()
    with pytest.raises(InputError, match="the file is missing: the store is damaged, see 'store verify'"):
        with_files.backup(tmp_path / "backup")
    assert not list(tmp_path.glob("*backup*"))


@on_sqlite
def test_an_archive_that_cannot_be_made_leaves_the_files_in_the_store(
    with_files: Store, tmp_path: Path
) -> None:
    (tmp_path / "letter.txt").write_text("mine")
    for folder, newest, sentence in (
        (tmp_path / "letter.txt" / "archive", 0, "cannot be created"),
        (tmp_path / "archive", -1, "the number of newest runs is -1; it must be 0 or more"),
    ):
        with pytest.raises(InputError, match=sentence):
            with_files.archive("bench", folder, newest=newest)
    assert with_files.verify(with_files.path).files == 6
    assert not (tmp_path / "archive").exists()


def test_an_exported_run_states_load_time_and_temperature_where_they_are_known() -> None:
    stated = {"mass_kg": 100.0, "measured_at": at(0.0), "temperature_C": 21.5}
    expected = [("load", "100.0 kg"), ("measured_at", at(0.0)), ("temperature", "21.5 degC")]
    assert copying.stated_fields(stated) == expected
    for number, name in enumerate(stated):
        others = expected[:number] + expected[number + 1 :]
        assert copying.stated_fields(stated | {name: None}) == others
