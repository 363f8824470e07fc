"""Columns of the linear least-squares problem that a response of the mode gives, in compiled loops."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.compilation import compiled

BELOW_NYQUIST = 0.45
"""Highest frequency of the discrete pitching mode, over the sampling rate."""


@compiled(fastmath={"contract", "arcp", "nsz"})
def pitching_response(
    acceleration: Array, first: NDArray[np.int64], frequency: float, damping: float, dt: float, out: Array
) -> None:
    """Response of the table's pitching mode, of unit gain at low frequency, to its axial acceleration.

    Each window begins at rest.

    Parameters
    ----------
    acceleration : ndarray, shape (n,)
        m/s².
    first : ndarray, shape (windows + 1,)
        First sample of each window.
    frequency, damping : float
        Angular frequency, rad/s, and damping ratio.
    dt : float
        Time between samples, s.
    out : ndarray, shape (n,)
        Filled with the response, m/s².
    """
    # Bilinear transform, prewarped so that the resonance stays at its frequency.
    square = frequency * frequency
    k = frequency / math.tan(frequency * dt / 2)
    a0 = k * k + 2 * damping * frequency * k + square
    b0 = square / a0
    a1, a2 = 2 * (square - k * k) / a0, (k * k - 2 * damping * frequency * k + square) / a0
    for window in range(first.shape[0] - 1):
        memory_0 = memory_1 = 0.0
        for i in range(first[window], first[window + 1]):
            x = acceleration[i]
            y = b0 * x + memory_0
            memory_0 = 2 * b0 * x - a1 * y + memory_1
            memory_1 = b0 * x - a2 * y
            out[i] = y


@compiled()
def differences(values: Array, first: NDArray[np.int64]) -> Array:
    """Derivative by central differences, one-sided at both ends of each window.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Of all windows, one after the other.
    first : ndarray, shape (windows + 1,)
        First sample of each window.

    Returns
    -------
    ndarray, shape (n,)
        Derivative per sample, in the unit of ``values``; 0 in a window of a single sample.
    """
    out = np.zeros(values.shape[0])
    for window in range(first.shape[0] - 1):
        start, last = first[window], first[window + 1] - 1
        if start < last:
            out[start], out[last] = values[start + 1] - values[start], values[last] - values[last - 1]
        for i in range(start + 1, last):
            out[i] = 0.5 * (values[i + 1] - values[i - 1])
    return out


@compiled()
def fill_columns(
    response: Array,
    pitching: Array,
    known: Array,
    ripple: Array,
    first: NDArray[np.int64],
    columns: Array,
) -> None:
    """Fill the columns of the linear least-squares problem of a block, in the order of the parameters.

    Parameters
    ----------
    response : ndarray, shape (n,)
        Response of the axial mode, m/s². Columns: the response and its derivative.
    pitching : ndarray, shape (n,)
        Response of the pitching mode, m/s², for a block with the nut's response; else empty. Further columns:
        the second derivative of ``response``, the response of the pitching mode and its derivative.
    known : ndarray, shape (n, m)
        Columns that do not depend on the mode.
    ripple : ndarray, shape (n, k)
        Response of the mode to the ripple.
    first : ndarray, shape (windows + 1,)
        First sample of each window.
    columns : ndarray, shape (n, 2 + m + k) or (n, 5 + m + k)
        Filled.
    """
    nut = pitching.shape[0] > 0
    own = 5 if nut else 2
    derivative = differences(response, first)
    for i in range(columns.shape[0]):
        columns[i, 0] = response[i]
        columns[i, 1] = derivative[i]
        for k in range(known.shape[1]):
            columns[i, own + k] = known[i, k]
        for k in range(ripple.shape[1]):
            columns[i, own + known.shape[1] + k] = ripple[i, k]
    if nut:
        second, pitching_derivative = differences(derivative, first), differences(pitching, first)
        for i in range(columns.shape[0]):
            columns[i, 2] = second[i]
            columns[i, 3] = pitching[i]
            columns[i, 4] = pitching_derivative[i]


@compiled()
def fill_change(
    response: Array,
    pitching: Array,
    ripple: Array,
    first: NDArray[np.int64],
    weights: Array,
    now: Array,
    step: float,
    change: Array,
) -> None:
    """Fill the difference quotient of a model: columns times weights, less the present model, over the step.

    Parameters
    ----------
    response, pitching, ripple, first
        As for :func:`fill_columns`, without columns that do not depend on the mode.
    weights : ndarray, shape (2 + k, responses) or (5 + k, responses)
        Weights of the columns in each response.
    now : ndarray, shape (n, responses)
        The present model, without columns that do not depend on the mode, m/s².
    step : float
        Change of the parameter by which the columns differ from those of the present model.
    change : ndarray, shape (n, responses)
        Filled, m/s² per unit of the parameter.
    """
    nut = pitching.shape[0] > 0
    own = 5 if nut else 2
    derivative = differences(response, first)
    second, pitching_derivative = derivative, derivative
    if nut:
        second, pitching_derivative = differences(derivative, first), differences(pitching, first)
    for r in range(change.shape[1]):
        of_response, of_derivative = weights[0, r] / step, weights[1, r] / step
        for i in range(change.shape[0]):
            change[i, r] = of_response * response[i] + of_derivative * derivative[i] - now[i, r] / step
        if nut:
            of_second, of_pitching, of_last = weights[2, r] / step, weights[3, r] / step, weights[4, r] / step
            for i in range(change.shape[0]):
                change[i, r] += (
                    of_second * second[i] + of_pitching * pitching[i] + of_last * pitching_derivative[i]
                )
        for k in range(ripple.shape[1]):
            weight = weights[own + k, r] / step
            if weight != 0:
                for i in range(change.shape[0]):
                    change[i, r] += weight * ripple[i, k]
