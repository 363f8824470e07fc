"""Possible causes of a change of the frequencies, compared by their evidence.

Each cause changes the compliance along the axis, the masses and the friction in a fixed proportion, its
signature. The changes of a run since its baseline are one vector of observations with one covariance. A cause
adds its signature times an unknown amount, whose prior is normal with mean 0 and a plausible size as standard
deviation. With each cause the observations are then normally distributed, and their density is the evidence
for it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.special import softmax

from ballscrew.base.arrays import Array
from ballscrew.calibration.assumptions import DEFAULT_ASSUMPTIONS, Assumptions, Priors
from ballscrew.estimation.change import DECLARED_LOAD, POSITION, ComplianceChange, change_covariance
from ballscrew.estimation.fusion import misfit

UNITS: Mapping[str, str] = {"load": "kg", "position": "m"}
"""Units of the amounts by cause; the amounts of the other causes have no unit."""

# Causes whose signature along the axis is nearly that of the nut, so that a fit does not separate the two.
_SIMILAR_TO_NUT = ("nut", "bearing", "position", "temperature")
_LEAST_U = 0.1  # least u of the nut in its description, that of a thousand times the preload

UNDECIDED = "nut or bearing"
"""Name of the cause where nothing separates nut and support bearing."""
AXIAL = ("nut", "bearing", "both", UNDECIDED)
"""Names of the causes that change the axial stiffness itself."""

# Text of each cause other than the nut, and its ``side`` for a positive and for any other amount.
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
        χ² of all observations after the fit of the cause.
    amount, standard_uncertainty : float
        Size of the cause, in ``unit``:

        - nut: u − 1, with u = (P/P₀)^(−1/3);
        - bearing, both: relative change of the bearing's rigidity;
        - load: load on the table above the declared one, kg;
        - torque: relative error of the torque signal;
        - position: shift of the axis's zero, m;
        - temperature: decrease of ln P;
        - gradient: ln P at the last stop less that at the first;
        - local: size of the change of u at a stop, the root mean square of its independent forms.
    unit : str
        Of the amount; empty for a ratio.
    possible : bool
        Whether the cause explains the cells, explains all observations about as well as the best of nut,
        bearing and both, has a plausible size and is significant. The nut need not be significant.
    text : str
        Cause and amount in words.
    fit : float
        Probability that cells with this cause have a misfit as large as the observed one, or larger.
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
    log_mass, log_mass_spread : float
        Change of ln equivalent mass beyond the declared change of the load, and its standard uncertainty.
    log_mass_by_load : float
        Change of ln equivalent mass per kg of load, 1/kg: one over the mass with the declared load.
    log_frequency_ratio, log_frequency_ratio_spread : float or None
        Change of ln (f_free/f_held)², of the frequencies with the rotor free and held, beyond that by the
        declared loads, and its standard uncertainty. The ratio depends on the masses alone.
    log_frequency_ratio_by_load : float
        Change of ln (f_free/f_held)² per kg of load, 1/kg.
    log_friction : tuple of (float, float)
        Changes of ln viscous and ln Coulomb friction, each with its standard uncertainty; without those that
        a run does not determine.
    moving_mass : float
        By the model, with the load, kg.
    """

    log_mass: float
    log_mass_spread: float
    log_mass_by_load: float
    log_frequency_ratio: float | None
    log_frequency_ratio_spread: float | None
    log_frequency_ratio_by_load: float
    log_friction: tuple[tuple[float, float], ...]
    moving_mass: float


@dataclass(frozen=True, slots=True, eq=False)
class CauseEvidence:
    """Observations of a run against its reference, with the signatures of the causes.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Y of each of m cells, then the changes of masses and friction, then u − 1 by the softening, each where
        it is known.
    covariance : ndarray, shape (n, n)
        Of ``values``, without the error terms that are compared as causes; it can be inverted.
    signatures : mapping of str to ndarray, shape (k, n)
        Effect on ``values`` of each cause at its plausible size. A cause that can have several forms along
        the axis has one row for each; their amounts are independent.
    sizes : mapping of str to float
        Plausible size of each cause, the standard deviation of its amount, in its unit.
    cell_covariance : ndarray, shape (m, m)
        Of Y of the cells, with all error terms and without the floor.
    floor : ndarray, shape (m,)
        Standard deviation of Y that each cell is given in addition, as in ComplianceChange.
    """

    values: Array
    covariance: Array
    signatures: dict[str, Array]
    sizes: dict[str, float]
    cell_covariance: Array
    floor: Array


