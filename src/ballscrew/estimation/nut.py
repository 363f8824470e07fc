"""The nut's own preload: the axial stiffness less what the support bearing may have done.

Nut and support bearing are springs in series at every stop and load, so frequencies give their sum alone:
the preload ratio that the nut would have if nothing else had changed. The nut's own ratio is uncertain by the
bearing's change since the reference, unless that is stated, or the nut's softening under load is known in
both runs: it depends on force over preload of the nut, and on no bearing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.calibration.anchors import SOFTENING_REPEATS
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.frequency_table import FrequencyTable
from ballscrew.estimation.causes import UNDECIDED, PossibleCause, describe_cause
from ballscrew.estimation.change import ComplianceChange
from ballscrew.estimation.fusion import FusedChange

_SEPARATE = ("nut", "bearing", "both")
_LEAST_PROBABILITY = 1e-300


@dataclass(frozen=True, slots=True)
class NutEvidence:
    """What is known of nut and support bearing beside the axial stiffness.

    Parameters
    ----------
    bearing_spread : float
        Standard deviation of ln k_b since the reference.
    stated : bool
        Whether the user has stated it.
    log_ratio, log_ratio_spread : float or None
        ln(P/P₀) of the nut by its softening under load, and its standard uncertainty; None where the
        softening is less certain than the bearing.
    """

    bearing_spread: float
    stated: bool
    log_ratio: float | None = None
    log_ratio_spread: float | None = None

    @property
    def separates(self) -> bool:
        """Whether a change of the nut is told from one of the bearing."""
        return self.stated or self.log_ratio is not None

    @property
    def softening(self) -> tuple[float, float] | None:
        """Nut's u − 1 by the softening, u = (P/P₀)^(−1/3), and its standard uncertainty."""
        if self.log_ratio is None or self.log_ratio_spread is None:
            return None
        u = math.exp(-self.log_ratio / 3)
        return u - 1, u * self.log_ratio_spread / 3


