from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballscrew.base.errors import InputError
from ballscrew.recording.channels import Channel, ChannelMap, read_channels
from ballscrew.recording.convert import _check_values, rate_from_time, second_derivative
from ballscrew.recording.load import read_recording

N = 200
T = np.arange(N) / 1000.0
TORQUE = {"source": "torque", "quantity": "torque"}
POSITION = {"source": "pos", "quantity": "position", "unit": "mm"}


def made(*rows: dict[str, Any], **top: Any) -> ChannelMap:
    return ChannelMap.from_settings({"channel": list(rows), **top}, "channels.toml")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "trip.h5"
    with h5py.File(path, "w") as file:
        file["torque"] = np.sin(T).astype(np.float32)
        file["pos"] = 1000 * 0.5 * 3.0 * T**2
        file["temp"] = np.full(20, 23.0)
        file["temp"].attrs["unit"] = "°C"
        file["temp"].attrs["sample_rate"] = 100.0
        file["t"] = T * 1000
        file["short"] = np.zeros(15)
        file["odd"] = np.zeros(N - 1)
        file["strange"] = np.zeros(N)
        file["strange"].attrs["unit"] = "furlongs per bushel"
        file["stopped"] = np.zeros(N)
    return path


def test_values_in_si_and_labels(path: Path) -> None:
    derived = {
        "source": "pos",
        "quantity": "acceleration",
        "derive": "second-derivative",
        "location": "motor",
    }
    temperature = {"source": "temp", "quantity": "temperature", "sample_rate": "100 Hz"}
    recording = read_recording(path, made(TORQUE, POSITION, derived, temperature, sample_rate="1 kHz"))
    assert recording.file.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert (recording.file.name, recording.reader, recording.sample_rate) == ("trip.h5", "hdf5", 1000.0)
    assert recording.array("torque").dtype == np.float64
    np.testing.assert_allclose(recording.array("position"), 1.5 * T**2, atol=1e-12)
    np.testing.assert_allclose(recording.array("acceleration:motor"), np.full(N, 3.0), rtol=1e-6)
    np.testing.assert_allclose(recording.array("temperature"), 296.15)
    assert recording.channels["temperature"].attrs["unit"] == "kelvin"
    assert recording.channels["acceleration:motor"].attrs["derived"] is True
    assert recording.of("acceleration", location="motor") == ["acceleration:motor"]
    assert recording.of("acceleration", location="nut") == []
    assert recording.notes == ("torque: no unit is given, so N m is assumed.",)


def test_a_derived_channel_has_the_filters_of_its_source(path: Path) -> None:
    average = [{"type": "moving average", "time": "1 ms"}]
    speed = {"source": "pos", "quantity": "speed", "unit": "mm/s", "filtered_by": average}
    derived = {"source": "pos", "quantity": "acceleration", "derive": "derivative", "location": "motor"}
    recording = read_recording(path, made(TORQUE, POSITION, speed, derived, sample_rate="1 kHz"))
    np.testing.assert_allclose(recording.array("acceleration:motor")[1:-1], 3.0 * T[1:-1], rtol=1e-6)
    (filtered,) = recording.channels["acceleration:motor"].attrs["filtered_by"]
    assert (filtered.type, filtered.time) == ("moving average", 1e-3)


def test_scale_comes_before_the_unit_and_offset_with_it(path: Path) -> None:
    recording = read_recording(path, made(POSITION | {"scale": -2, "offset": 10}, sample_rate=1000))
    np.testing.assert_allclose(recording.array("position"), -3.0 * T**2 + 0.010, atol=1e-12)


def test_own_rate_goes_before_the_maps_and_the_files(path: Path) -> None:
    with h5py.File(path, "a") as file:
        file.attrs["sample_rate"] = 900.0
    own = read_recording(path, made(TORQUE | {"sample_rate": "1100 Hz"}, sample_rate="1 kHz"))
    assert (own.sample_rate, own.declared_rate, own.file_rate) == (1100.0, 1100.0, 900.0)
    declared = read_recording(path, made(TORQUE, sample_rate="1 kHz"))
    assert (declared.rate("torque"), declared.declared_rate) == (1000.0, 1000.0)
    undeclared = read_recording(path, made(TORQUE))
    assert (undeclared.sample_rate, undeclared.declared_rate, undeclared.file_rate) == (900.0, None, 900.0)


def test_the_rate_from_the_time_channel(path: Path) -> None:
    recording = read_recording(path, made({"source": "t", "quantity": "time", "unit": "ms"}, TORQUE))
    assert recording.sample_rate == pytest.approx(1000.0)
    assert recording.time is not None
    np.testing.assert_allclose(recording.time, T)
    assert list(recording.channels) == ["torque"]


