"""The machine at other temperatures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ballscrew.axis.hertz import preload_deflection
from ballscrew.axis.imitation import warm_screw
from ballscrew.axis.model import kappa
from ballscrew.testbed.machine import Machine

_SOFTENING = 3e-4  # of the shaft's moduli by a kelvin; steel at room temperature


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
        With the former ``preload``; :meth:`Machine.local_preload` is the new one.
    """
    lost = machine.lost or ((0.0, 0.0),)
    return replace(machine, lost=tuple((place, depth - growth) for place, depth in lost))


def warmed(machine: Machine, difference: float, gradient: float = 0.0) -> Machine:
    """Copy of a machine whose screw is warmer than its nut, and so presses the balls harder.

    Parameters
    ----------
    machine : Machine
        Machine of uniform temperature.
    difference : float
        Screw less nut, K; a colder screw loses all nominal preload at most.
    gradient : float
        Change of that difference along the screw, K/m, from ``difference`` at axis position 0 on. Its mean
        over the screw softens the shaft.

    Returns
    -------
    Machine
        With the approach that has the P/P₀ of :func:`~ballscrew.axis.imitation.warm_screw`.

    Raises
    ------
    InputError
        If the difference is not finite.
    """
    sheet, screw = machine.sheet, machine.sheet.screw
    pressed = float(preload_deflection(sheet.nominal_preload, kappa(sheet)))

    def growth(warmer: float) -> float:
        ratio = 1 + float(warm_screw(sheet, warmer, screw.nominal_diameter / 2))
        return pressed * (float(np.cbrt(ratio)) ** 2 - 1)

    if gradient == 0:
        return pressed_more(machine, growth(difference))
    ends = (-screw.bearing_to_zero, sheet.travel_limit)
    places = sorted({*ends, *(place for place, _ in machine.lost)})
    lost = replace(machine, lost=()).pressed(places) - machine.pressed(places)
    depths = [
        depth - growth(difference + gradient * place) for place, depth in zip(places, lost, strict=True)
    ]
    softer = 1 - _SOFTENING * gradient * sum(ends) / 2
    shaft = replace(
        screw, youngs_modulus=softer * screw.youngs_modulus, shear_modulus=softer * screw.shear_modulus
    )
    return replace(machine, sheet=replace(sheet, screw=shaft), lost=tuple(zip(places, depths, strict=True)))
