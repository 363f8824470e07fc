"""How exact the natural frequencies are: the joint estimator and the paper's method on one and the same data.

    python -m benchmarks.identification [--data ../shared/data] [--seeds 0 30] [--trips 10] [--paper]

First the bench with known truth, both states: as it is, with the data sheet's K and k_b 25 % too low and too
high, without a data sheet, and from torque and encoder alone. Then random axes of the testbed, each at its
preload and at 95 % of it, with other noise and other trips. Errors in Hz against the truth, rotor free;
*inside* is the part of the cells whose 95 % interval holds it; *shift* the error of the run's mean change.

The testbed takes 16 steps a sample here: with 4 its semi-implicit steps ring 0.05 % above its own truth.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballscrew.axis.sheet import DataSheet, read_axis
from ballscrew.fcft.plan import Plan, read_plan
from ballscrew.modal.cells import identify_cells
from ballscrew.modal.joint.identify import identify_jointly
from ballscrew.modal.joint.settings import Response
from ballscrew.modal.joint.signals import Mark, TripSignals, marks_of, trip_signals
from ballscrew.modal.settings import PaperSettings
from ballscrew.recording.aligned import align
from ballscrew.recording.channels import ChannelMap, read_channels
from ballscrew.recording.load import read_recording
from ballscrew.recording.measure import Measurement, measure
from ballscrew.testbed.run import simulate_run
from ballscrew.testbed.spread import random_axis
from benchmarks.machine import heading

RATE = 5300.0  # Hz kept, at least
STATES = ("preload-4-percent", "preload-2-percent")
Found = dict[tuple[float, str], tuple[float, float]]


@dataclass(frozen=True)
class Data:
    """A run: its signals, its transients, and what is known of it."""

    trips: tuple[TripSignals, ...]
    marks: tuple[Mark, ...]
    measurement: Measurement
    sheet: DataSheet
    plan: Plan
    load: float
    truth: dict[float, float]


def read(
    files: Sequence[Path], channels: ChannelMap, sheet: DataSheet, plan: Plan, load: float, truth: object
) -> Data:
    """All that both methods need."""
    measurement = measure(files, channels, sheet=sheet, plan=plan, mass=load)
    assert measurement.transients is not None
    assert isinstance(truth, dict)
    return Data(
        tuple(trip_signals(align(read_recording(f, channels)), RATE) for f in files),
        marks_of(measurement.transients),
        measurement,
        sheet,
        plan,
        load,
        {float(x): float(f) for x, f in truth.items()},
    )


def jointly(data: Data, sheet: DataSheet | None, response: Response = "both") -> tuple[Found, int, float]:
    """Frequencies and uncertainties of the joint estimator, how many cells there are, and the time, s."""
    start = time.perf_counter()
    result = identify_jointly(data.trips, data.marks, sheet, data.load, response=response)
    taken = time.perf_counter() - start
    found = {
        (c.position, c.condition): (c.frequency, c.uncertainty)
        for c in result.cells
        if c.frequency is not None and c.uncertainty is not None
    }
    return found, len(result.cells), taken


def by_paper(data: Data) -> tuple[Found, int, float]:
    """The same of the paper's method."""
    start = time.perf_counter()
    cells, _ = identify_cells(
        data.measurement.transients,
        data.measurement.quality,
        data.sheet,
        data.plan,
        data.load,
        PaperSettings(),
    )
    taken = time.perf_counter() - start
    found = {
        (c.position_m, c.condition): (c.frequency_Hz, c.standard_uncertainty_Hz)
        for c in cells
        if c.frequency_Hz is not None and c.standard_uncertainty_Hz is not None
    }
    return found, len(cells), taken


def errors(found: Found, truth: dict[float, float]) -> np.ndarray:
    """Of each cell its error and its standard uncertainty, shape (cells, 2), Hz."""
    rows = [(f - truth[min(truth, key=lambda t: abs(t - x))], u) for (x, _), (f, u) in found.items()]
    return np.array(rows).reshape(-1, 2)


def line(name: str, rows: np.ndarray, cells: int, taken: float) -> str:
    """A row of the table."""
    if not len(rows):
        return f"| {name} | – | – | – | – | 0/{cells} | {taken:.1f} |"
    size = np.abs(rows[:, 0])
    inside = 100 * np.mean(size < 1.96 * rows[:, 1])
    return (
        f"| {name} | {np.median(size):.2f} | {np.quantile(size, 0.9):.2f} | {inside:.0f} % |"
        f" ± {1.96 * np.median(rows[:, 1]):.2f} | {len(rows)}/{cells} | {taken:.1f} |"
    )


