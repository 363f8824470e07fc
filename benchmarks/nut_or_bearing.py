"""Nut or support bearing: which is named, and what a drifting bearing does to the alarm.

    python -m benchmarks.nut_or_bearing [--axes 40] [--draws 2000] [--first 0] [--page PAGE]

1. Axes of :mod:`benchmarks.preload` whose stiffness fell as by a quarter of the preload, by the nut alone or
   by the bearing alone, with and without two acceleration levels in baseline and run. In a life of the nut
   the bearing drifts by ± 1 % (95 %).
2. Lives and healthy years of :mod:`benchmarks.early`, a run a day, with bearings that do not drift, that
   drift by ± 1 % of their rigidity (95 %) within months, and by the default prior of a preload's uncertainty.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import BallscrewError
from ballscrew.base.quantity import NORMAL_95
from ballscrew.calibration.assumptions import BEARING_PRELOAD
from ballscrew.calibration.calibration import calibrate
from ballscrew.estimation.nut import NutOrBearing
from ballscrew.estimation.preload import preload
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.testbed.machine import Machine
from benchmarks.early import YEAR, first_alarm_of
from benchmarks.early_axes import course, curve, draw_life, levels, of_day
from benchmarks.identification_tables import write
from benchmarks.machine import heading
from benchmarks.preload import SOFTENING, axis
from benchmarks.preload_cases import stiffer, true_stiffness

QUARTER = 0.75  # stiffness as P/P₀ of the runs in which nut or bearing is to be named
SURE = 0.8  # probability from which on one is named
HEALTHY = 0.01 / NORMAL_95  # of ln k_b
DRIFTS = {"none": 0.0, "± 1 % (95 %)": HEALTHY, "the default prior": BEARING_PRELOAD / 3}
DAYS = 60.0  # in which half of a bearing's drift happens
_DEEPEST = 0.45  # of the preload: a life is followed down to here


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
    """Show 1."""
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


@dataclass(frozen=True, slots=True)
class DriftResult:
    """Stiffness lost at the first alarm of a life, and whether a healthy year had one, and its drift."""

    lost: float | None
    false_alarm: bool
    drift: float


def with_drift(seed: int, draws: int) -> dict[str, DriftResult]:
    """One axis with each drift of its bearing."""
    of, one, _ = curve(seed)
    machine = one.machine
    softest = true_stiffness(stiffer(machine, 0.9), machine)
    over_nut = (softest ** (-1 / 3) - 1) / (1 / 0.9 - 1)  # compliance of the bearing over the nut's
    life, sample = draw_life(seed), float(np.random.default_rng([seed, 0xD1F]).standard_normal())
    settings = MonitorSettings(draws=draws, repeats_per_year=0)  # no second run on a day
    found = {}
    for name, spread in DRIFTS.items():

        def equivalent(ratio: Array, days: Array, size: float = spread * sample) -> Array:
            """Stiffness as P/P₀ with the bearing's drift."""
            drift = size * days / (days + DAYS)
            return np.asarray((ratio ** (-1 / 3) + over_nut * np.expm1(-drift)) ** -3)

        when = course(seed, life.onset + life.days)
        ratio = of_day(life, when.days)
        last = max(int(np.searchsorted(-ratio, -_DEEPEST)) + 1, 12)
        when = replace(
            when, days=when.days[:last], temperature=when.temperature[:last], read=when.read[:last]
        )
        stiffness = equivalent(ratio[:last], when.days)
        k = first_alarm_of(
            when.days, levels(of, life, when, stiffness, 1), of.uncertainty, when, settings
        )  # fmt: skip
        year = course(seed + 7_000_000, YEAR)
        sound = equivalent(np.ones_like(year.days), year.days)
        alarm = first_alarm_of(year.days, levels(of, life, year, sound, 2), of.uncertainty, year, settings)
        lost = None if k is None else float(1 - stiffness[k])
        found[name] = DriftResult(lost, alarm is not None, 1 - float(sound[-1]))
    return found


def drift_table(rows: Sequence[dict[str, DriftResult]]) -> list[str]:
    """Show 2."""
    heads = ["drift of the bearing", "axes", "stiffness lost at the alarm: median (90 % of lives)"]
    heads += ["healthy years with an alarm", "of them with 2 % of stiffness or more lost"]
    out = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for name in DRIFTS:
        found = [row[name] for row in rows]
        lost = [100 * each.lost for each in found if each.lost is not None]
        alarms = [each for each in found if each.false_alarm]
        true = sum(each.drift >= 0.02 for each in alarms)
        out.append(
            f"| {name} | {len(found)} | {np.median(lost):.1f} % ({np.quantile(lost, 0.9):.1f} %) | "
            f"{len(alarms)} | {true} |"
        )
    return out


def tables(axes: int, first: int, draws: int) -> Iterator[tuple[str, list[str]]]:
    """Each as soon as it is made."""
    head = [heading(f"python -m benchmarks.nut_or_bearing --axes {axes} --draws {draws}"), ""]
    rows: dict[str, list[Named]] = {"two": [], "one": []}
    drifts = []
    for seed in range(first, first + axes):
        try:
            rows["two"] += named(seed, True)
            rows["one"] += named(seed, False)
            drifts.append(with_drift(seed, draws))
        except BallscrewError as error:
            print(f"axis {seed}: {error}", file=sys.stderr, flush=True)
    yield "nut or bearing", [*head, *named_table(rows)]
    yield "bearing drift", [*head, *drift_table(drifts)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--axes", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--draws", type=int, default=2000)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    for name, lines in tables(given.axes, given.first, given.draws):
        print("\n".join(lines), end="\n\n", flush=True)
        if given.page is not None:
            write(given.page, name, lines)


if __name__ == "__main__":
    main()