@dataclass(frozen=True, slots=True)
class _CauseFit:
    """Fit of one cause.

    ``log_evidence`` is known up to a constant that all causes share, ``chi2`` is that of the observations
    after the fit, and ``size`` and ``spread`` are the amount and its standard deviation over the plausible
    size.
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
        Of m cells.
    masses : MassChanges or None
        Since the baseline; None where a run does not determine its masses.
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
    covariance_of_cells = change_covariance(change, without=compared_terms)
    all_errors_of_cells = change_covariance(change, floor=False)
    if model_covariance is not None and change.by_parameters is not None:
        by_model = change.by_parameters.T @ model_covariance @ change.by_parameters
        covariance_of_cells = covariance_of_cells + by_model
        all_errors_of_cells = all_errors_of_cells + by_model
    # The softening determines moving mass over preload: a load that was not declared is read as a decrease of
    # ln P, by about its part of the moving mass; du = −u/3 d ln P, here at u = 1.
    softening_by_load = 1 / (3 * change.moving_mass)
    others = _other_observations(masses, assumptions, softening, softening_by_load)
    values, spreads, by_load, by_torque, by_nut = others.T
    covariance = block_diag(covariance_of_cells, np.diag(spreads**2))

    def in_cells(signature: Array) -> Array:
        """Signature in the cells, shape (m,) or (k, m), extended by 0 in the other observations."""
        return np.pad(np.atleast_2d(signature), ((0, 0), (0, len(others))))

    nut = np.concatenate([change.nut_share, by_nut])[None]
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
        # A bearing whose rigidity grows by a small part of it loses the same part of its compliance.
        "bearing": in_cells(-sizes["bearing"] * change.bearing_share),
        "both": in_cells(-sizes["both"] * change.bearing_share),  # the nut is added in the fit
    }
    if not load_corrected:
        signatures["load"] = (sizes["load"] * np.concatenate([change.by_load, by_load]))[None]
    if masses is not None:
        sizes["torque"] = assumptions.torque_constant
        no_cell = np.zeros_like(change.y)
        signatures["torque"] = (sizes["torque"] * np.concatenate([no_cell, by_torque]))[None]
    # dY/dx = (1 + Y) d ln C/dx
    signatures["position"] = in_cells(priors.position_size * (1 + change.y) * change.log_slope)
    signatures["local"] = in_cells(_local_directions(change, priors))
    travel = float(np.ptp(change.position))
    if travel > 0:
        along = (change.position - change.position.mean()) / travel
        sizes["gradient"] = priors.gradient_size
        # du = −d ln P/3 at u = 1, here and for the temperature, the amount of which is a decrease of ln P.
        signatures["gradient"] = in_cells(-priors.gradient_size / 3 * along * change.nut_share)
    if temperature_difference:
        # By the assumed slope, even where runs determine it.
        sizes["temperature"] = assumptions.temperature * abs(temperature_difference)
        signatures["temperature"] = sizes["temperature"] / 3 * nut
    observations = np.concatenate([change.y, values])
    return CauseEvidence(observations, covariance, signatures, sizes, all_errors_of_cells, change.floor)


def compare_causes(
    evidence: CauseEvidence, assumptions: Assumptions = DEFAULT_ASSUMPTIONS
) -> tuple[PossibleCause, ...]:
    """Compare the causes.

    Nut and bearing are fitted alone, and together as the cause "both". The other causes with nearly the
    signature of the nut (zero of the position, temperature) are fitted alone, as alternatives to it. The
    remaining ones may accompany a worn nut, so they are fitted together with it.

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
    for name, signature in evidence.signatures.items():
        directions = signature
        if name not in _SIMILAR_TO_NUT:
            directions = np.vstack([signature, nut])
        fits[name] = _fit_cause(evidence, directions, len(signature))
    log_posteriors = [fit.log_evidence + math.log(priors.chances[name]) for name, fit in fits.items()]
    probabilities = softmax(log_posteriors).tolist()
    least_chi2 = min(fit.chi2 for name, fit in fits.items() if name in AXIAL)
    causes = []
    for (name, fit), probability in zip(fits.items(), probabilities, strict=True):
        # The size of a cause of several directions is a root mean square, which is above 0 without the cause
        # too. Its evidence must therefore exceed that of the nut alone, which its fit contains.
        significant = name == "nut" or abs(fit.size) > 2 * fit.spread
        if len(evidence.signatures[name]) > 1:
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
    """Possible causes of a change other than nut and bearing, in the order of ``causes``."""
    return tuple(cause for cause in causes if cause.possible and cause.name not in AXIAL)


