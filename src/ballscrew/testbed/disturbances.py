"""What pushes the machine besides its servo: torque ripple, ball passing, noise of the current loop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.compliance import transmission_ratio
from ballscrew.testbed.machine import Machine

__all__ = ["Disturbances", "disturbance_forces"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Disturbances:
    """Sizes of the disturbances.

    Parameters
    ----------
    ripple_orders : tuple of float
        Per motor turn.
    ripple : float
        Of the largest, N m; each following one has two thirds of it.
    ball_pass_order : float
        Balls that pass per turn of the screw.
    ball_pass : float
        Force on the nut, N.
    torque_noise : float
        White, of the current loop, N m rms.
    """

    ripple_orders: tuple[float, ...] = (1.0, 6.0, 12.0, 24.0)
    ripple: float = 0.008
    ball_pass_order: float = 7.31
    ball_pass: float = 0.6
    torque_noise: float = 0.004


def disturbance_forces(
    disturbances: Disturbances, machine: Machine, position: Array, random: np.random.Generator
) -> Array:
    """Forces on motor and nut along a wanted motion.

    The motor follows its set-points to some micrometres, thousandths of a turn, so its angle is taken from
    them.

    Parameters
    ----------
    disturbances : Disturbances
        Their sizes.
    machine : Machine
        Gives the lead.
    position : ndarray, shape (n,)
        Wanted, m.
    random : Generator
        Of the phases, which differ from trip to trip, and of the noise.

    Returns
    -------
    ndarray, shape (n, 2)
        Referred to the table, N.
    """
    beta = transmission_ratio(machine.sheet.screw.lead)
    angle = position / beta
    motor = random.standard_normal(len(position)) * (disturbances.torque_noise / beta)
    size = disturbances.ripple / beta
    for order in disturbances.ripple_orders:
        motor += size * np.sin(order * angle + random.uniform(0, 2 * math.pi))
        size *= 2 / 3
    phase = random.uniform(0, 2 * math.pi)
    nut = disturbances.ball_pass * np.sin(disturbances.ball_pass_order * angle + phase)
    return np.stack([motor, nut], axis=1)
