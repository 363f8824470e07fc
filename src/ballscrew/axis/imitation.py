"""Effects that imitate a loss of preload, as the apparent change P_apparent/P − 1.

The first three and the last act on the frequency: what is then measured is read by Eq. (3) of the paper as if
nothing but the preload had changed, inverted exactly. Warmth and oil truly press the nut harder, for a while.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.equations import preload_change
from ballscrew.axis.frequency import Rotor, axial_natural_frequency
from ballscrew.axis.given import finite, not_negative, positive
from ballscrew.axis.hertz import preload_deflection
from ballscrew.axis.model import STEEL_EXPANSION, kappa
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown

_CONTACT_ANGLE = math.pi / 4
_RIGID = 1e300  # N: a preload that leaves the nut no compliance


def wrong_load(
    sheet: DataSheet,
    hidden: ArrayLike,
    *,
    position: ArrayLike = 0.0,
    load: ArrayLike = 0.0,
    preload: ArrayLike | None = None,
    rotor: Rotor = "held",
) -> Array:
    """Apparent change by an unknown load on the table.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    hidden : array_like
        Load that is not accounted for, kg; negative if the load is smaller than assumed.
    position, load, preload : array_like
        x_t (m), the load that is known (kg) and P (N; nominal where not given).
    rotor : {"held", "free"}
        State of the rotor.

    Returns
    -------
    ndarray
        P_apparent/P − 1; −0.08 is 8 % of the preload that seem lost.

    Raises
    ------
    InputError
        As :func:`~ballscrew.axis.frequency.axial_natural_frequency`; or if no preload belongs to what is
        measured, because the frequency lies above that of an infinitely stiff nut.
    """
    true = finite("load", load, "kg") + finite("hidden load", hidden, "kg")
    measured = axial_natural_frequency(sheet, position, true, preload, rotor)
    return _read(sheet, measured, position, load, preload, rotor)


def wrong_position(
    sheet: DataSheet,
    shift: ArrayLike,
    *,
    position: ArrayLike = 0.0,
    load: ArrayLike = 0.0,
    preload: ArrayLike | None = None,
    rotor: Rotor = "held",
) -> Array:
    """Apparent change by a wrong position of the nut.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    shift : array_like
        True position less the known one, m.
    position, load, preload, rotor
        As for :func:`wrong_load`.

    Returns
    -------
    ndarray
        P_apparent/P − 1.

    Raises
    ------
    InputError
        As :func:`wrong_load`.
    """
    true = finite("position", position, "m") + finite("shift", shift, "m")
    measured = axial_natural_frequency(sheet, true, load, preload, rotor)
    return _read(sheet, measured, position, load, preload, rotor)


def bearing_change(
    sheet: DataSheet,
    change: float,
    *,
    position: ArrayLike = 0.0,
    load: ArrayLike = 0.0,
    preload: ArrayLike | None = None,
    rotor: Rotor = "held",
) -> Array:
    """Apparent change by a softer or stiffer thrust bearing.

    Neither masses nor positions can separate it from the nut: both are one compliance in series.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    change : float
        Relative change of k_b: −0.1 is a tenth less; above −1.
    position, load, preload, rotor
        As for :func:`wrong_load`.

    Returns
    -------
    ndarray
        P_apparent/P − 1.

    Raises
    ------
    InputError
        As :func:`wrong_load`; or if the change leaves no stiffness.
    """
    part = finite("change of the bearing", change)
    if part.ndim or part <= -1:
        raise InputError(
            f"a change of the bearing of {shown(change)} was given; it must be one number above -1."
        )
    stiffness = (1 + float(part)) * sheet.bearing.stiffness
    far = sheet.bearing.far_stiffness
    if far is not None:
        far *= 1 + float(part)
    other = replace(sheet, bearing=replace(sheet.bearing, stiffness=stiffness, far_stiffness=far))
    measured = axial_natural_frequency(other, position, load, preload, rotor)
    return _read(sheet, measured, position, load, preload, rotor)


def wrong_sample_rate(
    sheet: DataSheet,
    true_rate: ArrayLike,
    declared_rate: ArrayLike,
    *,
    position: ArrayLike = 0.0,
    load: ArrayLike = 0.0,
    preload: ArrayLike | None = None,
    rotor: Rotor = "held",
) -> Array:
    """Apparent change by a wrong sample rate, which scales every frequency.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    true_rate, declared_rate : array_like
        Hz.
    position, load, preload, rotor
        As for :func:`wrong_load`.

    Returns
    -------
    ndarray
        P_apparent/P − 1.

    Raises
    ------
    InputError
        As :func:`wrong_load`.
    """
    scale = positive("declared rate", declared_rate, "Hz") / positive("true rate", true_rate, "Hz")
    measured = scale * axial_natural_frequency(sheet, position, load, preload, rotor)
    return _read(sheet, measured, position, load, preload, rotor)


def warm_screw(
    sheet: DataSheet, difference: ArrayLike, contact_radius: ArrayLike, *, preload: ArrayLike | None = None
) -> Array:
    """Change by a screw that is warmer than its nut: α ΔT r more presses every ball.

    It is the model of four-point contact, whose balls the screw pushes outwards against the nut; a nut of two
    halves behaves otherwise. At a contact angle of 45° a radius that grows by α ΔT r presses the flanks
    together along the axis by as much: δ₀ grows by it, and P = P₀ (1 + α ΔT r / δ₀)^1.5. The change is real,
    and passes with the warmth.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    difference : array_like
        ΔT, screw less nut, K.
    contact_radius : array_like
        r, from the screw's axis to the contacts, m.
    preload : array_like, optional
        P₀, N; nominal where not given.

    Returns
    -------
    ndarray
        P/P₀ − 1; −1 where a cold screw takes all of the preload.

    Raises
    ------
    InputError
        If a number cannot be.
    """
    growth = STEEL_EXPANSION * finite("difference of temperature", difference, "K")
    return _pressed(sheet, growth * positive("contact radius", contact_radius, "m"), preload)


def oil_film(sheet: DataSheet, thickness: ArrayLike, *, preload: ArrayLike | None = None) -> Array:
    """Change by the oil of a moving nut: a film in both contacts of a ball presses the flank by 2h / sin 45°.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    thickness : array_like
        h, of the film in one contact when moving, less that at rest, m; 0 or more.
    preload : array_like, optional
        P₀ at rest, N; nominal where not given.

    Returns
    -------
    ndarray
        P/P₀ − 1.

    Raises
    ------
    InputError
        If a number cannot be.
    """
    film = not_negative("thickness of the oil film", thickness, "m")
    return _pressed(sheet, 2 * film / math.sin(_CONTACT_ANGLE), preload)


def _read(
    sheet: DataSheet,
    measured: Array,
    position: ArrayLike,
    load: ArrayLike,
    preload: ArrayLike | None,
    rotor: Rotor,
) -> Array:
    """P_apparent/P − 1 of a measured frequency, by the data sheet."""
    expected = axial_natural_frequency(sheet, position, load, preload, rotor)
    stiffest = axial_natural_frequency(sheet, position, load, _RIGID, rotor)
    # f² ∝ 1/C: an infinitely stiff nut lowers the compliance by the share of the nut.
    share = 1 - (expected / stiffest) ** 2
    return np.asarray(preload_change(measured, expected, share) - 1)


def _pressed(sheet: DataSheet, more: ArrayLike, preload: ArrayLike | None) -> Array:
    """P/P₀ − 1 where each flank is pressed together by more than δ₀."""
    start = positive("preload", sheet.nominal_preload if preload is None else preload, "N")
    ratio = 1 + np.asarray(more) / preload_deflection(start, kappa(sheet))
    return np.asarray(np.maximum(ratio, 0.0) ** 1.5 - 1)
