"""The axis as a rod that stretches and twists: the reference for the lumped forms of Eq. (3).

Equations (1) to (3) of the paper put one mass behind springs in series. Here the screw's mass and rotary
inertia lie where they are, along the shaft, so that the table's mode meets the shaft's own modes, as it does
in a machine. Two-node elements with linear shape functions, as in any book on finite elements.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh

from ballscrew.axis import compliance
from ballscrew.axis.frequency import Rotor, axial_natural_frequency
from ballscrew.axis.given import positive
from ballscrew.axis.model import drive_compliance, kappa, moving_mass
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.settings import check_whole

_MOST_ELEMENTS = 2000
# An element shorter than this part of the screw is so stiff that it drowns its neighbours in round-off.
_SHORTEST = 1e-8
_CLAMPED = 1e6  # stiffness of a clamped end, over that of the whole screw


@dataclass(frozen=True, slots=True)
class RodModes:
    """Undamped modes of an axis, mass-normalised, the table moving in the positive direction.

    Parameters
    ----------
    frequencies : ndarray
        Hz, ascending, without the rigid-body mode; (mode,).
    nodes : ndarray
        Places along the screw, from the thrust bearing, m; (node,).
    axial : ndarray
        Axial motion of the screw, kg^(−1/2); (mode, node).
    twist : ndarray
        β times the screw's angle, kg^(−1/2); (mode, node).
    table : ndarray
        Motion of table and load, kg^(−1/2); (mode,).
    rotor : ndarray
        β times the angle of motor and coupling, kg^(−1/2), 0 where the rotor is held; (mode,).
    table_share : ndarray
        The table's part of the mode's kinetic energy; (mode,). All modes and the rigid body add up to 1.
    first_axial : int
        Index of the mode that is called axial: the one with the largest ``table_share``.
    equivalent_mass : float
        Table, load and all inertia referred to the table, from the rigid-body mode, kg; inf where the rotor
        is held.
    """

    frequencies: Array
    nodes: Array
    axial: Array
    twist: Array
    table: Array
    rotor: Array
    table_share: Array
    first_axial: int
    equivalent_mass: float

    @property
    def axial_frequency(self) -> float:
        """Frequency of the first axial mode, Hz."""
        return float(self.frequencies[self.first_axial])


def rod_frequency(
    sheet: DataSheet,
    position: ArrayLike,
    load: ArrayLike,
    preload: ArrayLike | None = None,
    rotor: Rotor = "free",
    *,
    nut_rigidity: ArrayLike | None = None,
    elements: int = 200,
) -> Array:
    """Frequency of the first axial mode of the distributed model; see :func:`rod_modes`.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    position : array_like
        x_t, m.
    load : array_like
        Load on the table, kg.
    preload : array_like, optional
        P, N; the nominal preload where it is not given.
    rotor : {"free", "held"}
        Whether the motor can turn.
    nut_rigidity : array_like, optional
        The nut's tangent rigidity, N/m, in the place of the one that the preload gives.
    elements : int
        Along the screw.

    Returns
    -------
    ndarray
        Hz, of the shape that position, load, preload and nut rigidity broadcast to.

    Raises
    ------
    InputError
        As :func:`rod_modes`.
    """
    force = sheet.nominal_preload if preload is None else preload
    rigidity = np.nan if nut_rigidity is None else nut_rigidity
    cases = np.broadcast(*(np.asarray(v, dtype=np.float64) for v in (position, load, force, rigidity)))
    found = [
        rod_modes(
            sheet,
            x,
            m,
            p,
            rotor,
            nut_rigidity=None if nut_rigidity is None else k,
            elements=elements,
            count=1,
        ).axial_frequency
        for x, m, p, k in cases
    ]
    return np.asarray(found, dtype=np.float64).reshape(cases.shape)


def rod_modes(
    sheet: DataSheet,
    position: float,
    load: float,
    preload: float | None = None,
    rotor: Rotor = "free",
    *,
    nut_rigidity: float | None = None,
    elements: int = 200,
    count: int = 6,
) -> RodModes:
    """Modes of the axis with the screw as a rod in tension and in torsion.

    The root diameter carries and weighs, the nominal one turns. The bearing (both, if the support is
    fixed-fixed) holds the shaft axially; motor and coupling are one disc behind the coupling's spring; the
    nut is a spring between the table and u + β φ of the screw beneath it. No damping and no structure behind
    the bearing, and the screw's end beyond the nut is free or held as the support says. Where the nut
    rotates, the ends that the support fixes are clamped in translation and rotation, and the nut's spring is
    in series with those of its bearing and its drive.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    position : float
        x_t, m.
    load : float
        Load on the table, kg.
    preload : float, optional
        P, N; the nominal preload where it is not given.
    rotor : {"free", "held"}
        Whether the motor can turn.
    nut_rigidity : float, optional
        The nut's tangent rigidity, N/m, in the place of the one that the preload gives.
    elements : int
        Along the screw, 2 to 2000; the error of the frequencies falls with their square.
    count : int
        The number of modes wanted, at most ``elements``; more come back where the axial one lies higher.

    Returns
    -------
    RodModes
        The lowest modes, their shapes, and which one is axial.

    Raises
    ------
    InputError
        If a position is not on the screw, a preload or a rigidity not above 0, a load negative, the rotor
        neither free nor held, or a number of elements or modes out of range.
    """
    # The lumped form checks the arguments, and its answer is the scale on which the solver shall be exact.
    scale = axial_natural_frequency(sheet, position, load, preload, rotor, torsion=True)
    if scale.ndim:
        raise InputError(
            "rod_modes takes one position, load and preload at a time; rod_frequency takes arrays"
        )
    check_whole("elements", elements, 2, _MOST_ELEMENTS)
    check_whole("count", count, 1, elements)
    if nut_rigidity is None:
        nut = kappa(sheet) * math.cbrt(sheet.nominal_preload if preload is None else preload)
    else:
        nut = float(positive("nut rigidity", nut_rigidity, "N/m"))
    nodes, at_nut = _nodes(sheet.screw.length, sheet.screw.bearing_to_zero + float(position), elements)
    stiffness, mass = _matrices(sheet, nodes, at_nut, nut, float(load))
    free = len(mass) - (rotor == "held")  # the disc is the last
    values, vectors = _lowest(stiffness[:free, :free], mass[:free, :free], (2 * math.pi * float(scale)) ** 2)
    shapes = np.zeros((len(values), len(mass)))
    shapes[:, :free] = vectors
    return _modes(sheet, values, shapes, nodes, load, rotor, count)


def _nodes(length: float, distance: float, elements: int) -> tuple[Array, int]:
    """Nodes along the screw and the index of the one under the nut, which lies there exactly."""
    if distance <= _SHORTEST * length:
        return np.linspace(0.0, length, elements + 1), 0
    if length - distance <= _SHORTEST * length:
        return np.linspace(0.0, length, elements + 1), elements
    before = min(max(round(elements * distance / length), 1), elements - 1)
    return np.concatenate(
        [np.linspace(0.0, distance, before + 1), np.linspace(distance, length, elements - before + 1)[1:]]
    ), before


def _matrices(sheet: DataSheet, nodes: Array, at_nut: int, nut: float, load: float) -> tuple[Array, Array]:
    """Stiffness and mass over (u of each node, table, β φ of each node, disc), all in metres.

    Angles times β have the units and about the size of the travels, which keeps the matrices well
    conditioned. Consistent masses: each refinement brings the frequencies down towards the exact ones, never
    below. Lumped ones err as much and bound nothing.
    """
    screw = sheet.screw
    beta = compliance.transmission_ratio(screw.lead)
    area = math.pi * screw.root_diameter**2 / 4
    polar, nominal = (math.pi * d**4 / 32 for d in (screw.root_diameter, screw.nominal_diameter))
    u, table, twist, disc = _places(sheet, len(nodes))
    stiffness, mass = np.zeros((disc + 1, disc + 1)), np.zeros((disc + 1, disc + 1))
    lengths = np.diff(nodes)
    for dof, rigidity, inertia in (
        (u, screw.youngs_modulus * area, screw.density * area),
        (twist, screw.shear_modulus * polar / beta**2, screw.density * nominal / beta**2),
    ):
        a, b = dof[:-1], dof[1:]
        for i, j, spring, weight in ((a, a, 1, 2), (b, b, 1, 2), (a, b, -1, 1), (b, a, -1, 1)):
            stiffness[i, j] += spring * rigidity / lengths
            mass[i, j] += weight * inertia * lengths / 6
    mass[table, table] = float(moving_mass(sheet, load))
    mass[disc, disc] += sheet.drive.rotor_inertia * sheet.drive.ratio**2 / beta**2
    bearings = _bearings(sheet)
    thread = {table: 1.0, int(u[at_nut]): -1.0, int(twist[at_nut]): -1.0}
    if sheet.drive.rotating == "nut":
        clamp = _CLAMPED / screw.length
        for end in bearings:
            stiffness[u[end], u[end]] += clamp * screw.youngs_modulus * area
            stiffness[twist[end], twist[end]] += clamp * screw.shear_modulus * polar / beta**2
        series = 1 / nut + 1 / sheet.bearing.stiffness + drive_compliance(sheet)
        _spring(stiffness, {**thread, disc: -1.0}, 1 / series)
        return stiffness, mass
    for end, bearing in bearings.items():
        stiffness[u[end], u[end]] += bearing
    _spring(stiffness, thread, nut)
    if disc != twist[0]:
        _spring(stiffness, {disc: 1.0, int(twist[0]): -1.0}, 1 / drive_compliance(sheet))
    return stiffness, mass


def _bearings(sheet: DataSheet) -> dict[int, float]:
    """Index of each end that is held, and the stiffness of its bearing, N/m."""
    near, far = sheet.bearing.stiffness, sheet.bearing.far_stiffness
    if sheet.support != "fixed-fixed":
        return {0: near}
    return {0: near, -1: near if far is None else far}


def _places(sheet: DataSheet, n: int) -> tuple[NDArray[np.intp], int, NDArray[np.intp], int]:
    """Degrees of freedom: u of the n nodes, the table, β φ of the nodes, and last the disc."""
    if sheet.drive.rotating == "screw" and not drive_compliance(sheet):
        # The screw's first angle is the disc's.
        return np.arange(n), n, np.concatenate([[2 * n], np.arange(n + 1, 2 * n)]), 2 * n
    return np.arange(n), n, np.arange(n + 1, 2 * n + 1), 2 * n + 1


def _spring(stiffness: Array, stretch: dict[int, float], rigidity: float) -> None:
    where, sign = list(stretch), np.array(list(stretch.values()))
    stiffness[np.ix_(where, where)] += rigidity * np.outer(sign, sign)


def _lowest(stiffness: Array, mass: Array, scale: float) -> tuple[Array, Array]:
    """λ and mass-normalised shapes (mode, dof), ascending.

    Solved as M v = μ (K + s M) v, μ = 1/(λ + s): the low modes are then the large μ, exact to the last digits
    even where a very short element makes the highest λ 1e15 times as large; and K may be singular.
    """
    mu, vectors = eigh(mass, stiffness + scale * mass)
    sound = mu > len(mu) * np.finfo(np.float64).eps * mu[-1]  # the highest modes may be nothing but round-off
    mu, vectors = mu[sound][::-1], vectors[:, sound][:, ::-1]
    values = 1 / mu - scale
    return values, (vectors / np.sqrt(mu)).T


def _modes(
    sheet: DataSheet, values: Array, shapes: Array, nodes: Array, load: float, rotor: Rotor, count: int
) -> RodModes:
    u, table, twist, disc = _places(sheet, len(nodes))
    shapes = shapes * np.where(shapes[:, [table]] < 0, -1.0, 1.0)
    equivalent = math.inf
    if rotor == "free":
        equivalent = float(shapes[0, table] ** -2)
        values, shapes = values[1:], shapes[1:]
    share = float(moving_mass(sheet, load)) * shapes[:, table] ** 2
    first = int(np.argmax(share))
    lowest = slice(max(count, first + 1))
    return RodModes(
        frequencies=np.sqrt(values[lowest]) / (2 * math.pi),
        nodes=nodes,
        axial=shapes[lowest][:, u],
        twist=shapes[lowest][:, twist],
        table=shapes[lowest, table],
        rotor=shapes[lowest, disc],
        table_share=share[lowest],
        first_axial=first,
        equivalent_mass=equivalent,
    )
