"""The remaining life of simulated lives: coverage of its intervals, and scores beside references.

    python -m benchmarks.remaining_life [--lives 200] [--show half way others rubs] [--workers 1]
                                        [--page PAGE] [--picture PICTURE]

- half: forecasts at half of each life, and their scores.
- way: forecasts from a fifth to nine tenths of each life; horizon, α–λ, score.
- others: half of the way to a quarter of the preload, and of axes that are worn out in 80 to 300 days.
- rubs: precise runs.

The lives are those of :mod:`benchmarks.simulated_lives`, seeds from 0 on. What was chosen by looking at lives
was chosen on seeds from 10 000 on.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ballscrew.prognosis.exponential import ExponentialFilter
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.family_average import FamilyAverage
from ballscrew.prognosis.forecast import Forecast, LifeModel
from ballscrew.prognosis.wiener import WienerProcess
from benchmarks.forecast_metrics import (
    asymmetric_score,
    coverage,
    crps,
    mass_within,
    meets_alpha_lambda,
    pit,
    relative_accuracy,
    uniformity,
)
from benchmarks.identification_tables import write
from benchmarks.machine import heading
from benchmarks.simulated_lives import Lived, live
from benchmarks.wiener_since_onset import WienerSinceOnset

MODELS: dict[str, LifeModel] = {
    "average over families": FamilyAverage(),
    "Wiener process": WienerProcess(),
    "exponential, particle filter": ExponentialFilter(),
    "Wiener since the wear's onset": WienerSinceOnset(),
}
OURS, WIENER, *_ = MODELS
FAILURE = 0.5
WAY = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
LIMIT = 1000.0  # days: from there on every forecast is "long"
ALPHA_HORIZON, ALPHA = 0.1, 0.2
LEVELS = (0.5, 0.8, 0.9, 0.95)
WORN_OUT = 0.05  # of the preload
EXAMPLE = 4  # the life of the picture


@dataclass(frozen=True, slots=True)
class Scored:
    """One forecast beside the truth.

    Parameters
    ----------
    part : float
        λ, of the life.
    remaining : float
        True remaining life, days.
    end : float
        The whole life, days.
    median : float
        Forecast, days.
    transform, score, late : float
        PIT, CRPS in days, and the score of PHM 2008.
    in_cone, in_band : bool
        α–λ accuracy, and the criterion of the horizon.
    width : float
        Of the 90 % interval, days; infinite where open.
    """

    part: float
    remaining: float
    end: float
    median: float
    transform: float
    score: float
    late: float
    in_cone: bool
    in_band: bool
    width: float


def scored(forecast: Forecast, lived: Lived, day: float) -> Scored:
    """Score of a forecast."""
    remaining = lived.end - day
    low, middle, high = forecast.quantile([0.05, 0.5, 0.95]).tolist()
    near = ALPHA_HORIZON * lived.end
    return Scored(
        day / lived.end,
        remaining,
        lived.end,
        middle,
        pit(forecast.rul_days, remaining),
        crps(forecast.rul_days, remaining, LIMIT),
        asymmetric_score(middle, remaining),
        meets_alpha_lambda(forecast.rul_days, remaining, ALPHA),
        mass_within(forecast.rul_days, remaining - near, remaining + near) >= 0.5,
        high - low if math.isfinite(high) else math.inf,
    )


def at_half(
    seed: int,
    failure: float = FAILURE,
    worn_out: float | None = None,
    sharp: bool = False,
) -> dict[str, Scored]:
    """Half of the life; where the axis is followed until worn out, half of the way from its first wear."""
    lived = live(seed, failure, worn_out, sharp=sharp)
    day = lived.end / 2 if worn_out is None else (lived.onset + lived.end) / 2
    return {
        name: scored(model.forecast(lived.history, Failure(failure), at=day), lived, day)
        for name, model in MODELS.items()
    }


def on_the_way(seed: int) -> dict[str, list[Scored]]:
    """From a fifth to nine tenths of the life."""
    lived = live(seed, FAILURE)
    days = [part * lived.end for part in WAY]
    out: dict[str, list[Scored]] = {}
    for name, model in MODELS.items():
        forecasts = (model.forecast(lived.history, Failure(FAILURE), at=day) for day in days)
        out[name] = [scored(forecast, lived, day) for forecast, day in zip(forecasts, days, strict=True)]
    return out


def half_table(groups: Mapping[str, Sequence[dict[str, Scored]]]) -> list[str]:
    """Coverage, sharpness and score."""
    out = [
        (
            "| lives | model | 50 % | 80 % | **90 %** | 95 % | width of 90 %, of the remaining life | "
            "median over true | CRPS, days | less than Wiener | PIT's distance (limit) |"
        ),
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for words, rows in groups.items():
        other = float(np.mean([row[WIENER].score for row in rows]))
        for name in MODELS:
            some = [row[name] for row in rows]
            transforms = [each.transform for each in some]
            covered = [f"{100 * coverage(transforms, level):.0f} %" for level in LEVELS]
            wide = float(np.median([each.width / each.remaining for each in some]))
            score = float(np.mean([each.score for each in some]))
            cells = [
                f"{len(rows)}, {words}",
                name,
                *covered,
                f"{wide:.2f}" if math.isfinite(wide) else "open",
                f"{float(np.median([each.median / each.remaining for each in some])):.2f}",
                f"{score:.1f}",
                "–" if name == WIENER else f"{100 * (1 - score / other):.0f} %" if score < other else "more",
                f"{uniformity(transforms):.2f} ({1.36 / math.sqrt(len(rows)):.2f})",
            ]
            out.append("| " + " | ".join(cells) + " |")
    return out


def horizon(rows: Sequence[Scored]) -> float:
    """Of one life, as a part of it: how long before the end the criterion is met and stays met."""
    found = 0.0
    for score in reversed(rows):
        if not score.in_band:
            break
        found = 1 - score.part
    return found


def way_table(rows: Sequence[dict[str, list[Scored]]]) -> list[str]:
    """Horizon, cone and scores of the whole way."""
    out = [
        (
            "| model | horizon, of the life: median | mean | days, mean | α–λ at 0.5 | at 0.8 | "
            "relative accuracy at 0.5 | at 0.8 | late/early score at 0.8, median | CRPS over the life, days |"
            " coverage of the 90 % interval, from 0.2 to 0.9 |"
        ),
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    middle, late = WAY.index(0.5), WAY.index(0.8)
    for name in MODELS:
        lives = [row[name] for row in rows]
        parts = [horizon(life) for life in lives]
        days = [part * life[0].end for part, life in zip(parts, lives, strict=True)]
        cells = [
            name,
            f"{float(np.median(parts)):.2f}",
            f"{float(np.mean(parts)):.2f}",
            f"{np.mean(days):.0f}",
        ]
        cells += [f"{100 * float(np.mean([row[k].in_cone for row in lives])):.0f} %" for k in (middle, late)]
        for k in (middle, late):
            right = [relative_accuracy(min(life[k].median, LIMIT), life[k].remaining) for life in lives]
            cells.append(f"{float(np.median(right)):.2f}")
        cells.append(f"{float(np.median([life[late].late for life in lives])):.2f}")
        cells.append(f"{float(np.mean([[s.score for s in life] for life in lives])):.1f}")
        covered = [100 * coverage([life[k].transform for life in lives], 0.9) for k in range(len(WAY))]
        cells.append(f"{min(covered):.0f} to {max(covered):.0f} %")
        out.append("| " + " | ".join(cells) + " |")
    return out


def draw(path: Path, half: Sequence[dict[str, Scored]], way: Sequence[dict[str, list[Scored]]]) -> None:
    """Calibration, the way, and one life."""
    from ballscrew.report.canvas import blank, save_figure, styled

    colours = dict(zip(MODELS, ("#0072B2", "#D55E00", "#009E73", "#CC79A7"), strict=True))
    with styled():
        figure = blank(11.0, 6.8)
        axes = figure.subplots(2, 2)
        bins = np.linspace(0, 1, 11)
        for k, name in enumerate(MODELS):
            share = np.histogram([row[name].transform for row in half], bins)[0] / len(half)
            axes[0, 0].bar(bins[:-1] + 0.022 * k + 0.02, share, 0.02, color=colours[name], label=name)
            nominal = np.linspace(0.02, 0.98, 49)
            covered = [coverage([row[name].transform for row in half], level) for level in nominal]
            axes[0, 1].plot(nominal, covered, color=colours[name], label=name)
            if way:
                part = [np.mean([row[name][i].score for row in way]) for i in range(len(WAY))]
                axes[1, 0].semilogy(WAY, part, "o-", ms=4, color=colours[name], label=name)
        axes[0, 0].axhline(0.1, color="0.4", lw=0.8, ls=":")
        axes[0, 0].set(
            xlabel="probability integral transform of the true end",
            ylabel="fraction of lives",
            title="Histogram of the PIT (ideal: uniform)",
        )
        axes[0, 0].legend(fontsize=8)
        axes[0, 1].plot([0, 1], [0, 1], color="0.4", lw=0.8, ls=":")
        axes[0, 1].set(
            xlabel="nominal level of the interval",
            ylabel="fraction of lives covered",
            title="Coverage at mid-life",
        )
        axes[1, 0].set(xlabel="fraction of life elapsed", ylabel="CRPS (days)", title="Error during life")
        _example(axes[1, 1], colours[OURS])
        save_figure(figure, path)


def _example(axes, colour: str) -> None:  # type: ignore[no-untyped-def]  # matplotlib's own types
    from ballscrew.prognosis.forecast import FAN

    lived = live(EXAMPLE, FAILURE)
    half = lived.end / 2
    forecast = MODELS[OURS].forecast(lived.history, Failure(FAILURE), at=half)
    ratio = 100 * (1 + lived.history.level) ** -3.0
    before = lived.history.days <= half
    axes.plot(lived.history.days[before], ratio[before], ".", ms=3, color="0.3", label="runs to mid-life")
    axes.plot(lived.history.days[~before], ratio[~before], ".", ms=3, color="0.75", label="later runs")
    for low, high, alpha in ((0.05, 0.95, 0.18), (0.25, 0.75, 0.3)):
        band = 100 * forecast.ratio[:, [FAN.index(low), FAN.index(high)]]
        label = f"{100 * (high - low):.0f} %"
        axes.fill_between(
            half + forecast.days, band[:, 0], band[:, 1], color=colour, alpha=alpha, lw=0, label=label
        )
    axes.plot(half + forecast.days, 100 * forecast.ratio[:, FAN.index(0.5)], color=colour)
    axes.axhline(100 * FAILURE, color="0.3", lw=0.8, ls="--")
    axes.axvline(lived.end, color="0.3", lw=0.8, ls=":")
    axes.annotate("true end", (lived.end, 103), ha="right", color="0.3", fontsize=8)
    axes.set(
        xlabel="time (days)",
        ylabel="preload (% of the new nut's)",
        title="Forecast of one life at mid-life",
        ylim=(20, 110),
    )
    axes.legend(fontsize=8, loc="lower left")


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.remaining_life",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--lives", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="seed of the first life")
    parser.add_argument("--show", nargs="*", default=["half", "way", "others", "rubs"])
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args(arguments)
    seeds = range(given.first, given.first + given.lives)
    few = range(given.first, given.first + max(given.lives // 5, 1))
    head = [heading(f"python -m benchmarks.remaining_life --lives {given.lives}"), ""]
    out: dict[str, list[str]] = {}
    with ProcessPoolExecutor(given.workers) as pool:
        half = list(pool.map(at_half, seeds)) if "half" in given.show else []
        if half:
            out["half"] = [*head, *half_table({"half of the life": half})]
            print("\n".join(out["half"]), end="\n\n", flush=True)
        way = list(pool.map(on_the_way, seeds)) if "way" in given.show else []
        if way:
            out["way"] = [*head, *way_table(way)]
            print("\n".join(out["way"]), end="\n\n", flush=True)
        if "rubs" in given.show:
            sharp = list(pool.map(partial(at_half, sharp=True), few))
            out["rubs"] = [*head, *half_table({"sharp": sharp})]
            print("\n".join(out["rubs"]), end="\n\n", flush=True)
        if "others" in given.show:
            quarter = list(pool.map(partial(at_half, failure=0.25), few))
            worn = list(pool.map(partial(at_half, worn_out=WORN_OUT), few))
            groups = {"failed at a quarter of the preload": quarter, "worn out in 80 to 300 days": worn}
            out["others"] = [*head, *half_table(groups)]
            print("\n".join(out["others"]), end="\n\n", flush=True)
    for name, lines in out.items():
        if given.page is not None:
            write(given.page, name, lines)
    if given.picture is not None and half:
        draw(given.picture, half, way)
    return 0


if __name__ == "__main__":
    sys.exit(main())
