"""The most probable working vector, given rows of data and a prior: Gauss-Newton on whitened residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from ballscrew.axis.axial import PARAMETERS, frequency, from_vector, gradient
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, MeasurementError

__all__ = ["FULL", "Fit", "Problem", "extended", "loose", "solve"]


FULL = len(PARAMETERS)
_STEPS = 60
_SETTLED = 1e-6  # of a prior standard deviation
_LEAST = 1e-14  # of the largest variance: a direction that the prior holds still


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Rows of data, what they depend on, and what was known before.

    The unknowns are the working vector and ln(P/P_ref) of each group of runs but the first. A row is either
    ln f of a cell, or linear in them: an anchor.

    Parameters
    ----------
    centre : float
        m.
    position, load : ndarray, shape (n,)
        Of the cells, m, kg.
    group, run : ndarray of int, shape (n,)
        Which preload, and which run.
    told : ndarray, shape (n + m,)
        ln f of the cells, then what the m anchors say.
    covariance : ndarray, shape (n + m, n + m)
        Of these.
    anchors : ndarray, shape (m, unknowns)
        Rows of the anchors.
    mean, prior : ndarray, shape (unknowns,), (unknowns, unknowns)
        Before any data.
    worn : ndarray, shape (n,)
        By how much more than by the nut's rigidity ln f of each cell falls with ln(P/P_ref): the test's own
        load on a worn nut.
    """

    centre: float
    position: Array
    load: Array
    group: NDArray[np.intp]
    run: NDArray[np.intp]
    told: Array
    covariance: Array
    anchors: Array
    mean: Array
    prior: Array
    worn: Array

    def predicted(self, unknown: Array) -> Array:
        """What the rows should say, shape (n + m,)."""
        model = from_vector(unknown[:FULL], self.centre)
        ratio = self._log_ratio(unknown)
        cells = np.log(frequency(model, self.position, self.load, np.exp(ratio))) + self.worn * ratio
        return np.concatenate([cells, self.anchors @ np.where(np.isfinite(unknown), unknown, 0.0)])

    def jacobian(self, unknown: Array) -> Array:
        """Its derivative, shape (n + m, unknowns)."""
        model = from_vector(unknown[:FULL], self.centre)
        slopes = gradient(model, self.position, self.load, np.exp(self._log_ratio(unknown)))
        cells = np.zeros((len(self.position), len(unknown)))
        cells[:, :FULL] = slopes[:, :FULL]
        later = np.flatnonzero(self.group > 0)
        cells[later, FULL + self.group[later] - 1] = slopes[later, FULL] + self.worn[later]
        return np.vstack([cells, self.anchors])

    def _log_ratio(self, unknown: Array) -> Array:
        return np.concatenate([[0.0], unknown[FULL:]])[self.group]


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """The most probable unknowns.

    Parameters
    ----------
    unknown : ndarray, shape (unknowns,)
        Working vector and log ratios.
    covariance : ndarray, shape (unknowns, unknowns)
        By Laplace's approximation.
    residual : ndarray, shape (n + m,)
        Of the rows, not whitened.
    information : ndarray, shape (k, k)
        Of the data in units of the prior: 1 is as much as the prior knew.
    directions : ndarray, shape (unknowns, k)
        A prior standard deviation along each of k independent directions.
    chi2, prior_chi2 : float
        Of the rows; of the unknowns against the prior.
    log_evidence : float
        By Laplace's approximation.
    """

    unknown: Array
    covariance: Array
    residual: Array
    information: Array
    directions: Array
    chi2: float
    prior_chi2: float
    log_evidence: float


def solve(problem: Problem, start: Array | None = None) -> Fit:
    """Find the most probable unknowns.

    Levenberg-Marquardt steps in units of the prior, the rows whitened by their joint covariance.

    Parameters
    ----------
    problem : Problem
        Rows and prior.
    start : ndarray, optional
        Unknowns to begin with; the prior's mean otherwise.

    Returns
    -------
    Fit
        With the full covariance.

    Raises
    ------
    MeasurementError
        If it does not settle.
    """
    half = loose(problem.prior)
    lower = np.linalg.cholesky(problem.covariance)
    fixed = ~np.isfinite(problem.mean)
    half[fixed] = 0.0

    def at(z: Array) -> Array:
        return np.asarray(np.where(fixed, problem.mean, np.where(fixed, 0.0, problem.mean) + half @ z))

    def misfit(z: Array) -> Array:
        return np.asarray(solve_triangular(lower, problem.told - problem.predicted(at(z)), lower=True))

    z = np.zeros(half.shape[1])
    if start is not None:
        away = np.where(fixed, 0.0, start) - np.where(fixed, 0.0, problem.mean)
        z = np.linalg.lstsq(half, away, rcond=None)[0]
    white, damping = misfit(z), 0.0
    cost = float(white @ white + z @ z)
    for _ in range(_STEPS):
        slopes = solve_triangular(lower, problem.jacobian(at(z)) @ half, lower=True)
        matrix = slopes.T @ slopes + np.eye(len(z))
        step = cho_solve(cho_factor(matrix + damping * np.diag(np.diag(matrix))), slopes.T @ white - z)
        try:
            tried = misfit(z + step)
            new = float(tried @ tried + (z + step) @ (z + step))
        except InputError:  # a step off the screw: no such axis
            new = np.inf
        if new <= cost * (1 + 1e-12):
            z, white, damping = z + step, tried, damping / 10 if damping > 1e-9 else 0.0
            settled = cost - new <= 1e-9 * (1 + cost) and float(np.abs(step).max(initial=0.0)) < _SETTLED
            cost = new
            if settled:
                break
        else:
            damping = max(10 * damping, 1e-3)
            if damping > 1e9:
                break
    else:
        raise MeasurementError("the calibration does not settle: these frequencies fit no axis of this kind.")
    slopes = solve_triangular(lower, problem.jacobian(at(z)) @ half, lower=True)
    information = slopes.T @ slopes
    matrix = information + np.eye(len(z))
    unknown = at(z)
    spread = half @ np.linalg.solve(matrix, half.T)
    determinant = float(np.linalg.slogdet(matrix)[1]) + 2 * float(np.sum(np.log(np.diag(lower))))
    chi2 = float(white @ white)
    return Fit(
        unknown=unknown,
        covariance=(spread + spread.T) / 2,
        residual=problem.told - problem.predicted(unknown),
        information=information,
        directions=half,
        chi2=chi2,
        prior_chi2=float(z @ z),
        log_evidence=-0.5 * (chi2 + float(z @ z) + determinant + len(white) * np.log(2 * np.pi)),
    )


def loose(covariance: Array) -> Array:
    """Half of a covariance, H Hᵀ, without the directions in which nothing is free."""
    scale = np.sqrt(np.diag(covariance))
    safe = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(safe, safe))
    kept = values > _LEAST * max(float(values.max(initial=0.0)), 1e-300)
    return np.asarray(scale[:, None] * vectors[:, kept] * np.sqrt(values[kept]))


def extended(mean: Array, prior: Array, ratios: int, spread: float) -> tuple[Array, Array]:
    """Add log ratios, of which nothing is known but their size."""
    whole = np.zeros((len(mean) + ratios, len(mean) + ratios))
    whole[: len(mean), : len(mean)] = prior
    whole[len(mean) :, len(mean) :] = spread**2 * np.eye(ratios)
    return np.concatenate([mean, np.zeros(ratios)]), whole
