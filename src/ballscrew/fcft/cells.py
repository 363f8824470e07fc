"""The cells of a plan: all that is measured apart and averaged within."""

from __future__ import annotations

from dataclasses import dataclass

from ballscrew.fcft.conditions import Condition, conditions_at
from ballscrew.fcft.plan import Plan


@dataclass(frozen=True, slots=True)
class Cell:
    """One (mass, position, condition, motion).

    Parameters
    ----------
    mass : float
        Load on the table, kg.
    position : float
        The stop, m.
    condition : Condition
        How the table reaches or leaves it.
    motion : int
        Which of the plan's motions, from 0.
    """

    mass: float
    position: float
    condition: Condition
    motion: int


def cells(plan: Plan) -> tuple[Cell, ...]:
    """All cells of a plan.

    Parameters
    ----------
    plan : Plan
        With n stops.

    Returns
    -------
    tuple of Cell
        4 n − 4 for each mass and motion, by mass, motion, position, condition.
    """
    count = len(plan.positions)
    return tuple(
        Cell(mass, position, condition, motion)
        for mass in plan.masses
        for motion in range(len(plan.motions))
        for index, position in enumerate(plan.positions)
        for condition in conditions_at(index, count)
    )
