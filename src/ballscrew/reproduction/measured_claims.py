"""The paper's claims about its experiments, beside what ours show."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ballscrew.modal.run import Run
from ballscrew.reproduction.experiment import Measured
from ballscrew.reproduction.results import (
    Claim,
    Experiments,
    at,
    falls_before_backlash,
    first_backlash,
    frequency,
    mean_preload,
    told,
    truth_by_place,
    whole_runs,
)

__all__ = [
    "conditions",
    "early",
    "identified",
    "repetitions",
    "with_backlash",
    "with_load",
    "with_position",
    "with_preload",
]

_COVERAGE = 1.96


def identified(found: Experiments) -> Claim:
    """Fig. 3."""
    errors, halves, cells, number, doubtful = [], [], 0, 0, 0
    for one in (*found.masses, *found.life):
        true = truth_by_place(one)
        cells += len(one.run.cells)
        for (place, _), cell in told(one.run).items():
            number += 1
            doubtful += cell.verdict != "good"
            reference = at(true, place)
            # Where there is no preload left there is no frequency to be told: any is wrong.
            errors.append(float("inf") if reference is None else frequency(cell) - reference)
            halves.append(_COVERAGE * (cell.standard_uncertainty_Hz or 0.0))
    off, half = np.abs(errors), np.array(halves)
    return Claim(
        "The natural frequency can be identified as a peak of the FRF (Fig. 3).",
        f"{number} of {cells} cells are told, {doubtful} of them as suspect, the others refused, each with a "
        f"reason. Error: median {np.median(off):.2f} Hz, nine of ten below {np.quantile(off, 0.9):.1f} Hz; "
        f"the 95 % interval holds {100 * float((off <= half).mean()):.0f} % of them.",
        "yes" if number > 0.9 * cells and np.median(off) < 0.5 else "partly",
        "Refused are above all the runs of the last weeks, in which the test's own load unloads the nut.",
    )


def conditions(found: Experiments) -> Claim:
    """Table 1."""
    counts: dict[float, int] = {}
    for cell in found.life[0].run.cells:
        counts[cell.position_m] = counts.get(cell.position_m, 0) + 1
    inner = {counts[place] for place in sorted(counts)[1:-1]}
    ends = [counts[min(counts)], counts[max(counts)]]
    return Claim(
        "Two conditions exist at the ends of the travel, four between (Table 1).",
        f"{ends[0]} and {ends[1]} at the ends, {', '.join(str(n) for n in sorted(inner))} between: "
        f"{sum(counts.values())} cells at {len(counts)} stops.",
        "yes" if ends == [2, 2] and inner == {4} else "no",
        "None.",
    )


def repetitions(found: Experiments) -> Claim:
    """Thirty of them."""
    words = "30 repetitions are averaged to reduce the noise (section 3.3)."
    if found.few is None:
        return Claim(words, "Not measured with --quick, which has three.", "open", "None.")
    few, many = told(found.few), told(found.life[0].run)
    change = [frequency(few[key]) - frequency(many[key]) for key in few if key in many]
    truth = truth_by_place(found.life[0])
    errors = [abs(frequency(cell) - truth[place]) for (place, _), cell in many.items()]
    moved, error = float(np.median(np.abs(change))), float(np.median(errors))
    return Claim(
        words,
        f"On day 0 the first {few[next(iter(few))].repetitions} of {found.life[0].planned.plan.repetitions} "
        f"repetitions give frequencies that differ by {moved:.2f} Hz in the median; the error with all of "
        f"them is {error:.2f} Hz.",
        "yes",
        "What repetitions share they do not reduce: window, motion, friction at the same place.",
    )


def with_load(found: Experiments) -> Claim:
    """Figs. 8 and 10."""
    falls: list[float] = []
    for lighter, heavier in pairwise(found.masses):
        falls += _differences(lighter.run, heavier.run)
    down = sum(fall < 0 for fall in falls)
    possible = (len(found.masses) - 1) * len(found.masses[0].run.cells)
    span = found.masses[-1].planned.load - found.masses[0].planned.load
    ends = _differences(found.masses[0].run, found.masses[-1].run)
    return Claim(
        "The frequency generally falls as the load grows (Figs. 8 and 10).",
        f"It falls in {down} of {len(falls)} comparisons of one load with the next in the same cell"
        + (f"; over {span:g} kg by {-float(np.median(ends)):.0f} Hz in the median." if ends else "."),
        _verdict(down, len(falls)),
        f"{possible - len(falls)} of {possible} comparisons lack a cell that was refused.",
    )


def with_position(found: Experiments) -> Claim:
    """Figs. 8 and 9."""
    falls: list[float] = []
    for one in (*found.masses, found.life[0]):
        cells = told(one.run)
        for condition in ("PA", "PD", "NA", "ND"):
            places = sorted(place for place, other in cells if other == condition)
            falls += [
                frequency(cells[far, condition]) - frequency(cells[near, condition])
                for near, far in pairwise(places)
            ]
    down = sum(fall < 0 for fall in falls)
    steps = [
        abs(b - a)
        for one in (*found.masses, found.life[0])
        for a, b in pairwise(truth_by_place(one).values())
    ]
    return Claim(
        "The frequency falls as the table moves away from the bearing (Figs. 2, 8 and 9).",
        f"It falls in {down} of {len(falls)} comparisons of a stop with the next that is told.",
        _verdict(down, len(falls)),
        f"From one stop to the next it truly falls by {min(steps):.1f} to {max(steps):.1f} Hz.",
    )


def with_preload(found: Experiments) -> Claim:
    """Fig. 11."""
    from scipy.stats import spearmanr

    runs = whole_runs(found.life)
    base = told(runs[0].run)
    preload = [mean_preload(one) for one in runs]
    change = [
        float(
            np.mean(
                [frequency(cell) - frequency(base[key]) for key, cell in told(one.run).items() if key in base]
            )
        )
        for one in runs
    ]
    rank = float(spearmanr(preload, change).statistic) if len(runs) > 2 else float("nan")
    return Claim(
        "The frequency falls as the experiment proceeds: frequency and preload go together (Fig. 11).",
        f"Mean change of the cells by {min(change):+.1f} Hz over the {len(runs)} runs in which all are told, "
        f"to day {runs[-1].planned.day:g}; rank correlation with the true preload {rank:+.3f}.",
        "yes" if rank > 0.95 else "partly" if rank > 0.5 else "no",
        "Below about 1 % of Ca the test's own load unloads one side of the nut: what is read is then more "
        "and more the load's rigidity, not the preload's.",
    )


def early(found: Experiments) -> Claim:
    """The paper's promise."""
    words = "The natural frequency tells of the loss early, before it can be seen (sections 1 and 6)."
    falls = falls_before_backlash(found.life)
    end = first_backlash(found.life)
    if not falls or end is None:
        return Claim(words, "No two runs before the backlash have all their cells.", "open", "None.")
    sure = [fall for fall, u in falls.values() if fall > _COVERAGE * u]
    values = [fall for fall, _ in falls.values()]
    runs = whole_runs(found.life)
    first, last = (truth_by_place(one) for one in (runs[0], runs[-1]))
    true = [first[place] - last[place] for place, _ in falls]
    return Claim(
        words,
        f"On day {runs[-1].planned.day:g}, {end - runs[-1].planned.day:g} days before the first run with "
        f"backlash, it has fallen in {len(sure)} of {len(values)} cells by more than the 95 % interval of "
        f"the change, by {min(values):.1f} to {max(values):.1f} Hz; truly by {min(true):.1f} to "
        f"{max(true):.1f} Hz.",
        _verdict(len(sure), len(values)),
        "Later runs, in which cells are refused, are left out here.",
    )


