"""The axial natural frequency that a data sheet predicts, Eq. (3) with the rotor held and free."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.given import together
from ballscrew.axis.hertz import apparent_preload
from ballscrew.axis.model import kappa, moving_mass, rotor_mass, screw_part, structure_compliance
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

Rotor = Literal["free", "held"]


def axial_natural_frequency(
    sheet: DataSheet,
    position: ArrayLike,
    load: ArrayLike,
    preload: ArrayLike | None = None,
    rotor: Rotor = "free",
    *,
    torsion: bool = False,
    nut_load: ArrayLike = 0.0,
) -> Array:
    """Undamped frequency of the first axial mode, Eq. (3) in the paper's form.

    With the rotor held, f² (m_t + d) = c / (P^(−1/3) − a x_t − b), which is Eq. (3). With the rotor free, as
    it is in a transfer function from torque, 1/(m_t + d) becomes 1/(m_t + d) + 1/m_r. For a screw carried at
    both ends, −κ times the quadratic compliance stands in the place of a x_t + b. Under a nut load the nut is
    as stiff as an unloaded one of :func:`~ballscrew.axis.hertz.apparent_preload`.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    position : array_like
        x_t, m.
    load : array_like
        Load on the table, kg.
    preload : array_like, optional
        P, N; the nominal preload where it is not given.
    rotor : {"free", "held"}
        Whether the motor can turn.
    torsion : bool
        Whether the twist of shaft and coupling counts; :func:`predicted_frequency` says why it should.
    nut_load : array_like
        F, outer axial force on the nut, N.

    Returns
    -------
    ndarray
        f_a, Hz, of the shape that position, load, preload and nut load broadcast to.

    Raises
    ------
    InputError
        If a position is not on the screw, a preload not above 0, a load negative, or the rotor neither
        free nor held.
    """
    if preload is None:
        preload = sheet.nominal_preload
    x, mass, force, outer = together(position=position, load=load, preload=preload, nut_load=nut_load)
    _check(sheet, x, mass, force)
    if rotor not in ("free", "held"):
        raise InputError(f"the rotor is {rotor!r}; it must be 'free' or 'held'")
    inverse_mass = 1 / (moving_mass(sheet, mass) + screw_part(sheet))
    if rotor == "free":
        inverse_mass = inverse_mass + 1 / rotor_mass(sheet)
    nut = 1 / (kappa(sheet) * np.cbrt(apparent_preload(outer, force)))
    soft = nut + structure_compliance(sheet, x, torsion=torsion)
    return np.asarray(np.sqrt(inverse_mass / soft) / (2 * math.pi))


def nut_share(
    sheet: DataSheet, position: ArrayLike, preload: ArrayLike | None = None, *, torsion: bool = True
) -> Array:
    """Share s of the nut in the axial compliance at the nut.

    d ln f / d ln P is s/6, with the rotor held and free alike.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    position : array_like
        x_t, m.
    preload : array_like, optional
        P, N; the nominal preload where it is not given.
    torsion : bool
        Whether the twist of shaft and coupling counts.

    Returns
    -------
    ndarray
        Between 0 and 1, of the shape that position and preload broadcast to.

    Raises
    ------
    InputError
        As :func:`axial_natural_frequency`.
    """
    if preload is None:
        preload = sheet.nominal_preload
    x, force = together(position=position, preload=preload)
    _check(sheet, x, np.zeros_like(x), force)
    nut = 1 / (kappa(sheet) * np.cbrt(force))
    return np.asarray(nut / (nut + structure_compliance(sheet, x, torsion=torsion)))


def predicted_frequency(
    sheet: DataSheet,
    position: ArrayLike,
    load: ArrayLike,
    preload: ArrayLike | None = None,
    rotor: Rotor = "free",
    *,
    nut_load: ArrayLike = 0.0,
) -> Array:
    """Expected axial natural frequency of an axis, twist of shaft and coupling included.

    A force on the nut goes on as torque through shaft and coupling to the rotor, so their twist lies in
    series with the axial compliances whether the rotor is held or free. It adds 7 to 18 % to the slope with
    position, which is what brings a mode that was measured beside a stop to the stop. The rotor counts as
    one inertia behind the coupling: exact enough for small leads; for a lead of 20 mm on a screw of 40 mm it
    is 6 % low with the rotor free and 7 % high with it held, where
    :func:`~ballscrew.axis.rod.rod_frequency` is right.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    position : array_like
        x_t, m.
    load : array_like
        Load on the table, kg.
    preload : array_like, optional
        P, N; the nominal preload where it is not given.
    rotor : {"free", "held"}
        Whether the motor can turn.
    nut_load : array_like
        F, outer axial force on the nut, N.

    Returns
    -------
    ndarray
        f_a, Hz.

    Raises
    ------
    InputError
        As :func:`axial_natural_frequency`.
    """
    return axial_natural_frequency(sheet, position, load, preload, rotor, torsion=True, nut_load=nut_load)


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
