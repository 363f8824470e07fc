from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from ballscrew.base.errors import InputError
from ballscrew.base.provenance import FileRef
from ballscrew.recording import aligned
from ballscrew.recording.aligned import _from, align
from ballscrew.recording.filters import Filter
from ballscrew.recording.recording import Recording

UNIT = {
    "torque": "N m",
    "force": "N",
    "current": "A",
    "relative torque": "",
    "position": "m",
    "acceleration": "m/s^2",
    "speed": "m/s",
}


def recording(*channels):
    """Channels (name, quantity, location, direction, rate, values)."""
    arrays = {
        name: xr.DataArray(
            values,
            dims="time",
            attrs={
                "quantity": quantity,
                "unit": UNIT[quantity],
                "location": location,
                "direction": direction,
                "sample_rate": float(rate),
                "derived": False,
                "source": name,
            },
        )
        for name, quantity, location, direction, rate, values in channels
    }
    return Recording(arrays, FileRef("trip.h5", "0" * 64), "hdf5", 1000.0)


def wave(rate, frequency=7.0, seconds=2.0):
    return np.sin(2 * np.pi * frequency * np.arange(round(rate * seconds)) / rate)


TORQUE = ("torque", "torque", "", "", 1000, wave(1000))
POSITION = ("position", "position", "", "", 1000, wave(1000))
NUT = ("nut", "acceleration", "nut-1", "x", 1000, wave(1000))


def test_one_rate_is_unchanged():
    got = align(recording(TORQUE, POSITION, NUT))
    assert (got.rate, got.quantity, got.responses) == (1000.0, "torque", ("nut",))
    np.testing.assert_array_equal(got.input, wave(1000))
    assert got.response.shape == (1, 2000)


@pytest.mark.parametrize(("fast", "slow"), [(10000, 1000), (12800, 5120), (2560, 2048), (1500, 1000)])
def test_rates_come_down_to_the_lowest_without_delay(fast, slow):
    got = align(
        recording(
            ("torque", "torque", "", "", slow, wave(slow)),
            ("position", "position", "", "", fast, wave(fast)),
            ("nut", "acceleration", "nut-1", "x", fast, wave(fast)),
        )
    )
    assert got.rate == slow
    inner = slice(60, -60)
    for values in (got.input, got.position, got.response[0]):
        # A delay of one sample of the slow rate would be 2·pi·7/slow: 0.04 at 1 kHz.
        np.testing.assert_allclose(values[inner], wave(slow)[: len(values)][inner], rtol=0, atol=5e-3)
    assert len(got.input) == len(got.position) == got.response.shape[1]


def test_a_slow_position_does_not_lower_the_rate():
    got = align(
        recording(
            ("torque", "torque", "", "", 8000, wave(8000)),
            ("position", "position", "", "", 250, wave(250)),
            ("nut", "acceleration", "nut-1", "x", 8000, wave(8000)),
        )
    )
    assert got.rate == 8000
    # A spline of 7 Hz at 250 Hz; a straight line would be (2 pi 7 / 250)²/8 = 4e-3 off.
    inner = slice(400, -400)
    np.testing.assert_allclose(got.position[inner], wave(8000)[: len(got.position)][inner], rtol=0, atol=1e-5)
    np.testing.assert_array_equal(got.input, wave(8000)[: len(got.input)])


@pytest.mark.parametrize("rate", [250, 1000, 2000])
def test_channels_that_begin_later_are_brought_to_one_time(rate):
    late = 0.003
    time = late + np.arange(round(1.9 * rate)) / rate
    trip = recording(TORQUE, ("position", "position", "", "", rate, np.sin(2 * np.pi * 7 * time)), NUT)
    trip.channels["position"].attrs["start"] = late
    got = align(trip)
    expected = wave(1000)[3:][: len(got.input)]
    np.testing.assert_array_equal(got.input, expected)
    np.testing.assert_allclose(
        got.position[60:-60], expected[60:-60], rtol=0, atol=2e-5 if rate < 2000 else 5e-3
    )
    np.testing.assert_array_equal(got.response[0], expected)


def test_what_lies_above_half_the_lowest_rate_is_filtered_out():
    got = align(
        recording(
            TORQUE, POSITION, ("nut", "acceleration", "nut-1", "x", 10000, wave(10000, frequency=900.0))
        )
    )
    assert np.abs(got.response[0][100:-100]).max() < 0.02


def test_resampling_makes_no_step_at_the_ends():
    line = 5.0 + np.arange(20000) / 10000
    got = align(recording(("torque", "torque", "", "", 10000, line), POSITION, NUT))
    np.testing.assert_allclose(got.input, 5.0 + np.arange(2000) / 1000, rtol=0, atol=1e-3)


def test_torque_goes_before_force_before_current():
    force = ("f", "force", "", "", 1000, wave(1000))
    current = ("i", "current", "", "", 1000, wave(1000))
    assert align(recording(current, force, TORQUE, POSITION, NUT)).quantity == "torque"
    assert align(recording(current, force, POSITION, NUT)).quantity == "force"
    assert align(recording(current, POSITION, NUT)).quantity == "current"


