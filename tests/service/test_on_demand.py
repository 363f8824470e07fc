"""Results on demand: the process, its end, and the size of what is cached."""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.service.conftest import NewService, wait_for
from tests.service.raw_runs import compute_here

from ballscrew.base.errors import InputError
from ballscrew.service import on_demand
from ballscrew.service.on_demand import OnDemand, TaskFailure, compute, compute_tasks
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
        if self.way == "hang":
            time.sleep(600)


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


@pytest.fixture
def own_process(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What the main function changes in its process is changed back."""
    monkeypatch.setattr(tempfile, "tempdir", None)
    former = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, former)


@pytest.mark.usefixtures("own_process")
def test_the_process_computes_until_its_pipe_is_closed(tmp_path: Path) -> None:
    """Its temporary files are in the folder that the service clears; the service answers Ctrl-C."""
    pipe, other = multiprocessing.Pipe()
    for name, way in (("a", "write"), ("b", "refuse")):
        pipe.send((MadeTask(way), str(tmp_path / name)))
    answers = multiprocessing.Pipe(duplex=False)
    other.send = answers[1].send  # the pipe to the service is closed before they are read
    pipe.close()
    compute_tasks(other, str(tmp_path))
    answers[1].close()
    assert answers[0].recv() is None
    assert answers[0].recv() == TaskFailure("it is no file.", lasts=True)
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert tempfile.gettempdir() == str(tmp_path)
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_a_look_finds_what_is_there_and_computes_nothing(
    results: OnDemand, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    tasks = compute_here(monkeypatch)
    assert results.look("a") is None
    assert tasks == []
    path = find(results, "a", MadeTask())
    assert path is not None
    os.utime(path, (1, 1))
    assert results.look("a") == path
    assert path.stat().st_mtime > 1  # it is not the oldest now
    with pytest.raises(InputError):
        find(results, "b", MadeTask("refuse"))
    with pytest.raises(InputError, match="it is no file"):
        results.look("b")
    service.stopping.set()


def test_a_process_without_a_task_ends_and_another_begins_for_the_next(
    results: OnDemand, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute_here(monkeypatch)
    begun, killed = [], []

    def start(self: OnDemand) -> None:
        number = len(begun)
        begun.append(number)
        self._process = SimpleNamespace(
            is_alive=lambda: True, kill=lambda: killed.append(number), join=lambda: None
        )

    monkeypatch.setattr(OnDemand, "_start_process", start)
    monkeypatch.setattr(on_demand, "_IDLE", 0.0)
    monkeypatch.setattr(on_demand, "_TICK", 0.01)
    for number, key in enumerate("ab", start=1):
        assert find(results, key, MadeTask()) is not None
        wait_for(lambda: results._thread is None)
        assert begun == killed == list(range(number))
    service.stopping.set()


def test_a_computation_that_takes_too_long_is_ended_with_a_sentence(new_service: NewService) -> None:
    service = new_service(lease_s=0.1)
    service.scratch.mkdir()
    results = OnDemand(service, "made")
    with pytest.raises(RefusedError, match=r"it took more than 0 s\.") as caught:
        find(results, "a", MadeTask("hang"))
    assert caught.value.status == 503
    assert results._process is None
    service.stopping.set()


def test_a_computation_ends_with_the_server(results: OnDemand, service: Service) -> None:
    results._folder.mkdir()
    results._start_process()
    process = results._process
    service.stopping.set()
    failure = results._answer("a", MadeTask("hang"))
    assert failure == TaskFailure("the server stops.")
    results._run()
    assert not process.is_alive()


def test_the_failures_that_are_remembered_are_limited(
    results: OnDemand, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those before are forgotten, and computed again."""
    tasks = compute_here(monkeypatch)
    monkeypatch.setattr(on_demand, "_MOST_REFUSALS", 2)
    for key, number in (("a", 1), ("b", 2), ("a", 2), ("c", 3), ("a", 4)):
        with pytest.raises(InputError, match="it is no file"):
            find(results, key, MadeTask("refuse"))
        assert len(tasks) == number
    service.stopping.set()
