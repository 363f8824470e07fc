"""Force on the nut in the four conditions, and its limits."""

from __future__ import annotations

from collections.abc import Sequence

from ballscrew.axis.model import guide_friction, moving_mass, weight_on_nut
from ballscrew.axis.sheet import DataSheet, Screw
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.plan import Motion

ADVISED = 1.5
"""F/P to stay below: there the frequency reads as 10 % less preload, and twice that at F/P = 2."""
_ADVISED_SPRING = 0.5  # one flank under P - F and P + F in turn: on average 7 % more compliance than at rest


def advised_ratio(screw: Screw) -> float:
    """F/P to stay below."""
    return _ADVISED_SPRING if screw.preload_by == "spring" else ADVISED


def nut_load(sheet: DataSheet, motion: Motion, load: float, condition: Condition) -> float:
    """Nut load while the acceleration is held: W ± M a ± F_f.

    PA + M a + F_f, PD − M a + F_f, NA − M a − F_f, ND + M a − F_f: friction stands against the way, the
    mass against the acceleration. The weight W of an axis that is not horizontal is the same in all.

    Parameters
    ----------
    sheet : DataSheet
        Gives table, nut, inclination and the guides' friction F_f.
    motion : Motion
        Gives the acceleration a that is reached.
    load : float
        What lies on the table, kg.
    condition : Condition
        Direction, and whether it accelerates.

    Returns
    -------
    float
        F, N; positive where the screw pushes the nut in the positive direction.
    """
    inertia = float(moving_mass(sheet, load)) * motion.peak_acceleration
    along = (inertia if condition.accelerating else -inertia) + float(guide_friction(sheet, load))
    return float(weight_on_nut(sheet, load)) + condition.direction * along


def ringing_load(sheet: DataSheet, motion: Motion, load: float, condition: Condition) -> float:
    """Nut load under which the mode rings in a cell's window.

    A window holds the blow next to standstill. After a departure (PA, NA) the acceleration is on while the
    mode rings. After an arrival (PD, ND) the table stands, and the weight and friction alone are left on the
    nut.

    Parameters
    ----------
    sheet, motion, load, condition
        As in :func:`nut_load`.

    Returns
    -------
    float
        F, N; of an arrival the most that it can be.
    """
    if condition.accelerating:
        return nut_load(sheet, motion, load, condition)
    return float(weight_on_nut(sheet, load)) + condition.direction * float(guide_friction(sheet, load))


def hardest(motions: Sequence[Motion]) -> Motion:
    """The motion that reaches the highest acceleration: with a varied jerk not always the nominal one."""
    return max(motions, key=lambda motion: motion.peak_acceleration)
