"""The paper's claims about its experiments, beside the results of the testbed."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np

from ballscrew.base.quantity import NORMAL_95
from ballscrew.modal.run import Run
from ballscrew.reproduction.experiment import Measured
from ballscrew.reproduction.results import (
    Claim,
    Experiments,
    complete_runs,
    falls_before_backlash,
    first_backlash,
    frequencies,
    mean_preload,
    reported_cells,
    runs_before_backlash,
    true_values,
    value_at,
)


def identified(experiments: Experiments) -> Claim:
    """Fig. 3: the natural frequency is identified from the FRF."""
    errors, half_widths, cells, suspect = [], [], 0, 0
    for measured in (*experiments.masses, *experiments.life):
        true = true_values(measured)
        cells += len(measured.run.cells)
        for (position, _), cell in reported_cells(measured.run).items():
            suspect += cell.verdict != "good"
            error = (cell.frequency_Hz or 0.0) - value_at(true, position)
            # Without preload there is no such frequency: any reported value is wrong.
            errors.append(abs(error) if np.isfinite(error) else np.inf)
            half_widths.append(NORMAL_95 * (cell.standard_uncertainty_Hz or 0.0))
    median = float(np.median(errors))
    coverage = float(np.mean(np.array(errors) <= np.array(half_widths)))
    return Claim(
        "The natural frequency can be identified as a peak of the FRF (Fig. 3).",
        f"{len(errors)} of {cells} cells are reported, {suspect} of them as suspect; the others are refused "
        f"with a reason. Error: median {median:.2f} Hz, 90th percentile {np.quantile(errors, 0.9):.1f} Hz; "
        f"{100 * coverage:.0f} % of the 95 % intervals contain the true value.",
        "yes" if len(errors) > 0.9 * cells and median < 0.5 else "partly",
        "Most refused cells belong to the last weeks, when the load of the test itself unloads the nut.",
    )


def conditions(experiments: Experiments) -> Claim:
    """Table 1: conditions at each stop."""
    counts = Counter(cell.position_m for cell in experiments.life[0].run.cells)
    stops = sorted(counts)
    inner = sorted({counts[stop] for stop in stops[1:-1]})
    ends = [counts[stops[0]], counts[stops[-1]]]
    return Claim(
        "Two conditions exist at the ends of the travel, four between (Table 1).",
        f"{ends[0]} and {ends[1]} at the ends, {', '.join(map(str, inner))} between: "
        f"{counts.total()} cells at {len(stops)} stops.",
        "yes" if ends == [2, 2] and inner == [4] else "no",
        "None.",
    )


def repetitions(experiments: Experiments) -> Claim:
    """Section 3.3: thirty repetitions."""
    words = "30 repetitions are averaged to reduce the noise (section 3.3)."
    if experiments.short_run is None:
        return Claim(words, "Not measured with --quick, which makes three.", "open", "None.")
    first = experiments.life[0]
    few, many, truth = frequencies(experiments.short_run), frequencies(first.run), true_values(first)
    change = [abs(few[key] - many[key]) for key in few.keys() & many.keys()]
    errors = [abs(frequency - truth[position]) for (position, _), frequency in many.items()]
    return Claim(
        words,
        f"On day 0 the first {experiments.short_run.cells[0].repetitions} of "
        f"{first.planned.plan.repetitions} repetitions give frequencies that differ by "
        f"{np.median(change):.2f} Hz in the median; the median error with all of them is "
        f"{np.median(errors):.2f} Hz.",
        "yes",
        "Repetitions do not reduce what they share: window, motion, and friction at the same position.",
    )


def with_load(experiments: Experiments) -> Claim:
    """Figs. 8 and 10: frequency against load."""
    masses = experiments.masses
    changes: list[float] = []
    for lighter, heavier in pairwise(masses):
        changes += _changes(lighter.run, heavier.run)
    falls = sum(change < 0 for change in changes)
    possible = (len(masses) - 1) * len(masses[0].run.cells)
    measured = f"It falls in {falls} of {len(changes)} comparisons of one load with the next in the same cell"
    ends = _changes(masses[0].run, masses[-1].run)
    if ends:
        span = masses[-1].planned.load - masses[0].planned.load
        measured += f"; over {span:g} kg by {-float(np.median(ends)):.0f} Hz in the median"
    return Claim(
        "The frequency generally falls as the load grows (Figs. 8 and 10).",
        f"{measured}.",
        _verdict(falls, len(changes)),
        f"{possible - len(changes)} of {possible} comparisons lack a cell that was refused.",
    )


def with_position(experiments: Experiments) -> Claim:
    """Figs. 8 and 9: frequency against position."""
    changes: list[float] = []
    true_changes: list[float] = []
    for measured in (*experiments.masses, experiments.life[0]):
        cells = frequencies(measured.run)
        for condition in ("PA", "PD", "NA", "ND"):
            along = [cells[key] for key in sorted(cells) if key[1] == condition]
            changes += np.diff(along).tolist()
        true_changes += np.abs(np.diff(list(true_values(measured).values()))).tolist()
    falls = sum(change < 0 for change in changes)
    return Claim(
        "The frequency falls as the table moves away from the bearing (Figs. 2, 8 and 9).",
        f"It falls in {falls} of {len(changes)} comparisons of a stop with the next one that is reported.",
        _verdict(falls, len(changes)),
        f"The true fall from one stop to the next is {min(true_changes):.1f} to {max(true_changes):.1f} Hz.",
    )


def with_preload(experiments: Experiments) -> Claim:
    """Fig. 11: frequency over the life."""
    runs = complete_runs(experiments.life)
    preload = [mean_preload(measured) for measured in runs]
    change = [float(np.mean(_changes(runs[0].run, measured.run))) for measured in runs]
    rank = _rank_correlation(preload, change)
    holds = "no"
    if rank > 0.5:
        holds = "partly"
    if rank > 0.95:
        holds = "yes"
    return Claim(
        "The frequency falls as the experiment proceeds: frequency and preload go together (Fig. 11).",
        f"Mean change of the cells down to {min(change):+.1f} Hz over the {len(runs)} complete runs, up to "
        f"day {runs[-1].planned.day:g}; rank correlation with the true preload {rank:+.3f}.",
        holds,
        "Below about 1 % of Ca the load of the test unloads one side of the nut: the frequency then depends "
        "more and more on the rigidity under that load and less on the preload.",
    )


def early(experiments: Experiments) -> Claim:
    """Sections 1 and 6: early detection by the frequency."""
    words = "The natural frequency shows the loss early, before it can be seen (sections 1 and 6)."
    falls = falls_before_backlash(experiments.life)
    backlash_day = first_backlash(experiments.life)
    if not falls or backlash_day is None:
        return Claim(words, "No two runs before the backlash have all their cells.", "open", "None.")
    runs = complete_runs(experiments.life)
    first, last, day = true_values(runs[0]), true_values(runs[-1]), runs[-1].planned.day
    true = [first[position] - last[position] for position, _ in falls]
    values = np.array([fall for fall, _ in falls.values()])
    limits = NORMAL_95 * np.array([uncertainty for _, uncertainty in falls.values()])
    significant = int(np.sum(values > limits))
    return Claim(
        words,
        f"On day {day:g}, {backlash_day - day:g} days before the first run with backlash, it has fallen by "
        f"more than the 95 % interval of the change in {significant} of {len(falls)} cells, by "
        f"{min(values):.1f} to {max(values):.1f} Hz; the true fall is {min(true):.1f} to {max(true):.1f} Hz.",
        _verdict(significant, len(falls)),
        "Later runs, in which cells are refused, are left out here.",
    )


def with_backlash(experiments: Experiments) -> Claim:
    """Fig. 12: frequency and backlash."""
    before = runs_before_backlash(experiments.life)
    lost_motion = [_mean_lost_motion(measured) for measured in before]
    rank = _rank_correlation(lost_motion, [mean_preload(measured) for measured in before])
    peak = max(max(true_values(m, "local_backlash_m").values()) for m in experiments.life)
    return Claim(
        "The frequency falls gradually while backlash grows from 0 to 0.4 µm; the correlation of preload "
        "loss and backlash is quantified (section 2, Fig. 12).",
        f"True backlash is zero until day {before[-1].planned.day:g} and {1e6 * peak:.2f} µm at the end. "
        f"The lost motion at a reversal, measured by a scale beside the table (mean of the stops), goes from "
        f"{1e6 * lost_motion[0]:.2f} to {1e6 * lost_motion[-1]:.2f} µm before there is any; its rank "
        f"correlation with the preload is {rank:+.2f}.",
        "partly" if rank < -0.8 else "no",
        "A preloaded nut has no backlash. A displacement sensor also measures the elastic deflection of the "
        "whole axis under friction, which grows as preload is lost: a gradual rise from the start is "
        "consistent with stage I.",
    )


def _mean_lost_motion(measured: Measured) -> float:
    if not measured.run.lost_motion:
        return float("nan")
    return float(np.mean([stop.lost_m for stop in measured.run.lost_motion]))


def _changes(first: Run, second: Run) -> list[float]:
    """Change of the frequency of each cell that both runs report, Hz."""
    before, after = frequencies(first), frequencies(second)
    return [after[key] - before[key] for key in before if key in after]


def _rank_correlation(first: list[float], second: list[float]) -> float:
    """Spearman's rank correlation; NaN for fewer than three pairs."""
    from scipy.stats import spearmanr

    if len(first) < 3:
        return float("nan")
    return float(spearmanr(first, second).statistic)


def _verdict(successes: int, count: int) -> str:
    if count == 0:
        return "open"
    if successes >= 0.95 * count:
        return "yes"
    return "partly" if successes >= 0.6 * count else "no"
