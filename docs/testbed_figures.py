"""Draws the picture of the page *Is the testbed right?*.

Usage: python -m docs.testbed_figures [FOLDER]

FOLDER is docs/_static where it is not given. All that is drawn is computed here with the package's own parts.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from benchmarks.testbed import NO_WAVES, OFF, potential

from ballscrew.axis.compliance import nut_kappa
from ballscrew.axis.hertz import RELEASE, nut_deflection, tangent_ratio
from ballscrew.report.canvas import blank, save_figure, styled
from ballscrew.testbed.example import AXIS
from ballscrew.testbed.forces import nut_force
from ballscrew.testbed.integrator import integrate
from ballscrew.testbed.linear import structural_damping
from ballscrew.testbed.machine import Machine, constants
from ballscrew.testbed.servo import Servo, loop

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RATE = 12800.0
BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"
# The axis of the page "The machine and the test": a rigid coupling, table and nut of 101.5 kg.
SHEET = replace(
    AXIS, table=replace(AXIS.table, mass=101.5), drive=replace(AXIS.drive, coupling_stiffness=None)
)
P = SHEET.nominal_preload


def lossless():
    """Constants without friction and damping."""
    return constants(Machine(SHEET, P), 0.0, 0.2)._replace(
        coulomb=0.0, bristle=0.0, viscous=0.0, drag=0.0, motor_viscous=0.0, bed_viscous=0.0
    )


def nut(axes: Axes) -> None:
    """The nut's tangent over its load."""
    c = lossless()
    screw = SHEET.screw
    kappa = nut_kappa(screw.rigidity, screw.dynamic_load_rating, screw.rigidity_preload_ratio)
    ratio = np.linspace(0, 8, 401)
    axes.plot(ratio, tangent_ratio(ratio * P, P), color=BLUE, label="theory")
    some = np.linspace(0, 8, 33)
    at = [nut_force(float(d), c.flank, c.pressed)[1] for d in nut_deflection(some * P, P, kappa)]
    axes.plot(
        some, np.array(at) / nut_force(0.0, c.flank, c.pressed)[1], "o", ms=4, color=ORANGE, label="kernel"
    )
    axes.axvline(RELEASE, color="0.5", lw=0.8, ls=":")
    axes.annotate("2.83", (RELEASE, 1.0), xytext=(4, 0), textcoords="offset points", color="0.4")
    axes.set(
        xlabel="nut load F over preload P",
        ylabel="rigidity k(F)/k(0)",
        title="Rigidity of the nut under load",
    )
    axes.legend(loc="lower right")


def energy(axes: Axes) -> None:
    """Energy of a swinging machine without losses."""
    c = lossless()
    inertia = np.array([c.motor, c.screw, c.rod, c.table, c.bed])
    both = c.motor + c.screw
    swinging = 0.5 * both * c.table / (both + c.table) * 0.06**2
    for steps, colour in ((4, ORANGE), (8, BLUE), (16, GREEN)):
        state = np.zeros(11)
        state[[0, 1, 3]] = 0.2
        state[[5, 6, 8]] = 0.1
        state[8] += 0.06
        energies = []
        for _ in range(2560):
            energies.append(0.5 * inertia @ state[5:10] ** 2 + potential(c, *state[:5]))
            _, state = integrate(c, OFF, np.zeros((1, 3)), np.zeros((1, 2)), NO_WAVES, steps, RATE, state)
        gained = 100 * (np.array(energies) - energies[0]) / swinging
        axes.plot(1e3 * np.arange(2560) / RATE, gained, color=colour, lw=0.7, label=f"{steps} steps")
    axes.set(xlabel="time (ms)", ylabel="energy error (% of the vibration)", title="Energy without losses")
    axes.set_ylim(-1.6, 1.3)
    axes.legend(loc="lower right", ncols=3)


def shaken(bandwidth: float):
    """Torque and acceleration of the closed loop, shaken by a white torque."""
    c = constants(Machine(SHEET, P, bed_mass=1e8, bed_frequency=0.1), 0.0, 0.0)
    c = c._replace(coulomb=0.0, bristle=0.0, drag=0.0)
    c = c._replace(structural=structural_damping(c, 0.0, 0.02))
    servo = loop(Servo(speed_bandwidth=bandwidth, resolution=0.0), Machine(SHEET, P), c)
    n = 100 * 12800
    pushed = np.zeros((n, 2))
    pushed[:, 0] = 20 * np.random.default_rng(1).standard_normal(n)
    records, _ = integrate(c, servo, np.zeros((n, 3)), pushed, NO_WAVES, 4, RATE, np.zeros(11))
    parts = [
        np.fft.rfft(x.reshape(-1, 12800) * np.hanning(12800))
        for x in (records[:, 0] + pushed[:, 0], records[:, 1])
    ]
    u, y = parts
    return np.abs((u.conj() * y).sum(0) / (np.abs(u) ** 2).sum(0)), np.sqrt((np.abs(y) ** 2).mean(0))


def poles(transfer: Axes, response: Axes) -> None:
    """FRF and response under two servo settings."""
    near = np.arange(100, 261)
    for bandwidth, colour, style in ((10.0, BLUE, "-"), (150.0, ORANGE, "--")):
        h, own = shaken(bandwidth)
        label = f"velocity loop {bandwidth:.0f} Hz"
        transfer.semilogy(near, h[near], color=colour, ls=style, label=label)
        response.semilogy(near, own[near] / own[near].max(), color=colour, ls=style, label=label)
    transfer.set(
        xlabel="frequency (Hz)", ylabel="acceleration per force (1/kg)", title="FRF: independent of the servo"
    )
    response.set(
        xlabel="frequency (Hz)", ylabel="acceleration over its peak", title="Response: its peak shifts"
    )
    transfer.legend(loc="upper right")
    response.legend(loc="upper right")
    response.set_ylim(top=3)
    transfer.set_ylim(top=0.3)


def draw() -> Figure:
    """All four."""
    with styled():
        figure = blank(9.5, 6.6)
        axes = figure.subplots(2, 2)
        nut(axes[0, 0])
        energy(axes[0, 1])
        poles(axes[1, 0], axes[1, 1])
    return figure


def main(folder: Path) -> None:
    """Draw it."""
    save_figure(draw(), folder / "testbed.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "_static")
