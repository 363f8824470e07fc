"""Heat of a duty: friction heats the screw more than its nut, and so presses the balls harder for a while."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.compliance import transmission_ratio
from ballscrew.axis.drag import preload_torque
from ballscrew.axis.given import finite, not_negative
from ballscrew.axis.hertz import preload_deflection
from ballscrew.axis.imitation import warm_screw
from ballscrew.axis.model import kappa
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.testbed.duty import Duty
from ballscrew.testbed.machine import Machine


@dataclass(frozen=True, slots=True)
class ThermalModel:
    """First-order thermal model of screw and nut.

    Parameters
    ----------
    resistance : float
        Temperature of the screw less that of the nut for each watt of friction, K/W.
    time_constant : float
        Time constant, h.
    """

    resistance: float = 0.5
    time_constant: float = 0.75


def friction_power(duty: Duty, sheet: DataSheet, preload: ArrayLike) -> Array:
    """Heat of the preloaded nut's drag while the axis works, W.

    Parameters
    ----------
    duty : Duty
        The day's work.
    sheet : DataSheet
        The axis.
    preload : array_like
        P, N.

    Returns
    -------
    ndarray
        Mean over the hours in which the axis moves; in proportion to P.

    Raises
    ------
    InputError
        If the preload is negative.
    """
    screw = sheet.screw
    torque = preload_torque(preload, screw.lead, screw.nominal_diameter)
    speed = duty.travel_per_day / (3600 * duty.hours_per_day)
    return np.asarray(torque / transmission_ratio(screw.lead) * speed)


def temperature_difference(
    warmth: ThermalModel, power: ArrayLike, hours: ArrayLike, rested: ArrayLike = 0.0, before: ArrayLike = 0.0
) -> Array:
    """Screw less nut after work and rest.

    Parameters
    ----------
    warmth : ThermalModel
        The thermal state's constants.
    power : array_like
        Of :func:`friction_power`, W.
    hours : array_like
        Worked, h.
    rested : array_like
        Since then, h.
    before : array_like
        Difference before the work, K.

    Returns
    -------
    ndarray
        K.

    Raises
    ------
    InputError
        If a time or the power is negative.
    """
    steady = warmth.resistance * not_negative("friction power", power, "W")
    work = np.exp(-not_negative("time at work", hours, "h") / warmth.time_constant)
    rest = np.exp(-not_negative("time at rest", rested, "h") / warmth.time_constant)
    return np.asarray((steady + (finite("difference of temperature", before, "K") - steady) * work) * rest)


def warm_growth(sheet: DataSheet, difference: ArrayLike) -> Array:
    """Additional approach of each flank from a warmer screw.

    Parameters
    ----------
    sheet : DataSheet
        The axis; its contacts lie at half of the nominal diameter.
    difference : array_like
        Screw less nut, K.

    Returns
    -------
    ndarray
        m, from the P/P₀ of :func:`~ballscrew.axis.imitation.warm_screw`; negative for a colder screw, down
        to the loss of all nominal preload.

    Raises
    ------
    InputError
        If the difference is not finite.
    """
    ratio = 1 + warm_screw(sheet, difference, sheet.screw.nominal_diameter / 2)
    pressed = preload_deflection(sheet.nominal_preload, kappa(sheet))
    return np.asarray(pressed * (np.cbrt(ratio) ** 2 - 1))


def pressed_more(machine: Machine, growth: float) -> Machine:
    """Copy of a machine with a larger approach of its flanks everywhere.

    Parameters
    ----------
    machine : Machine
        With preload, or with backlash that the growth reduces first.
    growth : float
        Additional approach, m; may be negative.

    Returns
    -------
    Machine
        With the former ``preload``; :meth:`~ballscrew.testbed.machine.Machine.local_preload` is the new one.
    """
    lost = machine.lost or ((0.0, 0.0),)
    return replace(machine, lost=tuple((place, depth - growth) for place, depth in lost))


def warmed(machine: Machine, difference: float) -> Machine:
    """Copy of a machine whose screw is warmer than its nut.

    Parameters
    ----------
    machine : Machine
        Machine of uniform temperature.
    difference : float
        Screw less nut, K.

    Returns
    -------
    Machine
        With the additional approach of :func:`warm_growth`.
    """
    return pressed_more(machine, float(warm_growth(machine.sheet, difference)))
