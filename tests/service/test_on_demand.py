"""Results on demand: the process, its end, and the size of what is cached."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.service.raw_runs import compute_here

from ballscrew.base.errors import InputError
from ballscrew.service import on_demand
from ballscrew.service.on_demand import OnDemand, compute
from ballscrew.service.serving import RefusedError, Service


@dataclass(frozen=True)
class MadeTask:
    """Write a file, or end in another way."""

    way: str = "write"

    def write(self, folder: Path) -> None:
        (folder / "part").write_bytes(b"x" * 1000)
        (folder / "about.json").touch()
        if self.way == "refuse":
            raise InputError("it is no file.")
        if self.way == "fail":
            raise ValueError("unknown")
        if self.way == "crash":
            os._exit(3)


@pytest.fixture
def results(service: Service) -> OnDemand:
    service.scratch.mkdir()
    return OnDemand(service, "made")


def find(results: OnDemand, key: str, task: MadeTask) -> Path | None:
    """Result of a task, waited for."""
    found = None
    for _ in range(60):
        found = found or results.find(key, task)
    return found


def test_a_process_computes_and_its_crash_is_a_sentence(results: OnDemand, service: Service) -> None:
    path = find(results, "a", MadeTask())
    assert path is not None
    assert (path / "part").stat().st_size == 1000
    process = results._process
    with pytest.raises(RefusedError, match="the process that computes it ended"):
        find(results, "b", MadeTask("crash"))
    assert not process.is_alive()
    service.stopping.set()


@pytest.mark.parametrize(
    ("way", "sentence", "lasts"), [("refuse", "it is no file.", True), ("fail", "unexpected error", False)]
)
def test_what_cannot_be_computed_leaves_a_sentence_and_no_file(
    tmp_path: Path, way: str, sentence: str, lasts: bool
) -> None:
    failure = compute(MadeTask(way), tmp_path / "a")
    assert failure is not None
    assert (sentence in failure.sentence, failure.lasts) == (True, lasts)
    assert list(tmp_path.iterdir()) == []


def test_without_a_folder_to_write_to_there_is_a_sentence(tmp_path: Path) -> None:
    failure = compute(MadeTask(), tmp_path / "none" / "a")
    assert failure is not None
    assert "FileNotFoundError" in failure.sentence


def test_what_failed_for_a_reason_that_may_pass_is_tried_again(
    results: OnDemand, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute_here(monkeypatch)
    way = {"a": "fail", "b": "refuse"}
    errors = {}
    for key in way:
        for _ in range(2):  # the second answer is the first one
            with pytest.raises((InputError, RefusedError)) as caught:
                find(results, key, MadeTask(way[key]))
            errors[key] = caught.value
    assert (errors["a"].status, errors["a"].headers["Retry-After"] > "0") == (503, True)
    monkeypatch.setattr(on_demand, "_PAUSE", 0.0)
    assert find(results, "a", MadeTask()) is not None
    with pytest.raises(InputError, match="it is no file"):
        find(results, "b", MadeTask())
    service.stopping.set()


def test_an_error_of_the_disk_ends_neither_the_thread_nor_later_results(
    results: OnDemand, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute_here(monkeypatch)
    (service.scratch / "made").touch()  # where the folder should be
    for number in range(on_demand._MOST_WAITING + 1):
        with pytest.raises(RefusedError, match="FileExistsError"):
            find(results, str(number), MadeTask())
    assert results._waiting == {}
    (service.scratch / "made").unlink()
    assert find(results, "a", MadeTask()) is not None
    service.stopping.set()


def test_what_is_left_of_a_result_is_computed_again(
    results: OnDemand, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute_here(monkeypatch)
    folder = service.scratch / "made" / "a"
    folder.mkdir(parents=True)
    (folder / "0.npy").touch()
    assert find(results, "a", MadeTask()) == folder
    assert sorted(path.name for path in folder.iterdir()) == ["about.json", "part"]
    assert list(folder.parent.iterdir()) == [folder]
    service.stopping.set()


def test_a_result_that_is_in_use_stays_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows refuses to rename its folder."""
    for number, name in enumerate("ab"):
        assert compute(MadeTask(), tmp_path / name) is None
        os.utime(tmp_path / name, (number, number))

    def refuse(self: Path, target: Path) -> Path:
        raise PermissionError(13, "in use", str(self), None, str(target))

    with monkeypatch.context() as patched:
        patched.setattr(Path, "rename", refuse)
        on_demand._remove_oldest(tmp_path, 1)
    assert len(list((tmp_path / "a").iterdir())) == 2
    on_demand._remove_oldest(tmp_path, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["b"]


def test_the_oldest_results_are_removed(tmp_path: Path) -> None:
    for number, name in enumerate("abc"):
        assert compute(MadeTask(), tmp_path / name) is None
        os.utime(tmp_path / name, (number, number))
    on_demand._remove_oldest(tmp_path, 2500)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b", "c"]
    on_demand._remove_oldest(tmp_path, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["c"]


def test_a_result_is_removed_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever of its files is already removed, its folder no longer has its name."""
    found = []
    monkeypatch.setattr("shutil.rmtree", lambda *_, **__: found.append((tmp_path / "a").exists()))
    for number, name in enumerate("ab"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "part").write_bytes(b"x")
        os.utime(tmp_path / name, (number, number))
    on_demand._remove_oldest(tmp_path, 1)
    assert found == [False]


def test_too_many_results_are_refused(results: OnDemand, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(on_demand, "_PATIENCE", 0.0)
    monkeypatch.setattr(OnDemand, "_run", lambda self: None)  # noqa: ARG005
    for number in range(on_demand._MOST_WAITING):
        assert results.find(str(number), MadeTask()) is None
    with pytest.raises(RefusedError, match="too many"):
        results.find("more", MadeTask())


def test_nothing_is_computed_when_the_disk_is_full(
    results: OnDemand, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Service, "free_bytes", lambda self: -1)  # noqa: ARG005
    with pytest.raises(RefusedError, match="disk is full"):
        results.find("a", MadeTask())
