"""Recordings of arrays."""

from __future__ import annotations

import copy
import pickle

import h5py
import numpy as np
import pandas as pd
import pint
import pytest
import xarray as xr

import ballscrew
from ballscrew import InputError, Recording

X = np.linspace(0.0, 100.0, 500)


def made(**changes):
    given = {"torque": 0.1 * X, "position": X, "sample_rate": "1 kHz", "units": {"position": "mm"}}
    return Recording.from_arrays(**(given | changes))


def test_units_are_converted_to_si():
    recording = made()
    assert recording.sample_rate == 1000.0
    np.testing.assert_allclose(recording.array("position"), 1e-3 * X)
    np.testing.assert_allclose(recording.array("torque"), 0.1 * X)
    assert recording.channels["position"].attrs["unit"] == "m"


def test_units_of_xarray_and_columns_of_pandas():
    position = xr.DataArray(X, dims="time", attrs={"units": "mm"})
    assert made(position=position, units=None).array("position")[-1] == pytest.approx(0.1)
    table = pd.DataFrame({"torque": X, "acceleration": X, "acceleration_2": X})
    recording = Recording.from_arrays(**table, sample_rate=1000)
    assert list(recording.channels) == ["torque", "acceleration:x", "acceleration:x#2"]


def test_without_an_accelerometer_the_position_gives_the_acceleration_of_the_motor():
    recording = made(position=0.5 * X**2)
    (name,) = recording.of("acceleration", location="motor", direction="x")
    step = X[1] - X[0]
    np.testing.assert_allclose(recording.array(name), 1e-3 * (1000 * step) ** 2, rtol=1e-6)


def test_names_of_a_channel_map(tmp_path):
    path = tmp_path / "channels.toml"
    path.write_text('[[channel]]\nsource = "Mist"\nquantity = "torque"\nunit = "N mm"\n', encoding="utf-8")
    recording = Recording.from_arrays(Mist=X, channels=path, sample_rate=1000)
    assert recording.array("torque")[-1] == pytest.approx(0.1)
    with pytest.raises(InputError, match="Mist"):
        Recording.from_arrays(Moment=X, channels=path, sample_rate=1000)


def test_the_hash_is_that_of_the_content():
    assert made().file.sha256 == made(name="other").file.sha256
    assert made().file.sha256 != made(torque=0.2 * X).file.sha256
    assert made().file.sha256 != made(sample_rate=2000).file.sha256
    assert made().file.sha256 != made(units={"position": "m"}).file.sha256


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"torque": np.zeros((2, 500))}, "one row"),
        ({"torque": ["a"] * 500}, "numbers"),
        ({"torque": X[:10]}, "samples"),
        ({"torque": X[:400]}, "400"),
        ({"moment": X}, "moment"),
        ({"units": {"position": "kg"}}, "kg"),
        ({"units": {"speed": "m/s"}}, "none of its signals"),
        ({"sample_rate": 0.0}, "from 0.001 to"),
        ({"sample_rate": "1 kg"}, "kg"),
    ],
)
def test_wrong_arrays_are_one_sentence(changes, message):
    with pytest.raises(InputError, match=message):
        made(**changes)


def test_no_signals_are_one_sentence():
    with pytest.raises(InputError, match="no signal is given"):
        Recording.from_arrays(sample_rate=1000)


def test_a_file_needs_a_channel_map_and_a_recording_does_not(tmp_path):
    (tmp_path / "trip.csv").write_text("torque [Nm];position [mm]\n0;0\n")
    with pytest.raises(InputError, match="channel map"):
        ballscrew.quality([made(), tmp_path / "trip.csv"])
    assert ballscrew.quality(made()).verdict in ("good", "suspect", "bad")


