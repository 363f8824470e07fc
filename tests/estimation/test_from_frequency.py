"""Preload from frequencies without a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.estimation.made_runs import LOAD, MODEL, STOPS, calibrated, run_of

from ballscrew.axis.axial import frequency
from ballscrew.base.errors import InputError
from ballscrew.base.provenance import Made
from ballscrew.base.quantity import Quantity
from ballscrew.estimation.from_frequency import preload_from_frequency
from ballscrew.estimation.preload import preload
from ballscrew.modal.natural_frequency import NaturalFrequency
from ballscrew.testbed.example import AXIS


def measured(position, ratio, uncertainty=0.1):
    f = np.atleast_1d(frequency(MODEL, position, LOAD, ratio))
    return [Quantity(float(value), uncertainty, "Hz") for value in f]


@pytest.mark.parametrize("ratio", [0.3, 0.8, 1.2])
def test_the_preload_that_a_frequency_was_made_of_is_found(ratio):
    (f,) = measured(0.225, ratio)
    estimate = preload_from_frequency(f, calibrated(), "225 mm", "100 kg")
    assert estimate.preload_N.value == pytest.approx(ratio * MODEL.preload, rel=1e-6)
    low, high = estimate.preload_N.interval
    assert low < ratio * MODEL.preload < high
    assert estimate.relative_to_baseline is None


def test_a_baseline_gives_the_change_with_a_smaller_uncertainty():
    estimate = preload_from_frequency(
        measured(STOPS, 0.7), calibrated(), STOPS, LOAD, baseline=measured(STOPS, 1.0)
    )
    assert estimate.stiffness_relative_to_baseline.value == pytest.approx(0.7, rel=1e-6)
    change, absolute = estimate.stiffness_relative_to_baseline, estimate.relative_to_model
    assert change.standard_uncertainty < 0.5 * absolute.standard_uncertainty


def test_it_is_the_estimate_of_a_run_with_these_frequencies():
    run = run_of(0.8, stops=STOPS[:2])
    f = [Quantity(cell.frequency_Hz, cell.standard_uncertainty_Hz, "Hz") for cell in run.cells]
    own = tuple(replace(cell, uncertainty_terms_Hz={}) for cell in run.cells)
    expected = preload(replace(run, cells=own), calibrated())
    found = preload_from_frequency(f, calibrated(), [cell.position_m for cell in run.cells], LOAD)
    assert found.relative_to_model == expected.relative_to_model


def test_more_frequencies_determine_more():
    one = preload_from_frequency(measured(0.1, 0.8, 1.0), calibrated(), [0.1], LOAD)
    nine = preload_from_frequency(measured([0.1] * 9, 0.8, 1.0), calibrated(), np.full(9, 0.1), LOAD)
    assert nine.fused.random == pytest.approx(one.fused.random / 3, rel=0.02)


def test_doubts_of_a_natural_frequency_are_those_of_the_preload():
    (f,) = measured(0.1, 0.8)
    mode = NaturalFrequency(f, Quantity(0.03, 0.001), 0.1, 1, "suspect", ("one transient alone",))
    estimate = preload_from_frequency(mode, calibrated(), 0.1, LOAD)
    assert estimate.verdict == "suspect"
    assert "one transient alone" in estimate.reasons[0]


def test_a_data_sheet_alone_is_suspect_and_wide_and_a_change_by_it_is_not_wide():
    f = Quantity(150.0, 0.1, "Hz")
    alone = preload_from_frequency(f, AXIS, 0.1, 100)
    assert alone.verdict == "suspect"
    assert any("no run has calibrated the axis" in reason for reason in alone.reasons)
    low, high = alone.preload_N.interval
    assert high > 8 * low
    change = preload_from_frequency(f, AXIS, 0.1, 100, baseline=Quantity(153.0, 0.1, "Hz"))
    low, high = change.stiffness_relative_to_baseline.interval
    assert low < high < 1
    accepted = preload_from_frequency(f, AXIS, 0.1, 100, baseline=f, accept=["not-calibrated"])
    assert accepted.verdict == "good"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frequency": 150.0}, r"the frequency is 150.0; it must be a Quantity in Hz"),
        ({"frequency": Quantity(150.0, 0.0)}, "it must be a Quantity in Hz with a standard uncertainty"),
        ({"frequency": Quantity(0.15, 0.01, "kg")}, "the unit 'kg' is not one that can be turned into Hz"),
        ({"frequency": Quantity(-1.0, 1.0)}, "the frequency in Hz is -1"),
        ({"frequency": [Quantity(150.0, 1.0)] * 2}, "each frequency needs a position; 2 and 1 were given"),
        ({"position": "225"}, "the model: the position is 225 m"),
        ({"position": []}, "no position was given"),
        ({"position": None}, "None is not a number"),
        ({"load": "-3 kg"}, "the load in kg is -3"),
    ],
)
def test_what_is_wrong_is_refused_in_a_sentence(changes, message):
    model = replace(calibrated(), made=Made({"sheet": AXIS.to_settings()}))
    given = {"frequency": Quantity(150.0, 0.1), "model": model, "position": 0.1, "load": LOAD} | changes
    with pytest.raises(InputError, match=message):
        preload_from_frequency(**given)


def test_other_units_of_a_frequency_are_converted():
    in_hz, in_khz = (
        preload_from_frequency(f, calibrated(), 0.225, LOAD)
        for f in (Quantity(150.0, 0.1, "Hz"), Quantity(0.15, 1e-4, "kHz"))
    )
    assert in_khz.to_json() == in_hz.to_json()
    for wrong in (Quantity(150.0, 0.1, "mm"), Quantity(1e6, 1.0, "Hz")):
        with pytest.raises(InputError, match="Hz"):
            preload_from_frequency(wrong, calibrated(), 0.225, LOAD)
