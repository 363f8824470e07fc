"""MATLAB files: version 5, and version 7.3, which is HDF5.

scipy's reader follows a changed type code out of its table and crashes the process, so it is not used for
files of unknown origin. Source: MathWorks, MAT-File Format, chapter 1, Level 5.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.base.files import read_whole
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.attributes import RATES, rate_of
from ballscrew.recording.readers.guard import as_channel, check_size, is_channel, missing_channel, refusing

_INTEGERS = ("int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64")
_NUMERIC = ("double", "single", *_INTEGERS)
_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_STRUCT, _LOGICAL, _COMPLEX = 2, 0x02, 0x08
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_ENOUGH = 4096  # bytes in which class, shape and name of a variable lie


@dataclass(frozen=True, slots=True)
class Variable:
    """Numeric array of a file.

    Parameters
    ----------
    name : str
        Name with the path of its structs, ``"run/acc1_x"``.
    shape : tuple of int
        Declared shape.
    dtype : numpy.dtype
        Type of the class.
    complex : bool
        Whether it has an imaginary part.
    values : callable
        Reads the values, without the imaginary part.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    complex: bool
    values: Callable[[], NDArray[Any]]


@dataclass(frozen=True, slots=True)
class _Matrix:
    kind: int
    flags: int
    shape: tuple[int, ...]
    name: str
    start: int


def variables(path: Path) -> Iterator[Variable]:
    """Iterate over the numeric arrays of a file, including those in structs.

    Parameters
    ----------
    path : path-like
        The file.

    Yields
    ------
    Variable
        In the order of the file; its samples are not read yet, unless it lies in a compressed struct.

    Raises
    ------
    ValueError, struct.error, zlib.error
        If the file violates the format.
    """
    raw = memoryview(read_whole(path))
    order = {b"IM": "<", b"MI": ">"}.get(bytes(raw[126:128]))
    if order is None:
        raise ValueError("it is of version 4 or older; save it with -v7")
    at = _HEADER
    while at < len(raw):
        kind, start, end, after = _element(raw, at, order, padded=False)
        if kind == _COMPRESSED:
            yield from _compressed(raw[start:end], order, path)
        elif kind == _MATRIX:
            yield from _arrays(raw, at, order, "")
        at = after


def _compressed(packed: memoryview, order: str, path: Path) -> Iterator[Variable]:
    head = memoryview(zlib.decompressobj().decompress(packed, _ENOUGH))
    if len(head) < 8:
        raise ValueError("a variable is cut")
    size = 8 + struct.unpack_from(order + "I", head, 4)[0]
    if size <= 8:
        return
    matrix = _matrix(head, 8, order)

    def whole() -> memoryview:
        check_size(path, matrix.name, size)
        stream = zlib.decompressobj()
        content = stream.decompress(packed, size)
        stream.decompress(stream.unconsumed_tail, 64)  # what follows is the checksum, tested at the end only
        if not stream.eof:
            raise ValueError("a compressed variable is cut or longer than it says")
        return memoryview(content)

    if matrix.kind in _CLASSES:
        if not matrix.flags & _LOGICAL:
            yield _variable(matrix.name, matrix, whole, order)
    elif matrix.kind == _STRUCT:
        yield from _arrays(whole(), 0, order, "")


def _arrays(raw: memoryview, at: int, order: str, name: str) -> Iterator[Variable]:
    kind, start, end, _ = _element(raw, at, order)
    if kind != _MATRIX:
        raise ValueError("an element is no array")
    if start == end:
        return
    matrix = _matrix(raw[:end], start, order)
    name = name or matrix.name
    if matrix.kind in _CLASSES and not matrix.flags & _LOGICAL:
        yield _variable(name, matrix, lambda: raw[:end], order)
    elif matrix.kind == _STRUCT:
        yield from _fields(raw[:end], matrix, order, name)


def _fields(raw: memoryview, matrix: _Matrix, order: str, name: str) -> Iterator[Variable]:
    _, start, end, after = _element(raw, matrix.start, order)
    length = int.from_bytes(raw[start:end], "little" if order == "<" else "big", signed=True)
    _, start, end, at = _element(raw, after, order)
    if length < 1:
        raise ValueError("a struct's fields have no names")
    fields = [_text(raw[i : i + length]) for i in range(start, end, length)]
    count = math.prod(matrix.shape)
    if count * len(fields) * 8 > len(raw):
        raise ValueError("a struct declares more than it holds")
    for number in range(1, count + 1):
        prefix = name
        if count > 1:
            prefix = f"{name}({number})"
        for field in fields:
            yield from _arrays(raw, at, order, f"{prefix}/{field}")
            at = _element(raw, at, order)[3]


