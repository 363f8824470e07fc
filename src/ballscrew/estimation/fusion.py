"""All cells to one number: generalised least squares, and what becomes of its errors.

The unknown is u = (P/P₀)^(−1/3), in which the compliance is linear (Eq. (3) of Han, Miller, Vogl, Chen and
Jia, 2024), so that one step of Gauss and Newton is exact (Aitken, 1936). P/P₀ = u⁻³ is not: its interval is
carried through the power and the uncertain share, not drawn as ± about the value.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.quantity import Quantity
from ballscrew.estimation.change import ComplianceChange, covariance_of

__all__ = ["DRAWS", "FLOOR", "FusedChange", "draws", "fuse", "fuse_on_worn_nut", "misfit", "told"]

FLOOR = "what no model tells"
DRAWS = 10_000
"""The ends of a 95 % interval to 1 % of its width."""

_SEED = 20_241
_LEAST = 1e-9
_TURNS = 8
_FAR = 2.5
_RATIO_TURNS = 11
_SETTLED = 1e-3  # of P/P₀: it moves the correction for the nut's load by a hundredth of that


@dataclass(frozen=True, slots=True, eq=False)
class FusedChange:
    """One change of the nut out of n cells.

    Parameters
    ----------
    level : float
        u − 1.
    weights : ndarray, shape (n,)
        Of the cells: level = weights · Y.
    terms : mapping of str to (float, bool)
        Standard uncertainty of u by each term, and whether another run would draw it anew.
    model : ndarray, shape (7,)
        By the working vector, where the reference is the model's; zeros where it is a run.
    residual : ndarray, shape (n,)
        Of Y.
    chi2, degrees : float
        Misfit, and what it is expected to be: numbers in the data that are free to misfit, few where all
        cells lie on one curve.
    probability : float
        Of a misfit as large or larger where nothing is wrong.
    """

    level: float
    weights: Array
    terms: dict[str, tuple[float, bool]]
    model: Array
    residual: Array
    chi2: float
    degrees: float
    probability: float

    @property
    def random(self) -> float:
        """Standard uncertainty of u that another run would draw anew."""
        return float(np.sqrt(sum(u**2 for u, random in self.terms.values() if random)))

    @property
    def spread(self) -> float:
        """Standard uncertainty of u by all terms, random and not; the model's is not in it."""
        return float(np.sqrt(sum(u**2 for u, _ in self.terms.values())))


def fuse(change: ComplianceChange, model_covariance: Array | None = None) -> FusedChange:
    """Fuse all cells.

    Parameters
    ----------
    change : ComplianceChange
        Of one cell or more.
    model_covariance : ndarray, shape (7, 7), optional
        Of the working vector, where the reference is the model's.

    Returns
    -------
    FusedChange
        At the model's share.
    """
    true = covariance_of(change, floor=False)
    by_model = np.zeros((7, len(change.y))) if change.model is None else change.model
    if model_covariance is not None and change.model is not None:
        true = true + by_model.T @ model_covariance @ by_model
    whole = true + np.diag(change.floor**2)
    weights = _weights(change, whole)
    level = float(weights @ change.y)
    terms = {t.name: (float(np.linalg.norm(t.effects @ weights)), t.random) for t in change.terms}
    terms[FLOOR] = (float(np.linalg.norm(change.floor * weights)), True)
    residual = change.y - level * change.nut
    chi2, degrees, probability = misfit(residual, change.nut[:, None], true, change.floor)
    return FusedChange(level, weights, terms, by_model @ weights, residual, chi2, degrees, probability)


def fuse_on_worn_nut(
    change_at: Callable[[float], ComplianceChange], model_covariance: Array | None = None
) -> tuple[ComplianceChange, FusedChange, float]:
    """Fuse all cells, corrected for the test's own load at the preload that results.

    The test's load softens a worn nut more than a new one, so the change of the compliance depends on P/P₀,
    which it determines: a fixed point, found by the secant method.

    Parameters
    ----------
    change_at : callable
        Change of the compliance, corrected for the load at a given P/P₀.
    model_covariance : ndarray, shape (7, 7), optional
        As :func:`fuse`.

    Returns
    -------
    change : ComplianceChange
        Corrected.
    fused : FusedChange
        All its cells fused.
    ratio : float
        P/P₀ at which the change was corrected.
    """
    ratio, slope = (
        1.0,
        -2.0,
    )  # the first step goes half way: load and preload pull each other, and would swing
    change = change_at(ratio)
    fused = fuse(change, model_covariance)
    error = _ratio_of(fused) - ratio
    for _ in range(_RATIO_TURNS):
        if abs(error) < _SETTLED:
            break
        before, error_before = ratio, error
        ratio = min(max(ratio - error / min(slope, -0.5), 0.1), 10.0)
        change = change_at(ratio)
        fused = fuse(change, model_covariance)
        error = _ratio_of(fused) - ratio
        if ratio != before:
            slope = (error - error_before) / (ratio - before)
    return change, fused, ratio


