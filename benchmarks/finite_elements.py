"""Predictions against finite elements that share no code with them: python -m benchmarks.finite_elements.

Each random axis of :mod:`benchmarks.axis_sampling` is assembled from the numbers of its sheet: the screw as
axial and torsional bar elements, the rotor behind belt and coupling, the nut between table and thread, a
bearing at one end or at both; or a nut that rotates in a bearing of its own on a screw with clamped ends. The
mode is the one in which the table has most of its kinetic energy.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import eigsh

from ballscrew.axis.axial import AxialModel, frequency, from_vector
from ballscrew.axis.axial_prior import distributed
from ballscrew.axis.frequency import Rotor, axial_natural_frequency, predicted_frequency
from ballscrew.axis.sheet import DataSheet
from benchmarks.axis_sampling import random_axis
from benchmarks.machine import heading

AXES = 60
SUPPORTS = ("fixed-free", "fixed-fixed")
ROTORS: tuple[Rotor, ...] = ("free", "held")
TRANSMISSIONS = ("direct", "belt", "rotating nut")
_ELEMENTS = 300
_MODES = 12
_PLACES = (0.0, 0.2, 0.4, 0.6, 0.8)  # of the travel to the screw's end
_LOADS = (0.0, 0.5, 1.5)  # of the table's mass
_RATIOS = (1.0, 0.4)  # of the nominal preload


@dataclass(frozen=True, slots=True)
class Bars:
    """Chain of bar elements with one displacement per node."""

    first: int
    """Index of the first node's degree of freedom."""
    lengths: NDArray[np.float64]
    rigidity: float
    """E A, or G J (2π/lead)², N."""
    inertia: float
    """Mass per length, or polar inertia per length times (2π/lead)², kg/m."""