def test_arrays_give_the_results_of_the_files(bench):
    """Also in any order, with names of their own."""
    channels = ballscrew.read_channels(bench / "channels.toml")
    setup = {"axis": bench / "axis.toml", "plan": bench / "plan.toml", "mass": "100 kg", "method": "paper"}
    files = [bench / f"preload-4-percent-trip{n}.h5" for n in (1, 2, 3)]
    expected = ballscrew.analyze(files, channels=channels, **setup)
    trips = []
    for n, file in enumerate(files):
        read = ballscrew.read_recording(file, channels)
        acceleration = [read.array(name) for name in read.of("acceleration", direction="x")]
        trips.append(
            Recording.from_arrays(
                torque=read.array("torque"),
                position=read.array("position"),
                acceleration=acceleration[0],
                acceleration_2=acceleration[1],
                sample_rate=read.sample_rate,
                name=f"trip {n}",
            )
        )
    run = ballscrew.analyze(trips[::-1], **setup)
    for cell, other in zip(run.cells, expected.cells, strict=True):
        assert cell.frequency_Hz == pytest.approx(other.frequency_Hz, rel=1e-9, nan_ok=True)


def test_its_representation_is_short() -> None:
    lines = repr(made()).splitlines()
    assert lines[0].startswith("<Recording> arrays: ")
    assert "torque in N m" in lines[1]
    assert len("\n".join(lines)) < 400


def test_it_can_be_pickled_and_its_channels_still_not_be_replaced() -> None:
    recording = made()
    for copied in (pickle.loads(pickle.dumps(recording)), copy.deepcopy(recording)):  # noqa: S301  made above
        assert copied.file == recording.file
        assert list(copied.channels) == list(recording.channels)
        for name, values in recording.channels.items():
            assert copied.channels[name].identical(values)
        with pytest.raises(TypeError, match="assignment"):
            copied.channels["torque"] = None


def test_units_of_pint_and_other_names_of_the_attribute():
    registry = pint.UnitRegistry()
    in_pint = registry.Quantity(X, "mm")
    wrapped = xr.DataArray(in_pint, dims="time")
    named = xr.DataArray(X, dims="time", attrs={"Unit": "mm"})
    for position in (in_pint, wrapped, named):
        assert made(position=position, units=None).array("position")[-1] == pytest.approx(0.1)
    with pytest.raises(InputError, match="unit"):
        made(position=registry.Quantity(X, "s"), units=None)
    assert made(units={"position": registry.mm}).array("position")[-1] == pytest.approx(0.1)


def test_the_start_is_a_time():
    assert made(started_at="2026-01-31T08:00").started_at == "2026-01-31T08:00"
    assert made(started_at=pd.Timestamp("2026-01-31T08:00Z")).started_at == "2026-01-31T08:00:00+00:00"
    for wrong in ("yesterday", "2026-01-31T08:00+25:00", pd.NaT, 5):
        with pytest.raises(InputError, match=r"started_at is .* a time in ISO 8601"):
            made(started_at=wrong)


def test_a_start_of_a_file_that_is_no_time_is_ignored_and_noted(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["torque"], file["position"] = 0.1 * X, X
        file.attrs["sample_rate"], file.attrs["started_at"] = 1000.0, "31.01.2026 08:00"
    channels = ballscrew.recording.channels.ChannelMap.from_settings(
        {"channel": [{"source": name, "quantity": name} for name in ("torque", "position")]}
    )
    recording = ballscrew.read_recording(tmp_path / "a.h5", channels)
    assert recording.started_at is None
    assert recording.notes[-1] == "the start '31.01.2026 08:00' is no time in ISO 8601, and is ignored."


def test_a_unit_of_the_map_that_contradicts_the_file_is_noted(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["torque"], file.attrs["sample_rate"] = 0.1 * X, 1000.0
        file["torque"].attrs["unit"] = "N m"

    def read(unit):
        rows = [{"source": "torque", "quantity": "torque", "unit": unit}]
        channels = ballscrew.recording.channels.ChannelMap.from_settings({"channel": rows})
        return ballscrew.read_recording(tmp_path / "a.h5", channels)

    assert read("Nm").notes == ()
    expected = "torque: the channel map has the unit N cm, the file N m; that of the map is used."
    assert read("N cm").notes == (expected,)


def test_times_are_no_samples():
    with pytest.raises(InputError, match="position must be numbers"):
        made(position=pd.Series(pd.Timestamp("2026-01-01") + pd.to_timedelta(X, unit="s")))
