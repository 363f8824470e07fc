"""The machine linearised at rest: what its natural frequencies truly are."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.testbed.forces import nut_force, pressed_at, stiffnesses, support_force
from ballscrew.testbed.machine import Constants

_MOST_STEPS = 1000
# Frequency of the bed over the axial one: below it the bed follows no spring, and moves as a free body.
_FREE_BED = 0.5
_MOST_WAY = 1e-2  # m, of nut and support under a weight
# Ends of the springs: coupling and torsion, support and shaft, nut, mounts.
_SPRINGS = np.array([[1.0, -1, 0, 0, 0], [0, 0, 1, 0, -1], [0, 1, 1, -1, 0], [0, 0, 0, 0, 1]])


def _matrices(c: Constants, place: float) -> tuple[Array, Array]:
    """Masses, shape (5,), and stiffness matrix of motor, screw, rod, table and bed."""
    twist, axial, _, _ = stiffnesses(c, place)
    _, nut = nut_force(0.0, c.flank, pressed_at(c, place)[0])
    rigidities = np.array([twist, axial, nut, c.bed_stiffness])
    return np.array([c.motor, c.screw, c.rod, c.table, c.bed]), (_SPRINGS.T * rigidities) @ _SPRINGS


def compliance(c: Constants, place: float) -> float:
    """Axial compliance at the nut with the motor at rest: nut, shaft, bearing, torsion and coupling.

    Parameters
    ----------
    c : Constants
        The machine.
    place : float
        Of the table, m.

    Returns
    -------
    float
        m/N; infinite without preload.
    """
    twist, axial, _, _ = stiffnesses(c, place)
    _, nut = nut_force(0.0, c.flank, pressed_at(c, place)[0])
    return 1 / twist + 1 / axial + (1 / nut if nut > 0 else math.inf)


def standing(c: Constants, place: float) -> Array:
    """State of the machine at rest, with its weight on nut, shaft, bearing and coupling.

    Parameters
    ----------
    c : Constants
        The machine.
    place : float
        Of the motor, m.

    Returns
    -------
    ndarray, shape (11,)
        Ways and speeds of motor, screw, rod, table and bed; the bristle.
    """
    state = np.zeros(11)
    state[[0, 1, 3]] = place
    if c.gravity == 0:
        return state
    nut = -c.gravity
    twist, pressed = stiffnesses(c, place)[0], pressed_at(c, place)[0]
    deflection = brentq(lambda way: nut_force(way, c.flank, pressed)[0] - nut, -_MOST_WAY, _MOST_WAY)
    extension = brentq(lambda way: support_force(c, place, way)[0] + nut, -_MOST_WAY, _MOST_WAY)
    turn, bed = place - nut / twist, -nut / c.bed_stiffness
    state[[1, 2, 3, 4]] = turn, bed + extension, turn + bed + extension - deflection, bed
    return state


def natural_frequencies(
    c: Constants, place: float, *, rotor_fixed: bool = False, bed_blocked: bool = False
) -> tuple[Array, Array]:
    """Undamped natural frequencies of the machine at rest, its guide sliding freely.

    Parameters
    ----------
    c : Constants
        The machine; one without preload has no stiffness of the nut at rest.
    place : float
        Of the table, m.
    rotor_fixed : bool
        Whether the rotor is fixed.
    bed_blocked : bool
        Whether the bed is.

    Returns
    -------
    frequencies : ndarray, shape (modes,)
        Hz, ascending, with the rigid body's 0 where the motor is free.
    share : ndarray, shape (modes,)
        m (X_t − X_b)², the table's motion on the bed, of mass-normalised shapes.
    """
    frequencies, shapes = _modes(c, place, rotor_fixed, bed_blocked)
    return frequencies, c.table * (shapes[3] - shapes[4]) ** 2


def true_frequency(c: Constants, place: float, *, rotor_fixed: bool = False) -> float:
    """Axial natural frequency: of the mode in which the table moves most on the bed.

    With the bed blocked, for near the bed's own frequency no mode of the whole machine is the axis'. A bed on
    soft mounts, below half of that frequency, moves as a free body: the mode is that of the whole machine.
    Nut and bearings carry no load, and both ends of a screw with pretension are in tension.

    Parameters
    ----------
    c : Constants
        The machine.
    place : float
        Of the table, m.
    rotor_fixed : bool
        Whether the rotor is fixed.

    Returns
    -------
    float
        Hz.
    """
    return _axial_mode(c, place, rotor_fixed)[0]


def structural_damping(c: Constants, place: float, ratio: float) -> float:
    """Damping of the springs over their stiffness with which the axial mode has a damping ratio.

    Guide, motor and bed damp the mode too while the machine moves: 2 ζ ω = β ω² + φᵀ C φ, C theirs. What the
    drag of the nut and the guide's bristle take at standstill is friction, not damping.

    Parameters
    ----------
    c : Constants
        The machine; its own structural damping does not matter.
    place : float
        Of the table, m.
    ratio : float
        ζ of the axial mode, rotor free.

    Returns
    -------
    float
        β, s; 0 where the others damp as much or more already.
    """
    _, stiffness = _matrices(c, place)
    _, mode = _axial_mode(c, place, rotor_fixed=False)
    lost = (
        c.viscous * (mode[3] - mode[4]) ** 2 + c.motor_viscous * mode[0] ** 2 + c.bed_viscous * mode[4] ** 2
    )
    square = float(mode @ stiffness @ mode)
    return max(0.0, (2 * ratio * math.sqrt(square) - float(lost)) / square)


def least_steps(c: Constants, places: Sequence[float], rate: float) -> int:
    """Steps a sample that the integrator needs to stay stable, with room for a nut that stiffens under load.

    A mode of ω with damping γ = βω², β the structural damping, is stable while ω² Δt² + 4 γ Δt < 4. Three
    of the four are allowed. Accuracy asks for no more than four on axes of usual size.

    Parameters
    ----------
    c : Constants
        The machine.
    places : sequence of float
        Of the table; the stiffest is the one nearest to a bearing, m.
    rate : float
        Samples per second, Hz.

    Returns
    -------
    int
        1 or more.

    Raises
    ------
    InputError
        If it is more than 1000: nut, bearing and coupling leave nothing that gives way.
    """
    worst = 0.0
    for place in places:
        if c.coupling + c.twist * (place + c.to_zero) <= 0:
            worst = math.inf
            break
        square = (2 * math.pi * float(natural_frequencies(c, place)[0][-1])) ** 2
        # Least 1/Δt with ω²Δt² + 4γΔt = 3.
        damping = 2 * c.structural * square
        worst = max(worst, (damping + math.sqrt(damping**2 + 3 * square)) / 3)
    if not worst <= _MOST_STEPS * rate:
        raise InputError(
            f"with the table at {min(places):g} m the shaft is too stiff to simulate; "
            "state a coupling stiffness, or a stop farther from the bearing."
        )
    return max(1, math.ceil(worst / rate))


def _modes(c: Constants, place: float, rotor_fixed: bool, bed_blocked: bool) -> tuple[Array, Array]:
    """Frequencies, Hz, shape (modes,), and mass-normalised shapes, (5, modes)."""
    mass, stiffness = _matrices(c, place)
    moving = slice(1 if rotor_fixed else 0, 4 if bed_blocked else 5)
    root = np.sqrt(mass[moving])
    values, moved = np.linalg.eigh(stiffness[moving, moving] / np.outer(root, root))
    shapes = np.zeros((5, len(values)))
    shapes[moving] = moved / root[:, None]
    return np.sqrt(np.maximum(values, 0)) / (2 * math.pi), shapes


def _axial_mode(c: Constants, place: float, rotor_fixed: bool) -> tuple[float, Array]:
    """Frequency, Hz, and shape (5,) of the axial mode as :func:`true_frequency` defines it."""
    bed = math.sqrt(c.bed_stiffness / c.bed) / (2 * math.pi)
    for bed_blocked in (True, False):
        frequencies, shapes = _modes(c, place, rotor_fixed, bed_blocked)
        share = c.table * (shapes[3] - shapes[4]) ** 2
        # Neither the rigid body, whose frequency is 0 but for rounding, nor a bed on soft mounts.
        least = 1e-3 * frequencies[-1] if bed_blocked else 1.3 * bed
        axial = int(np.argmax(np.where(frequencies > least, share, -1.0)))
        if bed > _FREE_BED * frequencies[axial]:
            break
    return float(frequencies[axial]), shapes[:, axial]
