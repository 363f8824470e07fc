"""Density of a run, and of a run with its repeat: ordinary, odd, or now and then anything; compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ballscrew.monitoring.detection.settings import MonitorSettings

__all__ = ["FAST", "mixture", "ordinary", "pair", "single"]

Single = NDArray[np.float32]
FAST = frozenset({"arcp", "nsz", "nnan", "ninf"})
"""What compiled arithmetic may do with finite numbers: a loop takes several at once, each as if alone."""

_ANYTHING = 1e-5  # of a run that may be anything, over that of an ordinary one at its middle
_F = np.float32
_LOWEST = _F(-60.0)  # exp of less is nothing beside a run that may be anything
_PER_LN2, _HALF, _ONE = _F(1.44269504), _F(0.5), _F(1.0)
_LN2_HIGH, _LN2_LOW = _F(0.693359375), _F(-2.12194440e-4)
_C0, _C1, _C2 = _F(1.9875691500e-4), _F(1.3981999507e-3), _F(8.3334519073e-3)
_C3, _C4, _C5 = _F(4.1665795894e-2), _F(1.6666665459e-1), _F(5.0000001201e-1)
_BIAS, _MANTISSA = np.int32(127), np.int32(23)


@njit(cache=True, fastmath=set(FAST), error_model="numpy")
def _exp(x: np.float32) -> np.float32:
    """Tell exp of 0 or less, to 1e-7 of it.

    Power of two and a minimax polynomial, as in the Cephes library (Moshier, 1989): unlike the system's it
    is taken of several numbers at once.
    """
    x = max(x, _LOWEST)
    power = np.floor(x * _PER_LN2 + _HALF)
    r = x - power * _LN2_HIGH - power * _LN2_LOW
    rest = ((((_C0 * r + _C1) * r + _C2) * r + _C3) * r + _C4) * r + _C5
    two = np.int32((np.int32(power) + _BIAS) << _MANTISSA).view(np.float32)
    return np.float32((rest * r * r + r + _ONE) * two)


def ordinary(noise: float, doubt: float, kept: MonitorSettings) -> Single:
    """Numbers of :func:`single`.

    Parameters
    ----------
    noise, doubt : float
        Variance of an ordinary run, and of what is expected.
    kept : MonitorSettings
        How often and how far runs are odd.

    Returns
    -------
    ndarray of float32, shape (5,)
        Of each kind of run the exponent over the square and the density in the middle, and the least.
    """
    usual, odd = noise + doubt, kept.odd_size**2 * noise + doubt
    kinds = [-0.5 / usual, (1 - kept.odd) / np.sqrt(usual), -0.5 / odd, kept.odd / np.sqrt(odd)]
    return np.array([*kinds, _ANYTHING / np.sqrt(usual)], np.float32)


@njit(cache=True, fastmath=set(FAST), error_model="numpy")
def _single(off: np.float32, of: Single) -> np.float32:
    square = off * off
    return np.float32(of[1] * _exp(square * of[0]) + of[3] * _exp(square * of[2]) + of[4])


@njit(cache=True, fastmath=set(FAST), error_model="numpy")
def single(off: Single, of: Single, density: Single) -> None:
    """Tell the density of runs, over 1/√2π.

    Parameters
    ----------
    off : ndarray of float32, shape (r, m)
        How far each stands off what is expected.
    of : ndarray of float32, shape (5,)
        See :func:`ordinary`.
    density : ndarray of float32, shape (r, m)
        Filled; more than 0.
    """
    for r in range(off.shape[0]):
        for j in range(off.shape[1]):
            density[r, j] = _single(off[r, j], of)


def mixture(noise: float, doubt: float, kept: MonitorSettings) -> Single:
    """Numbers of :func:`pair`.

    Parameters
    ----------
    noise, doubt, kept
        As for :func:`ordinary`.

    Returns
    -------
    ndarray of float32, shape (kinds, 4)
        Density in the middle, and what the squares of the first, of the repeat and their product count in the
        exponent.
    """
    odd, stays, size = kept.odd, kept.odd_stays, kept.odd_size**2
    wide = size * noise
    rows = []
    for weight, first, second, common in (
        ((1 - odd) ** 2, noise, noise, doubt),
        (odd * (1 - stays) * (1 - odd), wide, noise, doubt),
        (odd * (1 - odd), noise, wide, doubt),
        (odd * (1 - stays) * odd, wide, wide, doubt),
        (odd * stays, noise, noise, doubt + (size - 1) * noise),
    ):
        spread = first * second + common * (first + second)
        sizes = np.array([second + common, first + common, -2 * common])
        rows.append([weight / np.sqrt(spread), *(-0.5 / spread * sizes)])
    return np.array(rows, np.float32)


@njit(cache=True, fastmath=set(FAST), error_model="numpy")
def pair(one: Single, other: Single, of: Single, both: Single, density: Single) -> None:
    """Tell the density of runs and their repeats, over 1/2π.

    They share the doubt, and now and then what made the first odd.

    Parameters
    ----------
    one, other : ndarray of float32, shape (r, m)
        How far each stands off what is expected.
    of : ndarray of float32, shape (5,)
        See :func:`ordinary`.
    both : ndarray of float32, shape (kinds, 4)
        See :func:`mixture`.
    density : ndarray of float32, shape (r, m)
        Filled; more than 0.
    """
    for r in range(one.shape[0]):
        for j in range(one.shape[1]):
            density[r, j] = of[4] * (_single(one[r, j], of) + _single(other[r, j], of) - of[4])
        for kind in range(both.shape[0]):
            for j in range(one.shape[1]):
                a, b = one[r, j], other[r, j]
                power = both[kind, 1] * a * a + both[kind, 2] * b * b + both[kind, 3] * a * b
                density[r, j] += both[kind, 0] * _exp(min(power, _F(0.0)))
