"""Faults of what runs: the machine is measured well, but it is not the machine or the test that was said."""

from __future__ import annotations

import math
from dataclasses import replace

from ballscrew.base.errors import InputError
from ballscrew.testbed.machine import Machine
from ballscrew.testbed.temperature import pressed_more, warmed
from benchmarks.fault_injection.fault import Setup

__all__ = ["greased", "heavier", "overridden", "short_of_the_end", "tempered", "tuned"]

_CONTACT_ANGLE = math.pi / 4
_THINNING = 0.03  # of the grease, a part per kelvin
_CHURNING = 1e6  # 1/m: 0.3 µm of film have 30 % more drag


def overridden(setup: Setup, strength: float) -> Setup:
    """Turn the feed override down by this part; accelerations and dwells stay, as on most controllers."""
    if strength >= 1:
        raise InputError(f"a speed cannot be {strength:g} of itself lower; it must be below 1.")
    return replace(setup, motion=replace(setup.motion, speed=(1 - strength) * setup.motion.speed))


def heavier(setup: Setup, strength: float) -> Setup:
    """Put so many kg more on the table than declared."""
    if setup.load + strength < 0:
        raise InputError(f"there are {setup.load:g} kg on the table; {-strength:g} kg cannot be taken off.")
    return replace(setup, load=setup.load + strength)


def tuned(setup: Setup, strength: float) -> Setup:
    """Multiply the bandwidths of the servo's loops."""
    servo = setup.rig.servo
    servo = replace(
        servo,
        position_bandwidth=strength * servo.position_bandwidth,
        speed_bandwidth=strength * servo.speed_bandwidth,
        integral_time=servo.integral_time / strength,
    )
    return replace(setup, rig=replace(setup.rig, servo=servo))


def short_of_the_end(setup: Setup, strength: float) -> Setup:
    """Let a soft limit end the way this far before the last stop, m; stops beyond it are not driven to."""
    limit = setup.plan.positions[-1] - strength
    reached = tuple(position for position in setup.plan.positions if position < limit)
    if not reached:
        raise InputError(f"a way that ends at {limit:g} m has no stop but its end.")
    return replace(setup, plan=replace(setup.plan, positions=(*reached, limit)))


def tempered(setup: Setup, strength: float, sign: int = 1) -> Setup:
    """Warm the screw by so many kelvins over the nut, and thin the grease; with a sign of −1, cool it."""
    warmer = sign * strength
    machine = warmed(setup.rig.machine, warmer)
    thinner = math.exp(-_THINNING * warmer)
    return _with(
        setup,
        replace(machine, viscous=thinner * machine.viscous, motor_viscous=thinner * machine.motor_viscous),
    )


def greased(setup: Setup, strength: float) -> Setup:
    """Put a film of grease of this thickness, m, between balls and both races, and all its drag."""
    machine = pressed_more(setup.rig.machine, 2 * strength / math.sin(_CONTACT_ANGLE))
    thicker = 1 + _CHURNING * strength
    return _with(
        setup, replace(machine, drag_ratio=thicker * machine.drag_ratio, viscous=thicker * machine.viscous)
    )


def _with(setup: Setup, machine: Machine) -> Setup:
    return replace(setup, rig=replace(setup.rig, machine=machine))
