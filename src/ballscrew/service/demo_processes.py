"""Processes of ``serve --demo``; this module imports little, so that they begin at once."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from importlib import import_module

_PROCESSES = 2


@contextmanager
def demo_processes(*, early: bool = False) -> Iterator[ProcessPoolExecutor]:
    """Processes for :func:`ballscrew.service.demo.make_plant`.

    Parameters
    ----------
    early : bool
        Whether one of them begins at once. All begin when they have something to do.

    Yields
    ------
    ProcessPoolExecutor
        After an error or an interrupt, what they have not begun is not done.
    """
    pool = ProcessPoolExecutor(_PROCESSES, multiprocessing.get_context("spawn"), _begin_process)
    if early:
        pool.submit(_import_all)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _begin_process() -> None:
    """Ignore Ctrl-C, which the main process handles, and lower the priority: the main one has most to do."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(5)


def _import_all() -> None:
    """Import what a process needs, in another order than the main one: each compiles other modules."""
    for name in ("ballscrew.reproduction.plant_runs", "ballscrew.service.demo"):
        import_module(name)