def _ratio_of(fused: FusedChange) -> float:
    """P/P₀, between an eighth and eight."""
    return min(max(1 + fused.level, 0.5), 2.0) ** -3


def _weights(change: ComplianceChange, covariance: Array) -> Array:
    """Of the cells: first to a level and a slope of the nut's change, then these two to one by what they err.

    The full covariance over forty cells that lie on one curve would find some contrast of them in which all
    its terms cancel, and trust that. Nobody knows a covariance so well; of level and slope it is known.
    """
    x = change.position - change.position.mean()
    half = float(np.ptp(x)) / 2
    slope = half > 0 and len(np.unique(change.position)) > 2
    basis = np.stack([change.nut, change.nut * x / half] if slope else [change.nut], axis=1)
    size = np.sqrt(np.diag(covariance))
    trust = np.ones_like(size)
    for _ in range(_TURNS):
        scaled = basis * (trust / size)[:, None]
        to_two = np.linalg.pinv(scaled) * (trust / size)
        off = np.abs(change.y - basis @ (to_two @ change.y)) / size
        # A cell that is no part of the course is turned down (Huber, 1964), none that is.
        trust = np.sqrt(np.minimum(1.0, _FAR / np.maximum(off, 1e-12)))
    both = to_two @ covariance @ to_two.T
    pulled = np.linalg.solve(both, np.eye(len(both))[0])
    return np.asarray((pulled / pulled[0]) @ to_two)


def misfit(residual: Array, fitted: Array, true: Array, floor: Array) -> tuple[float, float, float]:
    """χ² of what is left over, against what is expected of it.

    Forty cells on one smooth curve are two or three numbers. The floor makes the covariance regular but is no
    noise that is there; χ² is a weighted sum of squares, and it is told as one of as many degrees of freedom
    as its mean and variance say (Satterthwaite, 1946, DOI 10.2307/3002019).

    Parameters
    ----------
    residual : ndarray, shape (n,)
        Of Y.
    fitted : ndarray, shape (n, m)
        What was fitted to Y.
    true : ndarray, shape (n, n)
        Covariance of Y without the floor.
    floor : ndarray, shape (n,)
        Standard deviations.

    Returns
    -------
    chi2, degrees, probability : float
        Scaled so that χ² is compared with its degrees; 0, 0 and 1 where nothing is free to misfit.
    """
    root = np.linalg.cholesky(true + np.diag(floor**2))
    white = np.linalg.solve(root, residual)
    basis = np.linalg.qr(np.linalg.solve(root, fitted))[0]
    left = white - basis @ (basis.T @ white)
    inner = np.linalg.solve(root, np.linalg.solve(root, true).T)
    project = np.eye(len(residual)) - basis @ basis.T
    sizes = np.clip(np.linalg.eigvalsh(project @ inner @ project), 0.0, None)
    total, square = float(sizes.sum()), float((sizes**2).sum())
    if total < _LEAST or len(residual) <= fitted.shape[1]:
        return 0.0, 0.0, 1.0
    degrees, scale = total**2 / square, square / total
    chi2 = float(left @ left) / scale
    from scipy.special import chdtrc

    return chi2, degrees, float(chdtrc(degrees, chi2))


def draws(covariance: Array, others: int, count: int = DRAWS) -> tuple[Array, Array]:
    """Draw from the model's posterior, and independent standard-normal numbers beside; always the same ones.

    Parameters
    ----------
    covariance : ndarray, shape (m, m)
        Positive semi-definite.
    others : int
        How many numbers beside.
    count : int
        How many draws, even.

    Returns
    -------
    ndarray, shape (count, m)
        Deviations from the mean.
    ndarray, shape (count, others)
        Standard normal.
    """
    half = np.random.default_rng(_SEED).standard_normal((count // 2, len(covariance) + others))
    numbers = np.concatenate([half, -half])  # antithetic: the means are exact
    size, axes = np.linalg.eigh((covariance + covariance.T) / 2)
    root = axes * np.sqrt(np.clip(size, 0.0, None))
    return numbers[:, : len(covariance)] @ root.T, numbers[:, len(covariance) :]


def told(value: float, samples: Array, unit: str = "") -> Quantity | None:
    """A quantity from what it may be.

    Parameters
    ----------
    value : float
        Best estimate.
    samples : ndarray
        Of it; infinite where nothing bounds it.
    unit : str
        Of it.

    Returns
    -------
    Quantity or None
        Interval: the middle 95 %; None where that has no upper end. Standard uncertainty: the standard
        deviation, what lies beyond the middle 99 % set to its ends; half of the middle 68 % where these have
        no upper end.
    """
    parts = [0.005, 0.025, 0.15866, 0.84134, 0.975, 0.995]
    first, low, left, right, high, last = np.quantile(samples, parts, method="nearest")
    if not np.isfinite([value, low, left, right, high]).all():
        return None
    spread = float(np.std(np.clip(samples, first, last))) if np.isfinite(last) else float(right - left) / 2
    return Quantity(value, spread, unit, (min(float(low), value), max(float(high), value)))
