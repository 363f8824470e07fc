"""Tables of :mod:`benchmarks.preload`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.estimation.estimate import PreloadEstimate

__all__ = ["Assessed", "Place", "bench_table", "imitation_table", "local_table", "wear_table"]

_BOUND_COLUMN = 7  # of the bound in the table of show 1
_WEAR_COLUMNS = 13  # of that table without the first three and the bound
EARLY = 0.7  # of the preload: down to here a loss is early


@dataclass(frozen=True, slots=True)
class Assessed:
    """An estimate compared with the true value.

    Parameters
    ----------
    true, true_stiffness : float
        P/P₀ of the nut, and the axial stiffness as P/P₀.
    verdict, nut_verdict : str
        good, suspect or refused.
    decision : str
        What was decided on the load.
    causes : tuple of str
        Names of those that are possible.
    ratio, interval : float and tuple of float, or None
        Estimated P/P₀ of the nut and its 95 % interval; None where refused.
    stiffness, stiffness_interval : float and tuple of float, or None
        The same of the axial stiffness.
    force, force_interval : float and tuple of float, or None
        Estimated over true P, and its interval.
    """

    true: float
    true_stiffness: float
    verdict: str
    nut_verdict: str
    decision: str
    causes: tuple[str, ...]
    ratio: float | None = None
    interval: tuple[float, float] | None = None
    stiffness: float | None = None
    stiffness_interval: tuple[float, float] | None = None
    force: float | None = None
    force_interval: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Place:
    """True position of local wear (NaN for none), its estimate, and the spacing of the stops, m."""

    true: float
    estimate: float | None
    gap: float


def _coverage(rows: Sequence[Assessed]) -> float:
    inside = [row.interval[0] <= row.true <= row.interval[1] for row in rows if row.interval]
    return 100 * float(np.mean(inside))


def _stiffness_coverage(rows: Sequence[Assessed]) -> float:
    intervals = [(row.stiffness_interval, row.true_stiffness) for row in rows if row.stiffness_interval]
    return 100 * float(np.mean([low <= true <= high for (low, high), true in intervals]))


def _width(intervals: Iterable[tuple[float, float] | None]) -> float:
    """Median half-width."""
    return float(np.median([(interval[1] - interval[0]) / 2 for interval in intervals if interval]))


def _rms(errors: Sequence[float] | Array) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def wear_table(
    cases: Mapping[str, Sequence[Assessed]],
    bounds: Mapping[str, np.ndarray] | None = None,
    states: Sequence[float] = (),
) -> list[str]:
    """Show 1: for each anchor all states, and those with little lost.

    ``bounds`` are the least standard deviations of P/P₀, shape (axes, states), of the ``states``.
    """
    early = np.array(states) >= EARLY - 1e-9
    heads = ["anchor", "states", "reported", "stiffness: error, rms", "coverage", "95 %"]
    heads += ["nut's P/P₀: error, rms", *([] if bounds is None else ["at best"]), "mean", "coverage", "95 %"]
    heads += ["P: error, rms", "coverage", "95 %", "suspect: stiffness", "nut"]
    out = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for name, everything in cases.items():
        least = None if bounds is None else bounds.get(name)
        first = [row for row in everything if row.true >= EARLY - 1e-9]
        for words, rows, best in (
            ("all", everything, least),
            (f"P/P₀ of {EARLY:g} or more", first, None if least is None else least[:, early]),
        ):
            cells = [name, words, *_wear_cells(rows)]
            if bounds is not None:
                cells.insert(_BOUND_COLUMN, "–" if best is None else f"{np.sqrt(np.mean(best**2)):.3f}")
            out.append("| " + " | ".join(cells) + " |")
    return out


def _wear_cells(everything: Sequence[Assessed]) -> list[str]:
    """Cells of one row of show 1, without the bound."""
    rows = [row for row in everything if row.ratio is not None and row.interval]
    reported = f"{len(rows)} of {len(everything)}"
    if not rows:
        return [reported, *["–"] * _WEAR_COLUMNS]
    stiffness = np.array([row.stiffness for row in rows], float) - [row.true_stiffness for row in rows]
    nut = np.array([row.ratio for row in rows], float) - [row.true for row in rows]
    force, ends = (
        np.array([row.force for row in rows], float) - 1,
        np.array([row.force_interval for row in rows]),
    )
    inside = 100 * np.mean((ends[:, 0] <= 1) & (ends[:, 1] >= 1))
    wide = 100 * np.median(ends[:, 1] - ends[:, 0]) / 2
    suspect = 100 * np.mean([row.verdict == "suspect" for row in rows])
    nut_suspect = 100 * np.mean([row.nut_verdict != "good" for row in rows])
    return [
        reported,
        f"{_rms(stiffness):.3f}",
        f"{_stiffness_coverage(rows):.0f} %",
        f"± {_width(row.stiffness_interval for row in rows):.3f}",
        f"{_rms(nut):.3f}",
        f"{np.mean(nut):+.3f}",
        f"{_coverage(rows):.0f} %",
        f"± {_width(row.interval for row in rows):.3f}",
        f"{100 * _rms(force):.0f} %",
        f"{inside:.0f} %",
        f"± {wide:.0f} %",
        f"{suspect:.0f} %",
        f"{nut_suspect:.0f} %",
    ]


def imitation_table(cases: Mapping[str, Sequence[Assessed]]) -> list[str]:
    """Show 2: estimates where no preload was lost."""
    out = [
        (
            "| change | axes | good / suspect / refused | nut: good / suspect / refused | "
            "load: stands / corrected / torque / undecided | stiffness as P/P₀, median (5 to 95 %) | "
            "true value in the interval | 95 % | 1 in the nut's interval | 95 % |"
        ),
        "|---" * 10 + "|",
    ]
    for name, rows in cases.items():
        estimated = [row for row in rows if row.stiffness is not None and row.interval]
        verdicts = _counts([row.verdict for row in rows], ("good", "suspect", "refused"))
        of_nut = _counts([row.nut_verdict for row in rows], ("good", "suspect", "refused"))
        decisions = _counts([row.decision for row in rows], ("declared", "corrected", "torque", "undecided"))
        rest = "– | – | – | – | –"
        if estimated:
            low, middle, high = np.quantile([row.stiffness for row in estimated], (0.05, 0.5, 0.95))
            rest = (
                f"{middle:.3f} ({low:.3f} to {high:.3f}) | {_stiffness_coverage(estimated):.0f} % | "
                f"± {_width(row.stiffness_interval for row in estimated):.3f} | "
                f"{_coverage(estimated):.0f} % | ± {_width(row.interval for row in estimated):.3f}"
            )
        out.append(f"| {name} | {len(rows)} | {verdicts} | {of_nut} | {decisions} | {rest} |")
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
