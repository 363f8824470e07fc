"""Axial model in the parameters that frequencies determine, and the reference preload that they do not.

Eq. (3) of Han, Miller, Vogl, Chen and Jia (2024) in other coordinates. At one preload the compliance at a
point, its slope and the masses are all that a frequency depends on; the nut's share of the compliance says
what a change of the preload does, and the reference preload turns a ratio into newtons. In θ = {a, b, c, d}
these are mixed, and no frequency determines its scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.frequency import Rotor
from ballscrew.axis.given import finite, not_negative, positive, together
from ballscrew.axis.model import kappa, moving_mass, rotor_mass, screw_part, structure_compliance
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.settings import check_setting

PARAMETERS = ("compliance", "slope", "curve", "mass", "rotor", "share", "preload")
"""The working vector: log compliance, slope, curve, log mass, log rotor, logit share, log preload."""


@dataclass(frozen=True, slots=True)
class AxialModel:
    """Axial model of an axis in the parameters that frequencies determine.

    With ratio = P/P_ref the axial compliance at the nut is
    C(x) = U [1 + slope (x − c) + curve (x − c)² + share (ratio^(−1/3) − 1)], and
    (2π f)² = (1/(mass + load) + 1/rotor) / C.

    Parameters
    ----------
    centre : float
        c, the position where the compliance is stated, m.
    compliance : float
        U, whole axial compliance at the nut, at the centre and the reference preload, m/N.
    slope : float
        By position, as a part of U, 1/m.
    curve : float
        1/m²; 0 unless the screw is held at both ends.
    mass : float
        Moving mass besides the load: table, nut and a third of the screw, kg.
    rotor : float
        m_r, kg; infinite for Eq. (3) of the paper, whatever the state of the rotor.
    share : float
        s, the nut's part of U.
    preload : float
        P_ref, N.

    Raises
    ------
    InputError
        If a value is none that an axis can have.
    """

    centre: float
    compliance: float
    slope: float
    curve: float
    mass: float
    rotor: float
    share: float
    preload: float

    def __post_init__(self) -> None:
        """Refuse values that no axis has."""
        for name in ("compliance", "mass", "preload"):
            check_setting(f"{name} of the model", getattr(self, name), above=0)
        if not self.rotor > 0:
            raise InputError(f"rotor of the model is {self.rotor:g} kg; it must be more than 0, or infinite.")
        if not 0 < self.share < 1:
            raise InputError(f"share of the model is {self.share:g}; it must lie between 0 and 1.")
        for name in ("centre", "slope", "curve"):
            check_setting(f"{name} of the model", getattr(self, name))


def frequency(
    model: AxialModel, position: ArrayLike, load: ArrayLike, ratio: ArrayLike = 1.0, rotor: Rotor = "free"
) -> Array:
    """Axial natural frequency, Eq. (3) and the same with the rotor free.

    Parameters
    ----------
    model : AxialModel
        The axis.
    position, load : array_like
        x_t, m; load on the table, kg.
    ratio : array_like
        P/P_ref.
    rotor : {"free", "held"}
        Whether the motor can turn.

    Returns
    -------
    ndarray
        Hz, of the shape that the arguments broadcast to.

    Raises
    ------
    InputError
        If an argument is no possible value, or the compliance at a position not more than 0.
    """
    x, mass, part = _points(position, load, ratio)
    soft = _softness(model, x, part)
    inverse = _inverse_mass(model, mass, rotor)
    return np.asarray(np.sqrt(inverse / (model.compliance * soft)) / (2 * math.pi))


def gradient(
    model: AxialModel, position: ArrayLike, load: ArrayLike, ratio: ArrayLike = 1.0, rotor: Rotor = "free"
) -> Array:
    """∂ ln f by the working vector and by log ratio, in closed form.

    Parameters
    ----------
    model, position, load, ratio, rotor
        As :func:`frequency`.

    Returns
    -------
    ndarray
        Shape of the points and 8: one column for each of ``PARAMETERS`` (log compliance, slope, curve, log
        mass, log rotor, logit share, log preload) and one for log ratio. That of log preload is 0: no
        frequency knows it while the ratio stays.

    Raises
    ------
    InputError
        As :func:`frequency`.
    """
    x, mass, part = _points(position, load, ratio)
    soft = _softness(model, x, part)
    inverse = _inverse_mass(model, mass, rotor)
    away, nut = x - model.centre, np.cbrt(1 / part)
    moving = model.mass + mass
    free = rotor == "free" and math.isfinite(model.rotor)
    return np.stack(
        [
            np.full_like(soft, -0.5),
            -away / (2 * soft),
            -(away**2) / (2 * soft),
            -model.mass / (2 * inverse * moving**2),
            -1 / (2 * inverse * model.rotor) if free else np.zeros_like(soft),
            -(nut - 1) * model.share * (1 - model.share) / (2 * soft),
            np.zeros_like(soft),
            model.share * nut / (6 * soft),
        ],
        axis=-1,
    )


def to_vector(model: AxialModel) -> Array:
    """Return the working vector, shape (7,); log rotor is infinite where the rotor is."""
    return np.array(
        [
            math.log(model.compliance),
            model.slope,
            model.curve,
            math.log(model.mass),
            math.log(model.rotor),
            math.log(model.share / (1 - model.share)),
            math.log(model.preload),
        ]
    )


def from_vector(vector: ArrayLike, centre: float) -> AxialModel:
    """Return the model of a working vector.

    Parameters
    ----------
    vector : array_like, shape (7,)
        As :func:`to_vector` makes it.
    centre : float
        Position at which its compliance is stated, m.

    Returns
    -------
    AxialModel
        The axis.

    Raises
    ------
    InputError
        If it is none that an axis can have.
    """
    numbers = np.asarray(vector, dtype=np.float64)
    if numbers.shape != (len(PARAMETERS),):
        raise InputError(f"a working vector has {len(PARAMETERS)} numbers; {numbers.shape} was given.")
    compliance, slope, curve, mass, rotor, share, preload = (float(number) for number in numbers)
    return AxialModel(
        centre, _exp(compliance), slope, curve, _exp(mass), _exp(rotor), 1 / (1 + _exp(-share)), _exp(preload)
    )


def from_sheet(sheet: DataSheet, centre: float) -> AxialModel:
    """Return the lumped model of a data sheet: :func:`~ballscrew.axis.frequency.axial_natural_frequency`.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    centre : float
        Position at which the compliance is stated, m; on the screw.

    Returns
    -------
    AxialModel
        At the nominal preload, twist of shaft and coupling included.

    Raises
    ------
    InputError
        If the centre is not on the screw.
    """
    sheet.check_position(centre, "centre")
    low, high = -sheet.screw.bearing_to_zero, sheet.travel_limit
    reach = max(high - centre, centre - low) / 2
    step = reach if centre + reach <= high else -reach
    here, there, beyond = structure_compliance(
        sheet, np.array([centre, centre + step / 2, centre + step]), torsion=True
    )
    curve = float(beyond - 2 * there + here) / (step / 2) ** 2 / 2 if sheet.support == "fixed-fixed" else 0.0
    slope = float(beyond - here) / step - curve * step
    nut = 1 / (kappa(sheet) * math.cbrt(sheet.nominal_preload))
    whole = nut + float(here)
    return AxialModel(
        centre=centre,
        compliance=whole,
        slope=slope / whole,
        curve=curve / whole,
        mass=float(moving_mass(sheet, 0.0)) + screw_part(sheet),
        rotor=rotor_mass(sheet),
        share=nut / whole,
        preload=sheet.nominal_preload,
    )


def _exp(value: float) -> float:
    try:
        return math.exp(value)
    except OverflowError:
        return math.inf


def _points(position: ArrayLike, load: ArrayLike, ratio: ArrayLike) -> list[Array]:
    return together(
        position=finite("position", position, "m"),
        load=not_negative("load", load, "kg"),
        ratio=positive("preload ratio", ratio, ""),
    )


def _rest(model: AxialModel, x: Array) -> Array:
    """All compliance but the nut's, as a part of U."""
    away = x - model.centre
    return np.asarray(1 - model.share + model.slope * away + model.curve * away**2)


def _softness(model: AxialModel, x: Array, ratio: Array) -> Array:
    soft = _rest(model, x) + model.share * np.cbrt(1 / ratio)
    bad = ~(soft > 0)
    if np.any(bad):
        raise InputError(
            f"at a position of {x[bad].flat[0]:g} m the model leaves no compliance at all; the position must "
            "lie on the screw."
        )
    return np.asarray(soft)


def _inverse_mass(model: AxialModel, load: Array, rotor: Rotor) -> Array:
    if rotor not in ("free", "held"):
        raise InputError(f"the rotor is {rotor!r}; it must be 'free' or 'held'")
    inverse = 1 / (model.mass + load)
    if rotor == "free":
        inverse = inverse + 1 / model.rotor
    return np.asarray(inverse)
