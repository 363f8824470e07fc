"""Local wear: a random deviation of the compliance at every stop from the smooth profile along the axis.

The variance of these deviations is estimated from the run itself: it is the variance of the stops in excess
of that due to the scatter of the cells. It is 0 on an axis with even wear. On an axis with local wear, the
compliance at each stop follows the data of this stop the more, the smaller their uncertainty is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, logsumexp

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.fit import SAMPLES_PER_INDEPENDENT, JointFit, Prior
from ballscrew.modal.joint.mode import FORM_DEVIATION, AxialMode
from ballscrew.modal.joint.parameters import LOCAL
from ballscrew.modal.joint.uncertainty import cell_steps

# Standard deviations of the local compliances that are tried, over the compliance in the middle.
_SPREADS = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 81)])
# Prior standard deviation of a smooth profile (line or parabola) among the local compliances, over that of a
# local compliance: so small that nearly all of such a profile is in the parameters of the smooth profile.
_SMOOTH = 0.01
# Least gain in log-likelihood of a significant variation: a likelihood ratio of 55, exceeded by chance in one
# of 220 to 570 even axes (4,000 simulated scores each of 2 to 8 contrasts with 4 to 30 degrees of freedom).
_SIGNIFICANT = 4.0
_QUANTILES = (np.arange(40) + 0.5) / 40  # probabilities: quantiles of the inflation that are averaged
_ROUNDING = 1e-6  # of the largest eigenvalue of the information: smaller ones are rounding errors


@dataclass(frozen=True, slots=True)
class LocalVariation:
    """Variation of the compliance from stop to stop, as estimated from a run.

    Parameters
    ----------
    spread : float
        Standard deviation of the local compliances, over the compliance in the middle; 0 if the variation is
        not significant.
    inflation : float
        Variance of the cells' estimates about the means of conditions and stops, over that expected for white
        residuals.
    prior_inflation : float
        Result of :func:`~ballscrew.modal.joint.uncertainty.variance_inflation`, as assumed in the priors of
        the other parameters.
    """

    spread: float
    inflation: float
    prior_inflation: float = 0.0


UNKNOWN = LocalVariation(0.0, 100.0)
"""Variation assumed before a run is fitted: none. Its inflation has no effect without a spread."""


def with_stops(modes: tuple[AxialMode, ...], stops: tuple[float, ...]) -> tuple[AxialMode, ...]:
    """Modes with a local compliance of 0 at every stop; ``stops`` are positions from the middle, m."""
    return tuple(replace(mode, stops=stops, local=(0.0,) * len(stops)) for mode in modes)


def local_fields(stops: tuple[float, ...]) -> tuple[str, ...]:
    """Names of the local compliances as fields of a fit: ``"local:0"`` and so on."""
    return tuple(f"{LOCAL}{k}" for k in range(len(stops)))


def _coefficients(curved: bool) -> int:
    """Number of coefficients of a smooth profile: of a parabola or of a line."""
    if curved:
        return 3
    return 2


def _smooth_basis(stops: tuple[float, ...], curved: bool) -> Array:
    """Orthonormal basis of lines, shape (stops, 2), or of parabolas if ``curved``, shape (stops, 3)."""
    powers = np.vander(np.array(stops), _coefficients(curved), increasing=True)
    return np.asarray(np.linalg.qr(powers)[0])


def local_priors(variation: LocalVariation, stops: tuple[float, ...], curved: bool) -> list[Prior]:
    """Priors of the local compliances: each is 0 ± spread, and they contain almost no line or parabola."""
    # In proportion to the weight of the data, as Profile.scaled.
    deviation = variation.spread * float(np.sqrt(SAMPLES_PER_INDEPENDENT / variation.inflation))
    names = local_fields(stops)
    out = []
    for profile in _smooth_basis(stops, curved).T.tolist():
        weights = tuple(zip(names, profile, strict=True))
        out.append(Prior(weights, 0.0, _SMOOTH * deviation))
    return out + [Prior(((name, 1.0),), 0.0, deviation) for name in names]


def shrinkage_covariance(fit: JointFit, variation: LocalVariation) -> Array:
    """Covariance of the parameters due to the shrinkage of form and local compliances by their priors.

    The true local compliances have the standard deviation ``spread``, and contain no smooth profile. Their
    prior, whose information in the fit is inflation / spread², shifts the parameters in proportion to them;
    the prior of the form does likewise.

    Parameters
    ----------
    fit : JointFit
        The fit.
    variation : LocalVariation
        Local variation assumed in its priors.

    Returns
    -------
    ndarray, shape (parameters, parameters)
        0 if the fit has neither a form nor local compliances.
    """
    inverse = np.linalg.pinv(fit.hessian)
    covariance = np.zeros_like(inverse)
    if ("form", None) in fit.parameters:
        form = fit.parameters.index(("form", None))
        # Shift of the parameters by a form that differs from its mean by one standard deviation.
        shift = inverse[:, form] * (variation.prior_inflation / FORM_DEVIATION)
        covariance += np.outer(shift, shift)
    local = [k for k, (field, _) in enumerate(fit.parameters) if field.startswith(LOCAL)]
    if not local or variation.spread == 0:
        return covariance
    smooth = _smooth_basis(fit.modes[0].stops, ("curve", 0) in fit.parameters)
    # Shift of the parameters by local compliances of one standard deviation each.
    shifts = inverse[:, local] * (variation.inflation / variation.spread)
    without_smooth = np.eye(len(local)) - smooth @ smooth.T
    return np.asarray(covariance + shifts @ without_smooth @ shifts.T)


def local_residue(mode: AxialMode, stops: Array) -> Array:
    """Absolute deviation of the local compliance at stops from the line between the neighbouring stops.

    Parameters
    ----------
    mode : AxialMode
        Mode with local compliances, or without.
    stops : ndarray, shape (n,)
        Positions of stops from the middle, m.

    Returns
    -------
    ndarray, shape (n,)
        Over the compliance in the middle. At the first and the last stop, the deviation is that of its
        neighbour; 0 with less than three local compliances.
    """
    if len(mode.local) < 3:
        return np.zeros_like(stops)
    local, x = np.array(mode.local), np.array(mode.stops)
    nearest = np.array([int(np.argmin(np.abs(x - stop))) for stop in stops])
    inner = np.arange(1, len(local) - 1)
    fraction = (x[inner] - x[inner - 1]) / (x[inner + 1] - x[inner - 1])
    line = local[inner - 1] + fraction * (local[inner + 1] - local[inner - 1])
    residue = np.abs(local[inner] - line)
    return np.asarray(np.concatenate([residue[:1], residue, residue[-1:]])[nearest])


def estimate_variation(fit: JointFit, curved: bool) -> LocalVariation:
    """Estimate the variation by restricted maximum likelihood, with the model linearised at the fit.

    Parameters
    ----------
    fit : JointFit
        Fit with the local compliances among its parameters.
    curved : bool
        Whether the smooth profile is a parabola, and not a line.

    Returns
    -------
    LocalVariation
        With a spread of 0 if the variation is not significant.
    """
    is_local = np.array([field.startswith(LOCAL) for field, _ in fit.parameters])
    inflation, freedom = _inflation(fit, np.flatnonzero(is_local))
    coefficients = _coefficients(curved)
    if np.count_nonzero(is_local) <= coefficients:
        return LocalVariation(0.0, inflation)  # a smooth profile fits all stops exactly
    information, weighted = _local_information(fit, is_local)
    # Contrasts between the stops, to which a smooth profile adds nothing; then independent combinations of
    # them.
    complete = np.linalg.qr(_smooth_basis(fit.modes[0].stops, curved), mode="complete")[0]
    contrasts = complete[:, coefficients:]
    information, weighted = contrasts.T @ information @ contrasts, contrasts.T @ weighted
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    determined = values > _ROUNDING * values[-1]
    values, scores = values[determined], (vectors.T @ weighted)[determined]
    log_likelihood = _log_likelihood(scores, values, inflation, freedom)
    best = int(np.argmax(log_likelihood))
    if log_likelihood[best] > log_likelihood[0] + _SIGNIFICANT:
        return LocalVariation(float(_SPREADS[best]), inflation)
    return LocalVariation(0.0, inflation)


def _log_likelihood(scores: Array, values: Array, inflation: float, freedom: int) -> Array:
    """Log-likelihood of each of _SPREADS, shape (spreads,).

    The likelihood is averaged over the inflation, which a few cells determine only roughly: ``freedom`` times
    the estimated ``inflation`` over its true value has a chi-squared distribution with ``freedom`` degrees of
    freedom. ``scores`` are independent, with the information ``values``, both of shape (contrasts,).
    """
    # Possible true values of the inflation, with equal probability.
    possible = inflation * freedom / (2 * gammaincinv(freedom / 2, _QUANTILES))
    variance = values**2 * _SPREADS[:, None, None] ** 2 + possible[:, None] * values  # of the scores
    each = -0.5 * np.sum(np.log(variance) + scores**2 / variance, axis=2)
    return np.asarray(logsumexp(each, axis=1) - math.log(len(possible)))


def _local_information(fit: JointFit, is_local: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Information matrix of the local compliances, and its product with their estimate.

    Both are those of the data without priors, with all other parameters eliminated; shapes (stops, stops) and
    (stops,).
    """
    at, rest = np.flatnonzero(is_local), np.flatnonzero(~is_local)
    score = np.asarray(sum(j.T @ r for j, r in zip(fit.jacobian, fit.residual, strict=True)))
    crossed = fit.information[np.ix_(rest, at)]
    regression = np.linalg.pinv(fit.information[np.ix_(rest, rest)]) @ crossed
    of_local = fit.information[np.ix_(at, at)] - crossed.T @ regression
    step = score[at] - regression.T @ score[rest]
    return of_local, step + of_local @ np.array(fit.modes[0].local)


def _inflation(fit: JointFit, parameters: NDArray[np.intp]) -> tuple[float, int]:
    """Variance of the cells about the means of conditions and stops, over that for white residuals.

    Returned with its degrees of freedom, both at least 1. ``parameters`` are the indices of the local
    compliances.
    """
    cells = fit.blocks[0].windows.cells
    positions = np.array(fit.modes[0].stops) + fit.blocks[0].windows.middle  # of the stops, m
    nearest = np.array([int(np.argmin(np.abs(positions - cell.position))) for cell in cells])
    deviation, weight = cell_steps(fit, parameters[nearest], range(len(fit.blocks)))
    freedom = len(cells)
    conditions = np.array([f"{cell.condition} {cell.motion}" for cell in cells])
    for grouping in (conditions, nearest):
        for name in np.unique(grouping):
            group = grouping == name
            total = max(float(np.sum(weight[group])), 1e-300)
            deviation[group] -= np.sum(deviation[group] * weight[group]) / total
            freedom -= 1
    freedom = max(freedom + 1, 1)  # the means of conditions and those of stops have a common mean
    return max(float(np.sum(weight * deviation**2)) / freedom, 1.0), freedom
