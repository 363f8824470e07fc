"""Compliances of an axis, one physical part a function: numbers and arrays in SI, in and out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.given import not_negative
from ballscrew.axis.sheet import SUPPORTS
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

_ROUNDING = 1e-9  # of a length: a place at the end of a shaft may be computed as one beyond it


def transmission_ratio(lead: float) -> float:
    """β = lead / 2π: travel per angle, m/rad."""
    return lead / (2 * math.pi)


def shaft_compliance(
    x: ArrayLike, *, diameter: float, youngs_modulus: float, support: str, length: float | None = None
) -> Array:
    """Axial compliance of the shaft where the nut holds it.

    Parameters
    ----------
    x : array_like
        From the thrust bearing to the nut, m.
    diameter : float
        Root diameter, m.
    youngs_modulus : float
        E, Pa.
    support : str
        ``"fixed-free"`` and ``"fixed-supported"``: one end carries, x/AE. ``"fixed-fixed"``: both do,
        x(L − x)/(L AE), softest in the middle.
    length : float, optional
        L between the bearings, m; needed for ``"fixed-fixed"``.

    Returns
    -------
    ndarray
        m/N, the shape of ``x``.

    Raises
    ------
    InputError
        If the support is not known, a distance negative, or a fixed-fixed shaft has no length or ends before
        the nut.
    """
    section = math.pi * diameter**2 / 4 * youngs_modulus
    distance = not_negative("distance from the bearing", x, "m")
    if support == "fixed-fixed":
        length = _length(length, distance)
        return np.asarray(distance * np.maximum(length - distance, 0.0) / (length * section))
    if support not in SUPPORTS:
        raise InputError(f"the support is {support!r}; it must be one of {', '.join(SUPPORTS)}")
    return np.asarray(distance / section)


def support_compliance(
    x: ArrayLike,
    *,
    diameter: float,
    youngs_modulus: float,
    bearing_stiffness: float,
    support: str,
    length: float | None = None,
    far_stiffness: float | None = None,
) -> Array:
    """Axial compliance of shaft and thrust bearing together, where the nut holds the shaft.

    Carried at one end it is x/AE + 1/k_b, the first and third term of Eq. (1). Carried at both ends, each end
    is such a chain with a bearing of its own, and the two work side by side:
    (x/AE + 1/k_b) ((L − x)/AE + 1/k_f) / (L/AE + 1/k_b + 1/k_f). With rigid bearings that is
    x(L − x)/(L AE).

    Parameters
    ----------
    x : array_like
        From the thrust bearing to the nut, m.
    diameter : float
        Root diameter, m.
    youngs_modulus : float
        E, Pa.
    bearing_stiffness : float
        k_b of the thrust bearing, N/m; infinite for a rigid one.
    support : str
        ``"fixed-free"``, ``"fixed-supported"`` or ``"fixed-fixed"``.
    length : float, optional
        L between the bearings, m; needed for ``"fixed-fixed"``.
    far_stiffness : float, optional
        k_f of the other bearing, N/m; by default k_b.

    Returns
    -------
    ndarray
        m/N, the shape of ``x``.

    Raises
    ------
    InputError
        As :func:`shaft_compliance`.
    """
    bearing = bearing_compliance(bearing_stiffness)
    shaft = {"diameter": diameter, "youngs_modulus": youngs_modulus}
    if support != "fixed-fixed":
        return np.asarray(bearing + shaft_compliance(x, **shaft, support=support))
    distance = not_negative("distance from the bearing", x, "m")
    length = _length(length, distance)
    far_bearing = bearing if far_stiffness is None else bearing_compliance(far_stiffness)
    near = bearing + shaft_compliance(distance, **shaft, support="fixed-free")
    to_far_end = np.maximum(length - distance, 0.0)
    far = far_bearing + shaft_compliance(to_far_end, **shaft, support="fixed-free")
    return np.asarray(near * far / (near + far))


def _length(length: float | None, distance: Array) -> float:
    """Checked length of a shaft with both ends fixed."""
    if length is None:
        raise InputError("a fixed-fixed shaft needs its length between the bearings")
    if np.any(distance > length * (1 + _ROUNDING)):
        raise InputError(
            f"a distance of {distance.max():g} m from the bearing was given; the shaft is {length:g} m long"
        )
    return length


def pretension_reserve(
    x: ArrayLike,
    *,
    pretension: float,
    diameter: float,
    youngs_modulus: float,
    near_stiffness: float,
    far_stiffness: float,
    length: float,
) -> tuple[Array, float]:
    """Nut load and elongation that use up the pretension of a screw fixed at both ends.

    A nut load F at x adds F C_f / (C_n + C_f) to the tension of one side and takes F C_n / (C_n + C_f) from
    that of the other, with C_n and C_f the compliances of shaft and bearing on either side.

    Parameters
    ----------
    x : array_like
        From the thrust bearing to the nut, m.
    pretension : float
        Tension of the screw at rest, N.
    diameter : float
        Root diameter, m.
    youngs_modulus : float
        E, Pa.
    near_stiffness, far_stiffness : float
        Of the bearings, N/m.
    length : float
        L between the bearings, m.

    Returns
    -------
    load : ndarray
        Least nut load, of the less favourable direction, that unloads an end, N.
    elongation : float
        Elongation of the free screw that unloads both, as by a screw that is warmer than the bed; over L.
    """
    section = math.pi * diameter**2 / 4 * youngs_modulus
    distance = not_negative("distance from the bearing", x, "m")
    near = 1 / near_stiffness + distance / section
    far = 1 / far_stiffness + (length - distance) / section
    whole = 1 / near_stiffness + 1 / far_stiffness + length / section
    return np.asarray(pretension * whole / np.maximum(near, far)), pretension * whole / length


def torsion_compliance(length: ArrayLike, *, lead: float, diameter: float, shear_modulus: float) -> Array:
    """Axial compliance at the nut that the twist of the shaft makes, 32 β² l / (π d⁴ G).

    A force F on the nut is a torque β F in the shaft; it twists by β F l / (G I_p), I_p = π d⁴/32, and the
    nut travels β times that. β stands squared, therefore. Eq. (1) of the paper prints 32 β l / (π d³ G),
    which has the same unit and is d/β times as large.

    Parameters
    ----------
    length : array_like
        l, from the motor's end to the nut, m.
    lead : float
        m.
    diameter : float
        Root diameter d, m.
    shear_modulus : float
        G, Pa.

    Returns
    -------
    ndarray
        m/N, the shape of ``length``.
    """
    beta = transmission_ratio(lead)
    twist = 32 * np.asarray(length, dtype=np.float64) / (math.pi * diameter**4 * shear_modulus)
    return np.asarray(beta**2 * twist)


def coupling_compliance(lead: float, stiffness: float | None) -> float:
    """Axial compliance at the nut by the twist of a coupling or belt, β²/K, m/N; 0 where it is rigid."""
    return 0.0 if stiffness is None else transmission_ratio(lead) ** 2 / stiffness


def bearing_compliance(stiffness: float) -> float:
    """1/k_b, m/N."""
    return 1 / stiffness


def nut_kappa(rigidity: float, load_rating: float, ratio: float, *, accuracy: float = 0.8) -> float:
    """κ = 0.8 K / (ε Ca)^(1/3), so that the nut's rigidity is κ P^(1/3).

    Parameters
    ----------
    rigidity : float
        K, the maker's value, N/m.
    load_rating : float
        Ca, N.
    ratio : float
        ε, the preload at which K is stated, as a part of Ca.
    accuracy : float
        Part of K that a real nut has: 0.8 of the makers' theoretical K, 1 of a measured one.

    Returns
    -------
    float
        κ, N^(2/3)/m.
    """
    return accuracy * rigidity / math.cbrt(ratio * load_rating)


def nut_rigidity(preload: ArrayLike, rigidity: float, load_rating: float, ratio: float) -> Array:
    """Rigidity of a preloaded nut without outer load, 0.8 K (P / (ε Ca))^(1/3).

    The makers' form of two Hertz contacts pressed against each other; the cube root is what Eq. (1) of the
    paper lacks and Eqs. (2) and (3) have.

    Parameters
    ----------
    preload : array_like
        P, N; not negative.
    rigidity : float
        K, N/m.
    load_rating : float
        Ca, N.
    ratio : float
        ε, the preload at which K is stated, as a part of Ca.

    Returns
    -------
    ndarray
        N/m, the shape of ``preload``.
    """
    kappa = nut_kappa(rigidity, load_rating, ratio)
    return np.asarray(kappa * np.cbrt(np.asarray(preload, dtype=np.float64)))


def equivalent_preload_ratio(change: ArrayLike, nut: ArrayLike) -> Array:
    """Ratio of preloads by which the nut alone would change the axial compliance by a given amount.

    The nut's compliance is proportional to P^(−1/3), so P/P₀ = (1 + ΔC/C_nut)^(−3). It is the axial stiffness
    as a ratio of preloads: that of the nut where nothing else has changed, and a defined number where bearing
    or shaft have changed too.

    Parameters
    ----------
    change : array_like
        ΔC, change of the whole axial compliance where the nut is, m/N.
    nut : array_like
        C_nut, compliance of the nut before the change, m/N.

    Returns
    -------
    ndarray
        The common shape; infinite where the compliance fell by the nut's or more.
    """
    u = 1 + np.asarray(change, dtype=np.float64) / np.asarray(nut, dtype=np.float64)
    return np.power(u, -3.0, out=np.full_like(u, np.inf), where=u > 0)


def screw_mass(diameter: float, length: float, density: float) -> float:
    """Mass of a cylinder, kg."""
    return math.pi * diameter**2 / 4 * length * density


def moving_screw_mass(diameter: float, length: float, density: float) -> float:
    """Return a third of the screw's mass, kg: effective mass of a rod at its free end (Rayleigh)."""
    return screw_mass(diameter, length, density) / 3


def screw_inertia(nominal_diameter: float, length: float, density: float) -> float:
    """Inertia of a cylinder about its axis, π d⁴ L ρ / 32, kg m²."""
    return math.pi * nominal_diameter**4 * length * density / 32


def rotor_equivalent_mass(inertia: float, lead: float) -> float:
    """Mass m_r = J/β² that is equivalent to the rotor at the table, kg."""
    return inertia / transmission_ratio(lead) ** 2
