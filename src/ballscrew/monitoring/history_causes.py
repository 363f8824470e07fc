"""What made a history change: causes ranked by what single runs and the whole course speak for.

The newest runs are compared with the epoch's reference cell by cell, as one run is. The course adds what no
single run shows: wear goes on while a load, a mounting or a scale changes at once; a nut that loses preload
drags less; a load and a scale move the equivalent mass; grease moves friction and little else. Each adds to
the log odds, and none by more than a stated size, since none is known that well.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.estimation.causes import compare_causes, gather_evidence
from ballscrew.estimation.mass_check import mass_changes
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.chart import Chart
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.judged import Judged

__all__ = ["NAMES", "HistoryCause", "history_causes"]

NAMES = ("nut", "bearing", "load", "temperature", "lubrication", "torque scale", "sensor", "controller")
_OF_RUN = {
    "nut": "nut",
    "local": "nut",
    "bearing": "bearing",
    "load": "load",
    "temperature": "temperature",
    "torque": "torque scale",
    "position": "controller",
}
_OTHERS = {"lubrication": 0.03, "sensor": 0.03, "controller": 0.02, "temperature": 0.03}
_NEWEST = 3
_BENDS = (1.0, 1.5, 2.0)  # powers of time: wear by most laws is not quite a line
_FAR = 3.0  # residuals beyond it count as it: an odd run must not decide
_MOST = 4.0  # log odds that one kind of evidence adds at most
_PASSING = ("load", "sensor", "controller", "lubrication", "torque scale")
_DRAG = (0.05, 0.8)  # part of the friction that is the nut's drag: between
_OIL = 0.03  # of ln friction: oil and warmth change it slowly, which a baseline of days does not show
_MASS = 1e-3  # of ln equivalent mass


@dataclass(frozen=True, slots=True)
class HistoryCause:
    """One cause, and what speaks for and against it.

    Parameters
    ----------
    cause : str
        One of :data:`NAMES`.
    probability : float
        Among these; they sum to 1.
    evidence : str
        In words.
    """

    cause: str
    probability: float
    evidence: str


def history_causes(
    good: Sequence[Judged], reference: Run, found: Chart, model: CalibratedAxis, settings: MonitorSettings
) -> tuple[HistoryCause, ...]:
    """Rank what made the level change since the baseline.

    Parameters
    ----------
    good : sequence of Judged
        The epoch's good runs, in time order.
    reference : Run
        Of the epoch.
    found : Chart
        Of these runs.
    model : CalibratedAxis
        Of the axis.
    settings : MonitorSettings
        What is plausible.

    Returns
    -------
    tuple of HistoryCause
        The most probable first.
    """
    odds, words = dict.fromkeys(NAMES, 0.0), {name: list[str]() for name in NAMES}
    for name, chance in _cells(good[-_NEWEST:], reference, model, settings).items():
        odds[name] = math.log(max(chance, 1e-4))
    ramp, text = _course(found)
    for name in _PASSING:
        odds[name] -= ramp
    words["nut" if ramp > 0 else "load"].append(text)
    _by_friction(good, found, odds, words)
    _by_mass(good, found, odds, words)
    if not found.design.warm:
        words["temperature"].append("no run tells its temperature")
    words["bearing"].append("frequencies cannot tell a bearing that grows softer from the nut")
    most = max(odds.values())
    parts = {name: math.exp(value - most) for name, value in odds.items()}
    whole = sum(parts.values())
    ranked = sorted(NAMES, key=lambda name: -parts[name])
    return tuple(
        HistoryCause(name, parts[name] / whole, "; ".join(words[name]) or _plain(name)) for name in ranked
    )


def _plain(name: str) -> str:
    return {
        "nut": "the cells changed as by the nut",
        "load": "the masses of the runs do not show another load",
        "temperature": "what the temperature does was learnt and is taken out",
        "lubrication": "an oil film makes a step that passes",
        "torque scale": "a torque constant moves no frequency",
        "sensor": "an accelerometer that moves makes a step",
        "controller": "a pole does not move with the servo's gains",
    }.get(name, "nothing speaks for it")


def _cells(
    newest: Sequence[Judged], reference: Run, model: CalibratedAxis, settings: MonitorSettings
) -> dict[str, float]:
    """What the cells of the newest runs say, mean of their probabilities."""
    kept = settings.assumptions
    chances = dict.fromkeys(NAMES, 0.0) | _OTHERS
    rest = 1 - sum(_OTHERS.values())
    told = [one for one in newest if one.change is not None and one.run.id != reference.id]
    for one in told:
        warmer = None
        if one.run.temperature_C is not None and reference.temperature_C is not None:
            warmer = one.run.temperature_C - reference.temperature_C
        masses = mass_changes(one.run, reference, model.model, kept)
        assert one.change is not None  # noqa: S101  asked for above
        for cause in compare_causes(gather_evidence(one.change, masses, kept, warmer=warmer)):
            chances[_OF_RUN[cause.name]] += rest * cause.probability / len(told)
    if not told:
        chances["nut"] += rest
    return chances


def _course(found: Chart) -> tuple[float, str]:
    """Log odds of a course that goes on against a step, and words.

    By the scatter about the better of the two: sharp runs lie on neither by what they tell of themselves.
    """
    of, count = found.design, len(found.design.days)
    weight = 1 / (of.noise * (found.scale[-1] / of.settings.scale) ** 2) if count else np.zeros(0)
    levels = found.lost - of.columns[:, 1:] @ found.coefficients[1:]
    left: dict[str, list[Array]] = {"ramp": [], "step": []}
    for begin in range(count - 1):
        after = np.maximum(of.days - of.days[begin], 0.0) / max(float(of.days[-1] - of.days[begin]), 1e-9)
        left["step"].append(_left(levels, (after > 0).astype(float), weight))
        left["ramp"] += [_left(levels, after**bend, weight) for bend in _BENDS]
    if not left["ramp"]:
        return 0.0, "too few runs to tell a course"
    scale = max(1.0, min(_scatter(one) for kind in left.values() for one in kind))
    best = {kind: min(_misfit(one / scale) for one in some) for kind, some in left.items()}
    odds = min(max((best["step"] - best["ramp"]) / 2, -_MOST), _MOST)
    if odds > 1:
        return odds, "the change goes on from run to run, as wear does"
    if odds < -1:
        return odds, "the change came at once, as wear does not"
    return odds, "whether the change goes on or came at once cannot be told yet"


def _left(levels: Array, shape: Array, weight: Array) -> Array:
    """Residuals over what they are told to be."""
    basis = np.stack([np.ones_like(shape), shape], axis=1) * np.sqrt(weight)[:, None]
    values = levels * np.sqrt(weight)
    return np.asarray(values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0])


def _scatter(left: Array) -> float:
    """Root mean square, an odd run or two left out: level, shape and onset are fitted."""
    kept = np.sort(left**2)[: max(math.ceil(0.9 * len(left)), 1)]
    return math.sqrt(float(kept.sum()) / max(len(kept) - 3, 1))


def _misfit(left: Array) -> float:
    return float(np.sum(np.minimum(left**2, _FAR**2)))


def _by_friction(
    good: Sequence[Judged], found: Chart, odds: dict[str, float], words: dict[str, list[str]]
) -> None:
    change = _change([one.reading.friction for one in good], found, _OIL)
    if change is None:
        return
    value, spread = change
    loss = 1 - (1 - min(max(_newest(found), 0.0), 1.0)) ** 3
    likely = [
        _normal(value - math.log1p(-share * loss), spread) for share in np.linspace(_DRAG[0], _DRAG[1], 16)
    ]
    told = math.log(max(float(np.mean(likely)), 1e-12) / max(_normal(value, spread), 1e-12))
    told = min(max(told, -_MOST), _MOST)
    odds["nut"] += told
    size = f"{100 * abs(math.expm1(value)):.1f} % ± {100 * spread:.1f} %"
    if told > 0.5:
        words["nut"].append(f"friction fell by {size}, as a nut with less preload drags less")
        words["bearing"].append("friction fell, which a bearing does not do")
    elif told < -0.5:
        words["nut"].append("friction did not fall, as that of a nut with less preload would")
        words["lubrication"].append(f"friction changed by {size}")
    else:
        words["nut"].append("friction does not tell yet")


def _by_mass(
    good: Sequence[Judged], found: Chart, odds: dict[str, float], words: dict[str, list[str]]
) -> None:
    change = _change([one.reading.equivalent_mass for one in good], found, _MASS)
    if change is None:
        return
    value, spread = change
    moved = _normal(value, math.hypot(spread, 0.02)) / max(_normal(value, spread), 1e-12)
    told = min(max(math.log(max(moved, 1e-12)), -_MOST), _MOST)
    for name in ("load", "torque scale"):
        odds[name] += told
    if told > 0.5:
        text = f"the equivalent mass changed by {100 * math.expm1(value):+.2f} %"
        words["load"].append(text)
        words["torque scale"].append(text)
    elif told < -0.5:
        words["load"].append("the equivalent mass has not changed")


def _change(values: Sequence[float], found: Chart, floor: float) -> tuple[float, float] | None:
    """Newest runs against the baseline: change of the logarithm and its standard uncertainty."""
    told = np.array(values)
    usable = told > 0
    before = np.log(told[found.baseline][usable[found.baseline]])
    after = np.log(told[-_NEWEST:][usable[-_NEWEST:]])
    if len(before) < 2 or not len(after):
        return None
    spread = float(np.std(before, ddof=1)) * math.sqrt(1 / len(before) + 1 / len(after))
    return float(after.mean() - before.mean()), math.hypot(spread, floor)


def _newest(found: Chart) -> float:
    levels = found.lost - found.design.columns @ found.coefficients
    return float(np.mean(levels[-_NEWEST:]))


def _normal(value: float, spread: float) -> float:
    return math.exp(-0.5 * (value / spread) ** 2) / spread
