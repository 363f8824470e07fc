"""Analysis of stored raw files by processes of this computer or by the workers of a Dask scheduler.

Workers only read raw files and return results; the process that calls is the only one that writes.
"""

from __future__ import annotations

import logging
import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from ipaddress import ip_address
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from ballscrew._version import __version__
from ballscrew.base.errors import InputError, shown
from ballscrew.modal.analyze import AnalysisOptions, examine
from ballscrew.modal.job import Job
from ballscrew.modal.run import Run
from ballscrew.store.adding import reader_of
from ballscrew.store.raw_files import materialised, text_files
from ballscrew.store.rows import pack

_RUNS_OF_A_TASK = 10  # of Dask at most: as many are analysed again where a worker is killed
_WAITING = 2  # tasks a worker that are sent to it at the same time
_PATIENCE = 30  # s, for an answer of the scheduler and its first worker


@dataclass(frozen=True, slots=True)
class Task:
    """One run to analyse, as plain data for a process.

    Parameters
    ----------
    run : str
        Id of the run.
    folder : str
        Folder of raw files.
    files : tuple of (name, sha256, compression)
        Its recordings in their order.
    documents : dict of str to str
        Text of each document by its kind.
    stated : dict
        Content of its RUN.toml.
    method : str
        Method of the analysis.
    version : str
        Version that must analyse it.
    """

    run: str
    folder: str
    files: tuple[tuple[str, str, str], ...]
    documents: dict[str, str]
    stated: dict[str, Any]
    method: str
    version: str = __version__


def analyse_tasks(tasks: Sequence[Task]) -> list[bytes | str]:
    """Analyse runs in this process, which only reads their raw files.

    Parameters
    ----------
    tasks : sequence of Task
        The runs.

    Returns
    -------
    list of bytes or str
        RUN.json of each, packed, or the sentence why there is none.
    """
    return list(map(_analyse, tasks))


def _analyse(task: Task) -> bytes | str:
    try:
        run, _ = analyse_files(Path(task.folder), task.files, task.documents, task.stated, method=task.method)
    except InputError as error:
        return str(error)
    if run.id != task.run:
        return f"the analysis gives another run, {run.id[:12]}"
    if run.made.version != task.version:
        return f"its worker has ballscrew {run.made.version}, and this is {task.version}"
    return pack(run.to_json())


def analyse_files(
    folder: Path,
    files: Sequence[tuple[str, str, str]],
    documents: Mapping[str, str],
    stated: Mapping[str, Any],
    *,
    method: str,
) -> tuple[Run, list[str | None]]:
    """Analyse recordings of a store.

    Parameters
    ----------
    folder : Path
        Folder of raw files.
    files : sequence of (name, sha256, compression)
        The recordings in their order.
    documents : mapping of str to str
        Text of each document by its kind.
    stated : mapping
        Content of RUN.toml.
    method : str
        Method of the analysis.

    Returns
    -------
    tuple of Run and list
        The run, and the reader of each recording with its version.

    Raises
    ------
    InputError
        If they cannot be analysed; files are named without their temporary folders.
    """
    with text_files(documents) as texts, materialised(folder, list(files)) as paths:
        channels, axis, plan = (texts.get(kind) for kind in ("channels", "axis", "plan"))
        job = Job.read(paths, channels=channels, axis=axis, plan=plan, mass=stated["mass_kg"])
        job = replace(job, measured_at=stated["measured_at"], temperature=stated["temperature_C"])
        try:
            run = examine(job, AnalysisOptions(method=method)).run
            return run, [reader_of(path) for path in paths]
        except InputError as error:
            message = str(error)
            for path in paths:
                message = message.replace(str(path), path.name)
            raise type(error)(message) from None


@dataclass(frozen=True, slots=True)
class _Workers:
    """Workers: their executor and number, the runs of a task, and the error of a task that kills them."""

    executor: Executor
    count: Callable[[], int]
    runs_of_a_task: int = 1
    killed: tuple[type[Exception], ...] = ()


