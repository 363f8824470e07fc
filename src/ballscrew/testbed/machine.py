"""The machine that is simulated: what the data sheet says, and all that it does not."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.compliance import screw_inertia, screw_mass, transmission_ratio
from ballscrew.axis.given import not_negative, positive
from ballscrew.axis.hertz import preload_deflection
from ballscrew.axis.imitation import warm_screw
from ballscrew.axis.model import kappa
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

_EVENLY: Array = np.empty(0)
_LOST_POINTS = 256  # of a grid that the integrator can look up without a search


@dataclass(frozen=True, slots=True)
class Machine:
    """One axis as it really is.

    Parameters
    ----------
    sheet : DataSheet
        The true values; the data sheet that an analysis is given may say others.
    preload : float
        P, N; 0 where there is none left.
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
    lost : tuple of (float, float)
        Where the screw is worn: axis position, m, and the approach that each flank has lost there beyond
        what ``preload`` and ``backlash`` say, m. Positions ascend; between them it is linear, beyond them
        constant. Empty for a nut that is the same everywhere.

    Raises
    ------
    InputError
        If a number cannot be, a nut has preload and backlash at once, or places do not ascend.
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
    lost: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        """Refuse what no machine is."""
        for name in ("preload", "backlash", "damping_ratio", "bed_damping"):
            not_negative(name, getattr(self, name))
        for name in ("viscous", "drag_ratio", "motor_viscous"):
            not_negative(name, getattr(self, name))
        for name in ("bed_mass", "bed_frequency", "presliding", "stribeck_speed"):
            positive(name, getattr(self, name))
        if not 1 <= self.static_ratio < math.inf:
            raise InputError(
                f"a static_ratio of {self.static_ratio:g} was given; it must be 1 or more, and finite."
            )
        if self.preload > 0 and self.backlash > 0:
            raise InputError(
                f"a preload of {self.preload:g} N and a backlash of {self.backlash:g} m were given; "
                "a nut has backlash only where its preload is 0."
            )
        places = np.array([place for place, _ in self.lost])
        depths = np.array([depth for _, depth in self.lost])
        if not (np.isfinite(depths).all() and np.isfinite(places).all() and (np.diff(places) > 0).all()):
            raise InputError("the lost approach must be finite, at places that are finite and ascend.")

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
    to_zero, length : float
        From the thrust bearing to the nut where the axis reads 0, and to the screw's end, m.
    flank : float
        K_h of one flank of the nut, N/m^1.5.
    pressed : float
        δ₀, by which each flank is pressed, m; below 0 half a backlash.
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
    to_zero: float
    length: float
    flank: float
    pressed: float
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
    beta = transmission_ratio(screw.lead)
    area = math.pi * screw.root_diameter**2 / 4
    polar = math.pi * screw.root_diameter**4 / 32
    turning = screw_inertia(screw.nominal_diameter, screw.length, screw.density) / beta**2
    # Of the screw between motor and nut half turns with either; what hangs beyond turns with the nut.
    near = (middle + screw.bearing_to_zero) / screw.length / 2
    lost, lost_from, lost_step = _even(machine.lost)
    alike = replace(machine, lost=())
    stiffness = sheet.drive.coupling_stiffness
    bearing = 1 / sheet.bearing.stiffness
    bed = (2 * math.pi * machine.bed_frequency) ** 2 * machine.bed_mass
    table = sheet.table.mass + load
    coulomb = sheet.guide.friction
    bristle = coulomb / machine.presliding if coulomb > 0 else 0.0
    tangent = math.sqrt(screw.lead / (math.pi * screw.nominal_diameter))
    return Constants(
        motor=sheet.drive.rotor_inertia / beta**2 + near * turning,
        screw=(1 - near) * turning,
        rod=screw_mass(screw.root_diameter, screw.length, screw.density) / 3,
        table=table,
        bed=machine.bed_mass,
        twist=beta**2 / (polar * screw.shear_modulus),
        coupling=0.0 if stiffness is None else beta**2 / stiffness,
        bearing=bearing,
        shaft=1 / (area * screw.youngs_modulus),
        far_bearing=bearing if sheet.support == "fixed-fixed" else math.inf,
        to_zero=screw.bearing_to_zero,
        length=screw.length,
        flank=machine.hertz,
        pressed=float(alike.pressed(0.0)),
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
    )


def _even(lost: tuple[tuple[float, float], ...]) -> tuple[Array, float, float]:
    """Lost approach on an even grid, the first place and the step; a single place applies everywhere."""
    if not lost:
        return _EVENLY, 0.0, 1.0
    places, depths = (np.array(column) for column in zip(*lost, strict=True))
    grid = np.linspace(places[0], places[-1], _LOST_POINTS)
    step = float(grid[1] - grid[0])
    return np.interp(grid, places, depths), float(grid[0]), step if step > 0 else 1.0


def pressed_more(machine: Machine, growth: float) -> Machine:
    """Copy of a machine with a larger approach of its flanks everywhere.

    Parameters
    ----------
    machine : Machine
        With preload, or with backlash that the growth reduces first.
    growth : float
        Additional approach, m; may be negative.

    Returns
    -------
    Machine
        With the former ``preload``; :meth:`Machine.local_preload` is the new one.
    """
    lost = machine.lost or ((0.0, 0.0),)
    return replace(machine, lost=tuple((place, depth - growth) for place, depth in lost))


def warmed(machine: Machine, difference: float) -> Machine:
    """Copy of a machine whose screw is warmer than its nut, and so presses the balls harder.

    Parameters
    ----------
    machine : Machine
        Machine of uniform temperature.
    difference : float
        Screw less nut, K; a colder screw loses all nominal preload at most.

    Returns
    -------
    Machine
        With the approach that has the P/P₀ of :func:`~ballscrew.axis.imitation.warm_screw`.

    Raises
    ------
    InputError
        If the difference is not finite.
    """
    sheet = machine.sheet
    ratio = 1 + warm_screw(sheet, difference, sheet.screw.nominal_diameter / 2)
    pressed = preload_deflection(sheet.nominal_preload, kappa(sheet))
    return pressed_more(machine, float(pressed * (np.cbrt(ratio) ** 2 - 1)))
