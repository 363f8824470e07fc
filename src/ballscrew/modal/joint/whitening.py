"""Whitening of residuals, and removal of the free vibration with which a window may begin."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.compilation import compiled

_WHITENING_ORDER = 8  # of the autoregressive model of a residual
_BLOCK = 1024  # elements that are whitened at once: 8 kB of each array


@compiled()
def _filter(values: Array, taps: Array, columns: int, out: Array) -> None:
    """Filter each column of a window from rest; ``values`` and ``out`` contain its rows, concatenated."""
    # Tap by tap over a block that fits into the processor's cache: such loops are vectorised.
    for begin in range(0, values.shape[0], _BLOCK):
        end = min(begin + _BLOCK, values.shape[0])
        out[begin:end] = 0.0
        for k in range(len(taps)):
            first, tap = max(begin, k * columns), taps[k]
            sums, earlier = out[first:end], values[first - k * columns : end - k * columns]
            for j in range(sums.shape[0]):
                sums[j] += tap * earlier[j]


@compiled()
def whiten_windows(
    values: Array,
    first: NDArray[np.int64],
    taps: Array,
    keep: NDArray[np.bool_],
    free: Array,
    out: Array,
) -> None:
    """Whiten every window, and subtract its projection on the free vibration.

    Parameters
    ----------
    values : ndarray, shape (n, columns)
        Signals of all windows, concatenated.
    first : ndarray, shape (windows + 1,)
        First sample of each window, and the end of the last.
    taps : ndarray, shape (taps,)
        Whitening filter, which begins each window at rest.
    keep : ndarray of bool, shape (n,)
        Samples that are counted in the fit; the others are 0 in the result.
    free : ndarray, shape (n, k)
        Free vibration as of :func:`free_responses`, orthonormal in every window.
    out : ndarray, shape (n, columns)
        Filled with the whitened signals, in the unit of ``values``.
    """
    columns = values.shape[1]
    flat, flat_out = values.reshape(values.size), out.reshape(out.size)
    for window in range(first.shape[0] - 1):
        start, stop = first[window], first[window + 1]
        begin, end = start * columns, stop * columns
        _filter(flat[begin:end], taps, columns, flat_out[begin:end])
        for i in range(start, stop):
            if not keep[i]:
                out[i] = 0.0
        vibration, rest = free[start:stop], out[start:stop]
        rest -= np.dot(vibration, np.dot(vibration.T, rest))


@compiled()
def free_responses(
    first: NDArray[np.int64],
    begin: NDArray[np.int64],
    omega: Array,
    damping: Array,
    dt: float,
    taps: Array,
    keep: NDArray[np.bool_],
    out: Array,
) -> None:
    """Free vibration with which a window may begin: decaying cosines and sines, whitened and orthonormal.

    Parameters
    ----------
    first : ndarray, shape (windows + 1,)
        First sample of each window, and the end of the last.
    begin : ndarray, shape (windows,)
        First counted sample of each window: the vibration decays from there.
    omega : ndarray, shape (windows, modes)
        Angular frequencies, rad/s.
    damping : ndarray, shape (windows, modes)
        Damping ratios.
    dt : float
        Time between samples, s.
    taps, keep
        As for :func:`whiten_windows`.
    out : ndarray, shape (n, 2 * modes)
        Filled, without unit; 0 at samples that are not counted.
    """
    for window in range(first.shape[0] - 1):
        start, stop = first[window], first[window + 1]
        pair = np.empty((2, stop - start))
        rows = np.empty((out.shape[1], stop - start))
        for mode in range(omega.shape[1]):
            zeta = damping[window, mode]
            angle = omega[window, mode] * math.sqrt(1 - zeta * zeta) * dt
            cosine, sine = math.cos(angle), math.sin(angle)
            decay = math.exp(-zeta * omega[window, mode] * dt)
            at = begin[window] - start
            a, b = 1.0, 0.0
            # Earlier samples, for the memory of the filter: without decay, which would make them grow.
            for i in range(at, -1, -1):
                pair[0, i], pair[1, i] = a, b
                a, b = cosine * a + sine * b, cosine * b - sine * a
            a, b = 1.0, 0.0
            cosine, sine = decay * cosine, decay * sine
            for i in range(at, stop - start):
                pair[0, i], pair[1, i] = a, b
                a, b = cosine * a - sine * b, cosine * b + sine * a
            for k in range(2):
                _filter(pair[k], taps, 1, rows[2 * mode + k])
        for i in range(start, stop):
            if not keep[i]:
                rows[:, i - start] = 0.0
        _orthonormalise(rows)
        for k in range(rows.shape[0]):
            for i in range(start, stop):
                out[i, k] = rows[k, i - start]


@compiled()
def _orthonormalise(x: Array) -> None:
    """Make rows orthonormal, in place: Gram and Schmidt twice, since once leaves a rounding error."""
    for row in range(x.shape[0]):
        for _ in range(2):
            for before in range(row):
                part = np.dot(x[before], x[row])
                for i in range(x.shape[1]):
                    x[row, i] -= part * x[before, i]
        size = math.sqrt(np.dot(x[row], x[row]))
        scale = 1 / size if size > 0 else 0.0
        for i in range(x.shape[1]):
            x[row, i] *= scale


def whitening_filter(residuals: Sequence[Array], floor: float) -> Array:
    """Whitening filter of residuals by an autoregressive model, from the equations of Yule and Walker.

    Parameters
    ----------
    residuals : sequence of ndarray, shape (n,) or (n, responses)
        Residuals of each window.
    floor : float
        As for :func:`ballscrew.modal.joint.blocks.with_whitening`.

    Returns
    -------
    ndarray, shape (9,) or (1,)
        Taps of the filter, without unit, the first of them 1; ``[1]`` for residuals of 0.
    """
    from scipy.linalg import solve_toeplitz

    autocorrelation = np.zeros(_WHITENING_ORDER + 1)
    for part in residuals:
        for lag in range(_WHITENING_ORDER + 1):
            autocorrelation[lag] += np.sum(part[lag:] * part[: len(part) - lag])
    if not autocorrelation[0] > 0:
        return np.ones(1)
    autocorrelation[0] *= 1 + floor
    coefficients = solve_toeplitz(autocorrelation[:_WHITENING_ORDER], autocorrelation[1:])
    return np.concatenate([[1.0], -coefficients])
