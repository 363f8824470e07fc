"""The nut's own preload: the axial stiffness without the change of the support bearing.

Nut and support bearing are springs in series at every stop and load, so frequencies determine only the sum of
their compliances, and with it the preload ratio that the nut would have if nothing else had changed. The
nut's own ratio is uncertain by the bearing's change since the reference, unless the user states this change,
or the nut's softening under load is known in both runs: it depends on the nut's load over its preload, and
not on the bearing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ballscrew.axis.hertz import RELEASE
from ballscrew.base.arrays import Array
from ballscrew.base.quantity import NORMAL_95, Quantity
from ballscrew.calibration.anchors import SOFTENING_REPEATS
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.estimation.causes import (
    UNDECIDED,
    CauseEvidence,
    PossibleCause,
    compare_causes,
    describe_cause,
)
from ballscrew.estimation.change import ComplianceChange
from ballscrew.estimation.fusion import FusedChange
from ballscrew.modal.cell import CellResult
from ballscrew.modal.run import SOFTENING_SPREAD, Run

_NUT_AND_BEARING = ("nut", "bearing", "both")
_UPPER_95 = 1.645  # standard deviations from the mean to a one-sided 95 % limit
# Difference of two results, in its standard uncertainties, beyond which they exclude each other: by chance it
# is larger in one of a hundred runs (2.576 for a normal distribution).
_MOST_DEVIATIONS = 2.6


@dataclass(frozen=True, slots=True)
class NutEvidence:
    """Knowledge of nut and support bearing beside the axial stiffness.

    Parameters
    ----------
    bearing_spread : float
        Standard deviation of the change of ln k_b since the reference; k_b is the bearing's rigidity.
    stated : bool
        Whether the user has stated this change.
    log_ratio, log_ratio_spread : float or None
        ln(P/P₀) of the nut by its softening under load, and its standard uncertainty; None where run or
        baseline has no softening, or where this uncertainty exceeds that by the bearing's change.
    """

    bearing_spread: float
    stated: bool
    log_ratio: float | None = None
    log_ratio_spread: float | None = None

    @property
    def separates(self) -> bool:
        """Whether a change of the nut is distinguishable from one of the bearing."""
        return self.stated or self.log_ratio is not None

    @property
    def softening(self) -> tuple[float, float] | None:
        """The nut's u − 1 by the softening, u = (P/P₀)^(−1/3), and its standard uncertainty; or None."""
        if self.log_ratio is None or self.log_ratio_spread is None:
            return None
        u = math.exp(-self.log_ratio / 3)
        return u - 1, u * self.log_ratio_spread / 3


@dataclass(frozen=True, slots=True)
class NutOrBearing:
    """Whether the nut, the support bearing or both have changed the axial stiffness.

    Parameters
    ----------
    nut, bearing, both : float or None
        Probability that the nut, the bearing, or both have changed; their sum is 1. None where the stiffness
        has not changed significantly, or nothing separates the two.
    text : str
        The result and its evidence in words.
    """

    nut: float | None
    bearing: float | None
    both: float | None
    text: str

    @property
    def identifiable(self) -> bool:
        """Whether nut and bearing are distinguished."""
        return self.nut is not None

    def to_json(self) -> dict[str, Any]:
        """Object ``nut_or_bearing`` in the output of ``preload --json``."""
        probabilities = {"nut": self.nut, "bearing": self.bearing, "both": self.both}
        return {"identifiable": self.identifiable, **probabilities, "text": self.text}


def merge_nut_and_bearing(
    causes: Sequence[PossibleCause], evidence: NutEvidence
) -> tuple[PossibleCause, ...]:
    """Merge nut, support bearing and both into one cause, where nothing separates them.

    Their probabilities would otherwise be those assumed beforehand.

    Parameters
    ----------
    causes : sequence of PossibleCause
        By :func:`~ballscrew.estimation.causes.compare_causes`; nut, bearing and both are among them.
    evidence : NutEvidence
        Of nut and bearing.

    Returns
    -------
    tuple of PossibleCause
        The most probable first.
    """
    if evidence.separates:
        return tuple(causes)
    axial, others = {}, []
    for cause in causes:
        if cause.name in _NUT_AND_BEARING:
            axial[cause.name] = cause
        else:
            others.append(cause)
    undecided = replace(
        axial["nut"],
        name=UNDECIDED,
        probability=sum(cause.probability for cause in axial.values()),
        text=describe_cause(UNDECIDED, axial["nut"].amount),
    )
    return tuple(sorted([undecided, *others], key=lambda cause: -cause.probability))


