"""Whitening of residuals, and removal of the free vibration with which a window may begin."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.compilation import compiled

_WHITENING_ORDER = 8  # order of the autoregressive model of a residual
_CACHED = 1024  # elements that are filtered at a time: 8 kB of each array, so that they stay in the cache


@compiled()
def _filter(values: Array, taps: Array, columns: int, out: Array) -> None:
    """Filter each column of a window, which begins at rest.

    ``values`` contains the samples of the window, each with its ``columns`` elements, one after the other;
    ``out``, of the same length, is filled likewise. ``taps`` are the coefficients of the filter, without
    unit.
    """
    # Tap by tap over a part that fits into the processor's cache: such loops are vectorised.
    for begin in range(0, values.shape[0], _CACHED):
        end = min(begin + _CACHED, values.shape[0])
        out[begin:end] = 0.0
        for k in range(len(taps)):
            tap, delay = taps[k], k * columns
            first = max(begin, delay)
            sums, earlier = out[first:end], values[first - delay : end - delay]
            for j in range(sums.shape[0]):
                sums[j] += tap * earlier[j]


@compiled()
def whiten_windows(
    values: Array,
    starts: NDArray[np.int64],
    taps: Array,
    counted: NDArray[np.bool_],
    free_vibration: Array,
    out: Array,
) -> None:
    """Whiten every window, and subtract its projection on the free vibration.

    Parameters
    ----------
    values : ndarray, shape (n, columns)
        Signals of all windows, concatenated.
    starts : ndarray, shape (windows + 1,)
        Index of the first sample of each window, and the number of samples.
    taps : ndarray, shape (taps,)
        Coefficients of the whitening filter, without unit. Before a window the signals count as 0.
    counted : ndarray of bool, shape (n,)
        Samples that enter the fit; the others are 0 in the result.
    free_vibration : ndarray, shape (n, k)
        Free vibration as of :func:`free_responses`, orthonormal in every window.
    out : ndarray, shape (n, columns)
        Filled with the whitened signals, in the unit of ``values``.
    """
    columns = values.shape[1]
    flat, flat_out = values.reshape(values.size), out.reshape(out.size)
    for window in range(starts.shape[0] - 1):
        start, stop = starts[window], starts[window + 1]
        begin, end = start * columns, stop * columns
        _filter(flat[begin:end], taps, columns, flat_out[begin:end])
        for i in range(start, stop):
            if not counted[i]:
                out[i] = 0.0
        vibration, whitened = free_vibration[start:stop], out[start:stop]
        whitened -= np.dot(vibration, np.dot(vibration.T, whitened))


@compiled()
def free_responses(
    starts: NDArray[np.int64],
    begin: NDArray[np.int64],
    omega: Array,
    damping: Array,
    dt: float,
    taps: Array,
    counted: NDArray[np.bool_],
    out: Array,
) -> None:
    """Free vibration with which a window may begin: decaying cosines and sines, whitened and orthonormal.

    Parameters
    ----------
    starts : ndarray, shape (windows + 1,)
        Index of the first sample of each window, and the number of samples.
    begin : ndarray, shape (windows,)
        Index of the first counted sample of each window: the vibration decays from there.
    omega : ndarray, shape (windows, modes)
        Angular frequencies, rad/s.
    damping : ndarray, shape (windows, modes)
        Damping ratios.
    dt : float
        Time between samples, s.
    taps, counted
        As for :func:`whiten_windows`.
    out : ndarray, shape (n, 2 * modes)
        Filled, without unit, cosine and sine of each mode in turn; 0 at samples that are not counted.
    """
    for window in range(starts.shape[0] - 1):
        start, stop = starts[window], starts[window + 1]
        pair = np.empty((2, stop - start))  # cosine and sine of one mode
        rows = np.empty((out.shape[1], stop - start))  # the same of all modes, whitened
        for mode in range(omega.shape[1]):
            zeta = damping[window, mode]
            angle = omega[window, mode] * math.sqrt(1 - zeta * zeta) * dt
            cosine, sine = math.cos(angle), math.sin(angle)
            decay = math.exp(-zeta * omega[window, mode] * dt)
            # (a, b) rotates by one sample at a time: a is the cosine, b the sine.
            origin = begin[window] - start
            a, b = 1.0, 0.0
            # Backwards from the origin, for the memory of the filter: with the decay the vibration would
            # grow.
            for i in range(origin, -1, -1):
                pair[0, i], pair[1, i] = a, b
                a, b = cosine * a + sine * b, cosine * b - sine * a
            a, b = 1.0, 0.0
            cosine, sine = decay * cosine, decay * sine
            for i in range(origin, stop - start):
                pair[0, i], pair[1, i] = a, b
                a, b = cosine * a - sine * b, cosine * b + sine * a
            for k in range(2):
                _filter(pair[k], taps, 1, rows[2 * mode + k])
        for i in range(start, stop):
            if not counted[i]:
                rows[:, i - start] = 0.0
        _orthonormalise(rows)
        for k in range(rows.shape[0]):
            for i in range(start, stop):
                out[i, k] = rows[k, i - start]


@compiled()
def _orthonormalise(rows: Array) -> None:
    """Make rows orthonormal, in place, by the Gram-Schmidt process; a row of zeros stays as it is.

    The process is repeated for each row, since the first pass leaves a rounding error.
    """
    for row in range(rows.shape[0]):
        for _ in range(2):
            for before in range(row):
                part = np.dot(rows[before], rows[row])
                for i in range(rows.shape[1]):
                    rows[row, i] -= part * rows[before, i]
        length = math.sqrt(np.dot(rows[row], rows[row]))
        scale = 1 / length if length > 0 else 0.0
        for i in range(rows.shape[1]):
            rows[row, i] *= scale


def whitening_filter(residuals: Sequence[Array], floor: float) -> Array:
    """Whitening filter of residuals, by an autoregressive model from the Yule-Walker equations.

    Parameters
    ----------
    residuals : sequence of ndarray, shape (n,) or (n, responses)
        Residual in each window.
    floor : float
        Power of white noise that is added to the residuals, over their power; see
        :func:`ballscrew.modal.joint.blocks.with_whitening`.

    Returns
    -------
    ndarray, shape (9,) or (1,)
        Taps of the filter, without unit, the first of them 1; ``[1]`` for residuals of 0.
    """
    from scipy.linalg import solve_toeplitz

    autocorrelation = np.zeros(_WHITENING_ORDER + 1)
    for residual in residuals:
        for lag in range(_WHITENING_ORDER + 1):
            autocorrelation[lag] += np.sum(residual[lag:] * residual[: len(residual) - lag])
    if not autocorrelation[0] > 0:
        return np.ones(1)
    autocorrelation[0] *= 1 + floor  # white noise has an autocorrelation at lag 0 only
    coefficients = solve_toeplitz(autocorrelation[:_WHITENING_ORDER], autocorrelation[1:])
    return np.concatenate([[1.0], -coefficients])
