"""θ, the compliance of the structure and the masses of an axis, from its data sheet."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis import compliance, rigidity
from ballscrew.axis.equations import Theta
from ballscrew.axis.sheet import STANDARD_GRAVITY, DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

STEEL_EXPANSION = 11.5e-6
"""Linear thermal expansion of steel, 1/K."""

FRICTION_COEFFICIENT = 0.02
"""Coulomb friction over the weight of table and load, of rolling guides with seals.

The EMPS, an axis with a ball screw, has 20.4 N at 95.1 kg: 0.022 (Janot, Gautier and Brunot 2019). The
factor to other rolling guides is 3; sliding guides have more."""


def kappa(sheet: DataSheet) -> float:
    """κ of the data sheet's nut, N^(2/3)/m: its rigidity is κ P^(1/3)."""
    return rigidity.kappa(sheet.screw)


def motor_travel(sheet: DataSheet) -> float:
    """Travel of the table per angle of the motor, lead / (2π ratio), m/rad."""
    return compliance.transmission_ratio(sheet.screw.lead) / sheet.drive.ratio


def rotor_mass(sheet: DataSheet) -> float:
    """m_r: all that turns, referred to the table, kg.

    Motor and coupling by the square of the ratio, and the screw at its nominal diameter unless the nut
    rotates.
    """
    screw, drive = sheet.screw, sheet.drive
    inertia = drive.rotor_inertia * drive.ratio**2
    if drive.rotating == "screw":
        inertia += compliance.screw_inertia(screw.nominal_diameter, screw.length, screw.density)
    return compliance.rotor_equivalent_mass(inertia, screw.lead)


def drive_compliance(sheet: DataSheet) -> float:
    """Axial compliance at the nut by the twist of coupling and belt, m/N."""
    lead, drive = sheet.screw.lead, sheet.drive
    coupling = compliance.coupling_compliance(lead, drive.coupling_stiffness)
    return coupling + compliance.coupling_compliance(lead, drive.belt_stiffness)


def weight_on_nut(sheet: DataSheet, load: ArrayLike) -> Array:
    """Constant force with which the nut carries the weight of table and load.

    m_t g sin α less the counterbalance, with standard gravity.

    Parameters
    ----------
    sheet : DataSheet
        The axis; gives its inclination α, counterbalance and positive direction.
    load : array_like
        Load on the table, kg.

    Returns
    -------
    ndarray
        N, the shape of ``load``; positive where the screw pushes the nut in the positive direction.
    """
    force = (
        moving_mass(sheet, load) * (STANDARD_GRAVITY * math.sin(sheet.inclination))
        - sheet.table.counterbalance
    )
    return np.asarray(force if sheet.positive == "up" else -force)


def guide_friction(sheet: DataSheet, load: ArrayLike) -> Array:
    """Coulomb friction of the guides: the data sheet's, or ``FRICTION_COEFFICIENT`` of the weight.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    load : array_like
        Load on the table, kg.

    Returns
    -------
    ndarray
        N, the shape of ``load``.
    """
    mass = moving_mass(sheet, load)
    if sheet.guide.friction is None:
        return np.asarray(FRICTION_COEFFICIENT * STANDARD_GRAVITY * mass)
    return np.full_like(mass, sheet.guide.friction)


def screw_part(sheet: DataSheet) -> float:
    """Parameter d of Eqs. (2) and (3) with the nut in ``table.mass``: a third of the screw's mass, kg."""
    screw = sheet.screw
    return compliance.moving_screw_mass(screw.root_diameter, screw.length, screw.density)


def moving_mass(sheet: DataSheet, load: ArrayLike) -> Array:
    """m_t: table, nut and load, kg."""
    return np.asarray(load, dtype=np.float64) + sheet.table.mass


