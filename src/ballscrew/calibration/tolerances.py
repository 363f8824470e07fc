"""Tolerances of the data sheet as limits: resampling of a calibration's posterior samples.

The posterior of the calibration is a normal distribution, in which the numbers of the data sheet have normal
distributions with the variance of their tolerances. The tolerances are limits, which make these distributions
rectangular (JCGM 100:2008, 4.3.7): with normal ones, an interval that depends on them is a fifth too wide. So
the logarithms of the sheet's numbers are computed for each sample, which gets as its weight the rectangular
density over the normal one. Measurements enter through the working vector alone, so this is exact as far as
the model is linear in these logarithms.

A number that the calibration itself estimates outside its tolerance is wrong in the data sheet; its tolerance
is then not used, and it retains the normal distribution of the calibration.

All numbers are deviations of logarithms from the sheet's, in the standard uncertainty by the tolerance,
tolerance/√3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.axial import PARAMETERS
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.tolerances import tolerances
from ballscrew.base.arrays import Array
from ballscrew.base.resampling import systematic
from ballscrew.calibration.calibrated_axis import Doubt, ToleranceEstimate
from ballscrew.calibration.model_forms import ModelForm

_LIMIT = math.sqrt(3.0)  # of a rectangular distribution, in its standard uncertainties
_SIGNIFICANT = 1.645  # standard uncertainties beyond a tolerance: outside at a probability of 95 %
_SURPRISING = 2.58  # standard deviations of an estimate before any data: by chance in one of a hundred
# Part of the sheets' numbers that lie outside their tolerance: they are normal about the sheet's value, with
# the tolerance as the standard deviation.
_OUTSIDE = 0.02
_LEAST_EFFECTIVE = 0.1  # effective part of the samples by their weights; with less all count alike
_LEAST_EFFECT = 0.05  # on share and preload, relative to the largest: a number with less is not limited
_ROUNDING = 1e-10  # relative eigenvalue that is zero
_FIRST = 0.5  # first place of the systematic resampling, in steps
_SLACK = 1e-3  # of a variance or an effect, for the rounding of a file


def estimate_tolerances(form: ModelForm, vector: Array) -> tuple[ToleranceEstimate, ...]:
    """Estimates of the data sheet's numbers by a calibration.

    Parameters
    ----------
    form : ModelForm
        Prior by the sheet.
    vector : ndarray, shape (7,)
        Working vector of the calibration.

    Returns
    -------
    tuple of ToleranceEstimate
        One for each number with a tolerance.
    """
    if not form.tolerances:
        return ()
    finite = np.isfinite(vector) & np.isfinite(form.mean)
    change = np.zeros_like(vector)
    change[finite] = vector[finite] - form.mean[finite]
    effects = np.stack(list(form.tolerances.values()), axis=1)
    estimates = _numbers_by_vector(effects, form.covariance) @ change
    rows = zip(form.tolerances.items(), estimates.tolist(), strict=True)
    return tuple(ToleranceEstimate(field, effect, estimate) for (field, effect), estimate in rows)


def tolerance_doubts(
    estimates: Sequence[ToleranceEstimate],
    sheet: DataSheet,
    prior: Array,
    covariance: Array,
    *,
    explained: bool = False,
) -> tuple[list[Doubt], list[str]]:
    """Numbers of the sheet that are estimated outside their tolerances.

    Parameters
    ----------
    estimates : sequence of ToleranceEstimate
        Of the calibration.
    sheet : DataSheet
        The axis.
    prior, covariance : ndarray, shape (7, 7)
        Covariance of the working vector by the sheet, and by the calibration.
    explained : bool
        Whether another convention of K explains frequencies that contradict the sheet.

    Returns
    -------
    list of Doubt
        Doubts of numbers that are significantly outside, by the names of their fields; where the data
        contradict the sheet, also of the number that is estimated farthest from it.
    list of str
        Notes on numbers that are outside, but not significantly.
    """
    if not estimates:
        return [], []
    widths = tolerances(sheet)
    effects = np.stack([number.effects for number in estimates], axis=1)
    gain = _numbers_by_vector(effects, prior)
    # Variance of each number by the calibration: by the working vector, and what this leaves undetermined.
    variances = np.diag(gain @ covariance @ gain.T + np.eye(len(estimates)) - gain @ effects)
    advice = "check that the sheet belongs to this axis, and check the loads and known preloads"
    doubts, notes = [], []
    # Before any data the estimate of a number has the variance that the data will remove. Frequencies at one
    # preload move all numbers together: the one that moves most is named.
    sizes = np.abs([number.estimate for number in estimates])
    surprises = sizes / np.sqrt(np.maximum(1 - variances, _ROUNDING))
    moved = estimates[int(np.argmax(sizes))].field
    for number, variance, surprise in zip(estimates, variances.tolist(), surprises.tolist(), strict=True):
        text = _estimated(number, widths[number.field])
        excess = abs(number.estimate) - _LIMIT
        if excess > _SIGNIFICANT * math.sqrt(max(variance, 0.0)):
            doubts.append(Doubt(number.field, f"{text}: {advice}"))
        elif not explained and number.field == moved and surprise > _SURPRISING:
            contradiction = (
                f"the frequencies lie {surprise:.1f} standard deviations from those of the data sheet"
            )
            doubts.append(Doubt(number.field, f"{text}, and {contradiction}: {advice}"))
        elif excess > 0:
            notes.append(f"{text}; this is not significant, and the tolerance is not used as a limit")
    return doubts, notes


def _estimated(number: ToleranceEstimate, width: float) -> str:
    """A number's estimate and its tolerance ``width`` (relative) in words."""
    percent = 100 * math.exp(number.estimate * width / _LIMIT)
    return (
        f"{number.field} is estimated at {percent:.0f} % of the data sheet's value, which has a tolerance of "
        f"± {100 * width:.3g} %"
    )


