"""Preload from frequencies, on axes whose truth is known: how exact, and how true its intervals are.

    python -m benchmarks.preload [--axes 100] [--recorded 8] [--show 1 2 3 4 5] [--page PAGE]

1. Random axes of the testbed, data sheets wrong within the makers' tolerances, one multi-level-mass
   experiment at a preload nobody knows, then wear to a quarter of it: without an anchor, with known preloads,
   with two acceleration levels; in a world where all that ``Assumptions`` allow for happens, and in one where
   nothing changes but the nut. Beside it the best that anybody could do (:mod:`benchmarks.preload_bound`).
2. What is no loss of preload: a load that is 2 kg heavier than declared, a torque constant that drifts 1 %, a
   bearing that is 10 % softer.
3. Local wear, 30 % of the preload over 90 mm, and axes that are worn evenly.
4. The bench (BALLSCREW_DATA, or --data): its two states, from the recordings on.
5. As 1, without an anchor, from recordings on, on a few axes: takes half a minute each.

1 to 3 are at the level of mode tables (:mod:`benchmarks.mode_tables`). --page writes the tables into a page,
between their marks.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

import ballscrew
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import BallscrewError
from ballscrew.base.quantity import NORMAL_95, Quantity
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.calibration import calibrate
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.estimation.preload import preload
from ballscrew.fcft.plan import Plan
from ballscrew.modal.run import Run
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.run import simulate_run
from benchmarks.axis_sampling import random_axis
from benchmarks.identification_tables import write
from benchmarks.machine import heading
from benchmarks.mode_tables import Analyst, analyst, mode_table
from benchmarks.preload_bound import Bound
from benchmarks.preload_cases import CASES, Case, happened, stiffer, true_stiffness
from benchmarks.preload_tables import Assessed, Place, bench_table, imitation_table, local_table, wear_table

LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0)  # of the axis's load
RATIOS = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.25)
RECORDED = (1.0, 0.6, 0.4, 0.25)
LATER = 100  # day from which on runs are later than the calibration
KNOWN = 0.02  # standard uncertainty of a preload that is known, as a part
SOFTENING = 0.10  # what two acceleration levels tell of mass over preload
HEAVIER = 2.0  # kg
WIDTH, LOSS = 0.09, 0.30
Row = TypeVar("Row")
STATES = ("preload-4-percent", "preload-2-percent")
IMITATIONS = ("load 2 kg heavier", "torque constant +1 %", "bearing −10 %", "nothing")


@dataclass(frozen=True)
class Axis:
    """A random axis, its data sheet, and the estimator applied to it."""

    name: int
    machine: Machine
    sheet: DataSheet
    plan: Plan
    load: float
    who: Analyst
    changes: Assumptions | None = None  # random changes besides the wear, new in every run
    bearing: float | None = None  # k_b of later runs over the baseline's, where it is not random

    def measured(self, stream: int, ratio: float = 1.0, load: float | None = None, **more: float) -> Run:
        """Run at a part of the preload; every stream has its own scatter."""
        machine = replace(self.machine, preload=ratio * self.machine.preload)
        return self.run_of(machine, stream, load, **more)

    def run_of(self, machine: Machine, stream: int, load: float | None = None, **more: float) -> Run:
        """Run of another machine."""
        random = np.random.default_rng([self.name, stream, 0x10AD])
        mass = self.load if load is None else load
        more = {"day": float(stream), "declared": mass, **more}
        machine, mass = self.state(machine, stream, mass, more["day"])
        return mode_table(self.who, machine, self.plan, mass, random, **more)

    def state(self, machine: Machine, stream: int, mass: float, day: float) -> tuple[Machine, float]:
        """Machine and load of a run, with their random changes."""
        if day >= LATER and self.bearing is not None:
            machine = stiffer(machine, self.bearing)
        if self.changes is None:
            return machine, mass
        spread = 0.0
        if day >= LATER and self.bearing is None:
            spread = self.changes.bearing_spread
        elif 1 <= day < LATER:
            spread = self.changes.bearing_daily_drift / NORMAL_95
        moved = np.random.default_rng([self.name, stream, 0xD21F])
        return happened(machine, mass, self.changes, moved, spread)

    def experiment(self) -> list[Run]:
        """The multi-level-mass experiment, a run an hour; its last run has the axis's load."""
        return [
            self.measured(k, load=round(part * self.load, 1), day=k / 24) for k, part in enumerate(LEVELS)
        ]


def axis(
    seed: int, softening: float = np.inf, happens: Assumptions | None = None, bearing: float | None = None
) -> Axis:
    """Draw an axis."""
    sampled = random_axis(seed)
    random = np.random.default_rng([seed, 0xA9A1])
    who = analyst(sampled.data_sheet, sampled.plan, random, softening)
    machine, sheet = sampled.rig.machine, sampled.data_sheet
    return Axis(seed, machine, sheet, sampled.plan, sampled.load, who, happens, bearing)


