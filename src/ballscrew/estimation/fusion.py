"""One change of the nut from the changes of all cells: linear least squares, and its misfit.

The unknown is u = (P/P₀)^(−1/3). The change Y of the compliance is linear in it (Eq. (3) of Han, Miller,
Vogl, Chen and Jia, 2024), so the estimate of u is a weighted sum of Y over the cells, and its uncertainty
follows from the covariance of Y. P/P₀ = u⁻³ is not linear: its interval is computed from samples, see
:mod:`ballscrew.estimation.samples`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from ballscrew.axis.axial import PARAMETERS
from ballscrew.base.arrays import Array
from ballscrew.estimation.change import ComplianceChange, change_covariance

FLOOR = "floor of every model"
"""Printed name of the error term of ``ComplianceChange.floor``."""

_NO_VARIANCE = 1e-9  # expected sum of squares below which the residuals have no degree of freedom
# Part of the largest singular value; smaller ones are rounding errors of columns that depend on each other.
_SAME_COLUMN = 1e-9
_LEAST_U = 0.1  # least u in a logarithm or a divisor, that of a thousand times the preload
_REWEIGHTINGS = 8  # fits of the cells, each weighted by the deviations from the fit before it
_HUBER = 2.5  # standard deviations from the fit beyond which a cell loses weight

# Secant method for the P/P₀ that the load on a worn nut is corrected for. Its error is the resulting P/P₀
# less this one.
_RATIO_STEPS = 11
_RATIO_TOLERANCE = 1e-3  # of the assumed P/P₀; the resulting one changes by about a fiftieth of it
# Derivative of the error with respect to P/P₀ in the first step. It is -1 if the correction does not depend
# on P/P₀. With -2 the first step is half as long, so that it does not overshoot if the correction depends
# on P/P₀.
_FIRST_SLOPE = -2.0
_FLATTEST_SLOPE = -0.5  # with a slope nearer to 0 the step would exceed twice the error
_RATIO_LIMITS = (0.1, 10.0)  # of P/P₀


@dataclass(frozen=True, slots=True, eq=False)
class FusedChange:
    """The change of the nut that is common to n cells.

    Parameters
    ----------
    level : float
        u − 1, the relative change of the nut's compliance; above 0 for a loss of preload.
    weights : ndarray, shape (n,)
        Of the cells: level = weights · Y.
    terms : mapping of str to (float, bool)
        Standard uncertainty of u by each error term, by its name, and whether the error differs from run to
        run.
    by_parameters : ndarray, shape (7,)
        Derivatives of u with respect to the model's working vector, where the reference is the model; zeros
        where it is a run.
    residual : ndarray, shape (n,)
        Y less its fit.
    chi2, degrees : float
        Misfit of the cells and its expected value, the degrees of freedom: see :func:`misfit`.
    probability : float
        Of a misfit as large or larger if one change of the nut is all that has happened.
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
        """Standard uncertainty of ln(P/P₀) from ``spread``, that of u: d ln P = −3 du/u."""
        return 3 * spread / max(self.u, _LEAST_U)

    @property
    def random(self) -> float:
        """Standard uncertainty of u by the terms that differ from run to run."""
        return float(np.sqrt(sum(spread**2 for spread, random in self.terms.values() if random)))

    @property
    def spread(self) -> float:
        """Standard uncertainty of u by all terms, without that of the model's parameters and share."""
        return float(np.sqrt(sum(spread**2 for spread, _ in self.terms.values())))


def fuse(change: ComplianceChange, model_covariance: Array | None = None) -> FusedChange:
    """Fuse the changes of all cells into one change of the nut.

    Parameters
    ----------
    change : ComplianceChange
        Of one cell or more.
    model_covariance : ndarray, shape (7, 7), optional
        Of the model's working vector; it has an effect only where the reference is the model.

    Returns
    -------
    FusedChange
        The uncertainty of the nut's share is not among its terms.
    """
    covariance = change_covariance(change, floor=False)
    by_parameters = np.zeros((len(PARAMETERS), len(change.y)))
    if change.by_parameters is not None:
        by_parameters = change.by_parameters
        if model_covariance is not None:
            covariance = covariance + by_parameters.T @ model_covariance @ by_parameters
    weights = _cell_weights(change, covariance + np.diag(change.floor**2))
    level = float(weights @ change.y)
    terms = {}
    for term in change.terms:
        terms[term.name] = (float(np.linalg.norm(term.effects @ weights)), term.random)
    terms[FLOOR] = (float(np.linalg.norm(change.floor * weights)), True)
    residual = change.y - level * change.nut_share
    chi2, degrees, probability = misfit(residual, change.nut_share[:, None], covariance, change.floor)
    return FusedChange(level, weights, terms, by_parameters @ weights, residual, chi2, degrees, probability)


