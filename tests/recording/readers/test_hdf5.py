from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

from ballscrew.base import units
from ballscrew.base.errors import InputError
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers.hdf5 import Hdf5Reader

X = np.arange(40.0)
READER = Hdf5Reader()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.h5"


def test_channels_units_rates_and_start(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["Fs"] = np.array([1000])
        file.attrs["start_time"] = "2026-01-31T08:00:00Z"
        file["torque"] = X.astype(np.float32)
        file["torque"].attrs["unit"] = np.bytes_(b"N m")
        file["nut/acc1_x"] = X.astype(">i2")[None, :]
        file["nut"].attrs["sample_rate"] = "12.8 kHz"
        file["nut/acc2_x"] = X[:, None]
        file["nut/acc2_x"].attrs["dt"] = 1e-3
        file["picture"] = np.zeros((4, 5))
        file["text"] = "hello"
        file["flags"] = X > 3
        file["scalar"] = 3.0
        file["nothing"] = h5py.Empty("f8")
    header = READER.read_header(path)
    assert {c.name: (c.size, c.unit, c.sample_rate) for c in header.channels} == {
        "nut/acc1_x": (40, None, 12800.0),
        "nut/acc2_x": (40, None, 1000.0),
        "torque": (40, "N m", None),
    }
    assert (header.sample_rate, header.started_at, header.reader) == (1000.0, "2026-01-31T08:00:00Z", "hdf5")
    values = READER.read(path, ["torque", "nut/acc1_x"])
    assert values["torque"].dtype == np.float32
    assert values["nut/acc1_x"].dtype == np.float64
    np.testing.assert_array_equal(values["nut/acc1_x"], X)


def test_a_file_that_xarray_wrote(path: Path) -> None:
    data = xr.Dataset({"torque": ("time", X, {"units": "N m"})}, {"time": X * 1e-3}, {"sample_rate": 1000.0})
    data["packed"] = ("time", X)
    data.to_netcdf(
        path, engine="h5netcdf", encoding={"packed": {"dtype": "i2", "scale_factor": 0.5, "_FillValue": 8}}
    )
    header = READER.read_header(path)
    assert {c.name for c in header.channels} == {"torque", "time", "packed"}
    assert header.sample_rate == 1000.0
    values = READER.read(path, ["torque", "packed"])
    np.testing.assert_array_equal(values["torque"], X)
    np.testing.assert_array_equal(values["packed"], np.where(X == 4, np.nan, X))


def test_links_are_not_followed(path: Path) -> None:
    secret = path.with_name("secret.h5")
    with h5py.File(secret, "w") as file:
        file["torque"] = X
    with h5py.File(path, "w") as file:
        file["own"] = X
        file["out"] = h5py.ExternalLink("secret.h5", "/torque")
        file["folder"] = h5py.ExternalLink("secret.h5", "/")
        file["soft"] = h5py.SoftLink("/folder/torque")
        file["group/up"] = file["/"]  # a hard link in a circle
        layout = h5py.VirtualLayout((40,), "f8")
        layout[:] = h5py.VirtualSource("secret.h5", "torque", (40,))
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("raw", (40,), "f8", external=[("secret.h5", 0, 320)])
    assert [channel.name for channel in READER.read_header(path).channels] == ["own"]
    for name in ("out", "folder/torque", "soft"):
        with pytest.raises(InputError, match="is a link and is not followed"):
            READER.read(path, [name])
    for name in ("virtual", "raw"):
        with pytest.raises(InputError, match="keeps its data in another file"):
            READER.read(path, [name])


def test_channels_that_are_not_there_or_are_none(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["picture"] = np.zeros((4, 5))
        file["group/a"] = X
    for name in ("absent", "group", "group/a/b", "group/b", "", "group/../group/a", "."):
        with pytest.raises(InputError, match="has no channel"):
            READER.read(path, [name])
    with pytest.raises(InputError, match="is float64 of shape"):
        READER.read(path, ["picture"])


def test_a_size_that_the_file_cannot_hold(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("bomb", (10**13,), "f8", chunks=(1000,), compression="gzip")
    assert READER.read_header(path).channels[0].size == 10**13
    with pytest.raises(InputError, match="declares 80000000000000 bytes"):
        READER.read(path, ["bomb"])


def test_a_file_that_is_cut_off_says_how_much_is_there(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["a"] = X
    whole = path.read_bytes()
    path.write_bytes(whole[:-100])
    with pytest.raises(InputError, match=f"cut off: it holds {len(whole) - 100} of {len(whole)} bytes"):
        READER.read_header(path)


def test_a_user_block_before_the_signature(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        file["a"] = X
    assert reader_for(path).name == "hdf5"


def test_the_bench(bench: Path) -> None:
    path = bench / "preload-4-percent-trip1.h5"
    header = reader_for(path).read_header(path)
    assert len(header.channels) == 11
    assert header.sample_rate == 12800.0
    assert {c.name: c.unit for c in header.channels}["torque"] == "N m"
    with h5py.File(path) as file:
        assert {c.size for c in header.channels} == {len(file["torque"])}


@pytest.mark.parametrize("value", ["fast", "1000 m", "NaN Hz", [1000.0, 2000.0], b"\xff"])
def test_a_rate_that_is_none_is_not_known(path: Path, value: object) -> None:
    with h5py.File(path, "w") as file:
        file["torque"] = X
        file.attrs["sample_rate"] = value
    assert READER.read_header(path).sample_rate is None


def test_an_uncommon_unit_is_asked_for_where_its_definitions_cannot_be_loaded(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another process, which has loaded them, then reads the file."""

    def fail() -> None:
        raise OSError

    with h5py.File(path, "w") as file:
        file["torque"] = X
        file.attrs["sample_rate"] = "25.6 kilohertz"
    monkeypatch.setattr(units, "_registry", fail)
    with pytest.raises(units.NoDefinitionsError):
        READER.read_header(path)
