"""Machines for the tests of the testbed: the three axes, one without losses, runs without control."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.sheet import Bearing, DataSheet, Drive, Guide, Screw, Table
from ballscrew.testbed.integrator import Loop, integrate
from ballscrew.testbed.machine import Constants, Machine, constants

Array = NDArray[np.float64]

RATE = 12800.0
NO_WAVES = np.zeros((0, 4))
OFF = Loop(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, np.inf, 0.0, 0.0, False)


def _axis(
    name: str, nominal: float, root: float, lead: float, length: float, zero: float, k: float, ca: float,
    bearing: float, inertia: float, table: float,
) -> DataSheet:  # fmt: skip
    screw = Screw(lead / 1e3, root / 1e3, nominal / 1e3, length, zero, ca * 1e3, k * 1e6, 0.1, 0.04)
    return DataSheet(
        name, "fixed-free", screw, Bearing(bearing * 1e6), Table(table), Drive(inertia), Guide(25.0)
    )


AXES = {
    "S": _axis("S", 16, 13.2, 5, 0.60, 0.08, 230, 9, 100, 2.2e-5, 12.6),
    "M": _axis("M", 25, 21.4, 10, 0.90, 0.12, 450, 17, 180, 3.0e-4, 101.5),
    "L": _axis("L", 40, 34.4, 20, 1.10, 0.15, 800, 40, 400, 3.3e-3, 154.0),
}


def coupled(sheet: DataSheet, stiffness: float | None) -> DataSheet:
    """The axis with another coupling."""
    return replace(sheet, drive=replace(sheet.drive, coupling_stiffness=stiffness))


def machine(name: str = "M", preload_ratio: float = 0.04, **changes: Any) -> Machine:
    """One of the three, its preload as a part of Ca."""
    sheet = AXES[name]
    return Machine(sheet, preload_ratio * sheet.screw.dynamic_load_rating, **changes)


def lossless(c: Constants) -> Constants:
    """The same without friction and damping."""
    return c._replace(
        structural=0.0, coulomb=0.0, bristle=0.0, viscous=0.0, drag=0.0, motor_viscous=0.0, bed_viscous=0.0
    )


def plain(name: str = "M", place: float = 0.2) -> Constants:
    """One of the three without losses, with its bearing, coupling and bed."""
    return lossless(constants(replace(machine(name), sheet=coupled(AXES[name], 5000.0)), 0.0, place))


def run(
    c: Constants, state: Array, n: int, steps: int = 4, force: float | Array = 0.0
) -> tuple[Array, Array]:
    """Without control, with a force on the motor."""
    pushed = np.zeros((n, 2))
    pushed[:, 0] = force
    return integrate(c, OFF, np.zeros((n, 3)), pushed, NO_WAVES, steps, RATE, state)


def at(place: float, speed: float = 0.0) -> Array:
    """State of a machine that stands, or moves as a whole."""
    state = np.zeros(11)
    state[[0, 1, 3]] = place
    state[[5, 6, 8]] = speed
    return state


def constant_speed(n: int, place: float, speed: float) -> Array:
    """Set-points of a steady motion."""
    wanted = np.zeros((n, 3))
    wanted[:, 0] = place + speed * np.arange(n) / RATE
    wanted[:, 1] = speed
    return wanted