def fuse_on_worn_nut(
    change_at: Callable[[float], ComplianceChange], model_covariance: Array | None = None
) -> tuple[ComplianceChange, FusedChange, float]:
    """Fuse all cells, corrected for the softening of the worn nut by the test's own load.

    The load softens a worn nut more than a new one, so the correction depends on the result, P/P₀. The secant
    method finds the P/P₀ for which the corrected cells result in the same P/P₀.

    Parameters
    ----------
    change_at : callable
        Change of the compliance, corrected for the load on a nut of the given P/P₀.
    model_covariance : ndarray, shape (7, 7), optional
        As for :func:`fuse`.

    Returns
    -------
    change : ComplianceChange
        Corrected.
    fused : FusedChange
        Its cells fused.
    ratio : float
        P/P₀ for which the change is corrected.
    """
    ratio, slope = 1.0, _FIRST_SLOPE
    change = change_at(ratio)
    fused = fuse(change, model_covariance)
    error = _preload_ratio(fused) - ratio
    for _ in range(_RATIO_STEPS):
        if abs(error) < _RATIO_TOLERANCE:
            break
        last_ratio, last_error = ratio, error
        next_ratio = ratio - error / min(slope, _FLATTEST_SLOPE)
        ratio = min(max(next_ratio, _RATIO_LIMITS[0]), _RATIO_LIMITS[1])
        change = change_at(ratio)
        fused = fuse(change, model_covariance)
        error = _preload_ratio(fused) - ratio
        if ratio != last_ratio:
            slope = (error - last_error) / (ratio - last_ratio)
    return change, fused, ratio


def _preload_ratio(fused: FusedChange) -> float:
    """P/P₀ = u⁻³, limited to 1/8 to 8."""
    return min(max(fused.u, 0.5), 2.0) ** -3


def _cell_weights(change: ComplianceChange, covariance: Array) -> Array:
    """Weights of the cells in the change of the nut, shape (n,); weights · nut_share = 1.

    They are computed in two steps. A level and a slope along the axis are fitted to all cells by robust least
    squares, where each cell is weighted by its own variance. Since a nut causes no slope, the level may be
    corrected by a multiple of the slope: that with the least variance by the full covariance (Aitken, 1936)
    is chosen. Weights of all cells by the full covariance would rely on differences between cells in which
    the error terms happen to cancel, and the terms are not known that exactly.
    """
    x = change.position - change.position.mean()
    half_travel = float(np.ptp(x)) / 2
    basis = change.nut_share[:, None]
    if len(np.unique(change.position)) > 2:  # a slope through two stops would leave no deviation
        basis = np.stack([change.nut_share, change.nut_share * x / half_travel], axis=1)
    spread = np.sqrt(np.diag(covariance))
    huber_weight = np.ones_like(spread)
    for _ in range(_REWEIGHTINGS):
        row_weight = huber_weight / spread
        to_fit = np.linalg.pinv(basis * row_weight[:, None]) * row_weight  # level and slope are to_fit @ Y
        deviation = np.abs(change.y - basis @ (to_fit @ change.y)) / spread
        # Cells far from the common line lose weight (Huber, 1964); the square root, since rows are weighted.
        huber_weight = np.sqrt(np.minimum(1.0, _HUBER / np.maximum(deviation, 1e-12)))
    fit_covariance = to_fit @ covariance @ to_fit.T
    # Coefficients of level and slope with the least variance; that of the level is scaled to 1.
    coefficients = np.linalg.solve(fit_covariance, np.eye(len(fit_covariance))[0])
    return np.asarray((coefficients / coefficients[0]) @ to_fit)


def misfit(residual: Array, fitted: Array, covariance: Array, floor: Array) -> tuple[float, float, float]:
    """χ² of residuals, its degrees of freedom and its probability.

    The cells of a run lie on one smooth curve, so forty of them contain two or three independent numbers, and
    the covariance of Y can hardly be inverted. The floor is added to make this possible, although the data do
    not scatter by it. The sum of squares is then not distributed as χ²: it is scaled, and its degrees of
    freedom are chosen, so that its mean and variance agree with those of χ² (Satterthwaite, 1946, DOI
    10.2307/3002019).

    Parameters
    ----------
    residual : ndarray, shape (n,)
        Y less its fit, or Y: a combination of the fitted columns has no effect.
    fitted : ndarray, shape (n, m)
        Columns that were fitted to Y; those that are combinations of others do not count.
    covariance : ndarray, shape (n, n)
        Of Y without the floor.
    floor : ndarray, shape (n,)
        Standard deviation that is added to each cell, independently of the others.

    Returns
    -------
    chi2, degrees, probability : float
        χ², its expected value, and the probability of a χ² as large or larger; 0, 0 and 1 without a degree of
        freedom.
    """
    # Residual and fitted columns are whitened by the covariance with the floor.
    root = np.linalg.cholesky(covariance + np.diag(floor**2))
    white = np.linalg.solve(root, residual)
    columns = np.linalg.solve(root, fitted)
    lengths = np.linalg.norm(columns, axis=0)
    unit_columns = columns / np.where(lengths > 0, lengths, 1.0)
    vectors, singular_values, _ = np.linalg.svd(unit_columns, full_matrices=False)
    basis = vectors[:, singular_values > _SAME_COLUMN * singular_values.max(initial=0.0)]
    # The sum of squares outside the fitted columns is a sum of independent squares with these variances.
    projector = np.eye(len(residual)) - basis @ basis.T
    white_covariance = np.linalg.solve(root, np.linalg.solve(root, covariance).T)
    variances = np.clip(np.linalg.eigvalsh(projector @ white_covariance @ projector), 0.0, None)
    mean = float(variances.sum())
    half_variance = float((variances**2).sum())
    if mean < _NO_VARIANCE or len(residual) <= basis.shape[1]:
        return 0.0, 0.0, 1.0
    # The scale times a χ² of these degrees of freedom has the same mean and variance.
    degrees = mean**2 / half_variance
    scale = half_variance / mean
    remaining = white - basis @ (basis.T @ white)
    chi2 = float(remaining @ remaining) / scale
    return chi2, degrees, float(chdtrc(degrees, chi2))