def pretension_reserve(sheet: DataSheet, position: ArrayLike) -> tuple[float, float] | None:
    """Nut load and warmth of the screw that use up its pretension.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    position : array_like
        Positions of the nut, m.

    Returns
    -------
    tuple of float or None
        Least nut load that unloads an end at one of the positions, N, and temperature of the screw less that
        of the bed, K; None where the sheet states no pretension. See
        :func:`ballscrew.axis.compliance.pretension_reserve`.
    """
    screw, bearing = sheet.screw, sheet.bearing
    if bearing.pretension is None:
        return None
    near, far = _end_stiffness(sheet)
    load, elongation = compliance.pretension_reserve(
        np.asarray(position, dtype=np.float64) + screw.bearing_to_zero,
        pretension=bearing.pretension,
        diameter=screw.root_diameter,
        youngs_modulus=screw.youngs_modulus,
        near_stiffness=near,
        far_stiffness=far,
        length=screw.length,
    )
    return float(load.min()), elongation / STEEL_EXPANSION


def _end_stiffness(sheet: DataSheet) -> tuple[float, float]:
    """Stiffness of the screw's ends where both are fixed, N/m; infinite where the screw stands still."""
    if sheet.drive.rotating == "nut":
        return math.inf, math.inf
    return sheet.bearing.stiffness, sheet.bearing.far_stiffness or sheet.bearing.stiffness


def structure_compliance(sheet: DataSheet, position: ArrayLike, *, torsion: bool) -> Array:
    """Compliance at the nut of all parts but the nut.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    position : array_like
        x_t, m.
    torsion : bool
        Whether the twist of shaft, coupling and belt counts. The motor sits at the thrust bearing's end. A
        screw that stands still is twisted too, by the torque with which a rotating nut acts on it.

    Returns
    -------
    ndarray
        m/N, the shape of ``position``.
    """
    screw = sheet.screw
    distance = np.asarray(position, dtype=np.float64) + screw.bearing_to_zero
    nut_rotates = sheet.drive.rotating == "nut"
    near, far = _end_stiffness(sheet)
    total = compliance.support_compliance(
        distance,
        diameter=screw.root_diameter,
        youngs_modulus=screw.youngs_modulus,
        bearing_stiffness=near,
        support=sheet.support,
        length=screw.length,
        far_stiffness=far,
    )
    if nut_rotates:
        total = total + compliance.bearing_compliance(sheet.bearing.stiffness)
    if not torsion:
        return total
    twisted = distance
    if nut_rotates and sheet.support == "fixed-fixed":
        twisted = distance * (screw.length - distance) / screw.length
    twist = compliance.torsion_compliance(
        twisted, lead=screw.lead, diameter=screw.root_diameter, shear_modulus=screw.shear_modulus
    )
    return np.asarray(total + twist + drive_compliance(sheet))


def theta(sheet: DataSheet, *, torsion: bool = False) -> Theta:
    """θ of a data sheet.

    ``table.mass`` of a data sheet is table *and* nut, so d is only the third of the screw's mass.

    Parameters
    ----------
    sheet : DataSheet
        The axis, carried at one end.
    torsion : bool
        Whether a and b contain the twist of shaft and coupling too, as
        :func:`~ballscrew.axis.frequency.axial_natural_frequency` does on request.

    Returns
    -------
    Theta
        Parameters of Eqs. (2) and (3).

    Raises
    ------
    InputError
        If the screw is carried at both ends: its compliance is quadratic in x and has no a.
    """
    if sheet.support == "fixed-fixed":
        raise InputError(
            f"{sheet.source}: support is 'fixed-fixed'; θ = {{a, b, c, d}} is linear in the position and "
            "exists for 'fixed-free' and 'fixed-supported' only."
        )
    nut = kappa(sheet)
    at_zero, at_1_m = structure_compliance(sheet, np.array([0.0, 1.0]), torsion=torsion)
    return Theta(
        a=-nut * float(at_1_m - at_zero),
        b=-nut * float(at_zero),
        c=nut / (4 * math.pi**2),
        d=screw_part(sheet),
    )
