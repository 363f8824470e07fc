"""Channels of an excitation file: with a channel map, and as the file has them."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from ballscrew.base.errors import InputError
from ballscrew.modal.excited_record import Signals, read_record
from ballscrew.recording.channels import ChannelMap

PAIR = Signals("torque", "speed")
MAP = {
    "sample_rate": "2 kHz",
    "channel": [
        {"source": "torque", "quantity": "torque", "unit": "N m"},
        {"source": "speed", "quantity": "speed", "unit": "mm/s"},
        {"source": "x", "quantity": "position", "unit": "mm"},
    ],
}


def write(path: Path, rates: dict[str, float] | None = None, **channels: np.ndarray) -> Path:
    with h5py.File(path, "w") as file:
        for name, values in channels.items():
            file[name] = values
            if rates is not None:
                file[name].attrs["sample_rate"] = rates[name]
    return path


@pytest.fixture
def file(tmp_path: Path) -> Path:
    time = np.arange(500) / 2000
    return write(
        tmp_path / "noise.h5", torque=np.sin(300 * time), speed=np.cos(300 * time), x=np.full(500, 120.0)
    )


def test_a_channel_map_gives_units_rate_and_place(file: Path) -> None:
    record = read_record(file, PAIR, ChannelMap.from_settings(MAP, "map"))
    assert (record.rate, record.quantities) == (2000.0, ("torque", "speed"))
    assert record.position == pytest.approx(0.12)
    speed = np.cos(300 * np.arange(500) / 2000)
    np.testing.assert_allclose(record.arrays[1], 1e-3 * speed)


def test_a_channel_that_is_not_mapped_is_named_with_those_that_are(file: Path) -> None:
    with pytest.raises(InputError, match=r"noise.h5: no channel 'iq' is mapped; mapped are speed, torque, x"):
        read_record(file, Signals("iq", "speed"), ChannelMap.from_settings(MAP, "map"))


def test_a_file_without_a_rate_and_a_time_asks_for_a_channel_map(file: Path) -> None:
    with pytest.raises(InputError, match=r"states no sample rate; give a channel map with it \(--channels\)"):
        read_record(file, PAIR, None)


def test_channels_of_different_rates_are_refused(tmp_path: Path) -> None:
    fast, slow = np.sin(np.arange(800.0)), np.cos(np.arange(400.0))
    path = write(tmp_path / "a.h5", {"torque": 4000.0, "speed": 2000.0}, torque=fast, speed=slow)
    with pytest.raises(
        InputError, match="must have the same rate; they have 'torque' 4000 Hz, 'speed' 2000 Hz"
    ):
        read_record(path, PAIR, None)
    alike = write(tmp_path / "b.h5", {"torque": 2000.0, "speed": 2000.0}, torque=slow, speed=slow)
    assert read_record(alike, PAIR, None).rate == 2000.0