@pytest.mark.parametrize(
    ("rows", "top", "message"),
    [
        (
            [{"source": "torqe", "quantity": "torque"}],
            {},
            "has no channel 'torqe' (channels.toml: channel[0].source)",
        ),
        ([{"source": "torqe", "quantity": "torque"}], {}, "did you mean 'torque'? it has odd, pos, short"),
        ([{"source": "zzzz", "quantity": "torque"}], {}, "channel[0].source); it has"),
        ([TORQUE], {}, "no sample rate of 'torque' was found; declare sample_rate in channels.toml"),
        ([TORQUE, {"source": "short", "quantity": "force"}], {"sample_rate": 1000}, "'short' has 15 samples"),
        (
            [TORQUE, {"source": "odd", "quantity": "force"}],
            {"sample_rate": 1000},
            "'odd' has 199; channels of one rate",
        ),
        ([TORQUE, {"source": "odd", "quantity": "time"}], {"sample_rate": 1000}, "must have the same number"),
        (
            [{"source": "strange", "quantity": "force"}],
            {"sample_rate": 1000},
            "the unit 'furlongs per bushel'",
        ),
        ([TORQUE, {"source": "stopped", "quantity": "time"}], {}, "time channel does not increase"),
        ([{"source": "t", "quantity": "time"}], {}, "nothing but the time"),
    ],
)
def test_what_is_refused(path: Path, rows: list[dict[str, Any]], top: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        read_recording(path, made(*rows, **top))
    assert message in str(caught.value)


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf, 1e300, 1e-300])
def test_an_impossible_rate_in_the_file(path: Path, rate: float) -> None:
    with h5py.File(path, "a") as file:
        file.attrs["sample_rate"] = rate
    with pytest.raises(InputError, match=r"must be from 0\.001 to 1e\+09 Hz"):
        read_recording(path, made(TORQUE))
    assert read_recording(path, made(TORQUE, sample_rate=1000)).sample_rate == 1000.0


def test_only_mapped_channels_are_read(path: Path) -> None:
    with h5py.File(path, "a") as file:
        file.create_dataset("bomb", (10**13,), "f8", chunks=(1000,))
    assert list(read_recording(path, made(TORQUE, sample_rate=1000)).channels) == ["torque"]


@given(
    rate=st.floats(1.0, 1e5),
    count=st.integers(64, 2000),
    start=st.floats(-10, 10),
    lost=st.integers(0, 3),
)
def test_rate_from_time_with_lost_samples(rate: float, count: int, start: float, lost: int) -> None:
    index = np.arange(count + lost)
    index = np.delete(index, [count // 2] * lost)
    assert rate_from_time(start + index / rate) == pytest.approx(rate, rel=1e-6)


def test_rate_from_coarse_times() -> None:
    assert rate_from_time(np.floor(np.arange(12800) / 12.8) / 1000) == pytest.approx(12800, rel=2e-3)
    assert np.isnan(rate_from_time(np.full(100, np.nan)))
    assert np.isnan(rate_from_time(-np.arange(100.0)))


def test_the_time_channel_of_every_file_gives_the_same_rate(tmp_path: Path) -> None:
    """Digits that are rounded, and a start that differs, change the rate by less than 1 ppm."""
    rates = set()
    for start in (0.0, 17.123456):
        rows = [f"{start + index / 12800:.6f},1" for index in range(12800)]
        path = tmp_path / f"{start:.0f}.csv"
        path.write_text("\n".join(["t [s],torque [Nm]", *rows]))
        time = {"source": "t [s]", "quantity": "time"}
        rates.add(
            read_recording(path, made(time, {"source": "torque [Nm]", "quantity": "torque"})).sample_rate
        )
    assert rates == {12800.0}


@given(a=st.floats(-10, 10), b=st.floats(-1, 1), rate=st.sampled_from([100.0, 1000.0, 12800.0]))
def test_second_derivative_of_a_parabola(a: float, b: float, rate: float) -> None:
    t = np.arange(50) / rate
    acceleration = second_derivative(0.5 * a * t**2 + b * t, rate)
    assert acceleration.shape == t.shape
    np.testing.assert_allclose(acceleration, a, atol=1e-15 * rate**2 * 10)


def test_the_bench(bench: Path) -> None:
    recording = read_recording(bench / "preload-2-percent-trip3.h5", read_channels(bench / "channels.toml"))
    assert recording.sample_rate == recording.file_rate == recording.declared_rate == 12800.0
    assert recording.array("position").max() == pytest.approx(0.45, abs=1e-4)


def test_the_real_drive(emps: Path) -> None:
    channels = read_channels(emps / "channels.toml")
    assert channels.sample_rate == 1000.0
    assert channels.channels[2] == Channel(
        "qm", "acceleration", "m/s^2", location="motor", direction="x", derive="second-derivative"
    )
    recording = read_recording(emps / "DATA_EMPS.mat", channels)
    assert list(recording.channels) == ["force", "position", "acceleration:motor:x"]
    assert (recording.sample_rate, recording.file_rate) == (1000.0, None)
    assert recording.array("force")[0] == pytest.approx(35.15065188248547 * 2.53862809, rel=1e-6)


def test_of_many_channels_the_first_are_listed_and_how_many_more_there_are(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", **{f"x{number:02}": np.zeros(100) for number in range(40)})
    channels = ChannelMap.from_settings({"channel": [{"source": "y", "quantity": "torque", "unit": "N m"}]})
    with pytest.raises(InputError, match=r"has no channel 'y' .* it has x00, .*, x29 and 10 more\.$"):
        read_recording(tmp_path / "a.npz", channels)


@pytest.mark.parametrize("values", [[1.0] * 100, np.zeros((10, 10)), np.zeros(100, dtype=int), np.zeros(())])
def test_what_a_reader_of_another_package_gives_is_checked(values: object) -> None:
    with pytest.raises(
        InputError, match=r"a\.h5: the reader gave no row of numbers for the channel 'torque'"
    ):
        _check_values(Path("a.h5"), "torque", values)


def test_times_that_are_not_finite_are_left_out_of_the_rate_without_a_warning() -> None:
    time = np.arange(1600) / 100.0
    time[[200, 300]] = np.inf  # with a step of 100 samples, one is subtracted from the other
    assert rate_from_time(time) == pytest.approx(100.0)
