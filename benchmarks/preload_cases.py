"""Cases of :mod:`benchmarks.preload`: what is known, and what changes besides the wear."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.axis.compliance import equivalent_preload_ratio
from ballscrew.axis.model import kappa
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.testbed.machine import Machine

__all__ = ["CASES", "Case", "happened", "stiffer", "true_stiffness"]

SECOND, LOW = 0.5, 0.25  # of the first preload
LOST = 0.9 ** (1 / 3)  # of k_b, by a tenth of the bearing's preload
STATED = 0.01  # half-width of the change of k_b that a user states


@dataclass(frozen=True)
class Case:
    """What is known of the preloads, and what happens beside the wear.

    Parameters
    ----------
    second : float or None
        P/P₀ of a second preload that is known.
    first : bool
        Whether the first is known too.
    levels : bool
        Whether the runs have two acceleration levels.
    rigid : bool
        Whether the bearing keeps, and is said to.
    still : bool
        Whether nothing changes but the nut, whatever is allowed for.
    stated : float or None
        Half-width of the 95 % interval of the change of k_b, as stated and as it is.
    bearing : float or None
        k_b of the later runs over the baseline's; None where it is random.
    """

    second: float | None = None
    first: bool = False
    levels: bool = False
    rigid: bool = False
    still: bool = False
    stated: float | None = None
    bearing: float | None = None

    @property
    def assumed(self) -> Assumptions:
        """Assumptions of the estimator."""
        return Assumptions(bearing_drift=0.0 if self.rigid else self.stated)

    @property
    def changes(self) -> Assumptions | None:
        """Sizes of the random changes; None if nothing but the nut changes."""
        return None if self.still else self.assumed


def happened(
    machine: Machine, load: float, assumed: Assumptions, random: np.random.Generator, bearing: float
) -> tuple[Machine, float]:
    """Random changes of the size that is assumed: bearing, zero of the axis, and load.

    ``bearing`` is the standard deviation of ln k_b, 0 on the day of the experiment.
    """
    drift, zero, weight = random.standard_normal(3)
    screw = machine.sheet.screw
    moved = replace(screw, bearing_to_zero=screw.bearing_to_zero + assumed.position * zero)
    machine = replace(machine, sheet=replace(machine.sheet, screw=moved))
    if bearing:
        machine = stiffer(machine, math.exp(bearing * drift))
    return machine, load * (1 + assumed.load * weight)


def true_stiffness(machine: Machine, reference: Machine) -> float:
    """Axial stiffness as P/P₀ of a machine against another with the same shaft, carried at one end."""
    nut, nut_before = (1 / (kappa(m.sheet) * m.preload ** (1 / 3)) for m in (machine, reference))
    bearing, bearing_before = (1 / m.sheet.bearing.stiffness for m in (machine, reference))
    return float(equivalent_preload_ratio(nut - nut_before + bearing - bearing_before, nut_before))


def stiffer(machine: Machine, part: float) -> Machine:
    """The machine with another bearing."""
    bearing = replace(machine.sheet.bearing, stiffness=part * machine.sheet.bearing.stiffness)
    return replace(machine, sheet=replace(machine.sheet, bearing=bearing))


CASES = {
    "none": Case(),
    "none; the bearing lost a tenth of its preload": Case(bearing=LOST),
    "none; the bearing has not changed": Case(bearing=1.0),
    "none; the bearing is stated to ± 1 %, and it is": Case(stated=STATED),
    "two acceleration levels; the bearing lost a tenth of its preload": Case(levels=True, bearing=LOST),
    "a second preload known, a half; the first not": Case(SECOND),
    "a second preload known, a quarter; the first not": Case(LOW),
    "both preloads known": Case(SECOND, first=True),
    "two acceleration levels": Case(levels=True),
    "both preloads known and two levels": Case(SECOND, first=True, levels=True),
    "none; the bearing assumed rigid, and it is": Case(rigid=True),
    "a second preload known, a half; the first not; the bearing assumed rigid, and it is": Case(
        SECOND, rigid=True
    ),
    "a second preload known, a quarter; the first not; the bearing assumed rigid, and it is": Case(
        LOW, rigid=True
    ),
    "none; but nothing changes": Case(still=True),
    "a second preload known, a half; the first not; but nothing changes": Case(SECOND, still=True),
    "a second preload known, a quarter; the first not; but nothing changes": Case(LOW, still=True),
    "both preloads known; but nothing changes": Case(SECOND, first=True, still=True),
}