def softer(sheet: DataSheet, part: float) -> DataSheet:
    """The sheet with another K and k_b."""
    return replace(
        sheet,
        screw=replace(sheet.screw, rigidity=part * sheet.screw.rigidity),
        bearing=replace(sheet.bearing, stiffness=part * sheet.bearing.stiffness),
    )


def bench(folder: Path) -> None:
    """Print the table of the bench."""
    sheet, plan = read_axis(folder / "axis.toml"), read_plan(folder / "plan.toml")
    channels = read_channels(folder / "channels.toml")
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    for state in STATES:
        told = truth[state]["axial_natural_frequency_Hz"]
        data = read(sorted(folder.glob(f"{state}-trip*.h5")), channels, sheet, plan, 100.0, told)
        for name, (found, cells, taken) in {
            "joint": jointly(data, sheet),
            "joint, K and k_b − 25 %": jointly(data, softer(sheet, 0.75)),
            "joint, K and k_b + 25 %": jointly(data, softer(sheet, 1.25)),
            "joint, no sheet": jointly(data, None),
            "joint, motor alone": jointly(data, sheet, "motor"),
            "paper": by_paper(data),
        }.items():
            print(line(f"{state}, {name}", errors(found, data.truth), cells, taken), flush=True)


def random_run(seed: int, part: float, trips: int) -> Data:
    """A run on a random axis at a part of its preload."""
    axis = random_axis(seed)
    machine = replace(axis.rig.machine, preload=part * axis.rig.machine.preload)
    rig = replace(axis.rig, machine=machine, steps=16)
    plan = replace(axis.plan, repetitions=trips)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = simulate_run(rig, plan, axis.load, folder, told=axis.told, seed=2 * seed + (part < 1))
        truth = json.loads(files.truth.read_text(encoding="utf-8"))["axial_natural_frequency_Hz"]
        channels = read_channels(folder / "channels.toml")
        return read(files.recordings, channels, axis.told, plan, axis.load, truth)


def random_axes(seeds: range, trips: int, paper: bool) -> None:
    """Print the table of random axes."""
    total: dict[str, list[np.ndarray]] = {"joint": [], "paper": []}
    shifts: dict[str, list[float]] = {"joint": [], "paper": []}
    cells: dict[str, int] = {"joint": 0, "paper": 0}
    for seed in seeds:
        runs = [random_run(seed, part, trips) for part in (1.0, 0.95)]
        for method in ("joint", "paper") if paper else ("joint",):
            told = [jointly(r, r.sheet) if method == "joint" else by_paper(r) for r in runs]
            rows = [errors(t[0], r.truth) for t, r in zip(told, runs, strict=True)]
            total[method] += rows
            cells[method] += told[0][1] + told[1][1]
            shared = sorted(set(told[0][0]) & set(told[1][0]))
            if shared:
                gone = [
                    np.array(
                        [f[k][0] - min(r.truth.items(), key=lambda t: abs(t[0] - k[0]))[1] for k in shared]
                    )
                    for (f, _, _), r in zip(told, runs, strict=True)
                ]
                shifts[method].append(float(np.mean(gone[1] - gone[0])))
            both = np.concatenate(rows)
            print(line(f"axis {seed}, {method}", both, told[0][1] + told[1][1], told[0][2]), flush=True)
    for method, rows in total.items():
        if rows:
            print(line(f"all, {method}", np.concatenate(rows), cells[method], float("nan")))
            shift = float(np.sqrt(np.mean(np.square(shifts[method])))) if shifts[method] else float("nan")
            print(f"shift of {len(shifts[method])} axes, {method}: {shift:.3f} Hz rms")


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("BALLSCREW_DATA", "../shared/data")))
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 30))
    parser.add_argument("--trips", type=int, default=10)
    parser.add_argument("--paper", action="store_true", help="the paper's method on the random axes too")
    given = parser.parse_args()
    print(heading("benchmarks.identification"))
    print("| run | median | 90th percentile | inside | 95 % | cells | s |\n|---|---|---|---|---|---|---|")
    bench(given.data / "bench")
    random_axes(range(*given.seeds), given.trips, given.paper)


if __name__ == "__main__":
    main()
