"""Slope by temperature from runs of a calibration."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from tests.calibration.tables import Errors

from ballscrew.base.errors import InputError
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import TemperatureSlope
from ballscrew.calibration.calibration import calibrate
from ballscrew.calibration.modelfile import model_json, read_model, write_model
from ballscrew.estimation.preload import preload
from ballscrew.recording.temperature import TemperatureCourse

SLOPE = 0.02


def warm(runs, celsius):
    return [replace(run, temperature_C=celsius) for run in runs]


def one_day(experiment, temperatures, loads=(0.0, 100.0), **options):
    """The loads at each temperature, four hours apart, P ∝ exp(SLOPE · T)."""
    runs = []
    for number, celsius in enumerate(temperatures):
        ratio = float(np.exp(SLOPE * (celsius - temperatures[0])))
        hour = f"2026-01-01T{8 + 4 * number:02d}:00Z"
        runs += warm(experiment(number, ratio=ratio, measured_at=hour, loads=loads, **options), celsius)
    return runs


def test_runs_at_several_temperatures_determine_the_slope(experiment, sheet, tmp_path) -> None:
    model = calibrate(one_day(experiment, (20.0, 15.0, 30.0)), sheet)
    assert model.verdict == "good"
    assert model.temperature is not None
    assert model.temperature.standard_uncertainty < 0.005
    assert abs(model.temperature.value - SLOPE) < 3 * model.temperature.standard_uncertainty
    write_model(model, tmp_path / "model.json")
    assert (model.temperature.lowest, model.temperature.highest) == (15.0, 30.0)
    back = read_model(tmp_path / "model.json").temperature
    assert back is not None
    assert (back.value, back.lowest) == (pytest.approx(model.temperature.value), 15.0)


def test_the_slopes_of_many_days_lie_within_their_uncertainty(experiment, sheet) -> None:
    errors = []
    for seed in range(8):
        runs = one_day(lambda number, seed=seed, **o: experiment(10 * seed + number, **o), (20.0, 28.0))
        slope = calibrate(runs, sheet).temperature
        assert slope is not None
        errors.append((slope.value - SLOPE) / slope.standard_uncertainty)
    assert np.sqrt(np.mean(np.square(errors))) < 1.5


def test_one_temperature_or_none_determines_nothing(experiment, sheet) -> None:
    assert calibrate(one_day(experiment, (20.0, 20.5)), sheet).temperature is None
    assert calibrate(experiment(), sheet).temperature is None
    timeless = [replace(run, measured_at=None) for run in one_day(experiment, (20.0, 15.0, 30.0))]
    assert calibrate(timeless, sheet).temperature is None


def test_a_load_is_not_taken_for_the_temperature(experiment, sheet) -> None:
    empty = one_day(experiment, (20.0,), loads=(0.0,))
    loaded = warm(experiment(3, measured_at="2026-01-01T12:00Z", loads=(100.0,)), 30.0)
    assert calibrate([*empty, *loaded], sheet).temperature is None


def test_wear_between_days_is_not_taken_for_the_temperature(experiment, sheet) -> None:
    """Winter with all of the preload, summer with less of it."""
    loads = (0.0, 100.0)
    winter = warm(experiment(0, measured_at="2026-01-10T08:00Z", loads=loads), 18.0)
    summer = warm(experiment(1, ratio=0.85, measured_at="2026-07-10T08:00Z", loads=loads), 33.0)
    model = calibrate([*winter, *summer], sheet)
    assert model.temperature is None
    assert any("differ by 15 K" in note and "wear" in note for note in model.notes)
    worn = warm(experiment(5, ratio=0.7, measured_at="2026-08-10T08:00Z", loads=(0.0,)), 33.0)[0]
    found = preload(worn, model, winter[0]).stiffness_relative_to_baseline
    assert found is not None
    low, high = found.interval
    assert low < 0.7 < high
    mild = [*winter, *warm(summer, 20.0)]
    assert not any("wear" in note for note in calibrate(mild, sheet).notes)


def test_a_wrong_position_and_a_wrong_load_are_in_its_uncertainty(experiment, sheet) -> None:
    runs = one_day(experiment, (20.0, 24.0), errors=Errors(1e-5, 1e-5, 1e-5))
    spreads = []
    for position in (1e-9, 1e-4, 1e-3):
        slope = calibrate(runs, sheet, assumptions=Assumptions(position=position)).temperature
        assert slope is not None
        spreads.append(slope.standard_uncertainty)
    assert spreads[0] < spreads[1] < spreads[2]
    # By 1 mm in each of two runs, at two loads, over 4 K: d ln P = 6/s d ln f, d ln f = slope/2 dx.
    model = calibrate(runs, sheet).model
    assert spreads[2] == pytest.approx(3 * model.slope * 1e-3 / model.share / 4, rel=0.3)


def test_a_warm_screw_makes_the_calibration_suspect(experiment, sheet) -> None:
    course = TemperatureCourse(20.0, 20.0, 20.0, 0.0, 5.0, "nut")
    runs = experiment()
    runs[1] = replace(runs[1], temperature=course)
    model = calibrate(runs, sheet)
    assert [(doubt.name, "14 %" in doubt.text) for doubt in model.reasons] == [("warm-screw", True)]
    runs[1] = replace(runs[1], temperature=replace(course, screw_above_nut_K=1.0))
    assert calibrate(runs, sheet).verdict == "good"


@pytest.mark.parametrize(
    "wrong",
    [{"standard_uncertainty": 0}, {"standard_uncertainty": -0.01}, {"value": 5.0}, {"lowest": -300.0}],
)
def test_an_impossible_slope_in_a_file_is_refused(experiment, sheet, tmp_path, wrong) -> None:
    document = model_json(calibrate(experiment(), sheet))
    slope = {"value": 0.02, "standard_uncertainty": 0.001, "shared": 0, "lowest": 15.0, "highest": 30.0}
    path = tmp_path / "model.json"
    path.write_text(json.dumps(document | {"temperature": slope}))
    assert read_model(path).temperature == TemperatureSlope(**slope)
    path.write_text(json.dumps(document | {"temperature": slope | wrong}))
    with pytest.raises(InputError, match=next(iter(wrong))):
        read_model(path)


def test_another_known_preload_is_not_taken_for_the_temperature(experiment, sheet) -> None:
    new = [replace(run, temperature_C=20.0) for run in experiment(measured_at="2026-01-01T08:00Z")]
    worn = experiment(ratio=0.5, measured_at="2026-03-01T08:00Z", loads=(100.0,))
    worn = [replace(run, temperature_C=30.0) for run in worn]
    known = {new[0].id: Quantity(600.0, 12.0, "N"), worn[0].id: Quantity(300.0, 6.0, "N")}
    assert calibrate([*new, *worn], sheet, known=known).temperature is None
