"""How early wear is found, and at what rate of false alarms, on axes whose truth is known.

    python -m benchmarks.early [--lives 200] [--jobs 2] [--check 10] [--first 0] [--draws N] [--page PAGE]

200 simulated lives and 200 healthy axes with the same disturbances, a run a day, and again the same day where
that is asked for (played visit by visit, at the limits of the axis' own days); the same lives with
baselines of 3, 5 and 10 runs; the cadence of the paper; a nut that is replaced in the middle; and common
features, with three standard deviations of five runs, two in a row. --page writes the tables into a page.
Settings were chosen on axes from 100 000 on (--first), the tables are made of axes from 0 on.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import BallscrewError
from ballscrew.monitoring.detection.chart import chart_of, relative_loss
from ballscrew.monitoring.detection.design import LevelStep, design_of
from ballscrew.monitoring.detection.limits import compute_limits
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.statistics import statistics
from ballscrew.monitoring.epochs import Event
from ballscrew.monitoring.health import health_state
from benchmarks.early_axes import Course, Curve, Life, course, curve, draw_life, levels, of_day, repeats
from benchmarks.early_signatures import SIGNATURES, signature, three_sigma
from benchmarks.early_tables import Alarm, baseline_table, check_table, paper_table, replaced_table, table
from benchmarks.identification_tables import write
from benchmarks.machine import heading

Row = TypeVar("Row")
BASELINES = (3, 5, 10)
DRAWS = MonitorSettings().draws
YEAR = 365.0
FUSED = "this detection"
REPEATED = {
    "as it is asked for, a run a day, never again": None,
    "a run a day, and again the same day when asked": 0.0,
    "the same, half of the odd runs odd by the same again": 0.5,
}
NAIVE = "its level, 3σ of five runs, two in a row"
FOLLOWED = 0.45  # of the preload: a life is followed down to here


@dataclass(frozen=True, slots=True)
class AxisResult:
    """First alarm of an axis by method and number of baseline runs."""

    seed: int
    alarms: dict[str, Alarm]


def first_alarm(states: Sequence[str]) -> int | None:
    """Which run alarms first."""
    return states.index("alarm") if "alarm" in states else None


def first_alarm_of(of: Curve, level: Array, when: Course, settings: MonitorSettings) -> int | None:
    """The first alarm of a chart."""
    steps, uncertainty = (LevelStep(when.remount, settings.remounted),), np.full(len(level), of.uncertainty)
    drift = of.bearing * settings.assumptions.bearing_daily_spread
    return first_alarm(chart_of(when.days, level, uncertainty, when.read, steps, settings, drift).states)


def played(
    of: Curve, level: Array, again: Array, when: Course, settings: MonitorSettings
) -> list[tuple[int | None, int]]:
    """The first alarm, and the repeats by then, where the test is run again on the days when it is asked for.

    Limits depend on the days of the visits and not on the repeats: they are the same for every way of
    repeating, (w, n).
    """
    days = when.days
    lost, lost_uncertainty = relative_loss(level, np.full(len(days), of.uncertainty))
    steps = (LevelStep(when.remount, settings.remounted),)
    drift = of.bearing * settings.assumptions.bearing_daily_spread
    design = design_of(days, lost_uncertainty, when.read, steps, settings, drift)
    known = compute_limits(design)
    many = np.repeat(lost[:, None], len(again), axis=1)
    other = 1 - 1 / (1 + np.maximum(again.T, -0.5))
    found = statistics(design, many, other, lambda k, _: float(known.repeat[k]))
    alarm = known.alarms(found)
    result: list[tuple[int | None, int]] = []
    for row, made in zip(alarm.T, found.repeated.T, strict=True):
        k = int(np.argmax(row)) if row.any() else None
        result.append((k, int(made[: None if k is None else k + 1].sum())))
    return result


def _alarms(
    of: Curve, life: Life, when: Course, ratio: Array, onset: float, stream: int, draws: int
) -> dict[str, Alarm]:
    level = levels(of, life, when, ratio, stream)

    def alarm(k: int | None, again: int = 0) -> Alarm:
        lost = float("nan") if k is None else 1 - float(ratio[k])
        day = None if k is None else float(when.days[k])
        return Alarm(day, k, lost, onset, float(when.days[-1]), again)

    found = {
        f"{FUSED}, {count}": alarm(
            first_alarm_of(
                of,
                level,
                when,
                MonitorSettings(baseline_runs=count, repeats_per_year=0, draws=draws),
            )
        )
        for count in BASELINES
    }
    none = np.full(len(level), np.nan)
    again = np.array(
        [none if odd is None else repeats(of, life, when, ratio, stream, odd) for odd in REPEATED.values()]
    )
    ways = played(of, level, again, when, MonitorSettings(draws=draws))
    found |= {name: alarm(*way) for name, way in zip(REPEATED, ways, strict=True)}
    found[NAIVE] = alarm(three_sigma(level, 5))
    random = np.random.default_rng([of.seed, stream, 0x516])
    for name, feature in SIGNATURES.items():
        values = signature(feature, of, ratio, when.temperature, random)
        found[name] = alarm(three_sigma(values, 5, feature.sign))
    return found


def axis_at_work(seed: int, draws: int = DRAWS) -> tuple[AxisResult, AxisResult, AxisResult]:
    """One axis: its life, a healthy year, and its life at the paper's cadence."""
    of = curve(seed)[0]
    return worn(of, draws), healthy(of, draws), paper(of, draws)


