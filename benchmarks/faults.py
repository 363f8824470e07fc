"""What the quality gate sees of every fault of the catalogue, and how often it flags a good run.

Good runs are simulated on the testbed, each fault is put on them at its strengths, the files are written to a
temporary folder and analysed as any others. The figures of docs/explanation/faults.md come from here:

    python -m benchmarks.faults
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from unittest.mock import patch

import h5py
import numpy as np
from scipy.stats import beta

import ballscrew
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import axis_toml, read_axis
from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import Plan, read_plan
from ballscrew.fcft.planfile import plan_toml
from ballscrew.modal.joint.settings import Response
from ballscrew.recording.quality.finding import Finding, Quality, in_order
from ballscrew.testbed.linear import least_steps, true_frequency
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.trip import Rig, prepared, simulate_trip
from benchmarks.axis_sampling import random_axis
from benchmarks.fault_injection import FAULTS, RecordedTrips, Setup, inject
from benchmarks.machine import heading

TRIPS = 3
KINDS = ("bench", "random")  # that carry the faults
GOOD = ("data", *KINDS, "servo", "axis")
CARRIER = 1000  # seed of the two runs that the faults are put on
HARM = 1e-3  # of the frequency: 2 % of the preload
LOAD = 100.0
INPUT_ERROR = "input-error"  # a command that ends with one sentence and exit status 2
# Reasons that name the fault, by the start of its name; a longer start goes before a shorter one.
RIGHT: Mapping[str, tuple[str, ...]] = {
    "clipped": ("clipped",),
    "flat": ("flat", "stuck"),
    "flat position": ("flat", "stuck", "no-motion", "pause"),
    "NaN": ("nan",),
    "Inf": ("nan",),
    "integer wrap": ("wrapped",),
    "dropped": ("dropped", "stuck", "pause"),
    "dropped samples in acceleration": ("delay-changes", "dropped", "stuck"),
    "swapped": ("unrelated", "sensors-disagree"),
    "inverted": ("polarity",),
    "wrong scale of torque": ("scale", "load"),
    "wrong scale of acc": ("scale", "sensors-disagree"),
    "wrong scale of both": ("scale",),
    "wrong scale of pos": ("scale", "places", "offset", "stops"),
    "50": ("hum",),
    "60": ("hum",),
    "missing": (INPUT_ERROR,),
    "acceleration late": ("delay",),
    "torque late": ("delay",),
    "acceleration on": ("delay", "delay-changes"),
    "remounted": ("sensors-disagree", "scale"),
    "loose": ("sensors-disagree", "unrelated"),
    "both": ("unrelated",),
    "cut record": ("stops", "repetitions", "short", "no-motion", "set-aside"),
    "cut file": (INPUT_ERROR,),
    "wrong declared": ("rate",),
    "missed": ("repetitions",),
    "two runs": ("repetitions", "copies", INPUT_ERROR),
    "position not": ("places", "stops"),
    "speed": ("speed",),
    "changed mass": ("load",),
}


@dataclass(frozen=True)
class Case:
    """One run: a good one where there is no fault."""

    seed: int
    kind: str = "bench"
    fault: str | None = None
    strength: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """What was said of it."""

    case: Case
    verdict: str
    codes: tuple[str, ...]
    reason: str
    cells: Mapping[tuple[float, str], float]  # reported frequencies, Hz
    error: float  # of them, median, part


@cache
def bench_folder() -> Path:
    """Folder of the recordings of the bench."""
    return Path(os.environ.get("BALLSCREW_DATA", "../shared/data")) / "bench"


@dataclass(frozen=True)
class Declared:
    """What the analysis is given."""

    sheet: DataSheet
    plan: Plan
    load: float


def setup(case: Case) -> tuple[Setup, Declared]:
    """Simulated runs, and the data declared for them."""
    if case.kind == "axis":
        axis = random_axis(case.seed)
        runs = Setup(axis.rig, axis.plan, axis.plan.motions[0], axis.load)
        return runs, Declared(axis.data_sheet, replace(axis.plan, repetitions=TRIPS), axis.load)
    runs = _servo(case.seed) if case.kind == "servo" else _setup(case)
    sheet, plan = read_axis(bench_folder() / "axis.toml"), read_plan(bench_folder() / "plan.toml")
    return runs, Declared(sheet, replace(plan, masses=(runs.load,)), runs.load)


def _servo(seed: int) -> Setup:
    """The bench's axis at another load and preload, under another servo."""
    runs = _setup(Case(seed))
    random = np.random.default_rng([seed, 13])
    machine = replace(
        runs.rig.machine,
        preload=runs.rig.machine.preload * random.uniform(0.1, 1.2),
        damping_ratio=random.uniform(0.015, 0.05),
    )
    loop = random.uniform(22, 60)
    servo = replace(
        runs.rig.servo,
        speed_bandwidth=loop,
        position_bandwidth=loop * random.uniform(0.14, 0.22),
        integral_time=5 / (2 * np.pi * loop) * random.uniform(0.9, 1.6),
        mass_ahead=random.uniform(0.3, 1.0),
    )
    rig = replace(runs.rig, machine=machine, servo=servo)
    return replace(runs, rig=rig, load=round(random.uniform(0, 150), 1))