def describe_cause(name: str, amount: float) -> str:
    """Cause and amount in words.

    Parameters
    ----------
    name : str
        Of the cause, as in :class:`PossibleCause`.
    amount : float
        Of the cause, in its unit.

    Returns
    -------
    str
        For the middle of a sentence.
    """
    if name in ("nut", UNDECIDED):  # the amount is u − 1, and P/P₀ = u⁻³
        change = max(1 + amount, _LEAST_U) ** -3 - 1
        direction = "more" if change > 0 else "less"
        preload_change = f"{abs(100 * change):.1f} % {direction} preload"
        if name == "nut":
            return f"the nut, {preload_change}"
        return f"the nut or the support bearing: axial stiffness as with {preload_change} of the nut"
    text, positive, negative = _DESCRIPTIONS[name]
    side = positive if amount > 0 else negative
    size = abs(amount)
    digits = 1 if size >= 1e-3 else 2  # a second digit below 0.1 %
    percent = f"{100 * size:.{digits}f} %"
    return text.format(percent=percent, side=side, size=size, millimetres=1e3 * amount)


def _other_observations(
    masses: MassChanges | None,
    assumptions: Assumptions,
    softening: tuple[float, float] | None,
    softening_by_load: float,
) -> Array:
    """Observations of masses, friction and softening, a row for each, shape (k, 5).

    The columns are the value, its standard deviation, and its change per kg of load, per relative error of
    the torque, and per u − 1 of the nut. ``softening_by_load`` is the change of u by the softening per kg.
    """
    rows = []
    if masses is not None:
        rows.append((masses.log_mass, masses.log_mass_spread, masses.log_mass_by_load, 1.0, 0.0))
        ratio, spread = masses.log_frequency_ratio, masses.log_frequency_ratio_spread
        if ratio is not None and spread:
            rows.append((ratio, spread, masses.log_frequency_ratio_by_load, 0.0, 0.0))
        for value, friction_spread in masses.log_friction:
            rows.append((value, math.hypot(friction_spread, assumptions.friction), 0.0, 1.0, 0.0))
    if softening is not None:
        rows.append((*softening, softening_by_load, 0.0, 1.0))
    return np.array(rows).reshape(-1, 5)


def _local_directions(change: ComplianceChange, priors: Priors) -> Array:
    """Changes of Y by the independent directions of a local change at its plausible size, shape (k, m).

    There are as many as stops. Changes of u at two stops have the correlation exp(−distance/length), which
    allows for a step of u along the axis.
    """
    stops = np.unique(change.position)
    correlation = np.exp(-np.abs(stops[:, None] - stops[None]) / priors.local_length)
    eigenvalues, eigenvectors = np.linalg.eigh(correlation)
    root = eigenvectors * np.sqrt(np.clip(eigenvalues, 0.0, None))  # the correlation is root @ root.T
    stop_of_cell = np.searchsorted(stops, change.position)
    return np.asarray(priors.local_size * (root[stop_of_cell] * change.nut_share[:, None]).T)


def _fit_cause(evidence: CauseEvidence, directions: Array, count: int) -> _CauseFit:
    """Fit of a cause by directions, shape (k, n), with amounts whose prior is standard normal.

    The first ``count`` directions are those of the cause, and the others those of a worn nut. The size of a
    cause of one direction is its amount, that of several directions their root mean square.
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
    size = float(amounts[0])
    if count > 1:
        size = math.sqrt(float(np.mean(amounts[:count] ** 2)))
    spread = math.sqrt(float(np.mean(np.diag(posterior)[:count])))
    return _CauseFit(log_evidence, chi2, size, spread)


def _probability_of_cells(evidence: CauseEvidence, name: str) -> float:
    """Probability that cells with this cause, whose size is fitted, misfit as much as observed, or more.

    The directions of a cause that has several are not fitted, since they would explain any change. They are
    added to the covariance with their plausible sizes.
    """
    count = len(evidence.floor)
    signature = evidence.signatures[name][:, :count]
    nut = evidence.signatures["nut"][:, :count]
    covariance = evidence.cell_covariance
    if len(signature) > 1:
        covariance = covariance + signature.T @ signature
        fitted = nut
    else:
        fitted = signature[np.any(signature != 0, axis=1)]  # nothing for a cause that changes no cell
        if name not in _SIMILAR_TO_NUT:
            fitted = np.vstack([fitted, nut])
    _, _, probability = misfit(evidence.values[:count], fitted.T, covariance, evidence.floor)
    return probability
