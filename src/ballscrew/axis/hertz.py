"""The nut under load: two rows of Hertz contacts pressed against each other, in closed form.

A ball that is pressed into its groove gives way by the 2/3 power of the force (Hertz, 1881). A preloaded nut
has one such flank for each direction, each pressed together by δ₀. Moved by δ against the screw, it gives

    F = K_h [(δ₀ + δ)₊^1.5 − (δ₀ − δ)₊^1.5],    δ₀ = (P/K_h)^(2/3),

where (·)₊ is 0 for what is negative: a flank cannot pull. With K_h = (κ/3)^1.5 the rigidity at rest is
κ P^(1/3): the makers' law (THK and NSK catalogues of ball screws), and that of Eqs. (1) to (3). In parts of
the preload, q = F/P and ξ = δ/δ₀, and until one flank lets go at q = 2√2, the squares of u = √(1 + ξ) and
v = √(1 − ξ) add up to 2, which makes u³ − v³ = q a cubic in s = u − v: s³ − 6s + 2q = 0. Its root is
s = 2√2 sin θ with sin 3θ = q / 2√2.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballscrew.axis.given import finite, not_negative, positive
from ballscrew.base.arrays import Array

RELEASE = 2 * math.sqrt(2)
"""F/P at which one flank lets go; the makers print 2.83."""


def hertz_constant(kappa: ArrayLike) -> Array:
    """K_h = (κ/3)^1.5 of one flank, whose force is K_h δ^1.5.

    Parameters
    ----------
    kappa : array_like
        κ, N^(2/3)/m.

    Returns
    -------
    ndarray
        N/m^1.5.

    Raises
    ------
    InputError
        If κ is not above 0.
    """
    return np.asarray((_kappa(kappa) / 3) ** 1.5)


def preload_deflection(preload: ArrayLike, kappa: ArrayLike) -> Array:
    """δ₀ = (P/K_h)^(2/3) = 3 P / K_N: by how much the preload presses each flank together.

    Parameters
    ----------
    preload : array_like
        P, N.
    kappa : array_like
        κ, N^(2/3)/m.

    Returns
    -------
    ndarray
        m.

    Raises
    ------
    InputError
        If the preload is negative, or κ not above 0.
    """
    return np.asarray(3 * np.cbrt(_preload(preload)) ** 2 / _kappa(kappa))


def release_load(preload: ArrayLike) -> Array:
    """F = 2√2 P, N: the nut load at which one flank lets go.

    Parameters
    ----------
    preload : array_like
        P, N.

    Returns
    -------
    ndarray
        N.

    Raises
    ------
    InputError
        If the preload is negative.
    """
    return np.asarray(RELEASE * _preload(preload))


def nut_force(deflection: ArrayLike, preload: ArrayLike, kappa: ArrayLike) -> Array:
    """F = K_h [(δ₀ + δ)₊^1.5 − (δ₀ − δ)₊^1.5].

    Parameters
    ----------
    deflection : array_like
        δ, of the nut against the screw, m.
    preload : array_like
        P, N; at 0 one flank alone carries.
    kappa : array_like
        κ, N^(2/3)/m.

    Returns
    -------
    ndarray
        F, N; odd in δ.

    Raises
    ------
    InputError
        If a number is not finite, the preload negative, or κ not above 0.
    """
    delta = np.abs(finite("deflection", deflection, "m"))
    pressed = preload_deflection(preload, kappa)
    u, v = np.sqrt(pressed + delta), np.sqrt(np.maximum(pressed - delta, 0.0))
    # Both flanks: u³ − v³ with u − v = 2δ/(u + v), no difference of two large numbers where δ is small.
    both = 2 * delta * (2 * pressed + u * v) / np.where(u + v > 0, u + v, 1.0)
    size = np.where(delta < pressed, both, u**3)
    return np.asarray(np.sign(deflection) * hertz_constant(kappa) * size)


def nut_deflection(force: ArrayLike, preload: ArrayLike, kappa: ArrayLike) -> Array:
    r"""δ under a nut load: the inverse of :func:`nut_force`, in closed form.

    Up to release ξ = s √(4 − s²) / 2 with s = 2√2 sin θ, θ = arcsin(\|q\| / 2√2) / 3; beyond it
    ξ = \|q\|^(2/3) − 1.

    Parameters
    ----------
    force : array_like
        F, N.
    preload : array_like
        P, N; at 0 one flank alone carries.
    kappa : array_like
        κ, N^(2/3)/m.

    Returns
    -------
    ndarray
        δ, m; odd in F.

    Raises
    ------
    InputError
        If a number is not finite, the preload negative, or κ not above 0.
    """
    load = np.abs(finite("nut load", force, "N"))
    pressed = preload_deflection(preload, kappa)
    third, released = _third(load, preload)
    s = RELEASE * np.sin(third)
    alone = 3 * np.cbrt(load) ** 2 / _kappa(kappa) - pressed
    return np.asarray(np.sign(force) * np.where(released, alone, pressed * s * np.sqrt(4 - s * s) / 2))


def tangent_ratio(nut_load: ArrayLike, preload: ArrayLike) -> Array:
    r"""k(F)/k(0): the nut's rigidity for small vibrations about a nut load, over that without load.

    Parameters
    ----------
    nut_load : array_like
        F, N; its sign does not matter.
    preload : array_like
        P, N; more than 0.

    Returns
    -------
    ndarray
        √cos 2θ up to release, θ as in :func:`nut_deflection`; beyond \|F/P\|^(1/3) / 2.

    Raises
    ------
    InputError
        If the nut load is not finite, or the preload not above 0.
    """
    load, force = np.abs(finite("nut load", nut_load, "N")), positive("preload", preload, "N")
    third, released = _third(load, force)
    alone = np.cbrt(load) / np.cbrt(force) / 2
    return np.asarray(np.where(released, alone, np.sqrt(np.cos(2 * third))))


def nut_rigidity_under_load(nut_load: ArrayLike, preload: ArrayLike, kappa: ArrayLike) -> Array:
    r"""dF/dδ of the nut about a nut load.

    Parameters
    ----------
    nut_load : array_like
        F, N; its sign does not matter.
    preload : array_like
        P, N; at 0, and beyond release, one flank alone: 1.5 K_h^(2/3) \|F\|^(1/3).
    kappa : array_like
        κ, N^(2/3)/m.

    Returns
    -------
    ndarray
        N/m: κ P^(1/3) without nut load.

    Raises
    ------
    InputError
        If a number is not finite, the preload negative, or κ not above 0.
    """
    return np.asarray(_kappa(kappa) * np.cbrt(apparent_preload(nut_load, preload)))


def apparent_preload(nut_load: ArrayLike, preload: ArrayLike) -> Array:
    r"""P (k(F)/k(0))³: the preload of an unloaded nut that is as rigid as this one under its load.

    Eqs. (1) to (3) know no nut load; with this preload they give the frequency under one. Beyond release it
    is \|F\|/8, whatever the preload is.

    Parameters
    ----------
    nut_load : array_like
        F, N; its sign does not matter.
    preload : array_like
        P, N; 0 or more.

    Returns
    -------
    ndarray
        N.

    Raises
    ------
    InputError
        If the nut load is not finite, or the preload negative.
    """
    load, force = np.abs(finite("nut load", nut_load, "N")), _preload(preload)
    third, released = _third(load, force)
    return np.asarray(np.where(released, load / 8, force * np.cos(2 * third) ** 1.5))


def _kappa(kappa: ArrayLike) -> Array:
    return positive("kappa", kappa, "N^(2/3)/m")


def _preload(preload: ArrayLike) -> Array:
    return not_negative("preload", preload, "N")


def _third(load: Array, preload: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
    r"""θ = arcsin(\|q\| / 2√2) / 3, and where one flank has let go; there θ is of no use."""
    limit = release_load(preload)
    released = load >= limit
    part = np.where(released, 1.0, load / np.where(released, 1.0, limit))
    return np.arcsin(part) / 3, released
