"""Runs of one, two and three trips: errors and 95 % intervals of :func:`ballscrew.analyze`.

    python -m benchmarks.few_trips [--axes 10] [--results FOLDER] [--page PAGE]

Every subset of the three trips of both states of the bench (BALLSCREW_DATA, or --data) and of random axes of
the testbed, with the plan's repetitions lowered to match. All errors in Hz against the truth, rotor free.

With --results recordings and the cells of every run are stored; stored runs are not repeated.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations
from pathlib import Path

import numpy as np

from ballscrew.fcft.plan import read_plan
from ballscrew.modal.analyze import analyze
from ballscrew.modal.run import Run
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.run import simulate_run
from ballscrew.testbed.trip import prepared
from benchmarks.axis_sampling import random_axis
from benchmarks.identification import STATES, StoredRun, load, save
from benchmarks.identification_tables import nearest, write
from benchmarks.machine import heading

TRIPS = 3
BENCH, AXES = {"preload-4-percent": "bench, 4 %", "preload-2-percent": "bench, 2 %"}, "random axes"


@dataclass(frozen=True)
class Source:
    """Recordings of one state of an axis, with its true frequencies by position."""

    name: str
    group: str
    folder: Path
    recordings: tuple[Path, ...]
    truth: Sequence[Sequence[float]]

    def run(self, trips: Sequence[int]) -> Run:
        """Result of some of the trips."""
        plan = replace(read_plan(self.folder / "plan.toml"), repetitions=len(trips))
        return analyze(
            [self.recordings[trip] for trip in trips],
            channels=self.folder / "channels.toml",
            axis=self.folder / "axis.toml",
            plan=plan,
        )


def bench_sources(folder: Path) -> Iterator[Source]:
    """Both states of the bench."""
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    for state in STATES:
        by_place = [(float(x), f) for x, f in truth[state]["axial_natural_frequency_Hz"].items()]
        recordings = tuple(sorted(folder.glob(f"{state}-trip*.h5")))
        yield Source(state, BENCH[state], folder, recordings, by_place)


def random_source(seed: int, folder: Path) -> Source:
    """A random axis, simulated unless its recordings are there."""
    axis = random_axis(seed)
    plan = replace(axis.plan, repetitions=TRIPS)
    if not (folder / "run.toml").is_file():
        simulate_run(axis.rig, plan, axis.load, folder, seed=2 * seed, sheet=axis.data_sheet)
    c = prepared(axis.rig.machine, axis.load, plan)
    truth = [(x, true_frequency(c, x)) for x in plan.positions]
    return Source(f"axis-{seed:03d}", AXES, folder, tuple(sorted(folder.glob("*.h5"))), truth)


def subset_run(source: Source, trips: Sequence[int], results: Path | None) -> StoredRun:
    """Cells of a subset, and the mean of their errors with its standard uncertainty."""
    number = "".join(str(trip + 1) for trip in trips)
    path = results / f"{source.name}-trips-{number}.json" if results else None
    stored = load(path)
    if "rows" in stored:
        return stored
    run = source.run(trips)
    reported = [cell.frequency_Hz is not None for cell in run.cells]
    rows = []
    for cell in run.cells:
        if cell.frequency_Hz is not None:
            error = cell.frequency_Hz - nearest(source.truth, cell.position_m)
            rows.append((cell.position_m, cell.condition, error, cell.standard_uncertainty_Hz, cell.verdict))
    means = [np.mean(np.array(shared.effects_Hz)[reported]) for shared in run.shared_errors if any(reported)]
    stored = {
        "group": source.group,
        "source": source.name,
        "trips": len(trips),
        "cells": len(run.cells),
        "mean_uncertainty": float(np.sqrt(np.sum(np.square(means)))),
        "rows": rows,
    }
    save(path, stored)
    return stored


def table(runs: Sequence[StoredRun]) -> list[str]:
    """One row for each source and number of trips."""
    out = [
        (
            "| recordings | trips | runs | cells reported | median / 90th | in the 95 % interval | "
            "95 % | mean error beyond 2 u |"
        ),
        "|---|---|---|---|---|---|---|---|",
    ]
    for group in (*BENCH.values(), AXES):
        for trips in range(1, TRIPS + 1):
            of_row = [r for r in runs if (r["group"], r["trips"]) == (group, trips)]
            if of_row:
                out.append(f"| {group} | {trips} | {_row(of_row)} |")
    return out


def _row(runs: Sequence[StoredRun]) -> str:
    """Columns of a row after the first two; the coverage with its standard error by axes."""
    errors = np.array([row[2] for run in runs for row in run["rows"]])
    uncertainties = np.array([row[3] for run in runs for row in run["rows"]])
    cells = sum(run["cells"] for run in runs)
    by_source: dict[str, list[bool]] = {}
    beyond = 0
    for run in runs:
        rows = run["rows"]
        inside = [abs(row[2]) <= 1.96 * row[3] for row in rows]
        by_source.setdefault(run["source"], []).extend(inside)
        if rows and abs(np.mean([row[2] for row in rows])) > 2 * run["mean_uncertainty"]:
            beyond += 1
    inside = [value for values in by_source.values() for value in values]
    coverage = 100 * np.mean(inside)
    spread = ""
    if len(by_source) > 1:
        # Cells of one axis are not independent: scatter of the axes' own shares.
        excess = [np.sum(np.array(values) - np.mean(inside)) for values in by_source.values()]
        spread = f" ± {100 * np.sqrt(np.sum(np.square(excess))) / len(inside):.0f}"
    median, most = np.quantile(np.abs(errors), (0.5, 0.9))
    return (
        f"{len(runs)} | {100 * len(errors) / cells:.0f} % | {median:.2f} / {most:.2f}"
        f" | {coverage:.0f}{spread} % | ±\u2009{1.96 * np.median(uncertainties):.2f} | {beyond}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("BALLSCREW_DATA", "../shared/data")))
    parser.add_argument("--axes", type=int, default=10)
    parser.add_argument("--results", type=Path)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        recordings = (given.results or Path(name)) / "recordings"
        sources: list[Source] = []
        if (given.data / "bench").is_dir():
            sources += bench_sources(given.data / "bench")
        sources += [random_source(seed, recordings / f"{seed:03d}") for seed in range(given.axes)]
        runs = []
        for source in sources:
            subsets = chain.from_iterable(combinations(range(TRIPS), count) for count in (1, 2, 3))
            runs += [subset_run(source, trips, given.results) for trips in subsets]
            print(f"{source.name}: done", file=sys.stderr, flush=True)
    lines = [heading(f"python -m benchmarks.few_trips --axes {given.axes}"), "", *table(runs)]
    print("\n".join(lines))
    if given.page is not None:
        write(given.page, "few trips", lines)


if __name__ == "__main__":
    main()