def _setup(case: Case) -> Setup:
    """A machine like the bench's, or one of which all that may differ does."""
    sheet, plan = read_axis(bench_folder() / "axis.toml"), read_plan(bench_folder() / "plan.toml")
    preload = sheet.nominal_preload
    if case.kind == "bench":
        return Setup(Rig(Machine(sheet, preload)), plan, plan.motions[0], LOAD)
    random = np.random.default_rng([case.seed, 7])
    machine = Machine(
        sheet,
        preload * random.uniform(0.25, 1.2),
        damping_ratio=random.uniform(0.02, 0.05),
        viscous=random.uniform(60, 400),
        drag_ratio=random.uniform(0.7, 1.5),
        bed_frequency=random.uniform(18, 40),
    )
    # Hard damping with a stiff nut asks for more than the usual four steps a sample.
    steps = least_steps(prepared(machine, LOAD, plan), plan.positions, Rig(machine).sample_rate)
    rig = Rig(machine, steps=max(4, steps))
    servo = replace(rig.servo, speed_bandwidth=random.uniform(25, 55), mass_ahead=random.uniform(0.6, 1.0))
    return Setup(replace(rig, servo=servo), plan, plan.motions[0], LOAD)


def run(case: Case) -> Outcome:
    """Simulate, inject the fault, write and analyse one run."""
    if case.kind == "data":
        return _given(case)
    true, declared = setup(case)
    random = np.random.default_rng([case.seed, 11])
    on = FAULTS[case.fault].on if case.fault else None
    if case.fault and on == "setup":
        true = inject(case.fault, true, case.strength, random)
    seeds = np.random.SeedSequence(case.seed).generate_state(TRIPS)
    trips = tuple(simulate_trip(true.rig, true.plan, true.motion, true.load, int(seed)) for seed in seeds)
    recorded = RecordedTrips(trips, true.rig.sample_rate)
    if case.fault and on in ("channels", "trips", "rate"):
        recorded = inject(case.fault, recorded, case.strength, random)
    c = prepared(true.rig.machine, true.load, true.plan)
    findings: list[Finding] = []

    quality_of = Quality.of

    def recorded_quality(found: Sequence[Finding], notes: Sequence[str] = ()) -> Quality:
        findings[:] = in_order(found)
        return quality_of(findings, notes)

    with tempfile.TemporaryDirectory() as folder, patch.object(Quality, "of", recorded_quality):
        files = [Path(folder) / f"trip{index}.h5" for index in range(1, len(recorded.trips) + 1)]
        for file, channels in zip(files, recorded.trips, strict=True):
            write_trip(file, channels, recorded.rate)
        if case.fault and on == "file":
            files[0].write_bytes(inject(case.fault, files[0].read_bytes(), case.strength, random))
        try:
            found = analysed(files, declared, Path(folder))
        except InputError as error:
            return Outcome(case, "refused", (INPUT_ERROR,), str(error), {}, 0.0)
    cells = {(x.position_m, x.condition): x.frequency_Hz for x in found.cells if x.frequency_Hz is not None}
    errors = [abs(value / true_frequency(c, place) - 1) for (place, _), value in cells.items()]
    codes = tuple(dict.fromkeys(finding.code for finding in findings))
    reason = (*found.quality.reasons, "")[0]
    return Outcome(case, found.quality.verdict, codes, reason, cells, float(np.median(errors or [0.0])))


