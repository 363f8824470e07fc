from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.axis_sampling import random_axis
from tests.recording.quality.test_motion import delay_of
from tests.recording.synthetic import changed, recorded, synthetic_trip

from ballscrew.recording.aligned import align
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.phases import find_phases
from ballscrew.recording.quality.delay import (
    Synchronisation,
    _are_exchanged,
    compare_with_encoder,
    derived_responses,
)
from ballscrew.recording.quality.lowband import low_band, two_masses
from ballscrew.testbed.trip import simulate_trip


def twin(seed, **servo):
    """One trip of a random axis with friction as LuGre has it, and by how much its torque is told late."""
    axis = random_axis(seed)
    rig = replace(axis.rig, servo=replace(axis.rig.servo, **servo), disturbances=axis.rig.disturbances)
    channels = simulate_trip(rig, axis.plan, axis.plan.motions[0], axis.load, 1)
    stored = ("torque", "position", "acc1_x", "acc2_x")
    return recorded({name: channels[name] for name in stored}), rig.instruments.torque_delay


def step_of(recording):
    aligned = align(recording)
    band = low_band(aligned, find_phases(kinematics(aligned.position, aligned.rate)))
    return band, compare_with_encoder(band, derived=(False,) * len(aligned.responses))


@pytest.mark.parametrize("seed", [34, 39, 51])
def test_friction_and_servo_bend_no_delay(seed):
    """On these axes a torque that is read near standstill seems 0.2 to 0.3 ms late or early."""
    recording, late = twin(seed)
    found, scatter = delay_of(recording)
    assert abs(found + late) < 0.06e-3
    assert 0 < scatter < 0.1e-3


@pytest.mark.parametrize("ahead", [0.3, 1.0])
def test_what_is_fed_forward_bends_no_delay(ahead):
    recording, late = twin(5, mass_ahead=ahead)
    assert abs(delay_of(recording)[0] + late) < 0.06e-3


def test_a_delay_is_measured_where_friction_bends_the_torque():
    recording, late = twin(39)
    later = changed(recording, lambda _, x: np.roll(x, 6), "torque")
    assert delay_of(later)[0] + late == pytest.approx(-6 / 12800, abs=0.06e-3)


def test_a_table_that_is_reported_late_shifts_the_torque_by_nothing():
    trip = recorded(synthetic_trip())
    late = changed(trip, lambda _, x: np.roll(x, 20), "acc1_x", "acc2_x")
    (_, item), (_, other) = step_of(trip), step_of(late)
    assert other.masses.fit.late == pytest.approx(item.masses.fit.late, abs=0.02e-3)


def test_the_two_masses_are_those_of_the_axis():
    _, step = step_of(recorded(synthetic_trip()))
    assert step.masses.fit.gain == pytest.approx(step.drive.gain, rel=0.02)
    assert step.masses.fit.explained > 0.999


def test_without_an_accelerometer_there_are_none():
    band, _ = step_of(recorded(synthetic_trip()))
    assert two_masses(band, []) is None


def test_an_axis_that_stands_has_none():
    band, step = step_of(recorded(synthetic_trip()))
    still = replace(band, place=0 * band.place)
    assert two_masses(still, [(0, step.responses[0])]) is None


def test_a_torque_that_is_none_has_no_delay():
    band, step = step_of(recorded(synthetic_trip()))
    found = two_masses(replace(band, raw_drive=0 * band.raw_drive), [(0, step.responses[0])])
    assert found is None or not found.fit.explained > 0.5


@pytest.mark.parametrize("signal", ["raw_response", "raw_drive"])
def test_signals_that_are_missing_determine_no_masses(signal):
    recording = recorded(synthetic_trip())
    band, found = step_of(recording)
    assert found.masses is not None
    missing = replace(band, **{signal: np.full_like(getattr(band, signal), np.nan)})
    true = [(index, fit) for index, fit in enumerate(found.responses) if fit is not None]
    assert two_masses(band, true) is not None
    with np.errstate(all="ignore"):
        assert two_masses(missing, true) is None


def test_without_a_torque_there_is_no_delay_behind_it():
    late, spread = Synchronisation(None, ()).delay
    assert np.isnan([late, spread]).all()


def test_a_record_of_two_samples_has_no_response_that_is_derived():
    aligned = align(recorded(synthetic_trip()))
    short = replace(aligned, position=aligned.position[:2], response=aligned.response[:, :2])
    assert derived_responses(short) == (False, False)
    assert derived_responses(aligned) == (False, False)
    own = np.zeros_like(aligned.response)
    own[0, 1:-1] = np.diff(aligned.position, 2) * aligned.rate**2
    assert derived_responses(replace(aligned, response=own)) == (True, False)


def test_a_constant_torque_is_not_exchanged_with_the_position():
    aligned = align(recorded(synthetic_trip()))
    exchanged = replace(aligned, input=aligned.position, position=aligned.input)
    assert _are_exchanged(exchanged)
    assert not _are_exchanged(replace(exchanged, input=np.full_like(aligned.input, 0.1)))
