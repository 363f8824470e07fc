"""Possible causes of a change of the frequencies, compared by their evidence.

Each cause changes the compliance along the axis, the masses and the friction in proportions of its own, its
signature. The changes of a run since its baseline are one vector of observations with one covariance. A cause
adds its signature times an unknown amount, whose prior is normal with a plausible size as its standard
deviation. The observations then have a normal distribution, the density of which is the evidence for the
cause.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import softmax

from ballscrew.base.arrays import Array
from ballscrew.calibration.assumptions import DEFAULT_ASSUMPTIONS, Assumptions, Priors
from ballscrew.estimation.change import DECLARED_LOAD, POSITION, ComplianceChange, change_covariance
from ballscrew.estimation.fusion import misfit

UNITS: Mapping[str, str] = {"load": "kg", "position": "m"}
"""Units of the amounts by cause; the others are ratios."""

_SIMILAR_TO_NUT = ("nut", "bearing", "position", "temperature")
"""Causes whose signature along the axis is nearly that of the nut: a fit of both would not separate them."""

UNDECIDED = "nut or bearing"
"""Name of the cause where nothing separates nut and support bearing."""
AXIAL = ("nut", "bearing", "both", UNDECIDED)
"""Causes that are a change of the axial stiffness."""

_DESCRIPTIONS: Mapping[str, tuple[str, str, str]] = {
    "bearing": ("the support bearing, {percent} {side}", "stiffer", "softer"),
    "both": ("the nut and the support bearing, the bearing {percent} {side}", "stiffer", "softer"),
    "load": ("a load {size:.2g} kg {side} than declared", "heavier", "lighter"),
    "torque": ("a torque signal {percent} too {side}", "high", "low"),
    "position": ("a zero that has moved by {millimetres:+.1f} mm", "", ""),
    "temperature": ("temperature, {percent} of the preload", "", ""),
    "gradient": ("a screw that is warmer towards its {side} end, {percent} of the preload", "far", "near"),
    "local": ("a change at some stops and not at others", "", ""),
}
"""Text of each cause except the nut, and its ``side`` for a positive and for any other amount."""


@dataclass(frozen=True, slots=True)
class PossibleCause:
    """One cause and its evidence.

    Parameters
    ----------
    name : str
        nut, bearing, both (of these two), load, torque, position, temperature, gradient or local;
        "nut or bearing" where nothing separates the two.
    probability : float
        Among the causes compared, with their prior probabilities.
    chi2 : float
        χ² of all observations that the cause leaves unexplained.
    amount, standard_uncertainty : float
        Size of the cause in its unit: u − 1 of the nut, u = (P/P₀)^(−1/3); relative changes of bearing
        rigidity (also of both) and torque signal; additional load and shift of the zero; fall of ln P by the
        temperature; ln P at the far end less that at the near end for a gradient; root mean square of the
        changes of u for a change at some stops.
    unit : str
        Of the amount.
    possible : bool
        Whether the cause explains the cells, explains all observations about as well as the best of nut,
        bearing and both, has a plausible size and is significant.
    text : str
        Cause and amount in words.
    fit : float
        Probability of a misfit of the cells as large as with this cause, if it is the true one.
    """

    name: str
    probability: float
    chi2: float
    amount: float
    standard_uncertainty: float
    unit: str
    possible: bool
    text: str
    fit: float = 1.0

    def to_json(self) -> dict[str, Any]:
        """Row of ``causes`` in the output of ``preload --json``."""
        return {
            "cause": self.name,
            "probability": self.probability,
            "chi2": self.chi2,
            "amount": {
                "value": self.amount,
                "standard_uncertainty": self.standard_uncertainty,
                "unit": self.unit,
            },
            "fit": self.fit,
            "possible": self.possible,
            "text": self.text,
        }


@dataclass(frozen=True, slots=True)
class MassChanges:
    """Changes of masses and friction since the baseline, as differences of logarithms.

    Parameters
    ----------
    inertia, inertia_spread : float
        Change of ln equivalent mass beyond the declared change of the load, and its standard uncertainty.
    by_load : float
        Change of ln equivalent mass per kg of load, 1/kg: one over the mass with the declared load.
    frequency_ratio, frequency_ratio_spread : float or None
        Change of ln (f_free/f_held)², of the frequencies with the rotor free and held. The ratio depends on
        the masses alone.
    frequency_ratio_by_load : float
        Its change per kg, 1/kg.
    friction : tuple of (float, float)
        Changes of ln viscous and ln Coulomb friction, each with its standard uncertainty.
    moving_mass : float
        Of the model, with the load, kg.
    """

    inertia: float
    inertia_spread: float
    by_load: float
    frequency_ratio: float | None
    frequency_ratio_spread: float | None
    frequency_ratio_by_load: float
    friction: tuple[tuple[float, float], ...]
    moving_mass: float


@dataclass(frozen=True, slots=True, eq=False)
class CauseEvidence:
    """Observations of a run against its reference, with the signatures of the causes.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Y of each cell, then the changes of masses and friction.
    covariance : ndarray, shape (n, n)
        Of ``values``, without the error terms that are compared as causes; it can be inverted.
    signatures : mapping of str to ndarray, shape (k, n)
        Effect on ``values`` of each cause at its plausible size; k independent rows for a cause that can have
        several forms along the axis.
    sizes : mapping of str to float
        Plausible size of each cause, the standard deviation of its amount, in its unit.
    cell_covariance : ndarray, shape (m, m)
        Of the cells alone, with all error terms and without the floor.
    floor : ndarray, shape (m,)
        As of :class:`~ballscrew.estimation.change.ComplianceChange`.
    """

    values: Array
    covariance: Array
    signatures: dict[str, Array]
    sizes: dict[str, float]
    cell_covariance: Array
    floor: Array


@dataclass(frozen=True, slots=True)
class _CauseFit:
    """Fit of one cause: log evidence up to a constant, unexplained χ², and amount with its uncertainty.

    ``size`` and ``spread`` are the amount and its standard deviation over the plausible size.
    """

    log_evidence: float
    chi2: float
    size: float
    spread: float


def gather_evidence(
    change: ComplianceChange,
    masses: MassChanges | None,
    assumptions: Assumptions,
    *,
    temperature_difference: float | None = None,
    model_covariance: Array | None = None,
    softening: tuple[float, float] | None = None,
    load_corrected: bool = False,
) -> CauseEvidence:
    """Observations of a run, and the signature of each cause in them.

    Parameters
    ----------
    change : ComplianceChange
        Of the cells.
    masses : MassChanges or None
        Since the baseline, where both runs have masses.
    assumptions : Assumptions
        Plausible sizes of the causes.
    temperature_difference : float, optional
        Temperature of the run less the baseline's, K.
    model_covariance : ndarray, shape (7, 7), optional
        Of the model's working vector, where the reference is the model.
    softening : (float, float), optional
        u − 1 of the nut by its softening under load, and its standard uncertainty.
    load_corrected : bool
        Whether ``change`` is corrected for a wrong load: the load is then no cause, and its remaining error
        is part of the covariance.

    Returns
    -------
    CauseEvidence
        For :func:`compare_causes`.
    """
    priors = assumptions.priors
    # An error term that is compared as a cause has a signature, and is no part of the covariance.
    compared_terms = [POSITION]
    if not load_corrected:
        compared_terms.append(DECLARED_LOAD)
    cells = change_covariance(change, without=compared_terms)
    all_errors = change_covariance(change, floor=False)
    if model_covariance is not None and change.by_parameters is not None:
        by_model = change.by_parameters.T @ model_covariance @ change.by_parameters
        cells, all_errors = cells + by_model, all_errors + by_model
    # An undeclared load lowers ln P by the softening by its part of the moving mass, and du = −u/3 d ln P.
    softening_by_load = 1 / (3 * change.moving_mass)
    rows = _other_rows(masses, assumptions, softening, softening_by_load)
    count, added = len(change.y), len(rows)  # of cells, and of the other observations
    values, spreads, by_load, by_torque, by_nut = rows.T
    covariance = np.zeros((count + added, count + added))
    covariance[:count, :count] = cells
    covariance[range(count, count + added), range(count, count + added)] = spreads**2

    def in_cells(signature: Array) -> Array:
        """Signature in the cells, shape (n,) or (k, n), extended by 0 in the other observations."""
        return np.pad(np.atleast_2d(signature), ((0, 0), (0, added)))

    nut = np.concatenate([change.nut, by_nut])[None]
    sizes = {
        "nut": priors.nut_size,
        "bearing": assumptions.bearing_size,
        "both": assumptions.bearing_size,
        "load": assumptions.wrong_load * change.moving_mass,
        "position": priors.position_size,
        "local": priors.local_size,
    }
    signatures = {
        "nut": priors.nut_size * nut,
        # A bearing that is stiffer by a part δ is more compliant by −δ.
        "bearing": in_cells(-sizes["bearing"] * change.bearing),
        "both": in_cells(-sizes["both"] * change.bearing),  # the nut is added in the fit
    }
    if not load_corrected:
        signatures["load"] = (sizes["load"] * np.concatenate([change.by_load, by_load]))[None]
    if masses is not None:
        sizes["torque"] = assumptions.torque_constant
        signatures["torque"] = (sizes["torque"] * np.concatenate([np.zeros(count), by_torque]))[None]
    signatures["position"] = in_cells(priors.position_size * (1 + change.y) * change.slope)
    signatures["local"] = in_cells(_local_directions(change, priors))
    travel = float(np.ptp(change.position))
    if travel > 0:
        along = (change.position - change.position.mean()) / travel
        sizes["gradient"] = priors.gradient_size
        signatures["gradient"] = in_cells(-priors.gradient_size / 3 * along * change.nut)  # du = −d ln P/3
    if temperature_difference:
        sizes["temperature"] = assumptions.temperature * abs(temperature_difference)
        signatures["temperature"] = sizes["temperature"] / 3 * nut  # du = d/3 by a fall d of ln P
    observations = np.concatenate([change.y, values])
    return CauseEvidence(observations, covariance, signatures, sizes, all_errors, change.floor)


def compare_causes(
    evidence: CauseEvidence, assumptions: Assumptions = DEFAULT_ASSUMPTIONS
) -> tuple[PossibleCause, ...]:
    """Compare the causes.

    Nut and bearing are fitted each alone and together. The other causes with nearly the signature of the nut
    (zero of the position, temperature) are fitted alone, as alternatives to it. The remaining ones may
    accompany a worn nut, so they are fitted together with it.

    Parameters
    ----------
    evidence : CauseEvidence
        Of a run.
    assumptions : Assumptions
        Prior probabilities, and the probability of a misfit below which a cause does not explain the cells.

    Returns
    -------
    tuple of PossibleCause
        The most probable first.
    """
    priors, nut = assumptions.priors, evidence.signatures["nut"]
    fits = {}
    for name, own in evidence.signatures.items():
        directions = own
        if name not in _SIMILAR_TO_NUT:
            directions = np.vstack([own, nut])
        fits[name] = _fit_cause(evidence, directions, len(own))
    log_posteriors = [fit.log_evidence + math.log(priors.chances[name]) for name, fit in fits.items()]
    probabilities = softmax(log_posteriors).tolist()
    least_chi2 = min(fit.chi2 for name, fit in fits.items() if name in AXIAL)
    causes = []
    for (name, fit), probability in zip(fits.items(), probabilities, strict=True):
        significant = name == "nut" or abs(fit.size) > 2 * fit.spread
        # The size of a cause of several directions is never below 0, so the evidence decides; likewise for a
        # gradient, whose fit contains the nut.
        if len(evidence.signatures[name]) > 1 or name == "gradient":
            significant = fit.log_evidence > fits["nut"].log_evidence
        cell_fit = _probability_of_cells(evidence, name)
        explains_cells = cell_fit >= assumptions.false_alarm
        as_good_as_the_nut = fit.chi2 < least_chi2 + priors.as_good
        plausible = abs(fit.size) < priors.plausible
        amount = fit.size * evidence.sizes[name]
        causes.append(
            PossibleCause(
                name=name,
                probability=probability,
                chi2=fit.chi2,
                amount=amount,
                standard_uncertainty=fit.spread * evidence.sizes[name],
                unit=UNITS.get(name, ""),
                possible=explains_cells and as_good_as_the_nut and plausible and significant,
                text=describe_cause(name, amount),
                fit=cell_fit,
            )
        )
    return tuple(sorted(causes, key=lambda cause: -cause.probability))


def other_possible_causes(causes: Sequence[PossibleCause]) -> tuple[PossibleCause, ...]:
    """Causes other than a change of the axial stiffness that explain a run about as well."""
    return tuple(cause for cause in causes if cause.possible and cause.name not in AXIAL)


def describe_cause(name: str, amount: float) -> str:
    """Cause and amount in words.

    Parameters
    ----------
    name : str
        Of the cause.
    amount : float
        In its unit.

    Returns
    -------
    str
        For the middle of a sentence.
    """
    if name in ("nut", UNDECIDED):  # the amount is u − 1, and P/P₀ = u⁻³
        change = max(1 + amount, 0.1) ** -3 - 1
        size_of_change = f"{abs(100 * change):.1f} % {'more' if change > 0 else 'less'} preload"
        if name == "nut":
            return f"the nut, {size_of_change}"
        return f"the nut or the support bearing: axial stiffness as with {size_of_change} of the nut"
    size = abs(amount)
    digits = 1 if size >= 1e-3 else 2
    text, above, below = _DESCRIPTIONS.get(name, _DESCRIPTIONS["local"])
    return text.format(
        percent=f"{100 * size:.{digits}f} %",
        side=above if amount > 0 else below,
        size=size,
        millimetres=1e3 * amount,
    )


def _other_rows(
    masses: MassChanges | None,
    assumptions: Assumptions,
    softening: tuple[float, float] | None,
    softening_by_load: float,
) -> Array:
    """Observations of masses, friction and softening, a row each, shape (m, 5).

    Columns: value, standard deviation, and change of the value per kg of load, per relative error of the
    torque, and per u − 1 of the nut. ``softening_by_load`` is that of the softening per kg.
    """
    rows = []
    if masses is not None:
        rows.append((masses.inertia, masses.inertia_spread, masses.by_load, 1.0, 0.0))
        ratio, spread = masses.frequency_ratio, masses.frequency_ratio_spread
        if ratio is not None and spread:
            rows.append((ratio, spread, masses.frequency_ratio_by_load, 0.0, 0.0))
        for value, own in masses.friction:
            rows.append((value, math.hypot(own, assumptions.friction), 0.0, 1.0, 0.0))
    if softening is not None:
        rows.append((*softening, softening_by_load, 0.0, 1.0))
    return np.array(rows).reshape(-1, 5)


def _local_directions(change: ComplianceChange, priors: Priors) -> Array:
    """Changes of Y by the independent directions of a local change at its plausible size, shape (k, n).

    Changes of u at two stops are correlated by exp(−distance/length), so that steps along the axis are
    possible.
    """
    stops = np.unique(change.position)
    correlation = np.exp(-np.abs(stops[:, None] - stops[None]) / priors.local_length)
    size, axes = np.linalg.eigh(correlation)
    root = axes * np.sqrt(np.clip(size, 0.0, None))
    at = np.searchsorted(stops, change.position)
    return np.asarray(priors.local_size * (root[at] * change.nut[:, None]).T)


def _fit_cause(evidence: CauseEvidence, directions: Array, own: int) -> _CauseFit:
    """Fit of a cause by its directions, shape (k, n), each with an amount of 0 ± 1 before the data.

    The first ``own`` directions are the cause's. Its size is the amount of one, or the root mean square of
    those of several.
    """
    factor = cho_factor(evidence.covariance, lower=True)
    weighted = cho_solve(factor, directions.T)
    information = directions @ weighted
    projection = weighted.T @ evidence.values
    precision = information + np.eye(len(directions))
    posterior = np.linalg.inv(precision)
    amounts = posterior @ projection
    chi2_without = float(evidence.values @ cho_solve(factor, evidence.values))
    log_determinant = float(np.linalg.slogdet(precision)[1])
    log_evidence = -0.5 * (chi2_without - float(projection @ amounts) + log_determinant)
    chi2 = chi2_without - 2 * float(amounts @ projection) + float(amounts @ information @ amounts)
    if own == 1:
        return _CauseFit(log_evidence, chi2, float(amounts[0]), math.sqrt(float(posterior[0, 0])))
    size = math.sqrt(float(np.mean(amounts[:own] ** 2)))
    return _CauseFit(log_evidence, chi2, size, math.sqrt(float(np.mean(np.diag(posterior)[:own]))))


def _probability_of_cells(evidence: CauseEvidence, name: str) -> float:
    """Probability of a misfit of the cells as large as with a cause, whose size is fitted.

    The directions of a cause that has several are not fitted, since they would explain any change; they are
    added to the covariance with their plausible sizes.
    """
    count = len(evidence.floor)
    own, nut = evidence.signatures[name][:, :count], evidence.signatures["nut"][:, :count]
    # A cause that changes no cell, such as the torque, has nothing to fit.
    covariance, fitted = evidence.cell_covariance, own[np.any(own != 0, axis=1)]
    if name not in _SIMILAR_TO_NUT:
        if len(own) > 1:
            covariance, fitted = covariance + own.T @ own, nut
        else:
            fitted = np.vstack([fitted, nut])
    return misfit(evidence.values[:count], fitted.T, covariance, evidence.floor)[2]