def _given(case: Case) -> Outcome:
    """The bench's own data: both states, and each of their trips alone."""
    state, trip = (4, 2)[case.seed // 4], case.seed % 4
    names = [f"preload-{state}-percent-trip{index}.h5" for index in ([trip] if trip else [1, 2, 3])]
    plan = replace(read_plan(bench_folder() / "plan.toml"), repetitions=len(names))
    with tempfile.TemporaryDirectory() as folder:
        declared = Declared(read_axis(bench_folder() / "axis.toml"), plan, LOAD)
        found = analysed([bench_folder() / name for name in names], declared, Path(folder))
    reason = (*found.quality.reasons, "")[0]
    cells = {(x.position_m, x.condition): x.frequency_Hz for x in found.cells if x.frequency_Hz is not None}
    return Outcome(case, found.quality.verdict, (), reason, cells, np.nan)


def analysed(
    files: Sequence[Path], declared: Declared, folder: Path, response: Response = "both"
) -> ballscrew.Run:
    """Run of these files, with the axis, the plan and the load that are declared."""
    axis, plan = folder / "axis.toml", folder / "plan.toml"
    axis.write_text(axis_toml(declared.sheet), encoding="utf-8")
    plan.write_text(plan_toml(declared.plan), encoding="utf-8")
    return ballscrew.analyze(
        files, channels=_channels(folder), axis=axis, plan=plan, mass=declared.load, response=response
    )


def _channels(folder: Path) -> Path:
    """The bench's map without the rate, which the file then tells."""
    lines = (bench_folder() / "channels.toml").read_text(encoding="utf-8").splitlines()
    path = folder / "channels.toml"
    path.write_text("\n".join(line for line in lines if not line.startswith("sample_rate")), encoding="utf-8")
    return path


def write_trip(path: Path, channels: Mapping[str, np.ndarray], rate: float) -> None:
    """Write the channels of one trip to an HDF5 file."""
    units = {"torque": "N m", "position": "m"}
    with h5py.File(path, "w") as file:
        file.attrs["sample_rate"] = rate
        for name, values in channels.items():
            data = values if name == "position" else values.astype(np.float32)
            file.create_dataset(name, data=data).attrs["unit"] = units.get(
                name, "A" if name.startswith("current") else "m/s^2"
            )


def right_reason(outcome: Outcome) -> str:
    """Whether a reason names the fault, whether it comes first, or whether none does."""
    fault = outcome.case.fault or ""
    starts = sorted((start for start in RIGHT if fault.startswith(start)), key=len)
    wanted = RIGHT[starts[-1]] if starts else ()
    if not outcome.codes or outcome.verdict == "good":
        return ""
    if outcome.codes[0] in wanted:
        return "yes"
    return "not first" if set(outcome.codes) & set(wanted) else "no"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--good", type=int, default=40, help="good runs of each kind")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", default="", help="faults whose name holds this")
    given = parser.parse_args()
    good = [
        Case(seed, kind) for kind in GOOD for seed in range(min(given.good, 8 if kind == "data" else 10**6))
    ]
    # The same two runs carry every fault, so that one strength differs from the next in the strength alone.
    clean = [Case(CARRIER, kind) for kind in KINDS]
    bad = [
        Case(CARRIER, kind, fault.name, strength)
        for fault in FAULTS.values()
        if given.only in fault.name
        for strength in fault.strengths
        for kind in KINDS
    ]
    with ProcessPoolExecutor(given.workers) as pool:
        outcomes = list(pool.map(run, [*good, *clean, *bad], chunksize=4))
    first = len(good) + len(clean)
    print(heading("python -m benchmarks.faults"), end="\n\n")
    _good_table(outcomes[: len(good)])
    _fault_table(outcomes[first:], outcomes[len(good) : first])


