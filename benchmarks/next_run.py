"""Processor time and memory to judge the next run from a checkpoint, and from the first run.

    python -m benchmarks.next_run [--runs 30 365 1825] [--page PAGE]

A simulated axis with a run a day, worn in the last days: an alarm with causes, stage and forecast is the
dearest case. The checkpoint is read from its bytes; limits that the process remembers are forgotten before.
Through the store: the same by ``monitor --store`` with SQLite, from the rows that were read to those that are
durable.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import tracemalloc
from collections.abc import Iterator, Sequence
from pathlib import Path

from sqlalchemy import select

import ballscrew
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.calibration import calibrate
from ballscrew.modal.run import Run
from ballscrew.monitoring.checkpoint import Checkpoint
from ballscrew.monitoring.detection import limits
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.health import health_of
from ballscrew.monitoring.history import read_history
from ballscrew.store.adding import METHOD_REVISION, add_model, add_run
from ballscrew.store.assessing import monitor_axis
from ballscrew.store.inserting import insert_run
from ballscrew.store.migrating import create_store
from ballscrew.store.opened import OpenStore
from ballscrew.store.tables import StateRow
from benchmarks.identification_tables import write
from benchmarks.machine import heading
from benchmarks.preload import axis

WORN, LIFE = 12.5, 150.0  # days


def history(count: int) -> tuple[list[Run], CalibratedAxis]:
    """Runs of an axis, a day apart, and its model."""
    simulated = axis(0)
    runs = []
    for day in range(count):
        ratio = (1 - max(day - (count - WORN), 0.0) / LIFE) ** 3
        runs.append(simulated.measured(9000 + day, ratio, day=float(day)))
    return runs, calibrate(simulated.experiment(), simulated.sheet)


def row(count: int) -> str:
    """Row of the table."""
    runs, model = history(count + 1)
    settings = MonitorSettings()
    begin = time.process_time()
    before = ballscrew.monitor(runs[:-1], model)
    first = time.process_time() - begin
    data = before.checkpoint.to_bytes() if before.checkpoint is not None else b""
    limits._KNOWN.clear()
    begin = time.process_time()
    known = Checkpoint.from_bytes(data)
    health_of(read_history(runs[-1:], model, (), settings, known.history), model, (), settings)
    judging = time.process_time() - begin
    begin = time.process_time()
    ballscrew.monitor(runs[-1:], model, checkpoint=known)
    both = time.process_time() - begin
    tracemalloc.start()
    known = Checkpoint.from_bytes(data)
    ballscrew.monitor(runs[-1:], model, checkpoint=known)
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    size = len(data) / 1000
    stored, changed = through_store(runs, model)
    times = f"{first:.1f} | {judging:.2f} | {both:.2f} | {stored:.2f}"
    return f"| {count + 1} | {times} | {changed} | {peak:.0f} MB | {size:.0f} kB |"


def through_store(runs: Sequence[Run], model: CalibratedAxis) -> tuple[float, int]:
    """Processor time to assess the newest run by a store, and the number of states that are written."""
    with tempfile.TemporaryDirectory(prefix="ballscrew-") as folder:
        store = create_store(Path(folder) / "store")
        add_model(store, model)
        with store.write("benchmark") as session:
            for run in runs[:-1]:
                insert_run(session, run, METHOD_REVISION)
        axis = str(runs[0].axis)
        monitor_axis(store, axis)
        add_run(store, runs[-1])
        before = states(store)
        limits._KNOWN.clear()
        begin = time.process_time()
        found = monitor_axis(store, axis)
        used = time.process_time() - begin
        assert found.new_runs == 1
        return used, len(states(store) - before)


def states(store: OpenStore) -> set[tuple[int, int]]:
    """Run and checksum of each row of a state."""
    with store.read() as session:
        return {
            (run, checksum) for run, checksum in session.execute(select(StateRow.run_id, StateRow.checksum))
        }


def table(counts: Sequence[int]) -> Iterator[str]:
    """Lines of the table."""
    yield heading("python -m benchmarks.next_run")
    yield ""
    yield (
        "| run | all from the first, CPU-s | from a checkpoint | and forecast | through the store "
        "| states written | memory | checkpoint |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    ballscrew.monitor(*history(8))  # imports and compiles
    for count in counts:
        yield row(count)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, nargs="*", default=[30, 365, 1825])
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    lines = []
    for line in table(given.runs):
        print(line, flush=True)
        lines.append(line)
    if given.page is not None:
        write(given.page, "next run", lines)


if __name__ == "__main__":
    main()