def is_part_of_prior(estimates: Sequence[ToleranceEstimate], prior: Array) -> bool:
    """Whether the prior can contain the variance by the tolerances.

    Parameters
    ----------
    estimates : sequence of ToleranceEstimate
        Of k numbers.
    prior : ndarray, shape (7, 7)
        Covariance of the working vector by the sheet.

    Returns
    -------
    bool
        False where their effects have more variance in some direction than the prior.
    """
    if not estimates:
        return True
    effects = np.stack([number.effects for number in estimates], axis=1)
    # Variances of the numbers for a given working vector, and effects outside the space of the prior.
    remaining = np.linalg.eigvalsh(np.eye(len(estimates)) - _numbers_by_vector(effects, prior) @ effects)
    outside = effects - prior @ np.linalg.pinv(prior, rcond=_ROUNDING, hermitian=True) @ effects
    largest = max(float(np.abs(effects).max()), 1e-9)
    return bool(remaining[0] >= -_SLACK and np.abs(outside).max() <= _SLACK * largest)


def log_density_ratio(numbers: Array) -> Array:
    """Logarithm of the density by tolerances over the normal density.

    Parameters
    ----------
    numbers : ndarray, shape (n, k)
        Deviations from the sheet's values, in standard uncertainties.

    Returns
    -------
    ndarray, shape (n,)
        Up to a constant.
    """
    inside = np.where(np.abs(numbers) <= _LIMIT, math.log((1 - _OUTSIDE) / (2 * _LIMIT)), -np.inf)
    outside = math.log(_OUTSIDE / math.sqrt(2 * math.pi) / _LIMIT) - numbers**2 / (2 * _LIMIT**2)
    return np.asarray(np.sum(np.logaddexp(inside, outside) + numbers**2 / 2, axis=1))


def resample_within_tolerances(
    estimates: Sequence[ToleranceEstimate], prior: Array, deviations: Array, normal: Array, count: int
) -> NDArray[np.intp]:
    """Samples of a calibration, resampled by the density of the sheet's numbers.

    Parameters
    ----------
    estimates : sequence of ToleranceEstimate
        Of k numbers.
    prior : ndarray, shape (7, 7)
        Covariance of the working vector by the sheet.
    deviations : ndarray, shape (n, 7)
        Samples of the working vector, less the calibration's.
    normal : ndarray, shape (n, k)
        Independent standard-normal numbers: the vector alone does not determine the sheet's numbers.
    count : int
        Number of samples to choose, at most n.

    Returns
    -------
    ndarray of int, shape (count,)
        Rows of the chosen samples; evenly from all where no number is limited.
    """
    evenly = systematic(np.full(len(deviations), 1 / len(deviations)), _FIRST, count)
    limited = _limited(estimates)
    if not limited.any():
        return evenly
    effects = np.stack([number.effects for number in estimates], axis=1)
    gain = _numbers_by_vector(effects, prior)
    # The numbers are their estimates from the vector, and a part that the vector does not determine.
    size, axes = np.linalg.eigh(np.eye(len(estimates)) - gain @ effects)
    remaining = normal * np.sqrt(np.clip(size, 0.0, None)) @ axes.T
    numbers = np.array([number.estimate for number in estimates]) + deviations @ gain.T + remaining
    log_weights = log_density_ratio(numbers[:, limited])
    weights = np.exp(log_weights - log_weights.max())
    if float(weights.sum()) ** 2 < _LEAST_EFFECTIVE * len(weights) * float(weights @ weights):
        return evenly
    return systematic(weights / float(weights.sum()), _FIRST, count)


def _limited(estimates: Sequence[ToleranceEstimate]) -> NDArray[np.bool_]:
    """Mask of the numbers that affect the preload and are estimated within their tolerance, shape (k,)."""
    at = [PARAMETERS.index("share"), PARAMETERS.index("preload")]
    effect = np.array([float(np.linalg.norm(number.effects[at])) for number in estimates])
    distance = np.abs(np.array([number.estimate for number in estimates]))
    relevant = (effect > 0) & (effect >= _LEAST_EFFECT * effect.max(initial=0.0))
    return np.asarray((distance <= _LIMIT) & relevant)


def _numbers_by_vector(effects: Array, prior: Array) -> Array:
    """Matrix, shape (k, 7), that estimates the k numbers from a deviation of the working vector."""
    return np.asarray(effects.T @ np.linalg.pinv(prior, rcond=_ROUNDING, hermitian=True))
