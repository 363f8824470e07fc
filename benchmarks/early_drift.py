"""Alarms of axes whose support bearing drifts: lives, and healthy years.

    python -m benchmarks.early_drift [--axes 12] [--histories 30] [--draws 5000] [--first 0] [--page PAGE]

Axes and disturbances of :mod:`benchmarks.early`, monitored as configured: a run a day, and again the same
day where that is asked for. A healthy bearing settles: its rigidity changes by the stated prior, half of it
within 30 to 120 days. Limits depend on the days of an axis and not on its levels, so many histories of an
axis share them; each has a scatter, temperature coefficient and drift of its own. A false alarm is that of a
healthy axis whose bearing is within the 95 % interval of its prior; beyond it, the alarm is true.
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
from ballscrew.calibration.assumptions import BEARING_DAILY_DRIFT, BEARING_PRELOAD
from ballscrew.monitoring.detection.chart import relative_loss
from ballscrew.monitoring.detection.design import LevelStep, design_of
from ballscrew.monitoring.detection.limits import compute_limits
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.statistics import statistics
from ballscrew.testbed.machine import Machine
from benchmarks.early import FOLLOWED, YEAR, cut
from benchmarks.early_axes import WARM, Course, Curve, course, curve, draw_life, levels, of_day, repeats
from benchmarks.early_tables import Alarm, table
from benchmarks.identification_tables import write
from benchmarks.machine import heading
from benchmarks.preload_cases import stiffer, true_stiffness

STATED = BEARING_DAILY_DRIFT / NORMAL_95  # standard deviation of ln k_b
DRIFTS = {
    "none": 0.0,
    f"± {100 * BEARING_DAILY_DRIFT:g} % of k_b (95 %), the detection's prior": STATED,
    f"± {200 * BEARING_PRELOAD / 3:.1f} % of k_b (95 %), the prior of a nut's preload": BEARING_PRELOAD / 3,
}
HALF = (30.0, 120.0)  # d, in which half of a drift happens


Rows = dict[str, tuple[list[Alarm], list[Alarm]]]


@dataclass(frozen=True, slots=True)
class History:
    """A history: its drift of the bearing, stiffness as P/P₀, and levels of the runs and their repeats."""

    name: str
    drift: Array
    stiffness: Array
    level: Array
    again: Array


def stiffness_of(over_nut: float, ratio: Array, drift: Array) -> Array:
    """Axial stiffness as P/P₀ with a bearing whose ln k_b has changed."""
    return np.asarray((ratio ** (-1 / 3) + over_nut * np.expm1(-drift)) ** -3)


def bearing_over_nut(machine: Machine) -> float:
    """Compliance of the bearing over that of the nut."""
    softer = 0.9
    stiffness = true_stiffness(stiffer(machine, softer), machine)
    return float((stiffness ** (-1 / 3) - 1) / (1 / softer - 1))


def histories(
    of: Curve, over_nut: float, when: Course, ratio: Array, stream: int, count: int
) -> list[History]:
    """Histories on the same days, each with all drifts."""
    random, found = np.random.default_rng([of.seed, stream, 0xD1F]), []
    for number in range(count):
        life = replace(
            draw_life(of.seed),
            scatter=2.0 ** float(random.uniform(-1, 1)),
            warm=WARM * float(random.standard_normal()),
        )
        half = np.exp(random.uniform(*np.log(HALF)))
        settled = random.standard_normal() * when.days / (when.days + half)
        for name, spread in DRIFTS.items():
            stiffness = stiffness_of(over_nut, ratio, spread * settled)
            level = levels(of, life, when, stiffness, stream + number)
            again = repeats(of, life, when, stiffness, stream + number)
            found.append(History(name, settled, stiffness, level, again))
    return found


def first_alarms(of: Curve, when: Course, onset: float, found: Sequence[History], draws: int) -> list[Alarm]:
    """First alarm of each history; one by a bearing beyond its prior is none, and ends the history."""
    settings, nominal = MonitorSettings(draws=draws), found[0].stiffness
    smooth = levels(replace(of, scatter=0.0), draw_life(of.seed), when, nominal)
    lost_uncertainty = relative_loss(smooth, np.full(len(smooth), of.uncertainty))[1]
    steps = (LevelStep(when.remount, settings.remounted),)
    design = design_of(when.days, lost_uncertainty, when.read, steps, settings, of.bearing * STATED)
    known = compute_limits(design)
    lost, again = (
        1 - 1 / (1 + np.maximum(np.array(level).T, -0.5))
        for level in ([each.level for each in found], [each.again for each in found])
    )
    values = statistics(design, lost, again, lambda k, _: float(known.repeat[k]))
    alarms = []
    for history, alarmed, repeated in zip(found, known.alarms(values).T, values.repeated.T, strict=True):
        until, k = float(when.days[-1]), None
        if alarmed.any():
            k = int(np.argmax(alarmed))
        made = int(repeated[: None if k is None else k + 1].sum())
        if k is None:
            alarms.append(Alarm(None, None, float("nan"), onset, until, made))
            continue
        day, beyond = float(when.days[k]), abs(float(history.drift[k])) > NORMAL_95
        if beyond and day <= onset:
            alarms.append(Alarm(None, None, float("nan"), onset, day, made))
            continue
        alarms.append(Alarm(day, k, float(1 - history.stiffness[k]), onset, until, made))
    return alarms


def axis_alarms(seed: int, count: int, draws: int) -> Rows:
    """Alarms of lives and healthy years of one axis, by the drift."""
    of, one, _ = curve(seed)
    over_nut, life = bearing_over_nut(one.machine), draw_life(seed)
    when = course(seed, life.onset + life.days)
    ratio = of_day(life, when.days)
    last = max(int(np.searchsorted(-ratio, -FOLLOWED)) + 1, 12)
    worn = histories(of, over_nut, cut(when, last), ratio[:last], 1000, count)
    ends = first_alarms(of, cut(when, last), life.onset, worn, draws)
    year = course(seed + 7_000_000, YEAR)
    healthy = histories(of, over_nut, year, np.ones_like(year.days), 2000, count)
    sound = first_alarms(of, year, float("inf"), healthy, draws)
    rows: Rows = {name: ([], []) for name in DRIFTS}
    for column, (found, alarms) in enumerate(((worn, ends), (healthy, sound))):
        for history, alarm in zip(found, alarms, strict=True):
            rows[history.name][column].append(alarm)
    return rows


def tables(axes: int, first: int, count: int, draws: int) -> Iterator[list[str]]:
    """The table after each axis."""
    rows: Rows = {name: ([], []) for name in DRIFTS}
    for number, seed in enumerate(range(first, first + axes), 1):
        try:
            found = axis_alarms(seed, count, draws)
        except BallscrewError as error:
            print(f"axis {seed}: {error}", file=sys.stderr, flush=True)
            continue
        for name, (worn, sound) in found.items():
            rows[name][0].extend(worn)
            rows[name][1].extend(sound)
        command = f"python -m benchmarks.early_drift --axes {number} --histories {count} --draws {draws}"
        lines = table(rows)
        lines[0] = lines[0].replace("method", "drift of the support bearing")
        yield [heading(command), "", *lines]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--axes", type=int, default=12)
    parser.add_argument("--histories", type=int, default=30)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--draws", type=int, default=5000)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    for lines in tables(given.axes, given.first, given.histories, given.draws):
        print("\n".join(lines), end="\n\n", flush=True)
        if given.page is not None:
            write(given.page, "drift", lines)


if __name__ == "__main__":
    main()