def attribute_change(
    observations: CauseEvidence, evidence: NutEvidence, assumptions: Assumptions, *, changed: bool
) -> NutOrBearing:
    """Attribute a change of the axial stiffness to nut, support bearing, or both.

    Parameters
    ----------
    observations : CauseEvidence
        Of the run, with the load corrected.
    evidence : NutEvidence
        Of nut and bearing.
    assumptions : Assumptions
        Prior probabilities of the three.
    changed : bool
        Whether the stiffness has changed significantly.

    Returns
    -------
    NutOrBearing
        Probabilities of the three among themselves; their sum is 1.
    """
    if not changed:
        return NutOrBearing(None, None, None, "the stiffness has not changed significantly")
    if not evidence.separates:
        text = "not identifiable: nothing in these recordings separates the nut from the support bearing"
        return NutOrBearing(None, None, None, text)
    signatures = {name: observations.signatures[name] for name in _NUT_AND_BEARING}
    causes = compare_causes(replace(observations, signatures=signatures), assumptions)
    probabilities = {cause.name: cause.probability for cause in causes}
    nut, bearing, both = (probabilities[name] for name in _NUT_AND_BEARING)
    sources = []
    if evidence.log_ratio is not None:
        sources.append("the nut's softening under load in both runs")
    if evidence.stated:
        sources.append("the stated drift of the bearing")
    text = f"nut {nut:.2f}, support bearing {bearing:.2f}, both {both:.2f}; by {' and '.join(sources)}"
    return NutOrBearing(nut, bearing, both, text)


def nut_evidence(
    run: Run,
    baselines: Sequence[Run],
    model: CalibratedAxis,
    assumptions: Assumptions,
    bearing_over_nut: float,
) -> NutEvidence:
    """Evidence of a run and its baseline on nut and support bearing.

    Parameters
    ----------
    run : Run
        Analysed.
    baselines : sequence of Run
        Runs of one state that the change refers to; may be empty.
    model : CalibratedAxis
        Of the axis, with the mass that the nut accelerates.
    assumptions : Assumptions
        With the change of the bearing.
    bearing_over_nut : float
        Compliance of the bearing over the nut's.

    Returns
    -------
    NutEvidence
        By :func:`evidence_by_softening`.
    """
    of_run = log_preload_by_softening(run, model.nut_mass)
    of_baselines = [log_preload_by_softening(base, model.nut_mass) for base in baselines]
    return evidence_by_softening(of_run, of_baselines, assumptions, bearing_over_nut)


