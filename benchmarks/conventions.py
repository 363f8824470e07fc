"""Conventions of K, right and wrong on the sheet: which calibrations are suspect, which good intervals miss.

    python -m benchmarks.conventions [--first 500] [--axes 41] [--noise 1] [--wrong 0.5] [--workers 2]

Axes of :mod:`benchmarks.other_worlds` at the level of mode tables (:mod:`benchmarks.mode_tables`): two loads
when new, then P/P₀ of 1, 0.85 and 0.6. K is printed in one of three conventions and stated in each of them.
--wrong are probabilities, before any data, of another convention than the stated one; each evidence for the
other conventions, beyond which a calibration is suspect, has columns of its own. --noise multiplies that of
the mode tables: 3 gives the intervals of four trips with five stops.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import BallscrewError
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.calibration import calibrate
from ballscrew.calibration.conventions import WRONG
from ballscrew.estimation.preload import preload
from ballscrew.modal.run import Run
from benchmarks.machine import heading
from benchmarks.mode_tables import analyst, mode_table
from benchmarks.other_tables import PROMISED, fewest_misses
from benchmarks.other_worlds import CLEARANCE_K, ISO_K, LOW_LOAD, RATIOS, Bench, bench, truth

# Convention, preload at which it states K, and K over that of a nut preloaded by 0.10 Ca.
PRINTED = {
    "preloaded": ("preloaded", 0.10, 1.0),
    "R_nu,ar": ("iso", 0.10, ISO_K),
    "clearance": ("clearance", None, CLEARANCE_K),
}
EVIDENCE = (math.sqrt(10), 10.0, 100.0)
DAYS = (30.0, 130.0, 230.0)  # of the later runs


@dataclass(frozen=True)
class Answer:
    """One estimate of the axial stiffness as P/P₀.

    Parameters
    ----------
    axis : int
        Seed.
    printed, stated : str
        Convention of K, and what the sheet states.
    wrong : float
        Probability of another convention, before any data.
    evidence : float
        For the other conventions, over the stated one.
    good : bool
        Whether nothing else makes it suspect.
    misses : bool
        Whether the 95 % interval misses.
    half_width : float
        Of the interval.
    """

    axis: int
    printed: str
    stated: str
    wrong: float
    evidence: float
    good: bool
    misses: bool
    half_width: float


def measured(one: Bench, seed: int, noise: float) -> list[Run]:
    """Two loads when new, and the later runs."""
    random = np.random.default_rng([seed, 0x51])
    who = analyst(one.sheet, one.plan, random)
    who = replace(who, noise=noise * who.noise)
    machine = one.rig.machine
    loads = (round(LOW_LOAD * one.load, 1), one.load)
    runs = [mode_table(who, machine, one.plan, load, random, day=k / 24) for k, load in enumerate(loads)]
    for ratio, day in zip(RATIOS, DAYS, strict=True):
        runs.append(mode_table(who, one.later(ratio), one.plan, one.load, random, day=day))
    return runs


def restated(sheet: DataSheet, printed: str, stated: str) -> DataSheet:
    """The sheet with K in one convention, stated as in another."""
    convention, ratio, _ = PRINTED[stated]
    rigidity = PRINTED[printed][2] * sheet.screw.rigidity
    screw = replace(
        sheet.screw, rigidity=rigidity, rigidity_convention=convention, rigidity_preload_ratio=ratio
    )
    return replace(sheet, screw=screw)


def evidence(model: CalibratedAxis) -> float:
    """Evidence for the other conventions together, over the stated one."""
    others = sum(reading.probability for reading in model.conventions)
    return others / max(1 - others, 1e-12) * (1 - WRONG) / WRONG


def expected(model: CalibratedAxis, wrong: float) -> CalibratedAxis:
    """The model with another probability of the other conventions before any data."""
    others = sum(reading.probability for reading in model.conventions)
    factor = wrong / (1 - wrong) * (1 - WRONG) / WRONG
    whole = max(1 - others, 1e-12) + factor * others
    conventions = [replace(r, probability=factor * r.probability / whole) for r in model.conventions]
    return replace(model, conventions=tuple(conventions))


def answers(seed: int, noise: float, probabilities: Sequence[float]) -> list[Answer]:
    """All answers on one axis."""
    one = bench(seed, "as new")
    runs = measured(one, seed, noise)
    true = [truth(one, ratio).stiffness for ratio in RATIOS]
    found: list[Answer] = []
    for printed in PRINTED:
        for stated in PRINTED:
            try:
                model = calibrate(runs[:2], restated(one.sheet, printed, stated))
            except BallscrewError:
                continue
            by_tolerance = [doubt for doubt in model.reasons if not doubt.text.startswith("the data fit a K")]
            for wrong in probabilities:
                for run, value in zip(runs[2:], true, strict=True):
                    estimate = preload(run, expected(replace(model, reasons=()), wrong), runs[1])
                    quantity = estimate.stiffness_relative_to_baseline
                    if quantity is None:
                        continue
                    low, high = quantity.interval
                    good = not by_tolerance and estimate.verdict == "good"
                    missed = not low <= value <= high
                    of_model = (seed, printed, stated, wrong, evidence(model))
                    found.append(Answer(*of_model, good, missed, (high - low) / 2))
    return found


def table(rows: Sequence[Answer], probabilities: Sequence[float]) -> Iterator[str]:
    """Suspect axes, misses of good answers and mean half-width, by what makes a calibration suspect."""
    yield "| K printed | stated | wrong, before data |" + "".join(
        f" evidence {limit:.3g}: suspect | good: missed | 95 % |" for limit in EVIDENCE
    )
    yield "|---" * (3 + 3 * len(EVIDENCE)) + "|"
    for printed in PRINTED:
        for stated in PRINTED:
            for wrong in probabilities:
                of_world = [
                    row for row in rows if (row.printed, row.stated, row.wrong) == (printed, stated, wrong)
                ]
                cells = "".join(_columns(of_world, limit) for limit in EVIDENCE)
                yield f"| {printed} | {stated} | {wrong:g} |{cells}"


def _columns(rows: Sequence[Answer], limit: float) -> str:
    axes = {row.axis for row in rows}
    good = [row for row in rows if row.good and row.evidence <= limit]
    suspect = len(axes) - len({row.axis for row in good})
    if not good:
        return f" {suspect} of {len(axes)} | – | – |"
    misses = np.array([row.misses for row in good])
    missed = f"{misses.sum()} of {len(good)}"
    if fewest_misses(misses, np.array([row.axis for row in good])) > PROMISED:
        missed = f"**{missed}**"
    width = np.mean([row.half_width for row in good])
    return f" {suspect} of {len(axes)} | {missed} | ± {width:.3f} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--axes", type=int, default=41)
    parser.add_argument("--noise", type=float, default=1.0)
    parser.add_argument("--wrong", type=float, nargs="*", default=[WRONG])
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    job = partial(answers, noise=given.noise, probabilities=given.wrong)
    rows: list[Answer] = []
    with ProcessPoolExecutor(max_workers=given.workers) as pool:
        for found in pool.map(job, range(given.first, given.first + given.axes)):
            rows += found
            print(f"axis {rows[-1].axis}", flush=True)
    command = f"python -m benchmarks.conventions --first {given.first} --axes {given.axes}"
    print("\n".join([heading(f"{command} --noise {given.noise:g}"), "", *table(rows, given.wrong)]))


if __name__ == "__main__":
    main()
