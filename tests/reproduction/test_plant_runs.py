"""Runs of the simulated plant that imitate an analysed one."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from tests.store.stored import RUNS

from ballscrew.base.quantity import Quantity
from ballscrew.reproduction.plant import PLANT
from ballscrew.reproduction.plant_runs import TrueState, imitate_run, make_history

PRESENT = datetime(2026, 5, 1, 12, tzinfo=UTC)
STOPS = len({cell.position_m for cell in RUNS[0].cells})


def state(preload: float, frequency: float = 100.0) -> TrueState:
    frequencies = np.full(STOPS, frequency)
    return TrueState(frequencies, frequencies, preload, 50.0)


def test_an_axis_without_a_calibration_has_neither_runs_nor_model() -> None:
    """Its recordings are stored, and not analysed."""
    axis = replace(PLANT[-1], calibrated=False)
    history = make_history(axis, PRESENT, 0, {})
    assert (history.runs, history.model, history.template) == ({}, None, None)


def test_the_mass_over_the_preload_grows_as_the_preload_is_lost() -> None:
    over = Quantity(0.1, 0.01, "kg/N")
    template = replace(RUNS[0], mass_over_preload_kg_per_N=over)
    random = np.random.default_rng(0)
    found = [
        imitate_run(template, state(600.0), state(300.0), random).mass_over_preload_kg_per_N
        for _ in range(100)
    ]
    values = np.array([each.value for each in found if each is not None])
    assert len(values) == 100
    assert np.log(values / over.value).mean() == pytest.approx(np.log(2), abs=0.01)
    assert np.log(values).std() == pytest.approx(0.03, rel=0.3)
    for each in found:
        assert each is not None
        assert each.standard_uncertainty / each.value == pytest.approx(0.1)
        assert each.unit == "kg/N"


def test_a_cell_without_a_frequency_stays_without_and_the_others_move() -> None:
    missing = replace(RUNS[0].cells[1], frequency_Hz=None, standard_uncertainty_Hz=None, verdict="refused")
    template = replace(RUNS[0], cells=(RUNS[0].cells[0], missing, *RUNS[0].cells[2:]))
    random = np.random.default_rng(0)
    run = imitate_run(template, state(600.0, 100.0), state(600.0, 90.0), random)
    assert run.cells[1] == missing
    for cell, former in zip(run.cells, template.cells, strict=True):
        if cell is not run.cells[1]:
            assert cell.frequency_Hz == pytest.approx(0.9 * (former.frequency_Hz or 0.0), rel=0.01)
