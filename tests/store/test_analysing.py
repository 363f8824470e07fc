"""Stored runs analysed by the workers of a Dask scheduler: the same bytes, none lost and none doubled."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select
from tests.store.stored import imitate_analysis, write_recordings

from ballscrew.base.errors import InputError, InterruptedReadError
from ballscrew.modal.run import Run
from ballscrew.store import adding, analysing
from ballscrew.store.raw_files import path_of
from ballscrew.store.rows import unpack
from ballscrew.store.store import Store
from ballscrew.store.tables import Method, ResultRow, RunRow

RUNS = 9


@pytest.fixture
def plant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A store with raw files, whose method has another revision since."""
    imitate_analysis(monkeypatch)
    Store.init(tmp_path / "plant")
    store = Store(tmp_path / "plant")
    for day in range(RUNS):
        store.add(write_recordings(tmp_path / f"run{day}", float(day), f"{day}".encode(), files=1))
    monkeypatch.setattr(adding, "METHOD_REVISION", 2)
    return store.path


@pytest.fixture
def cluster() -> Iterator[Any]:
    """A scheduler and two workers, threads of this process, which talk by TCP."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", host="127.0.0.1",
        dashboard_address=None, silence_logs=logging.CRITICAL,
    ) as found:  # fmt: skip
        yield found


def new_results(path: Path) -> list[tuple[str, bytes]]:
    with Store(path).read() as session:
        found = session.execute(
            select(RunRow.run, ResultRow.document)
            .join(ResultRow, ResultRow.run_id == RunRow.id)
            .join(Method, Method.id == ResultRow.method_id)
            .where(Method.revision == 2)
            .order_by(RunRow.run)
        )
        return [(run, document) for run, document in found]


def test_dask_gives_the_bytes_of_one_process(plant: Path, cluster: Any, tmp_path: Path) -> None:
    Store(plant).backup(tmp_path / "copy")
    counts: list[int] = []
    document = Store(plant).reprocess(
        scheduler=cluster.scheduler_address, progress=lambda done, *_: counts.append(done)
    )
    assert (document["analyzed"], document["failures"]) == (RUNS, [])
    assert counts == list(range(1, RUNS + 1))
    Store(tmp_path / "copy").reprocess()
    assert new_results(plant) == new_results(tmp_path / "copy")
    assert len(new_results(plant)) == RUNS
    assert Store.verify(plant).faults == ()
    assert Store(plant).reprocess(scheduler=cluster.scheduler_address)["analyzed"] == 0


def test_runs_of_a_lost_worker_are_analysed_again_and_none_is_doubled(
    plant: Path, cluster: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    examine, calls, lost = analysing.examine, [], threading.Event()

    def examine_and_wait(*arguments: Any, **named: Any) -> Any:
        calls.append(arguments)
        if len(calls) == 3:
            lost.wait(10)
        return examine(*arguments, **named)

    def lose(done: int, *_: object) -> None:
        if done == 1:
            worker = cluster.workers[0]
            cluster.loop.add_callback(worker.close, executor_wait=False)
            lost.set()

    monkeypatch.setattr(analysing, "examine", examine_and_wait)
    document = Store(plant).reprocess(scheduler=cluster.scheduler_address, progress=lose)
    assert (document["analyzed"], document["failures"]) == (RUNS, [])
    assert len(new_results(plant)) == RUNS
    assert Store.verify(plant).faults == ()


@pytest.mark.slow
def test_a_lost_scheduler_is_a_sentence_and_the_same_call_goes_on(
    plant: Path, cluster: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(analysing, "_PATIENCE", 5)

    def lose(done: int, *_: object) -> None:
        if done == 1:
            cluster.close()

    with pytest.raises(InputError, match="was lost; run the same command again"):
        Store(plant).reprocess(scheduler=cluster.scheduler_address, progress=lose)
    done = len(new_results(plant))
    assert 1 <= done < RUNS
    assert Store(plant).reprocess()["analyzed"] == RUNS - done


def test_a_scheduler_without_workers_is_a_sentence(
    plant: Path, cluster: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    cluster.scale(0)
    monkeypatch.setattr(analysing, "_PATIENCE", 1)
    with pytest.raises(InputError, match="has no workers: start some with 'dask worker tcp://"):
        Store(plant).reprocess(scheduler=cluster.scheduler_address)


@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("tcp://192.0.2.1:8786", "is on another computer; .* use TLS"),
        ("scheduler:8786", "is on another computer"),
        ("tcp://127.0.0.1.example:8786", "is on another computer"),
        ("ws://127.0.0.1:8786", "is on another computer"),
        ("tcp://127.0.0.1", "its address is as tcp://127.0.0.1:8786"),
        ("tcp://[::1:8786", "its address is as"),
        ("", "its address is as"),
    ],
)
def test_a_scheduler_that_others_reach_is_refused(address: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        analysing.check_workers(1, address)


@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("127.0.0.1:1", "cannot be reached"),
        ("tcp://[::1]:1", "cannot be reached"),
        ("tls://192.0.2.1:1", "TLS needs certificates"),
    ],
)
def test_a_scheduler_that_does_not_answer_is_a_sentence(
    monkeypatch: pytest.MonkeyPatch, address: str, sentence: str
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(analysing, "_PATIENCE", 0.5)
    analysing.check_workers(1, address)
    task = analysing.Task("run", "files", (), {}, {}, "joint")
    with pytest.raises(InputError, match=sentence):
        next(analysing.analysed([task], scheduler=address))


def test_a_missing_extra_is_named(plant: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"ballscrew\[cluster\]"):
        Store(plant).reprocess(scheduler="tcp://127.0.0.1:8786")


def test_a_worker_of_another_version_adds_nothing(plant: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    task = analysing.Task
    monkeypatch.setattr("ballscrew.store.reprocessing.Task", lambda *given: task(*given, version="9.9"))
    document = Store(plant).reprocess()
    assert len(document["failures"]) == RUNS
    assert "and this is 9.9" in document["failures"][0]
    assert new_results(plant) == []


def tasks_of(path: Path, patched: pytest.MonkeyPatch) -> list[analysing.Task]:
    """Tasks of a reprocessing, of which none is done."""
    found: list[analysing.Task] = []

    def take(tasks: list[analysing.Task], *_: object) -> Iterator[Any]:
        found.extend(tasks)
        return iter(())

    with patched.context() as patch:
        patch.setattr("ballscrew.store.reprocessing.analysed", take)
        Store(path).reprocess()
    return found


def test_a_run_that_cannot_be_analysed_is_a_sentence_beside_the_results_of_the_others(
    plant: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second, third, *_ = tasks_of(plant, monkeypatch)
    ((_, sha256, compression),) = second.files
    path_of(Path(second.folder), sha256, compression).unlink()
    result, missing, another = analysing.analyse_tasks([first, second, replace(third, run="another")])
    assert isinstance(result, bytes)
    assert Run.from_json(unpack(result)).id == first.run
    assert "cannot be read" in str(missing)
    assert another == f"the analysis gives another run, {third.run[:12]}"


def test_a_sentence_of_an_analysis_names_the_file_without_the_folder_of_its_copy(
    plant: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (task, *_) = tasks_of(plant, monkeypatch)

    def refuse(job: Any, _: object) -> None:
        raise InterruptedReadError(f"{job.files[0]}: cannot be read.")

    monkeypatch.setattr(analysing, "examine", refuse)
    with pytest.raises(InterruptedReadError, match=r"^trip0\.bin: cannot be read\.$"):
        analysing.analyse_files(Path(task.folder), task.files, task.documents, task.stated, method="joint")
    assert analysing.analyse_tasks([task]) == ["trip0.bin: cannot be read."]


def test_runs_of_a_task_that_kills_its_workers_are_named_and_the_others_are_analysed() -> None:
    class KilledError(Exception):
        """As of Dask."""

    class Workers(Executor):
        def submit(self, function: Any, runs: Any, /, *_: Any, **__: Any) -> Future[Any]:  # noqa: ARG002
            future: Future[Any] = Future()
            if runs[0].run == "0":
                future.set_exception(KilledError())
            else:
                future.set_result([b"result"] * len(runs))
            return future

    tasks = [analysing.Task(str(number), "files", (), {}, {}, "joint") for number in range(40)]
    workers = analysing._Workers(Workers(), lambda: 1, 2, (KilledError,))
    found = {int(task.run): result for task, result in analysing._distributed(tasks, workers)}
    killed = "it, or another of 2 runs, killed its workers"
    assert found == dict.fromkeys(range(40), b"result") | {0: killed, 1: killed}


def test_a_process_that_was_killed_is_a_sentence() -> None:
    with analysing._processes(1) as found:
        assert found.count() == 1
        assert found.executor.submit(abs, -1).result() == 1
    with (
        pytest.raises(InputError, match="a worker was killed; run the same command again"),
        analysing._processes(1) as found,
    ):
        found.executor.submit(os._exit, 9).result()


def test_a_scheduler_that_is_lost_meanwhile_is_a_sentence(cluster: Any) -> None:
    for error in (CancelledError, OSError):
        with (
            pytest.raises(InputError, match=r"the scheduler 'tcp://.*' was lost"),
            analysing._cluster(cluster.scheduler_address),
        ):
            raise error


def test_fewer_workers_than_one_are_refused() -> None:
    with pytest.raises(InputError, match="the number of workers is 0; it must be 1 or more"):
        analysing.check_workers(0, None)
    with pytest.raises(InputError, match="give --scheduler or --workers"):
        analysing.check_workers(2, "tcp://127.0.0.1:8786")
