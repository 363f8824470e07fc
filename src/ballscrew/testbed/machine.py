"""The machine that is simulated: what the data sheet says, and all that it does not."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.compliance import screw_inertia, screw_mass, transmission_ratio
from ballscrew.axis.given import not_negative, positive
from ballscrew.axis.model import guide_friction, kappa
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

GRAVITY = 9.80665
"""Acceleration of gravity, m/s²."""

_EVENLY: Array = np.empty(0)
_LOST_POINTS = 256  # of a grid that the integrator can look up without a search
_NOT_NEGATIVE = (
    "preload", "backlash", "damping_ratio", "bed_damping", "viscous", "drag_ratio", "motor_viscous",
    "oil_film", "pitch_frequency", "pitch_damping", "pitch_share",
)  # fmt: skip
_POSITIVE = ("bed_mass", "bed_frequency", "presliding", "stribeck_speed", "bearing_preload_ratio")


@dataclass(frozen=True, slots=True)
class Machine:
    """One axis as it really is.

    Parameters
    ----------
    sheet : DataSheet
        The true values; the data sheet that an analysis is given may say others.
    preload : float
        P, N, up to the dynamic load rating; 0 where there is none left.
    backlash : float
        Clearance once the preload is gone, m.
    damping_ratio : float
        Of the axial mode; every spring has its part, in proportion to its stiffness.
    bed_mass, bed_frequency, bed_damping : float
        Of the bed on its mounts, kg, Hz and ratio.
    viscous : float
        Of the guide, N s/m.
    static_ratio : float
        Breakaway over Coulomb friction.
    presliding : float
        Way in which the guide's friction builds up, m.
    stribeck_speed : float
        m/s.
    drag_ratio : float
        Drag torque of the nut over the JIS form's.
    motor_viscous : float
        Of motor and bearings, referred to the table, N s/m.
    bearing_preload : float
        P_b of the support bearing when new, N: two Hertz flanks, softer under load as the nut is. Infinite
        for a stiffness that does not depend on the load.
    bearing_preload_ratio : float
        P_b over its new value; the bearing's stiffness is proportional to its cube root.
    pretension : float
        Tension of a fixed-fixed screw at rest, N: each end pulls only, and carries nothing where it has lost
        its tension. Infinite for ends that pull and push.
    oil_film : float
        Thickness of the oil film in each contact of the nut's balls at 0.1 m/s, m.
    pitch_frequency, pitch_damping : float
        Frequency and damping ratio of the pitching mode of the table, Hz; 0 Hz for none.
    pitch_share : float
        Part of the mass on the guide that the pitching mode moves along the axis.
    lost : tuple of (float, float)
        Where the screw is worn: axis position, m, and the approach that each flank has lost there beyond
        what ``preload`` and ``backlash`` say, m. Positions ascend; between them it is linear, beyond them
        constant. Empty for a nut that is the same everywhere.

    Raises
    ------
    InputError
        If a number cannot be, a nut has preload and backlash at once or more preload than its dynamic load
        rating, or places do not ascend.
    """

    sheet: DataSheet
    preload: float
    backlash: float = 0.0
    damping_ratio: float = 0.03
    bed_mass: float = 1500.0
    bed_frequency: float = 28.0
    bed_damping: float = 0.05
    viscous: float = 120.0
    static_ratio: float = 1.25
    presliding: float = 4e-6
    stribeck_speed: float = 2e-3
    drag_ratio: float = 1.0
    motor_viscous: float = 60.0
    bearing_preload: float = math.inf
    bearing_preload_ratio: float = 1.0
    pretension: float = math.inf
    oil_film: float = 0.0
    pitch_frequency: float = 0.0
    pitch_damping: float = 0.03
    pitch_share: float = 0.0
    lost: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        """Refuse what no machine is."""
        for name in _NOT_NEGATIVE:
            not_negative(name, getattr(self, name))
        for name in _POSITIVE:
            positive(name, getattr(self, name))
        if not 1 <= self.static_ratio < math.inf:
            raise InputError(
                f"a static_ratio of {self.static_ratio:g} was given; it must be 1 or more, and finite."
            )
        if self.pitch_share >= 1:
            raise InputError(
                f"a pitch_share of {self.pitch_share:g} was given; it must be less than 1, the whole mass."
            )
        _check_preload(self)
        _check_support(self)
        _check_lost(self.lost)

    @property
    def motor_ratio(self) -> float:
        """Travel per angle of the motor, m/rad."""
        return transmission_ratio(self.sheet.screw.lead) / self.sheet.drive.ratio

    @property
    def hertz(self) -> float:
        """K_h of one flank of the nut, N/m^1.5."""
        return float((kappa(self.sheet) / 3) ** 1.5)

    def pressed(self, position: ArrayLike) -> Array:
        """δ₀ at axis positions: by which each flank is pressed, m; below 0 half a backlash."""
        alike = (self.preload / self.hertz) ** (2 / 3) if self.preload > 0 else -self.backlash / 2
        places = np.asarray(position, dtype=np.float64)
        if not self.lost:
            return np.full(places.shape, alike)
        known = np.array(self.lost)
        return np.asarray(alike - np.interp(places, known[:, 0], known[:, 1]))

    def local_preload(self, position: ArrayLike) -> Array:
        """Preload at axis positions, N."""
        return np.asarray(self.hertz * np.maximum(self.pressed(position), 0.0) ** 1.5)

    def local_backlash(self, position: ArrayLike) -> Array:
        """Backlash at axis positions, m."""
        return np.asarray(2 * np.maximum(-self.pressed(position), 0.0))


def _check_preload(machine: Machine) -> None:
    if machine.preload > 0 and machine.backlash > 0:
        raise InputError(
            f"a preload of {machine.preload:g} N and a backlash of {machine.backlash:g} m were given; "
            "a nut has backlash only where its preload is 0."
        )
    rating = machine.sheet.screw.dynamic_load_rating
    if machine.preload > rating:
        raise InputError(
            f"a preload of {machine.preload:g} N was given; it must be at most the dynamic load rating "
            f"of the data sheet, {rating:g} N."
        )


def _check_support(machine: Machine) -> None:
    if not machine.bearing_preload > 0 or not machine.pretension >= 0:
        raise InputError("bearing_preload must be above 0, and pretension 0 or more.")
    if machine.pretension < math.inf and machine.sheet.support != "fixed-fixed":
        raise InputError(f"a pretension was given; the support is {machine.sheet.support}.")


def _check_lost(lost: tuple[tuple[float, float], ...]) -> None:
    places = np.array([place for place, _ in lost])
    depths = np.array([depth for _, depth in lost])
    if not (np.isfinite(depths).all() and np.isfinite(places).all() and (np.diff(places) > 0).all()):
        raise InputError("the lost approach must be finite, at places that are finite and ascend.")


class Constants(NamedTuple):
    """Constants of a machine and a load for the integrator, in SI, referred to the table.

    Parameters
    ----------
    motor, screw, rod, table, bed : float
        Inertias: motor with its part of the screw's turning, the rest of that, the screw along its axis,
        table and load, bed, kg.
    twist : float
        Compliance of the shaft's torsion per length, 1/N.
    coupling : float
        Compliance of the coupling, m/N.
    bearing : float
        Compliance of the thrust bearing, m/N.
    shaft : float
        Compliance of the shaft's tension per length, 1/N.
    far_bearing : float
        Compliance of the bearing at the far end, m/N; infinite where that end carries no thrust.
    bearing_preload : float
        P_b of either, N; infinite for compliances that do not depend on the load.
    pretension : float
        Tension of a screw between two bearings that pull only, N; infinite for bearings that also push.
    to_zero, length : float
        From the thrust bearing to the nut where the axis reads 0, and to the screw's end, m.
    flank : float
        K_h of one flank of the nut, N/m^1.5.
    pressed : float
        δ₀, by which each flank is pressed, m; below 0 half a backlash.
    film : float
        By which the oil presses each flank more at 0.1 m/s, m.
    lost : ndarray
        What each flank has lost of it at places of an even grid, m; empty where it is the same everywhere.
    lost_from, lost_step : float
        First place of that grid and the way to the next, m.
    bed_stiffness, bed_viscous : float
        Of the bed's mounts, N/m and N s/m.
    structural : float
        Damping of each spring over its stiffness, s.
    coulomb, breakaway : float
        Friction of the guide sliding and at rest, N.
    stribeck : float
        Speed at which one becomes the other, m/s.
    bristle, bristle_damping : float
        σ₀ and σ₁ of the guide's friction, N/m and N s/m; σ₀ = 0 for none.
    viscous : float
        σ₂ of the guide, N s/m.
    drag : float
        Of the preloaded nut where nothing is lost, N.
    motor_viscous : float
        N s/m.
    gravity : float
        Weight of table and load along the axis with its counterbalance, N; positive where it pushes towards
        larger positions.
    pitch_mass : float
        Part of ``table`` that the pitching mode moves, kg.
    pitch_stiffness, pitch_viscous : float
        Of that mode, N/m and N s/m.
    """

    motor: float
    screw: float
    rod: float
    table: float
    bed: float
    twist: float
    coupling: float
    bearing: float
    shaft: float
    far_bearing: float
    bearing_preload: float
    pretension: float
    to_zero: float
    length: float
    flank: float
    pressed: float
    film: float
    lost: Array
    lost_from: float
    lost_step: float
    bed_stiffness: float
    bed_viscous: float
    structural: float
    coulomb: float
    breakaway: float
    stribeck: float
    bristle: float
    bristle_damping: float
    viscous: float
    drag: float
    motor_viscous: float
    gravity: float
    pitch_mass: float
    pitch_stiffness: float
    pitch_viscous: float


def constants(machine: Machine, load: float, middle: float) -> Constants:
    """Turn a machine into the numbers of its equations of motion.

    Parameters
    ----------
    machine : Machine
        The machine.
    load : float
        What lies on the table, kg.
    middle : float
        Axis position about which the screw's own inertia is parted between its two ends, m.

    Returns
    -------
    Constants
        With stiffnesses as compliances per length, so that they follow the table; without structural damping.

    Raises
    ------
    InputError
        If the load is negative, or the position not on the screw.
    """
    not_negative("load", load, "kg")
    sheet, screw = machine.sheet, machine.sheet.screw
    low, high = -screw.bearing_to_zero, sheet.travel_limit
    if not low <= middle <= high:
        raise InputError(
            f"a position of {middle:g} was given; it must be between {low:g} and {high:g} m, on the screw."
        )
    drive = sheet.drive
    if drive.rotating != "screw":
        raise InputError("the testbed simulates screws that rotate, not nuts.")
    beta = transmission_ratio(screw.lead)
    area = math.pi * screw.root_diameter**2 / 4
    polar = math.pi * screw.root_diameter**4 / 32
    turning = screw_inertia(screw.nominal_diameter, screw.length, screw.density) / beta**2
    # Of the screw between motor and nut half turns with either; what hangs beyond turns with the nut.
    near = (middle + screw.bearing_to_zero) / screw.length / 2
    lost, lost_from, lost_step = _even(machine.lost)
    alike = replace(machine, lost=())
    couplings = [k for k in (drive.coupling_stiffness, drive.belt_stiffness) if k is not None]
    loss = machine.bearing_preload_ratio
    bearing = 1 / (sheet.bearing.stiffness * loss ** (1 / 3))
    far_bearing = math.inf
    if sheet.support == "fixed-fixed":
        far_bearing = 1 / ((sheet.bearing.far_stiffness or sheet.bearing.stiffness) * loss ** (1 / 3))
    bed = (2 * math.pi * machine.bed_frequency) ** 2 * machine.bed_mass
    table = sheet.table.mass + load
    coulomb = float(guide_friction(sheet, load))
    bristle = coulomb / machine.presliding if coulomb > 0 else 0.0
    tangent = math.sqrt(screw.lead / (math.pi * screw.nominal_diameter))
    pitch_mass = machine.pitch_share * table if machine.pitch_frequency > 0 else 0.0
    pitching = 2 * math.pi * machine.pitch_frequency
    return Constants(
        motor=drive.rotor_inertia / machine.motor_ratio**2 + near * turning,
        screw=(1 - near) * turning,
        rod=screw_mass(screw.root_diameter, screw.length, screw.density) / 3,
        table=table,
        bed=machine.bed_mass,
        twist=beta**2 / (polar * screw.shear_modulus),
        coupling=float(sum(beta**2 / stiffness for stiffness in couplings)),
        bearing=bearing,
        shaft=1 / (area * screw.youngs_modulus),
        far_bearing=far_bearing,
        bearing_preload=loss * machine.bearing_preload,
        pretension=machine.pretension,
        to_zero=screw.bearing_to_zero,
        length=screw.length,
        flank=machine.hertz,
        pressed=float(alike.pressed(0.0)),
        film=2 * math.sqrt(2) * machine.oil_film,  # two contacts of each ball, at 45°
        lost=lost,
        lost_from=lost_from,
        lost_step=lost_step,
        bed_stiffness=bed,
        bed_viscous=2 * machine.bed_damping * math.sqrt(bed * machine.bed_mass),
        structural=0.0,
        coulomb=coulomb,
        breakaway=machine.static_ratio * coulomb,
        stribeck=machine.stribeck_speed,
        bristle=bristle,
        bristle_damping=0.3 * 2 * math.sqrt(bristle * table),
        viscous=machine.viscous,
        drag=machine.drag_ratio * 0.05 / tangent * machine.preload,
        motor_viscous=machine.motor_viscous,
        gravity=_gravity(sheet, table),
        pitch_mass=pitch_mass,
        pitch_stiffness=pitching**2 * pitch_mass,
        pitch_viscous=2 * machine.pitch_damping * pitching * pitch_mass,
    )


def _gravity(sheet: DataSheet, mass: float) -> float:
    """Weight along the axis less its counterbalance, N, positive towards larger positions."""
    down = mass * GRAVITY * math.sin(sheet.inclination) - sheet.table.counterbalance
    return down if sheet.positive == "down" else -down


def _even(lost: tuple[tuple[float, float], ...]) -> tuple[Array, float, float]:
    """Lost approach on an even grid, the first place and the step; a single place applies everywhere."""
    if not lost:
        return _EVENLY, 0.0, 1.0
    places, depths = (np.array(column) for column in zip(*lost, strict=True))
    grid = np.linspace(places[0], places[-1], _LOST_POINTS)
    step = float(grid[1] - grid[0])
    return np.interp(grid, places, depths), float(grid[0]), step if step > 0 else 1.0
