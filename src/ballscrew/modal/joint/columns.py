"""Columns of the linear least-squares problem of a block, in compiled loops.

The axial and the pitching mode determine the first columns, in this order: the response of the axial mode and
its derivative; for accelerometers at the nut also the second derivative of this response, the response of the
pitching mode, and its derivative; the response of the axial mode times the position of the stop. Derivatives
are per sample.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.compilation import compiled

BELOW_NYQUIST = 0.45
"""Highest frequency of the discrete pitching mode, over the sampling rate."""

MOTOR_MODE_COLUMNS = 3
"""Number of columns that the axial mode determines in a block with the motor's response."""

NUT_MODE_COLUMNS = 6
"""Number of columns that the axial and the pitching mode determine in a block with the nut's response."""


@compiled(fastmath={"contract", "arcp", "nsz"})
def pitching_response(
    acceleration: Array, starts: NDArray[np.int64], frequency: float, damping: float, dt: float, out: Array
) -> None:
    """Response of the table's pitching mode, of unit gain at low frequency, to its axial acceleration.

    Each window begins at rest.

    Parameters
    ----------
    acceleration : ndarray, shape (n,)
        Axial acceleration of the table, m/s².
    starts : ndarray, shape (windows + 1,)
        Index of the first sample of each window, and the number of samples.
    frequency, damping : float
        Angular frequency, rad/s, and damping ratio.
    dt : float
        Time between samples, s.
    out : ndarray, shape (n,)
        Filled with the response, m/s².
    """
    # Bilinear transform, prewarped so that the resonance stays at its frequency: s = k (1 - 1/z) / (1 + 1/z).
    # Coefficients of the output: 1, a1, a2; of the input: b0, 2 b0, b0.
    square = frequency * frequency
    k = frequency / math.tan(frequency * dt / 2)
    a0 = k * k + 2 * damping * frequency * k + square
    b0 = square / a0
    a1 = 2 * (square - k * k) / a0
    a2 = (k * k - 2 * damping * frequency * k + square) / a0
    for window in range(starts.shape[0] - 1):
        memory_0 = memory_1 = 0.0
        for i in range(starts[window], starts[window + 1]):
            x = acceleration[i]
            y = b0 * x + memory_0
            memory_0 = 2 * b0 * x - a1 * y + memory_1
            memory_1 = b0 * x - a2 * y
            out[i] = y


@compiled()
def differences(values: Array, starts: NDArray[np.int64]) -> Array:
    """Derivative by central differences, one-sided at both ends of each window.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Signal in all windows, one after the other.
    starts : ndarray, shape (windows + 1,)
        Index of the first sample of each window, and the number of samples.

    Returns
    -------
    ndarray, shape (n,)
        Derivative per sample, in the unit of ``values``; 0 in a window of a single sample.
    """
    out = np.zeros(values.shape[0])
    for window in range(starts.shape[0] - 1):
        start, last = starts[window], starts[window + 1] - 1
        if start < last:
            out[start] = values[start + 1] - values[start]
            out[last] = values[last] - values[last - 1]
        for i in range(start + 1, last):
            out[i] = 0.5 * (values[i + 1] - values[i - 1])
    return out


@compiled()
def fill_columns(
    response: Array,
    pitching: Array,
    fixed: Array,
    ripple: Array,
    stop: Array,
    starts: NDArray[np.int64],
    columns: Array,
) -> None:
    """Fill the columns of a block: those of the modes, the fixed ones, and those of the ripple.

    Parameters
    ----------
    response : ndarray, shape (n,)
        Response of the axial mode, m/s².
    pitching : ndarray, shape (n,)
        Response of the pitching mode, m/s², for a block with the nut's response; else empty, shape (0,).
    fixed : ndarray, shape (n, m)
        Columns that do not depend on the modes.
    ripple : ndarray, shape (n, k)
        Response of the axial mode to each force of the ripple, m/s².
    stop : ndarray, shape (n,)
        Position of the stop from the mean of all stops, m.
    starts : ndarray, shape (windows + 1,)
        Index of the first sample of each window, and the number of samples.
    columns : ndarray, shape (n, 3 + m + k), or (n, 6 + m + k) for the nut's response
        Filled. The modes have :data:`MOTOR_MODE_COLUMNS` or :data:`NUT_MODE_COLUMNS` of them.
    """
    nut = pitching.shape[0] > 0
    mode_columns = NUT_MODE_COLUMNS if nut else MOTOR_MODE_COLUMNS
    derivative = differences(response, starts)
    for i in range(columns.shape[0]):
        columns[i, 0] = response[i]
        columns[i, 1] = derivative[i]
        columns[i, mode_columns - 1] = stop[i] * response[i]
        for k in range(fixed.shape[1]):
            columns[i, mode_columns + k] = fixed[i, k]
        for k in range(ripple.shape[1]):
            columns[i, mode_columns + fixed.shape[1] + k] = ripple[i, k]
    if nut:
        second = differences(derivative, starts)
        pitching_derivative = differences(pitching, starts)
        for i in range(columns.shape[0]):
            columns[i, 2] = second[i]
            columns[i, 3] = pitching[i]
            columns[i, 4] = pitching_derivative[i]


@compiled()
def fill_change(
    response: Array,
    pitching: Array,
    ripple: Array,
    stop: Array,
    starts: NDArray[np.int64],
    weights: Array,
    present: Array,
    step: float,
    change: Array,
) -> None:
    """Fill the difference quotient of a model: columns times weights, less the present model, over the step.

    The fixed columns have no part in it.

    Parameters
    ----------
    response, pitching, ripple, stop, starts
        As for :func:`fill_columns`, after the change of a parameter.
    weights : ndarray, shape (3 + k, responses), or (6 + k, responses) for the nut's response
        Weights of the columns in each response.
    present : ndarray, shape (n, responses)
        Model before the change of the parameter, without fixed columns, m/s².
    step : float
        Change of the parameter.
    change : ndarray, shape (n, responses)
        Filled, m/s² per unit of the parameter.
    """
    nut = pitching.shape[0] > 0
    mode_columns = NUT_MODE_COLUMNS if nut else MOTOR_MODE_COLUMNS
    derivative = differences(response, starts)
    second, pitching_derivative = derivative, derivative  # not used without the nut: numba needs a value
    if nut:
        second = differences(derivative, starts)
        pitching_derivative = differences(pitching, starts)
    for r in range(change.shape[1]):
        factor, derivative_factor = weights[0, r] / step, weights[1, r] / step
        stop_factor = weights[mode_columns - 1, r] / step
        for i in range(change.shape[0]):
            change[i, r] = (
                (factor + stop_factor * stop[i]) * response[i]
                + derivative_factor * derivative[i]
                - present[i, r] / step
            )
        if nut:
            second_factor = weights[2, r] / step
            pitching_factor, pitching_derivative_factor = weights[3, r] / step, weights[4, r] / step
            for i in range(change.shape[0]):
                change[i, r] += (
                    second_factor * second[i]
                    + pitching_factor * pitching[i]
                    + pitching_derivative_factor * pitching_derivative[i]
                )
        for k in range(ripple.shape[1]):
            weight = weights[mode_columns + k, r] / step
            if weight != 0:
                for i in range(change.shape[0]):
                    change[i, r] += weight * ripple[i, k]
