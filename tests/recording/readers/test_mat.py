from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from ballscrew.base.errors import InputError
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers.mat import MatReader

X = np.arange(40.0)
READER = MatReader()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.mat"


@pytest.mark.parametrize("packed", [False, True])
def test_version_5(path: Path, packed: bool) -> None:
    content = {
        "torque": X[:, None].astype(np.float32),
        "position": X[None, :].astype(np.int16),
        "run": {"acc1_x": X, "deep": {"y": X[:20]}, "note": "text", "scalar": 3.0},
        "Fs": 1000.0,
        "matrix": np.zeros((4, 5)),
        "text": "hello",
        "cells": np.array([1, "a"], dtype=object),
        "complex": X + 1j,
    }
    scipy.io.savemat(path, content, do_compression=packed)
    assert reader_for(path).name == "mat"
    header = READER.read_header(path)
    sizes = {channel.name: channel.size for channel in header.channels}
    assert sizes == {"torque": 40, "position": 40, "run/acc1_x": 40, "run/deep/y": 20, "complex": 40}
    assert header.sample_rate == 1000.0
    values = READER.read(path, ["torque", "position", "run/acc1_x"])
    assert values["torque"].dtype == np.float32
    assert values["position"].dtype == np.float64
    np.testing.assert_array_equal(values["position"], X)
    np.testing.assert_array_equal(values["run/acc1_x"], X)
    with pytest.raises(InputError, match="'complex' holds complex numbers"):
        READER.read(path, ["complex"])
    for name in ("absent", "run", "text", "matrix", "Fs"):
        with pytest.raises(InputError, match="has no channel"):
            READER.read(path, [name])


def test_an_array_of_structs(path: Path) -> None:
    runs = np.zeros((1, 2), dtype=[("a", object)])
    runs[0, 0]["a"], runs[0, 1]["a"] = X, X + 1
    scipy.io.savemat(path, {"run": runs})
    assert [channel.name for channel in READER.read_header(path).channels] == ["run(1)/a", "run(2)/a"]
    np.testing.assert_array_equal(READER.read(path, ["run(2)/a"])["run(2)/a"], X + 1)


def test_version_7_3(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        file["torque"] = X[None, :]
        file["torque"].attrs["MATLAB_class"] = np.bytes_(b"double")
        file["run/acc"] = X[None, :]
        file["word"] = np.arange(5, dtype=np.uint16)[:, None]
        file["word"].attrs["MATLAB_class"] = np.bytes_(b"char")
        file["nothing"] = np.zeros(2, dtype=np.uint64)
        file["nothing"].attrs["MATLAB_empty"] = np.uint8(1)
        file["#refs#/a"] = X
        file["fs"] = np.array([[1000.0]])
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    assert reader_for(path).name == "mat"
    header = READER.read_header(path)
    assert {channel.name for channel in header.channels} == {"torque", "run/acc"}
    assert (header.sample_rate, header.reader) == (1000.0, "mat")
    np.testing.assert_array_equal(READER.read(path, ["torque"])["torque"], X)
    with pytest.raises(InputError, match="has no channel"):
        READER.read(path, ["absent"])


def test_version_4_by_its_name(path: Path) -> None:
    scipy.io.savemat(path, {"torque": X}, format="4")
    assert reader_for(path).name == "mat"
    np.testing.assert_array_equal(READER.read(path, ["torque"])["torque"], X)


def test_a_real_drive(emps: Path) -> None:
    path = emps / "DATA_EMPS.mat"
    header = reader_for(path).read_header(path)
    assert [channel.name for channel in header.channels] == ["qg", "qm", "t", "vir"]
    assert {channel.size for channel in header.channels} == {24841}
    assert READER.read(path, ["qm"])["qm"][:2] == pytest.approx([7.45e-6, 1.43e-5])
