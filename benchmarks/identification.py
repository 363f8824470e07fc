"""How exact the natural frequencies are: ours and others' on one and the same data, whose truth is known.

    python -m benchmarks.identification [--axes 60] [--trips 10] [--results FOLDER] [--again METHOD ...]

Two tables. The bench (BALLSCREW_DATA, or --data): both its states, with the data sheet as it is and with K
and k_b 25 % too low and too high. Random axes of the testbed: each with its preload and with 5 % less of it,
4.0 and 3.8 % of C_a, with other noise on other trips. All errors in Hz against the truth, rotor free.
Recordings are simulated into a temporary folder, one run at a time, and deleted.

With --results the cells of every run are stored as JSON; stored runs are not repeated, but for the methods
named by --again (the beginning of a name is enough). With --joint only method joint runs, on the random axes,
with a table of its own. --page writes the tables into a page, between their marks.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import xarray as xr

from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import read_axis
from ballscrew.fcft.plan import Plan, read_plan
from ballscrew.modal.cell import CellResult
from ballscrew.modal.joint.analysis import analyse_jointly, signal_reducer
from ballscrew.modal.joint.settings import JointSettings, Response
from ballscrew.modal.paper.cells import identify_cells
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.recording.channels import ChannelMap, read_channels
from ballscrew.recording.measure import Measurement, measure
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.run import simulate_run
from ballscrew.testbed.trip import prepared
from benchmarks.axis_sampling import RandomAxis, random_axis
from benchmarks.identification_tables import bench_table, random_table, write
from benchmarks.machine import heading
from benchmarks.peers import PEERS, available

JOINT, PAPER = "ballscrew, joint", "ballscrew, paper"
MOTOR, ROTOR_HELD, BLIND = (
    f"{JOINT}, encoder alone",
    f"{JOINT}, encoder alone, rotor held",
    f"{JOINT}, no sheet",
)
STATES = ("preload-4-percent", "preload-2-percent")
PARTS = (1.0, 0.95)  # of the axis's preload
SHEETS = {"as is": 1.0, "K, k_b −25 %": 0.75, "K, k_b +25 %": 1.25}
Key = tuple[float, str, int]
Row = tuple[float, str, int, float, float | None]  # position, condition, motion, Hz, Hz
StoredRun = dict[str, Any]


@dataclass(frozen=True)
class Given:
    """Files of a run and the data declared for it."""

    files: tuple[Path, ...]
    channels: ChannelMap
    sheet: DataSheet
    plan: Plan
    load: float

    def measured(self) -> Measurement:
        """Read once for all methods."""
        keep = signal_reducer(self.sheet, self.load, JointSettings())
        return measure(
            self.files, self.channels, sheet=self.sheet, plan=self.plan, mass=self.load, extract=keep
        )


def jointly(
    given: Given,
    data: Measurement,
    response: Response = "both",
    *,
    use_sheet: bool = True,
    rotor_held: bool = False,
) -> list[Row]:
    """By :func:`ballscrew.analyze`, method joint."""
    cells, table = _papers(given, data)
    sheet = given.sheet if use_sheet else None
    found = analyse_jointly(data, cells, table, sheet, given.load, JointSettings(), response).cells
    return _rows(found, rotor_held=rotor_held)


def by_paper(given: Given, data: Measurement) -> list[Row]:
    """By :func:`ballscrew.analyze`, method paper."""
    return _rows(_papers(given, data)[0])


def _papers(given: Given, data: Measurement) -> tuple[tuple[CellResult, ...], xr.Dataset | None]:
    return identify_cells(data.transients, data.quality, given.sheet, given.plan, given.load, PaperSettings())


def _rows(cells: Sequence[CellResult], *, rotor_held: bool = False) -> list[Row]:
    out = []
    for c in cells:
        f, u = c.frequency_Hz, c.standard_uncertainty_Hz
        if rotor_held:
            f, u = c.rotor_held_frequency_Hz, c.rotor_held_standard_uncertainty_Hz
        if f is not None:
            out.append((c.position_m, c.condition, c.motion, f, u))
    return out


def grouped(transients: xr.Dataset | None) -> dict[Key, xr.Dataset]:
    """The complete transients of each cell."""
    if transients is None:
        return {}
    names = ("position_m", "condition", "motion", "complete")
    rows: dict[Key, list[int]] = {}
    for index, (x, condition, motion, complete) in enumerate(
        zip(*(transients[name].values.tolist() for name in names), strict=True)
    ):
        if complete:
            rows.setdefault((x, condition, motion), []).append(index)
    return {key: transients.isel(transient=where) for key, where in rows.items()}


def by_peer(name: str) -> Callable[[Given, Measurement], list[Row]]:
    """By one of the peers, cell by cell."""
    peer = PEERS[name][0]

    def rows(given: Given, data: Measurement) -> list[Row]:
        out: list[Row] = []
        for key, cell in grouped(data.transients).items():
            found = peer(cell, float(predicted_frequency(given.sheet, key[0], given.load)))
            if found is not None:
                out.append((*key, found, None))
        return out

    return rows


METHODS: dict[str, Callable[[Given, Measurement], list[Row]]] = {
    JOINT: jointly,
    PAPER: by_paper,
    **{name: by_peer(name) for name in available()},
}
EXTRA: dict[str, Callable[[Given, Measurement], list[Row]]] = {
    BLIND: lambda given, data: jointly(given, data, use_sheet=False),
    MOTOR: lambda given, data: jointly(given, data, "motor"),
    ROTOR_HELD: lambda given, data: jointly(given, data, "motor", rotor_held=True),
}


def fill(stored: StoredRun, given: Given, methods: Sequence[str]) -> None:
    """Do what is missing; times are those of the method alone, everything read and cut."""
    data = given.measured()
    stored["cells"] = len(grouped(data.transients))
    for name in methods:
        start = time.perf_counter()
        rows = (METHODS | EXTRA)[name](given, data)
        stored["methods"][name] = {"seconds": time.perf_counter() - start, "rows": rows}


def missing(stored: StoredRun, wanted: Sequence[str], again: Sequence[str]) -> list[str]:
    """Methods to be done."""
    return [
        name
        for name in wanted
        if name not in stored["methods"] or any(name.startswith(start) for start in again)
    ]


def load(path: Path | None) -> StoredRun:
    """Stored results of a run, empty if there are none."""
    if path is not None and path.is_file():
        stored: StoredRun = json.loads(path.read_text(encoding="utf-8"))
        return stored
    return {"methods": {}}


def save(path: Path | None, stored: StoredRun) -> None:
    """Keep it."""
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(stored) + "\n", encoding="utf-8", newline="\n")


def softer(sheet: DataSheet, part: float) -> DataSheet:
    """The sheet with another K and k_b."""
    return replace(
        sheet,
        screw=replace(sheet.screw, rigidity=part * sheet.screw.rigidity),
        bearing=replace(sheet.bearing, stiffness=part * sheet.bearing.stiffness),
    )


def bench_run(folder: Path, state: str, part: float, results: Path | None, again: Sequence[str]) -> StoredRun:
    """One state of the bench under one data sheet."""
    path = results / f"bench-{state}-{part:g}.json" if results else None
    stored = load(path)
    todo = missing(stored, [*METHODS, *(EXTRA if part == 1 else ())], again)
    if todo:
        truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))[state]
        stored["truth"] = _by_place(truth["axial_natural_frequency_Hz"])
        stored["held"] = _by_place(next(v for k, v in truth.items() if "held" in k and "frequency" in k))
        sheet, plan = read_axis(folder / "axis.toml"), read_plan(folder / "plan.toml")
        files = tuple(sorted(folder.glob(f"{state}-trip*.h5")))
        channels = read_channels(folder / "channels.toml")
        fill(stored, Given(files, channels, softer(sheet, part), plan, 100.0), todo)
        save(path, stored)
    return stored


def random_run(
    axis: RandomAxis,
    seed: int,
    part: float,
    trips: int,
    methods: Sequence[str],
    results: Path | None,
    again: Sequence[str],
) -> StoredRun:
    """A random axis at a part of its preload."""
    path = results / f"axis-{seed:03d}-{part:g}-trips-{trips}.json" if results else None
    stored = load(path)
    todo = missing(stored, methods, again)
    if not todo:
        return stored
    rig = replace(axis.rig, machine=replace(axis.rig.machine, preload=part * axis.rig.machine.preload))
    plan = replace(axis.plan, repetitions=trips)
    c = prepared(rig.machine, axis.load, plan)
    stored["truth"] = [(x, true_frequency(c, x)) for x in plan.positions]
    with tempfile.TemporaryDirectory() as name:
        files = simulate_run(
            rig, plan, axis.load, Path(name), sheet=axis.data_sheet, seed=2 * seed + (part != PARTS[0])
        )
        channels = read_channels(Path(name) / "channels.toml")
        given = Given(files.recordings, channels, axis.data_sheet, plan, axis.load)
        fill(stored, given, todo)
    save(path, stored)
    return stored


def _by_place(truth: dict[str, float]) -> list[tuple[float, float]]:
    return [(float(x), f) for x, f in truth.items()]


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("BALLSCREW_DATA", "../shared/data")))
    parser.add_argument("--axes", type=int, default=60)
    parser.add_argument("--trips", type=int, default=10)
    parser.add_argument("--results", type=Path)
    parser.add_argument("--again", nargs="*", default=())
    parser.add_argument("--joint", action="store_true")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    tables: dict[str, list[str]] = {}
    bench = given.data / "bench"
    methods, name = tuple(METHODS), "random axes"
    if given.joint:
        methods, name = (JOINT,), "random axes, joint"
    elif bench.is_dir():
        states = {}
        for sheet, part in SHEETS.items():
            states[sheet] = [bench_run(bench, state, part, given.results, given.again) for state in STATES]
            print(f"bench, sheet {sheet}: done", file=sys.stderr, flush=True)
        tables["bench"] = [
            heading("python -m benchmarks.identification"),
            "",
            *bench_table(states, (*METHODS, *EXTRA)),
        ]
    else:
        print(f"no bench at {bench}: its table is left out; set BALLSCREW_DATA.", file=sys.stderr)
    pairs = []
    for seed in range(given.axes):
        start, axis = time.perf_counter(), random_axis(seed)
        first, second = (
            random_run(axis, seed, part, given.trips, methods, given.results, given.again) for part in PARTS
        )
        pairs.append((first, second))
        took = time.perf_counter() - start
        print(f"axis {seed + 1} of {given.axes}: {took:.0f} s", file=sys.stderr, flush=True)
    if pairs:
        command = f"python -m benchmarks.identification --axes {given.axes} --trips {given.trips}"
        if given.joint:
            command += " --joint"
        tables[name] = [heading(command), "", *random_table(pairs, methods)]
    for title, lines in tables.items():
        print("\n".join(lines), end="\n\n")
        if given.page is not None:
            write(given.page, title, lines)


if __name__ == "__main__":
    main()
