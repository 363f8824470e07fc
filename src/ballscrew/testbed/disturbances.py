"""What pushes the machine besides its servo: torque ripple, ball passing, noise of the current loop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballscrew.axis.compliance import transmission_ratio
from ballscrew.base.arrays import Array
from ballscrew.testbed.machine import Machine

__all__ = ["Disturbances", "noise_forces", "waves"]


@dataclass(frozen=True, slots=True)
class Disturbances:
    """Sizes of the disturbances.

    Parameters
    ----------
    ripple_orders : tuple of float
        Per motor turn.
    ripple : float
        Of the largest, N m; each following one has two thirds of it.
    ripple_seed : int
        Of the ripple's phases. They are the motor's: a rotor cogs where it cogs, in every trip and every run.
    ball_pass_order : float
        Balls that pass per turn of the screw.
    ball_pass : float
        Force on the nut, N.
    torque_noise : float
        White, of the current loop, N m rms.
    """

    ripple_orders: tuple[float, ...] = (1.0, 6.0, 12.0, 24.0)
    ripple: float = 0.008
    ripple_seed: int = 1
    ball_pass_order: float = 7.31
    ball_pass: float = 0.6
    torque_noise: float = 0.004


def noise_forces(
    disturbances: Disturbances, machine: Machine, count: int, random: np.random.Generator
) -> Array:
    """Forces that nothing foretells.

    Parameters
    ----------
    disturbances : Disturbances
        Their sizes.
    machine : Machine
        Gives the lead.
    count : int
        n, samples.
    random : Generator
        Of the noise.

    Returns
    -------
    ndarray, shape (n, 2)
        On motor and nut, referred to the table, N.
    """
    motor = random.standard_normal(count) * (disturbances.torque_noise / _lead(machine))
    return np.stack([motor, np.zeros(count)], axis=1)


def waves(disturbances: Disturbances, machine: Machine, random: np.random.Generator) -> Array:
    """Forces that go with the motor's angle: its ripple, and the balls that pass in the nut.

    They push where the motor is, and not where it should be: half a millimetre that it lags behind is half a
    turn of the phase of the twelfth order on a lead of 10 mm.

    Parameters
    ----------
    disturbances : Disturbances
        Their sizes.
    machine : Machine
        Gives the lead.
    random : Generator
        Of the balls' phase: they creep, and lie elsewhere in every trip.

    Returns
    -------
    ndarray, shape (waves, 4)
        Of each its phase over the motor's way, rad/m, and where that is 0, rad; its size on the motor and
        between screw and nut, referred to the table, N.
    """
    beta = _lead(machine)
    size = disturbances.ripple / beta
    motor = np.random.default_rng(disturbances.ripple_seed)
    out = []
    for order in disturbances.ripple_orders:
        out.append((order / beta, motor.uniform(0, 2 * math.pi), size, 0.0))
        size *= 2 / 3
    phase = random.uniform(0, 2 * math.pi)
    out.append((disturbances.ball_pass_order / beta, phase, 0.0, disturbances.ball_pass))
    return np.array(out)


def _lead(machine: Machine) -> float:
    return transmission_ratio(machine.sheet.screw.lead)