def worn(of: Curve, draws: int = DRAWS) -> AxisResult:
    """One life."""
    seed, life = of.seed, draw_life(of.seed)
    when = course(seed, life.onset + life.days)
    ratio = of_day(life, when.days)
    last = max(int(np.searchsorted(-ratio, -FOLLOWED)) + 1, 12)
    when = cut(when, last)
    return AxisResult(seed, _alarms(of, life, when, ratio[:last], life.onset, 1, draws))


def healthy(of: Curve, draws: int = DRAWS) -> AxisResult:
    """One axis that does not wear, for a year."""
    seed, life = of.seed, draw_life(of.seed)
    when = course(seed + 7_000_000, YEAR)
    return AxisResult(seed, _alarms(of, life, when, np.ones_like(when.days), float("inf"), 2, draws))


def paper(of: Curve, draws: int = DRAWS) -> AxisResult:
    """27 runs in 80 days, worn from the first day on, learnt from three."""
    seed, life = of.seed, draw_life(of.seed)
    life = replace(life, onset=0.0, days=80.0, law="contact-pressure")
    when = course(seed + 3_000_000, 79.0, 3.0)
    when = replace(when, remount=-1.0, step=0.0)
    ratio = of_day(life, when.days)
    level = levels(of, life, when, ratio, 3)
    k = first_alarm_of(of, level, when, MonitorSettings(baseline_runs=3, draws=draws))
    lost = float("nan") if k is None else 1 - float(ratio[k])
    day = None if k is None else float(when.days[k])
    return AxisResult(seed, {FUSED: Alarm(day, k, lost, 0.0, 79.0)})


def whole(seed: int) -> AxisResult:
    """One life by both ways: from mode tables on, and at the level of levels."""
    of, axis, model = curve(seed)
    life = replace(draw_life(seed), scatter=1.0)
    when = course(seed, life.onset + life.days)
    ratio = of_day(life, when.days)
    last = min(max(int(np.searchsorted(-ratio, -0.7)) + 1, 12), len(ratio))
    when, ratio = replace(cut(when, last), remount=-1.0, step=0.0), ratio[:last]
    runs = [
        replace(
            axis.measured(3000 + k, float(r * np.exp(life.warm * t)), day=float(d)),
            temperature_C=20 + float(w),
        )
        for k, (d, r, t, w) in enumerate(zip(when.days, ratio, when.temperature, when.read, strict=True))
    ]
    found = {}
    names = [run.state for run in health_state(runs, model).runs]
    direct = first_alarm_of(of, levels(of, life, when, ratio, 4), when, MonitorSettings())
    for name, k in (
        ("mode tables", first_alarm(names)),
        ("levels", direct),
    ):
        lost = float("nan") if k is None else 1 - float(ratio[k])
        day = None if k is None else float(when.days[k])
        found[name] = Alarm(day, k, lost, life.onset, float(when.days[-1]))
    return AxisResult(seed, found)