class Assembly:
    """Symmetric stiffness and mass matrices from springs, masses and bars."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.entries: dict[str, list[tuple[int, int, float]]] = {"stiffness": [], "mass": []}

    def add_mass(self, dof: int, mass: float) -> None:
        """Add a concentrated mass."""
        self.entries["mass"].append((dof, dof, mass))

    def add_spring(self, stiffness: float, ends: dict[int, float]) -> None:
        """Add a spring that a unit of each degree of freedom stretches by the number beside it."""
        for row, left in ends.items():
            for column, right in ends.items():
                self.entries["stiffness"].append((row, column, stiffness * left * right))

    def add_bars(self, bars: Bars) -> None:
        """Add a chain of linear elements with consistent masses."""
        for index, length in enumerate(bars.lengths):
            left = bars.first + index
            self.add_spring(bars.rigidity / length, {left: 1.0, left + 1: -1.0})
            whole = bars.inertia * length
            for row, column, part in ((0, 0, 3), (1, 1, 3), (0, 1, 6), (1, 0, 6)):
                self.entries["mass"].append((left + row, left + column, whole / part))

    def matrix(self, name: str, free: NDArray[np.int64]) -> csc_matrix:
        """Assembled sparse matrix of the free degrees of freedom."""
        rows, columns, values = np.array(self.entries[name]).T
        places = (rows.astype(np.int64), columns.astype(np.int64))
        return coo_matrix((values, places), shape=(self.size, self.size)).tocsc()[free][:, free]


def element_frequency(
    sheet: DataSheet, position: float, load: float, preload: float, rotor: Rotor, elements: int = _ELEMENTS
) -> float:
    """Frequency of the table's mode by finite elements, Hz.

    Parameters
    ----------
    sheet : DataSheet
        Axis whose K is stated at a preload, with a coupling.
    position, load, preload : float
        m, kg, N.
    rotor : {"free", "held"}
        Whether the motor can turn.
    elements : int
        Along the screw.

    Returns
    -------
    float
        Of the mode with the largest part of its kinetic energy in the table.
    """
    screw, drive = sheet.screw, sheet.drive
    before = screw.bearing_to_zero + position
    near = min(max(round(elements * before / screw.length), 1), elements - 1)
    lengths = np.repeat([before / near, (screw.length - before) / (elements - near)], [near, elements - near])
    turn = 2 * math.pi / screw.lead
    nodes = elements + 1
    table, motor, pulley, nut, nut_angle = range(2 * nodes, 2 * nodes + 5)
    model = Assembly(2 * nodes + 5)
    area = math.pi * screw.root_diameter**2 / 4
    root, nominal = (math.pi * d**4 / 32 for d in (screw.root_diameter, screw.nominal_diameter))
    model.add_bars(Bars(0, lengths, screw.youngs_modulus * area, screw.density * area))
    model.add_bars(
        Bars(nodes, lengths, screw.shear_modulus * root * turn**2, screw.density * nominal * turn**2)
    )
    model.add_mass(table, sheet.table.mass + load)
    model.add_mass(motor, drive.rotor_inertia * turn**2)
    fixed = {motor} if rotor == "held" else set()
    ends = (0, elements) if sheet.support == "fixed-fixed" else (0,)
    thread = {nut: 1.0, near: -1.0, nodes + near: -1.0}
    if drive.rotating == "nut":
        driven = nut_angle
        thread[nut_angle] = -1.0
        model.add_spring(sheet.bearing.stiffness, {table: 1.0, nut: -1.0})
        fixed |= {node + first for node in ends for first in (0, nodes)}
    else:
        driven = nodes
        thread[table] = thread.pop(nut)
        fixed |= {nut, nut_angle}
        model.add_spring(sheet.bearing.stiffness, {0: 1.0})
        if len(ends) > 1:
            model.add_spring(sheet.bearing.far_stiffness or sheet.bearing.stiffness, {elements: 1.0})
    assert screw.rigidity_preload_ratio is not None
    stated = screw.rigidity_preload_ratio * screw.dynamic_load_rating
    model.add_spring(0.8 * screw.rigidity * (preload / stated) ** (1 / 3), thread)
    assert drive.coupling_stiffness is not None
    if drive.belt_stiffness is None:
        fixed.add(pulley)
        model.add_spring(drive.coupling_stiffness * turn**2, {motor: 1 / drive.ratio, driven: -1.0})
    else:
        model.add_spring(drive.belt_stiffness * turn**2, {motor: 1 / drive.ratio, pulley: -1.0})
        model.add_spring(drive.coupling_stiffness * turn**2, {pulley: 1.0, driven: -1.0})
    free = np.setdiff1d(np.arange(model.size), sorted(fixed))
    shift = -((2 * math.pi * 20.0) ** 2)  # below all modes, so that the rigid body has a factor too
    squares, shapes = eigsh(
        model.matrix("stiffness", free), _MODES, model.matrix("mass", free), sigma=shift, which="LM"
    )
    share = shapes[np.searchsorted(free, table)] ** 2 * (squares > 1.0)  # the rigid body is no mode
    return math.sqrt(squares[int(np.argmax(share))]) / (2 * math.pi)


def cases(sheet: DataSheet) -> NDArray[np.float64]:
    """Position (m), load (kg) and preload (N) of each case; (3, case)."""
    positions = [part * sheet.travel_limit for part in _PLACES]
    loads = [part * sheet.table.mass for part in _LOADS]
    preloads = [part * sheet.nominal_preload for part in _RATIOS]
    return np.array([(x, load, p) for x in positions for load in loads for p in preloads]).T


def sheets(count: int, support: str, transmission: str) -> Iterator[DataSheet]:
    """Random axes with a support and a transmission.

    Belts are 0.1 to 3 times as stiff as the coupling, at ratios of 0.5 to 4; beside a belt the far bearing is
    0.3 to 3 times as stiff as the other.
    """
    for seed in range(count):
        sheet = replace(random_axis(seed).data_sheet, support=support)
        if transmission != "direct":
            sheet = with_belt(sheet, np.random.default_rng([seed, 0xBE17]), transmission)
        yield sheet


def with_belt(sheet: DataSheet, random: np.random.Generator, transmission: str) -> DataSheet:
    """Axis that is driven by a belt, at its screw or at its nut."""
    assert sheet.drive.coupling_stiffness is not None
    belt = sheet.drive.coupling_stiffness * math.exp(random.uniform(math.log(0.1), math.log(3)))
    ratio = math.exp(random.uniform(math.log(0.5), math.log(4)))
    far = sheet.bearing.stiffness * math.exp(random.uniform(math.log(0.3), math.log(3)))
    drive = replace(sheet.drive, belt_stiffness=belt, ratio=ratio)
    if transmission == "rotating nut":
        return replace(sheet, drive=replace(drive, rotating="nut"))
    if sheet.support == "fixed-fixed":
        sheet = replace(sheet, bearing=replace(sheet.bearing, far_stiffness=far))
    return replace(sheet, drive=drive)


def form_residual(sheet: DataSheet, exact: NDArray[np.float64]) -> float:
    """Rms of ln f about the lumped model fitted to the distributed one."""
    x, load, preload = cases(sheet)
    centre = 0.4 * sheet.travel_limit
    model: AxialModel = from_vector(distributed(sheet, centre), centre)
    fitted = frequency(model, x, load, preload / sheet.nominal_preload)
    return float(np.sqrt(np.mean(np.log(exact / fitted) ** 2)))


def compare(sheet: DataSheet, rotor: Rotor) -> tuple[float, float, float]:
    """Largest relative deviation of prediction and lumped formula, and rms residual of the fitted form."""
    x, load, preload = cases(sheet)
    exact = np.array([element_frequency(sheet, *case, rotor) for case in zip(x, load, preload, strict=True)])
    predicted = predicted_frequency(sheet, x, load, preload, rotor) / exact - 1
    lumped = axial_natural_frequency(sheet, x, load, preload, rotor, torsion=True) / exact - 1
    residual = form_residual(sheet, exact) if rotor == "free" else math.nan
    return (
        float(predicted[np.argmax(np.abs(predicted))]),
        float(lumped[np.argmax(np.abs(lumped))]),
        residual,
    )


def main(count: int) -> None:
    """Print the table."""
    print(heading(f"python -m benchmarks.finite_elements {count}"))
    print(
        f"\n{count} axes, {len(_PLACES) * len(_LOADS) * len(_RATIOS)} cases each. Largest deviation:\n\n"
        "| support | transmission | rotor | `predicted_frequency` | lumped formula | "
        "fitted form: median, largest rms |\n"
        "|---|---|---|---|---|---|"
    )
    for support, transmission, rotor in product(SUPPORTS, TRANSMISSIONS, ROTORS):
        rows = np.array([compare(sheet, rotor) for sheet in sheets(count, support, transmission)])
        worst = [column[np.argmax(np.abs(column))] for column in rows.T[:2]]
        form = "–"
        if rotor == "free":
            form = f"{np.median(rows[:, 2]):.1e}, {rows[:, 2].max():.1e}"
        name = f"| {support} | {transmission} | {rotor} "
        print(f"{name}| {worst[0]:+.0e} | {worst[1]:+.2%} | {form} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else AXES)
