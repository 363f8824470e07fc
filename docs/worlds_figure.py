"""Draws the picture of the page *What a machine can hide*.

Usage: python -m docs.worlds_figure [FOLDER]

FOLDER is docs/_static where it is not given. Frequencies are those of the testbed, linearised about the load
of the nut; the axis is the testbed's example.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

from ballscrew.axis.equations import preload_change
from ballscrew.axis.sheet import DataSheet
from ballscrew.report.canvas import blank, save_figure, styled
from ballscrew.testbed.example import AXIS, LOAD
from ballscrew.testbed.forces import nut_force, pressed_at, stiffnesses, support_force
from ballscrew.testbed.linear import compliance
from ballscrew.testbed.machine import Machine, constants
from ballscrew.testbed.temperature import warmed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NEW, LATER, SHEET, SECOND = "0.15", "#0072B2", "#D55E00", "#009E73"
PLACES = np.linspace(0.0, 0.45, 46)
P = AXIS.nominal_preload
RIGID = {"bed_mass": 1e8, "bed_frequency": 0.1}
MACHINE = Machine(AXIS, P, **RIGID)
MASS = AXIS.table.mass + LOAD
LEFT = 0.75  # of the preload, later
INERTIA = 240.0  # N, of the motion
FRAME_MASS = 8  # over table and load
FRAME_RATIO = PITCH_RATIO = 0.95  # over the natural frequency in the middle
PITCH_SHARE = 0.1
_WAY = 1e-3  # m, more than nut and support yield
_VISIBLE = 0.03  # part of the moving mass that a mode in the picture moves


def modes(machine: Machine, place: float, force: float = 0.0) -> list[float]:
    """Natural frequencies in which the table moves, while the nut carries a force, Hz."""
    c = constants(machine, LOAD, 0.2)
    twist, _, _, _ = stiffnesses(c, place)
    pressed = pressed_at(c, place)[0] + c.film
    deflection = brentq(lambda way: nut_force(way, c.flank, pressed)[0] - force, -_WAY, _WAY)
    extension = brentq(lambda way: support_force(c, place, way)[0] + force, -_WAY, _WAY)
    springs = (
        (twist, (1, -1, 0, 0, 0, 0)),
        (support_force(c, place, extension)[1], (0, 0, 1, 0, -1, 0)),
        (nut_force(deflection, c.flank, pressed)[1], (0, 1, 1, -1, 0, 0)),
        (c.bed_stiffness, (0, 0, 0, 0, 1, 0)),
        (c.pitch_stiffness, (0, 0, 0, 1, 0, -1)),
    )
    stiffness = sum(rigidity * np.outer(row, row) for rigidity, row in springs)
    mass = np.diag([c.motor, c.screw, c.rod, c.table - c.pitch_mass, c.bed, c.pitch_mass or 1e-9])
    values, shapes = eigh(stiffness, mass)
    frequencies = np.sqrt(np.maximum(values, 0)) / (2 * math.pi)
    share = c.table * (shapes[3] - shapes[4]) ** 2
    return [float(f) for f, part in zip(frequencies, share, strict=True) if 60 < f < 330 and part > _VISIBLE]


def curve(axes: Axes, machine: Machine, force: float = 0.0, **look: object) -> None:
    """Every mode along the axis."""
    by_place = [modes(machine, float(x), force) for x in PLACES]
    count = max(len(row) for row in by_place)
    found = np.full((len(PLACES), count), np.nan)
    for row, values in zip(found, by_place, strict=True):
        row[: len(values)] = values
    for number, column in enumerate(found.T):
        axes.plot(1e3 * PLACES, column, **{**look, "label": look.get("label") if number == 0 else None})


def worn(machine: Machine) -> Machine:
    """A quarter of the preload is lost."""
    return replace(machine, preload=LEFT * machine.preload)


def three(axes: Axes, machine: Machine, later: Machine, sheet: Machine | None = MACHINE) -> None:
    """By the sheet, new, and later."""
    if sheet is not None:
        curve(axes, sheet, color=SHEET, ls="--", lw=1.4, label="data sheet", zorder=3)
    curve(axes, machine, color=NEW, lw=1.6, label="new")
    curve(axes, later, color=LATER, lw=1.6, label=f"P/P₀ = {LEFT:g}")


def as_the_sheet_says(axes: Axes) -> None:
    """Nothing is hidden."""
    three(axes, MACHINE, worn(MACHINE))


def reported(axes: Axes) -> None:
    """P/P₀ that other conventions of the rigidity report."""
    c, place = constants(MACHINE, LOAD, 0.2), 0.2
    nut = 1 / (3 * MACHINE.hertz ** (2 / 3) * P ** (1 / 3))
    share = nut / compliance(c, place)
    ratio = np.linspace(0.5, 1.0, 51)
    frequency = 1 / np.sqrt(1 + share * (ratio ** (-1 / 3) - 1))
    clearance = 3 / 3 ** (1 / 3)
    for factor, colour, words in (
        (1.0, NEW, "right"),
        (0.8, SECOND, "0.8 twice"),
        (1 / clearance, LATER, "with clearance,\nread as preloaded"),
        (clearance, SHEET, "the reverse"),
    ):
        wrong = share / factor / (1 - share + share / factor)
        axes.plot(ratio, preload_change(frequency, 1.0, wrong), color=colour, label=words)
    axes.set(xlabel="P/P₀", ylabel="P/P₀ reported")


def bearing(axes: Axes) -> None:
    """Bearing and nut on one curve."""
    c, place = constants(MACHINE, LOAD, 0.2), 0.2
    softer = replace(MACHINE, bearing_preload_ratio=0.9)
    change = compliance(constants(softer, LOAD, 0.2), place) - compliance(c, place)
    nut = 3 * MACHINE.hertz ** (2 / 3) * P ** (1 / 3)
    equal = (1 + change * nut) ** -3
    curve(axes, MACHINE, color=NEW, lw=1.6, label="new")
    curve(axes, softer, color=LATER, lw=3.5, alpha=0.5, label="bearing preload −10 %")
    lost = replace(MACHINE, preload=equal * P)
    curve(axes, lost, color=SHEET, ls="--", lw=1.4, label=f"nut preload −{100 * (1 - equal):.0f} %")


def middle() -> float:
    """Natural frequency in the middle of the travel, Hz."""
    return modes(MACHINE, 0.225)[0]


def frame(axes: Axes) -> None:
    """Two modes where the sheet expects one."""
    machine = replace(MACHINE, bed_mass=FRAME_MASS * MASS, bed_frequency=FRAME_RATIO * middle())
    three(axes, machine, worn(machine))


def pitching(axes: Axes) -> None:
    """The same by the table's pitching."""
    machine = replace(MACHINE, pitch_frequency=PITCH_RATIO * middle(), pitch_share=PITCH_SHARE)
    three(axes, machine, worn(machine))


