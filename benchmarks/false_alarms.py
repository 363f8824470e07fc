"""False alarms of healthy axes of the detection's own model, for histories unlike those that it learnt from.

    python -m benchmarks.false_alarms [--histories 3000] [--page PAGE]

Limits are computed from the first visits of an epoch. Here the epoch goes on otherwise: other temperatures,
cadences, steps and uncertainties. Healthy histories, with repeats as requested, are simulated with another
seed than those of the limits.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import Design, LevelStep, design_of
from ballscrew.monitoring.detection.healthy_axes import simulate_healthy
from ballscrew.monitoring.detection.limits import compute_limits
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.statistics import statistics
from benchmarks.identification_tables import write
from benchmarks.machine import heading

UNCERTAINTY, DRIFT = 0.004, 0.0017
SEED = 5
YEAR = 365.25


def season(days: Array, size: float = 4.0) -> Array:
    """Temperature with a season and weather."""
    weather = 2 * np.random.default_rng(3).standard_normal(len(days))
    return np.asarray(20 + size * np.sin(2 * np.pi * days / 365) + weather)


def epoch(days: Array, temperature: Array | None = None, steps: Sequence[LevelStep] = ()) -> Design:
    """Epoch with runs of the usual uncertainty."""
    read = season(days) if temperature is None else temperature
    return design_of(days, np.full(len(days), UNCERTAINTY), read, steps, MonitorSettings(), DRIFT)


def epochs() -> Iterator[tuple[str, Design]]:
    """Epochs by name."""
    present = np.random.default_rng([1, 77]).uniform(size=420) > 0.05
    yield "a test a day for a year, season ± 4 K", epoch(np.arange(420.0)[present][:365])
    yield "a test a week", epoch(7 * np.arange(80.0))
    days = np.arange(200.0)
    yield "grease and a remounted sensor", epoch(days, steps=(LevelStep(60.5, 0.02), LevelStep(120.5, 0.01)))
    cold = np.where(days < 25, 20 + 0.3 * np.sin(days), season(days - 25, 10.0))
    yield "learnt at one temperature, then ± 10 K", epoch(days, cold)
    weekly = 140 + 7 * np.arange(40.0)
    pauses = np.concatenate([np.arange(40.0), 100 + np.arange(40.0), weekly, 420 + np.arange(60.0)])
    yield "pauses of 60 days, weekly tests, then daily ones", epoch(pauses)
    yield (
        "learnt in five days, then daily",
        epoch(np.concatenate([0.2 * np.arange(25), 5 + np.arange(120.0)])),
    )
    yield "learnt weekly, then daily", epoch(np.concatenate([7 * np.arange(25.0), 175 + np.arange(100.0)]))
    size = UNCERTAINTY * np.select([days < 60, days < 130], [1.0, 2.0], 0.5)
    changed = design_of(days, size, season(days), (), MonitorSettings(), DRIFT)
    yield "uncertainty doubled, then a quarter of it", changed


def row(name: str, design: Design, histories: int) -> str:
    """Row of the table."""
    limits = compute_limits(design)
    levels, again = simulate_healthy(design, histories, (SEED,))
    found = statistics(design, levels, again, lambda k, _: float(limits.repeat[k]))
    alarmed = limits.alarms(found)
    last = np.where(alarmed.any(axis=0), alarmed.argmax(axis=0), len(design.days) - 1)
    alarms, years = int(alarmed.any(axis=0).sum()), float(design.days[last].sum()) / YEAR
    rate, spread = alarms / years, np.sqrt(max(alarms, 1)) / years
    repeats = found.repeated.sum() / histories / float(design.days[-1]) * YEAR
    return f"| {name} | {alarms} in {years:.0f} | {rate:.2f} ± {spread:.2f} | {repeats:.1f} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--histories", type=int, default=3000)
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    lines = [
        heading("python -m benchmarks.false_alarms"),
        "",
        "| healthy axes, 0.1 a year stated | false alarms in axis-years | a year | repeats a year |",
        "|---|---|---|---|",
    ]
    for name, design in epochs():
        lines.append(row(name, design, given.histories))
        print(lines[-1], flush=True)
    if given.page is not None:
        write(given.page, "false alarms", lines)


if __name__ == "__main__":
    main()
