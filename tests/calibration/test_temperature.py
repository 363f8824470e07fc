"""Slope by temperature from runs of a calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballscrew.base.quantity import Quantity
from ballscrew.calibration.calibration import calibrate
from ballscrew.calibration.modelfile import read_model, write_model

SLOPE = 0.02


def days(experiment, temperatures):
    """Two loads at each temperature, a day apart, P ∝ exp(SLOPE · T)."""
    runs = []
    for number, celsius in enumerate(temperatures):
        ratio = float(np.exp(SLOPE * (celsius - temperatures[0])))
        day = f"2026-01-0{1 + 2 * number}T08:00Z"
        found = experiment(number, ratio=ratio, measured_at=day, loads=(0.0, 100.0))
        runs += [replace(run, temperature_C=celsius) for run in found]
    return runs


def test_runs_at_several_temperatures_determine_the_slope(experiment, sheet, tmp_path) -> None:
    model = calibrate(days(experiment, (20.0, 15.0, 30.0)), sheet)
    assert model.temperature is not None
    assert model.temperature.standard_uncertainty < 0.005
    assert abs(model.temperature.value - SLOPE) < 3 * model.temperature.standard_uncertainty
    write_model(model, tmp_path / "model.json")
    back = read_model(tmp_path / "model.json").temperature
    assert back is not None
    assert back.value == pytest.approx(model.temperature.value)


def test_one_temperature_or_none_determines_nothing(experiment, sheet) -> None:
    assert calibrate(days(experiment, (20.0, 20.5)), sheet).temperature is None
    assert calibrate(experiment(), sheet).temperature is None


def test_another_known_preload_is_not_taken_for_the_temperature(experiment, sheet) -> None:
    new = [replace(run, temperature_C=20.0) for run in experiment(measured_at="2026-01-01T08:00Z")]
    worn = experiment(ratio=0.5, measured_at="2026-03-01T08:00Z", loads=(100.0,))
    worn = [replace(run, temperature_C=30.0) for run in worn]
    known = {new[0].id: Quantity(600.0, 12.0, "N"), worn[0].id: Quantity(300.0, 6.0, "N")}
    assert calibrate([*new, *worn], sheet, known=known).temperature is None
