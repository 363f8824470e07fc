"""Causes of a change in the history of an axis, ranked by single runs and by the whole trend.

The newest runs are compared with the epoch's reference cell by cell, as a single run is. The trend adds
evidence that no single run has: wear progresses, while a load, a mounting or a scale changes at once; the
friction of a nut decreases with its preload; another load or torque scale changes the equivalent mass; grease
changes friction and little else. Nut and support bearing are one cause, unless the nut's softening under load
or a statement on the bearing separates them. Each kind of evidence adds a bounded amount to the log odds,
since none is exact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from scipy.special import logsumexp, softmax

from ballscrew.base.arrays import Array
from ballscrew.base.blocks import anchored_blocks
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.estimation.causes import AXIAL, UNDECIDED, compare_causes, gather_evidence
from ballscrew.estimation.mass_check import mass_changes
from ballscrew.estimation.nut import NutEvidence, evidence_by_softening
from ballscrew.modal.run import Run
from ballscrew.monitoring.assessment import AssessedRun
from ballscrew.monitoring.detection.chart import Chart
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.history import HistoryRow

NAMES = ("load", "temperature", "lubrication", "torque scale", "sensor", "controller")
"""Causes beside a change of the axial stiffness (:data:`~ballscrew.estimation.causes.AXIAL`)."""
# Cause of a change in a history, for each cause of a change between two runs.
_CAUSE_OF = {
    "nut": "nut",
    "local": "nut",
    "bearing": "bearing",
    "both": "both",
    "load": "load",
    "temperature": "temperature",
    "gradient": "nut",  # as a local change: in run after run it is uneven wear
    "torque": "torque scale",
    "position": "controller",
}
# Probabilities of causes that single runs cannot exclude.
_OTHERS = {"lubrication": 0.03, "sensor": 0.03, "controller": 0.02, "temperature": 0.03}
_LEAST_PROBABILITY = 1e-4  # of a cause by single runs
_NEWEST = 3  # runs that are compared with the baseline
_POOLED_FROM, _SINGLES = 60, 40  # runs of a trend from which on older ones are pooled, and those that are not
_EXPONENTS = (1.0, 1.5, 2.0)  # of time: wear by most laws is not quite linear
_BOUND = 3.0  # standard deviations: a larger residual counts as this, so that an outlier does not decide
_LARGEST_EVIDENCE = 4.0  # log odds that one kind of evidence adds at most
_CLEAR = 1.0  # log odds of a trend from which on it is stated
_NOTABLE = 0.5  # log odds of friction and mass from which on they are stated
_SUDDEN = ("load", "sensor", "controller", "lubrication", "torque scale")  # they change at once
_DRAG_SHARES = np.linspace(0.05, 0.8, 16)  # part of the friction that is the nut's drag
_OIL = 0.03  # least uncertainty of ln friction: oil and temperature change it slowly
_MASS = 1e-3  # least uncertainty of a change of ln equivalent mass
_OTHER_MASS = 0.02  # standard deviation of ln equivalent mass by another load or torque scale
_FOR, _AGAINST, _UNCLEAR = "for", "against", "unclear"  # evidence of a cause
_DEFAULT_EVIDENCE = {
    "nut": (_FOR, "the cells changed as expected of a softer nut"),
    "bearing": (_FOR, "the nut's softening under load has not changed as that of a worn nut"),
    "both": (_FOR, "the nut's softening under load has changed by less than the stiffness"),
    UNDECIDED: (_FOR, "the cells changed as expected of a softer nut or support bearing"),
    "load": (_AGAINST, "the masses of the runs show no other load"),
    "temperature": (_AGAINST, "the effect of the temperature is estimated and removed"),
    "lubrication": (_AGAINST, "an oil film causes a step that does not last"),
    "torque scale": (_AGAINST, "frequencies do not depend on the torque constant"),
    "sensor": (_UNCLEAR, "a displaced accelerometer causes a step"),
    "controller": (_AGAINST, "the natural frequency does not depend on the gains of the servo"),
}
_BY_CELLS = {
    "controller": "the cells changed as if the zero of the axis had moved",
    "temperature": "the cells changed as at another temperature than the stated one",
}
"""Evidence for a cause whose probability by the cells exceeds that of :data:`_OTHERS`."""


@dataclass(frozen=True, slots=True)
class HistoryCause:
    """Cause of a change, and the evidence for and against it.

    Parameters
    ----------
    cause : str
        One of :data:`NAMES`, or of :data:`~ballscrew.estimation.causes.AXIAL`.
    probability : float
        Relative to the other causes; all sum to 1.
    evidence : str
        Evidence in words, a sentence for each kind, with ``;`` between them. Each begins with ``for:``,
        ``against:``, or ``unclear:`` where it is neither.
    """

    cause: str
    probability: float
    evidence: str


class _Evidence:
    """Log odds and sentences of each cause."""

    def __init__(self, probabilities: dict[str, float]) -> None:
        self.log_odds = {name: math.log(max(p, _LEAST_PROBABILITY)) for name, p in probabilities.items()}
        self.sentences: dict[str, list[str]] = {name: [] for name in probabilities}
        self.axial = tuple(name for name in AXIAL if name in probabilities)

    def add(self, names: Sequence[str], log_odds: float) -> None:
        for name in names:
            self.log_odds[name] += log_odds

    def note(self, name: str, sign: str, sentence: str) -> None:
        self.sentences[name].append(f"{sign}: {sentence}")

    def note_axial(self, sign: str, sentence: str) -> None:
        """Note on the first cause that is a change of the stiffness."""
        self.note(self.axial[0], sign, sentence)

    def ranked(self) -> tuple[HistoryCause, ...]:
        """Causes by their probability, the most probable first."""
        causes = []
        for name, probability in zip(self.log_odds, softmax(list(self.log_odds.values())), strict=True):
            if not self.sentences[name]:
                self.note(name, *_DEFAULT_EVIDENCE[name])
            evidence = "; ".join(self.sentences[name])
            causes.append(HistoryCause(name, float(probability), evidence))
        return tuple(sorted(causes, key=attrgetter("probability"), reverse=True))


def history_causes(
    good: Sequence[HistoryRow],
    newest: Sequence[AssessedRun],
    reference: Run,
    chart: Chart,
    model: CalibratedAxis,
    settings: MonitorSettings,
) -> tuple[HistoryCause, ...]:
    """Rank the causes of the change of the level since the baseline.

    Parameters
    ----------
    good : sequence of HistoryRow
        The epoch's good runs, in time order.
    newest : sequence of AssessedRun
        The newest of them, with the changes of their cells.
    reference : Run
        Reference run of the epoch.
    chart : Chart
        Chart of these runs.
    model : CalibratedAxis
        The axis.
    settings : MonitorSettings
        Limits of plausibility.

    Returns
    -------
    tuple of HistoryCause
        The most probable first.
    """
    evidence_of = {row.reading.run: evidence_of_nut(row, good, chart, settings) for row in good[-_NEWEST:]}
    newest = [assessed for assessed in newest if assessed.run.id != reference.id]
    of_nut = [evidence_of[assessed.run.id] for assessed in newest]
    probabilities = _probabilities_by_cells(newest, of_nut, reference, model, settings)
    evidence = _Evidence(probabilities)
    for name, sentence in _BY_CELLS.items():
        if probabilities[name] > 2 * _OTHERS[name]:
            evidence.note(name, _FOR, sentence)
    _add_trend(evidence, chart)
    _add_friction(evidence, good, chart)
    _add_mass(evidence, good, chart)
    if not chart.design.has_temperature:
        evidence.note("temperature", _UNCLEAR, "no run has a temperature")
    if UNDECIDED in evidence.axial:
        evidence.note_axial(
            _UNCLEAR,
            "frequencies and friction cannot separate a softer bearing from a softer nut: runs at two "
            "acceleration levels, or a check of the bearing, can",
        )
    return evidence.ranked()


def evidence_of_nut(
    row: HistoryRow, good: Sequence[HistoryRow], chart: Chart, settings: MonitorSettings
) -> NutEvidence:
    """Evidence of nut and support bearing in a run against the baseline of its epoch.

    Parameters
    ----------
    row : HistoryRow
        The run.
    good : sequence of HistoryRow
        The epoch's good runs, in time order.
    chart : Chart
        Of these runs.
    settings : MonitorSettings
        With the assumptions on the bearing.

    Returns
    -------
    NutEvidence
        Without the softening where the run has no change.
    """
    then, ratio = [good[i].softening for i in chart.baseline], row.bearing_over_nut
    if math.isnan(ratio):
        ratio = 0.0
    return evidence_by_softening(row.softening, then, settings.assumptions, ratio)


def _probabilities_by_cells(
    newest: Sequence[AssessedRun],
    of_nut: Sequence[NutEvidence],
    reference: Run,
    model: CalibratedAxis,
    settings: MonitorSettings,
) -> dict[str, float]:
    """Probability of each cause by the cells of the newest runs, mean over the runs."""
    assumptions = settings.assumptions
    separates = len(of_nut) > 0 and all(evidence.separates for evidence in of_nut)
    axial = ("nut", "bearing", "both") if separates else (UNDECIDED,)
    probabilities = dict.fromkeys((*axial, *NAMES), 0.0)
    probabilities.update(_OTHERS)
    rest = 1 - sum(_OTHERS.values())
    runs = []
    for assessed, evidence in zip(newest, of_nut, strict=True):
        if assessed.change is not None:
            runs.append((assessed.run, assessed.change, evidence.softening))
    for run, change, softening in runs:
        difference = None
        if run.temperature_C is not None and reference.temperature_C is not None:
            difference = run.temperature_C - reference.temperature_C
        masses = mass_changes(run, reference, model.model, assumptions)
        observations = gather_evidence(
            change, masses, assumptions, temperature_difference=difference, softening=softening
        )
        for cause in compare_causes(observations, assumptions):
            name = _CAUSE_OF[cause.name]
            if name in AXIAL and not separates:
                name = UNDECIDED
            probabilities[name] += rest * cause.probability / len(runs)
    if not runs:
        probabilities[axial[0]] += rest
    return probabilities


def trend_evidence(chart: Chart) -> tuple[float, str]:
    """Log odds of a progressing change against a step, and a sentence.

    Parameters
    ----------
    chart : Chart
        Chart of an epoch.

    Returns
    -------
    log_odds : float
        Positive for a progressing change. Residuals count relative to the scatter about the best fit, since
        neither shape fits runs of very small stated uncertainty.
    sentence : str
        Without a full stop.
    """
    if len(chart.design.days) < 2:
        return 0.0, "there are too few runs for a trend"
    days, corrected, weight = _pooled_trend(chart)
    count = len(days)
    ramps, steps = [], []
    for begin in range(count - 1):
        elapsed = np.maximum(days - days[begin], 0.0) / max(float(days[-1] - days[begin]), 1e-9)
        steps.append(_residuals(corrected, (elapsed > 0).astype(float), weight))
        ramps += [_residuals(corrected, elapsed**exponent, weight) for exponent in _EXPONENTS]
    scale = max(1.0, min(map(_scatter, [*ramps, *steps])))
    log_odds = _bounded((_least_misfit(steps, scale) - _least_misfit(ramps, scale)) / 2)
    if log_odds > _CLEAR:
        return log_odds, "the change progresses from run to run, as wear does"
    if log_odds < -_CLEAR:
        return log_odds, "the change came at once, as wear does not"
    return log_odds, "the runs do not show yet whether the change progresses or came at once"


def _add_trend(evidence: _Evidence, chart: Chart) -> None:
    """Add the evidence by the trend: it is against causes that change at once, or for them."""
    trend, sentence = trend_evidence(chart)
    evidence.add(_SUDDEN, -trend)
    if trend > _CLEAR:
        evidence.note_axial(_FOR, sentence)
        evidence.note("sensor", _AGAINST, sentence)
    elif trend > 0:
        evidence.note_axial(_UNCLEAR, sentence)
    elif trend >= -_CLEAR:
        evidence.note("load", _UNCLEAR, sentence)
    else:
        evidence.note("load", _FOR, sentence)
        evidence.note("sensor", _FOR, sentence)


def _pooled_trend(chart: Chart) -> tuple[Array, Array, Array]:
    """Days, levels without the effects of temperature and known steps, and weights; older runs are pooled."""
    design = chart.design
    weight = 1 / (design.noise * (chart.scale[-1] / design.settings.scale) ** 2)
    corrected = chart.lost - design.columns[:, 1:] @ chart.coefficients[1:]
    if len(weight) <= _POOLED_FROM:
        return design.days, corrected, weight
    starts = anchored_blocks(len(weight), _SINGLES)
    whole = np.add.reduceat(weight, starts)
    days, level = (np.add.reduceat(weight * values, starts) / whole for values in (design.days, corrected))
    return days, level, whole


def _residuals(levels: Array, shape: Array, weight: Array) -> Array:
    """Residuals of a weighted least-squares fit of a constant and a shape, over their stated uncertainty."""
    basis = np.stack([np.ones_like(shape), shape], axis=1) * np.sqrt(weight)[:, None]
    values = levels * np.sqrt(weight)
    return np.asarray(values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0])


def _scatter(residuals: Array) -> float:
    """Root mean square without the largest tenth: level, shape and onset are fitted."""
    count = max(math.ceil(0.9 * len(residuals)), 1)
    squares = np.sort(residuals**2)[:count]
    return math.sqrt(float(squares.sum()) / max(count - 3, 1))


def _least_misfit(fits: Sequence[Array], scale: float) -> float:
    """Least sum of squares of some fits, outliers bounded."""
    return min(float(np.sum(np.minimum((residuals / scale) ** 2, _BOUND**2))) for residuals in fits)


def _add_friction(evidence: _Evidence, good: Sequence[HistoryRow], chart: Chart) -> None:
    """Add the evidence by friction: its change, against that expected from the lost preload.

    The nut's drag is proportional to the preload. Its share of the friction is not known: the density is the
    mean over all shares.
    """
    change = _log_change(np.array([row.reading.friction for row in good]), chart, _OIL)
    if change is None:
        return
    value, spread = change
    cube_root = 1 - min(max(_newest_loss(chart), 0.0), 1.0)
    expected = np.log1p(-_DRAG_SHARES * (1 - cube_root**3))
    worn = logsumexp(_log_normal(value - expected, spread)) - math.log(len(expected))
    log_odds = _bounded(float(worn - _log_normal(value, spread)))
    evidence.add(evidence.axial, log_odds)
    size = f"{100 * abs(math.expm1(value)):.1f} % ± {100 * spread:.1f} %"
    if log_odds > _NOTABLE:
        evidence.note_axial(_FOR, f"friction decreased by {size}, as that of a nut with less preload does")
    elif log_odds < -_NOTABLE:
        evidence.note_axial(_AGAINST, "friction did not decrease, as that of a nut with less preload would")
        evidence.note("lubrication", _FOR, f"friction changed by {size}")
    else:
        evidence.note_axial(_UNCLEAR, "friction is not conclusive yet")


def _add_mass(evidence: _Evidence, good: Sequence[HistoryRow], chart: Chart) -> None:
    """Add the evidence by the equivalent mass: its change, against that by another load or torque scale."""
    change = _log_change(np.array([row.reading.equivalent_mass for row in good]), chart, _MASS)
    if change is None:
        return
    value, spread = change
    log_odds = _bounded(_log_normal(value, math.hypot(spread, _OTHER_MASS)) - _log_normal(value, spread))
    evidence.add(["load", "torque scale"], log_odds)
    if log_odds > _NOTABLE:
        sentence = f"the equivalent mass changed by {100 * math.expm1(value):+.2f} %"
        evidence.note("load", _FOR, sentence)
        evidence.note("torque scale", _FOR, sentence)
    elif log_odds < -_NOTABLE:
        evidence.note("load", _AGAINST, "the equivalent mass has not changed")


def _log_change(values: Array, chart: Chart, floor: float) -> tuple[float, float] | None:
    """Newest runs against the baseline: change of the logarithm and its standard uncertainty."""
    baseline, newest = values[chart.baseline], values[-_NEWEST:]
    before, after = np.log(baseline[baseline > 0]), np.log(newest[newest > 0])
    if len(before) < 2 or not len(after):
        return None
    spread = float(np.std(before, ddof=1)) * math.sqrt(1 / len(before) + 1 / len(after))
    return float(after.mean() - before.mean()), math.hypot(spread, floor)


def _newest_loss(chart: Chart) -> float:
    """Mean loss 1 − (P/P₀)^(1/3) of the newest runs."""
    loss = chart.lost - chart.design.columns @ chart.coefficients
    return float(np.mean(loss[-_NEWEST:]))


def _log_normal(value: Any, spread: float) -> Any:
    """Logarithm of the normal density of numbers, up to a constant."""
    return -0.5 * (value / spread) ** 2 - math.log(spread)


def _bounded(log_odds: float) -> float:
    return min(max(log_odds, -_LARGEST_EVIDENCE), _LARGEST_EVIDENCE)