@dataclass(frozen=True, slots=True)
class NutOrBearing:
    """Share of nut and support bearing in a change of the axial stiffness.

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
        """Whether nut and bearing are told apart."""
        return self.nut is not None

    def to_json(self) -> dict[str, Any]:
        """Object ``nut_or_bearing`` in the output of ``preload --json``."""
        probabilities = {"nut": self.nut, "bearing": self.bearing, "both": self.both}
        return {"identifiable": self.identifiable, **probabilities, "text": self.text}


def attribute_change(
    causes: Sequence[PossibleCause], evidence: NutEvidence, *, changed: bool
) -> tuple[tuple[PossibleCause, ...], NutOrBearing]:
    """Attribute a change of the axial stiffness to nut, support bearing, or both.

    Parameters
    ----------
    causes : sequence of PossibleCause
        Compared, with nut, bearing and both.
    evidence : NutEvidence
        Of nut and bearing.
    changed : bool
        Whether the stiffness has changed significantly.

    Returns
    -------
    tuple of PossibleCause
        The same; where nothing separates the three, they are one cause, since their probabilities would be
        those assumed beforehand.
    NutOrBearing
        Their probabilities among the three.
    """
    three = {cause.name: cause for cause in causes if cause.name in _SEPARATE}
    total = sum(cause.probability for cause in three.values())
    if not evidence.separates:
        undecided = replace(
            three["nut"],
            name=UNDECIDED,
            probability=total,
            text=describe_cause(UNDECIDED, three["nut"].amount),
        )
        others = [cause for cause in causes if cause.name not in _SEPARATE]
        causes = sorted([undecided, *others], key=lambda cause: -cause.probability)
    if not changed:
        return tuple(causes), NutOrBearing(None, None, None, "the stiffness has not changed significantly")
    if not evidence.separates:
        text = "not identifiable: nothing in these recordings separates the nut from the support bearing"
        return tuple(causes), NutOrBearing(None, None, None, text)
    nut, bearing, both = (three[name].probability / max(total, _LEAST_PROBABILITY) for name in _SEPARATE)
    means = []
    if evidence.log_ratio is not None:
        means.append("the nut's softening under load in both runs")
    if evidence.stated:
        means.append("the stated drift of the bearing")
    text = f"nut {nut:.2f}, support bearing {bearing:.2f}, both {both:.2f}; by {' and '.join(means)}"
    return tuple(causes), NutOrBearing(nut, bearing, both, text)


def nut_evidence(
    run: FrequencyTable,
    baseline: FrequencyTable | None,
    model: CalibratedAxis,
    assumptions: Assumptions,
    bearing_over_nut: float,
) -> NutEvidence:
    """Evidence of a run against its baseline.

    Parameters
    ----------
    run, baseline : FrequencyTable
        The baseline may be None.
    model : CalibratedAxis
        For the mass that the nut accelerates.
    assumptions : Assumptions
        Drift of the bearing.
    bearing_over_nut : float
        Compliance of the bearing over the nut's.

    Returns
    -------
    NutEvidence
        The law of the softening errs alike in both runs and cancels; so does the correlated part of the rest.
        Where the softening separates the two and nothing is stated, the bearing may have changed by as much
        as is plausible of a worn one.
    """
    spread, stated = assumptions.bearing_spread, assumptions.bearing_drift is not None
    without = NutEvidence(spread, stated)
    if baseline is None or run.mass_over_preload is None or baseline.mass_over_preload is None:
        return without
    now, then = run.mass_over_preload, baseline.mass_over_preload
    own, other = now.standard_uncertainty / now.value, then.standard_uncertainty / then.value
    uncertainty = math.sqrt(own**2 + other**2 - 2 * SOFTENING_REPEATS * own * other)
    if uncertainty > 3 * bearing_over_nut * assumptions.bearing_spread:
        return without
    mass_ratio = (model.nut_mass + run.load) / (model.nut_mass + baseline.load)
    log_ratio = math.log(mass_ratio) - math.log(now.value / then.value)
    if not stated:
        spread = max(spread, assumptions.priors.bearing_size)
    return NutEvidence(spread, stated, log_ratio, uncertainty)


def bearing_over_nut(change: ComplianceChange, fused: FusedChange) -> float:
    """Compliance of the support bearing over that of the nut, in the reference's state."""
    return float(change.bearing @ fused.weights) / float(change.nut @ fused.weights)


def nut_ratios(
    ratios: Array, bearing: Array, evidence: NutEvidence, normal: Array, shift: float
) -> tuple[Array, float]:
    """Samples of the nut's P/P₀ from those by the axial stiffness.

    Parameters
    ----------
    ratios : ndarray, shape (n,)
        By the stiffness; infinite where nothing bounds them.
    bearing : ndarray, shape (n,)
        Compliance of the bearing over the nut's.
    evidence : NutEvidence
        Of the run.
    normal : ndarray, shape (n, 2)
        Standard-normal numbers.
    shift : float
        ln P by the temperature, which is subtracted from the softening's ratio as from the others.

    Returns
    -------
    ndarray, shape (n,)
        Infinite where nothing bounds them.
    float
        Weight of the softening in u = (P/P₀)^(−1/3), 0 to 1.
    """
    # A bearing that is stiffer by a factor e^z is more compliant by e^−z − 1.
    u = np.power(ratios, -1 / 3) - bearing * np.expm1(-evidence.bearing_spread * normal[:, 0])
    weight = 0.0
    if evidence.log_ratio is not None and evidence.log_ratio_spread is not None:
        logarithms = evidence.log_ratio - shift + evidence.log_ratio_spread * normal[:, 1]
        softening = np.exp(-logarithms / 3)
        variance = float(np.var(u))
        weight = variance / (variance + float(np.var(softening)))
        u = u + weight * (softening - u)
    return np.power(u, -3.0, out=np.full_like(u, np.inf), where=u > 0), weight
