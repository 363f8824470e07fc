"""The compiled inner loops of :mod:`~ballscrew.modal.fast_spectra`: importing this module loads numba."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["decimate", "multiply"]

_GROUP = 4  # taps in one sweep, a constant for the compiler: fewer sweeps, and each in wide registers
_BLOCK = 512  # samples summed in float32: a sum of thousands would lose digits
Float = NDArray[np.float32]


@njit(cache=True, fastmath=True, nogil=True)
def _mean(record: Float) -> float:
    total = 0.0
    for start in range(0, record.size, _BLOCK):
        block = record[start : start + _BLOCK]
        part = np.float32(0)
        for n in range(block.size):
            part += block[n]
        total += float(part)
    return total / record.size


@njit(cache=True, fastmath=True, nogil=True)
def _part(line: Float, phases: Float) -> None:
    """Put every factor-th sample in a row; the factor 8 by itself, since a constant is four times as fast."""
    factor, width = phases.shape[0], line.size // phases.shape[0]
    if factor == 8:
        p0, p1, p2, p3 = phases[0], phases[1], phases[2], phases[3]
        p4, p5, p6, p7 = phases[4], phases[5], phases[6], phases[7]
        for n in range(width):
            p0[n], p1[n], p2[n], p3[n] = line[8 * n], line[8 * n + 1], line[8 * n + 2], line[8 * n + 3]
            p4[n], p5[n], p6[n], p7[n] = line[8 * n + 4], line[8 * n + 5], line[8 * n + 6], line[8 * n + 7]
        return
    for p in range(factor):
        target, source = phases[p], line[p::factor]
        for n in range(width):
            target[n] = source[n]


@njit(cache=True, fastmath=True, nogil=True)
def decimate(records: Float, window: Float, taps: Float, lag: int, demean: bool, out: Float) -> None:
    """Window, difference, filter and decimate records; what lies outside a record is zero.

    Parameters
    ----------
    records : ndarray of float32, shape (records, samples)
        As measured.
    window : ndarray of float32, shape (samples,)
        Factors.
    taps : ndarray of float32, shape (factor, taps of one phase)
        Of the filter, every factor-th tap in a row, a multiple of four in each.
    lag : int
        Samples of each of the two differences.
    demean : bool
        Whether each record's mean is taken out before the window.
    out : ndarray of float32, shape (records, m)
        Filled from the start; must be zero.
    """
    count, samples = records.shape
    factor, width = taps.shape
    lead = factor * width
    kept = -(-(samples + 2 * lag + lead - 1) // factor)
    windowed = np.zeros(samples + 4 * lag, np.float32)
    line = np.zeros((kept + width) * factor, np.float32)
    phases = np.zeros((factor, kept + width), np.float32)
    inside = windowed[2 * lag : 2 * lag + samples]
    now, before, twice = windowed[2 * lag :], windowed[lag:], windowed
    target = line[lead - 1 :]
    for k in range(count):
        record = records[k]
        mean = np.float32(_mean(record)) if demean else np.float32(0)
        for n in range(samples):
            inside[n] = (record[n] - mean) * window[n]
        for n in range(samples + 2 * lag):
            target[n] = (now[n] - before[n]) - (before[n] - twice[n])
        _part(line, phases)
        answer = out[k]
        for p in range(factor):
            for t in range(0, width, _GROUP):
                # Slices, so that the compiler sees indices that cannot be negative.
                x0, x1, x2, x3 = phases[p, t:], phases[p, t + 1 :], phases[p, t + 2 :], phases[p, t + 3 :]
                a, b, c, d = taps[p, t], taps[p, t + 1], taps[p, t + 2], taps[p, t + 3]
                for m in range(kept):
                    answer[m] += a * x0[m] + b * x1[m] + c * x2[m] + d * x3[m]


@njit(cache=True, fastmath=True, nogil=True)
def multiply(u: Float, y: Float, uu: Float, yy: Float, uy: Float) -> None:
    """Sum powers and products over repetitions; complex numbers lie as pairs.

    Parameters
    ----------
    u : ndarray of float32, shape (repetitions, 2 n)
        Transforms of the input.
    y : ndarray of float32, shape (responses, repetitions, 2 n)
        Of the responses.
    uu, yy, uy : ndarray of float32, shapes (n,), (responses, n), (responses, 2 n)
        Sums, added to.
    """
    count, pairs = u.shape[0], u.shape[1] // 2
    for k in range(count):
        for n in range(pairs):
            uu[n] += u[k, 2 * n] * u[k, 2 * n] + u[k, 2 * n + 1] * u[k, 2 * n + 1]
        for r in range(y.shape[0]):
            for n in range(pairs):
                a, b = u[k, 2 * n], u[k, 2 * n + 1]
                c, d = y[r, k, 2 * n], y[r, k, 2 * n + 1]
                yy[r, n] += c * c + d * d
                uy[r, 2 * n] += a * c + b * d
                uy[r, 2 * n + 1] += a * d - b * c
