"""Change of the frequency of each cell, with its uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.estimation.made_runs import run_of

from ballscrew.base.errors import InputError
from ballscrew.calibration.assumptions import REPEATS
from ballscrew.estimation.frequency_change import frequency_changes
from ballscrew.modal.cell import SharedError
from ballscrew.modal.run import Run


def with_shared(run: Run, effect: float, *, repeats: bool) -> Run:
    """A run whose cells have a standard uncertainty of 0.5 Hz, of which one error is shared."""
    cells = tuple(replace(cell, standard_uncertainty_Hz=0.5, uncertainty_terms_Hz={}) for cell in run.cells)
    return replace(run, cells=cells, shared_errors=(SharedError("clock", repeats, (effect,) * len(cells)),))


def test_the_change_of_every_cell_is_the_difference_of_its_frequencies() -> None:
    run, before = run_of(0.7), run_of(1.0)
    changes = frequency_changes(run, before)
    assert len(changes) == len(run.cells)
    for cell, other in zip(run.cells, before.cells, strict=True):
        assert changes[cell.key].value == pytest.approx(cell.frequency_Hz - other.frequency_Hz)  # type: ignore[operator]


@pytest.mark.parametrize(
    ("repeats", "axis", "variance"),
    [
        (True, "bench", 2 * (0.25 - 0.16) + 2 * 0.16 * (1 - REPEATS)),
        (True, "another", 2 * 0.25),
        (False, "bench", 2 * 0.25),
    ],
)
def test_errors_that_repeat_cancel_on_one_axis_only(repeats: bool, axis: str, variance: float) -> None:
    run = with_shared(run_of(0.7), 0.4, repeats=repeats)
    before = replace(with_shared(run_of(1.0), 0.4, repeats=repeats), axis=axis)
    found = [change.standard_uncertainty for change in frequency_changes(run, before).values()]
    assert np.allclose(found, np.sqrt(variance))


def test_cells_of_one_run_only_have_no_change() -> None:
    run, before = run_of(0.7), run_of(1.0)
    assert len(frequency_changes(replace(run, cells=run.cells[:3]), before)) == 3
    refused = replace(before.cells[0], frequency_Hz=None, standard_uncertainty_Hz=None, verdict="refused")
    partly = replace(before, cells=(refused, *before.cells[1:]))
    assert len(frequency_changes(run, partly)) == len(run.cells) - 1
    assert frequency_changes(replace(run, cells=run.cells[:1]), replace(before, cells=before.cells[1:])) == {}


def test_a_run_without_a_load_is_refused() -> None:
    with pytest.raises(InputError, match="mass_kg"):
        frequency_changes(replace(run_of(), mass_kg=None), run_of())
