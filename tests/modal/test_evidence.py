"""Cells are found by their names, and named where there is none."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.estimation.made_runs import run_of

from ballscrew.base.errors import InputError
from ballscrew.modal.evidence import find_cell


def test_a_cell_within_a_millimetre_is_found() -> None:
    run = run_of()
    cell = find_cell(run, 0.0459, "PD", 0)
    assert (cell.position_m, cell.condition) == (0.045, "PD")
    with pytest.raises(InputError, match="it has stops at 0, 45, 90, "):
        find_cell(run, 0.0461, "PD", 0)


def test_a_run_without_cells_has_none() -> None:
    with pytest.raises(InputError, match="the run has no cell 45mm:PD:0: no transient was found in it"):
        find_cell(replace(run_of(), cells=()), 0.045, "PD", 0)


def test_cells_of_a_stop_are_named_with_their_motion_where_there_are_several() -> None:
    run = run_of()
    with pytest.raises(InputError, match="no cell 0mm:PD:0; at 0 mm it has PA, ND"):
        find_cell(run, 0.0, "PD", 0)
    gentle = [replace(cell, motion=1) for cell in run.cells]
    both = replace(run, cells=(*run.cells, *gentle))
    with pytest.raises(InputError, match="no cell 0mm:PD:1; at 0 mm it has PA:0, ND:0, PA:1, ND:1"):
        find_cell(both, 0.0, "PD", 1)
    assert find_cell(both, 0.0, "ND", 1).motion == 1