def test_a_torque_in_percent_goes_before_a_current():
    percent = ("p", "relative torque", "", "", 1000, wave(1000))
    current = ("i", "current", "", "", 1000, wave(1000))
    got = align(recording(current, percent, POSITION, NUT))
    assert (got.quantity, got.drive.channels) == ("relative torque", ("p",))


def test_declared_filters_are_undone_and_applied():
    shifted = wave(1000, frequency=7.0)
    trip = recording(TORQUE, POSITION, NUT)
    late = [Filter("delay", time=0.01)]
    trip.channels["torque"].attrs["filtered_by"] = late
    trip.channels["nut"].attrs["filtered_by"] = late
    got = align(trip)
    np.testing.assert_allclose(got.input[:-60], shifted[10:-50], rtol=0, atol=2e-3)
    np.testing.assert_allclose(got.response[0][:-60], shifted[10:-50], rtol=0, atol=2e-3)
    trip.channels["torque"].attrs["followed_by"] = late
    np.testing.assert_allclose(align(trip).input, shifted, rtol=0, atol=1e-9)


def test_the_nut_goes_before_the_motor_and_across_is_omitted():
    motor = ("motor", "acceleration", "motor", "x", 1000, wave(1000))
    across = ("y", "acceleration", "nut-1", "y", 1000, wave(1000))
    plain = ("plain", "acceleration", "", "", 1000, wave(1000))
    assert align(recording(TORQUE, POSITION, motor, across, NUT)).responses == ("nut",)
    assert align(recording(TORQUE, POSITION, motor, across)).responses == ("motor",)
    assert align(recording(TORQUE, POSITION, NUT, plain)).responses == ("nut", "plain")


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        ((POSITION, NUT), r"trip\.h5: no channel is a torque, force or current"),
        ((TORQUE, NUT), r"trip\.h5: no channel is a position"),
        ((TORQUE, POSITION), r"trip\.h5: no channel is an acceleration along the screw"),
        (
            (TORQUE, POSITION, ("y", "acceleration", "nut", "y", 1000, wave(1000))),
            r'along the screw \(axis = "x"\)',
        ),
    ],
)
def test_a_missing_channel_is_named(channels, message):
    with pytest.raises(InputError, match=message):
        align(recording(*channels))


def with_speed(speed_rate, position_rate, speed_step, position_step):
    """Position and speed of a motor, with the accelerations derived from them."""
    position = np.round(wave(position_rate) / position_step) * position_step
    speed = np.round(44 * wave(speed_rate) / speed_step) * speed_step
    made = recording(
        ("torque", "torque", "", "", speed_rate, wave(speed_rate)),
        ("position", "position", "", "", position_rate, position),
        ("speed", "speed", "", "", speed_rate, speed),
        ("by position", "acceleration", "motor", "x", position_rate, wave(position_rate)),
        ("by speed", "acceleration", "motor", "x", speed_rate, wave(speed_rate)),
    )
    made.channels["by position"].attrs.update(derived=True, derive="second-derivative", source="position")
    made.channels["by speed"].attrs.update(derived=True, derive="derivative", source="speed")
    return made


@pytest.mark.parametrize(
    ("signals", "used"),
    [
        ((4000, 250, 1e-3, 1e-6), "by speed"),
        ((250, 4000, 1e-6, 1e-3), "by position"),
        ((4000, 4000, 1e-2, 1e-6), "by position"),
        ((4000, 4000, 1e-3, 1e-5), "by speed"),
    ],
)
def test_the_motor_moves_by_the_better_of_speed_and_position(signals, used):
    got = align(with_speed(*signals))
    assert got.responses == (used,)
    assert (got.motor is not None) == (used == "by speed")
    if got.motor is not None:
        assert got.rate == 4000.0
        np.testing.assert_array_equal(got.motor, got.response[0])


def test_the_speed_is_the_motors_beside_accelerometers():
    signals = with_speed(4000, 250, 1e-3, 1e-6)
    nut = recording(("nut", "acceleration", "nut-1", "x", 2000, wave(2000))).channels["nut"]
    got = align(Recording({**signals.channels, "nut": nut}, signals.file, "hdf5", 4000.0))
    assert (got.responses, got.rate) == (("nut",), 2000.0)
    inner = slice(60, len(got.motor) - 60)
    np.testing.assert_allclose(got.motor[inner], wave(2000)[inner], atol=1e-3)


def test_a_speed_that_is_the_only_response_is_resampled_once(monkeypatch):
    rates = []
    monkeypatch.setattr(aligned, "_from", lambda x, rate, *_: rates.append(rate) or x)
    align(with_speed(4000, 250, 1e-3, 1e-6))
    assert sorted(rates) == [250.0, 4000.0, 4000.0]  # position, torque, speed


def test_a_missing_sample_stays_missing_and_the_others_are_interpolated():
    x = np.arange(100.0)
    x[50] = np.nan
    found = _from(x, 1000.0, 1500.0, 0.0)
    rows = np.arange(found.size) / 1.5
    touched = np.abs(rows - 50) < 1
    assert np.isnan(found[touched]).all()
    np.testing.assert_allclose(found[~touched], rows[~touched], atol=1e-12)
