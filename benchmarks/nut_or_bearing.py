"""Nut or support bearing: which is named where the axial stiffness has fallen.

    python -m benchmarks.nut_or_bearing [--axes 40] [--first 0] [--page PAGE]

Axes of :mod:`benchmarks.preload` whose stiffness fell as by a quarter of the preload, by the nut alone or by
the bearing alone, with and without two acceleration levels in baseline and run. In a life of the nut the
bearing drifts by ± 1 % (95 %).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballscrew.base.errors import BallscrewError
from ballscrew.base.quantity import NORMAL_95
from ballscrew.calibration.calibration import calibrate
from ballscrew.estimation.nut import NutOrBearing
from ballscrew.estimation.preload import preload
from ballscrew.testbed.machine import Machine
from benchmarks.identification_tables import write
from benchmarks.machine import heading
from benchmarks.preload import SOFTENING, axis
from benchmarks.preload_cases import stiffer, true_stiffness

QUARTER = 0.75  # stiffness as P/P₀ of the runs in which nut or bearing is to be named
SURE = 0.8  # probability from which on one is named
HEALTHY = 0.01 / NORMAL_95  # of ln k_b


@dataclass(frozen=True, slots=True)
class Named:
    """Cause of a change, and the share that was estimated."""

    cause: str
    share: NutOrBearing | None


def softer_bearing(machine: Machine, ratio: float) -> Machine:
    """The machine with a bearing so soft that its stiffness is that of a preload ratio."""
    low, high = 0.2, 1.0
    for _ in range(50):
        middle = (low + high) / 2
        if true_stiffness(stiffer(machine, middle), machine) < ratio:
            low = middle
        else:
            high = middle
    return stiffer(machine, high)


def named(seed: int, levels_used: bool) -> list[Named]:
    """Both causes on one axis."""
    one = axis(seed, SOFTENING if levels_used else np.inf)
    runs = one.experiment()
    model = calibrate(runs, one.sheet)
    drift = float(np.exp(HEALTHY * np.random.default_rng([seed, 0xB0]).standard_normal()))
    worn = stiffer(replace(one.machine, preload=QUARTER * one.machine.preload), drift)
    soft = softer_bearing(one.machine, QUARTER)
    rows = []
    for stream, cause, machine in ((700, "nut", worn), (701, "bearing", soft)):
        rows.append(Named(cause, preload(one.run_of(machine, stream), model, runs[-1]).nut_or_bearing))
    return rows


def named_table(rows: dict[str, list[Named]]) -> list[str]:
    """Table by acceleration levels and cause."""
    heads = ["acceleration levels", "cause", "runs", f"named at {SURE:g} or more", f"wrong at {SURE:g}"]
    heads += ["not identifiable", "Brier"]
    out = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for words, everything in rows.items():
        for cause, other in (("nut", "bearing"), ("bearing", "nut")):
            shares = [row.share for row in everything if row.cause == cause]
            known = [share for share in shares if share is not None and share.identifiable]
            right = sum(getattr(share, cause) >= SURE for share in known)
            wrong = sum(getattr(share, other) >= SURE for share in known)
            score = "–"
            if known:
                score = f"{np.mean([brier(share, cause) for share in known]):.3f}"
            out.append(
                f"| {words} | {cause} | {len(shares)} | {right} | {wrong} | "
                f"{len(shares) - len(known)} | {score} |"
            )
    return out


def brier(share: NutOrBearing, cause: str) -> float:
    """Brier score of the three probabilities, 0 to 2."""
    total = 0.0
    for name in ("nut", "bearing", "both"):
        total += (getattr(share, name) - (name == cause)) ** 2
    return total


def tables(axes: int, first: int) -> Iterator[tuple[str, list[str]]]:
    """Each as soon as it is made."""
    head = [heading(f"python -m benchmarks.nut_or_bearing --axes {axes}"), ""]
    rows: dict[str, list[Named]] = {"two": [], "one": []}
    for seed in range(first, first + axes):
        try:
            rows["two"] += named(seed, True)
            rows["one"] += named(seed, False)
        except BallscrewError as error:
            print(f"axis {seed}: {error}", file=sys.stderr, flush=True)
    yield "nut or bearing", [*head, *named_table(rows)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--axes", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    for name, lines in tables(given.axes, given.first):
        print("\n".join(lines), end="\n\n", flush=True)
        if given.page is not None:
            write(given.page, name, lines)


if __name__ == "__main__":
    main()
