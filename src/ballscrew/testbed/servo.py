"""The drive: a P-PI cascade with feedforward, the current loop's lag, a dead time, a limit and an encoder."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ballscrew.axis.given import not_negative, positive
from ballscrew.base.errors import InputError, shown
from ballscrew.testbed.integrator import Loop
from ballscrew.testbed.machine import Constants, Machine

_MOST_DEAD = 1000  # samples; the kernel moves all of them on, every sample


@dataclass(frozen=True, slots=True)
class Servo:
    """Settings of a drive.

    Parameters
    ----------
    position_bandwidth, speed_bandwidth : float
        Bandwidths of the two outer loops, Hz.
    integral_time : float
        Integral time of the speed loop, s.
    speed_ahead, mass_ahead : float
        Parts of the speed set-point and of the inertia force that are fed forward.
    lag : float
        Lag of the current loop, s.
    dead_samples : int
        Samples of delay from the controller to the current loop.
    torque_limit : float
        Limit of the torque, N m.
    resolution : float
        Resolution of the motor encoder, referred to the table, m.
    filter_time : float
        Time constant of the filter of the measured speed, s.

    Raises
    ------
    InputError
        If a setting is impossible.
    """

    position_bandwidth: float = 8.0
    speed_bandwidth: float = 40.0
    integral_time: float = 0.02
    speed_ahead: float = 1.0
    mass_ahead: float = 0.5
    lag: float = 2e-4
    dead_samples: int = 1
    torque_limit: float = 1e3
    resolution: float = 5e-8
    filter_time: float = 2e-4

    def __post_init__(self) -> None:
        """Refuse impossible settings."""
        for name in ("position_bandwidth", "speed_bandwidth", "speed_ahead", "mass_ahead", "resolution"):
            not_negative(name, getattr(self, name))
        for name in ("lag", "filter_time"):
            not_negative(name, getattr(self, name), "s")
        positive("integral_time", self.integral_time, "s")
        positive("torque_limit", self.torque_limit, "N m")
        dead = self.dead_samples
        if not isinstance(dead, int) or not 0 <= dead <= _MOST_DEAD:
            raise InputError(f"dead_samples is {shown(dead)}; it must be a whole number, 0 to {_MOST_DEAD}.")


def loop(servo: Servo, machine: Machine, c: Constants) -> Loop:
    """Turn a drive's settings into gains for one machine and load.

    Parameters
    ----------
    servo : Servo
        The settings.
    machine : Machine
        Gives the lead.
    c : Constants
        Gives all that moves, to which the gains are tuned.

    Returns
    -------
    Loop
        Referred to the table.
    """
    mass = c.motor + c.screw + c.table  # the rod stays where it is
    gain = mass * 2 * math.pi * servo.speed_bandwidth
    return Loop(
        position_gain=2 * math.pi * servo.position_bandwidth,
        speed_gain=gain,
        integral_gain=gain / servo.integral_time,
        speed_ahead=servo.speed_ahead,
        mass_ahead=servo.mass_ahead * mass,
        lag=servo.lag,
        dead_samples=servo.dead_samples,
        force_limit=servo.torque_limit / machine.motor_ratio,
        resolution=servo.resolution,
        filter=servo.filter_time,
        on=True,
    )
