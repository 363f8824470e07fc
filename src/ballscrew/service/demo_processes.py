"""Processes of ``serve --demo``; this module imports little, so that they begin early."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from importlib import import_module

_PROCESSES = 2


@contextmanager
def demo_processes(*, early: bool = False) -> Iterator[ProcessPoolExecutor]:
    """Processes for :func:`ballscrew.service.demo.make_plant`.

    Parameters
    ----------
    early : bool
        Whether one process begins at once, to import what it needs; else each begins with its first task.

    Yields
    ------
    ProcessPoolExecutor
        Used within :func:`shut_down`.
    """
    pool = ProcessPoolExecutor(_PROCESSES, multiprocessing.get_context("spawn"), _begin_process)
    if early:
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN)  # a process that begins ignores it too
        pool.submit(_import_all)
        signal.signal(signal.SIGINT, handler)
    with _interrupted_by_termination(), shut_down(pool):
        yield pool


@contextmanager
def _interrupted_by_termination() -> Iterator[None]:
    """Let SIGTERM interrupt the process like Ctrl-C, so that temporary folders are removed."""
    before = signal.getsignal(signal.SIGTERM)
    if threading.current_thread() is not threading.main_thread() or before is None:
        yield
        return
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def shut_down(pool: Executor) -> Iterator[None]:
    """Shut processes down at the end; after an error or an interrupt, end them at once."""
    try:
        yield
    except BaseException:
        for process in multiprocessing.active_children():
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin_process() -> None:
    """Ignore Ctrl-C, which the main process handles; lower the priority, since that one has most to do."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(5)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when the main one has ended, in whatever way."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _import_all() -> None:
    """Import what a process needs, in another order than the main one: each compiles other modules."""
    for name in ("ballscrew.reproduction.plant_runs", "ballscrew.service.demo"):
        import_module(name)
