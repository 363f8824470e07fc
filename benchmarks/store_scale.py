"""A store of 300 axes over five years: times to read and to add, and its size.

``python -m benchmarks.store_scale`` uses SQLite in a temporary folder, ``--database URL`` an empty PostgreSQL
database. Rows are synthetic, and their number is that of real ones: 40 cells a run.
"""

from __future__ import annotations

import argparse
import gc
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from sqlalchemy import select, text

from ballscrew.base.provenance import FileRef
from ballscrew.modal.run import Run
from ballscrew.store.adding import add_run
from ballscrew.store.fleet import simulate_fleet
from ballscrew.store.migrating import create_store
from ballscrew.store.opened import OpenStore
from ballscrew.store.reading import find_axis, list_axes, trend
from ballscrew.store.rows import unpack
from ballscrew.store.showing import show_axis
from ballscrew.store.tables import Axis, ResultRow

_REPEATS = 300


class PooledStore(OpenStore):
    """A store whose connections to PostgreSQL stay open, as in a server."""

    pooled = True


def milliseconds(action: Callable[[int], object], repeats: int) -> str:
    """Median and 99th percentile of the time of an action, and of its processor time."""
    times = []
    for number in range(repeats):
        begin, used = time.perf_counter(), time.process_time()
        action(number)
        times.append((1e3 * (time.perf_counter() - begin), 1e3 * (time.process_time() - used)))
    wall, cpu = np.percentile(times, (50, 99), axis=0).T
    return f"median {wall[0]:.1f} ms, p99 {wall[1]:.1f} ms; processor {cpu[0]:.1f} and {cpu[1]:.1f} ms"


def read_trend(store: OpenStore, name: str) -> None:
    """Trend of an axis."""
    with store.read() as session:
        trend(session, find_axis(session, name))


def size_of(store: OpenStore) -> int:
    """Bytes of the database."""
    if store.folder.database_url() is None:
        return sum(path.stat().st_size for path in store.path.glob("store.sqlite*"))
    with store.read() as session:
        return int(session.scalar(text("SELECT pg_database_size(current_database())")) or 0)


def measure(store: OpenStore) -> None:
    """Print how long it takes to read and to add."""
    gc.set_threshold(100_000)  # as ``ballscrew`` does: a search for garbage takes 80 ms
    with store.read() as session:
        names = list(session.scalars(select(Axis.name).order_by(Axis.name)))
        template = Run.from_json(unpack(session.scalars(select(ResultRow.document).limit(1)).all()[0]))
    order = np.random.default_rng(1).integers(0, len(names), _REPEATS)
    print("trend of an axis:", milliseconds(lambda k: read_trend(store, names[order[k]]), _REPEATS))
    print("axis with all it has:", milliseconds(lambda k: show_axis(store, names[order[k]]), _REPEATS))
    print("fleet overview:", milliseconds(lambda _: list_axes(store), 100))
    new = [
        replace(template, id=f"new {number}", files=(FileRef("trip.h5", f"{number:064}"),))
        for number in range(100)
    ]
    print("add of a run:", milliseconds(lambda k: add_run(store, new[k]), 100), flush=True)


def main() -> None:
    """Fill a store and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--axes", type=int, default=300)
    parser.add_argument("--years", type=float, default=5.0)
    parser.add_argument("--runs-per-week", type=float, default=1.0)
    parser.add_argument("--cells", type=int, default=40)
    parser.add_argument("--database")
    parser.add_argument("--store", type=Path, help="store that was filled before")
    given = parser.parse_args()
    if given.store:
        measure(PooledStore(given.store))
        return
    folder = Path(tempfile.mkdtemp(prefix="ballscrew-scale-"))
    try:
        store = create_store(folder / "store", database=given.database)
        begin = time.perf_counter()
        rows = simulate_fleet(
            store, axes=given.axes, years=given.years, runs_per_week=given.runs_per_week, cells=given.cells
        )
        print(f"{rows['axes']} axes, {rows['runs']} runs, {rows['cells']} cells", flush=True)
        print(f"filled in {time.perf_counter() - begin:.0f} s", flush=True)
        size = size_of(store)
        print(f"size {size / 1e9:.2f} GB, {size / rows['runs']:.0f} bytes a run", flush=True)
        # In a new process: the garbage of this one would be collected meanwhile.
        command = [sys.executable, "-m", "benchmarks.store_scale", "--store", str(store.path)]
        subprocess.run(command, check=True)  # noqa: S603
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
