"""Workers: processes that analyse and assess, return results through a pipe, and never write."""

from __future__ import annotations

import logging
import multiprocessing
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import BallscrewError, InterruptedReadError
from ballscrew.modal.run import Run
from ballscrew.service import jobs
from ballscrew.service.alarms import report_bad_measurement, report_refused_assessment, write_messages
from ballscrew.service.counting import doubts_of
from ballscrew.service.jobs import Lease
from ballscrew.service.runs import QUEUED, REFUSED, SET_ASIDE, document_texts, store_result
from ballscrew.service.serving import FULL, UNAVAILABLE, RefusedError, Service
from ballscrew.store.assessing import compute_assessment
from ballscrew.store.assessment_rows import MadeAssessment, store_assessment
from ballscrew.store.folder import now
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.reading import find_axis
from ballscrew.store.same_recordings import SameRecordingError
from ballscrew.store.service_tables import JobRow, Upload
from ballscrew.store.tables import Axis, RawFile

_log = logging.getLogger("ballscrew.service")

_TICK = 0.2  # s between looks at whether the service stops
_IDLE = 1.0  # s between looks at whether a job is due
_STOP = 5.0  # s that a worker has to end
_START = 120.0  # s within which a worker is ready; compiled code may have to be compiled again


@dataclass(frozen=True, slots=True)
class AnalysisTask:
    """Recordings to analyse, as plain data for a process.

    Parameters
    ----------
    folder : str
        Folder of raw files.
    files : tuple of (name, sha256, compression)
        Recordings in their order.
    texts : dict of str to str
        Text of each document by its kind.
    stated : dict
        Content of RUN.toml.
    method : str
        Method of the analysis.
    """

    folder: str
    files: tuple[tuple[str, str, str], ...]
    texts: dict[str, str]
    stated: dict[str, Any]
    method: str


@dataclass(frozen=True, slots=True)
class AssessmentTask:
    """An axis to assess.

    Parameters
    ----------
    store : str
        Data folder of the store, which is only read.
    axis : str
        Name of the axis.
    """

    store: str
    axis: str


Task = AnalysisTask | AssessmentTask


