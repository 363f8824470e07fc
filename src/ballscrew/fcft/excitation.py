r"""Spectra of jerk-limited accelerations, which excite a natural frequency, and their nulls.

The acceleration of a move rises over the jerk time T_j, is held, and falls again; its two blows lie
T_a = speed / acceleration apart. In frequency that is \|sinc(f T_a)\| \|sinc(f T_j)\| (sinc x = sin πx / πx):
nulls at every k/T_a, which lie close and go where a window holds one blow only, and at every k/T_j, which
stay.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.model import motor_travel, moving_mass, rotor_mass
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.fcft.plan import Motion

_ENOUGH = 1000


def blow_spectrum(frequency: ArrayLike, motion: Motion) -> Array:
    r"""Spectrum of one blow over that of a jerk without duration: \|sinc(f T_j)\|.

    Parameters
    ----------
    frequency : array_like
        Hz.
    motion : Motion
        Gives T_j.

    Returns
    -------
    ndarray
        Between 0 (a null) and 1, the shape of ``frequency``.
    """
    return np.asarray(np.abs(np.sinc(np.asarray(frequency, dtype=np.float64) * motion.jerk_time)))


def mean_blow_spectrum(frequency: ArrayLike, motions: Sequence[Motion]) -> Array:
    """Root mean square of the blows' spectra: what is left where spectra are averaged over repetitions.

    Parameters
    ----------
    frequency : array_like
        Hz.
    motions : sequence of Motion
        As each repetition runs it; one or more. Of very many the first 1000 count: they are spread as
        evenly as all.

    Returns
    -------
    ndarray
        Between 0 and 1, the shape of ``frequency``.

    Raises
    ------
    InputError
        If there is no motion.
    """
    if not motions:
        raise InputError("no motion was given; a mean needs one or more")
    f = np.asarray(frequency, dtype=np.float64)
    power = np.zeros_like(f)
    # One after another, and each jerk time once: a thousand repetitions must not fill the memory.
    counted = Counter(motion.jerk_time for motion in motions[:_ENOUGH])
    for jerk_time, count in counted.items():
        power += count * np.sinc(f * jerk_time) ** 2
    return np.asarray(np.sqrt(power / counted.total()))


def torque_spectrum(sheet: DataSheet, motions: Sequence[Motion], load: float, frequency: ArrayLike) -> Array:
    r"""Motor torque that one blow asks for at a frequency: m_e (β/ratio) a \|sinc(f T_j)\| / 2πf.

    Parameters
    ----------
    sheet : DataSheet
        The axis; m_e is table, nut, load and all that turns.
    motions : sequence of Motion
        As each repetition runs it; each gives the acceleration a that is reached, and T_j. Of several, the
        root mean square.
    load : float
        What lies on the table, kg.
    frequency : array_like
        Hz; more than 0.

    Returns
    -------
    ndarray
        N m s (N m per Hz), the shape of ``frequency``.
    """
    f = np.asarray(frequency, dtype=np.float64)
    mass = float(moving_mass(sheet, load)) + rotor_mass(sheet)
    power = np.zeros_like(f)
    counted = Counter((motion.jerk_time, motion.peak_acceleration) for motion in motions[:_ENOUGH])
    for (jerk_time, acceleration), count in counted.items():
        power += count * (acceleration * np.sinc(f * jerk_time)) ** 2
    level = np.sqrt(power / counted.total())
    return np.asarray(mass * motor_travel(sheet) * level / (2 * np.pi * f))


def nulls(motion: Motion, highest: float) -> tuple[float, ...]:
    """Nulls k/T_j of one blow up to a frequency, Hz.

    Parameters
    ----------
    motion : Motion
        Gives T_j.
    highest : float
        Hz.

    Returns
    -------
    tuple of float
        Ascending; empty where the first lies above.
    """
    return tuple(k / motion.jerk_time for k in range(1, int(highest * motion.jerk_time * (1 + 1e-12)) + 1))
