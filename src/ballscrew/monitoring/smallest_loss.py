"""Smallest loss of preload that a test of means detects: the necessary shift, and the loss that causes it."""

from __future__ import annotations

import math

import numpy as np

from ballscrew.axis import axial
from ballscrew.axis.axial import AxialModel, from_vector, to_vector
from ballscrew.base.arrays import Array

MOST_LOSS = 0.99
"""Largest loss that is reported, as a fraction of the preload."""

_MANY = 1e4  # degrees of freedom from which on the standard error counts as known


def needed_shift(degrees: float, false_alarm: float, power: float) -> float:
    """Shift of a mean, in standard errors, that Student's one-sided test detects.

    Parameters
    ----------
    degrees : float
        Degrees of freedom of the estimated standard error; infinite where it is known.
    false_alarm, power : float
        Probability of a detection without a shift, and of a detection with this one.

    Returns
    -------
    float
        Noncentrality at which the probability of detection is ``power``; z₁₋α + z_power for many degrees.
    """
    from scipy.optimize import brentq
    from scipy.stats import nct, norm, t

    normal = float(norm.isf(false_alarm) + norm.ppf(power))
    if not degrees < _MANY:
        return normal
    limit = float(t.isf(false_alarm, degrees))

    def power_error(shift: float) -> float:
        return float(nct.sf(limit, degrees, shift)) - power

    return float(brentq(power_error, 0.0, 3 * max(limit, normal), xtol=1e-6))


def smallest_loss(model: AxialModel, load: float, x: Array, weights: Array, shift: float) -> float | None:
    """Loss of preload that decreases the fused ln f of the cells by a shift.

    Parameters
    ----------
    model : AxialModel
        The axis, with its reference preload.
    load : float
        On the table, kg.
    x : ndarray, shape (n,)
        Positions of the cells, m.
    weights : ndarray, shape (n,)
        Weight of each cell's ln f.
    shift : float
        Decrease of their weighted sum.

    Returns
    -------
    float or None
        Fraction of the reference preload; None if it exceeds :data:`MOST_LOSS`.
    """
    from scipy.optimize import brentq

    start = np.log(axial.frequency(model, x, load))

    def shift_error(loss: float) -> float:
        decrease = start - np.log(axial.frequency(model, x, load, 1 - loss))
        return float(weights @ decrease) - shift

    if shift_error(MOST_LOSS) < 0:
        return None
    return float(brentq(shift_error, 0.0, MOST_LOSS, xtol=1e-9))


def log_odds_variance(
    model: AxialModel, covariance: Array, load: float, x: Array, weights: Array, shift: float
) -> float:
    """Variance of the log odds of the smallest loss, to first order in the working vector.

    The weights and the shift, in ln f, are those of the test: they do not depend on the axis.

    Parameters
    ----------
    model, load, x, weights, shift
        As in :func:`smallest_loss`.
    covariance : ndarray, shape (7, 7)
        Covariance of the working vector.

    Returns
    -------
    float
        Variance of ln(loss / (1 - loss)), which is closer to normal than the loss itself.
    """
    vector = to_vector(model)
    slope = np.zeros(len(vector))
    for i in np.flatnonzero(np.diag(covariance) > 0):
        step = 0.1 * math.sqrt(covariance[i, i])
        sides = []
        for sign in (1, -1):
            moved = vector.copy()
            moved[i] += sign * step
            loss = smallest_loss(from_vector(moved, model.centre), load, x, weights, shift)
            bounded = MOST_LOSS if loss is None else loss
            sides.append(math.log(bounded / (1 - bounded)))
        slope[i] = (sides[0] - sides[1]) / (2 * step)
    return max(float(slope @ covariance @ slope), 0.0)
