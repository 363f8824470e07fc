"""What the experiments say of the preload: the calibrated theory, and each day's preload by it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.calibration import calibrate
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.estimation.preload import preload
from ballscrew.reproduction.experiment import Measured
from ballscrew.reproduction.results import (
    Claim,
    Experiments,
    at,
    frequency,
    mean_preload,
    told,
    truth_by_place,
    whole_runs,
)

__all__ = ["along", "calibrated", "contact", "left", "metrology", "preloads"]

_FOUR_POINTS = 2 ** (2 / 3)  # of κ, for as many loaded balls
_FAIR = 0.05  # of P/P₀


@dataclass(frozen=True, slots=True)
class Told:
    """A run's preload beside the true one."""

    day: float
    estimate: PreloadEstimate
    true: float


def calibrated(found: Experiments, sheet: DataSheet | None = None) -> CalibratedAxis:
    """Calibrate with the multi-level-mass experiment and a data sheet, by default the bench's."""
    return calibrate([one.run for one in found.masses], sheet or found.sheet)


def left(found: Experiments, model: CalibratedAxis) -> list[float]:
    """Measured less the calibrated theory, of every cell under every load, Hz."""
    from ballscrew.axis.axial import frequency as theory

    return [
        frequency(cell) - float(theory(model.model, place, one.planned.load))
        for one in found.masses
        for (place, _), cell in told(one.run).items()
    ]


def preloads(found: Experiments, model: CalibratedAxis, runs: Sequence[Measured]) -> tuple[Told, ...]:
    """Tell the preload of runs of the life, its first run the baseline."""
    base, new = found.life[0], mean_preload(found.life[0])
    return tuple(
        Told(one.planned.day, preload(one.run, model, base.run), mean_preload(one) / new)
        for one in runs
        if one is not base
    )


def metrology(found: Experiments) -> Claim:
    """θ and the preload."""
    words = (
        "With the theory validated, the frequency is a virtual metrology of the preload; θ is fitted to "
        "each screw, which needs no maker's parameters (section 3.1)."
    )
    why = (
        "At one preload, loads and positions determine three combinations of θ, not its four numbers: the "
        "rest is the maker's K, which is right here: data sheet and bench agree. A second known preload "
        "would take its place."
    )
    model = calibrated(found)
    rows = preloads(found, model, whole_runs(found.life))
    known = [
        (row.day, row.true, row.estimate.relative_to_baseline)
        for row in rows
        if row.estimate.relative_to_baseline is not None
    ]
    if not known:
        return Claim(words, "No run of the life tells a preload.", "open", why)
    error = np.array([ratio.value - true for _, true, ratio in known])
    holds = [ratio.interval[0] <= true <= ratio.interval[1] for _, true, ratio in known]
    day, true, last = known[-1]
    rms = float(np.sqrt(np.mean(error**2)))
    return Claim(
        words,
        f"Calibrated with {len(found.masses)} loads and the data sheet, {len(known)} runs of the life are "
        f"told P/P₀ with an error of {rms:.3f} (root mean square) against the mean of the stops; the 95 % "
        f"interval holds it in {sum(holds)}. The last of them, day {day:g}: {last.value:.2f}, "
        f"{last.interval[0]:.2f} to {last.interval[1]:.2f}; truly {true:.2f}.",
        "partly" if rms < _FAIR and np.mean(holds) > 0.8 else "no",
        why,
    )


def contact(found: Experiments) -> Claim:
    """Two points or four."""
    screw = found.sheet.screw
    four = replace(found.sheet, screw=replace(screw, rigidity=_FOUR_POINTS * screw.rigidity))
    models = [calibrated(found, sheet) for sheet in (found.sheet, four)]
    rms = [float(np.sqrt(np.mean(np.square(left(found, model))))) for model in models]
    shares = [model.model.share for model in models]
    runs = whole_runs(found.life)[-1:]
    ends = [preloads(found, model, runs) for model in models]
    words = []
    for rows in ends:
        ratio = rows[0].estimate.relative_to_baseline if rows else None
        words.append("nothing" if ratio is None else f"{ratio.value:.2f}")
    true = f", truly {ends[0][0].true:.2f}" if ends[0] else ""
    return Claim(
        "What is left comes partly from contact at two points in the model, at four in the screw (section "
        "5.1).",
        f"Fitted to all loads, κ of two points leaves {rms[0]:.2f} Hz (root mean square), κ of four points "
        f"{rms[1]:.2f} Hz: frequencies at one preload do not tell them apart. They take the nut for "
        f"{100 * shares[0]:.0f} and {100 * shares[1]:.0f} % of the compliance, and read the last whole run "
        f"as a P/P₀ of {words[0]} and {words[1]}{true}: our bench, which has two points, tells them apart by "
        "its known preloads alone.",
        "open",
        "Four points change κ by a factor (2^(2/3) for as many loaded balls) and no exponent: the law "
        "stays P^(1/3), a, b and c are scaled alike. What theory by the data sheet leaves here comes above "
        "all from the bed, which swings along.",
    )


def along(found: Experiments) -> Claim:
    """The paper's future work."""
    words = "A model that predicts the preload at a location is left for the future (section 6)."
    runs = whole_runs(found.life)
    middle = runs[len(runs) // 2]
    true, new = (truth_by_place(one, "local_preload_N") for one in (middle, found.life[0]))
    (row,) = preloads(found, calibrated(found), [middle]) or (None,)
    told_along = None if row is None else row.estimate.along
    if told_along is None:
        return Claim(words, "No run between tells a preload along the axis.", "open", "None.")
    true_ratio = {place: value / (at(new, place) or value) for place, value in true.items()}
    pairs = [
        (x, one, right)
        for x, one in zip(told_along.position, told_along.ratio, strict=True)
        if (right := at(true_ratio, x)) is not None
    ]
    holds = sum(one.interval[0] <= right <= one.interval[1] for _, one, right in pairs)
    rms = float(np.sqrt(np.mean([(one.value - right) ** 2 for _, one, right in pairs])))
    worst, low, right = min(pairs, key=lambda row: row[2])
    return Claim(
        words,
        f"On day {middle.planned.day:g} P/P₀ is told at {len(pairs)} stops with an error of {rms:.2f} (root "
        f"mean square); the 95 % interval holds it at {holds}. At {1e3 * worst:.0f} mm, where most is "
        f"lost, {low.value:.2f} is told; truly {right:.2f}.",
        "yes" if holds >= 0.9 * len(pairs) and rms < 0.1 else "partly",
        "P(x) is smooth between stops by assumption; a place narrower than that reads shallower than it is.",
    )