def assess(
    estimate: PreloadEstimate, true: float, new: float, true_stiffness: float | None = None
) -> Assessed:
    """An estimate compared with the true preload, N, and the true stiffness as P/P₀."""
    ratio, force = estimate.relative_to_baseline, estimate.preload_N
    stiffness = estimate.stiffness_relative_to_baseline
    assessed_run = Assessed(
        true / new,
        true / new if true_stiffness is None else true_stiffness,
        estimate.verdict,
        estimate.nut_verdict,
        estimate.mass.decision if estimate.mass is not None else "unknown",
        tuple(cause.name for cause in estimate.causes if cause.possible),
    )
    if estimate.verdict == "refused" or ratio is None or force is None or stiffness is None:
        return assessed_run
    low, high = force.interval
    return replace(
        assessed_run,
        ratio=ratio.value,
        interval=ratio.interval,
        stiffness=stiffness.value,
        stiffness_interval=stiffness.interval,
        force=force.value / true,
        force_interval=(low / true, high / true),
    )


def known(random: np.random.Generator, true: float) -> Quantity:
    """Known preload, with an error."""
    value = true * (1 + KNOWN * random.standard_normal())
    return Quantity(value, KNOWN * value, "N")


def wear(seed: int, case: Case) -> list[Assessed]:
    """Show 1 on one axis."""
    one = axis(seed, SOFTENING if case.levels else np.inf, case.changes, case.bearing)
    runs, preloads = one.experiment(), {}
    if case.second is not None:
        random = np.random.default_rng([seed, 0x5EC])
        other = one.measured(50, case.second)
        preloads[other.id] = known(random, case.second * one.machine.preload)
        if case.first:
            preloads[runs[0].id] = known(random, one.machine.preload)
        runs = [*runs, other]
    model = calibrate(runs, one.sheet, known=preloads, assumptions=case.assumed)
    base, new, assessed_runs = runs[len(LEVELS) - 1], one.machine.preload, []
    for k, ratio in enumerate(RATIOS):
        stream = LATER + k
        machine, _ = one.state(replace(one.machine, preload=ratio * new), stream, one.load, stream)
        estimate = preload(one.measured(stream, ratio), model, base, assumptions=case.assumed)
        stiffness = true_stiffness(machine, one.machine)
        assessed_runs.append(assess(estimate, ratio * new, new, stiffness))
    return assessed_runs


def best(seed: int, cases: Sequence[Case]) -> list[np.ndarray]:
    """How exact P/P₀ can be on one axis: for each case its standard deviation in each state."""
    one = axis(seed)
    loads = tuple(round(part * one.load, 1) for part in LEVELS)
    bound = Bound(one.machine, one.plan, one.who, loads, KNOWN)
    return [bound.ratio(RATIOS, case.second, case.first, case.changes) for case in cases]


def imitation(seed: int, what: str) -> Assessed:
    """Show 2 on one axis."""
    one = axis(seed)
    runs = one.experiment()
    model, machine = calibrate(runs, one.sheet), one.machine
    true = 1.0
    if what == "load 2 kg heavier":
        run = one.run_of(machine, 200, one.load + HEAVIER, declared=one.load)
    elif what == "torque constant +1 %":
        run = one.run_of(machine, 200, torque_scale=1.01)
    elif what == "bearing −10 %":
        run, true = one.run_of(stiffer(machine, 0.9), 200), true_stiffness(stiffer(machine, 0.9), machine)
    else:
        run = one.measured(200)
    return assess(preload(run, model, runs[-1]), machine.preload, machine.preload, true)


def dented(machine: Machine, middle: float) -> Machine:
    """The machine with less preload over a part of its way."""
    deep = float(machine.pressed(0.0)) * (1 - (1 - LOSS) ** (2 / 3))
    half, edge = WIDTH / 2, 0.005
    lost = ((-half - edge, 0.0), (-half, deep), (half, deep), (half + edge, 0.0))
    return replace(machine, lost=tuple((middle + way, depth) for way, depth in lost))


def local(seed: int, worn: bool) -> Place:
    """Show 3 on one axis."""
    one = axis(seed)
    runs = one.experiment()
    model = calibrate(runs, one.sheet)
    random = np.random.default_rng([seed, 0x10CA])
    stops = np.array(one.plan.positions)
    if worn:
        middle = float(random.uniform(stops[0], stops[-1]))  # at a stop or between two
        run = one.run_of(dented(one.machine, middle), 300)
    else:
        middle = float("nan")
        run = one.measured(300, ratio=float(random.uniform(0.4, 1.0)))
    found = preload(run, model, runs[-1]).profile
    estimate = None
    if found is not None and found.start is not None and found.stop is not None:
        estimate = (found.start + found.stop) / 2
    return Place(middle, estimate, float(np.diff(stops).max()))