def weighed(axes: Axes, weight: float) -> None:
    """The nut carries a weight, more or less the inertia."""
    curve(axes, MACHINE, color=SHEET, ls="--", lw=1.4, label="data sheet", zorder=3)
    for machine, colour, word in ((MACHINE, NEW, "new"), (worn(MACHINE), LATER, f"P/P₀ = {LEFT:g}")):
        curve(axes, machine, weight + INERTIA, color=colour, lw=1.6, label=word)
        curve(axes, machine, weight - INERTIA, color=colour, lw=1.0, ls=":")


def vertical(axes: Axes) -> None:
    """Nothing balances the weight."""
    weighed(axes, 9.81 * MASS)


def counterbalance(axes: Axes) -> None:
    """The load alone is not balanced."""
    weighed(axes, 9.81 * LOAD)


def _with(sheet: DataSheet, **changes: object) -> Machine:
    return replace(MACHINE, sheet=replace(sheet, **changes))


def transmission(axes: Axes) -> None:
    """The rotor that the sheet forgets to multiply."""
    drive = replace(AXIS.drive, ratio=2.0)
    machine = _with(AXIS, drive=drive)
    three(axes, machine, worn(machine))


def pretension(axes: Axes) -> None:
    """Both ends, then one at a time."""
    machine = _with(AXIS, support="fixed-fixed")
    curve(axes, machine, color=NEW, lw=1.6, label="both ends pull")
    loose = replace(machine, pretension=0.0)
    curve(axes, loose, -INERTIA, color=LATER, lw=1.6, label="lost: pulled to +x")
    curve(axes, loose, INERTIA, color=SECOND, lw=1.6, label="lost: pulled to −x")


def gradient(axes: Axes) -> None:
    """Warm at the thrust bearing."""
    slope = -10.0 / AXIS.screw.length
    warm = warmed(MACHINE, 10.0 + slope * AXIS.screw.bearing_to_zero, slope)
    curve(axes, MACHINE, color=NEW, lw=1.6, label="new, cold")
    curve(axes, warm, color=SHEET, ls="--", lw=1.4, label="10 K at the bearing")
    later = warmed(worn(MACHINE), 10.0 + slope * AXIS.screw.bearing_to_zero, slope)
    curve(axes, later, color=LATER, lw=1.6, label=f"the same, P/P₀ = {LEFT:g}")


def oil(axes: Axes) -> None:
    """The film presses the flanks while the nut moves."""
    curve(axes, MACHINE, color=NEW, lw=1.6, label="new, dry")
    wet = replace(MACHINE, oil_film=0.3e-6)
    curve(axes, wet, color=SHEET, ls="--", lw=1.4, label="0.3 µm of oil")
    curve(axes, worn(wet), color=LATER, lw=1.6, label=f"the same, P/P₀ = {LEFT:g}")


PANELS: Sequence[tuple[str, Callable[[Axes], None]]] = (
    ("As the sheet says", as_the_sheet_says),
    ("Rigidity by another convention", reported),
    ("Bearing preload −10 %", bearing),
    ("Frame mode at 0.95 of the ANF", frame),
    ("Table pitches at 0.95 of the ANF", pitching),
    ("Vertical", vertical),
    ("Vertical, table balanced", counterbalance),
    ("Transmission 2, sheet silent", transmission),
    ("Fixed-fixed, pretension lost", pretension),
    ("Warm at the thrust bearing", gradient),
    ("Oil film", oil),
)


def draw() -> Figure:
    """One panel for each world."""
    with styled():
        figure = blank(11.0, 11.5)
        panels = figure.subplots(4, 3).ravel()
        for axes, (title, panel) in zip(panels, PANELS, strict=False):
            panel(axes)
            axes.set_title(title)
            if not axes.get_xlabel():
                axes.set(xlabel="position (mm)", ylabel="frequency (Hz)")
            axes.legend(loc="best", fontsize=8)
        for axes in panels[len(PANELS) :]:
            axes.axis("off")
    return figure


def main(folder: Path) -> None:
    """Draw it."""
    save_figure(draw(), folder / "worlds.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "_static")
