"""Fisher information of mode tables about an axis, with independent and shared errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

_OPEN = 1e-9  # least eigenvalue of the scaled matrix above rounding


def fisher_information(jacobian: ArrayLike, own: ArrayLike, shared: ArrayLike | None = None) -> Array:
    """Jᵀ (diag(own²) + sharedᵀ shared)⁻¹ J, the Fisher information of data with normal errors.

    Shared errors are not averaged out by more cells. The inverse is Woodbury's, so that thousands of cells
    with a few shared causes stay cheap.

    Parameters
    ----------
    jacobian : array_like, shape (n, p)
        ∂y/∂q at n points.
    own : array_like, shape (n,)
        Standard deviation of the independent error of each point, in the unit of y.
    shared : array_like, shape (k, n), optional
        Effects of k independent causes on every point, in the unit of y.

    Returns
    -------
    ndarray, shape (p, p)
        Inverse of the least covariance that an unbiased estimate of q can have, where it has one.

    Raises
    ------
    InputError
        If shapes do not fit, a number is not finite or an own error not above 0.
    """
    matrix, spread = np.asarray(jacobian, dtype=np.float64), np.asarray(own, dtype=np.float64)
    if matrix.ndim != 2 or spread.shape != matrix.shape[:1]:
        raise InputError(
            f"a jacobian of shape {matrix.shape} and own errors of shape {spread.shape} were given; they "
            "must be (n, p) and (n,)."
        )
    causes = np.zeros((0, len(spread))) if shared is None else np.asarray(shared, dtype=np.float64)
    if causes.ndim != 2 or causes.shape[1] != len(spread):
        raise InputError(
            f"shared errors of shape {causes.shape} were given; they must be (k, {len(spread)}): an effect "
            "of every cause on every point."
        )
    if not (np.isfinite(matrix).all() and np.isfinite(causes).all() and np.isfinite(spread).all()):
        raise InputError("a jacobian or an error that is not finite was given; all must be finite.")
    if not np.all(spread > 0):
        raise InputError(f"an own error of {spread.min():g} was given; it must be more than 0.")
    by_point, by_cause = matrix / spread[:, None], causes / spread
    mixed = by_cause @ by_point
    lost = mixed.T @ np.linalg.solve(np.eye(len(causes)) + by_cause @ by_cause.T, mixed)
    full = by_point.T @ by_point - lost
    return np.asarray((full + full.T) / 2)


def posterior(covariance: ArrayLike, information: ArrayLike) -> Array:
    """Covariance after data with this information.

    Parameters
    ----------
    covariance : array_like, shape (p, p)
        Prior covariance. It may be singular: a parameter without variance is fixed.
    information : array_like, shape (p, p)
        Information of the data, as :func:`fisher_information` gives it; it may be singular too.

    Returns
    -------
    ndarray, shape (p, p)
        L (1 + Lᵀ M L)⁻¹ Lᵀ with L Lᵀ the covariance before.

    Raises
    ------
    InputError
        If the covariance is none.
    """
    root = _root(covariance)
    inner = np.eye(len(root)) + root.T @ np.asarray(information, dtype=np.float64) @ root
    return np.asarray(root @ np.linalg.solve(inner, root.T))


def gained_bits(covariance: ArrayLike, information: ArrayLike) -> float:
    """Expected gain of information by data with this information, bits (Lindley).

    Parameters
    ----------
    covariance, information : array_like, shape (p, p)
        As in :func:`posterior`.

    Returns
    -------
    float
        ½ log₂ det(1 + Lᵀ M L). One bit halves one standard deviation.

    Raises
    ------
    InputError
        As :func:`posterior`.
    """
    root = _root(covariance)
    inner = np.eye(len(root)) + root.T @ np.asarray(information, dtype=np.float64) @ root
    return float(np.linalg.slogdet(inner)[1] / (2 * np.log(2)))


def d_information(information: ArrayLike, wanted: Sequence[int], precision: ArrayLike) -> float:
    """det^(1/p) of the information about p wanted parameters, the others known no better than before.

    It is proportional to the number of measurements, so plans are compared by it per unit of time.

    Parameters
    ----------
    information : array_like, shape (q, q)
        Information of the data.
    wanted : sequence of int
        Indices of the p wanted parameters.
    precision : array_like, shape (q,)
        1/variance before, of the parameters that do not count; infinite where one is known.

    Returns
    -------
    float
        0 where the data leave one of the wanted parameters open.
    """
    matrix, before = np.asarray(information, dtype=np.float64), np.asarray(precision, dtype=np.float64)
    keep = list(wanted)
    # A fixed parameter takes no information from the others: it drops out.
    rest = np.setdiff1d(np.flatnonzero(np.isfinite(before)), keep).tolist()
    inner = matrix[np.ix_(rest, rest)] + np.diag(before[rest])
    across = matrix[np.ix_(keep, rest)]
    marginal = matrix[np.ix_(keep, keep)] - across @ np.linalg.pinv(inner, hermitian=True) @ across.T
    # Scaled to a unit diagonal first: the parameters' units are far apart.
    size = np.sqrt(np.clip(np.diag(marginal), 0, None))
    if not np.all(size > 0):
        return 0.0
    values = np.linalg.eigvalsh(marginal / np.outer(size, size))
    if values[0] <= _OPEN:
        return 0.0
    return float(np.exp((np.log(values).sum() + 2 * np.log(size).sum()) / len(keep)))


def _root(covariance: ArrayLike) -> Array:
    """L with L Lᵀ the covariance, scaled so that small variances are as accurate as large ones."""
    matrix = np.asarray(covariance, dtype=np.float64)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not np.isfinite(matrix).all():
        raise InputError(f"a covariance of shape {matrix.shape} was given; it must be square, and finite.")
    diagonal = np.diag(matrix)
    size = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    if np.any(diagonal < 0) or values[0] < -1e-9:
        raise InputError("a covariance with a negative variance was given; it must have none.")
    return np.asarray(size[:, None] * vectors * np.sqrt(np.clip(values, 0, None)))