def evidence_by_softening(
    of_run: tuple[float, float] | None,
    of_baselines: Sequence[tuple[float, float] | None],
    assumptions: Assumptions,
    bearing_over_nut: float,
) -> NutEvidence:
    """Evidence of a run and its baseline on nut and support bearing, given the nut's softening in both.

    Parameters
    ----------
    of_run : tuple of float or None
        ln P by the softening of the run, and its standard uncertainty, as :func:`log_preload_by_softening`
        returns them.
    of_baselines : sequence of tuple of float or None
        The same of each run of the baseline.
    assumptions : Assumptions
        With the change of the bearing.
    bearing_over_nut : float
        Compliance of the bearing over the nut's.

    Returns
    -------
    NutEvidence
        ln(P/P₀) is the difference from the mean of the baseline's runs. In it the repeating part of the error
        of the softening's law cancels, and the noise of run and baseline does not. Where the softening
        separates nut and bearing and the user states nothing, the bearing may have changed by as much as is
        plausible of a worn one.
    """
    bearing_spread = assumptions.bearing_spread
    stated = assumptions.bearing_drift is not None
    known = [base for base in of_baselines if base is not None]
    if of_run is None or not known:
        return NutEvidence(bearing_spread, stated)
    log_preload, spread = of_run
    base_log_preloads, base_spreads = np.array(known).T
    # Part of each uncertainty that is the error of the law. The part of its variance that repeats is the same
    # error in all runs, and only the difference of its sizes counts.
    law = min(spread, SOFTENING_SPREAD)
    base_laws = np.minimum(base_spreads, SOFTENING_SPREAD)
    independent = spread**2 - SOFTENING_REPEATS * law**2
    independent += float(np.mean(base_spreads**2 - SOFTENING_REPEATS * base_laws**2)) / len(known)
    log_ratio_spread = math.sqrt(independent + SOFTENING_REPEATS * (law - float(np.mean(base_laws))) ** 2)
    by_bearing = 3 * bearing_over_nut * assumptions.bearing_spread  # of ln P: d ln P = −3 du at u = 1
    if log_ratio_spread > by_bearing:
        return NutEvidence(bearing_spread, stated)
    if not stated:
        bearing_spread = max(bearing_spread, assumptions.priors.bearing_size)
    log_ratio = log_preload - float(np.mean(base_log_preloads))
    return NutEvidence(bearing_spread, stated, log_ratio, log_ratio_spread)


def log_preload_by_softening(run: Run, nut_mass: float) -> tuple[float, float] | None:
    """Logarithm of the preload by the nut's softening under load.

    The constant error of an axis in it cancels in the difference of two runs.

    Parameters
    ----------
    run : Run
        Analysed.
    nut_mass : float
        Mass that the nut accelerates without a load on the table, kg.

    Returns
    -------
    tuple of float or None
        ln P, P in N, and its standard uncertainty; None where the run does not determine the softening.
    """
    softening = run.mass_over_preload_kg_per_N
    if softening is None or not (softening.value > 0 and softening.standard_uncertainty > 0):
        return None
    mass = nut_mass + (run.mass_kg or 0.0)
    return math.log(mass / softening.value), softening.standard_uncertainty / softening.value


def nut_quantity(stiffness: Quantity, bearing_over_nut: float, evidence: NutEvidence) -> Quantity | None:
    """P/P₀ of the nut from that of the stiffness, in linear approximation.

    Parameters
    ----------
    stiffness : Quantity
        Axial stiffness as P/P₀.
    bearing_over_nut : float
        Compliance of the bearing over the nut's.
    evidence : NutEvidence
        Of nut and bearing.

    Returns
    -------
    Quantity or None
        None where its interval has no upper end.
    """
    u, variance = _u_by_stiffness(stiffness, bearing_over_nut, evidence)
    if evidence.softening is not None:  # mean of the two results, weighted by their inverse variances
        level, softening_spread = evidence.softening
        difference = 1 + level - u
        excess = _excess_variance(difference, variance + softening_spread**2)
        variance += excess
        weight = variance / (variance + softening_spread**2 + excess)
        u += weight * difference
        variance *= 1 - weight
    spread = math.sqrt(variance)
    half = NORMAL_95 * spread
    if not u > half:
        return None
    interval = ((u + half) ** -3, (u - half) ** -3)
    return Quantity(u**-3, 3 * spread * u**-4, "", interval)  # dP/P₀ = −3 u⁻⁴ du


def _u_by_stiffness(
    stiffness: Quantity, bearing_over_nut: float, evidence: NutEvidence
) -> tuple[float, float]:
    """The nut's u by the stiffness, and its variance, which includes that by the bearing's change."""
    u = stiffness.value ** (-1 / 3)
    own = u * stiffness.standard_uncertainty / (3 * stiffness.value)  # du = −u/3 d ln P
    return u, own**2 + (bearing_over_nut * evidence.bearing_spread) ** 2


def _excess_variance(difference: float, variance: float) -> float:
    """Variance to be added to each of two results that exclude each other; else 0.

    ``difference`` is that of the results, and ``variance`` its variance by their own uncertainties. The
    variance is estimated by the method of moments (DerSimonian and Laird, 1986, DOI
    10.1016/0197-2456(86)90046-2).
    """
    if difference**2 <= _MOST_DEVIATIONS**2 * variance:
        return 0.0
    return (difference**2 - variance) / 2


