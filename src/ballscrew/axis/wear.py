"""Loss of preload by wear of the flanks, and laws of wear over travel.

Each flank is pressed together by δ₀ (:mod:`~ballscrew.axis.hertz`). Worn by w it is pressed by δ₀ − w, hence
P = P₀ (1 − w/δ₀)^1.5. Beyond δ₀ the nut has backlash.

The laws of travel follow from dw/dN = k Pⁿ: wear after Archard (1953), its depth in proportion to the travel
N and to what presses. With u = 1 − w/δ₀, P = P₀ u^1.5 and du/dN ∝ −u^(1.5 n).

=========================  ===================================  =====  ===================  =========
law                        what presses                         n      linear in N          ends
=========================  ===================================  =====  ===================  =========
``"contact-pressure"``     contact pressure of the preload      1/3    P^(1/3)              at N_f
``"preload"``              the preload itself                   1      P^(−1/3)             never
``"exponential"``          preload^(2/3), the contact's area    2/3    ln P                 never
``"external-load"``        a load that does not change          0      P^(2/3)              at N_f
=========================  ===================================  =====  ===================  =========

Each law has one parameter, the travel at which half of the preload is lost; k and N_f follow from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.given import not_negative, positive
from ballscrew.axis.hertz import preload_deflection
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown


def preload_after_wear(wear: ArrayLike, preload: ArrayLike, kappa: ArrayLike) -> Array:
    """P = P₀ (1 − w/δ₀)^1.5.

    Parameters
    ----------
    wear : array_like
        w, the approach that each flank has lost, m; 0 or more.
    preload : array_like
        P₀, when new, N; more than 0.
    kappa : array_like
        κ, N^(2/3)/m.

    Returns
    -------
    ndarray
        P, N; 0 from w = δ₀ on.

    Raises
    ------
    InputError
        If a number is not finite, the wear negative, or preload or κ not above 0.
    """
    return np.asarray(positive("preload", preload, "N") * _remaining(wear, preload, kappa) ** 1.5)


def backlash_after_wear(wear: ArrayLike, preload: ArrayLike, kappa: ArrayLike) -> Array:
    """B = 2 (w − δ₀)₊: both flanks have lost w, and the first δ₀ of each was preload.

    Parameters
    ----------
    wear, preload, kappa : array_like
        As for :func:`preload_after_wear`; a preload of 0 is a nut that was new without any.

    Returns
    -------
    ndarray
        B, m.

    Raises
    ------
    InputError
        If a number is not finite, wear or preload negative, or κ not above 0.
    """
    worn = not_negative("wear", wear, "m")
    return np.asarray(2 * np.maximum(worn - preload_deflection(preload, kappa), 0.0))


def contact_pressure_law(travel: ArrayLike, preload: ArrayLike, half_travel: ArrayLike) -> Array:
    """P = P₀ (1 − N/N_f)³: the contact pressure, ∝ P^(1/3), wears the flanks.

    Parameters
    ----------
    travel : array_like
        N, in any unit; 0 or more.
    preload : array_like
        P₀, at N = 0, N; more than 0.
    half_travel : array_like
        The travel at which P is P₀/2, in the unit of ``travel``; more than 0.

    Returns
    -------
    ndarray
        P, N; 0 from N_f on.

    Raises
    ------
    InputError
        If a number cannot be.
    """
    part, start = _part(travel, preload, half_travel)
    return np.asarray(start * np.maximum(1 - part * (1 - 2 ** (-1 / 3)), 0.0) ** 3)


def preload_law(travel: ArrayLike, preload: ArrayLike, half_travel: ArrayLike) -> Array:
    """P^(−1/3) rises linearly: the depth of wear is in proportion to P. It never ends.

    Parameters, result and errors as :func:`contact_pressure_law`.
    """
    part, start = _part(travel, preload, half_travel)
    return np.asarray(start / (1 + part * (2 ** (1 / 3) - 1)) ** 3)


def exponential_law(travel: ArrayLike, preload: ArrayLike, half_travel: ArrayLike) -> Array:
    """P = P₀ 2^(−N/N_half): the depth of wear is in proportion to P^(2/3). It never ends.

    Parameters, result and errors as :func:`contact_pressure_law`.
    """
    part, start = _part(travel, preload, half_travel)
    return np.asarray(start * np.exp2(-part))


def external_load_law(travel: ArrayLike, preload: ArrayLike, half_travel: ArrayLike) -> Array:
    """P = P₀ (1 − N/N_f)^1.5: a constant outer load wears the flanks, at a constant rate.

    Parameters, result and errors as :func:`contact_pressure_law`.
    """
    part, start = _part(travel, preload, half_travel)
    return np.asarray(start * np.maximum(1 - part * (1 - 2 ** (-2 / 3)), 0.0) ** 1.5)


WEAR_LAWS: Mapping[str, Callable[[ArrayLike, ArrayLike, ArrayLike], Array]] = MappingProxyType(
    {
        "contact-pressure": contact_pressure_law,
        "preload": preload_law,
        "exponential": exponential_law,
        "external-load": external_load_law,
    }
)
"""Law to P(travel, initial preload, travel to half of it)."""

_ENDS = MappingProxyType(
    {"contact-pressure": 1 / (1 - 2 ** (-1 / 3)), "external-load": 1 / (1 - 2 ** (-2 / 3))}
)


def end_of_preload(law: str, half_travel: ArrayLike) -> Array:
    """Travel N_f at which the preload is lost.

    Parameters
    ----------
    law : str
        A key of :data:`WEAR_LAWS`.
    half_travel : array_like
        The travel at which half of the preload is lost, in any unit; more than 0.

    Returns
    -------
    ndarray
        In the unit of ``half_travel``; infinite where the law never ends.

    Raises
    ------
    InputError
        If the law is not known, or the travel not above 0.
    """
    if law not in WEAR_LAWS:
        raise InputError(f"the wear law is {shown(law)}; it must be one of {', '.join(WEAR_LAWS)}.")
    return np.asarray(_ENDS.get(law, math.inf) * positive("travel to half of the preload", half_travel))


def _remaining(wear: ArrayLike, preload: ArrayLike, kappa: ArrayLike) -> Array:
    """1 − w/δ₀, 0 at least."""
    worn = not_negative("wear", wear, "m")
    pressed = preload_deflection(positive("preload", preload, "N"), kappa)
    return np.maximum(1 - worn / pressed, 0.0)


def _part(travel: ArrayLike, preload: ArrayLike, half_travel: ArrayLike) -> tuple[Array, Array]:
    """N over the travel to half of the preload, and P₀."""
    part = not_negative("travel", travel) / positive("travel to half of the preload", half_travel)
    return np.asarray(part), positive("preload", preload, "N")
