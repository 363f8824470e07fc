"""Processes of the demo end with the main one, however it ends; the command makes a plant, and serves it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ballscrew.cli import serve_app
from ballscrew.cli.shell import INTERRUPTED
from ballscrew.service import demo, demo_processes, server

_LONG = 600.0  # s: a test that waits for it fails


def test_an_interrupt_ends_the_processes() -> None:
    begun: list[int] = []

    def interrupt() -> None:
        with demo_processes.demo_processes() as pool:
            begun.append(pool.submit(os.getpid).result())
            long = pool.submit(time.sleep, _LONG)
            while not long.running():  # before, it would be cancelled
                time.sleep(0.01)
            raise KeyboardInterrupt

    handler = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        interrupt()
    assert signal.getsignal(signal.SIGTERM) is handler
    assert begun[0] not in {process.pid for process in multiprocessing.active_children()}


def test_a_process_ends_with_the_main_one(tmp_path: Path) -> None:
    """It holds the pipe of the output open: that ends when the process has ended."""
    program = tmp_path / "main.py"
    program.write_text(
        "import os, time\n"
        "from ballscrew.service.demo_processes import demo_processes\n"
        "if __name__ == '__main__':\n"
        "    with demo_processes() as pool:\n"
        "        print(pool.submit(os.getpid).result(), flush=True)\n"
        f"        pool.submit(time.sleep, {_LONG})\n"
        "        os._exit(3)\n"
    )
    done = subprocess.run(  # noqa: S603
        [sys.executable, str(program)], stdout=subprocess.PIPE, text=True, timeout=_LONG / 2, check=False
    )
    assert done.returncode == 3
    assert int(done.stdout) != os.getpid()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends a process at once")
def test_a_demo_that_is_terminated_leaves_no_folder(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "ballscrew", "serve", "--demo", "--port", "0"],
        env=os.environ | {"TMPDIR": str(tmp_path)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    end = time.monotonic() + _LONG
    while not any(tmp_path.glob("ballscrew-demo-*/*")) and time.monotonic() < end:
        time.sleep(0.05)
    process.terminate()
    assert process.wait(_LONG) == INTERRUPTED
    assert not any(tmp_path.glob("ballscrew-demo-*"))


def test_what_a_process_imports_exists() -> None:
    demo_processes._import_all()
    assert "ballscrew.reproduction.plant_runs" in sys.modules


@pytest.mark.parametrize("data", [None, "plant"])
def test_the_command_makes_a_plant_and_serves_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, data: str | None
) -> None:
    given = None if data is None else tmp_path / data
    done: list[Any] = []

    @contextmanager
    def processes(*, early: bool) -> Iterator[ProcessPoolExecutor]:
        done.append(early)
        with ProcessPoolExecutor(1) as pool:  # begins no process before it has something to do
            yield pool
        done.append("shut down")

    @contextmanager
    def store(folder: Path | None, pool: Executor, _progress: Any) -> Iterator[Path]:
        assert isinstance(pool, ProcessPoolExecutor)
        done.append(folder)
        yield tmp_path / "made"
        done.append("removed")

    monkeypatch.setattr(demo_processes, "demo_processes", processes)
    monkeypatch.setattr(demo, "demo_store", store)
    monkeypatch.setattr(server, "serve", lambda folder, **options: done.append((folder, options)))
    assert serve_app.serve(data=given, port=0, demo=True) == 0
    served = (tmp_path / "made", {"config": None, "port": 0})
    assert done == [data is None, given, "shut down", served, "removed"]


def test_a_demo_in_a_thread_leaves_the_signals_as_they_are() -> None:
    handlers = []

    def demonstrate() -> None:
        with demo_processes._interrupted_by_termination():
            handlers.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=demonstrate)
    thread.start()
    thread.join()
    assert handlers == [signal.getsignal(signal.SIGTERM)]


def test_a_process_waits_for_the_main_one_and_then_ends_with_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done: list[object] = []
    parent = SimpleNamespace(join=lambda: done.append("join"))
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: parent)
    monkeypatch.setattr(os, "_exit", done.append)
    demo_processes._end_with_parent()
    assert done == ["join", 1]