def work(pipe: Connection, scratch: str) -> None:
    """Main function of a worker: receive tasks and return results until the pipe is closed.

    Parameters
    ----------
    pipe : Connection
        To the service; a result is a pair of ``done``, ``refused`` or ``failed`` and the result or sentence.
    scratch : str
        Folder for temporary files.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the service stops this one
    Path(scratch).mkdir(parents=True, exist_ok=True)
    tempfile.tempdir = scratch
    _import_all()
    with suppress(EOFError, OSError):
        pipe.send(("ready", None))
        while (task := pipe.recv()) is not None:
            pipe.send(do_task(task))


def _import_all() -> None:
    """Import what a task needs, before the first one comes."""
    for name in ("ballscrew.store.analysing", "ballscrew.prognosis.monitor"):
        import_module(name)


def do_task(task: Task) -> tuple[str, Any]:
    """Do a task: ``done`` and its result, or ``refused`` or ``failed`` and a sentence."""
    try:
        if isinstance(task, AnalysisTask):
            from ballscrew.store.analysing import analyse_files

            run, readers = analyse_files(
                Path(task.folder), task.files, task.texts, task.stated, method=task.method
            )
            return "done", (run.to_json(), readers)
        return "done", assess(task)
    except InterruptedReadError as error:
        return "failed", str(error)
    except BallscrewError as error:
        return "refused", str(error)
    except Exception as error:  # noqa: BLE001  of whatever kind, the others are not stopped
        return "failed", f"unexpected error ({type(error).__name__}: {error})"


def assess(task: AssessmentTask) -> MadeAssessment:
    """Assess an axis of the store, without storing the result.

    Parameters
    ----------
    task : AssessmentTask
        The axis.

    Returns
    -------
    MadeAssessment
        Without its runs, which are in the store.
    """
    made = compute_assessment(OpenStore(task.store), task.axis)
    return replace(made, history=replace(made.history, runs=()))


class Worker:
    """A worker process, which is replaced when it ends or takes too long, and the thread that feeds it.

    Parameters
    ----------
    service : Service
        The service.
    number : int
        From 0.
    target : callable
        Main function of the process.
    """

    def __init__(
        self, service: Service, number: int, target: Callable[[Connection, str], None] = work
    ) -> None:
        self.target = target
        self.service = service
        self.number = number
        self.process: Any = None
        self.is_ready = False
        self.pipe: Connection | None = None
        self.thread = threading.Thread(target=self._run, name=f"worker {number}", daemon=True)

    def _start_process(self) -> bool:
        """Start the process, and wait until it is ready."""
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        scratch = str(self.service.scratch / str(self.number))
        self.process = context.Process(
            target=self.target, args=(other, scratch), name=f"ballscrew worker {self.number}"
        )
        self.process.start()
        other.close()
        return self._receive(_START) is not None

    def _receive(self, patience: float) -> tuple[str, Any] | None:
        """Next message of the process; None if it ended, takes too long, or the service stops."""
        deadline = time.monotonic() + patience
        pipe, stop_at = self.pipe, None
        if pipe is None:
            return None
        try:
            while not pipe.poll(_TICK):
                if time.monotonic() > deadline:
                    return None
                if self.service.stopping.is_set():
                    stop_at = stop_at or time.monotonic() + _STOP
                    if time.monotonic() > stop_at:
                        return None
            message: tuple[str, Any] = pipe.recv()
        except (EOFError, OSError):
            self.process.join(_STOP)  # so that its exit code is known
            return None
        return message

    def _end_process(self) -> str:
        """Kill the process, and describe how it ended."""
        if self.process is None:
            return "it did not start"
        ended = not self.process.is_alive()
        if not ended:
            self.process.kill()
        self.process.join(_STOP)
        code = self.process.exitcode
        if self.pipe is not None:
            self.pipe.close()
        self.process, self.pipe = None, None
        shutil.rmtree(self.service.scratch / str(self.number), ignore_errors=True)
        return f"its process ended ({code})" if ended else "it took too long"

    def _run(self) -> None:
        while not self.service.stopping.is_set():
            try:
                if not self.is_ready:
                    self._end_process()
                    self.is_ready = self._start_process()
                    continue
                lease = jobs.lease_job(self.service)
                if lease is None:
                    with self.service.work:
                        if not self.service.stopping.is_set():
                            self.service.work.wait(_IDLE)
                    continue
                self.is_ready = self._do(lease)
            except Exception as error:  # noqa: BLE001  a worker goes on, whatever it is
                _log.error("worker %d: %s", self.number, error, exc_info=not isinstance(error, RefusedError))
                self.service.stopping.wait(_IDLE)
        self._stop()

    def _stop(self) -> None:
        """End the process through its pipe."""
        if self.pipe is not None:
            with suppress(OSError):
                self.pipe.send(None)
            self.process.join(_STOP)
        self._end_process()

    def _do(self, lease: Lease) -> bool:
        """Do a job, and return whether the process can do another."""
        task = task_of(self.service, lease)
        if task is None or self.pipe is None:
            return True
        result = None
        with suppress(OSError):
            self.pipe.send(task)
            result = self._receive(self.service.settings.lease_s)
        if result is None and self.service.stopping.is_set():
            with self.service.store.write("release") as session:
                jobs.release_jobs(session, lease)
            return False
        if result is None:
            reason = self._end_process()
            fail(self.service, lease, f"the {lease.kind} job failed: {reason}.")
        else:
            finish(self.service, lease, *result)
        self.service.announce()
        return result is not None


def task_of(service: Service, lease: Lease) -> Task | None:
    """What a worker needs for a job; None if there is nothing to do, and the job is removed."""
    if lease.kind == jobs.ASSESS:
        return AssessmentTask(str(service.store.path), lease.argument)
    with service.store.read() as session:
        row = session.scalar(
            select(Upload).where(Upload.content == lease.argument, Upload.status.in_((QUEUED, SET_ASIDE)))
        )
        if row is not None:
            files = []
            for file in row.files or ():
                stored = session.get_one(RawFile, file["sha256"])
                files.append((file["name"], stored.sha256, stored.compression))
            texts = document_texts(session, row.stated)
            folder = str(service.store.folder.files)
            return AnalysisTask(folder, tuple(files), texts, row.stated, service.settings.method)
    with service.store.write("finish") as session:
        _remove(session, lease)
    return None


def _remove(session: Session, lease: Lease) -> None:
    row = jobs.is_current(session, lease)
    if row is not None:
        session.delete(row)


def finish(service: Service, lease: Lease, outcome: str, value: Any) -> bool:
    """Store the result of a job, unless its lease was lost.

    A result that the store does not accept is refused; an unexpected error is a failed attempt.

    Parameters
    ----------
    service : Service
        The service.
    lease : Lease
        Of the job.
    outcome : str
        done, refused or failed.
    value : object
        Result, or a sentence.

    Returns
    -------
    bool
        Whether the lease was current.
    """
    try:
        return _store_outcome(service, lease, outcome, value)
    except Exception as error:
        if isinstance(error, RefusedError) and error.status in (UNAVAILABLE, FULL):
            raise  # nothing can be stored: the job is repeated when its lease has ended
        if isinstance(error, BallscrewError) and outcome == "done":
            return finish(service, lease, "refused", str(error))
        _log.exception("%s %s", lease.kind, lease.argument[:12])
        fail(service, lease, f"unexpected error ({type(error).__name__}: {error})")
        return True


def _store_outcome(service: Service, lease: Lease, outcome: str, value: Any) -> bool:
    if outcome == "failed":
        fail(service, lease, str(value))
        return True
    with service.store.write("finish") as session:
        row = jobs.is_current(session, lease)
        if row is None:
            return False
        if lease.kind == jobs.ANALYSE:
            session.delete(row)
            session.flush()
            _finish_analysis(session, lease, outcome, value)
        elif outcome == "refused":
            row.lease = row.lease_until = None
            row.set_aside, row.error = True, value
            report_refused_assessment(session, find_axis(session, row.argument), value)
        else:
            _finish_assessment(session, row, value)
    return True


def _finish_analysis(session: Session, lease: Lease, outcome: str, value: Any) -> None:
    rows = _uploads(session, lease.argument)
    if not rows:
        return
    axis = session.get_one(Axis, rows[0].axis_id)
    if outcome == "refused":
        _reject(session, axis, rows, value)
        at = rows[0].stated.get("measured_at")
        if doubts_of(session, rows[:1]) != [None]:
            at = None
        time = at or rows[0].received_at
        report_bad_measurement(session, axis, time, [str(value)], is_dated=at is not None)
        return
    document, readers = value
    run = Run.from_json(document, "the run")
    try:
        store_result(session, axis, rows, run, readers)
    except SameRecordingError as error:  # no trouble with the measurement
        _reject(session, axis, rows, str(error))


def _reject(session: Session, axis: Axis, rows: Sequence[Upload], reason: str) -> None:
    """Refuse a run under each of its keys."""
    for row in rows:
        row.status, row.error, row.finished_at = REFUSED, reason, now()
    record(session, "reject", f"run {rows[0].key}", axis=axis.name, reason=reason)


def _finish_assessment(session: Session, row: JobRow, made: MadeAssessment) -> None:
    axis = find_axis(session, row.argument)
    if store_assessment(session, made):
        session.delete(row)
        write_messages(session, axis)
        report_refused_assessment(session, axis, None)
    else:  # a run has come meanwhile
        row.lease = row.lease_until = None


def _uploads(session: Session, content: str) -> list[Upload]:
    found = select(Upload).where(Upload.content == content, Upload.status.in_((QUEUED, SET_ASIDE)))
    return list(session.scalars(found.order_by(Upload.id)))


def fail(service: Service, lease: Lease, reason: str) -> None:
    """Record that a job has failed; after the last attempt the job is set aside with the reason.

    Parameters
    ----------
    service : Service
        The service.
    lease : Lease
        Of the job.
    reason : str
        A sentence.
    """
    _log.warning("%s %s: %s", lease.kind, lease.argument[:12], reason)
    if not jobs.fail_job(service, lease, reason):
        return
    with service.store.write("set aside") as session:
        if lease.kind == jobs.ASSESS:
            report_refused_assessment(session, find_axis(session, lease.argument), reason)
        else:
            for row in _uploads(session, lease.argument):
                row.status, row.error, row.finished_at = SET_ASIDE, reason, now()
