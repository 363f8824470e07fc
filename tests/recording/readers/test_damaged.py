"""Damage that a library does not report, and content made to harm: each refused with one sentence."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ballscrew.base.errors import InputError
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers.process import opened

X = np.random.default_rng(0).normal(size=2000)
NAMES = ["mat73-1330.mat", "mat73-585.mat", "npz-stored-800.npz", "npz-stored-1469.npz"]


def test_files_with_one_changed_byte(data: Path, survives: Callable[[Path], bool]) -> None:
    for name in NAMES:
        assert not survives(data / "hostile" / name), name


def read(path: Path) -> dict[str, Any]:
    reader = reader_for(path)
    return reader.read(path, [channel.name for channel in reader.read_header(path).channels])


@pytest.mark.parametrize("storage", [{}, {"chunks": (500,)}, {"chunks": (500,), "compression": "gzip"}])
def test_hdf5_that_was_never_completely_written(tmp_path: Path, storage: dict[str, Any]) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        torque = file.create_dataset("torque", (2000,), "f8", **storage)
        if storage:
            torque[:1500] = X[:1500]
    with pytest.raises(InputError, match="'torque' is damaged or was never completely written"):
        read(path)
    with h5py.File(path, "a") as file:
        file["torque"][:] = X
    np.testing.assert_array_equal(read(path)["torque"], X)


@pytest.mark.parametrize("compression", ["gzip", "lzf", None])
def test_noise_that_cannot_be_compressed_is_read(tmp_path: Path, compression: str | None) -> None:
    noise = np.frombuffer(np.random.default_rng(1).bytes(8 * 2000), "u8") >> np.uint64(11)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset(
            "x", data=noise, chunks=(300,), compression=compression, shuffle=compression is None
        )
        file.create_dataset("y", data=noise.astype("f4"), maxshape=(None,), fletcher32=True)
    np.testing.assert_array_equal(read(tmp_path / "a.h5")["x"], noise.astype("f8"))


def test_a_rate_in_another_file_is_not_read(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(np.array([1234.5]).tobytes())
    path = tmp_path / "a.h5"
    layout = h5py.VirtualLayout((1,), "f8")
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["x"] = [1234.5]
    layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "x", (1,))
    with h5py.File(path, "w") as file:
        file["torque"] = X
        file.create_dataset("sample_rate", (1,), "f8", external=[(str(secret), 0, 8)])
        file.create_virtual_dataset("fs", layout)
    header = reader_for(path).read_header(path)
    assert (header.sample_rate, [channel.name for channel in header.channels]) == (None, ["torque"])
    with pytest.raises(InputError, match="in another file"):
        reader_for(path).read(path, ["sample_rate"])


def test_channels_that_are_too_large_together(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        for name in "abcd":
            file.create_dataset(name, (10**8,), "f8", chunks=(10**5,), compression="gzip")
    with pytest.raises(InputError, match="'a, b, c, d' declares 3200000000 bytes"):
        read(path)


def test_parquet_pages_are_checked(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    pq.write_table(
        pa.table({"torque": X}), path, compression="none", use_dictionary=False, write_page_checksum=True
    )
    whole = bytearray(path.read_bytes())
    whole[1000] ^= 1
    path.write_bytes(whole)
    with pytest.raises(InputError, match="cannot be read as Parquet"):
        read(path)


def test_members_of_an_archive_are_checked_to_their_ends(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, torque=X)
    whole = bytearray(path.read_bytes())
    whole[1000] ^= 1
    path.write_bytes(whole)
    with pytest.raises(InputError, match="CRC"):
        read(path)
    np.save(tmp_path / "x.npy", X)
    content = (tmp_path / "x.npy").read_bytes()
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("torque.npy", content + bytes(8))
    with pytest.raises(InputError, match="has more bytes than the 16000"):
        read(path)


@pytest.mark.parametrize(
    ("end", "count"),
    [
        ("48.75", 21),
        ("48.75\n", 21),
        ("48.", 20),
        ("48", 20),
        ("48.7", 20),
        ("48.7\n", 21),
        ("48.75\n\n", 21),
    ],
)
def test_a_last_line_that_may_be_cut_is_left_out(tmp_path: Path, end: str, count: int) -> None:
    path = tmp_path / "a.csv"
    path.write_text("torque,position\n" + "1.25,48.75\n" * 20 + f"1.25,{end}")
    position = read(path)["position"]
    assert position.size == count
    assert set(position[:20]) == {48.75}


@pytest.mark.parametrize(
    "note",
    [
        "fs " * 80_000,
        "fs" + "1" * 240_000,
        "start 2026-01-01 " * 15_000,
        "a(" * 60_000,
        "[" * 100_000 + " 1",
        "1" * 300_000 + "x",
    ],
)
def test_a_long_header_is_read_within_the_processor_time_of_its_size(tmp_path: Path, note: str) -> None:
    path = tmp_path / "a.txt"
    path.write_text(f"{note}\ntorque position\n" + "1.5 2.5\n" * 20)
    with opened(path) as file:
        assert len(file.header.channels) == 2


def test_a_link_is_no_recording(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", torque=X)
    try:
        (tmp_path / "link.npz").symlink_to("a.npz")
    except OSError:
        pytest.skip("links cannot be made here")
    with pytest.raises(InputError, match="is a link; give the file that it leads to"):
        reader_for(tmp_path / "link.npz")