def replaced(seed: int) -> AxisResult:
    """A life, a new nut when a third is lost, and thirty healthy days: the alarms of both epochs."""
    _, axis, model = curve(seed)
    life = draw_life(seed)
    when = course(seed, life.onset + life.days)
    ratio = of_day(life, when.days)
    last = int(np.searchsorted(-ratio, -0.67)) + 1
    days = np.concatenate([when.days[:last], when.days[last - 1] + 1 + np.arange(30.0)])
    preload = np.concatenate([ratio[:last], np.full(30, life.tight)])
    runs = [
        axis.measured(6000 + k, float(r), day=float(d))
        for k, (d, r) in enumerate(zip(days, preload, strict=True))
    ]
    new = Event(runs[last].measured_at or "", "nut replaced")
    found = health_state(runs, model, events=(new,))
    alarms = {}
    for number, epoch in enumerate(found.epochs):
        k = first_alarm([r.state if r.reading.epoch == number else "" for r in found.runs])
        day = None if k is None else float(days[k])
        lost = float("nan") if k is None else 1 - float(preload[k])
        alarms[f"epoch {number}"] = Alarm(
            day, k, lost, life.onset if number == 0 else float("inf"), float(len(found.runs))
        )
        assert (epoch.alarm_at is None) == (k is None)
    return AxisResult(seed, alarms)


def cut(when: Course, last: int) -> Course:
    """The first runs of a course."""
    return replace(when, days=when.days[:last], temperature=when.temperature[:last], read=when.read[:last])


def _tried(simulate: Callable[[int], Row], seed: int) -> Row | str:
    try:
        return simulate(seed)
    except BallscrewError as error:
        return f"axis {seed}: {error}"


def each(name: str, simulate: Callable[[int], Row], seeds: range, jobs: int) -> list[Row]:
    """All of them, in their order."""
    if jobs > 1:
        with ProcessPoolExecutor(jobs) as pool:
            found = list(pool.map(partial(_tried, simulate), seeds, chunksize=2))
    else:
        found = [_tried(simulate, seed) for seed in seeds]
    for row in found:
        if isinstance(row, str):
            print(f"{name}, {row}", file=sys.stderr, flush=True)
    rows: list[Row] = [row for row in found if not isinstance(row, str)]
    print(f"{name}: {len(rows)} of {len(seeds)}", file=sys.stderr, flush=True)
    return rows


def tables(
    lives: int, few: int, first: int, jobs: int, show: Sequence[str], draws: int = DRAWS
) -> Iterator[tuple[str, list[str]]]:
    """Each as soon as it is made."""
    fewer = "" if draws == DRAWS else f" --draws {draws}"
    head = [heading(f"python -m benchmarks.early --lives {lives} --check {few}{fewer}"), ""]
    seeds = range(first, first + lives)
    if "lives" in show:
        rows = each("axes", partial(axis_at_work, draws=draws), seeds, jobs)
        ends, sound, cadence = ([row[k] for row in rows] for k in range(3))
        names = {name: name for name in (*REPEATED, NAIVE, *SIGNATURES)}
        names = {FUSED: f"{FUSED}, {BASELINES[-1]}"} | names
        by = {of: ([r.alarms[k] for r in ends], [r.alarms[k] for r in sound]) for of, k in names.items()}
        yield "lives", [*head, *table(by)]
        counts = {n: f"{FUSED}, {n}" for n in BASELINES}
        by_count = {n: ([r.alarms[k] for r in ends], [r.alarms[k] for r in sound]) for n, k in counts.items()}
        yield "baselines", baseline_table(by_count)
        yield "cadence", paper_table([r.alarms[FUSED] for r in cadence])
    if few and "check" in show:
        both = each("check", whole, range(first, first + few), jobs)
        yield "check", [*head, *check_table([r.alarms for r in both])]
        nuts = each("replaced", replaced, range(first, first + few), jobs)
        yield "replaced", replaced_table([r.alarms for r in nuts])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--lives", type=int, default=200)
    parser.add_argument("--check", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--show", nargs="*", default=["lives", "check"])
    parser.add_argument("--draws", type=int, default=DRAWS, help="healthy histories for limits")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    for name, lines in tables(
        given.lives, given.check, given.first, min(given.jobs, 2), given.show, given.draws
    ):
        print("\n".join(lines), end="\n\n", flush=True)
        if given.page is not None:
            write(given.page, name, lines)


if __name__ == "__main__":
    main()
