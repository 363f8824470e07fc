"""Reprocessing of stored runs by Dask: time, efficiency, memory, and whether every byte is that without Dask.

    python -m benchmarks.reprocessing [--runs 120] [--killed 24] [--trips 3]

The testbed makes four runs of three round trips, and a store has as many copies of them as are wanted, each
at another time. ``ballscrew reprocess`` then analyses copies of the store: without Dask, by
one worker, by two, and by two of which one is killed midway (of ``--killed`` runs). Scheduler and workers
are processes of this computer. The last lines extrapolate to 10,000 axes with a run a day. Needs
``os.wait4``, which Windows lacks.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
from sqlalchemy import select

from ballscrew.modal import analyze
from ballscrew.modal.analyze import Analysis, AnalysisOptions
from ballscrew.modal.job import Job
from ballscrew.store.adding import add
from ballscrew.store.checking import verify
from ballscrew.store.migrating import create_store
from ballscrew.store.opened import OpenStore
from ballscrew.store.tables import Method, ResultRow, RunRow
from ballscrew.testbed.example import AXIS, PLAN
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.run import simulate_run
from ballscrew.testbed.trip import Rig
from benchmarks.machine import heading
from benchmarks.speed import FEW, Spent
from benchmarks.store_kills import imitate_analysis

_PRELOADS = (1.0, 0.97, 0.9, 0.7)  # parts of the nominal one, of the recordings
_BEGIN = datetime(2026, 1, 1, 6, tzinfo=UTC)
_UNIT = 2**20 if sys.platform == "darwin" else 2**10  # of ru_maxrss, in a MiB
_FLEET = 10_000 * 365  # runs in a year
_WEEK = 7 * 86400.0  # s


def fill(folder: Path, runs: int, trips: int) -> Path:
    """A store with runs whose results are of an earlier revision."""
    folder.mkdir(exist_ok=True)
    store = create_store(folder / "store")
    plan = replace(PLAN, repetitions=trips)
    texts = []
    for number, part in enumerate(_PRELOADS):
        rig = Rig(Machine(AXIS, part * AXIS.nominal_preload))
        made = simulate_run(rig, plan, PLAN.masses[0], folder / f"run{number}", seed=number)
        texts.append((made.run, made.run.read_text(encoding="utf-8")))
    examine = analyze.examine
    setattr(analyze, "examine", imitate)  # noqa: B010  mypy
    for number in range(runs):
        path, text = texts[number % len(texts)]
        measured_at = (_BEGIN + timedelta(days=number)).isoformat()
        lines = [line for line in text.splitlines() if not line.startswith("measured_at")]
        path.write_text("\n".join([f'measured_at = "{measured_at}"', *lines]) + "\n", encoding="utf-8")
        for recording in path.parent.glob("*.h5"):
            with h5py.File(recording, "r+") as file:  # a recording belongs to a single run
                file.attrs["copy"] = number
        add(store, path)
    setattr(analyze, "examine", examine)  # noqa: B010  mypy
    with store.write("benchmark") as session:
        session.scalars(select(Method)).one().revision = 0
    return store.path


def imitate(job: Job, options: AnalysisOptions, **named: Any) -> Analysis:
    """Run of a job, without an analysis."""
    found = imitate_analysis(job, options, **named)
    return replace(found, run=replace(found.run, axis=AXIS.name, temperature_C=job.temperature))


def results(path: Path) -> dict[str, bytes]:
    """New result of each run, as stored."""
    with OpenStore(path).read() as session:
        found = session.execute(
            select(RunRow.run, ResultRow.document)
            .join(ResultRow, ResultRow.run_id == RunRow.id)
            .join(Method, Method.id == ResultRow.method_id)
            .where(Method.revision > 0)
        ).all()
    assert len({run for run, _ in found}) == len(found), "a run has two results"
    return {run: document for run, document in found}  # noqa: C416


@dataclass
class Cluster:
    """A scheduler and workers, as processes."""

    stack: ExitStack
    workers: int

    def __post_init__(self) -> None:
        """Start them."""
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        dashboard = ["--dashboard-address", "127.0.0.1:0"]
        self.processes = [self._start("scheduler", "--host", "127.0.0.1", "--port", str(port), *dashboard)]
        for _ in range(self.workers):
            options = ["--host", "127.0.0.1", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
            self.processes.append(self._start("worker", self.address, *options))

    def _start(self, *arguments: str) -> subprocess.Popen[bytes]:
        folder = self.stack.enter_context(tempfile.TemporaryDirectory(prefix="ballscrew-dask-"))
        command = [sys.executable, "-m", "dask", *arguments]
        return subprocess.Popen(  # noqa: S603
            command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def end(self) -> list[Spent]:
        """End them; what the scheduler and each worker took."""
        for process in self.processes:
            os.kill(process.pid, signal.SIGKILL)  # not by Popen, which would wait for it
        return [_spent(process) for process in self.processes]


def _spent(process: subprocess.Popen[bytes], begin: float = 0.0) -> Spent:
    """Wait for a process, and ask the operating system what it took."""
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    clock = time.perf_counter() - begin
    return Spent(clock, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / _UNIT)


def reprocess(store: Path, *options: str) -> tuple[subprocess.Popen[bytes], float]:
    """Start ``ballscrew reprocess``; the process and its begin."""
    command = [sys.executable, "-m", "ballscrew", "reprocess", "--store", str(store), *options, "--json"]
    begin = time.perf_counter()
    return subprocess.Popen(command, stdout=subprocess.DEVNULL), begin  # noqa: S603


def by_workers(store: Path, workers: int, *, kill: bool = False) -> tuple[Spent, list[Spent]]:
    """Reprocess by a cluster, of which a worker is killed midway; what the call and the cluster took."""
    with ExitStack() as stack:
        cluster = Cluster(stack, workers)
        process, begin = reprocess(store, "--scheduler", cluster.address)
        if kill:
            before = len(results(store))
            while len(results(store)) == before:
                assert process.poll() is None, "ended before the kill"
                time.sleep(0.2)
            time.sleep(1.0)
            os.kill(cluster.processes[-1].pid, signal.SIGKILL)
        spent = _spent(process, begin)
        assert process.returncode == 0, process.returncode
        return spent, cluster.end()


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=120)
    parser.add_argument("--killed", type=int, default=24, help="runs of the store whose worker is killed")
    parser.add_argument("--trips", type=int, default=FEW, help="round trips of each run")
    given = parser.parse_args()
    options = f"--runs {given.runs} --killed {given.killed} --trips {given.trips}"
    print(heading(f"python -m benchmarks.reprocessing {options}") + "\n")
    folder = Path(tempfile.mkdtemp(prefix="ballscrew-reprocessing-"))
    try:
        measure(folder, given.runs, given.killed, given.trips)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def measure(folder: Path, runs: int, killed: int, trips: int) -> None:
    """Print the table and what follows from it."""
    store = fill(folder, runs, trips)
    shutil.copytree(store, folder / "alone")
    process, begin = reprocess(folder / "alone")
    alone = _spent(process, begin)
    expected = results(folder / "alone")
    assert len(expected) == runs, len(expected)
    print("| | time, s | processor of the call, s | memory, MiB | of workers, s | memory, MiB |")
    print("|---|---|---|---|---|---|")
    _print_row("without Dask", alone, [])
    took = []
    for workers in (1, 2):
        copy = shutil.copytree(store, folder / f"workers{workers}")
        took.append(by_workers(copy, workers))
        _print_row(f"{workers} by Dask", *took[-1])
        check(copy, expected)
    one, two = took
    load = ", ".join(f"{each:.1f}" for each in os.getloadavg())
    efficiency = one[0].clock / two[0].clock / 2
    print(f"\nThe same bytes each time. Efficiency of two workers: {efficiency:.2f}; load average {load}.")
    copy = fill(folder / "kill", killed, trips)
    shutil.copytree(copy, folder / "expected")
    process, begin = reprocess(folder / "expected")
    _spent(process, begin)
    spent, _ = by_workers(copy, 2, kill=True)
    check(copy, results(folder / "expected"))
    print(
        f"One of two workers killed midway of {killed} runs: {spent.clock:.1f} s, the same bytes, none twice."
    )
    extrapolate(runs, one)


def _print_row(name: str, call: Spent, cluster: Sequence[Spent]) -> None:
    row = f"| {name} | {call.clock:.1f} | {call.processor:.1f} | {call.memory:.0f} |"
    workers = cluster[1:]
    if workers:
        processor, memory = sum(each.processor for each in workers), max(each.memory for each in workers)
        row += f" {processor:.1f} | {memory:.0f} |"
    print(row, flush=True)


def check(path: Path, expected: dict[str, bytes]) -> None:
    """Check that a store has the expected results, each once, and no fault."""
    found = results(path)
    assert found == expected, f"{len(found)} results of {len(expected)}"
    assert verify(path).faults == ()


def extrapolate(runs: int, one: tuple[Spent, list[Spent]]) -> None:
    """Print what a year of 10,000 axes would need by these figures."""
    call, cluster = one
    analysis, writing = cluster[1].processor / runs, call.processor / runs
    scheduling = cluster[0].processor / runs
    print(
        f"\nA run takes {analysis:.2f} s of a worker, {1e3 * writing:.0f} ms of the call and "
        f"{1e3 * scheduling:.1f} ms of the scheduler. A year of 10,000 axes with a run a day is then "
        f"{_FLEET * analysis / 3600:.0f} h of workers ({_FLEET * analysis / _WEEK:.0f} within a week, "
        f"{cluster[1].memory:.0f} MiB each) and {_FLEET * writing / 3600:.0f} h of the call, one process."
    )


if __name__ == "__main__":
    main()
