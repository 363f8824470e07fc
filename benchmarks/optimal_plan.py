"""The optimised plan beside the paper's multi-level mass plan: what a minute of each tells of an axis.

python -m benchmarks.optimal_plan [--axes COUNT] [--draws COUNT] [--page FILE]
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballscrew.axis.axial import PARAMETERS, frequency, from_vector, gradient
from ballscrew.axis.axial_prior import prior
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.arrays import Array
from ballscrew.fcft.optimise import Optimised, optimise
from ballscrew.fcft.plan import Plan, read_plan
from ballscrew.fcft.run_information import RunRows, run_rows
from ballscrew.fcft.scatter import default_scatter
from ballscrew.testbed.example import AXIS, PLAN
from benchmarks.axis_sampling import random_axis
from benchmarks.identification_tables import write
from benchmarks.machine import heading

_LOADS = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0)
_REPETITIONS = 30
_CHANGES = (0.0, 5.0, 10.0, 20.0)
_COUNT, _DRAWS = 20, 2000
_STEPS = 8
_ESTIMATED = ("compliance", "slope", "mass")


@dataclass(frozen=True)
class Case:
    """An axis and the paper's plan on it.

    Parameters
    ----------
    name : str
        For the table.
    sheet : DataSheet
        The axis.
    plan : Plan
        Eleven stops, six loads, thirty repetitions.
    """

    name: str
    sheet: DataSheet
    plan: Plan


def papers_plan(plan: Plan, heaviest: float = 50.0) -> Plan:
    """Six loads and thirty repetitions at eleven stops over a plan's travel, with its motions.

    Parameters
    ----------
    plan : Plan
        Gives travel and motions.
    heaviest : float
        The six loads go from nothing to this, kg.

    Returns
    -------
    Plan
        The paper's, where the travel is 450 mm and the heaviest load 50 kg.
    """
    first, last = plan.positions[0], plan.positions[-1]
    gap = max(2 * motion.acceleration_distance for motion in plan.motions)
    count = min(10, int((last - first) / gap * (1 + 1e-9)))
    return replace(
        plan,
        positions=tuple(first + (last - first) * i / count for i in range(count + 1)),
        masses=tuple(heaviest * load / _LOADS[-1] for load in _LOADS),
        repetitions=_REPETITIONS,
    )


def cases(count: int) -> list[Case]:
    """The paper-like axis, the bench where its data are, and random ones with loads as they carry."""
    found = [Case("25 × 10, as the paper's", AXIS, papers_plan(PLAN))]
    folder = Path(os.environ.get("BALLSCREW_DATA", "../shared/data")) / "bench"
    if folder.is_dir():
        sheet = read_axis(folder / "axis.toml")
        found.append(Case("the bench, 18 × 10", sheet, papers_plan(read_plan(folder / "plan.toml"))))
    for seed in range(count):
        axis = random_axis(seed)
        screw = axis.data_sheet.screw
        name = f"random {seed}, {1e3 * screw.nominal_diameter:.0f} × {1e3 * screw.lead:.0f}"
        found.append(Case(name, axis.data_sheet, papers_plan(axis.plan, axis.load)))
    return found


def row(case: Case) -> tuple[str, list[float]]:
    """One line of the table, and its ratios by the time that a change of load takes."""
    best = {change: optimise(case.plan, case.sheet, change_minutes=change) for change in _CHANGES}
    ten = best[10.0]
    ratios = [one.ratio for one in best.values()]
    thrice = optimise(replace(case.plan, repetitions=3), case.sheet)
    bare = optimise(case.plan, case.sheet, centre=False).ratio
    briefly = thrice.chosen.per_minute / ten.given.per_minute
    stops = " ".join(f"{1e3 * x:.0f}" for x in ten.plan.positions)
    loads = " ".join(f"{load:.3g}" for load in ten.plan.masses)
    line = (
        f"| {case.name} | {stops} | {loads} | {ten.given.minutes:.0f} → {ten.chosen.minutes:.0f} | "
        f"{ten.given.bits:.1f} → {ten.chosen.bits:.1f} | "
        + " | ".join(f"{ratio:.2f}" for ratio in ratios)
        + f" | {bare:.2f} | {briefly:.2f} |"
    )
    return line, [*ratios, bare, briefly]


def realised(plan: Plan, sheet: DataSheet, draws: int, seed: int = 0) -> Array:
    """Errors of fits to random mode tables of random axes, root mean square by working vector.

    Axes are sampled from the data sheet's tolerances, errors from the default scatter; the fit takes
    both for what they are and is not linear. It uses nothing of :mod:`ballscrew.fcft.plan_information`.

    Parameters
    ----------
    plan : Plan
        The test.
    sheet : DataSheet
        The axis.
    draws : int
        How many.
    seed : int
        Of the draws.

    Returns
    -------
    ndarray, shape (7,)
        In the units of the working vector.
    """
    centre = (plan.positions[0] + plan.positions[-1]) / 2
    mean, covariance = prior(sheet, centre)
    model, span = from_vector(mean, centre), (plan.positions[0], plan.positions[-1])
    scatter = default_scatter(sheet)
    rows = [run_rows(plan, load, model, scatter, span) for load in plan.masses]
    x = np.tile(plan.positions, len(plan.masses))
    load = np.repeat(plan.masses, len(plan.positions))
    factor = _error_factor(rows)
    whole = factor @ factor.T
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.clip(values, 0, None))
    rng = np.random.default_rng(seed)
    errors = []
    for _ in range(draws):
        truth = root @ rng.normal(size=len(mean))
        measured = np.log(frequency(from_vector(mean + truth, centre), x, load))
        measured = measured + factor @ rng.normal(size=factor.shape[1])
        fitted = np.zeros_like(truth)
        for _ in range(_STEPS):
            now = from_vector(mean + fitted, centre)
            slopes = gradient(now, x, load)[:, :-1]
            left = measured - np.log(frequency(now, x, load)) + slopes @ fitted
            fitted = covariance @ slopes.T @ np.linalg.solve(slopes @ covariance @ slopes.T + whole, left)
        errors.append(fitted - truth)
    return np.asarray(np.sqrt(np.mean(np.square(errors), axis=0)))


def _error_factor(rows: Sequence[RunRows]) -> Array:
    """Effects of all independent causes on all rows, shape (n, causes)."""
    sizes = [len(run.own) for run in rows]
    blocks = [np.diag(np.concatenate([run.own for run in rows]))]
    blocks.append(np.concatenate([run.lasting for run in rows], axis=1).T)
    start = 0
    for run, size in zip(rows, sizes, strict=True):
        block = np.zeros((sum(sizes), 3))
        block[start : start + size] = np.column_stack([run.runs.T, run.loads])
        blocks.append(block)
        start += size
    return np.concatenate(blocks, axis=1)


def accuracy_lines(case: Case, draws: int) -> list[str]:
    """Table of what is expected and what fits give, of both plans."""
    best: Optimised = optimise(case.plan, case.sheet)
    centre = (case.plan.positions[0] + case.plan.positions[-1]) / 2
    slope = abs(from_vector(prior(case.sheet, centre)[0], centre).slope)
    out = [
        "| plan | standard uncertainty of | data sheet | expected | fits, rms |",
        "|---|---|---|---|---|",
    ]
    for name, plan, information in (
        ("the paper's", case.plan, best.given),
        ("optimised", best.plan, best.chosen),
    ):
        got = dict(zip(PARAMETERS, realised(plan, case.sheet, draws), strict=True))
        got["slope"] /= slope
        out += [
            f"| {name} | {one.name} | {100 * one.before:.2g} % | {100 * one.after:.2g} % | "
            f"{100 * got[one.name]:.2g} % |"
            for one in information.accuracy
            if one.name in _ESTIMATED
        ]
    return out


def main() -> None:
    """Print the tables, and write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--axes", type=int, default=_COUNT)
    parser.add_argument("--draws", type=int, default=_DRAWS)
    parser.add_argument("--page", type=Path)
    asked = parser.parse_args()
    changes = " | ".join(f"{change:g} min" for change in _CHANGES)
    lines = [
        heading(f"python -m benchmarks.optimal_plan --axes {asked.axes}"),
        "",
        f"| axis | stops, mm | loads, kg | minutes | bits | {changes} | no centre | 3 trips |",
        f"|---|---|---|---|---|{'---|' * (len(_CHANGES) + 2)}",
    ]
    every, found = [], cases(asked.axes)
    for case in found:
        line, ratios = row(case)
        lines.append(line)
        every.append(ratios)
        print(line, flush=True)
    for name, of in (("median of all", np.median), ("least of all", np.min)):
        lines.append(f"| {name} | | | | | " + " | ".join(f"{v:.2f}" for v in of(every, axis=0)) + " |")
    known = [
        heading(f"python -m benchmarks.optimal_plan --draws {asked.draws}"),
        "",
        *accuracy_lines(found[0], asked.draws),
    ]
    print("\n".join([*lines, "", *known]))
    if asked.page is not None:
        write(asked.page, "information per minute", lines)
        write(asked.page, "expected accuracy", known)


if __name__ == "__main__":
    main()
