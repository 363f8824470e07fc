"""Results that pages need of raw files: computed by one process when they are asked for, and cached."""

from __future__ import annotations

import logging
import math
import multiprocessing
import os
import queue
import shutil
import signal
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Annotated, Any, Protocol

from fastapi import Depends, Request
from fastapi.responses import JSONResponse

from ballscrew.base.errors import BallscrewError, InputError
from ballscrew.base.files import move_file
from ballscrew.service.serving import FULL, TOO_MANY, UNAVAILABLE, RefusedError, Service

_log = logging.getLogger("ballscrew.service")

_PATIENCE = 2.0  # s until an answer says that a result is being computed
_TICK = 0.2  # s between looks at whether the service stops
_IDLE = 300.0  # s without a task after which the process ends
_MOST_WAITING = 8  # tasks
_MOST_BYTES = 4 << 30  # of all results of a kind; the oldest are removed
_MOST_REFUSALS = 1000  # that are remembered
_PAUSE = 60.0  # s until a result is tried again that failed for a reason which may pass


class FileTask(Protocol):
    """Something to compute, as plain data for a process."""

    def write(self, folder: Path) -> None:
        """Write the result as files of a folder, one of them ``about.json``."""
        ...


@dataclass(frozen=True, slots=True)
class TaskFailure:
    """Why there is no result.

    Parameters
    ----------
    sentence : str
        The reason.
    lasts : bool
        Whether the task itself refuses, so that it would fail again.
    """

    sentence: str
    lasts: bool = False


