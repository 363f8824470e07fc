"""Examples of machines that the data sheet does not describe, on the testbed's example axis.

    python -m benchmarks.other_examples --cache FOLDER [--page PAGE]

Each beside the answer of an earlier version, which had no such fields, one result and no doubt. Four trips;
two loads calibrate. FOLDER keeps analysed runs.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import ballscrew
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import BallscrewError
from ballscrew.base.jsonfile import write_json
from ballscrew.calibration.calibration import calibrate
from ballscrew.estimation.preload import preload
from ballscrew.modal.run import Run
from ballscrew.testbed.example import AXIS, LOAD, PLAN
from ballscrew.testbed.linear import natural_frequencies
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.run import simulate_run
from ballscrew.testbed.trip import Rig, prepared
from benchmarks.identification_tables import write
from benchmarks.machine import heading
from benchmarks.other_worlds import CLEARANCE_K, ISO_K

TRIPS, LOW_LOAD = 4, 15.0
BEARING_PRELOAD = 2000.0
P = AXIS.nominal_preload
FRAME = replace(Machine(AXIS, P), bed_mass=500.0, bed_frequency=180.0)
VERTICAL = replace(AXIS, orientation="vertical", inclination=math.pi / 2)
GEARED = replace(AXIS, drive=replace(AXIS.drive, ratio=2.0))
BOTH_ENDS = replace(AXIS, support="fixed-fixed", bearing=replace(AXIS.bearing, pretension=2500.0))


@dataclass(frozen=True, slots=True)
class Example:
    """A machine when new, what becomes of it, and the data sheet that the analysis is given."""

    name: str
    new: Machine
    later: Machine
    sheet: DataSheet
    earlier: str


def examples() -> list[Example]:
    """All of them."""
    plain = Machine(AXIS, P, bearing_preload=BEARING_PRELOAD)
    half = replace(plain, preload=P / 2)
    up, geared = Machine(VERTICAL, P), Machine(GEARED, P)
    stretched = Machine(BOTH_ENDS, P, pretension=2500.0)
    return [
        Example("bearing preload −10 %", plain, replace(plain, bearing_preload_ratio=0.9), AXIS,
                "0.853 [0.795, 0.906], good"),
        Example("0.8 applied twice, P/P₀ = 0.50", plain, half, _rigidity(ISO_K), "0.54, good"),
        Example("K with clearance at 0.30 Ca, read as preloaded at 0.10 Ca, P/P₀ = 0.50", plain, half,
                _rigidity(CLEARANCE_K), "0.63, good"),
        Example("vertical, sheet silent, P/P₀ = 0.75", up, replace(up, preload=0.75 * P), AXIS, "0.69, good"),
        Example("vertical, stated, P/P₀ = 0.75", up, replace(up, preload=0.75 * P), VERTICAL, "no field"),
        Example("transmission 2, sheet silent, P/P₀ = 0.75", geared, replace(geared, preload=0.75 * P), AXIS,
                "no field"),
        Example("pretension lost, P/P₀ = 1", stretched, replace(stretched, pretension=0.0), BOTH_ENDS,
                "0.25 to 0.02 along the travel"),
        Example("frame of 500 kg at 180 Hz, P/P₀ = 0.75", FRAME,
                replace(FRAME, preload=0.75 * P), AXIS, "143.6 Hz for 205.2 Hz, 38 of 40 cells good"),
    ]  # fmt: skip


def _rigidity(part: float) -> DataSheet:
    return replace(AXIS, screw=replace(AXIS.screw, rigidity=part * AXIS.screw.rigidity))


def analysed(name: str, machine: Machine, load: float, sheet: DataSheet, folder: Path, seed: int) -> Run:
    """Run from the folder, or simulated and analysed."""
    path = folder / f"{name}.json"
    if path.exists():
        return Run.read(path)
    plan = replace(PLAN, repetitions=TRIPS, masses=(load,))
    with tempfile.TemporaryDirectory() as place:
        files = simulate_run(Rig(machine), plan, load, Path(place), seed=seed, sheet=sheet, workers=1)
        run = ballscrew.analyze(files.run)
    path.write_text(write_json(run.to_json()), encoding="utf-8")
    return run


def answer(example: Example, folder: Path) -> str:
    """What is printed now, in short."""
    read = replace(example.sheet, screw=AXIS.screw)  # the analysis does not depend on the rigidity
    state = name_of(example.new, read)

    def run(word: str, machine: Machine, load: float, seed: int) -> Run:
        return analysed(f"{state} {word}", machine, load, read, folder, seed)

    try:
        low, new = run("low", example.new, LOW_LOAD, 1), run("new", example.new, LOAD, 2)
        model = calibrate([low, new], example.sheet)
        later = run(f"later {name_of(example.later, read)}", example.later, LOAD, 3)
        estimate = preload(later, model, new)
    except BallscrewError as error:
        return f"refused: {error}"
    words = []
    for name, verdict, quantity, reasons in (
        ("stiffness", estimate.verdict, estimate.stiffness_relative_to_baseline, estimate.reasons),
        ("nut", estimate.nut_verdict, estimate.relative_to_baseline, estimate.nut_reasons),
    ):
        text = f"{name} {verdict}"
        if quantity is not None:
            low_end, high_end = quantity.interval
            text += f", {quantity.value:.3f} [{low_end:.3f}, {high_end:.3f}]"
        if reasons and name == "stiffness":
            text += f" ({reasons[0]})"
        words.append(text)
    return "; ".join(words) + modes_in_words(example.new, new)


def name_of(machine: Machine, sheet: DataSheet) -> str:
    """Name of a state for the folder."""
    return hashlib.sha256(f"{machine}{sheet}".encode()).hexdigest()[:12]


def modes_in_words(machine: Machine, run: Run) -> str:
    """Frequency in the middle beside the true modes, where a frame has one of its own."""
    if machine.bed_frequency < 100:
        return ""
    middle = PLAN.positions[len(PLAN.positions) // 2]
    near_middle = [cell for cell in run.cells if abs(cell.position_m - middle) < 0.03]
    found = [cell.frequency_Hz for cell in near_middle if cell.frequency_Hz is not None]
    modes, share = natural_frequencies(prepared(machine, LOAD, PLAN), middle)
    table = [f"{f:.1f}" for f, part in zip(modes, share, strict=True) if 80 < f < 320 and part > 0.03]
    good = sum(cell.verdict == "good" for cell in run.cells)
    measured = f"{np.median(found):.1f} Hz" if found else "no frequency"
    true = " and ".join(table)
    return f"; in the middle {measured}, true modes {true} Hz, {good} of {len(run.cells)} cells good"


def rows(folder: Path) -> Iterator[str]:
    """Lines of the table."""
    yield "| example | an earlier version | now |"
    yield "|---|---|---|"
    for example in examples():
        line = f"| {example.name} | {example.earlier} | {answer(example, folder)} |"
        print(line, flush=True)
        yield line


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    given.cache.mkdir(parents=True, exist_ok=True)
    words = "The testbed's example axis, four trips; values are P/P₀."
    command = heading("python -m benchmarks.other_examples")
    lines = ["## Examples", "", words, "", command, "", *rows(given.cache)]
    if given.page is not None:
        write(given.page, "examples", lines)


if __name__ == "__main__":
    main()