def with_backlash(found: Experiments) -> Claim:
    """Fig. 12."""
    from scipy.stats import spearmanr

    end = first_backlash(found.life)
    before = [one for one in found.life if end is None or one.planned.day < end]
    first, last = (_lost(one) for one in (before[0], before[-1]))
    peak = max(max(truth_by_place(one, "local_backlash_m").values()) for one in found.life)
    lost, preloads = [_lost(one) for one in before], [mean_preload(one) for one in before]
    rank = float(spearmanr(lost, preloads).statistic) if len(before) > 2 else float("nan")
    return Claim(
        "The frequency falls gradually while backlash grows from 0 to 0.4 µm; the correlation of preload "
        "loss and backlash is quantified (section 2, Fig. 12).",
        f"True backlash is zero until day {before[-1].planned.day:g} and {1e6 * peak:.2f} µm at the end. "
        f"What a scale beside the table shows at a reversal, mean of the stops, goes from {1e6 * first:.2f} "
        f"to {1e6 * last:.2f} µm before there is any; its rank correlation with the preload is {rank:+.2f}.",
        "partly" if rank < -0.8 else "no",
        "A preloaded nut has no backlash. A displacement sensor also shows what friction winds up in the "
        "whole axis, and that grows as preload goes: a gradual rise from the start does not contradict "
        "stage I.",
    )


def _lost(one: Measured) -> float:
    lost = [each.lost_m for each in one.run.lost_motion]
    return float(np.mean(lost)) if lost else float("nan")


def _differences(one: Run, other: Run) -> list[float]:
    first, second = told(one), told(other)
    return [frequency(second[key]) - frequency(first[key]) for key in first if key in second]


def _verdict(good: int, count: int) -> str:
    if not count:
        return "open"
    return "yes" if good >= 0.95 * count else "partly" if good >= 0.6 * count else "no"