def compute_tasks(pipe: Connection, scratch: str) -> None:
    """Main function of the process: receive tasks and folders until the pipe is closed.

    Parameters
    ----------
    pipe : Connection
        To the service; the answer is None, or why there is no result.
    scratch : str
        Folder for temporary files.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the service stops this one
    tempfile.tempdir = scratch
    with suppress(EOFError, OSError):
        while True:
            task, target = pipe.recv()
            pipe.send(compute(task, Path(target)))


def compute(task: FileTask, target: Path) -> TaskFailure | None:
    """Compute a result and write it, whole or not at all; why not, or None."""
    folder = None
    try:
        folder = Path(tempfile.mkdtemp(prefix="computing-", dir=target.parent))
        task.write(folder)
        if target.exists():  # what is left of a result
            _remove(target)
        move_file(folder, target)
    except BallscrewError as error:
        return TaskFailure(str(error), lasts=True)
    except Exception as error:  # noqa: BLE001  of whatever kind, the process goes on
        return _unexpected(error)
    finally:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
    return None


def _unexpected(error: Exception) -> TaskFailure:
    return TaskFailure(f"unexpected error ({type(error).__name__}: {error})")


class OnDemand:
    """Results of tasks of one kind in folders, and the process that computes them, one by one.

    Parameters
    ----------
    service : Service
        The service.
    kind : str
        Name of their folder in the scratch folder.
    """

    def __init__(self, service: Service, kind: str) -> None:
        self.service = service
        self.kind = kind
        self._lock = threading.Lock()
        self._tasks: queue.SimpleQueue[tuple[str, FileTask]] = queue.SimpleQueue()
        self._waiting: dict[str, threading.Event] = {}
        self._refusals: dict[str, tuple[TaskFailure, float]] = {}
        self._thread: threading.Thread | None = None
        self._process: Any = None
        self._pipe: Connection | None = None

    @property
    def _folder(self) -> Path:
        return self.service.scratch / self.kind

    def find(self, key: str, task: FileTask) -> Path | None:
        """Folder with the result of a task.

        Parameters
        ----------
        key : str
            Name of the result, of letters and digits.
        task : FileTask
            How it is computed.

        Returns
        -------
        Path or None
            None where it is not computed within two seconds: ask again.

        Raises
        ------
        InputError
            If it cannot be computed.
        RefusedError
            429 if too many results wait, 503 if it failed for a reason that may pass, 507 if the disk is
            full.
        """
        path = self._folder / key
        with self._lock:
            if _is_whole(path):
                os.utime(path)  # used last
                return path
            self._check_refusal(key)
            done = self._waiting.get(key) or self._enqueue(key, task)
        done.wait(_PATIENCE)
        with self._lock:
            self._check_refusal(key)
        return path if _is_whole(path) else None

    def look(self, key: str) -> Path | None:
        """As :meth:`find`, of a result that is there already: None otherwise, and nothing is computed."""
        path = self._folder / key
        with self._lock:
            self._check_refusal(key)
            if not _is_whole(path):
                return None
            os.utime(path)
        return path

    def _check_refusal(self, key: str) -> None:
        """Refuse what failed; what may succeed meanwhile only for a while."""
        failure, at = self._refusals.get(key, (None, 0.0))
        if failure is None:
            return
        if failure.lasts:
            raise InputError(failure.sentence)
        pause = math.ceil(at + _PAUSE - time.monotonic())
        if pause > 0:
            raise RefusedError(UNAVAILABLE, failure.sentence, {"Retry-After": str(pause)})
        del self._refusals[key]

    def _enqueue(self, key: str, task: FileTask) -> threading.Event:
        if len(self._waiting) >= _MOST_WAITING:
            raise RefusedError(TOO_MANY, "too many results are being computed.", {"Retry-After": "5"})
        if self.service.free_bytes() < self.service.settings.min_free_bytes:
            raise RefusedError(FULL, "the disk is full.", {"Retry-After": "60"})
        self._waiting[key] = threading.Event()
        self._tasks.put((key, task))
        if self._thread is None or not self._thread.is_alive():
            self._thread = threading.Thread(target=self._run, name="on demand", daemon=True)
            self._thread.start()
        return self._waiting[key]

    def _run(self) -> None:
        """Compute until no task has come for a while, or the service stops."""
        deadline = time.monotonic() + _IDLE
        while not self.service.stopping.is_set():
            try:
                key, task = self._tasks.get(timeout=_TICK)
            except queue.Empty:
                with self._lock:
                    if time.monotonic() > deadline and not self._waiting:
                        self._end_process()
                        self._thread = None
                        return
                continue
            self._finish(key, self._answer(key, task))
            deadline = time.monotonic() + _IDLE
        self._end_process()

    def _answer(self, key: str, task: FileTask) -> TaskFailure | None:
        """Why there is no result, or None."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            if self._process is None or not self._process.is_alive():
                self._end_process()
                self._start_process()
            return self._ask(task, self._folder / key)
        except Exception as error:  # noqa: BLE001  whatever it is, the next task is computed
            _log.exception("on demand")
            self._end_process()
            return _unexpected(error)

    def _finish(self, key: str, failure: TaskFailure | None) -> None:
        with self._lock:
            if failure is not None:
                if len(self._refusals) >= _MOST_REFUSALS:
                    self._refusals.clear()
                self._refusals[key] = failure, time.monotonic()
            try:
                _remove_oldest(self._folder, _MOST_BYTES)
            except OSError:
                _log.exception("on demand")
            finally:
                self._waiting.pop(key).set()

    def _start_process(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe()
        self._process = context.Process(
            target=compute_tasks, args=(other, str(self._folder)), name="ballscrew on demand", daemon=True
        )
        self._process.start()
        other.close()

    def _ask(self, task: FileTask, target: Path) -> TaskFailure | None:
        """Let the process compute a result; why there is none, or None."""
        assert self._pipe is not None  # noqa: S101
        deadline = time.monotonic() + self.service.settings.lease_s
        try:
            self._pipe.send((task, str(target)))
            while not self._pipe.poll(_TICK):
                if self.service.stopping.is_set():
                    return TaskFailure("the server stops.")
                if time.monotonic() > deadline:
                    self._end_process()
                    return TaskFailure(f"it took more than {self.service.settings.lease_s:.0f} s.")
            answer: TaskFailure | None = self._pipe.recv()
        except (EOFError, OSError):
            self._end_process()
            return TaskFailure("the process that computes it ended.")
        return answer

    def _end_process(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
        if self._pipe is not None:
            self._pipe.close()
        self._process, self._pipe = None, None


def _remove_oldest(folder: Path, limit: int) -> None:
    """Remove results, the ones first that were not used for longest; the newest stays whatever its size."""
    found = []
    for path in folder.iterdir():
        size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
        found.append((path.stat().st_mtime, size, path))
    total = 0
    for number, (_, size, path) in enumerate(sorted(found, reverse=True)):
        total += size
        if number > 0 and total > limit:
            _remove(path)


def _remove(path: Path) -> None:
    """Remove a result whole: who reads it has all of its files, or no folder."""
    folder = tempfile.TemporaryDirectory(prefix="removing-", dir=path.parent, ignore_cleanup_errors=True)
    with folder as target, suppress(OSError):  # on Windows one that is being read stays
        path.rename(Path(target) / path.name)


def _is_whole(folder: Path) -> bool:
    """Whether there is a result, and not only what is left of one."""
    return (folder / "about.json").is_file()


def not_yet(sentence: str) -> JSONResponse:
    """Answer that a result is being computed."""
    return JSONResponse({"detail": sentence}, 202, {"Retry-After": "1"})


def signals_of(request: Request) -> OnDemand:
    """Signals of raw files of the service of a request, which never wait for an FRF."""
    found: OnDemand = request.app.state.signals
    return found


def responses_of(request: Request) -> OnDemand:
    """FRFs of the service of a request."""
    found: OnDemand = request.app.state.responses
    return found


Signals = Annotated[OnDemand, Depends(signals_of)]
Responses = Annotated[OnDemand, Depends(responses_of)]