def analysed(
    tasks: Sequence[Task], workers: int = 1, scheduler: str | None = None
) -> Iterator[tuple[Task, bytes | str]]:
    """Analyse runs; the number of tasks that are underway is bounded.

    Parameters
    ----------
    tasks : sequence of Task
        The runs.
    workers, scheduler
        As for :func:`ballscrew.reprocess`.

    Yields
    ------
    tuple of Task and bytes or str
        A run and its result, as :func:`analyse_tasks` gives it, as they come.

    Raises
    ------
    InputError
        If the scheduler cannot be used, or it or a process of this computer was killed.
    """
    if workers == 1 and scheduler is None:
        for task in tasks:
            yield task, _analyse(task)
    elif tasks:
        with _processes(workers) if scheduler is None else _cluster(scheduler) as found:
            yield from _distributed(tasks, found)


def _distributed(tasks: Sequence[Task], workers: _Workers) -> Iterator[tuple[Task, bytes | str]]:
    runs_of_a_task = max(1, min(workers.runs_of_a_task, len(tasks) // (2 * _WAITING * workers.count())))
    starts = iter(range(0, len(tasks), runs_of_a_task))
    underway: dict[Future[list[bytes | str]], Sequence[Task]] = {}
    while True:
        for start in islice(starts, max(_WAITING * workers.count() - len(underway), 0)):
            runs = tasks[start : start + runs_of_a_task]
            underway[workers.executor.submit(analyse_tasks, runs)] = runs
        if not underway:
            return
        for future in wait(underway, return_when=FIRST_COMPLETED).done:
            runs = underway.pop(future)
            try:
                results = future.result()
            except workers.killed:
                results = [f"it, or another of {len(runs)} runs, killed its workers"] * len(runs)
            yield from zip(runs, results, strict=True)


@contextmanager
def _processes(number: int) -> Iterator[_Workers]:
    """Processes of this computer."""
    with ProcessPoolExecutor(number, multiprocessing.get_context("spawn")) as pool:
        try:
            yield _Workers(pool, lambda: number)
        except BrokenProcessPool:
            raise InputError("a worker was killed; run the same command again to go on.") from None


@contextmanager
def _cluster(address: str) -> Iterator[_Workers]:
    """Workers of a Dask scheduler, which repeats the tasks of those that are killed."""
    try:
        from distributed import Client, Security
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise InputError('--scheduler needs Dask: python -m pip install "ballscrew[cluster]".') from None
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # its errors are sentences here
    try:
        security: Any = Security()  # type: ignore[no-untyped-call]
        if address.startswith("tls") and security.get_connection_args("client")["ssl_context"] is None:
            raise InputError("TLS needs certificates, which Dask's configuration does not name.")
        client: Any = Client(address, timeout=_PATIENCE, security=security, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"the scheduler {shown(address)} cannot be reached ({error}).") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError:
            raise InputError(
                f"the scheduler {shown(address)} has no workers: start some with 'dask worker {address}'."
            ) from None
        try:
            yield _Workers(
                client.get_executor(pure=False),
                lambda: max(sum(client.nthreads().values()), 1),
                _RUNS_OF_A_TASK,
                (KilledWorker,),
            )
        except (CancelledError, OSError):
            raise InputError(
                f"the scheduler {shown(address)} was lost; run the same command again to go on."
            ) from None


def check_workers(workers: int, scheduler: str | None) -> None:
    """Check the number of workers, and that a scheduler is on this computer or uses TLS.

    Parameters
    ----------
    workers, scheduler
        As for :func:`ballscrew.reprocess`.

    Raises
    ------
    InputError
        If they cannot be used, or both are given.
    """
    if workers < 1:
        raise InputError(f"the number of workers is {workers}; it must be 1 or more.")
    if scheduler is None:
        return
    if workers > 1:
        raise InputError("the workers are those of the scheduler: give --scheduler or --workers.")
    scheme, host = _scheme_and_host(scheduler)
    own = host == "localhost"
    with suppress(ValueError):
        own = own or ip_address(host).is_loopback
    if scheme != "tls" and not (scheme == "tcp" and own):
        # Its messages are programs.
        raise InputError(
            f"the scheduler {shown(scheduler)} is on another computer; whoever reaches it can run programs "
            "on its workers; use TLS (tls://host:port)."
        )


def _scheme_and_host(address: str) -> tuple[str, str]:
    try:
        parts = urlsplit(address if "://" in address else f"tcp://{address}")
        if parts.hostname and parts.port is not None:
            return parts.scheme, parts.hostname
    except ValueError:
        pass
    raise InputError(f"the scheduler is {shown(address)}; its address is as tcp://127.0.0.1:8786.")
