"""Runs by two methods are not mixed."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.estimation.made_runs import calibrated, run_of

from ballscrew.base.errors import InputError
from ballscrew.calibration.calibration import calibrate
from ballscrew.calibration.method import common_method, method_of
from ballscrew.estimation.preload import preload
from ballscrew.modal.run import Run


def by_paper(run: Run) -> Run:
    return replace(run, cells=tuple(replace(cell, method="paper") for cell in run.cells))


def test_the_method_of_a_run() -> None:
    run = run_of()
    assert method_of(run) == "joint"
    assert method_of(by_paper(run)) == "paper"
    assert method_of(replace(run, cells=())) is None
    assert common_method([replace(run, cells=()), run]) == "joint"
    assert common_method([]) is None


def test_a_run_and_a_baseline_by_two_methods_are_refused() -> None:
    with pytest.raises(InputError, match=r"by method joint.*by method paper"):
        preload(by_paper(run_of(0.8)), calibrated(), run_of(name="base"))


def test_a_model_by_another_method_is_refused() -> None:
    model = calibrated()
    by_paper_model = replace(model, runs=tuple(replace(run, method="paper") for run in model.runs))
    with pytest.raises(InputError, match="calibrated with runs by method paper"):
        preload(run_of(0.8), by_paper_model, run_of(name="base"))
    assert preload(by_paper(run_of(0.8)), by_paper_model, by_paper(run_of(name="base"))).preload_N is not None
    assert preload(run_of(0.8), model).preload_N is not None  # an older model does not state its method


def test_runs_by_two_methods_are_not_calibrated_together(sheet) -> None:
    with pytest.raises(InputError, match="must be by the same method"):
        calibrate([run_of(), by_paper(run_of(name="other"))], sheet)


def test_frequencies_of_the_paper_are_reported_as_of_a_loaded_nut() -> None:
    found = preload(by_paper(run_of(0.8)), calibrated(), by_paper(run_of(name="base")))
    assert any("nut under load" in note for note in found.notes)
    assert not any("nut under load" in note for note in preload(run_of(0.8), calibrated()).notes)