def describe_contradiction(stiffness: Quantity, bearing_over_nut: float, evidence: NutEvidence) -> str:
    """Reason to doubt the nut's preload where stiffness and softening exclude each other; else empty.

    Parameters
    ----------
    stiffness, bearing_over_nut, evidence
        As for :func:`nut_quantity`.

    Returns
    -------
    str
        A sentence without full stop, or an empty text.
    """
    if evidence.softening is None:
        return ""
    level, spread = evidence.softening
    u, variance = _u_by_stiffness(stiffness, bearing_over_nut, evidence)
    if not _excess_variance(1 + level - u, variance + spread**2):
        return ""
    return (
        f"the axial stiffness (as P/P₀ {stiffness.value:.2f}) and the nut's softening under load "
        f"({(1 + level) ** -3:.2f}) exclude each other, whatever a worn support bearing does: compare "
        "loads and motions of the two runs, and check the bearing"
    )


def describe_unidentifiable(bearing_over_nut: float) -> str:
    """Reason why a change is not attributed to the nut, with the bearing's effect and what to do.

    Parameters
    ----------
    bearing_over_nut : float
        Compliance of the bearing over the nut's.

    Returns
    -------
    str
        A sentence without full stop.
    """
    # Growth of a bearing's compliance by the loss of a tenth of its preload: Hertz, as of the nut.
    softer = 0.9 ** (-1 / 3) - 1
    loss = 100 * (1 - (1 + bearing_over_nut * softer) ** -3)
    return (
        "not identifiable: whether the nut or the support bearing has changed cannot be decided from these "
        f"recordings (a bearing that lost 10 % of its own preload acts as {loss:.0f} % less preload of the "
        "nut). Record baseline and later runs at two acceleration levels, check the bearing's preload or "
        "friction torque, or state the bearing's largest change with --bearing-drift"
    )


def bearing_over_nut(change: ComplianceChange, fused: FusedChange) -> float:
    """Compliance of the support bearing over that of the nut, in the state of the reference.

    Mean over the cells, with the weights of the fusion.

    Parameters
    ----------
    change : ComplianceChange
        With the shares of nut and bearing in n cells.
    fused : FusedChange
        With the weights of these cells.

    Returns
    -------
    float
        Ratio of the two mean shares.
    """
    return float(change.bearing_share @ fused.weights) / float(change.nut_share @ fused.weights)


def nut_ratios(
    ratios: Array, bearing_over_nut: Array, evidence: NutEvidence, normal: Array, shift: float
) -> tuple[Array, float]:
    """Samples of the nut's P/P₀ from those by the axial stiffness.

    Parameters
    ----------
    ratios : ndarray, shape (n,)
        P/P₀ by the stiffness; infinite where nothing bounds it.
    bearing_over_nut : ndarray, shape (n,)
        Samples of the compliance of the bearing over the nut's.
    evidence : NutEvidence
        Of nut and bearing.
    normal : ndarray, shape (n, 2)
        Standard-normal numbers for the bearing's change and for the error of the softening.
    shift : float
        Change of ln P by the temperature, for which ``ratios`` are corrected, and ``evidence`` is not.

    Returns
    -------
    ratios : ndarray, shape (n,)
        P/P₀ of the nut; infinite where nothing bounds it.
    weight : float
        Weight of the softening in the mean of u = (P/P₀)^(−1/3), 0 to 1.
    """
    # A change z of ln k_b multiplies the bearing's compliance by e^−z.
    bearing_change = np.expm1(-evidence.bearing_spread * normal[:, 0])
    u = np.power(ratios, -1 / 3) - bearing_over_nut * bearing_change
    weight = 0.0
    if evidence.log_ratio is not None and evidence.log_ratio_spread is not None:
        log_ratios = evidence.log_ratio - shift + evidence.log_ratio_spread * normal[:, 1]
        u_by_softening = np.exp(-log_ratios / 3)
        variances = np.array([np.var(u), np.var(u_by_softening)])
        difference = float(np.mean(u_by_softening) - np.mean(u))
        excess = _excess_variance(difference, float(variances.sum()))
        u = _add_variance(u, excess)
        u_by_softening = _add_variance(u_by_softening, excess)
        weight = float((variances[0] + excess) / (variances.sum() + 2 * excess))
        u = u + weight * (u_by_softening - u)
    return np.power(u, -3.0, out=np.full_like(u, np.inf), where=u > 0), weight


