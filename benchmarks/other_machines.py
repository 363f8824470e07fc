"""Preload of machines that the data sheet does not describe, from recordings.

    python -m benchmarks.other_machines --results FILE --cache FOLDER [--axes 10] [--worlds NAME,NAME]
        [--workers 2] [--page PAGE]

Is *good* to be relied on? For each axis and world of :mod:`benchmarks.other_worlds`: two loads calibrate the
axis when new, the second is the baseline, and later runs have P/P₀ of 1, 0.85 and 0.6. Every run is simulated
and goes through ``analyze``, ``calibrate`` and ``preload``. Each result is a line of FILE; results that it
has already are not repeated. FOLDER keeps analysed runs; empty it when the package has changed. ``--axes 0``
only makes the table, which --page writes into a page between its marks.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import ballscrew
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import BallscrewError
from ballscrew.base.jsonfile import write_json
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.calibration import calibrate
from ballscrew.estimation.preload import preload
from ballscrew.modal.run import Run
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.run import simulate_run
from benchmarks.identification_tables import write
from benchmarks.machine import heading
from benchmarks.other_tables import world_table
from benchmarks.other_worlds import GROUPS, LOW_LOAD, WORLDS, Bench, World, bench, keeps_contact, truth

Row = dict[str, Any]
DAYS = {"low": "2026-01-05T08:00Z", "new": "2026-01-05T10:00Z", 1.0: "2026-02-02T08:00Z",
        0.85: "2026-05-04T08:00Z", 0.6: "2026-08-03T08:00Z"}  # fmt: skip


def simulated(one: Bench, group: str, state: str | float, sheet: DataSheet, seed: int) -> Run:
    """Simulate and analyse the run of a state: ``"low"`` and ``"new"``, or P/P₀ of a later run."""
    machine: Machine = one.rig.machine if isinstance(state, str) else one.later(state)
    load = round(LOW_LOAD * one.load, 1) if state == "low" else one.load
    stream = [*GROUPS].index(group) * 10 + [*DAYS].index(state)
    plan = replace(one.plan, masses=(load,))
    with tempfile.TemporaryDirectory() as name:
        files = simulate_run(
            replace(one.rig, machine=machine), plan, load, Path(name), seed=1000 * seed + stream,
            sheet=sheet, measured_at=DAYS[state], workers=1,
        )  # fmt: skip
        return ballscrew.analyze(files.run)


def analysed(seed: int, world: World, state: str | float, folder: Path) -> Run:
    """Run of a state from the folder, or new and put there."""
    one = bench(seed, world.group)
    group = one.new_as if isinstance(state, str) else world.group
    reader = world.name if world.reanalysed else "right sheet"
    path = folder / f"{seed:03d} {group} {state} {reader}.json"
    if path.exists():
        return Run.read(path)
    sheet = world.stated(one.sheet) if world.reanalysed else one.sheet
    run = simulated(one, group, state, sheet, seed)
    path.write_text(write_json(run.to_json()), encoding="utf-8")
    return run


def assessed(seed: int, world: World, folder: Path) -> list[Row]:
    """Results of the later runs of one axis in one world."""
    one = bench(seed, world.group)

    @cache
    def model() -> tuple[CalibratedAxis, Run]:
        runs = [analysed(seed, world, state, folder) for state in ("low", "new")]
        return calibrate(runs, world.stated(one.sheet)), runs[1]

    rows = []
    for ratio in world.ratios:
        true = truth(one, ratio)
        row: Row = {"axis": seed, "world": world.name, "ratio": ratio}
        row["contact"] = keeps_contact(one, ratio)
        try:
            calibrated, baseline = model()
            estimate = preload(analysed(seed, world, ratio, folder), calibrated, baseline)
        except BallscrewError as error:
            refusal: Row = {"verdict": "refused", "reasons": [str(error)]}
            row |= {"stiffness": {"true": true.stiffness, **refusal}, "nut": {"true": true.nut, **refusal}}
        else:
            row["doubts"] = [doubt.name for doubt in calibrated.reasons]
            row["causes"] = [[cause.name, cause.probability] for cause in estimate.causes]
            row["stiffness"] = result(
                true.stiffness,
                estimate.verdict,
                estimate.stiffness_relative_to_baseline,
                estimate.reasons,
            )
            row["nut"] = result(
                true.nut,
                estimate.nut_verdict,
                estimate.relative_to_baseline,
                estimate.nut_reasons,
            )
        rows.append(row)
    return rows


def result(true: float, verdict: str, quantity: Quantity | None, reasons: Sequence[str]) -> Row:
    """One result beside its true value."""
    row: Row = {"true": true, "verdict": verdict, "reasons": list(reasons)}
    if quantity is not None:
        row |= {"value": quantity.value, "interval": list(quantity.interval)}
    return row


def group_of(seed: int, worlds: Sequence[World], folder: Path) -> list[Row]:
    """Results of one axis in worlds that share recordings."""
    rows: list[Row] = []
    for world in worlds:
        rows += assessed(seed, world, folder)
    return rows


def read(path: Path) -> list[Row]:
    """Results so far."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def missing(rows: Sequence[Row], axes: int, worlds: Sequence[World]) -> Iterator[tuple[int, list[World]]]:
    """Axes with the worlds that have no results yet, by the recordings of the new machine."""
    done = {(row["axis"], row["world"]) for row in rows}
    for seed in range(axes):
        by_recordings: dict[str, list[World]] = {}
        for world in worlds:
            if (seed, world.name) not in done:
                by_recordings.setdefault(bench(seed, world.group).new_as, []).append(world)
        for shared in by_recordings.values():
            yield seed, shared


def main(arguments: Sequence[str] | None = None) -> None:
    """Add results and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--cache", type=Path)
    parser.add_argument("--axes", type=int, default=10)
    parser.add_argument("--worlds", default=",".join(world.name for world in WORLDS))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    names = given.worlds.split(",")
    worlds = [world for world in WORLDS if any(name in world.name for name in names)]
    folder = given.cache or given.results.with_suffix(".runs")
    folder.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(max_workers=given.workers) as pool:
        jobs = [
            pool.submit(group_of, seed, shared, folder)
            for seed, shared in missing(read(given.results), given.axes, worlds)
        ]
        for number, job in enumerate(as_completed(jobs), 1):
            with given.results.open("a", encoding="utf-8") as file:
                file.writelines(json.dumps(row) + "\n" for row in job.result())
            print(f"{number} of {len(jobs)} machines", flush=True)
    lines = [heading("python -m benchmarks.other_machines"), "", *world_table(read(given.results))]
    print("\n".join(lines))
    if given.page is not None:
        write(given.page, "worlds", lines)


if __name__ == "__main__":
    main()
