from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

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
    assert sizes == {"torque": 40, "position": 40, "run/acc1_x": 40, "run/deep/y": 20}
    assert header.sample_rate == 1000.0
    values = READER.read(path, ["torque", "position", "run/acc1_x"])
    assert values["torque"].dtype == np.float32
    assert values["position"].dtype == np.float64
    np.testing.assert_array_equal(values["position"], X)
    np.testing.assert_array_equal(values["run/acc1_x"], X)
    with pytest.raises(InputError, match="'complex' holds complex numbers"):
        READER.read(path, ["complex"])
    with pytest.raises(InputError, match=r"'matrix' is of shape \(4, 5\)"):
        READER.read(path, ["matrix"])
    for name in ("absent", "run", "text"):
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


def test_version_4_is_refused(path: Path) -> None:
    scipy.io.savemat(path, {"torque": X}, format="4")
    assert reader_for(path).name == "mat"
    with pytest.raises(InputError, match="save it with -v7"):
        READER.read_header(path)


def test_an_unknown_type_code(path: Path) -> None:
    scipy.io.savemat(path, {"run": {"torque": X}})
    whole = path.read_bytes()
    at = whole.index(X.tobytes()) - 8  # the tag of the samples
    assert whole[at] == 9
    path.write_bytes(whole[:at] + b"\x78" + whole[at + 1 :])
    with pytest.raises(InputError, match="stored as an unknown type"):
        READER.read(path, ["run/torque"])


@given(
    values=hnp.arrays(
        st.sampled_from(
            [np.dtype(name) for name in ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")]
        ),
        hnp.array_shapes(min_dims=1, max_dims=1, min_side=2, max_side=30),
    ),
    packed=st.booleans(),
    column=st.booleans(),
)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_scipy_writes_is_read(values: NDArray[Any], packed: bool, column: bool, path: Path) -> None:
    matrix = values[:, None] if column else values[None, :]
    scipy.io.savemat(path, {"a": matrix, "s": {"b": matrix}}, do_compression=packed)
    read = READER.read(path, ["a", "s/b"])
    for array in read.values():
        np.testing.assert_array_equal(array, values.astype(array.dtype))
        assert array.dtype == (np.float32 if values.dtype == np.float32 else np.float64)


def test_a_real_drive(emps: Path) -> None:
    path = emps / "DATA_EMPS.mat"
    header = reader_for(path).read_header(path)
    assert [channel.name for channel in header.channels] == ["qg", "qm", "t", "vir"]
    assert {channel.size for channel in header.channels} == {24841}
    assert READER.read(path, ["qm"])["qm"][:2] == pytest.approx([7.45e-6, 1.43e-5])


def element(kind: int, content: bytes) -> bytes:
    """An element, padded to eight bytes."""
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def matrix(
    content: bytes,
    kind: int = 6,
    *,
    name: bytes = b"a",
    shape: bytes = struct.pack("<2i", 1, 40),
    dims: int = 5,
) -> bytes:
    """An array of a class with its samples or fields."""
    about = element(6, struct.pack("<II", kind, 0)) + element(dims, shape) + element(1, name)
    return element(14, about + content)


def fields(size: int, *arrays: bytes) -> bytes:
    """A struct of fields a, b …, whose names have a size."""
    names = b"".join(bytes([97 + number]).ljust(size, b"\0") for number in range(len(arrays)))
    about = element(5, struct.pack("<i", size)) + element(1, names)
    return matrix(about + b"".join(arrays), 2, name=b"run", shape=struct.pack("<2i", 1, 1))


def packed(content: bytes) -> bytes:
    """A compressed element, which is not padded."""
    content = zlib.compress(content)
    return struct.pack("<II", 15, len(content)) + content


def write(path: Path, *elements: bytes) -> None:
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(elements))


GOOD = matrix(element(9, X.tobytes()))


def test_a_file_that_is_assembled_here_is_read(path: Path) -> None:
    write(path, GOOD, packed(fields(8, GOOD)))
    values = READER.read(path, ["a", "run/a"])
    for name in values:
        np.testing.assert_array_equal(values[name], X)


def test_an_empty_array_is_no_channel(path: Path) -> None:
    """As MATLAB writes ``[]`` in a struct, and a variable of which nothing is stored."""
    nothing = struct.pack("<II", 14, 0)
    write(path, packed(nothing), fields(8, nothing, GOOD))
    assert [channel.name for channel in READER.read_header(path).channels] == ["run/b"]


@pytest.mark.parametrize(
    ("elements", "why"),
    [
        ([packed(b"abc")], "a variable is cut"),
        ([packed(GOOD + bytes(200))], "a compressed variable is cut or longer than it says"),
        ([packed(GOOD[:-8])], "the file is cut"),
        ([fields(8, element(9, X.tobytes()))], "an element is no array"),
        ([fields(0, GOOD)], "a struct's fields have no names"),
        ([matrix(b"", dims=9)], "an array does not say its shape"),
        ([matrix(b"", shape=b"1234")], "an array does not say its shape"),
        ([matrix(b"", shape=struct.pack("<2i", -1, 40))], r"the impossible shape \(-1, 40\)"),
    ],
)
def test_what_violates_the_format_is_refused(path: Path, elements: list[bytes], why: str) -> None:
    write(path, *elements)

    def read() -> None:
        READER.read_header(path)
        READER.read(path, ["a"])

    with pytest.raises(InputError, match=rf"a\.mat: cannot be read as .*{why}"):
        read()
