"""The most probable working vector for rows of data and a prior: least squares, and its goodness of fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares
from scipy.special import gammaincinv

from ballscrew.axis.axial import PARAMETERS, AxialModel, frequency, from_vector, gradient
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, MeasurementError
from ballscrew.calibration.calibrated_axis import Doubt
from ballscrew.calibration.covariance import FLOOR

SIZE = len(PARAMETERS)
_MOST_EVALUATIONS = 200  # of the residuals by least_squares
_TOLERANCE = 1e-12  # relative, of steps, cost and gradient in least_squares
_LEAST_VARIANCE = 1e-14  # of the largest in the prior: a direction with less is fixed
_CHANCE = 0.99  # quantile of χ² by chance above which variances are scaled
_FORM_LENGTH = 0.25  # of the travel: correlation length of the residuals by the form of the model


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Rows of data, what they depend on, and the prior.

    The unknowns are the working vector and ln(P/P_ref) of each group of runs but the first. A row is either
    ln f of a cell, or an anchor, linear in the unknowns.

    Parameters
    ----------
    centre : float
        Position where the compliance is stated, m.
    position, load : ndarray, shape (n,)
        Of the cells, m, kg.
    group, run : ndarray of int, shape (n,)
        Number of the group with one preload, and of the run, of each cell.
    observed : ndarray, shape (n + m,)
        ln f of the cells (f in Hz), then ln P of the m anchors (P in N).
    covariance : ndarray, shape (n + m, n + m)
        Of ``observed``.
    anchors : ndarray, shape (m, unknowns)
        Derivatives of the anchors with respect to the unknowns.
    mean, prior : ndarray, shape (unknowns,), (unknowns, unknowns)
        Mean and covariance of the unknowns before any data; an unknown with an infinite mean is fixed.
    worn_nut : ndarray, shape (n,)
        Additional derivative of ln f by ln(P/P_ref), by the test's own load on a worn nut.
    """

    centre: float
    position: Array
    load: Array
    group: NDArray[np.intp]
    run: NDArray[np.intp]
    observed: Array
    covariance: Array
    anchors: Array
    mean: Array
    prior: Array
    worn_nut: Array

    @property
    def runs(self) -> int:
        """Number of runs."""
        return int(self.run.max()) + 1

    @property
    def run_groups(self) -> list[int]:
        """Number of the group of each run."""
        return [int(self.group[self.run == run][0]) for run in range(self.runs)]

    @property
    def fixed(self) -> NDArray[np.bool_]:
        """Which unknowns are fixed at an infinite value, shape (unknowns,)."""
        return ~np.isfinite(self.mean)

    def deviation(self, unknown: Array) -> Array:
        """Unknowns less the prior's mean; 0 where fixed."""
        return np.where(self.fixed, 0.0, unknown) - np.where(self.fixed, 0.0, self.mean)

    def unknowns(self, deviation: Array) -> Array:
        """Unknowns from their deviation from the prior's mean."""
        return np.asarray(self.mean + deviation)

    def predicted(self, unknown: Array) -> Array:
        """Values of the rows by the model, shape (n + m,)."""
        model = from_vector(unknown[:SIZE], self.centre)
        log_ratio = self._log_ratio(unknown)
        by_model = np.log(frequency(model, self.position, self.load, np.exp(log_ratio)))
        anchors = self.anchors @ np.where(np.isfinite(unknown), unknown, 0.0)
        return np.concatenate([by_model + self.worn_nut * log_ratio, anchors])

    def jacobian(self, unknown: Array) -> Array:
        """Derivatives of :meth:`predicted` with respect to the unknowns, shape (n + m, unknowns)."""
        model = from_vector(unknown[:SIZE], self.centre)
        slopes = gradient(model, self.position, self.load, np.exp(self._log_ratio(unknown)))
        cells = np.zeros((len(self.position), len(unknown)))
        cells[:, :SIZE] = slopes[:, :SIZE]
        others = np.flatnonzero(self.group > 0)
        cells[others, SIZE + self.group[others] - 1] = slopes[others, SIZE] + self.worn_nut[others]
        return np.vstack([cells, self.anchors])

    def _log_ratio(self, unknown: Array) -> Array:
        """ln(P/P_ref) of each cell, 0 in the first group."""
        return np.pad(unknown[SIZE:], (1, 0))[self.group]


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """The most probable unknowns.

    Parameters
    ----------
    problem : Problem
        Rows and prior.
    unknown : ndarray, shape (unknowns,)
        Working vector, and ln(P/P_ref) of each group but the first.
    covariance : ndarray, shape (unknowns, unknowns)
        Posterior covariance of these by Laplace's approximation.
    residual : ndarray, shape (n + m,)
        Observed less predicted rows, not whitened.
    information : ndarray, shape (k, k)
        Fisher information of the data on the directions, in units of the prior's: 1 is as much as the prior.
    directions : ndarray, shape (unknowns, k)
        Change of the unknowns by one standard deviation of the prior along each of k independent directions.
    chi2 : float
        Of the whitened residuals.
    log_evidence : float
        ln of the probability density of the rows, by Laplace's approximation.
    """

    problem: Problem
    unknown: Array
    covariance: Array
    residual: Array
    information: Array
    directions: Array
    chi2: float
    log_evidence: float

    @property
    def model(self) -> AxialModel:
        """Axial model at the most probable values."""
        return from_vector(self.unknown[:SIZE], self.problem.centre)


