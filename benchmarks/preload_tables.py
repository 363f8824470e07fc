"""Tables of :mod:`benchmarks.preload`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.estimation.estimate import PreloadEstimate

__all__ = ["Assessed", "Place", "bench_table", "imitation_table", "local_table", "wear_table"]

EARLY = 0.7  # of the preload: down to here a loss is early


@dataclass(frozen=True, slots=True)
class Assessed:
    """An estimate compared with the true value.

    Parameters
    ----------
    true : float
        P/P₀.
    verdict : str
        good, suspect or refused.
    decision : str
        What was decided on the load.
    causes : tuple of str
        Names of those that are possible.
    ratio, interval : float and tuple of float, or None
        Estimated P/P₀ and its 95 % interval; None where refused.
    force, force_interval : float and tuple of float, or None
        Estimated over true P, and its interval.
    """

    true: float
    verdict: str
    decision: str
    causes: tuple[str, ...]
    ratio: float | None = None
    interval: tuple[float, float] | None = None
    force: float | None = None
    force_interval: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Place:
    """True position of local wear (NaN for none), its estimate, and the spacing of the stops, m."""

    true: float
    estimate: float | None
    gap: float


def _coverage(rows: Sequence[Assessed]) -> float:
    return 100 * float(np.mean([r.interval[0] <= r.true <= r.interval[1] for r in rows if r.interval]))


def _width(rows: Sequence[Assessed]) -> float:
    return float(np.median([(r.interval[1] - r.interval[0]) / 2 for r in rows if r.interval]))


def _off(rows: Sequence[Assessed]) -> np.ndarray:
    return np.array([r.ratio - r.true for r in rows if r.ratio is not None])


def wear_table(
    cases: Mapping[str, Sequence[Assessed]],
    bounds: Mapping[str, np.ndarray] | None = None,
    states: Sequence[float] = (),
) -> list[str]:
    """Show 1: for each anchor all states, and those with little lost.

    ``bounds`` are the least standard deviations of P/P₀, shape (axes, states), of the ``states``.
    """
    early = np.array(states) >= EARLY - 1e-9
    heads = ["anchor", "states", "reported", "P/P₀: error, rms", *([] if bounds is None else ["at best"])]
    heads += ["mean", "coverage", "95 %", "P: error, rms", "coverage", "95 %", "suspect"]
    out = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for name, everything in cases.items():
        of = None if bounds is None else bounds.get(name)
        for words, rows, least in (
            ("all", everything, of),
            (
                f"P/P₀ of {EARLY:g} or more",
                [r for r in everything if r.true >= EARLY - 1e-9],
                None if of is None else of[:, early],
            ),
        ):
            estimated = [r for r in rows if r.ratio is not None and r.interval]
            if not estimated:
                out.append(f"| {name} | {words} | 0 of {len(rows)} |" + " – |" * (len(heads) - 3))
                continue
            off = _off(estimated)
            best = (
                "" if bounds is None else "– | " if least is None else f"{np.sqrt(np.mean(least**2)):.3f} | "
            )
            force = np.array([r.force for r in estimated]) - 1
            ends = np.array([r.force_interval for r in estimated])
            inside = 100 * np.mean((ends[:, 0] <= 1) & (ends[:, 1] >= 1))
            wide = 100 * np.median(ends[:, 1] - ends[:, 0]) / 2
            suspect = 100 * np.mean([r.verdict == "suspect" for r in estimated])
            out.append(
                f"| {name} | {words} | {len(estimated)} of {len(rows)} | {np.sqrt(np.mean(off**2)):.3f} | "
                f"{best}{off.mean():+.3f} | {_coverage(estimated):.0f} % | ± {_width(estimated):.3f} | "
                f"{100 * np.sqrt(np.mean(force**2)):.0f} % | {inside:.0f} % | ± {wide:.0f} % | "
                f"{suspect:.0f} % |"
            )
    return out


def imitation_table(cases: Mapping[str, Sequence[Assessed]]) -> list[str]:
    """Show 2: estimates where no preload was lost."""
    out = [
        (
            "| change | axes | good / suspect / refused | "
            "load: stands / corrected / torque / undecided | bearing named | "
            "P/P₀, median (5 to 95 %) | 1 in the interval | 95 % |"
        ),
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, rows in cases.items():
        estimated = [r for r in rows if r.ratio is not None and r.interval]
        verdicts = _counts([r.verdict for r in rows], ("good", "suspect", "refused"))
        decisions = _counts([r.decision for r in rows], ("declared", "corrected", "torque", "undecided"))
        bearing = sum("bearing" in r.causes for r in rows)
        rest = "– | – | –"
        if estimated:
            low, middle, high = np.quantile([r.ratio for r in estimated], (0.05, 0.5, 0.95))
            coverage, width = _coverage(estimated), _width(estimated)
            rest = f"{middle:.3f} ({low:.3f} to {high:.3f}) | {coverage:.0f} % | ± {width:.3f}"
        out.append(f"| {name} | {len(rows)} | {verdicts} | {decisions} | {bearing} | {rest} |")
    return out


def _counts(words: Sequence[str], names: Sequence[str]) -> str:
    return " / ".join(str(words.count(name)) for name in names)


def local_table(worn: Sequence[Place], even: Sequence[Place]) -> list[str]:
    """Show 3: how many are found, how near, and how many where there is nothing."""
    off = [abs(place.estimate - place.true) / place.gap for place in worn if place.estimate is not None]
    false = sum(place.estimate is not None for place in even)
    return [
        "| axes | a worn place is reported | within one stop |",
        "|---|---|---|",
        f"| {len(worn)} with 30 % less over 90 mm | {len(off)} | {sum(gap <= 1.01 for gap in off)} |",
        f"| {len(even)} worn evenly | {false} | – |",
    ]


def bench_table(estimate: PreloadEstimate, model: CalibratedAxis, true: float) -> list[str]:
    """Show 4."""
    stiffness, nut = estimate.stiffness_relative_to_baseline, estimate.relative_to_baseline
    force = estimate.preload_N
    out = ["| | estimated | 95 % | true |", "|---|---|---|---|"]
    if stiffness is None or nut is None or force is None:
        return [*out, f"| P/P₀ | {estimate.verdict}: {'; '.join(estimate.reasons)} | – | {true:.2f} |"]
    for name, one, right, form in (
        ("axial stiffness as P/P₀", stiffness, true, ".3f"),
        ("P/P₀ of the nut", nut, true, ".3f"),
        ("P, N", force, true * 600.0, ".0f"),
    ):
        low, high = one.interval
        out.append(f"| {name} | {one.value:{form}} | {low:{form}} to {high:{form}} | {right:{form}} |")
    share = model.model.share
    sure = 1.96 * model.standard_uncertainty("share") * share * (1 - share)
    return [*out, f"| the nut's share of the compliance | {share:.3f} | ± {sure:.3f} | – |"]
