"""Axial natural frequency that a data sheet predicts: of a rod, and of Eq. (3); rotor held and free."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballscrew.axis.compliance import transmission_ratio
from ballscrew.axis.given import together
from ballscrew.axis.hertz import apparent_preload
from ballscrew.axis.model import (
    drive_compliance,
    kappa,
    moving_mass,
    rotor_mass,
    screw_part,
    structure_compliance,
)
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

Rotor = Literal["free", "held"]

# Of the lumped frequency, where the modes are searched for, and up to which power of it. Modes less than a
# step of 1 % apart are one: there the table's energy is in both.
_LOW, _HIGH, _STEPS, _REACH = 0.4, 2.5, 184, 3
_LEAST_SHARE = 1e-6  # of the kinetic energy: of a second mode where there is none
_HALVINGS = 10  # of that step: 1e-5 of the frequency, and 1e-10 after one step by the slope
_SLOPE_STEP = 1e-5


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
        Whether the twist of shaft and coupling counts; it adds 7 to 18 % to the
        slope with position.
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
    """Expected axial natural frequency of an axis whose screw is a rod that stretches and twists.

    The screw's mass and rotary inertia lie along it, and motor and coupling turn as one disc behind the
    coupling's spring. With Y_u and Y_φ the axial and torsional receptances of the screw at the nut, ends
    included, the modes are the roots of 1/k_nut + Y_u + Y_φ = 1/(m_t ω²) (receptance coupling; Bishop and
    Johnson 1960, The Mechanics of Vibration). Of these the axial mode is that of which the table has the
    largest share of the kinetic energy. In :func:`axial_natural_frequency` the screw is lumped: with a free
    rotor and leads of 10 mm and more it is up to 6 % low fixed-free, 11 % low fixed-fixed.

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
    return predicted_modes(sheet, position, load, preload, rotor, nut_load=nut_load).frequency


@dataclass(frozen=True, slots=True)
class AxialModes:
    """Axial mode, and the mode in which the table has the next largest share of the kinetic energy.

    Where the shares are nearly equal, table and screw swing against each other: both are the axis's modes.

    Parameters
    ----------
    frequency, second_frequency : ndarray
        Hz; equal where there is no second mode.
    share, second_share : ndarray
        Kinetic energy of table and load, as a part of the mode's. All modes and, with the rotor free, the
        rigid body add up to 1.
    """

    frequency: Array
    share: Array
    second_frequency: Array
    second_share: Array

    @property
    def log_odds(self) -> Array:
        """Logarithm of the share over that of the second mode."""
        return np.asarray(np.log(self.share / self.second_share))

    def nearest(self, frequency: Array) -> Array:
        """Frequency of the mode that is closer to a given one, Hz: the same mode of a similar axis."""
        away, second_away = np.abs(self.frequency - frequency), np.abs(self.second_frequency - frequency)
        return np.where(second_away < away, self.second_frequency, self.frequency)


def predicted_modes(
    sheet: DataSheet,
    position: ArrayLike,
    load: ArrayLike,
    preload: ArrayLike | None = None,
    rotor: Rotor = "free",
    *,
    nut_load: ArrayLike = 0.0,
) -> AxialModes:
    """Axial mode of :func:`predicted_frequency` and the mode that comes next to it.

    Parameters
    ----------
    sheet, position, load, preload, rotor, nut_load
        As of :func:`predicted_frequency`.

    Returns
    -------
    AxialModes
        Of the shape that position, load, preload and nut load broadcast to.

    Raises
    ------
    InputError
        As :func:`axial_natural_frequency`.
    """
    lumped = axial_natural_frequency(sheet, position, load, preload, rotor, torsion=True, nut_load=nut_load)
    if preload is None:
        preload = sheet.nominal_preload
    x, mass, force, outer = together(position=position, load=load, preload=preload, nut_load=nut_load)
    balance = _Balance(
        sheet,
        x.ravel() + sheet.screw.bearing_to_zero,
        moving_mass(sheet, mass.ravel()),
        kappa(sheet) * np.cbrt(apparent_preload(outer.ravel(), force.ravel())),
        rotor,
    )
    omega, share = balance.axial_modes(2 * math.pi * lumped.ravel())
    frequencies, shares = omega.reshape(2, *lumped.shape) / (2 * math.pi), share.reshape(2, *lumped.shape)
    return AxialModes(frequencies[0], shares[0], frequencies[1], shares[1])


