"""One round trip of a machine, as its instruments tell it, with the truth beside."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import Motion, Plan
from ballscrew.fcft.profile import profile, set_points
from ballscrew.testbed.disturbances import Disturbances, noise_forces, waves
from ballscrew.testbed.instruments import Instruments, measured
from ballscrew.testbed.integrator import integrate
from ballscrew.testbed.linear import least_steps, structural_damping
from ballscrew.testbed.machine import Constants, Machine, constants
from ballscrew.testbed.servo import Servo, loop

__all__ = ["Rig", "Variation", "prepared", "simulate_trip"]


_LOST_WAY = 0.02  # m, off the set-point


@dataclass(frozen=True, slots=True)
class Variation:
    """How trips differ from one another, as real ones do.

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
        Its parts.
    sample_rate : float
        Hz.
    steps : int
        Of the integrator, a sample; more are taken where the machine is so stiff that it needs them.
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
    # Wear takes from the nut's stiffness, not from what damps the other springs: they keep what they had new.
    preload = machine.preload if machine.preload > 0 else machine.sheet.nominal_preload
    sound = constants(replace(machine, preload=preload, backlash=0.0, lost=()), load, middle)
    return c._replace(structural=structural_damping(sound, middle, machine.damping_ratio))


def simulate_trip(rig: Rig, plan: Plan, motion: Motion, load: float, seed: int) -> dict[str, Array]:
    """Run one round trip and read the instruments.

    Parameters
    ----------
    rig : Rig
        What runs.
    plan : Plan
        Gives the stops.
    motion : Motion
        As this trip runs it.
    load : float
        What lies on the table, kg.
    seed : int
        Of all that differs from trip to trip; the same seed gives the same trip.

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
    move = profile(plan, motion)
    # One way, faster or slower by the override: speeds by one power of it, accelerations by two.
    n = int((move.duration / pace + lead) * rig.sample_rate)
    points = set_points(move, (np.arange(n) / rig.sample_rate - lead) * pace)
    wanted = np.stack([points.position, pace * points.speed, pace**2 * points.acceleration], axis=1)
    c = prepared(rig.machine, load, plan)
    rough = max(0.2, 1 + rig.variation.friction * random.standard_normal())
    c = c._replace(coulomb=rough * c.coulomb, breakaway=rough * c.breakaway)
    noise = noise_forces(rig.disturbances, rig.machine, len(wanted), random)
    turning = waves(rig.disturbances, rig.machine, random)
    state = np.zeros(11)
    state[[0, 1, 3]] = plan.positions[0]
    servo = loop(rig.servo, rig.machine, c)
    steps = max(rig.steps, least_steps(c, plan.positions, rig.sample_rate))
    records, _ = integrate(c, servo, wanted, noise, turning, steps, rig.sample_rate, state)
    if not (np.isfinite(records).all() and np.abs(records[:, 5] - wanted[:, 0]).max() < _LOST_WAY):
        raise InputError(
            f"with {load:g} kg on the table and a preload of {rig.machine.preload:g} N the simulated axis "
            "does not follow its set-points; give a load, a preload and a backlash that such an axis can "
            "have."
        )
    return measured(rig.instruments, rig.machine, records, rig.sample_rate, random)
