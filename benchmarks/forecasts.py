"""Forecasts of histories that no prior made: six shapes of preload, of friction torque, and a wear test.

    python -m benchmarks.forecasts [--show preload torque xjtu] [--first 0] [--workers 1] [--page PAGE]
                                   [--data FOLDER] [--picture PICTURE]

- preload: 300 histories, a run every 1, 3 or 7 days, each forecast four times from the alarm to half of the
  preload.
- torque: 200 surrogate screws, the last ten of thirty readings forecast from the first twenty, by the average
  and by each of its families alone.
- xjtu: the measured friction torque of a screw in a wear test, from 15, 20 and 25 of its thirty readings.

Seeds are from 0 on (``--first``); what was chosen by looking at histories was chosen on seeds from 10 000 on.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from ballscrew.base.arrays import Array
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.families import FAMILIES, Family, FamilyPrior
from ballscrew.prognosis.family_average import FamilyAverage
from ballscrew.prognosis.preload_history import PreloadHistory, preload_history
from benchmarks.forecast_metrics import coverage, crps, pit
from benchmarks.forecast_shapes import SHAPES, preload_life, torque_series
from benchmarks.identification_tables import write
from benchmarks.machine import heading

HISTORIES, SCREWS = 300, 200
EVERY = (1.0, 3.0, 7.0)  # days
WAY = (0.0, 0.25, 0.5, 0.75)  # from the alarm to half of the preload
LIMIT = 1000.0  # days: from there on every forecast is "long"
KNOWN = 20  # readings of a surrogate
PARTS = (15, 20, 25)  # readings of the wear test
UNCERTAINTY = 0.03  # of a reading of the torque: standard uncertainty
BAND = 0.8
DRAWS = 4000
SPEEDS = (300.0, 200.0, 140.0)  # r/min at first, more after each so many hours
AVERAGE = "average over families"


@dataclass(frozen=True, slots=True)
class Scored:
    """A forecast of the day of half of the preload: days remaining, PIT, CRPS, and median over true."""

    shape: str
    transform: float
    score: float
    median: float


def preload_scores(job: tuple[str, float, int]) -> list[Scored]:
    """Forecasts of one history on its way from the alarm to half of the preload."""
    shape, every, seed = job
    lived = preload_life(shape, every, seed)
    scores = []
    for part in WAY:
        known = lived.history.days[lived.history.days <= lived.alarm + part * (lived.end - lived.alarm)]
        day = float(known[-1])
        forecast = FamilyAverage().forecast(lived.history, Failure(), at=day)
        true = lived.end - day
        median = min(float(forecast.quantile(0.5)), LIMIT) / true
        lives = forecast.rul_days
        scores.append(Scored(shape, pit(lives, true), crps(lives, true, LIMIT), median))
    return scores


def preload_table(rows: Sequence[Scored]) -> list[str]:
    """Coverage on either side, and scores, of each shape."""
    out = [
        (
            "| preload falls | forecasts | in the 90 % interval | earlier than it | later than it "
            "| median over true | CRPS, days |"
        ),
        "|---|---|---|---|---|---|---|",
    ]
    for shape in SHAPES:
        some = [row for row in rows if row.shape == shape]
        transforms = np.array([row.transform for row in some])
        cells = [
            shape,
            f"{len(some)}",
            f"{100 * coverage(transforms, 0.9):.0f} %",
            f"{100 * float(np.mean(transforms < 0.05)):.0f} %",
            f"{100 * float(np.mean(transforms > 0.95)):.0f} %",
            f"{float(np.median([row.median for row in some])):.2f}",
            f"{float(np.mean([row.score for row in some])):.1f}",
        ]
        out.append("| " + " | ".join(cells) + " |")
    return out


def friction(days: Array, torque: Array) -> PreloadHistory:
    """History of a friction torque."""
    return preload_history(days, friction=torque, friction_uncertainty=UNCERTAINTY * torque)


def torque_scores(job: tuple[str, int], scatter: Array) -> dict[str, tuple[float, float]]:
    """CRPS, mN m, and coverage of the 80 % band, by the average and by each family alone."""
    shape, seed = job
    hours, torque = torque_series(shape, seed, scatter)
    known = friction(hours[:KNOWN] / 24, torque[:KNOWN])
    models = {AVERAGE: FamilyAverage()}
    steady = FamilyPrior(hazard=0.0)
    models |= {family.name: FamilyAverage(families=(family,), prior=steady) for family in applicable()}
    result = {}
    for name, model in models.items():
        samples = model.friction_ahead(known, hours[KNOWN:] / 24)
        result[name] = band_and_score(samples, torque[KNOWN:])
    return result


def applicable() -> list[Family]:
    """Families by time: the duty of the surrogates is even."""
    return [family for family in FAMILIES if not (family.by_travel or family.by_hours)]


def band_and_score(samples: Array, truth: Array) -> tuple[float, float]:
    """CRPS, mN m, and part of the readings in the 80 % band."""
    scores = [crps(samples[:, k], float(true)) for k, true in enumerate(truth)]
    low, high = np.quantile(samples, [(1 - BAND) / 2, (1 + BAND) / 2], axis=0)
    return 1e3 * float(np.mean(scores)), float(np.mean((truth >= low) & (truth <= high)))


def torque_table(rows: Sequence[tuple[str, dict[str, tuple[float, float]]]]) -> list[str]:
    """The average beside the family that turns out best, of each shape."""
    out = [
        (
            "| torque falls | screws | CRPS of the average, mN m | best family, known afterwards | its CRPS "
            "| ratio | readings in the 80 % band |"
        ),
        "|---|---|---|---|---|---|---|",
    ]
    for shape in SHAPES:
        some = [scores for name, scores in rows if name == shape]
        if not some:
            continue
        mean = {name: float(np.mean([scores[name][0] for scores in some])) for name in some[0]}
        covered = float(np.mean([scores[AVERAGE][1] for scores in some]))
        ours = mean.pop(AVERAGE)
        best = min(mean, key=lambda name: mean[name])
        cells = [shape, f"{len(some)}", f"{ours:.2f}", best, f"{mean[best]:.2f}"]
        cells += [f"{ours / mean[best]:.2f}", f"{100 * covered:.0f} %"]
        out.append("| " + " | ".join(cells) + " |")
    return out


def read(folder: Path) -> tuple[Array, Array]:
    """Hours and torque of the wear test, N m."""
    table = np.loadtxt(folder / "xjtu" / "friction_torque_upper.csv", delimiter=",", skiprows=1)
    return table[:, 0], table[:, 1]


def relative_scatter(hours: Array, torque: Array) -> Array:
    """Relative residuals of the readings from a parabola, of as much variance as the scatter itself."""
    expected = np.polyval(np.polyfit(hours, torque, 2), hours)
    return np.asarray((torque / expected - 1) * np.sqrt(len(hours) / (len(hours) - 3)))


def turns(days: Array) -> Array:
    """Revolutions of the wear test up to some days, in those of a day at its first speed."""
    first, more, every = SPEEDS
    hours = np.arange(0.0, 24 * float(np.max(days)) + 1)
    speed = first + more * np.floor(hours / every)
    done = np.concatenate([[0], np.cumsum(speed)[:-1]])
    return np.asarray(np.interp(24 * days, hours, done) / first / 24)


def least_squares(hours: Array, readings: Array, later: Array, *, log: bool) -> Array:
    """Samples by a line through the readings or their logarithms."""
    y = np.log(readings) if log else readings
    design, new = (np.column_stack([np.ones_like(h), h]) for h in (hours, later))
    beta, rest, *_ = np.linalg.lstsq(design, y, rcond=None)
    freedom = len(y) - 2
    spread = np.sqrt(rest[0] / freedom * (1 + np.sum(new @ np.linalg.inv(design.T @ design) * new, axis=1)))
    chance = student.ppf((np.arange(DRAWS) + 0.5) / DRAWS, freedom)
    samples = new @ beta + spread * chance[:, None]
    return np.asarray(np.exp(samples) if log else samples)


def wear_test(hours: Array, torque: Array, known: int) -> Mapping[str, Array]:
    """Samples of the later readings of the wear test, by model."""
    history, later = friction(hours[:known] / 24, torque[:known]), hours[known:] / 24
    line = partial(least_squares, hours[:known], torque[:known], hours[known:])
    return {
        "average, by time and revolutions": FamilyAverage(travel=turns).friction_ahead(history, later),
        "average, by time": FamilyAverage().friction_ahead(history, later),
        "straight line": line(log=False),
        "exponential": line(log=True),
    }


def wear_test_table(hours: Array, torque: Array) -> list[str]:
    """Readings in the band, and scores."""
    out = ["| from | model | later readings in the 80 % band | CRPS, mN m |", "|---|---|---|---|"]
    for known in PARTS:
        for name, samples in wear_test(hours, torque, known).items():
            score, covered = band_and_score(samples, torque[known:])
            count = len(torque) - known
            out.append(f"| {known} | {name} | {round(covered * count)} of {count} | {score:.2f} |")
    return out


def draw(path: Path, hours: Array, torque: Array) -> None:
    """Draw the wear test with its forecast by the average and by a straight line."""
    from ballscrew.report.canvas import blank, save_figure, styled

    models = wear_test(hours, torque, KNOWN)
    with styled():
        figure = blank(9.5, 4.2)
        panels = figure.subplots(1, 2, sharey=True)
        shown = (("average, by time and revolutions", "#0072B2"), ("straight line", "#D55E00"))
        for axes, (name, colour) in zip(panels, shown, strict=True):
            for band, alpha in ((0.95, 0.18), (0.80, 0.3)):
                low, high = np.quantile(models[name], [(1 - band) / 2, (1 + band) / 2], axis=0)
                label = f"{100 * band:.0f} %"
                axes.fill_between(hours[KNOWN:], low, high, color=colour, alpha=alpha, lw=0, label=label)
            axes.plot(hours[KNOWN:], np.median(models[name], axis=0), color=colour, label="median")
            axes.plot(hours[:KNOWN], torque[:KNOWN], "o", ms=4, color="0.2", label="readings used")
            axes.plot(
                hours[KNOWN:], torque[KNOWN:], "o", ms=5, mfc="white", mec="0.1", label="later readings"
            )
            axes.set(xlabel="time (h)", title=name)
            axes.legend(loc="lower left", ncols=2, fontsize=8)
        panels[0].set_ylabel("friction torque (N m)")
        save_figure(figure, path)


def main(argv: list[str] | None = None) -> int:
    """Forecast, and print the tables."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.forecasts",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("BALLSCREW_DATA", "../shared/data")))
    parser.add_argument("--show", nargs="*", default=["preload", "torque", "xjtu"])
    parser.add_argument("--histories", type=int, default=HISTORIES)
    parser.add_argument("--screws", type=int, default=SCREWS)
    parser.add_argument("--first", type=int, default=0, help="seed of the first history")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args(argv)
    try:
        hours, torque = read(given.data)
    except OSError as error:
        print(f"{given.data}: cannot be read ({error}); set BALLSCREW_DATA.", file=sys.stderr)
        return 2
    head = [heading("python -m benchmarks.forecasts"), ""]
    tables: dict[str, list[str]] = {}
    with ProcessPoolExecutor(given.workers) as pool:
        if "preload" in given.show:
            shapes, every = cycle(SHAPES), cycle(np.repeat(EVERY, len(SHAPES)).tolist())
            seeds = range(given.first, given.first + given.histories)
            jobs = list(zip(shapes, every, seeds, strict=False))
            rows = [row for scores in pool.map(preload_scores, jobs) for row in scores]
            tables["preload shapes"] = preload_table(rows)
        if "torque" in given.show:
            some = list(zip(cycle(SHAPES), range(given.first, given.first + given.screws), strict=False))
            found = pool.map(partial(torque_scores, scatter=relative_scatter(hours, torque)), some)
            tables["torque shapes"] = torque_table([(job[0], r) for job, r in zip(some, found, strict=True)])
    if "xjtu" in given.show:
        tables["xjtu"] = wear_test_table(hours, torque)
    for name, lines in tables.items():
        print("\n".join(lines), end="\n\n")
        if given.page:
            write(given.page, name, [*head, *lines])
    if given.picture:
        draw(given.picture, hours, torque)
    return 0


if __name__ == "__main__":
    sys.exit(main())