@dataclass(frozen=True, slots=True)
class GoodnessOfFit:
    """Misfit of the frequencies of a calibration.

    Parameters
    ----------
    chi2, degrees : float
        Misfit, and its expected value.
    scale : float
        Factor on the variances of the frequencies: 1 unless they scatter beyond chance.
    reasons : tuple of Doubt
        One where they do.
    """

    chi2: float
    degrees: float
    scale: float = 1.0
    reasons: tuple[Doubt, ...] = ()


def solve(problem: Problem, start: Array | None = None) -> Fit:
    """Find the most probable unknowns by least squares.

    The variables of the fit, z, are the deviations from the prior's mean along its independent directions, in
    its standard deviations. The residuals are those of the rows, whitened by their joint covariance, and z.

    Parameters
    ----------
    problem : Problem
        Rows and prior.
    start : ndarray, optional
        Initial unknowns; the prior's mean by default.

    Returns
    -------
    Fit
        With the full covariance.

    Raises
    ------
    MeasurementError
        If it does not converge.
    """
    directions = _free_directions(problem.prior)
    directions[problem.fixed] = 0.0
    size = directions.shape[1]
    lower = np.linalg.cholesky(problem.covariance)

    def residuals(z: Array) -> Array:
        try:
            difference = problem.predicted(problem.unknowns(directions @ z)) - problem.observed
        except InputError:  # a step to impossible parameters
            return np.full(len(problem.observed) + size, np.inf)
        return np.concatenate([solve_triangular(lower, difference, lower=True), z])

    def jacobian(z: Array) -> Array:
        slopes = problem.jacobian(problem.unknowns(directions @ z)) @ directions
        return np.vstack([solve_triangular(lower, slopes, lower=True), np.eye(size)])

    initial = np.zeros(size)
    if start is not None:
        initial[:] = np.linalg.lstsq(directions, problem.deviation(start), rcond=None)[0]
    result = least_squares(
        residuals, initial, jacobian, xtol=_TOLERANCE, ftol=_TOLERANCE, gtol=_TOLERANCE,
        max_nfev=_MOST_EVALUATIONS,
    )  # fmt: skip
    if not result.success:
        raise MeasurementError(
            "the calibration does not converge: these frequencies fit no axis of this kind."
        )
    z, rows = result.x, len(problem.observed)
    white, slopes = result.fun[:rows], jacobian(z)[:rows]  # of the rows, without the prior
    information = slopes.T @ slopes
    precision = information + np.eye(size)
    covariance = directions @ np.linalg.solve(precision, directions.T)
    log_determinant = float(np.linalg.slogdet(precision)[1]) + 2 * float(np.sum(np.log(np.diag(lower))))
    chi2 = float(white @ white)
    unknown = problem.unknowns(directions @ z)
    return Fit(
        problem=problem,
        unknown=unknown,
        covariance=(covariance + covariance.T) / 2,
        residual=problem.observed - problem.predicted(unknown),
        information=information,
        directions=directions,
        chi2=chi2,
        log_evidence=-0.5 * (chi2 + float(z @ z) + log_determinant + len(white) * np.log(2 * np.pi)),
    )


