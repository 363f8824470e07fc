"""Jobs: leased to one worker, tried again after its death, set aside at last, and never done twice."""

from __future__ import annotations

import itertools
import json
import logging
import multiprocessing
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from tests.service.bad_worker import end_at_once, give_result, misbehave, never_end
from tests.service.conftest import (
    FILES,
    SETUP,
    NewService,
    client_of,
    send,
    send_result,
    wait_for,
    work_off,
)
from tests.service.pages.forms import fill_axis
from tests.store.stored import RUNS, count, imitate_analysis, write_recordings

from ballscrew.base.errors import InterruptedReadError
from ballscrew.service import jobs, working
from ballscrew.service.jobs import ASSESS, Lease, enqueue, fail_job, lease_job, release_jobs
from ballscrew.service.runs import REFUSED
from ballscrew.service.serving import RefusedError, Service
from ballscrew.service.working import AssessmentTask, Worker, do_task, finish, task_of, work
from ballscrew.store.adding import add
from ballscrew.store.service_tables import JobRow, Upload
from ballscrew.store.tables import Assessment, ResultRow, RunRow

OTHER = {"a.h5": b"another", "b.h5": b"run"}
SECOND = "/api/v1/axes/bench/runs/r2"


@contextmanager
def worker(service: Service, target: Callable[..., None]) -> Iterator[Worker]:
    """A worker process that runs."""
    started = Worker(service, 0, target)
    started.thread.start()
    try:
        yield started
    finally:
        service.stopping.set()
        service.announce()
        started.thread.join(600)
        assert not started.thread.is_alive()


