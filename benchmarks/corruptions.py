"""Does *good* hold on corrupted recordings?  Corruptions, rates and encoders of two benches, and coverage.

    python -m benchmarks.corruptions --results FILE [--only PART,PART] [--benches NAME,NAME] [--workers 2]
        [--page PAGE]

Each corruption of :data:`CORRUPTIONS` is put on the three trips of the bench given in BALLSCREW_DATA and of
an axis of the testbed; what changes the machine itself is simulated, on a twin of the bench and on that axis.
The files are analysed with the sheet and the plan of the good run, and the cells are compared with the true
frequencies. Each result is a line of FILE; results that it has already are not repeated. ``--workers 0`` only
makes the tables, which --page writes into a page between its marks.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ballscrew.base.errors import InputError
from ballscrew.modal.joint.settings import Response
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.trip import prepared, simulate_trip
from benchmarks.axis_sampling import random_axis
from benchmarks.fault_injection import FAULTS, RecordedTrips, inject, sensors
from benchmarks.fault_injection.fault import Array
from benchmarks.faults import Case, Declared, analysed, bench_folder, setup, write_trip
from benchmarks.identification_tables import write
from benchmarks.machine import heading

Row = dict[str, Any]
Truth = Mapping[float, float]  # frequency (Hz) at each stop (m)
AXIS = 12  # seed of the axis of the testbed
BENCHES = ("bench", "axis")
ACCELEROMETERS = ("acc1_x", "acc2_x")
RATES = (12800.0, 8000.0, 4000.0, 2000.0, 1500.0, 1000.0, 500.0)  # Hz
ENCODERS = (5e-8, 2e-7, 5e-7, 1e-6, 2e-6)  # m
_INSIDE = 1.96


@dataclass(frozen=True)
class Corruption:
    """Name and size of a corruption.

    ``change`` acts on the recorded trips; a corruption of the machine itself has the name of a fault and its
    strength instead.
    """

    name: str
    size: str
    change: Callable[[RecordedTrips, np.random.Generator], RecordedTrips] | None = None
    fault: str = ""
    strength: float = 0.0
    response: Response = "both"
    group: str = "own"

    @property
    def key(self) -> str:
        """Name with size and response."""
        return " ".join(
            filter(None, (self.name, self.size, "" if self.response == "both" else self.response))
        )


def _on(names: tuple[str, ...], function: Callable[..., Array], *args: float, rated: bool = False) -> Any:
    def change(run: RecordedTrips, _: np.random.Generator) -> RecordedTrips:
        def one(x: Array, rate: float) -> Array:
            return function(x, rate, *args) if rated else function(x, *args)

        return sensors.each(run, names, one)

    return change


def _random_on(
    names: tuple[str, ...], function: Callable[..., Array], *args: float, rated: bool = False
) -> Any:
    def change(run: RecordedTrips, random: np.random.Generator) -> RecordedTrips:
        def one(x: Array, rate: float) -> Array:
            given = (rate, *args) if rated else args
            return function(x, *given, random)

        return sensors.each(run, names, one)

    return change


def _rate(part: float, run: RecordedTrips, _: np.random.Generator) -> RecordedTrips:
    return replace(run, rate=run.rate / (1 + part))


def _third_missing(run: RecordedTrips, _: np.random.Generator) -> RecordedTrips:
    return replace(run, trips=run.trips[:2])


def _sampled(rate: float, step: float, run: RecordedTrips, _: np.random.Generator) -> RecordedTrips:
    run = sensors.resampled(run, rate) if rate < run.rate else run
    return sensors.each(run, ("position",), lambda x, _: sensors.coarse(x, step)) if step else run


def _loose(frequency: float, both: bool) -> Any:
    name = "both sensors loose" if both else "loose sensor"
    return lambda run, random: inject(name, run, frequency, random)


def _jitter(part: float) -> Any:
    return lambda run, random: sensors.jitter(run, part, random)


def _own() -> list[Corruption]:
    """What a reader of the documentation may think of first, and ten others."""
    c, torque, position = Corruption, ("torque",), ("position",)
    out = [c("none", "")]
    for part in (0.005, 0.003, 0.001, 0.0005):
        out += [
            c("true rate", f"{100 * sign * part:+.3g} %", partial(_rate, sign * part)) for sign in (1, -1)
        ]
    for amplitude, period in ((1e-6, 20e-6), (3e-7, 20e-6), (2e-6, 1e-4)):
        size = f"{1e6 * amplitude:.2g} µm per {1e6 * period:.3g} µm"
        out.append(c("encoder error", size, _on(position, sensors.interpolation_error, amplitude, period)))
    for step in (0.02, 0.05, 0.1):
        out.append(c("torque in steps", f"{step:g} N m", _on(torque, sensors.coarse, step)))
    out.append(c("third trip missing", "", _third_missing))
    out.append(c("trips of two preloads", "2 of 3, 1 of 3"))
    for frequency in (220.0, 300.0, 400.0):
        out.append(c("loose sensor", f"{frequency:g} Hz", _loose(frequency, both=False)))
        out.append(c("both sensors loose", f"{frequency:g} Hz", _loose(frequency, both=True)))
    for corner in (0.2, 1.0, 5.0):
        out.append(
            c("AC coupling", f"{corner:g} Hz", _on(ACCELEROMETERS, sensors.high_pass, corner, rated=True))
        )
    for notch in (300.0, 450.0):
        out.append(c("before a notch", f"{notch:g} Hz", _on(torque, sensors.unnotched, notch, rated=True)))
    for corner in (1000.0, 300.0):
        size = f"{corner:g} Hz"
        out.append(c("low pass of the torque", size, _on(torque, sensors.low_pass, corner, rated=True)))
        out.append(
            c("low pass of the acceleration", size, _on(ACCELEROMETERS, sensors.low_pass, corner, rated=True))
        )
    out += [
        c("torque held", "1 kHz", _on(torque, sensors.held_samples, 1000.0, rated=True)),
        c("torque held", "250 Hz", _on(torque, sensors.held_samples, 250.0, rated=True)),
        c("jitter", "0.3 of the interval", _jitter(0.3)),
        c("position held", "1 kHz", _on(position, sensors.held_samples, 1000.0, rated=True)),
        c("dead band of the position", "2 µm", _on(position, sensors.dead_band, 2e-6)),
        c("dead band of the torque", "0.05 N m", _on(torque, sensors.dead_band, 0.05)),
        c("acceleration in steps", "0.1 m/s²", _on(ACCELEROMETERS, sensors.coarse, 0.1)),
        c("noise of the torque", "5 % rms", _random_on(torque, sensors.noise, 0.05)),
        c("noise of the acceleration", "20 % rms", _random_on(ACCELEROMETERS, sensors.noise, 0.2)),
        c("nonlinear accelerometer", "5 %", _on(ACCELEROMETERS, sensors.nonlinear, 0.05)),
        c("nonlinear torque", "3 %", _on(torque, sensors.nonlinear, 0.03)),
        c("offset drift of the acceleration", "0.5 m/s²", _on(ACCELEROMETERS, sensors.drifting_offset, 0.5)),
        c("offset drift of the torque", "0.1 N m", _on(torque, sensors.drifting_offset, 0.1)),
        c("bursts on the acceleration", "20", _random_on(ACCELEROMETERS, sensors.bursts, 20, rated=True)),
        c("bursts on the torque", "20", _random_on(torque, sensors.bursts, 20, rated=True)),
    ]
    return out


def _catalogue() -> list[Corruption]:
    """Every fault of the catalogue at its two smallest strengths."""
    out = []
    for fault in FAULTS.values():
        for strength in fault.strengths[:2]:
            change = None
            if fault.on in ("channels", "trips", "rate"):
                change = partial(_injected, fault.name, strength)
            elif fault.on != "setup":
                continue  # a file that cannot be read has no cells
            size = f"{strength:.3g} {fault.unit}".strip()
            out.append(Corruption(fault.name, size, change, fault.name, strength, group="catalogue"))
    return out


def _injected(name: str, strength: float, run: RecordedTrips, random: np.random.Generator) -> RecordedTrips:
    return inject(name, run, strength, random)


def _sampling() -> list[Corruption]:
    """Rates and encoders, with all sensors and with drive signals alone."""
    out = []
    for response in ("motor", "both"):
        for rate in RATES:
            size, change = f"{rate / 1e3:g} kHz", partial(_sampled, rate, 0.0)
            out += [Corruption("rate", size, change, response=response, group="rate")]
        for rate in (12800.0, 4000.0):
            for step in ENCODERS:
                size = f"{1e6 * step:g} µm at {rate / 1e3:g} kHz"
                change = partial(_sampled, rate, step)
                out += [Corruption("encoder", size, change, response=response, group="encoder")]
    return out


CORRUPTIONS = {corruption.key: corruption for corruption in (*_own(), *_catalogue(), *_sampling())}


@cache
def _recorded(bench: str, state: int = 4) -> RecordedTrips:
    """The good trips of a bench."""
    if bench == "bench":
        trips = []
        for path in sorted(bench_folder().glob(f"preload-{state}-percent-trip*.h5")):
            with h5py.File(path) as file:
                trips.append({name: np.asarray(x, dtype=np.float64) for name, x in file.items()})
                rate = float(file.attrs["sample_rate"])
        return RecordedTrips(tuple(trips), rate)
    return _simulated(Case(AXIS, "axis"), 1.0 if state == 4 else 0.8)[0]


def _simulated(
    case: Case, preload: float = 1.0, corruption: Corruption | None = None
) -> tuple[RecordedTrips, Truth]:
    """Trips of the testbed, and the true frequency at each stop."""
    true, _ = setup(case)
    if corruption is not None and corruption.fault:
        true = inject(corruption.fault, true, corruption.strength, np.random.default_rng([case.seed, 11]))
    machine = replace(true.rig.machine, preload=preload * true.rig.machine.preload)
    true = replace(true, rig=replace(true.rig, machine=machine))
    seeds = np.random.SeedSequence(case.seed).generate_state(3)
    trips = tuple(simulate_trip(true.rig, true.plan, true.motion, true.load, int(seed)) for seed in seeds)
    c = prepared(machine, true.load, true.plan)
    truth = {
        x: true_frequency(c, x) for x in np.linspace(true.plan.positions[0], true.plan.positions[-1], 46)
    }
    return RecordedTrips(trips, true.rig.sample_rate), truth


def _declared(bench: str) -> Declared:
    return setup(Case(AXIS, "axis") if bench == "axis" else Case(0))[1]


def _truth(bench: str) -> Truth:
    if bench == "bench":
        document = json.loads((bench_folder() / "truth.json").read_text(encoding="utf-8"))
        frequencies = document["preload-4-percent"]["axial_natural_frequency_Hz"]
        return {float(x): f for x, f in frequencies.items()}
    axis = random_axis(AXIS)
    c = prepared(axis.rig.machine, axis.load, axis.plan)
    return {x: true_frequency(c, x) for x in axis.plan.positions}


def result(bench: str, key: str) -> Row:
    """Analyse one corruption of one bench."""
    corruption, random = CORRUPTIONS[key], np.random.default_rng([*key.encode()])
    truth = _truth(bench)
    if corruption.fault and corruption.change is None:
        case = Case(AXIS, "axis") if bench == "axis" else Case(1000)
        run, truth = _simulated(case, corruption=corruption)
    else:
        run = _recorded(bench)
        if corruption.name == "trips of two preloads":
            run = replace(run, trips=(*run.trips[:2], _recorded(bench, 2).trips[2]))
        if corruption.change is not None:
            run = corruption.change(run, random)
    row: Row = {"bench": bench, "key": key, "group": corruption.group}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = [folder / f"trip{index}.h5" for index in range(1, len(run.trips) + 1)]
        for file, channels in zip(files, run.trips, strict=True):
            write_trip(file, channels, run.rate)
        try:
            found = analysed(files, _declared(bench), folder, corruption.response)
        except InputError as error:
            return {**row, "verdict": "refused", "reason": str(error), "cells": [], "count": 0}
    places, frequencies = np.array(list(truth)), np.array(list(truth.values()))
    cells = []
    for cell in found.cells:
        f, u = cell.frequency_Hz, cell.standard_uncertainty_Hz
        if f is None or u is None:
            continue
        true = float(np.interp(cell.position_m, places, frequencies))
        good = cell.verdict == "good" and found.quality.verdict == "good"
        cells.append((round(f - true, 4), round(u, 4), good, round(true, 2)))
    reasons = [*found.quality.reasons, *(str(cell.reasons[0]) for cell in found.cells if cell.reasons)]
    return {
        **row,
        "verdict": found.quality.verdict,
        "reason": reasons[0] if reasons else "",
        "cells": cells,
        "count": len(found.cells),
    }


def _line(row: Row) -> str:
    """Figures of one result as columns of the table."""
    errors = np.array([cell[0] for cell in row["cells"]])
    spreads = np.array([cell[1] for cell in row["cells"]])
    good = np.array([cell[2] for cell in row["cells"]], dtype=bool)
    outside = np.abs(errors) > _INSIDE * spreads
    size = "" if not len(errors) else f"{np.median(np.abs(errors)):.2f} ± {_INSIDE * np.median(spreads):.2f}"
    return (
        f"{row['verdict']} | {len(errors)} of {row['count']} | {np.sum(good)} | "
        f"{np.sum(outside & good)} | {np.sum(outside)} | {size}"
    )


def table(rows: Sequence[Row], groups: Sequence[str]) -> list[str]:
    """Table of the corruptions of some groups."""
    out = [
        "| corruption | machine | recording | cells | good | good and outside | outside | error, Hz, and ± |",
        "|---|---|---|---|---|---|---|---|",
    ]
    order = list(CORRUPTIONS)
    rows = [row for row in rows if row["group"] in groups]
    rows.sort(key=lambda row: (order.index(row["key"]), row["bench"]))
    return out + [f"| {row['key']} | {row['bench']} | {_line(row)} |" for row in rows]


def main() -> None:
    """Run what is missing and print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--only", default="", help="parts of names")
    parser.add_argument("--group", default="own,catalogue,rate,encoder")
    parser.add_argument("--benches", default=",".join(BENCHES))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    rows: list[Row] = []
    if given.results.exists():
        rows = [json.loads(line) for line in given.results.read_text(encoding="utf-8").splitlines()]
    done = {(row["bench"], row["key"]) for row in rows}
    wanted = [
        (bench, key)
        for key, corruption in CORRUPTIONS.items()
        for bench in given.benches.split(",")
        if corruption.group in given.group.split(",")
        and any(part in key for part in given.only.split(","))
        and (bench, key) not in done
    ]
    if given.workers:
        with ProcessPoolExecutor(given.workers) as pool, given.results.open("a", encoding="utf-8") as file:
            for future in as_completed([pool.submit(result, *one) for one in wanted]):
                row = future.result()
                rows.append(row)
                file.write(json.dumps(row) + "\n")
                file.flush()
    blocks = {group: table(rows, groups) for group, groups in _TABLES.items()}
    print(heading("python -m benchmarks.corruptions"))
    for name, lines in blocks.items():
        print("\n" + "\n".join(lines))
        if given.page is not None and len(lines) > _HEADING:
            write(given.page, name, [heading("python -m benchmarks.corruptions --results FILE"), "", *lines])


_HEADING = 2  # lines of a table without rows
_TABLES = {"corruptions": ("own", "catalogue"), "sampling": ("rate", "encoder")}

if __name__ == "__main__":
    main()