def goodness_of_fit(fit: Fit) -> GoodnessOfFit:
    """Compare the residuals of the frequencies with their expected size.

    Forty cells on one smooth curve are two or three independent numbers. The floor is added to each cell so
    that their covariance can be inverted, but the error that it stands for, by the form of the model, is
    smooth along the stops of a run. So χ² is a weighted sum of squares, reported with the degrees of freedom
    that follow from its mean and variance (Satterthwaite, 1946, DOI 10.2307/3002019). Parameters count as far
    as the data, and not the prior, determine them. Where χ² exceeds its 99 % quantile, the variances of the
    frequencies are scaled by the excess (after R. T. Birge, 1932), continuously from 1.

    Parameters
    ----------
    fit : Fit
        The most probable unknowns of the problem.

    Returns
    -------
    GoodnessOfFit
        Of the frequencies; anchors have a test of their own.
    """
    problem, n = fit.problem, len(fit.problem.position)
    root = np.linalg.cholesky(problem.covariance)
    white = np.linalg.solve(root, fit.residual)[:n]
    slopes = np.linalg.solve(root, problem.jacobian(fit.unknown) @ fit.directions)
    expected = problem.covariance.copy()  # of the data, with the smooth errors in place of the floor
    expected[:n, :n] += FLOOR**2 * (_form_correlation(problem) - np.eye(n))
    noise = np.linalg.solve(root, np.linalg.solve(root, expected).T)
    # The residuals of the n cells are the projector times noise and deviation from the prior, all whitened.
    fitted = slopes @ np.linalg.solve(slopes.T @ slopes + np.eye(slopes.shape[1]), slopes.T)
    projector = (np.eye(len(root)) - fitted)[:n]
    remaining = projector @ (noise + slopes @ slopes.T) @ projector.T  # their covariance
    # Mean of the sum of squares, and half of its variance: scale times χ² has the same mean and variance.
    total, square = float(np.trace(remaining)), float(np.sum(remaining**2))
    if not total > 0:
        return GoodnessOfFit(0.0, 0.0)
    degrees, scale = total**2 / square, square / total
    chi2 = float(white @ white) / scale
    excess = chi2 - 2 * float(gammaincinv(degrees / 2, _CHANCE))  # over the quantile of χ²
    if excess <= 0:
        return GoodnessOfFit(chi2, degrees)
    reason = (
        f"the frequencies scatter more than their uncertainties allow (χ² {chi2:.0f} at {degrees:.0f} "
        "degrees of freedom): their uncertainties were increased"
    )
    return GoodnessOfFit(chi2, degrees, 1 + excess / degrees, (Doubt("misfit", reason),))


def scaled(problem: Problem, scale: float) -> Problem:
    """The problem with the variances of the frequencies scaled; prior and anchors are the same."""
    n = len(problem.position)
    covariance = problem.covariance.copy()
    covariance[:n, :n] *= scale
    return replace(problem, covariance=covariance)


def _form_correlation(problem: Problem) -> Array:
    """Correlation of the errors by the form of the model, shape (n, n), smooth along the stops of a run."""
    x = problem.position
    length = _FORM_LENGTH * max(float(np.ptp(x)), 1e-9)
    near = np.exp(-0.5 * ((x[:, None] - x) / length) ** 2)
    return np.asarray(np.where(problem.run[:, None] == problem.run, near, 0.0))


def _free_directions(covariance: Array) -> Array:
    """Root H of a covariance H Hᵀ, shape (unknowns, k), without the directions that have no variance."""
    scale = np.sqrt(np.diag(covariance))
    divisor = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(divisor, divisor))
    free = values > _LEAST_VARIANCE * max(float(values.max(initial=0.0)), 1e-300)
    return np.asarray(scale[:, None] * vectors[:, free] * np.sqrt(values[free]))
