"""Whether frequencies scatter as they say that they err, and by how much more."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2 as chi2_law

from ballscrew.base.arrays import Array
from ballscrew.calibration.fit import Fit, Problem
from ballscrew.calibration.rows import FLOOR

__all__ = ["Scattered", "scattered", "widened"]


_SURE = 0.99
_ALIKE = 0.25  # of the way between the outer stops: what the form leaves goes in bows of this size


@dataclass(frozen=True, slots=True)
class Scattered:
    """Misfit of the frequencies of a calibration.

    Parameters
    ----------
    chi2, degrees : float
        Misfit, and what chance makes of it.
    scale : float
        Factor on the variances of the frequencies: 1 unless they scatter beyond chance.
    reasons : tuple of str
        That they do.
    """

    chi2: float
    degrees: float
    scale: float = 1.0
    reasons: tuple[str, ...] = ()


def scattered(problem: Problem, fit: Fit) -> Scattered:
    """Hold what the fit leaves of the frequencies against what their errors would leave.

    Forty cells on one smooth curve are two or three numbers. The floor that makes their covariance regular is
    the form's, and smooth along the stops of a run, not another number for each cell. So χ² is a weighted sum
    of squares; it is told as one of as many degrees of freedom as its mean and variance say (Satterthwaite,
    1946, DOI 10.2307/3002019). What the fit takes up counts as far as data, and not the prior, settle it.
    Beyond 99 % of chance the variances of the frequencies grow by what is beyond (after R. T. Birge, 1932):
    from 1 on, without a jump.

    Parameters
    ----------
    problem, fit
        Rows, and the most probable unknowns.

    Returns
    -------
    Scattered
        Of the frequencies; anchors have a test of their own.
    """
    n = len(problem.position)
    root = np.linalg.cholesky(problem.covariance)
    white = np.linalg.solve(root, fit.residual)[:n]
    slopes = np.linalg.solve(root, problem.jacobian(fit.unknown) @ fit.directions)
    true = problem.covariance.copy()
    true[:n, :n] += FLOOR**2 * (_smooth(problem) - np.eye(n))
    noise = np.linalg.solve(root, np.linalg.solve(root, true).T)
    taken = slopes @ np.linalg.solve(slopes.T @ slopes + np.eye(slopes.shape[1]), slopes.T)
    kept = (np.eye(len(root)) - taken)[:n]
    left = kept @ (noise + slopes @ slopes.T) @ kept.T
    total, square = float(np.trace(left)), float(np.sum(left**2))
    if not total > 0:
        return Scattered(0.0, 0.0)
    degrees, size = total**2 / square, square / total
    chi2 = float(white @ white) / size
    beyond = chi2 - float(chi2_law.ppf(_SURE, degrees))
    if beyond <= 0:
        return Scattered(chi2, degrees)
    words = (
        f"the frequencies scatter more than their uncertainties allow (χ² {chi2:.0f} at {degrees:.0f} "
        "degrees of freedom): their uncertainties were widened"
    )
    return Scattered(chi2, degrees, 1 + beyond / degrees, (words,))


def _smooth(problem: Problem) -> Array:
    """Correlation of what the form leaves, from cell to cell of a run."""
    x = problem.position
    way = _ALIKE * max(float(np.ptp(x)), 1e-9)
    near = np.exp(-0.5 * ((x[:, None] - x) / way) ** 2)
    return np.asarray(np.where(problem.run[:, None] == problem.run, near, 0.0))


def widened(problem: Problem, scale: float) -> Problem:
    """Widen what the frequencies err by; prior and anchors stay what they are."""
    if scale == 1.0:
        return problem
    n = len(problem.position)
    whole = problem.covariance.copy()
    whole[:n, :n] *= scale
    return replace(problem, covariance=whole)