def _add_variance(samples: Array, excess: float) -> Array:
    """Samples with the same mean and a variance larger by ``excess``."""
    if not excess:
        return samples
    mean, variance = np.mean(samples), np.var(samples)
    return np.asarray(mean + (samples - mean) * np.sqrt(1 + excess / variance))


def describe_release(limit: float) -> str:
    """Reason why the nut's preload has only an upper limit; ``limit`` is that of :func:`ratio_below`."""
    return (
        "a flank of the nut loses contact under the test's own load, and the frequency hardly depends on the "
        f"preload: it is below {100 * limit:.0f} % of the baseline's"
    )


def ratio_below(limit: float, nut: Quantity | None = None) -> Quantity:
    """P/P₀ of a nut for which only an upper limit is known.

    Parameters
    ----------
    limit : float
        One-sided 95 % limit of P/P₀.
    nut : Quantity, optional
        P/P₀ by the frequencies, where the run has any.

    Returns
    -------
    Quantity
        Its interval is from 0 to the limit, and its value at most the limit. Without frequencies the value is
        half of the limit, and the standard uncertainty that of a uniform distribution in the interval.
    """
    if nut is None:
        nut = Quantity(limit / 2, limit / math.sqrt(12))
    return Quantity(min(nut.value, limit), nut.standard_uncertainty, "", (0.0, limit))


def release_limit(run: Run, baseline: Run | None, model: CalibratedAxis) -> float | None:
    """Upper limit of P/P₀ where the test's own load unloads the nut in most cells of a run.

    A flank loses contact at a load of 2.83 P (:data:`~ballscrew.axis.hertz.RELEASE`). The load is that of the
    baseline's cells, which state it over their own preload P₀.

    Parameters
    ----------
    run : Run
        Analysed.
    baseline : Run or None
        Analysed, with the same plan and load.
    model : CalibratedAxis
        Of the axis, with the uncertainty of the preload.

    Returns
    -------
    float or None
        One-sided 95 % limit; None where both flanks carry in half of the cells or more, or where no baseline
        states the load.
    """
    if baseline is None:
        return None
    measured = [cell for cell in run.cells if cell.frequency_Hz is not None or cell.nut_load_over_preload]
    unloaded = [cell for cell in measured if _is_unloaded(cell)]
    if len(unloaded) <= len(measured) / 2:
        return None
    limits = _release_ratios(unloaded, baseline)
    if not limits:
        return None
    # The limit is uncertain by ln P₀: by the model, or by the baseline's softening where it has one.
    spread = model.standard_uncertainty("preload")
    softening = baseline.mass_over_preload_kg_per_N
    if softening is not None and softening.value > 0:
        spread = softening.standard_uncertainty / softening.value
    return float(np.median(limits)) * math.exp(_UPPER_95 * spread)


def _release_ratios(cells: Sequence[CellResult], baseline: Run) -> list[float]:
    """P/P₀ at which the load of the baseline releases a flank, for each cell of which it states the load."""
    loads = {cell.key.rounded: cell.nut_load_over_preload for cell in baseline.cells}
    ratios = []
    for cell in cells:
        load = loads.get(cell.key.rounded)
        if load is not None:
            ratios.append(load / RELEASE)
    return ratios


def _is_unloaded(cell: CellResult) -> bool:
    """Whether a flank of the nut loses contact under the test's own load in a cell."""
    if cell.nut_load_over_preload is None:
        return "unloaded" in cell.reason_kinds
    return cell.nut_load_over_preload > RELEASE
