"""What survives without θ: the change of the preload from the change of the frequency.

At the same position and mass, with the same rotor, only the nut's part of Eq. (3) changes:

    (f₀/f)² = C/C₀ = 1 + s₀ [(P/P₀)^(−1/3) − 1],

s₀ the nut's share of the whole axial compliance C₀ when P was P₀. It follows from Eq. (3) of the paper, rotor
held or free; masses, geometry and the maker's K stand in s₀ alone. An error of s₀ scales a loss, it does not
change its sign.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.given import positive
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

__all__ = ["frequency_change", "preload_change"]


def preload_change(frequency: ArrayLike, reference_frequency: ArrayLike, nut_share: ArrayLike) -> Array:
    """P/P₀ = [1 + ((f₀/f)² − 1) / s₀]⁻³.

    Parameters
    ----------
    frequency : array_like
        f, Hz.
    reference_frequency : array_like
        f₀, at the same position and mass, Hz.
    nut_share : array_like
        s₀, the nut's share of the axial compliance at the reference, above 0, 1 at most.

    Returns
    -------
    ndarray
        P/P₀.

    Raises
    ------
    InputError
        If a number cannot be, or a frequency lies at or above f₀ / √(1 − s₀), that of an infinitely stiff
        nut, where no preload belongs to it.
    """
    f, f0 = positive("frequency", frequency, "Hz"), positive("reference frequency", reference_frequency, "Hz")
    f, f0, share = np.broadcast_arrays(f, f0, _share(nut_share))
    bracket = 1 + ((f0 / f) ** 2 - 1) / share
    if not np.all(bracket > 0):
        wrong = ~(bracket > 0)
        given = f[wrong].flat[0]
        limit = f0[wrong].flat[0] / np.sqrt(1 - share[wrong].flat[0])
        raise InputError(
            f"a frequency of {given:.9g} Hz was given; it must be below {limit:.9g} Hz, which this axis has "
            "with an infinitely stiff nut."
        )
    return np.asarray(bracket**-3.0)


def frequency_change(preload_ratio: ArrayLike, nut_share: ArrayLike) -> Array:
    """f/f₀ = [1 + s₀ ((P/P₀)^(−1/3) − 1)]^(−1/2): the inverse of :func:`preload_change`.

    Parameters
    ----------
    preload_ratio : array_like
        P/P₀, above 0.
    nut_share : array_like
        s₀, the nut's share of the axial compliance at the reference, above 0, 1 at most.

    Returns
    -------
    ndarray
        f/f₀.

    Raises
    ------
    InputError
        If a number cannot be.
    """
    ratio, share = positive("preload over its reference", preload_ratio), _share(nut_share)
    return np.asarray(1 / np.sqrt(1 + share * (1 / np.cbrt(ratio) - 1)))


def _share(nut_share: ArrayLike) -> Array:
    share = positive("nut's share of the compliance", nut_share)
    if not np.all(share <= 1):
        wrong = share[share > 1].flat[0]
        raise InputError(
            f"a nut's share of the compliance of {wrong:g} was given; it must be more than 0, 1 at most."
        )
    return share
