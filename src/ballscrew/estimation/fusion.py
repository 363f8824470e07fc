"""All cells fused to one change of the nut: generalised least squares, and its misfit.

The unknown is u = (P/P₀)^(−1/3), in which the compliance is linear (Eq. (3) of Han, Miller, Vogl, Chen and
Jia, 2024), so that one Gauss-Newton step is exact (Aitken, 1936). P/P₀ = u⁻³ is not linear: its interval is
computed from samples, see :mod:`ballscrew.estimation.samples`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from ballscrew.base.arrays import Array
from ballscrew.estimation.change import ComplianceChange, change_covariance

FLOOR = "floor of every model"
"""Name of the term of the floor."""

_NO_VARIANCE = 1e-9  # sum of the eigenvalues of an expected misfit below which nothing is free to misfit
_LEAST_U = 0.1  # of (P/P₀)^(−1/3), for logarithms: a thousand times the preload
_REWEIGHTINGS = 8  # of the cells, each by the fit before
_HUBER = 2.5  # standard deviations from the fit beyond which a cell loses weight
_RATIO_STEPS = 11  # of the secant method, at most
_RATIO_TOLERANCE = 1e-3  # of P/P₀; moves the correction for the nut's load by a hundredth of that


@dataclass(frozen=True, slots=True, eq=False)
class FusedChange:
    """One change of the nut, fused from n cells.

    Parameters
    ----------
    level : float
        u − 1: relative change of the nut's compliance; above 0 for a loss of preload.
    weights : ndarray, shape (n,)
        Of the cells: level = weights · Y.
    terms : mapping of str to (float, bool)
        Standard uncertainty of u by each term, and whether it differs from run to run.
    by_parameters : ndarray, shape (7,)
        ∂u by the working vector, where the reference is the model; zeros where it is a run.
    residual : ndarray, shape (n,)
        Of Y.
    chi2, degrees : float
        Misfit and its expected value: the numbers in the data that are free to misfit, few where all cells
        lie on one curve.
    probability : float
        Of a misfit as large or larger where the model is right.
    """

    level: float
    weights: Array
    terms: dict[str, tuple[float, bool]]
    by_parameters: Array
    residual: Array
    chi2: float
    degrees: float
    probability: float

    @property
    def u(self) -> float:
        """(P/P₀)^(−1/3); not above 0 for frequencies above those of an infinitely stiff nut."""
        return 1 + self.level

    @property
    def log_ratio(self) -> float:
        """ln(P/P₀) = −3 ln u."""
        return -3 * math.log(max(self.u, _LEAST_U))

    def log_preload_spread(self, spread: float) -> float:
        """Standard uncertainty of ln(P/P₀) by that of u: d ln P = −3 du/u."""
        return 3 * spread / max(self.u, _LEAST_U)

    @property
    def random(self) -> float:
        """Standard uncertainty of u by the terms that differ from run to run."""
        return float(np.sqrt(sum(u**2 for u, random in self.terms.values() if random)))

    @property
    def spread(self) -> float:
        """Standard uncertainty of u by all terms; that of the model is not included."""
        return float(np.sqrt(sum(u**2 for u, _ in self.terms.values())))


def fuse(change: ComplianceChange, model_covariance: Array | None = None) -> FusedChange:
    """Fuse all cells.

    Parameters
    ----------
    change : ComplianceChange
        Of one cell or more.
    model_covariance : ndarray, shape (7, 7), optional
        Covariance of the working vector, where the reference is the model.

    Returns
    -------
    FusedChange
        For the model's share of the nut.
    """
    covariance = change_covariance(change, floor=False)
    by_parameters = np.zeros((7, len(change.y)))
    if change.by_parameters is not None:
        by_parameters = change.by_parameters
        if model_covariance is not None:
            covariance = covariance + by_parameters.T @ model_covariance @ by_parameters
    weights = _weights(change, covariance + np.diag(change.floor**2))
    level = float(weights @ change.y)
    terms = {}
    for term in change.terms:
        terms[term.name] = (float(np.linalg.norm(term.effects @ weights)), term.random)
    terms[FLOOR] = (float(np.linalg.norm(change.floor * weights)), True)
    residual = change.y - level * change.nut
    chi2, degrees, probability = misfit(residual, change.nut[:, None], covariance, change.floor)
    return FusedChange(level, weights, terms, by_parameters @ weights, residual, chi2, degrees, probability)


def fuse_on_worn_nut(
    change_at: Callable[[float], ComplianceChange], model_covariance: Array | None = None
) -> tuple[ComplianceChange, FusedChange, float]:
    """Fuse all cells, corrected for the test's own load at the preload that results.

    The test's load softens a worn nut more than a new one, so the change of the compliance depends on P/P₀,
    which it determines: a fixed point, found by the secant method.

    Parameters
    ----------
    change_at : callable
        Change of the compliance, corrected for the load on the nut at a given P/P₀.
    model_covariance : ndarray, shape (7, 7), optional
        As for :func:`fuse`.

    Returns
    -------
    change : ComplianceChange
        Corrected.
    fused : FusedChange
        Its cells fused.
    ratio : float
        P/P₀ at which the change was corrected.
    """
    ratio, slope = 1.0, -2.0  # half a step at first: load and preload pull each other, and would swing
    change = change_at(ratio)
    fused = fuse(change, model_covariance)
    error = _preload_ratio(fused) - ratio
    for _ in range(_RATIO_STEPS):
        if abs(error) < _RATIO_TOLERANCE:
            break
        last_ratio, last_error = ratio, error
        ratio = min(max(ratio - error / min(slope, -0.5), 0.1), 10.0)
        change = change_at(ratio)
        fused = fuse(change, model_covariance)
        error = _preload_ratio(fused) - ratio
        if ratio != last_ratio:
            slope = (error - last_error) / (ratio - last_ratio)
    return change, fused, ratio


def _preload_ratio(fused: FusedChange) -> float:
    """P/P₀, limited to 1/8 to 8."""
    return min(max(fused.u, 0.5), 2.0) ** -3


def _weights(change: ComplianceChange, covariance: Array) -> Array:
    """Weights of the cells: fit of a level and a slope of the nut's change, then the best mean of these two.

    The full covariance of forty cells on one curve would find a contrast of them in which all its terms
    cancel, and rely on it. No covariance is known that well; those of a level and a slope are.
    """
    x = change.position - change.position.mean()
    half_travel = float(np.ptp(x)) / 2
    basis = change.nut[:, None]
    if len(np.unique(change.position)) > 2:
        basis = np.stack([change.nut, change.nut * x / half_travel], axis=1)
    size = np.sqrt(np.diag(covariance))
    trust = np.ones_like(size)
    for _ in range(_REWEIGHTINGS):
        fit = np.linalg.pinv(basis * (trust / size)[:, None]) * (trust / size)
        deviation = np.abs(change.y - basis @ (fit @ change.y)) / size
        # Cells off the common course lose weight (Huber, 1964).
        trust = np.sqrt(np.minimum(1.0, _HUBER / np.maximum(deviation, 1e-12)))
    fit_covariance = fit @ covariance @ fit.T
    combination = np.linalg.solve(fit_covariance, np.eye(len(fit_covariance))[0])
    return np.asarray((combination / combination[0]) @ fit)


def misfit(residual: Array, fitted: Array, covariance: Array, floor: Array) -> tuple[float, float, float]:
    """χ² of residuals, its degrees of freedom and its probability.

    Forty cells on one smooth curve are two or three numbers. The floor makes the covariance regular but is no
    noise of the data; χ² is a weighted sum of squares, reported with the degrees of freedom of its mean and
    variance (Satterthwaite, 1946, DOI 10.2307/3002019).

    Parameters
    ----------
    residual : ndarray, shape (n,)
        Of Y.
    fitted : ndarray, shape (n, m)
        Directions that were fitted to Y.
    covariance : ndarray, shape (n, n)
        Of Y without the floor.
    floor : ndarray, shape (n,)
        Standard deviations.

    Returns
    -------
    chi2, degrees, probability : float
        χ² is scaled to be compared with its degrees; 0, 0 and 1 where nothing is free to misfit.
    """
    root = np.linalg.cholesky(covariance + np.diag(floor**2))
    white = np.linalg.solve(root, residual)
    basis = np.linalg.qr(np.linalg.solve(root, fitted))[0]
    projector = np.eye(len(residual)) - basis @ basis.T
    white_covariance = np.linalg.solve(root, np.linalg.solve(root, covariance).T)
    variances = np.clip(np.linalg.eigvalsh(projector @ white_covariance @ projector), 0.0, None)
    total, square = float(variances.sum()), float((variances**2).sum())
    if total < _NO_VARIANCE or len(residual) <= fitted.shape[1]:
        return 0.0, 0.0, 1.0
    degrees, scale = total**2 / square, square / total
    remaining = white - basis @ (basis.T @ white)
    chi2 = float(remaining @ remaining) / scale
    return chi2, degrees, float(chdtrc(degrees, chi2))