def _variable(name: str, matrix: _Matrix, whole: Callable[[], memoryview], order: str) -> Variable:
    dtype = np.dtype(_CLASSES[matrix.kind])

    def values() -> NDArray[Any]:
        raw = whole()
        kind, start, end, _ = _element(raw, matrix.start, order)
        if kind not in _STORED:
            raise ValueError(f"{name!r} is stored as an unknown type")
        stored = np.frombuffer(raw[start:end], order + _STORED[kind])
        if stored.size != math.prod(matrix.shape):
            raise ValueError(f"{name!r} holds {stored.size} values and declares the shape {matrix.shape}")
        return stored.astype(dtype)

    return Variable(name, matrix.shape, dtype, bool(matrix.flags & _COMPLEX), values)


def _matrix(raw: memoryview, at: int, order: str) -> _Matrix:
    kind, start, end, at = _element(raw, at, order)
    if kind != 6 or end - start != 8:
        raise ValueError("an array does not say what it is")
    word = struct.unpack_from(order + "I", raw, start)[0]
    kind, start, end, at = _element(raw, at, order)
    if kind != 5 or end - start < 8:
        raise ValueError("an array does not say its shape")
    shape = tuple(np.frombuffer(raw[start:end], order + "i4").tolist())
    if min(shape) < 0:
        raise ValueError(f"an array declares the impossible shape {shape}")
    _, start, end, at = _element(raw, at, order)
    return _Matrix(word & 0xFF, word >> 8 & 0xFF, shape, _text(raw[start:end]), at)


def _element(raw: memoryview, at: int, order: str, *, padded: bool = True) -> tuple[int, int, int, int]:
    """Type, start and end of an element's data, and where the next element begins."""
    kind, size = struct.unpack_from(order + "II", raw, at)
    if kind >> 16:  # a small one: size and type in one word, the data in the other
        kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
        if size > 4:
            raise ValueError("a small element is too large")
        return kind, start, start + size, at + 8
    start, end = at + 8, at + 8 + size
    if end > len(raw):
        raise ValueError("the file is cut")
    after = end
    if padded:
        after += -size % 8
    return kind, start, end, after


def _text(raw: memoryview) -> str:
    return bytes(raw).split(b"\0")[0].decode("ascii", "replace")


class MatReader:
    """Variables that are one row or one column; structs flattened to ``struct/field``."""

    name = "mat"

    def can_open(self, path: Path, head: bytes) -> bool:
        """True if the file begins with MATLAB's header; version 4 has none, so there the name decides."""
        if head.startswith(b"MATLAB") or head[126:128] in (b"IM", b"MI"):
            return True
        return path.suffix.casefold() == ".mat" and head[:1] == b"\0"

    def read_header(self, path: Path) -> Header:
        """Read channels; the rate from a scalar variable ``fs`` or ``sample_rate``, where there is one."""
        with refusing(path, "MAT"):
            if _is_73(path):
                from ballscrew.recording.readers.hdf5 import header_of, open_file

                with open_file(path) as file:
                    return header_of(file, self.name, _is_matlab_number)
            channels, rates = [], {}
            for variable in variables(path):
                if _is_channel(variable):
                    channels.append(RawChannel(variable.name, math.prod(variable.shape)))
                if _is_rate(variable):
                    rates[variable.name] = variable.values()
            return Header(tuple(channels), rate_of(rates), None, self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the channels asked for."""
        with refusing(path, "MAT"):
            if _is_73(path):
                from ballscrew.recording.readers.hdf5 import open_file, read_from

                with open_file(path) as file:
                    return read_from(file, path, names)
            found = {variable.name: variable for variable in variables(path)}
            sizes = [8 * math.prod(found[name].shape) for name in names if name in found]
            check_size(path, ", ".join(names), sum(sizes))
            return {name: _values(found.get(name), path, name) for name in names}


def _is_73(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(10) == b"MATLAB 7.3"


def _is_matlab_number(name: str, dataset: Any) -> bool:
    if name.startswith("#") or "MATLAB_empty" in dataset.attrs:
        return False
    kind = dataset.attrs.get("MATLAB_class", b"double")
    if isinstance(kind, bytes):
        kind = kind.decode("ascii", "replace")
    return str(kind) in _NUMERIC


def _is_channel(variable: Variable) -> bool:
    return is_channel(variable.dtype, variable.shape) and not variable.complex


def _is_rate(variable: Variable) -> bool:
    return variable.name.casefold() in RATES and math.prod(variable.shape) == 1


def _values(variable: Variable | None, path: Path, name: str) -> NDArray[Any]:
    if variable is None:
        raise missing_channel(path, name)
    if variable.complex:
        raise InputError(f"{path}: {name!r} holds complex numbers; a channel holds real ones.")
    if not _is_channel(variable):
        raise InputError(f"{path}: {name!r} is of shape {variable.shape}; a channel is one row of numbers.")
    return as_channel(variable.values())
