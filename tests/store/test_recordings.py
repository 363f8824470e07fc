"""RUN.toml with its raw files: analysed once, stored by their hash, and analysed again by a new method."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select
from tests.monitoring.histories import at
from tests.simulated_bench import AXIS, PLAN
from tests.store.conftest import NewStore
from tests.store.stored import MODEL, RUNS, count, fill, imitate_analysis, text_of, write_recordings

from ballscrew._version import __version__
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import read_plan
from ballscrew.modal import analyze as analyze_module
from ballscrew.modal.amend import amend
from ballscrew.modal.run import Run
from ballscrew.store import adding, changing, raw_files
from ballscrew.store.adding import add_run
from ballscrew.store.folder import DataFolder
from ballscrew.store.raw_files import path_of, put_file, read_blocks
from ballscrew.store.store import Store
from ballscrew.store.tables import Audit, RawFile, ResultRow, RunRow


def test_the_same_recordings_are_analysed_once(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobs = imitate_analysis(monkeypatch)
    path = write_recordings(tmp_path / "run", 1.0)
    assert store.add(path).is_new
    shutil.copytree(tmp_path / "run", tmp_path / "other name")
    assert not store.add(tmp_path / "other name" / "run.toml").is_new
    assert not store.add(path).is_new
    assert len(jobs) == 1
    assert count(store, RawFile) == 2
    assert store.verify(store.path).faults == ()


def test_a_result_and_then_its_recordings_are_one_run(
    new_store: NewStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)
    path = write_recordings(tmp_path / "run", 1.0)
    one, other = new_store(), new_store()
    one.add(path)
    exported = next(one.export("bench", tmp_path / "exported").glob("runs/*.json"))
    assert not one.add(exported).is_new
    assert other.add(exported).is_new
    assert not other.add(path).is_new
    assert (count(other, RunRow), count(other, ResultRow), count(other, RawFile)) == (1, 1, 2)


def test_recordings_that_change_meanwhile_are_refused_whole(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)
    path = write_recordings(tmp_path / "run", 1.0)

    def change_and_put(*arguments: object) -> object:
        (tmp_path / "run" / "trip1.bin").write_bytes(b"changed")
        return put_file(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(adding, "put_file", change_and_put)
    with pytest.raises(InputError, match="has changed since it was analysed; nothing was added"):
        store.add(path)
    assert count(store, RunRow) == count(store, RawFile) == 0
    store.gc()
    assert [each for each in store.folder.files.rglob("*") if each.is_file()] == []


def test_a_new_revision_is_beside_the_old_until_the_axis_is_switched(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)
    for day in range(5):
        store.add(write_recordings(tmp_path / f"run{day}", float(day), f"{day}".encode()))
    first = store.show("bench")["runs"][0]["run"]
    new = store.correct(first, measured_at="2026-01-01T09:00Z", reason="wrong clock")
    fill(store, RUNS[5:6])
    store.exclude(RUNS[5].id, reason="has no raw files")
    before = text_of(store.monitor("bench").monitored)
    imitate_analysis(monkeypatch, scale=3.0)
    monkeypatch.setattr(adding, "METHOD_REVISION", 2)
    document = store.reprocess()
    (axis,) = document["axes"]
    assert document["analyzed"] == 5
    assert (axis["runs"], axis["missing"], axis["switched"]) == (6, 0, False)
    assert axis["largest_change"] == pytest.approx(2e-4, rel=1e-3)
    assert text_of(store.monitor("bench").monitored) == before
    assert store.reprocess(["bench"])["analyzed"] == 0
    store.reprocess(["bench"], switch=True)
    assert store.show("bench")["method"] == {"name": "joint", "revision": 2}
    switched = store.monitor("bench").monitored
    assert new in {run.reading.run for run in switched.state.runs}
    assert text_of(switched) != before
    assert store.verify(store.path).faults == ()


def test_two_corrections_of_a_run_are_reprocessed_and_the_choice_of_the_method_is_in_the_audit(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)
    run = store.add(write_recordings(tmp_path / "run", 1.0)).subject
    exported = next(store.export("bench", tmp_path / "exported").glob("runs/*.json"))
    for day in (2.0, 3.0):
        add_run(store, amend(Run.read(exported), measured_at=at(day)))
    monkeypatch.setattr(adding, "METHOD_REVISION", 2)
    (axis,) = store.reprocess()["axes"]
    assert axis["missing"] == 0
    assert len(store.show(run)["corrected_as"]) == 2
    assert store.verify(store.path).faults == ()
    with store.read() as session:
        (row,) = session.scalars(select(Audit).where(Audit.action == "choose"))
    assert (row.subject, row.detail["revision"]) == ("axis bench", 1)


@pytest.mark.parametrize("action", ["add", "archive"])
def test_files_are_durable_before_the_lock_is_taken(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, action: str
) -> None:
    imitate_analysis(monkeypatch)
    path = write_recordings(tmp_path / "run", 1.0)
    fsyncs: list[bool] = []

    def note(*_: object) -> None:
        fsyncs.append(DataFolder(store.path)._holder() == {})

    if action == "archive":
        store.add(path)
    monkeypatch.setattr(raw_files.os, "fsync", note)
    if action == "archive":
        assert store.archive("bench", tmp_path / "archived", newest=0)["files"] == 2
    else:
        store.add(path)
    assert len(fsyncs) >= 2
    assert all(fsyncs)
    assert store.verify(store.path).faults == ()


def test_a_file_that_was_removed_before_its_row_was_there_is_stored_again(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)

    def remove_and_insert(*arguments: Any) -> object:
        for each in store.folder.files.rglob("*"):
            if each.is_file():
                each.unlink()  # as gc does
        return insert_run(*arguments)

    insert_run = adding.insert_run
    monkeypatch.setattr(adding, "insert_run", remove_and_insert)
    store.add(write_recordings(tmp_path / "run", 1.0))
    assert store.verify(store.path).faults == ()


def test_a_recording_is_shown_with_its_reader(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)
    path = write_recordings(tmp_path / "run", 1.0, files=1)
    (tmp_path / "run" / "trip0.bin").write_text("time,a\n" + "".join(f"{n / 100},{n}\n" for n in range(200)))
    run = store.add(path).subject
    corrected = store.correct(run, measured_at=at(2.0), reason="clock")
    for each in (run, corrected):
        (file,) = store.show(each)["recordings"]
        assert (file["reader"], file["stored"]) == (f"text, ballscrew {__version__}", True)
    folder = store.export("bench", tmp_path / "exported")
    provenance = json.loads((folder / "provenance.json").read_text())
    assert [each["run"] for each in provenance["runs"]] == [corrected]
    assert provenance["runs"][0]["recordings"] == [file]


def test_an_axis_with_runs_without_raw_files_is_not_switched(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)
    store.add(write_recordings(tmp_path / "run", 1.0))
    add_run(store, RUNS[0])
    monkeypatch.setattr(adding, "METHOD_REVISION", 2)
    with pytest.raises(InputError, match="'bench' is not switched: 1 runs have no new result"):
        store.reprocess(switch=True)
    assert store.show("bench")["method"]["revision"] == 1


@pytest.mark.slow
def test_reprocessed_recordings_of_the_bench_are_the_same_result(bench: Path, tmp_path: Path) -> None:
    """By two processes, which analyse from the store alone."""
    for path in [*bench.glob("*.toml"), *bench.glob("preload-4-percent-trip*.h5")]:
        shutil.copy(path, tmp_path)
    (tmp_path / "run.toml").write_text(
        'axis = "axis.toml"\nplan = "plan.toml"\nchannels = "channels.toml"\nload = "100 kg"\n'
        'measured_at = 2026-01-31T08:00:00Z\ntemperature = "23.4 degC"\n'
        'files = ["preload-4-percent-trip1.h5", "preload-4-percent-trip2.h5", "preload-4-percent-trip3.h5"]\n'
    )
    Store.init(tmp_path / "store")
    store = Store(tmp_path / "store")
    added = store.add(tmp_path / "run.toml", method="paper")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(adding, "METHOD_REVISION", 2)
        document = store.reprocess(method="paper", workers=2)
    assert document["failures"] == []
    (axis,) = document["axes"]
    assert (axis["runs"], axis["cells"], axis["largest_change"]) == (1, 40, 0.0)
    assert store.show("bench")["runs"][0]["run"] == added.subject


@pytest.mark.parametrize("content", [b"", b"text " * 500_000, os.urandom(1 << 21)])
def test_a_stored_file_is_read_back(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "files").mkdir()
    (tmp_path / "a.bin").write_bytes(content)
    sha256 = hashlib.sha256(content).hexdigest()
    stored = put_file(tmp_path / "files", tmp_path / "a.bin", sha256)
    path = path_of(tmp_path / "files", sha256, stored.compression)
    assert b"".join(read_blocks(path, stored.compression)) == content
    assert stored.size == len(content)
    assert stored.stored_size == path.stat().st_size
    assert (stored.compression == "zstd") == content.startswith(b"text")


@pytest.mark.parametrize("function", ["fsync", "replace", "write"])
@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO])
def test_after_an_error_of_the_disk_there_is_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, function: str, code: int
) -> None:
    (tmp_path / "files").mkdir()
    (tmp_path / "a.bin").write_bytes(b"content")

    def fail(*_: object, **__: object) -> None:
        raise OSError(code, os.strerror(code))

    place = {"fsync": (os, "fsync"), "replace": (Path, "replace"), "write": (raw_files, "_copy")}[function]
    monkeypatch.setattr(*place, fail)
    with pytest.raises(InputError, match=f"cannot be stored .*{os.strerror(code)}"):
        put_file(tmp_path / "files", tmp_path / "a.bin", hashlib.sha256(b"content").hexdigest())
    monkeypatch.undo()
    assert [path for path in (tmp_path / "files").rglob("*") if path.is_file()] == []


def test_recordings_that_change_during_the_analysis_are_refused(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)
    path = write_recordings(tmp_path / "run", 1.0)
    examine = analyze_module.examine

    def change_and_examine(*given: Any, **options: Any) -> Any:
        (tmp_path / "run" / "trip1.bin").write_bytes(b"changed")
        return examine(*given, **options)

    monkeypatch.setattr(analyze_module, "examine", change_and_examine)
    with pytest.raises(
        InputError, match="its recordings have changed during the analysis; nothing was added"
    ):
        store.add(path)
    assert count(store, RunRow) == count(store, RawFile) == 0


def test_a_model_of_no_axis_is_not_added(tmp_path: Path) -> None:
    store = Store.init(tmp_path / "a")
    with pytest.raises(InputError, match="the model names no axis; calibrate it with runs that do"):
        adding.add_model(store, replace(MODEL, axis=""))


@pytest.fixture
def clone(tmp_path: Path) -> tuple[Path, Path, str]:
    """A stored file, another folder of raw files, and its hash."""
    for name in ("files", "others"):
        (tmp_path / name).mkdir()
    (tmp_path / "a.bin").write_bytes(b"content")
    sha256 = hashlib.sha256(b"content").hexdigest()
    put_file(tmp_path / "files", tmp_path / "a.bin", sha256)
    return path_of(tmp_path / "files", sha256, "none"), tmp_path / "others", sha256


def test_a_damaged_file_is_neither_cloned_nor_copied_out(
    clone: tuple[Path, Path, str], tmp_path: Path
) -> None:
    path, folder, sha256 = clone
    raw_files.clone_file(path, folder, sha256, "none")
    assert path_of(folder, sha256, "none").read_bytes() == b"content"
    shutil.rmtree(folder)
    folder.mkdir()
    path.chmod(0o644)
    path.write_bytes(b"another")
    with pytest.raises(InputError, match="the content is not that of its hash: it is damaged"):
        raw_files.clone_file(path, folder, sha256, "none")
    assert [each for each in folder.rglob("*") if each.is_file()] == []
    with pytest.raises(InputError, match="the content of the file is not that of its hash: it is damaged"):
        raw_files.copy_out(path, "none", tmp_path / "out.bin", sha256)


def test_a_file_that_cannot_be_cloned_is_a_sentence(clone: tuple[Path, Path, str], tmp_path: Path) -> None:
    path, _, sha256 = clone
    with pytest.raises(InputError, match="cannot be copied"):
        raw_files.clone_file(path, tmp_path / "a.bin", sha256, "none")


def test_a_text_that_cannot_be_written_is_a_sentence_without_a_folder() -> None:
    for text, sentence in (("\ud800", r"^a text is not valid Unicode\.$"), ("[", r"^axis\.toml: ")):
        with pytest.raises(InputError, match=sentence), raw_files.text_files({"axis": text}) as paths:
            read_axis(paths["axis"])


def add_documented(store: Store, folder: Path, day: float) -> str:
    """Add recordings with data sheet and plan; the id of their run."""
    path = write_recordings(folder, day)
    for name, text in (("axis", AXIS), ("plan", PLAN)):
        (folder / f"{name}.toml").write_text(text)
    path.write_text(path.read_text() + 'axis = "axis.toml"\nplan = "plan.toml"\n')
    return store.add(path).subject


def test_a_corrected_load_is_checked_by_the_documents_of_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)
    store = Store(Store.init(tmp_path / "a").path)
    run = add_documented(store, tmp_path / "run", 1.0)
    given: list[Any] = []

    def note(former: Any, **options: Any) -> Any:
        given.append(options)
        return amend(former, **options)

    monkeypatch.setattr(changing, "amend", note)
    corrected = store.correct(run, mass="101 kg", reason="weighed")
    (options,) = given
    assert options["axis"] == read_axis(tmp_path / "run" / "axis.toml")
    assert options["plan"] == read_plan(tmp_path / "run" / "plan.toml")
    counting = [run for run in store.show("bench")["runs"] if run["counts"]]
    assert {run["run"]: run["mass_kg"] for run in counting} == {corrected: 101.0}


def test_a_corrected_load_stays_with_a_new_revision_and_so_does_a_corrected_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)
    store = Store(Store.init(tmp_path / "a").path)
    first, second = (add_documented(store, tmp_path / f"run{day}", float(day)) for day in (1, 2))
    loaded = store.correct(first, mass="101 kg", reason="weighed")
    both = store.correct(second, mass="101 kg", measured_at=at(3.0), reason="clock")
    monkeypatch.setattr(adding, "METHOD_REVISION", 2)
    assert store.reprocess(switch=True)["failures"] == []
    counting = [run for run in store.show("bench")["runs"] if run["counts"]]
    shown = {run["run"]: (run["mass_kg"], run["measured_at"]) for run in counting}
    assert shown == {loaded: (101.0, at(1.0)), both: (101.0, at(3.0))}
    assert store.show("bench")["method"]["revision"] == 2


def test_a_model_is_chosen_by_the_beginning_of_one_digest(tmp_path: Path) -> None:
    store = Store.init(tmp_path / "a")
    adding.add_model(store, MODEL)
    for beginning, number in (("x", 0), ("%", 0), ("", 1)):
        with pytest.raises(InputError, match=f"{number} models of the axis 'bench' begin with '{beginning}'"):
            changing.choose_model(store, "bench", beginning)
    adding.add_model(store, replace(MODEL, notes=("another",)))
    with pytest.raises(InputError, match="2 models of the axis 'bench' begin with ''; give one"):
        changing.choose_model(store, "bench", "")
