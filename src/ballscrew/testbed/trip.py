"""One round trip of a machine, as measured by its instruments, and the disturbances that act on it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ballscrew.axis.compliance import transmission_ratio
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.profile import profile, set_points
from ballscrew.testbed.instruments import Instruments, measured
from ballscrew.testbed.integrator import integrate
from ballscrew.testbed.linear import least_steps, standing, structural_damping
from ballscrew.testbed.machine import Constants, Machine, constants
from ballscrew.testbed.servo import Servo, loop

_LOST_WAY = 0.02  # m, off the set-point


@dataclass(frozen=True, slots=True)
class Disturbances:
    """Sizes of torque ripple, ball passing and noise of the current loop.

    Parameters
    ----------
    ripple_orders : tuple of float
        Orders of the ripple, per motor turn.
    ripple : float
        Amplitude of the first order, N m; each following order has two thirds of the previous one.
    ripple_seed : int
        Seed of the ripple's phases, which are a property of the motor and equal in all trips and runs.
    ball_pass_order : float
        Balls that pass per turn of the screw.
    ball_pass : float
        Force on the nut, N.
    torque_noise : float
        White noise of the current loop, N m rms.
    """

    ripple_orders: tuple[float, ...] = (1.0, 6.0, 12.0, 24.0)
    ripple: float = 0.008
    ripple_seed: int = 1
    ball_pass_order: float = 7.31
    ball_pass: float = 0.6
    torque_noise: float = 0.004


@dataclass(frozen=True, slots=True)
class Variation:
    """Variation from trip to trip.

    Parameters
    ----------
    start : float
        Longest further standstill before the first move, s.
    speed : float
        Half-width of the override's error, as a part.
    friction : float
        Standard deviation of the friction, as a part.
    """

    start: float = 0.2
    speed: float = 0.005
    friction: float = 0.05


@dataclass(frozen=True, slots=True)
class Rig:
    """A machine with its drive, disturbances and instruments.

    Parameters
    ----------
    machine, servo, disturbances, instruments, variation
        Parts of the rig.
    sample_rate : float
        Sample rate of the recordings, Hz.
    steps : int
        Steps of the integrator per sample; more are used where the machine is too stiff for them.
    """

    machine: Machine
    servo: Servo = field(default_factory=Servo)
    disturbances: Disturbances = field(default_factory=Disturbances)
    instruments: Instruments = field(default_factory=Instruments)
    variation: Variation = field(default_factory=Variation)
    sample_rate: float = 12800.0
    steps: int = 4


def prepared(machine: Machine, load: float, plan: Plan) -> Constants:
    """Constants of a machine with a load; its springs give the unworn axis its damping ratio."""
    middle = (plan.positions[0] + plan.positions[-1]) / 2
    c = constants(machine, load, middle)
    # Wear reduces the nut's stiffness, not the damping of the other springs.
    preload = machine.preload if machine.preload > 0 else machine.sheet.nominal_preload
    sound = constants(replace(machine, preload=preload, backlash=0.0, lost=()), load, middle)
    return c._replace(structural=structural_damping(sound, middle, machine.damping_ratio))


def simulate_trip(rig: Rig, plan: Plan, motion: Motion, load: float, seed: int) -> dict[str, Array]:
    """Run one round trip and read the instruments.

    Parameters
    ----------
    rig : Rig
        Machine with drive and instruments.
    plan : Plan
        Gives the stops.
    motion : Motion
        Motion of this trip.
    load : float
        Load on the table, kg.
    seed : int
        Seed of the variation from trip to trip; the same seed gives the same trip.

    Returns
    -------
    dict of str to ndarray
        As :func:`~ballscrew.testbed.instruments.measured`.

    Raises
    ------
    InputError
        If the axis does not follow its set-points: no drive moves such a machine.
    """
    random = np.random.default_rng(seed)
    pace = 1 + random.uniform(-1, 1) * rig.variation.speed
    lead = random.uniform(0, rig.variation.start)
    # Faster or slower by the override, which leaves the dwell: speeds by one power, accelerations by two.
    paced = replace(
        motion,
        speed=pace * motion.speed,
        acceleration=pace**2 * motion.acceleration,
        jerk=pace**3 * motion.jerk,
    )
    move = profile(plan, paced)
    n = int((move.duration + lead) * rig.sample_rate)
    points = set_points(move, np.arange(n) / rig.sample_rate - lead)
    wanted = np.stack([points.position, points.speed, points.acceleration], axis=1)
    c = prepared(rig.machine, load, plan)
    rough = max(0.2, 1 + rig.variation.friction * random.standard_normal())
    c = c._replace(coulomb=rough * c.coulomb, breakaway=rough * c.breakaway)
    noise = np.zeros((n, 2))
    size = rig.disturbances.torque_noise / rig.machine.motor_ratio
    noise[:, 0] = random.standard_normal(n) * size
    turning = waves(rig.disturbances, rig.machine, random)
    servo = loop(rig.servo, rig.machine, c)
    steps = max(rig.steps, least_steps(c, plan.positions, rig.sample_rate))
    records, _ = integrate(
        c, servo, wanted, noise, turning, steps, rig.sample_rate, standing(c, plan.positions[0])
    )
    if not (np.isfinite(records).all() and np.abs(records[:, 5] - wanted[:, 0]).max() < _LOST_WAY):
        raise InputError(
            f"with {load:g} kg on the table and a preload of {rig.machine.preload:g} N the simulated axis "
            "does not follow its set-points; give a load, a preload and a backlash that such an axis can "
            "have."
        )
    return measured(rig.instruments, rig.machine, records, rig.sample_rate, random)


def waves(disturbances: Disturbances, machine: Machine, random: np.random.Generator) -> Array:
    """Forces that depend on the motor's angle: its ripple, and the balls that pass in the nut.

    They depend on the actual angle, not on the set-point: a lag of half a millimetre is half a turn of the
    phase of the twelfth order on a lead of 10 mm.

    Parameters
    ----------
    disturbances : Disturbances
        Sizes of the disturbances.
    machine : Machine
        Gives the lead.
    random : Generator
        Generator of the balls' phase: they creep, so it differs from trip to trip.

    Returns
    -------
    ndarray, shape (waves, 4)
        Phase over the motor's way, rad/m, phase at 0, rad, and amplitudes on the motor and between screw
        and nut, referred to the table, N.
    """
    beta, motor_ratio = transmission_ratio(machine.sheet.screw.lead), machine.motor_ratio
    size = disturbances.ripple / motor_ratio
    motor = np.random.default_rng(disturbances.ripple_seed)
    out = []
    for order in disturbances.ripple_orders:
        out.append((order / motor_ratio, motor.uniform(0, 2 * math.pi), size, 0.0))
        size *= 2 / 3
    phase = random.uniform(0, 2 * math.pi)
    out.append((disturbances.ball_pass_order / beta, phase, 0.0, disturbances.ball_pass))
    return np.array(out)
