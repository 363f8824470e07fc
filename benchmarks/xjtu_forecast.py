"""Forecast of a real degradation: the last ten readings of a wear test from its first twenty.

    python -m benchmarks.xjtu_forecast [--data FOLDER] [--page PAGE] [--picture PICTURE]

The friction torque of a preloaded ball screw, read every 35 h (BALLSCREW_DATA, its folder xjtu), is all that
is known. The life model treats it as the friction of any axis, with a wear law in travel. The speed was
raised in steps, so travel and time differ; the model in time is listed for comparison, with a straight line
and an exponential, fitted by least squares, and their prediction intervals.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from ballscrew.base.arrays import Array
from ballscrew.prognosis.life_prior import LifePrior, Lives
from ballscrew.prognosis.likelihood import preload_ratio, remaining_on
from ballscrew.prognosis.particle_filter import ParticleFilter
from ballscrew.prognosis.preload_history import preload_history
from benchmarks.forecast_metrics import crps
from benchmarks.identification_tables import write
from benchmarks.machine import heading

FIRST, LAST = 20, 10
UNCERTAINTY = 0.03  # of the reading: standard uncertainty
SHARE = (0.8, 1.0)  # of the torque that is the preload's: the makers' formula gives 0.95 to 1.0 of the first
BANDS = (0.80, 0.95)
ONSET = 1.0  # days: a wear test wears from the first hour on
DRAWS = 4000
SPEEDS = (300.0, 200.0, 140.0)  # r/min at first, more after each so many hours


@dataclass(frozen=True, eq=False)
class Ahead:
    """Samples of the last ten readings, shape (draws, 10)."""

    name: str
    samples: Array


def read(folder: Path) -> tuple[Array, Array]:
    """Hours and torque, N m."""
    table = np.loadtxt(folder / "xjtu" / "friction_torque_upper.csv", delimiter=",", skiprows=1)
    return table[:, 0], table[:, 1]


def turns(hours: Array) -> Array:
    """Revolutions since the begin, in those of a day at the first speed."""
    first, more, every = SPEEDS
    fine = np.arange(0.0, hours[-1] + 1)
    speed = first + more * np.floor(fine[:-1] / every)
    return np.asarray(np.interp(hours, fine, np.concatenate([[0], np.cumsum(speed)])) / first / 24)


def least_squares(name: str, hours: Array, readings: Array, later: Array, *, log: bool) -> Ahead:
    """A line through the readings or their logarithms."""
    y = np.log(readings) if log else readings
    design, new = (np.column_stack([np.ones_like(h), h]) for h in (hours, later))
    beta, rest, *_ = np.linalg.lstsq(design, y, rcond=None)
    freedom = len(y) - 2
    spread = np.sqrt(rest[0] / freedom * (1 + np.sum(new @ np.linalg.inv(design.T @ design) * new, axis=1)))
    chance = student.ppf((np.arange(DRAWS) + 0.5) / DRAWS, freedom)
    samples = new @ beta + spread * chance[:, None]
    return Ahead(name, np.exp(samples) if log else samples)


def by_life(name: str, clock: Array, torque: Array) -> Ahead:
    """The particle filter, on a clock in days."""
    known = preload_history(
        clock[:FIRST], friction=torque[:FIRST], friction_uncertainty=UNCERTAINTY * torque[:FIRST]
    )
    prior = LifePrior(friction_share=SHARE, onset=ONSET)
    model = ParticleFilter(prior, particles=DRAWS, moves=16)
    # Asked for the last day too, the pace's wander is carried on to it; no later reading is known.
    _, lives = next(model.lives(known, [float(clock[FIRST - 1]), float(clock[-1])]))
    expected = torque_of(lives, clock, float(clock[-1]))[:, FIRST:]
    random = np.random.default_rng(7)
    odd = random.standard_t(5, expected.shape) * lives.friction_noise[:, None]
    return Ahead(name, expected + UNCERTAINTY * float(np.median(torque[:FIRST])) * odd)


def torque_of(lives: Lives, clock: Array, span: float) -> Array:
    """Of each life at each time."""
    share = lives.friction_share[:, None]
    ratio = preload_ratio(remaining_on(lives, clock, span))
    rest = (1 - share) * (1 + lives.friction_drift[:, None] * clock / (clock + LifePrior().bearing_days))
    return np.asarray(lives.friction[:, None] * (rest + share * ratio))


def table(models: list[Ahead], truth: Array) -> list[str]:
    """Bands, their widths, and scores."""
    out = [
        "| model | readings in the 80 % band | its width, mN m | in the 95 % band | its width | CRPS, mN m |",
        "|---|---|---|---|---|---|",
    ]
    for model in models:
        cells = [model.name]
        for band in BANDS:
            low, high = np.quantile(model.samples, [(1 - band) / 2, (1 + band) / 2], axis=0)
            cells += [
                f"{int(((truth >= low) & (truth <= high)).sum())} of {len(truth)}",
                f"{1e3 * float(np.mean(high - low)):.0f}",
            ]
        scores = [crps(model.samples[:, k], float(true)) for k, true in enumerate(truth)]
        out.append("| " + " | ".join([*cells, f"{1e3 * float(np.mean(scores)):.2f}"]) + " |")
    return out


def draw(path: Path, hours: Array, torque: Array, models: Mapping[str, Ahead]) -> None:
    """The picture of the page."""
    from ballscrew.report.canvas import blank, save_figure, styled

    with styled():
        figure = blank(9.5, 4.2)
        first, second = figure.subplots(1, 2, sharey=True)
        for axes, name, colour in ((first, "life", "#0072B2"), (second, "line", "#D55E00")):
            model = models[name]
            later = hours[FIRST:]
            for band, alpha in zip(BANDS[::-1], (0.18, 0.3), strict=True):
                low, high = np.quantile(model.samples, [(1 - band) / 2, (1 + band) / 2], axis=0)
                axes.fill_between(
                    later, low, high, color=colour, alpha=alpha, lw=0, label=f"{100 * band:.0f} %"
                )
            axes.plot(later, np.median(model.samples, axis=0), color=colour, label="median")
            axes.plot(hours[:FIRST], torque[:FIRST], "o", ms=4, color="0.2", label="readings used")
            axes.plot(later, torque[FIRST:], "o", ms=5, mfc="white", mec="0.1", label="later readings")
            axes.axvline((hours[FIRST - 1] + hours[FIRST]) / 2, color="0.6", lw=0.8, ls=":")
            axes.set(xlabel="time (h)", title=model.name)
            axes.legend(loc="lower left", ncols=2, fontsize=8)
        first.set_ylabel("friction torque (N m)")
        save_figure(figure, path)


def main(argv: list[str] | None = None) -> int:
    """Forecast, print the table, and draw."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.xjtu_forecast", description=__doc__)
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("BALLSCREW_DATA", "../shared/data")))
    parser.add_argument("--page", type=Path)
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args(argv)
    try:
        hours, torque = read(given.data)
    except OSError as error:
        print(f"{given.data}: cannot be read ({error}); set BALLSCREW_DATA.", file=sys.stderr)
        return 2
    later, truth = hours[FIRST:], torque[FIRST:]
    models = {
        "life": by_life("particle filter, by revolutions", turns(hours), torque),
        "hours": by_life("particle filter, by hours", hours / 24, torque),
        "line": least_squares("straight line", hours[:FIRST], torque[:FIRST], later, log=False),
        "log": least_squares("exponential", hours[:FIRST], torque[:FIRST], later, log=True),
    }
    halves = [models[name].samples[::2] for name in ("life", "hours")]
    models["both"] = Ahead("both of them, evenly (thought of afterwards)", np.concatenate(halves))
    order = [models[name] for name in ("life", "hours", "both", "line", "log")]
    lines = table(order, truth)
    print("\n".join(lines))
    if given.page:
        text: Any = [heading("python -m benchmarks.xjtu_forecast"), "", *lines]
        write(given.page, "xjtu", text)
    if given.picture:
        draw(given.picture, hours, torque, models)
    return 0


if __name__ == "__main__":
    sys.exit(main())
