"""The axial natural frequency that a data sheet predicts, Eq. (3) with the rotor held and free."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballscrew.axis import compliance
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError

__all__ = [
    "Theta",
    "axial_natural_frequency",
    "predicted_frequency",
    "rotor_mass",
    "theta",
]

Rotor = Literal["free", "held"]
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Theta:
    """θ = {a, b, c, d} of Eqs. (2) and (3).

    Parameters
    ----------
    a : float
        −κ × compliance of the shaft per length, N^(−1/3)/m; negative.
    b : float
        −κ × all other compliance but the nut's, N^(−1/3); negative.
    c : float
        κ / 4π², N^(2/3)/m; positive.
    d : float
        What moves besides table, nut and load: a third of the screw's mass, kg.
    """

    a: float
    b: float
    c: float
    d: float


def theta(sheet: DataSheet, *, torsion: bool = False) -> Theta:
    """θ as the data sheet has it.

    ``table.mass`` of a data sheet is table *and* nut, so d holds only the third of the screw's mass.

    Parameters
    ----------
    sheet : DataSheet
        The axis, carried at one end.
    torsion : bool
        Whether a and b hold the twist of shaft and coupling too, as :func:`predicted_frequency` does.

    Returns
    -------
    Theta
        Of Eqs. (2) and (3).

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
    kappa = _kappa(sheet)
    at_zero, at_one = _structure(sheet, np.array([0.0, 1.0]), torsion)
    return Theta(
        a=-kappa * float(at_one - at_zero),
        b=-kappa * float(at_zero),
        c=kappa / (4 * math.pi**2),
        d=_screw_part(sheet),
    )


def rotor_mass(sheet: DataSheet) -> float:
    """m_r: motor, coupling and screw (at its nominal diameter) referred to the table, kg."""
    screw = sheet.screw
    own = compliance.screw_inertia(screw.nominal_diameter, screw.length, screw.density)
    return compliance.rotor_equivalent_mass(sheet.drive.rotor_inertia + own, screw.lead)


def axial_natural_frequency(
    sheet: DataSheet,
    position: ArrayLike,
    load: ArrayLike,
    preload: ArrayLike | None = None,
    rotor: Rotor = "free",
    *,
    torsion: bool = False,
) -> Array:
    """Undamped frequency of the first axial mode, Eq. (3) in the paper's form.

    With the rotor held, f² (m_t + d) = c / (P^(−1/3) − a x_t − b), which is Eq. (3). With the rotor free, as
    it is in a transfer function from torque, 1/(m_t + d) becomes 1/(m_t + d) + 1/m_r. For a screw carried at
    both ends, −κ times the quadratic compliance stands in the place of a x_t + b.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    position : array_like
        x_t, m.
    load : array_like
        What lies on the table, kg.
    preload : array_like, optional
        P, N; the nominal preload where it is not given.
    rotor : {"free", "held"}
        Whether the motor can turn.
    torsion : bool
        Whether the twist of shaft and coupling counts; :func:`predicted_frequency` says why it should.

    Returns
    -------
    ndarray
        f_a, Hz, of the shape that position, load and preload broadcast to.

    Raises
    ------
    InputError
        If a position is not on the screw, a preload not above 0, a load negative, or the rotor neither
        free nor held.
    """
    x, mass, force = np.broadcast_arrays(
        np.asarray(position, dtype=np.float64),
        np.asarray(load, dtype=np.float64),
        np.asarray(sheet.nominal_preload if preload is None else preload, dtype=np.float64),
    )
    _check(sheet, x, mass, force)
    if rotor not in ("free", "held"):
        raise InputError(f"the rotor is {rotor!r}; it must be 'free' or 'held'")
    kappa = _kappa(sheet)
    moving = mass + sheet.table.mass + _screw_part(sheet)
    inverse_mass = 1 / moving + (1 / rotor_mass(sheet) if rotor == "free" else 0.0)
    softness = 1 / np.cbrt(force) + kappa * _structure(sheet, x, torsion)
    return np.asarray(np.sqrt(kappa / softness * inverse_mass) / (2 * math.pi))


def predicted_frequency(
    sheet: DataSheet,
    position: ArrayLike,
    load: ArrayLike,
    preload: ArrayLike | None = None,
    rotor: Rotor = "free",
) -> Array:
    """Frequency at which a measured axis is expected to ring: twist of shaft and coupling included.

    A force on the nut goes on as torque through shaft and coupling to the rotor, so their twist lies in
    series with the axial compliances whether the rotor is held or free. It adds 7 to 18 % to the slope with
    position, which is what brings a mode that was measured beside a stop to the stop. The rotor counts as one
    inertia behind the coupling: exact enough for small leads, some per cent low where the lead is large.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    position : array_like
        x_t, m.
    load : array_like
        What lies on the table, kg.
    preload : array_like, optional
        P, N; the nominal preload where it is not given.
    rotor : {"free", "held"}
        Whether the motor can turn.

    Returns
    -------
    ndarray
        f_a, Hz.

    Raises
    ------
    InputError
        As :func:`axial_natural_frequency`.
    """
    return axial_natural_frequency(sheet, position, load, preload, rotor, torsion=True)


def _kappa(sheet: DataSheet) -> float:
    screw = sheet.screw
    return compliance.nut_kappa(screw.rigidity, screw.dynamic_load_rating, screw.rigidity_preload_ratio)


def _screw_part(sheet: DataSheet) -> float:
    screw = sheet.screw
    return compliance.moving_screw_mass(screw.root_diameter, screw.length, screw.density)


def _structure(sheet: DataSheet, position: Array, torsion: bool) -> Array:
    """All compliance but the nut's, m/N."""
    screw = sheet.screw
    distance = np.asarray(position, dtype=np.float64) + screw.bearing_to_zero
    total = compliance.bearing_compliance(sheet.bearing.stiffness) + compliance.shaft_compliance(
        distance,
        diameter=screw.root_diameter,
        youngs_modulus=screw.youngs_modulus,
        support=sheet.support,
        length=screw.length,
    )
    if not torsion:
        return np.asarray(total)
    twist = compliance.torsion_compliance(
        distance, lead=screw.lead, diameter=screw.root_diameter, shear_modulus=screw.shear_modulus
    )
    coupling = compliance.coupling_compliance(screw.lead, sheet.drive.coupling_stiffness)
    return np.asarray(total + twist + coupling)


def _check(sheet: DataSheet, x: Array, load: Array, preload: Array) -> None:
    low, high = -sheet.screw.bearing_to_zero, sheet.travel_limit
    for name, values, good, allowed in (
        ("position", x, (x >= low) & (x <= high), f"between {low:g} and {high:g} m, on the screw"),
        ("load", load, (load >= 0) & np.isfinite(load), "a mass, 0 kg or more"),
        ("preload", preload, (preload > 0) & np.isfinite(preload), "more than 0 N"),
    ):
        if not np.all(good):
            wrong = np.asarray(values)[~good].flat[0]
            raise InputError(f"{sheet.source}: a {name} of {wrong:g} was given; it must be {allowed}.")