@dataclass(frozen=True, slots=True)
class _Balance:
    """G(ω) = 1/k_nut + Y_u + Y_φ − 1/(m_t ω²) of some cases: ascends between its poles, 0 at the modes.

    Twist counts as travel, the angle times β.
    """

    sheet: DataSheet
    distance: Array
    mass: Array
    nut: Array
    rotor: Rotor

    def axial_modes(self, lumped: Array) -> tuple[Array, Array]:
        """Angular frequencies and table shares of the two modes with the largest ones; (2, case) each.

        Where no mode is found, the lumped frequency with the least share. The shares of all modes add up to
        1: the range is widened where what is missing could be a mode with a share as large.
        """
        omega, share = np.tile(lumped, (2, 1)), np.full((2, len(lumped)), _LEAST_SHARE)
        oscillating = np.ones_like(lumped)
        if self.rotor == "free":
            oscillating = 1 - self.mass / (self.mass + rotor_mass(self.sheet))
        cases = np.arange(len(lumped))
        for reach in range(1, _REACH + 1):
            case, root, part = self._roots(cases, lumped[cases], reach)
            order = np.argsort(part)
            for place in (0, 1):
                omega[place, case[order]] = root[order]  # of several, the last stays
                share[place, case[order]] = part[order]
                order = order[share[0, case[order]] != part[order]]
            missing = oscillating - np.bincount(case, part, len(lumped))
            cases = cases[(missing > np.maximum(share[0] / 2, share[1]))[cases]]
            if not len(cases):
                break
        omega[1] = np.where(share[1] > _LEAST_SHARE, omega[1], omega[0])
        return omega, np.maximum(share, _LEAST_SHARE)

    def _roots(
        self, cases: NDArray[np.intp], lumped: Array, reach: int
    ) -> tuple[NDArray[np.intp], Array, Array]:
        """Case, angular frequency and table share of every mode in the range."""
        grid = lumped[:, None] * np.geomspace(_LOW**reach, _HIGH**reach, reach * _STEPS + 1)
        ascends = np.diff(np.signbit(self(cases[:, None], grid)).astype(int), axis=1) < 0
        row, start = np.nonzero(ascends)
        case, low, high = cases[row], grid[row, start], grid[row, start + 1]
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            below = self(case, middle) < 0
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        root = (low + high) / 2
        root = np.clip(root * (1 - self(case, root) / self._slope(case, root)), low, high)
        return case, root, 2 / (self.mass[case] * root**2 * self._slope(case, root))

    def _slope(self, case: NDArray[np.intp], omega: Array) -> Array:
        """Slope of G by ln ω."""
        above, below = self(case, omega * (1 + _SLOPE_STEP)), self(case, omega * (1 - _SLOPE_STEP))
        return (above - below) / (2 * _SLOPE_STEP)

    def __call__(self, case: NDArray[np.intp], omega: Array) -> Array:
        """Return G of the cases at angular frequencies of the same shape."""
        sheet, screw = self.sheet, self.sheet.screw
        at = self.distance[case]
        beta = transmission_ratio(screw.lead)
        area, carrying = math.pi * screw.root_diameter**2 / 4, math.pi * screw.root_diameter**4 / 32
        turning = math.pi * screw.nominal_diameter**4 / 32
        stretch = math.sqrt(screw.density / screw.youngs_modulus), screw.youngs_modulus * area
        speed = math.sqrt(screw.shear_modulus * carrying / (screw.density * turning))
        twist = 1 / speed, screw.shear_modulus * carrying / beta**2
        near, far, motor = self._ends(omega)
        total = 1 / self.nut[case] - 1 / (self.mass[case] * omega**2)
        if sheet.drive.rotating == "nut":
            total = total + motor + 1 / sheet.bearing.stiffness
            twisted = _receptance(omega, at, screw.length - at, *twist, near, far)
        else:
            twisted = _receptance(omega, at, screw.length - at, *twist, motor, math.inf)
        return np.asarray(total + twisted + _receptance(omega, at, screw.length - at, *stretch, near, far))

    def _ends(self, omega: Array) -> tuple[float, float, Array]:
        """Receptance of the thrust bearing, of the other end, and of the drive, m/N."""
        sheet = self.sheet
        fixed = sheet.support == "fixed-fixed"
        drive = np.full_like(omega, drive_compliance(sheet))
        if self.rotor == "free":
            disc = sheet.drive.rotor_inertia * (sheet.drive.ratio / transmission_ratio(sheet.screw.lead)) ** 2
            drive = drive - 1 / (disc * omega**2)
        if sheet.drive.rotating == "nut":
            return 0.0, 0.0 if fixed else math.inf, drive
        far = 1 / (sheet.bearing.far_stiffness or sheet.bearing.stiffness) if fixed else math.inf
        return 1 / sheet.bearing.stiffness, far, drive


def _receptance(
    omega: Array, left: Array, right: Array, slowness: float, rigidity: float, near: Any, far: float
) -> Array:
    """Receptance of a rod at a point with the lengths ``left`` and ``right`` on either side of it.

    Parameters
    ----------
    omega : ndarray
        rad/s.
    left, right : ndarray
        m.
    slowness : float
        1/c of the waves, s/m.
    rigidity : float
        E A or that of the twist, N.
    near, far : float or ndarray
        Receptance of the ends, m/N; infinite for a free far end.

    Returns
    -------
    ndarray
        m/N.
    """
    stiffness = rigidity * slowness * omega
    cosine, sine = np.cos(slowness * omega * left), np.sin(slowness * omega * left)
    travel = near * stiffness * cosine + sine
    force = stiffness * (cosine - near * stiffness * sine)
    cosine, sine = np.cos(slowness * omega * right), np.sin(slowness * omega * right)
    other_travel, other_force = cosine, -stiffness * sine
    if not math.isinf(far):
        other_travel = far * stiffness * cosine + sine
        other_force = stiffness * (cosine - far * stiffness * sine)
    return np.asarray(travel * other_travel / (force * other_travel + other_force * travel))


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
