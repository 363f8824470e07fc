"""θ, the compliance of the structure and the masses of an axis, from its data sheet."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis import compliance, rigidity
from ballscrew.axis.equations import Theta
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError


def kappa(sheet: DataSheet) -> float:
    """κ of the data sheet's nut, N^(2/3)/m: its rigidity is κ P^(1/3)."""
    return rigidity.kappa(sheet.screw)


def rotor_mass(sheet: DataSheet) -> float:
    """m_r: motor, coupling and screw (at its nominal diameter) referred to the table, kg."""
    screw = sheet.screw
    own = compliance.screw_inertia(screw.nominal_diameter, screw.length, screw.density)
    return compliance.rotor_equivalent_mass(sheet.drive.rotor_inertia + own, screw.lead)


def screw_part(sheet: DataSheet) -> float:
    """Parameter d of Eqs. (2) and (3) with the nut in ``table.mass``: a third of the screw's mass, kg."""
    screw = sheet.screw
    return compliance.moving_screw_mass(screw.root_diameter, screw.length, screw.density)


def moving_mass(sheet: DataSheet, load: ArrayLike) -> Array:
    """m_t: table, nut and load, kg."""
    return np.asarray(load, dtype=np.float64) + sheet.table.mass


def structure_compliance(sheet: DataSheet, position: ArrayLike, *, torsion: bool) -> Array:
    """Compliance at the nut of all parts but the nut.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    position : array_like
        x_t, m.
    torsion : bool
        Whether the twist of shaft and coupling counts. The motor sits at the thrust bearing's end.

    Returns
    -------
    ndarray
        m/N, the shape of ``position``.
    """
    screw = sheet.screw
    distance = np.asarray(position, dtype=np.float64) + screw.bearing_to_zero
    total = compliance.support_compliance(
        distance,
        diameter=screw.root_diameter,
        youngs_modulus=screw.youngs_modulus,
        bearing_stiffness=sheet.bearing.stiffness,
        support=sheet.support,
        length=screw.length,
    )
    if not torsion:
        return total
    twist = compliance.torsion_compliance(
        distance, lead=screw.lead, diameter=screw.root_diameter, shear_modulus=screw.shear_modulus
    )
    coupling = compliance.coupling_compliance(screw.lead, sheet.drive.coupling_stiffness)
    return np.asarray(total + twist + coupling)


def theta(sheet: DataSheet, *, torsion: bool = False) -> Theta:
    """θ of a data sheet.

    ``table.mass`` of a data sheet is table *and* nut, so d is only the third of the screw's mass.

    Parameters
    ----------
    sheet : DataSheet
        The axis, carried at one end.
    torsion : bool
        Whether a and b contain the twist of shaft and coupling too, as
        :func:`~ballscrew.axis.frequency.predicted_frequency` does.

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
