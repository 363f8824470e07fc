"""Eq. (1) of the paper: exactly as it is printed, to set beside the rest, and corrected.

Nothing else computes with the printed form. What it does wrong, and by how much, is on the page *Where we
depart from the paper, and why*. Han, Miller, Vogl, Chen and Jia, *Robust feature design for early detection
of ball screw preload loss*, 2024.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.compliance import (
    bearing_compliance,
    coupling_compliance,
    nut_kappa,
    shaft_compliance,
    torsion_compliance,
    transmission_ratio,
)
from ballscrew.axis.given import finite, not_negative, positive
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

__all__ = [
    "equation_1_as_printed",
    "equation_1_corrected",
    "preload_as_printed",
    "torsion_as_printed",
]


def torsion_as_printed(*, lead: float, diameter: float, length: float, shear_modulus: float) -> float:
    """Second term of Eq. (1) as printed, 32 β L / (π d³ G), m/N.

    Parameters
    ----------
    lead, diameter, length : float
        Of the screw (its whole length), m.
    shear_modulus : float
        G, Pa.

    Returns
    -------
    float
        m/N: d/β times the twist of a shaft of that length.
    """
    return 32 * transmission_ratio(lead) * length / (math.pi * diameter**3 * shear_modulus)


def preload_as_printed(bracket: ArrayLike, *, rigidity: float, load_rating: float) -> Array:
    """Eq. (1) as printed, P = 0.1 Ca / (0.8 K [·]), N: without the cube that Eqs. (2) and (3) have.

    Parameters
    ----------
    bracket : array_like
        The bracket of Eq. (1): the compliance that is left for the nut, m/N.
    rigidity : float
        K, N/m.
    load_rating : float
        Ca, N.

    Returns
    -------
    ndarray
        N. With the cube, 0.1 Ca / (0.8 K [·])³, it inverts the makers' rigidity law.
    """
    return np.asarray(0.1 * load_rating / (0.8 * rigidity * np.asarray(bracket, dtype=np.float64)))


def equation_1_as_printed(  # noqa: PLR0913  the symbols of the equation
    x_t: ArrayLike,
    f_a: ArrayLike,
    m_t: ArrayLike,
    *,
    rigidity: float,
    load_rating: float,
    diameter: float,
    length: float,
    shear_modulus: float,
    youngs_modulus: float,
    lead: float,
    screw_mass: float,
    nut_mass: float,
    bearing_stiffness: float,
) -> Array:
    """Eq. (1) as printed, term by term.

    P = 0.1 Ca / (0.8 K [·]), the bracket
    −4 x_t/(π d_m² E) − 32 β L/(π d_m³ G) − 1/k_bearing + 1/((2π f_a)² (m_t + m_s + m_nut)).

    Parameters
    ----------
    x_t : array_like
        Axis position, m.
    f_a : array_like
        Axial natural frequency, Hz.
    m_t : array_like
        Mass of the worktable, kg.
    rigidity, load_rating : float
        K, N/m; Ca, N.
    diameter, length, lead : float
        d_m (root), L and the lead, of which β = lead/2π, m.
    shear_modulus, youngs_modulus : float
        G and E, Pa.
    screw_mass, nut_mass : float
        m_s and m_nut, kg.
    bearing_stiffness : float
        k_bearing, N/m.

    Returns
    -------
    ndarray
        P as printed, N. Negative where the printed torsion term is larger than all compliance.
    """
    x, f, mass = (np.asarray(part, dtype=np.float64) for part in (x_t, f_a, m_t))
    bracket = (
        -4 * x / (math.pi * diameter**2 * youngs_modulus)
        - torsion_as_printed(lead=lead, diameter=diameter, length=length, shear_modulus=shear_modulus)
        - 1 / bearing_stiffness
        + 1 / ((2 * math.pi * f) ** 2 * (mass + screw_mass + nut_mass))
    )
    return preload_as_printed(bracket, rigidity=rigidity, load_rating=load_rating)


def equation_1_corrected(  # noqa: PLR0913  the symbols of the equation
    x_t: ArrayLike,
    f_a: ArrayLike,
    m_t: ArrayLike,
    *,
    rigidity: float,
    load_rating: float,
    rigidity_preload_ratio: float,
    diameter: float,
    bearing_to_zero: float,
    shear_modulus: float,
    youngs_modulus: float,
    lead: float,
    screw_mass: float,
    nut_mass: float,
    bearing_stiffness: float,
    coupling_stiffness: float | None = None,
    rotor_mass: float = math.inf,
) -> Array:
    """Eq. (1) as it should read: P = (C_N κ)^(−3), C_N what is left of the compliance for the nut.

    Against the printed form: the cube; shaft and twist from the bearing to the nut, 32 β² l/(π d⁴ G), and
    the coupling beside it; a third of the screw's mass; ε as the catalogue says it; the rotor where it is
    free.

    Parameters
    ----------
    x_t, f_a, m_t : array_like
        Axis position, m; axial natural frequency, Hz; mass of the worktable, kg.
    rigidity, load_rating : float
        K, N/m; Ca, N.
    rigidity_preload_ratio : float
        ε, at which K is stated.
    diameter, bearing_to_zero, lead : float
        d_m (root), from the thrust bearing to the nut at x_t = 0, and the lead, m.
    shear_modulus, youngs_modulus : float
        G and E, Pa.
    screw_mass, nut_mass : float
        m_s and m_nut, kg.
    bearing_stiffness : float
        k_bearing, N/m.
    coupling_stiffness : float, optional
        Torsional, N m/rad; rigid where it is not given.
    rotor_mass : float
        m_r, kg; infinite where the rotor is held.

    Returns
    -------
    ndarray
        P, N.

    Raises
    ------
    InputError
        If the other compliances alone are larger than what the frequency allows, or an argument is no
        possible value.
    """
    x, f, mass = (
        finite("position", x_t, "m"),
        positive("frequency", f_a, "Hz"),
        not_negative("mass", m_t, "kg"),
    )
    distance = not_negative("distance from the bearing", x + bearing_to_zero, "m")
    moving = positive("moving mass", mass + screw_mass / 3 + nut_mass, "kg")
    if not rotor_mass > 0:
        raise InputError(
            f"a rotor mass of {rotor_mass:g} kg was given; it must be more than 0 kg, or infinite."
        )
    total = (1 / moving + 1 / rotor_mass) / (2 * math.pi * f) ** 2
    nut = (
        total
        - shaft_compliance(distance, diameter=diameter, youngs_modulus=youngs_modulus, support="fixed-free")
        - torsion_compliance(distance, lead=lead, diameter=diameter, shear_modulus=shear_modulus)
        - coupling_compliance(lead, coupling_stiffness)
        - bearing_compliance(bearing_stiffness)
    )
    if not np.all(nut > 0):
        raise InputError(
            f"a frequency of {np.broadcast_to(f, nut.shape)[~(nut > 0)].flat[0]:.6g} Hz was given; it is "
            "above that of a nut without any compliance, so no preload explains it."
        )
    return np.asarray((nut * nut_kappa(rigidity, load_rating, rigidity_preload_ratio)) ** -3)