@pytest.fixture
def own_process(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What the main function of a worker changes in its process is changed back."""
    monkeypatch.setattr(tempfile, "tempdir", None)
    former = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, former)


def leased(service: Service) -> Lease:
    """The next job."""
    lease = lease_job(service)
    assert lease is not None
    return lease


def write_result(service: Service) -> None:
    """Write the result that :func:`give_result` sends."""
    (service.store.path / "result.json").write_text(json.dumps([RUNS[0].to_json(), []]))


def drop_uploads(service: Service) -> None:
    """Leave no run that waits, as after its refusal."""
    with service.store.write("test") as session:
        for row in session.scalars(select(Upload)):
            row.status = REFUSED


def status_of(client: TestClient, key: str) -> str:
    sent = client.get("/api/v1/axes/bench/runs").json()["sent"]
    return str(next(each["status"] for each in sent if each["run"] == key))


def test_a_job_of_a_dead_or_frozen_worker_is_done_by_the_next(new_service: NewService) -> None:
    service = new_service(lease_s=1.0, back_off_s=0.0, attempts=1000)
    service.scratch.mkdir()
    (service.scratch / "run.json").write_text(json.dumps([RUNS[0].to_json(), []]))
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        send(client)
        with worker(service, misbehave):
            wait_for(lambda: status_of(client, "r1") == "done")
    assert int((service.scratch / "count").read_text()) >= 3
    assert (count(service.store, RunRow), count(service.store, ResultRow)) == (1, 1)


def test_a_run_whose_worker_always_dies_is_set_aside(new_service: NewService) -> None:
    service = new_service(back_off_s=0.0, attempts=2)
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        send(client)
        with worker(service, end_at_once):
            wait_for(lambda: status_of(client, "r1") == "set aside")
        (job,) = client.get("/api/v1/jobs").json()["jobs"]
        assert (job["status"], job["attempts"], job["error"]) == (
            "set aside", 2, "the analyse job failed: its process ended (9).",
        )  # fmt: skip
        assert client.post(f"/api/v1/jobs/{job['id']}/retry").status_code == 200
        assert client.post(f"/api/v1/jobs/{job['id']}/retry").status_code == 404
        assert work_off(service, lambda _: ("done", (RUNS[0].to_json(), []))) == 1
        assert status_of(client, "r1") == "done"


def test_a_poison_run_does_not_stop_the_others(new_service: NewService) -> None:
    service = new_service(back_off_s=0.0, attempts=3)
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        poison = send(client).json()["id"]
        send(client, SECOND, OTHER)

        def analyse(lease: object) -> tuple[str, object]:
            if lease.argument == poison:  # type: ignore[attr-defined]
                return "failed", "unexpected error (ValueError: x)"
            return "done", (RUNS[1].to_json(), [])

        work_off(service, analyse)
        assert (status_of(client, "r1"), status_of(client, "r2")) == ("set aside", "done")


def test_a_result_that_the_store_does_not_accept_is_refused_at_once(
    client: TestClient, service: Service
) -> None:
    send(client)
    early = replace(RUNS[0], measured_at="1961-05-05T00:00:00Z")
    assert work_off(service, lambda _: ("done", (early.to_json(), []))) == 1
    (sent,) = client.get("/api/v1/axes/bench/runs").json()["sent"]
    assert (sent["status"], "1961" in sent["error"]) == ("refused", True)
    assert count(service.store, JobRow) == count(service.store, RunRow) == 0


def test_a_run_whose_reader_was_killed_is_analysed_again(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the system, for want of memory: the files are not to blame."""
    send(client)
    lease = lease_job(service)
    assert lease is not None

    def fail(*_: object, **__: object) -> None:
        raise InterruptedReadError("a.h5: cannot be read: its reader was ended from outside; try again.")

    monkeypatch.setattr("ballscrew.store.analysing.analyse_files", fail)
    task = task_of(service, lease)
    assert task is not None
    outcome = do_task(task)
    assert outcome[0] == "failed"
    finish(service, lease, *outcome)
    assert status_of(client, "r1") == "queued"


def test_an_unexpected_error_while_a_result_is_stored_counts_as_an_attempt(
    new_service: NewService, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = new_service(back_off_s=0.0, attempts=2)
    monkeypatch.setattr("ballscrew.service.working.store_result", lambda *_: 1 / 0)
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        send(client)
        assert work_off(service, lambda _: ("done", (RUNS[0].to_json(), []))) == 2
        (job,) = client.get("/api/v1/jobs").json()["jobs"]
        assert (job["status"], "ZeroDivisionError" in job["error"]) == ("set aside", True)
        assert status_of(client, "r1") == "set aside"


@pytest.mark.parametrize("status", [503, 507])
def test_a_result_is_not_refused_because_the_store_cannot_be_written(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch, status: int
) -> None:
    send(client)
    lease = lease_job(service)
    assert lease is not None

    def refuse(*_: object) -> None:
        raise RefusedError(status, "the disk is full.")

    monkeypatch.setattr("ballscrew.service.working.store_result", refuse)
    with pytest.raises(RefusedError, match="the disk is full"):
        finish(service, lease, "done", (RUNS[0].to_json(), []))
    assert status_of(client, "r1") == "queued"


def test_a_result_that_comes_after_its_lease_was_lost_is_dropped(
    client: TestClient, service: Service
) -> None:
    send(client)
    now = time.time()
    first = lease_job(service, lambda: now)
    assert lease_job(service, lambda: now + 1) is None
    second = lease_job(service, lambda: now + service.settings.lease_s + 1)
    assert first is not None
    assert second is not None
    assert not finish(service, first, "done", (RUNS[0].to_json(), []))
    assert count(service.store, RunRow) == 0
    assert finish(service, second, "done", (RUNS[0].to_json(), []))
    assert not finish(service, second, "done", (RUNS[1].to_json(), []))
    assert count(service.store, RunRow) == 1


@pytest.mark.parametrize("jump", [-366 * 86_400.0, -86_400.0, 86_400.0])
def test_a_clock_that_jumps_delays_no_job_and_doubles_none(
    client: TestClient, service: Service, jump: float
) -> None:
    send(client)
    now = time.time()
    first = lease_job(service, lambda: now)
    second = lease_job(service, lambda: now + jump)  # the lease of the first cannot be judged
    assert first is not None
    assert second is not None
    assert lease_job(service, lambda: now + jump + 1) is None
    assert not finish(service, first, "done", (RUNS[0].to_json(), []))
    fail_job(service, second, "x", lambda: now)
    third = lease_job(service, lambda: now + jump)
    assert third is not None
    assert finish(service, third, "done", (RUNS[0].to_json(), []))
    assert (count(service.store, RunRow), count(service.store, JobRow)) == (1, 0)


def test_leases_of_a_server_that_has_ended_are_void(client: TestClient, service: Service) -> None:
    send(client)
    lease_job(service)
    assert lease_job(service) is None
    with service.store.write("test") as session:
        release_jobs(session)
    assert lease_job(service) is not None


def test_the_pause_between_attempts_doubles(new_service: NewService) -> None:
    service = new_service(back_off_s=10.0)
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        send(client)
    lease = lease_job(service)
    assert lease is not None
    finish(service, lease, "failed", "x")
    now = time.time()
    assert lease_job(service, lambda: now + 5) is None
    lease = lease_job(service, lambda: now + 11)
    assert lease is not None
    fail_job(service, lease, "x", lambda: now + 11)
    assert lease_job(service, lambda: now + 30) is None
    assert lease_job(service, lambda: now + 32) is not None


def test_the_pause_after_many_attempts_is_an_hour(new_service: NewService) -> None:
    service = new_service(back_off_s=10.0, attempts=5000)
    with client_of(service) as client:
        client.put("/api/v1/axes/bench", json=SETUP)
        send(client)
    lease = lease_job(service)
    assert lease is not None
    with service.store.write("test") as session:
        session.get_one(JobRow, lease.job).attempts = 4000
    now = time.time()
    fail_job(service, lease, "x", lambda: now)
    assert lease_job(service, lambda: now + 3599) is None
    assert lease_job(service, lambda: now + 3601) is not None


def test_sent_recordings_are_the_run_that_store_add_makes(
    client: TestClient, service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the same identity, in either order."""
    jobs = imitate_analysis(monkeypatch)
    path = write_recordings(tmp_path / "run", 1.0)
    files = {file.name: file.read_bytes() for file in sorted(path.parent.glob("*.bin"))}
    for name in ("axis", "plan"):
        (path.parent / f"{name}.toml").write_text({"axis": SETUP["sheet"], "plan": SETUP["plan"]}[name])
    text = path.read_text() + 'axis = "axis.toml"\nplan = "plan.toml"\n'
    path.write_text(text)
    answer = send(client, files=files, run_toml=text)

    def analyse(lease: object) -> tuple[str, object]:
        from ballscrew.service.working import do_task

        return do_task(task_of(service, lease))  # type: ignore[arg-type]

    work_off(service, analyse)
    assert status_of(client, "r1") == "done"
    assert not add(service.store, path).is_new
    assert len(jobs) == 1
    path.write_text(text.replace("100 kg", "100.0 kg"))
    assert add(service.store, path).is_new is False
    assert answer.json()["id"]


def test_recordings_of_store_add_are_not_analysed_again(
    client: TestClient, service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imitate_analysis(monkeypatch)
    path = write_recordings(tmp_path / "run", 1.0)
    for name in ("axis", "plan"):
        (path.parent / f"{name}.toml").write_text({"axis": SETUP["sheet"], "plan": SETUP["plan"]}[name])
    text = path.read_text() + 'axis = "axis.toml"\nplan = "plan.toml"\n'
    path.write_text(text)
    run = add(service.store, path).subject
    files = {file.name: file.read_bytes() for file in sorted(path.parent.glob("*.bin"))}
    answer = send(client, files=files, run_toml=text)
    assert (answer.status_code, answer.json()["result"]) == (200, run)
    assert count(service.store, JobRow) == 0
    assert FILES


@pytest.mark.usefixtures("own_process")
def test_a_worker_does_tasks_until_its_pipe_says_no_more(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its temporary files are in the folder that the service clears; the service answers Ctrl-C."""
    pipe, other = multiprocessing.Pipe()
    for task in (AssessmentTask(str(service.store.path), "none"), None):
        pipe.send(task)
    imported: list[str] = []
    monkeypatch.setattr(working, "import_module", imported.append)
    work(other, str(tmp_path / "scratch" / "0"))
    other.close()
    assert pipe.recv() == ("ready", None)
    assert "ballscrew.store.analysing" in imported  # before the first task comes
    status, sentence = pipe.recv()
    assert (status, "no axis 'none'" in sentence) == ("refused", True)
    with pytest.raises(EOFError):
        pipe.recv()
    assert tempfile.gettempdir() == str(tmp_path / "scratch" / "0")
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


@pytest.mark.usefixtures("own_process")
def test_a_worker_whose_service_has_gone_ends(tmp_path: Path) -> None:
    pipe, other = multiprocessing.Pipe()
    pipe.close()
    work(other, str(tmp_path / "0"))
    assert (tmp_path / "0").is_dir()


def test_an_unexpected_error_of_a_task_fails_it_and_names_the_error(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(working, "compute_assessment", lambda *_: 1 / 0)
    outcome = do_task(AssessmentTask(str(service.store.path), "bench"))
    assert outcome == ("failed", "unexpected error (ZeroDivisionError: division by zero)")


def test_a_job_that_is_running_when_the_server_stops_waits_for_the_next_without_an_attempt(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(working, "_STOP", 0.1)
    send(client)
    with worker(service, never_end) as started:
        wait_for(lambda: started.is_ready)
        wait_for(lambda: client.get("/api/v1/jobs").json()["jobs"][0]["status"] == "running")
        process = started.process
    (job,) = client.get("/api/v1/jobs").json()["jobs"]
    assert (job["status"], job["attempts"], job["error"]) == ("queued", 0, None)
    assert not process.is_alive()
    assert leased(service).argument == job["argument"]


@pytest.mark.parametrize(
    ("error", "has_traceback"), [(RefusedError(503, "no disk."), False), (OSError, True)]
)
def test_a_worker_goes_on_after_an_error_of_the_store(
    client: TestClient,
    service: Service,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    error: Exception,
    has_traceback: bool,
) -> None:
    """The log has a traceback of an error that was not foreseen only."""
    errors = [error]

    def lease(service: Service) -> Lease | None:
        if errors:
            raise errors.pop()
        return lease_job(service)

    monkeypatch.setattr(jobs, "lease_job", lease)
    monkeypatch.setattr(working, "_IDLE", 0.01)
    write_result(service)
    send(client)
    with caplog.at_level(logging.ERROR, "ballscrew.service"), worker(service, give_result):
        wait_for(lambda: status_of(client, "r1") == "done")
    (logged,) = caplog.records
    assert logged.getMessage().startswith("worker 0: ")
    assert bool(logged.exc_info) is has_traceback


def test_a_job_whose_run_no_longer_waits_is_removed_and_the_next_is_done(
    client: TestClient, service: Service
) -> None:
    write_result(service)
    send(client)
    drop_uploads(service)
    send(client, SECOND, OTHER)
    with worker(service, give_result):
        wait_for(lambda: status_of(client, "r2") == "done")
    assert (status_of(client, "r1"), count(service.store, JobRow)) == ("refused", 0)


def test_a_job_that_another_worker_has_leased_meanwhile_is_not_removed(
    client: TestClient, service: Service
) -> None:
    send(client)
    now = time.time()
    first = lease_job(service, lambda: now)
    second = lease_job(service, lambda: now + service.settings.lease_s + 1)
    assert first is not None
    drop_uploads(service)
    assert task_of(service, first) is None
    assert count(service.store, JobRow) == 1
    fail_job(service, first, "x")
    (job,) = client.get("/api/v1/jobs").json()["jobs"]
    assert (job["attempts"], job["status"]) == (0, "running")
    assert second is not None
    assert task_of(service, second) is None
    assert count(service.store, JobRow) == 0


def test_a_result_of_a_run_that_no_longer_waits_is_dropped(client: TestClient, service: Service) -> None:
    send(client)
    lease = leased(service)
    drop_uploads(service)
    assert finish(service, lease, "done", (RUNS[0].to_json(), []))
    assert (count(service.store, JobRow), count(service.store, RunRow)) == (0, 0)


def test_an_assessment_during_which_a_run_came_is_made_again(client: TestClient, service: Service) -> None:
    fill_axis(client, service, 4)
    with service.store.write("test") as session:
        enqueue(session, ASSESS, "bench")
    lease = leased(service)
    task = task_of(service, lease)
    assert task is not None
    outcome = do_task(task)
    stored = count(service.store, Assessment)
    send_result(client, 4)
    assert finish(service, lease, *outcome)
    assert count(service.store, Assessment) == stored
    assert leased(service).kind == ASSESS
    assert outcome[0] == "done"


def test_a_job_that_waits_is_not_added_again(client: TestClient, service: Service) -> None:
    """Its attempts are counted on."""
    send(client)
    lease = leased(service)
    fail_job(service, lease, "x")
    with service.store.write("test") as session:
        enqueue(session, lease.kind, lease.argument)
    (job,) = client.get("/api/v1/jobs").json()["jobs"]
    assert (job["attempts"], job["error"]) == (1, "x")


def test_a_job_that_another_worker_takes_first_is_not_leased_again(
    client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the look and the lease, which takes time."""
    send(client)
    write, found = service.store.write, []
    times = itertools.count(time.time(), 0.01)

    def write_later(*given: str) -> object:
        monkeypatch.setattr(service.store, "write", write)
        found.append(lease_job(service, lambda: next(times)))
        return write(*given)

    monkeypatch.setattr(service.store, "write", write_later)
    assert lease_job(service, lambda: next(times)) is None
    assert found[0] is not None
