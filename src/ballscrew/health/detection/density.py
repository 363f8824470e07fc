"""Density of a run, and of a run with its repeat: ordinary, odd, or now and then anything at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballscrew.health.detection.settings import MonitorSettings

__all__ = ["pair", "single"]

Single = NDArray[np.float32]
_ANYTHING = 1e-5  # of a run that may be anything, over that of an ordinary one at its middle


def single(off: Single, noise: float, doubt: float, kept: MonitorSettings) -> Single:
    """Tell the density of one run, over 1/√2π.

    Parameters
    ----------
    off : ndarray of float32
        How far it stands off what is expected.
    noise, doubt : float
        Variance of an ordinary run, and of what is expected.
    kept : MonitorSettings
        How often and how far runs are odd.

    Returns
    -------
    ndarray of float32
        Of the same shape.
    """
    usual, odd = noise + doubt, kept.odd_size**2 * noise + doubt
    square = off * off
    density: Single = np.exp(square * np.float32(-0.5 / usual))
    density *= np.float32((1 - kept.odd) / np.sqrt(usual))
    square *= np.float32(-0.5 / odd)
    np.exp(square, out=square)
    square *= np.float32(kept.odd / np.sqrt(odd))
    density += square
    density += np.float32(_ANYTHING / np.sqrt(usual))
    return density


def pair(one: Single, other: Single, noise: float, doubt: float, kept: MonitorSettings) -> Single:
    """Tell the density of a run and its repeat, over 1/2π.

    They share the doubt, and now and then what made the first odd.

    Parameters
    ----------
    one, other : ndarray of float32
        How far each stands off what is expected.
    noise, doubt, kept
        As for :func:`single`.

    Returns
    -------
    ndarray of float32
        Of the same shape.
    """
    odd, stays, size = kept.odd, kept.odd_stays, kept.odd_size**2
    wide = size * noise
    density = np.zeros_like(one)
    for weight, first, second, common in (
        ((1 - odd) ** 2, noise, noise, doubt),
        (odd * (1 - stays) * (1 - odd), wide, noise, doubt),
        (odd * (1 - odd), noise, wide, doubt),
        (odd * (1 - stays) * odd, wide, wide, doubt),
        (odd * stays, noise, noise, doubt + (size - 1) * noise),
    ):
        if weight:
            spread = first * second + common * (first + second)
            square = (
                (second + common) * one * one + (first + common) * other * other - 2 * common * one * other
            )
            density += np.float32(weight / np.sqrt(spread)) * np.exp(square * np.float32(-0.5 / spread))
    least = np.float32(_ANYTHING / np.sqrt(noise + doubt))
    density += least * (single(one, noise, doubt, kept) + single(other, noise, doubt, kept) - least)
    return density
