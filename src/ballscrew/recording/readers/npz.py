"""NumPy's NPZ: an array per channel; nothing in it is ever unpickled."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.attributes import RATES, rate_of, start_of
from ballscrew.recording.readers.guard import as_channel, check_size, is_channel, missing_channel, refusing

_STARTS = ("started_at", "start_time")


class NpzReader:
    """One-dimensional numeric arrays; a scalar ``sample_rate`` or ``fs`` is the rate."""

    name = "npz"

    def can_open(self, path: Path, head: bytes) -> bool:
        """True if it is a zip archive whose name or first member says NumPy: spreadsheets are zips too."""
        if not head.startswith((b"PK\x03\x04", b"PK\x05\x06")):
            return False
        first = head[30 : 30 + int.from_bytes(head[26:28], "little")]
        return path.suffix.casefold() == ".npz" or first.endswith(b".npy")

    def read_header(self, path: Path) -> Header:
        """Read channels, rate and start time."""
        with refusing(path, "NPZ"), zipfile.ZipFile(path) as archive:
            channels: list[RawChannel] = []
            scalars: dict[str, Any] = {}
            pickled: list[str] = []
            for info in archive.infolist():
                if not info.filename.endswith(".npy"):
                    continue
                name = info.filename[:-4]
                with archive.open(info) as stream:
                    shape, dtype = _declared(stream, path, name)
                if dtype.hasobject:
                    pickled.append(name)
                elif math.prod(shape) == 1 and name.casefold() in (*RATES, *_STARTS):
                    scalars[name] = _array(archive, path, name)
                elif is_channel(dtype, shape):
                    channels.append(RawChannel(name, math.prod(shape)))
            if pickled and not channels:
                raise _pickle_error(path, pickled[0])
            return Header(tuple(channels), rate_of(scalars), start_of(scalars), self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the channels asked for."""
        with refusing(path, "NPZ"), zipfile.ZipFile(path) as archive:
            sizes = [info.file_size for info in archive.infolist() if info.filename[:-4] in names]
            check_size(path, ", ".join(names), sum(sizes))
            return {name: as_channel(_array(archive, path, name)) for name in names}


def _declared(stream: IO[bytes], path: Path, name: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = npy.read_magic(stream)
    if version == (1, 0):
        shape, _, dtype = npy.read_array_header_1_0(stream)
    elif version == (2, 0):
        shape, _, dtype = npy.read_array_header_2_0(stream)
    else:
        return (), np.dtype([(name or "x", "f8")])  # version 3 is for records only, and those are no channels
    if min(shape, default=0) < 0:
        raise InputError(f"{path}: {name!r} declares the impossible shape {shape}.")
    return tuple(shape), dtype


def _array(archive: zipfile.ZipFile, path: Path, name: str) -> NDArray[Any]:
    try:
        info = archive.getinfo(f"{name}.npy")
    except KeyError:
        raise missing_channel(path, name) from None
    with archive.open(info) as stream:
        shape, dtype = _declared(stream, path, name)
    if dtype.hasobject:
        raise _pickle_error(path, name)
    if not (is_channel(dtype, shape) or math.prod(shape) == 1):
        raise InputError(f"{path}: {name!r} is {dtype} of shape {shape}; a channel is one row of numbers.")
    size = math.prod(shape) * dtype.itemsize
    check_size(path, name, size)
    if size > info.file_size:
        raise InputError(
            f"{path}: {name!r} declares {size} bytes and has {info.file_size}: it is cut or forged."
        )
    with archive.open(info) as stream:
        values: NDArray[Any] = npy.read_array(stream, allow_pickle=False)
        # The archive's checksum is compared at the end of the member only.
        if stream.read(1):
            raise InputError(f"{path}: {name!r} has more bytes than the {size} that it declares.")
    return values


def _pickle_error(path: Path, name: str) -> InputError:
    return InputError(
        f"{path}: {name!r} is pickled Python objects, which can run code, so they are refused;"
        " save plain numbers instead."
    )
