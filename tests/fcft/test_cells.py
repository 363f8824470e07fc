from __future__ import annotations

import pytest

from ballscrew.fcft.cells import Cell, cells
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.plan import Motion, Plan, read_plan


def test_the_cells_of_the_bench(bench):
    got = cells(read_plan(bench / "plan.toml"))
    assert len(got) == len(set(got)) == 40
    assert got[0] == Cell(100.0, 0.0, Condition.PA, 0)
    assert got[-1] == Cell(100.0, 0.45, Condition.NA, 0)


@pytest.mark.parametrize(("stops", "masses", "motions"), [(2, 1, 1), (11, 3, 2), (5, 2, 1)])
def test_how_many_there_are(stops, masses, motions):
    plan = Plan(
        tuple(0.01 * i for i in range(stops)),
        1,
        tuple(10.0 * i for i in range(masses)),
        tuple(Motion(0.1, 1.0 + i, 100.0, 0.1) for i in range(motions)),
    )
    got = cells(plan)
    assert len(got) == len(set(got)) == (4 * stops - 4) * masses * motions
    assert {cell.motion for cell in got} == set(range(motions))
