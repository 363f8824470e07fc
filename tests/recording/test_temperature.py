"""Recorded temperature of the axis."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from ballscrew.base.provenance import FileRef
from ballscrew.recording.recording import Recording
from ballscrew.recording.temperature import temperature_course, trip_temperatures


def recording(**celsius):
    channels = {}
    for place, values in celsius.items():
        attrs = {"quantity": "temperature", "location": place.replace("_", "-"), "sample_rate": 10.0}
        channels[f"temperature:{place}"] = xr.DataArray(np.asarray(values) + 273.15, dims="time", attrs=attrs)
    return Recording(channels, FileRef("trip.h5", "0"), "test", 10.0)


def test_mean_ends_and_range_of_a_run_that_warms_up() -> None:
    trips = [trip_temperatures(recording(nut=np.linspace(start, start + 2, 101))) for start in (20.0, 22.0)]
    course = temperature_course(trips)
    assert course is not None
    assert course.mean_C == pytest.approx(22.0)
    assert (course.start_C, course.end_C) == (pytest.approx(20.1, abs=0.02), pytest.approx(23.9, abs=0.02))
    assert course.range_K == pytest.approx(course.end_C - course.start_C)
    assert course.screw_above_nut_K is None


def test_the_nut_is_the_axis_and_the_screw_is_compared_with_it() -> None:
    course = temperature_course([trip_temperatures(recording(screw_mid=[25.0] * 20, nut_1=[20.0] * 20))])
    assert course is not None
    assert (course.mean_C, course.screw_above_nut_K) == (pytest.approx(20.0), pytest.approx(5.0))


def test_a_sensor_that_is_open_or_that_some_recordings_lack_is_not_used() -> None:
    assert trip_temperatures(recording(nut=[1372.0] * 20)) == {}
    assert trip_temperatures(recording(nut=[20.0] * 9 + [np.nan])) == {}
    assert temperature_course([]) is None
    assert temperature_course([trip_temperatures(recording(nut=[20.0] * 20)), {}]) is None


def test_a_motor_or_the_room_is_not_the_axis_and_another_place_is_named() -> None:
    assert trip_temperatures(recording(motor=[65.0] * 20)) == {}
    assert trip_temperatures(recording(room_wall=[18.0] * 20)) == {}
    channels = recording(x=[65.0] * 20).channels
    for values in channels.values():
        values.attrs |= {"location": "", "source": "Drive/MotorTemp"}
    assert trip_temperatures(Recording(channels, FileRef("trip.h5", "0"), "test", 10.0)) == {}
    course = temperature_course([trip_temperatures(recording(bed=[22.0] * 20, table=[26.0] * 20))])
    assert course is not None
    assert (course.place, course.is_of_axis, course.mean_C) == ("bed", False, pytest.approx(22.0))
    near = temperature_course([trip_temperatures(recording(bed=[22.0] * 20, screw_motor_end=[25.0] * 20))])
    assert near is not None
    assert (near.place, near.is_of_axis) == ("screw", True)