def analyse_bench(folder: Path) -> list[Run]:
    """Runs of both states of the bench, the new one first."""
    return [
        ballscrew.analyze(
            sorted(folder.glob(f"{state}-trip*.h5")),
            channels=folder / "channels.toml",
            axis=folder / "axis.toml",
            plan=folder / "plan.toml",
            mass="100 kg",
        )
        for state in STATES
    ]


def bench(folder: Path, runs: list[Run]) -> tuple[PreloadEstimate, CalibratedAxis, float]:
    """Show 4: the estimate, the model, and the true P/P₀."""
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    model = calibrate(runs[:1], read_axis(folder / "axis.toml"))
    ratio = truth[STATES[1]]["preload_N"] / truth[STATES[0]]["preload_N"]
    return preload(runs[1], model, runs[0]), model, ratio


def recorded(seed: int, trips: int = 10) -> list[Assessed]:
    """As show 1, without an anchor, from recordings on: two loads, then four states."""
    sampled = random_axis(seed)
    new, load = sampled.rig.machine.preload, sampled.load
    cases = ((1.0, round(0.3 * load, 1)), (1.0, load), *((ratio, load) for ratio in RECORDED))
    runs = []
    for k, (ratio, mass) in enumerate(cases):
        rig = replace(sampled.rig, machine=replace(sampled.rig.machine, preload=ratio * new))
        plan = replace(sampled.plan, repetitions=trips, masses=(mass,))
        with tempfile.TemporaryDirectory() as name:
            files = simulate_run(rig, plan, mass, Path(name), sheet=sampled.data_sheet, seed=100 * seed + k)
            channels = Path(name) / "channels.toml"
            runs.append(
                ballscrew.analyze(
                    files.recordings, channels=channels, axis=sampled.data_sheet, plan=plan, mass=mass
                )
            )
    model = calibrate(runs[:2], sampled.data_sheet)
    return [
        assess(preload(run, model, runs[1]), ratio * new, new)
        for run, ratio in zip(runs[2:], RECORDED, strict=True)
    ]


def _each(name: str, axes: int, one: Callable[[int], Row]) -> list[Row]:
    rows: list[Row] = []
    for seed in range(axes):
        try:
            rows.append(one(seed))
        except BallscrewError as error:
            print(f"{name}, axis {seed}: {error}", file=sys.stderr, flush=True)
    print(f"{name}: {len(rows)} of {axes} axes", file=sys.stderr, flush=True)
    return rows


def bounds(axes: int) -> dict[str, np.ndarray]:
    """By case, shape (axes, states); of two levels there is none."""
    plain = {name: case for name, case in CASES.items() if not case.levels and case.bearing is None}
    made = np.array(_each("bound", axes, partial(best, cases=tuple(plain.values()))))
    return {name: made[:, k] for k, name in enumerate(plain)} if len(made) else {}


def tables(show: Sequence[int], axes: int, few: int, folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Each as soon as it is made."""
    head = [heading(f"python -m benchmarks.preload --axes {axes}"), ""]
    if 1 in show:
        rows = {name: _each(name, axes, partial(wear, case=case)) for name, case in CASES.items()}
        flat = {name: [one for axis in of for one in axis] for name, of in rows.items()}
        yield "wear", [*head, *wear_table(flat, bounds(axes), RATIOS)]
    if 2 in show:
        imitations = {what: _each(what, axes, partial(imitation, what=what)) for what in IMITATIONS}
        yield "imitations", [*head, *imitation_table(imitations)]
    if 3 in show:
        worn = _each("local wear", axes, partial(local, worn=True))
        even = _each("even wear", axes, partial(local, worn=False))
        yield "local wear", [*head, *local_table(worn, even)]
    if 4 in show and folder.is_dir():
        yield (
            "bench",
            [
                heading("python -m benchmarks.preload --show 4"),
                "",
                *bench_table(*bench(folder, analyse_bench(folder))),
            ],
        )
    elif 4 in show:
        print(f"no bench at {folder}: its table is left out; set BALLSCREW_DATA.", file=sys.stderr)
    if 5 in show and few:
        assessed = [row for axis in _each("recorded", few, recorded) for row in axis]
        command = f"python -m benchmarks.preload --show 5 --recorded {few}"
        yield "recorded", [heading(command), "", *wear_table({"none": assessed})]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("BALLSCREW_DATA", "../shared/data")))
    parser.add_argument("--axes", type=int, default=100)
    parser.add_argument("--recorded", type=int, default=8)
    parser.add_argument("--show", type=int, nargs="*", default=[1, 2, 3, 4, 5])
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    for name, lines in tables(given.show, given.axes, given.recorded, given.data / "bench"):
        print("\n".join(lines), end="\n\n", flush=True)
        if given.page is not None:
            write(given.page, name, lines)


if __name__ == "__main__":
    main()
