"""Random axes between a 16 × 5 and a 40 × 20 mm screw, each with a fitting test and a sheet that errs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ballscrew.axis.model import guide_friction
from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Screw, Table
from ballscrew.axis.tolerances import DEFAULT_TOLERANCES
from ballscrew.base.errors import InputError, shown
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.testbed.instruments import Instruments
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.servo import Servo
from ballscrew.testbed.trip import Disturbances, Rig, prepared

__all__ = ["RandomAxis", "random_axis"]

# What axes of three sizes have, at nominal diameters of 16, 25 and 40 mm; between them by powers of the size.
_SIZES = (0.016, 0.025, 0.040)
_KNOTS: dict[str, tuple[float, float, float]] = {
    "root_diameter": (0.0132, 0.0214, 0.0344),
    "length": (0.60, 0.90, 1.10),
    "bearing_to_zero": (0.08, 0.12, 0.15),
    "rigidity": (230e6, 450e6, 800e6),
    "dynamic_load_rating": (9e3, 17e3, 40e3),
    "stiffness": (100e6, 180e6, 400e6),
    "table": (12.6, 60.0, 154.0),
    "load": (8.0, 50.0, 100.0),
    "rotor_inertia": (2.2e-5, 3.0e-4, 3.3e-3),
    "coupling": (1000.0, 5000.0, 20000.0),
    "friction": (8.0, 25.0, 45.0),
}
_WRONG = ("rigidity", "stiffness", "preload_ratio")  # fields of the data sheet that are in error
_LEADS = (0.005, 0.010, 0.020)


@dataclass(frozen=True, slots=True)
class RandomAxis:
    """A random axis with its data sheet, which is in error, and its test.

    Parameters
    ----------
    rig : Rig
        Machine, drive, disturbances and instruments; ``rig.machine.sheet`` holds the true values.
    data_sheet : DataSheet
        The sheet given to the analysis.
    plan : Plan
        The test, with its one load.
    frequency : float
        Axial natural frequency in the middle of the stops, Hz.
    """

    rig: Rig
    data_sheet: DataSheet
    plan: Plan
    frequency: float

    @property
    def load(self) -> float:
        """What lies on the table, kg."""
        return self.plan.masses[0]


def random_axis(seed: int) -> RandomAxis:
    """Sample a random axis.

    Size and lead are sampled first; all else follows the size with some scatter. K, k_b and P₀ of the data
    sheet are in error within the makers' tolerances of :data:`ballscrew.axis.tolerances.DEFAULT_TOLERANCES`.

    Parameters
    ----------
    seed : int
        Decides everything; 0 or more.

    Returns
    -------
    RandomAxis
        With damping of 1.5 to 5 %, jerk of 600 to 2500 m/s³, and a pitching mode at 1.4 to 2.2 times the
        axial natural frequency.

    Raises
    ------
    InputError
        If the seed is not a whole number from 0 on.
    """
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise InputError(f"a seed of {shown(seed)} was given; it must be a whole number, 0 or more.")
    random = np.random.default_rng([seed, 0xBA11])
    sheet, load = _sample_sheet(random, f"axis {seed}")
    machine = _machine(random, sheet)
    plan, frequency = _test(random, machine, sheet, load)
    return RandomAxis(_rig(random, machine, frequency, seed), sheet, plan, frequency)


def _sample_sheet(random: np.random.Generator, name: str) -> tuple[DataSheet, float]:
    size = _SIZES[0] * (_SIZES[-1] / _SIZES[0]) ** random.uniform()
    typical = {key: _interpolate(size, knots) for key, knots in _KNOTS.items()}
    # The lead of the size's own axis, give or take one: nobody sells 20 mm on the smallest screw.
    lead = min(_LEADS, key=lambda lead: abs(math.log(lead / (0.4 * size * random.uniform(0.7, 1.4)))))
    screw = Screw(
        lead=lead,
        root_diameter=typical["root_diameter"],
        nominal_diameter=size,
        length=typical["length"] * random.uniform(0.85, 1.2),
        bearing_to_zero=typical["bearing_to_zero"] * random.uniform(0.8, 1.2),
        dynamic_load_rating=typical["dynamic_load_rating"],
        rigidity=typical["rigidity"],
        rigidity_preload_ratio=0.10,
        preload_ratio=random.uniform(0.03, 0.06),
    )
    sheet = DataSheet(
        name=name,
        support=str(random.choice(["fixed-free", "fixed-supported"])),
        screw=screw,
        bearing=Bearing(typical["stiffness"]),
        table=Table(typical["table"] * random.uniform(0.75, 1.3)),
        drive=Drive(
            typical["rotor_inertia"] * random.uniform(0.8, 1.3),
            coupling_stiffness=typical["coupling"] * random.uniform(0.7, 1.5),
        ),
        guide=Guide(typical["friction"] * random.uniform(0.7, 1.3)),
        source=f"the data sheet of {name}",
    )
    return sheet, round(typical["load"] * random.uniform(0.4, 1.5), 1)


def _interpolate(size: float, knots: tuple[float, float, float]) -> float:
    return float(np.exp(np.interp(math.log(size), np.log(_SIZES), np.log(knots))))


def _machine(random: np.random.Generator, sheet: DataSheet) -> Machine:
    off = {field: 1 + DEFAULT_TOLERANCES[field] * random.uniform(-1, 1) for field in _WRONG}
    screw = sheet.screw
    true_sheet = replace(
        sheet,
        screw=replace(
            screw,
            rigidity=screw.rigidity * off["rigidity"],
            preload_ratio=screw.preload_ratio * off["preload_ratio"],
        ),
        bearing=Bearing(sheet.bearing.stiffness * off["stiffness"]),
        source=f"the true values of {sheet.name}",
    )
    friction = float(guide_friction(sheet, 0.0))
    return Machine(
        sheet=true_sheet,
        preload=true_sheet.nominal_preload,
        damping_ratio=random.uniform(0.015, 0.05),
        bed_mass=sheet.table.mass * random.uniform(12, 25),
        bed_frequency=random.uniform(18, 35),
        bed_damping=random.uniform(0.03, 0.08),
        viscous=friction * random.uniform(3, 7),
        static_ratio=random.uniform(1.1, 1.5),
        presliding=random.uniform(2e-6, 8e-6),
        stribeck_speed=random.uniform(1e-3, 4e-3),
        drag_ratio=random.uniform(0.7, 1.4),
        motor_viscous=friction * random.uniform(1.5, 4),
    )


def _test(random: np.random.Generator, machine: Machine, sheet: DataSheet, load: float) -> tuple[Plan, float]:
    """Stops over most of the travel, and a motion whose nut load stays below the preload."""
    travel = 0.9 * sheet.travel_limit * random.uniform(0.7, 0.95)
    count = int(random.integers(6, 12))
    # To the millimetre, as people write plans.
    positions = tuple(round(travel * index / (count - 1), 3) for index in range(count))
    gap = min(b - a for a, b in pairwise(positions))
    still = Motion(speed=0.1, acceleration=1.0, jerk=1000.0, dwell=0.3)
    plan = Plan(positions, 3, (load,), (still,), source=f"the plan of {sheet.name}")
    frequency = true_frequency(prepared(machine, load, plan), (positions[0] + positions[-1]) / 2)
    jerk = random.uniform(600, 2500)
    # M a + F_f below the preload, also where it is 15 % less than the sheet says; and the jerk time below
    # half a period, or the first null of the pulse lies at the mode.
    most = (0.85 * sheet.nominal_preload - float(guide_friction(sheet, load))) / (sheet.table.mass + load)
    acceleration = min(most, jerk / (2 * frequency)) * random.uniform(0.75, 0.98)
    rise = acceleration / jerk
    # Both ramps fit between two stops: v (v/a + t_j) = gap; above a t_j the acceleration is reached.
    fastest = (-rise + math.sqrt(rise**2 + 4 * gap / acceleration)) * acceleration / 2
    speed = max(min(fastest * random.uniform(0.45, 0.85), 0.3), 1.2 * acceleration * rise)
    motion = Motion(speed, acceleration, jerk, dwell=round(random.uniform(0.30, 0.45), 3))
    return replace(plan, motions=(motion,)), frequency


def _rig(random: np.random.Generator, machine: Machine, frequency: float, seed: int) -> Rig:
    screw = machine.sheet.screw
    # Torques against those of the 25 × 10 mm axis at 680 N, for which the defaults are.
    scale = screw.lead * machine.preload / (0.010 * 680.0)
    speed_loop = random.uniform(22, 45)
    return Rig(
        machine,
        servo=Servo(
            position_bandwidth=speed_loop * random.uniform(0.14, 0.22),
            speed_bandwidth=speed_loop,
            integral_time=5 / (2 * math.pi * speed_loop) * random.uniform(0.9, 1.6),
            speed_ahead=random.uniform(0.9, 1.0),
            mass_ahead=random.uniform(0.3, 0.9),
            lag=random.uniform(1.5e-4, 3e-4),
        ),
        disturbances=Disturbances(
            ripple=0.008 * scale * random.uniform(0.5, 1.5),
            ripple_seed=seed,
            ball_pass_order=random.uniform(5.5, 9.5),
            ball_pass=0.6 * machine.preload / 680.0 * random.uniform(0.5, 1.5),
            torque_noise=0.004 * scale * random.uniform(0.6, 1.4),
        ),
        instruments=Instruments(
            torque_noise=0.002 * scale,
            torque_resolution=5e-4 * scale,
            acceleration_noise=0.02 * random.uniform(1.0, 1.5),
            pitch_frequency=frequency * random.uniform(1.4, 2.2),
            pitch_damping=random.uniform(0.015, 0.05),
            pitch=(random.uniform(0.05, 0.2), -random.uniform(0.05, 0.2)),
            torque_delay=random.uniform(0, 1) / 12800.0,
        ),
    )