def _good_table(outcomes: Sequence[Outcome]) -> None:
    print(
        "| good runs | flagged | 95 % interval | why | cells reported | median error |\n"
        "|---|---|---|---|---|---|"
    )
    for kind in (*GOOD, "all"):
        those = [outcome for outcome in outcomes if kind in (outcome.case.kind, "all")]
        if not those:
            continue
        flagged = [outcome for outcome in those if outcome.verdict != "good"]
        why = ", ".join(sorted({code for outcome in flagged for code in outcome.codes}))
        error = 100 * np.nanmedian([outcome.error for outcome in those]) if kind != "data" else np.nan
        reported = np.mean([len(outcome.cells) for outcome in those])
        low, high = _interval(len(flagged), len(those))
        between = f"{100 * low:.1f} to {100 * high:.1f} %"
        off = "" if np.isnan(error) else f"{error:.2f} %"
        print(f"| {len(those)} {kind} | {len(flagged)} | {between} | {why} | {reported:.1f} | {off} |")
        for outcome in flagged if kind != "all" else ():
            print(f"<!-- {outcome.case.seed}: {outcome.reason[:200]} -->")


def _interval(count: int, of: int) -> tuple[float, float]:
    """Of a share, by Clopper and Pearson."""
    low = float(beta.ppf(0.025, count, of - count + 1)) if count else 0.0
    return low, float(beta.ppf(0.975, count + 1, of - count)) if count < of else 1.0


def _fault_table(outcomes: Sequence[Outcome], clean: Sequence[Outcome]) -> None:
    print("\n| fault | strength | outcome | verdict | codes | cells reported | moves them by |")
    print("|---|---|---|---|---|---|---|")
    counts: dict[str, int] = {}
    for pair in zip(outcomes[::2], outcomes[1::2], strict=True):
        case = pair[0].case
        assert case.fault is not None
        fault = FAULTS[case.fault]
        moved = [_moved(outcome, good) for outcome, good in zip(pair, clean, strict=True)]
        kinds = [_kind(outcome, part) for outcome, part in zip(pair, moved, strict=True)]
        for kind in kinds:
            counts[kind] = counts.get(kind, 0) + 1
        columns = (
            kinds,
            [outcome.verdict for outcome in pair],
            [", ".join(outcome.codes[:2]) for outcome in pair],
            [str(len(outcome.cells)) for outcome in pair],
            ["" if np.isnan(part) else f"{100 * part:+.2f} %" for part in moved],
        )
        texts = " | ".join(_both(one, two) for one, two in columns)
        print(f"| {fault.name} | {case.strength:.3g} {fault.unit} | {texts} |")
    print("\n" + ", ".join(f"{kind}: {number}" for kind, number in sorted(counts.items())))
    named = counts.get("caught", 0)
    matter = sum(counts.values()) - counts.get("history", 0) - counts.get("missed, harmless", 0)
    print(f"named: {named} of {matter}, {100 * named / max(matter, 1):.1f} %; ", end="")
    whole = sum(counts.values())
    print(
        f"of all, with what is harmless and what only the history shows: {named} of {whole}, "
        f"{100 * named / max(whole, 1):.1f} %"
    )


def _moved(outcome: Outcome, clean: Outcome) -> float:
    """Median relative shift of the frequencies reported with and without a fault."""
    both = outcome.cells.keys() & clean.cells.keys()
    return (
        float(np.median([outcome.cells[cell] / clean.cells[cell] - 1 for cell in both])) if both else np.nan
    )


def _kind(outcome: Outcome, moved: float) -> str:
    if outcome.case.fault and FAULTS[outcome.case.fault].only_history(outcome.case.strength):
        return "history"
    if outcome.verdict == "good":
        return "**missed**" if abs(moved) > HARM else "missed, harmless"
    return {"yes": "caught", "not first": "caught, not first"}.get(right_reason(outcome), "wrong reason")


def _both(one: str, two: str) -> str:
    return one if one == two else f"{one or '–'} / {two or '–'}"


if __name__ == "__main__":
    main()
