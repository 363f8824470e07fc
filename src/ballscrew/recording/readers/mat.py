"""MATLAB files: version 5 by scipy, version 7.3 as the HDF5 that it is."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.attributes import RATES, rate_of
from ballscrew.recording.readers.guard import as_channel, check_size, is_channel, missing_channel, refusing

__all__ = ["MatReader"]

_NUMERIC = {"double", "single"} | {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}


class MatReader:
    """Variables that are one row or one column; structs flattened to ``struct/field``."""

    name = "mat"

    def can_open(self, path: Path, head: bytes) -> bool:
        """Whether MATLAB's header stands first; version 4 has none, so there the name decides."""
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
            return _header_5(path, self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the channels asked for."""
        with refusing(path, "MAT"):
            if _is_73(path):
                from ballscrew.recording.readers.hdf5 import open_file, read_from

                with open_file(path) as file:
                    return read_from(file, path, names)
            _check_sizes(path)
            loaded = _load(path, {re.split(r"[/(]", name)[0] for name in names})
            found = dict(_channels(loaded))
            for name in names:
                if name in loaded and loaded[name].dtype.kind == "c":
                    raise InputError(f"{path}: {name!r} holds complex numbers; a channel holds real ones.")
                if name not in found:
                    raise missing_channel(path, name)
            return {name: as_channel(found[name]) for name in names}


def _is_73(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(10) == b"MATLAB 7.3"


def _is_matlab_number(name: str, dataset: Any) -> bool:
    if name.startswith("#") or "MATLAB_empty" in dataset.attrs:
        return False
    kind = dataset.attrs.get("MATLAB_class", b"double")
    return (kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)) in _NUMERIC


def _check_sizes(path: Path) -> list[tuple[str, tuple[int, ...], str]]:
    from scipy.io import whosmat

    listing: list[tuple[str, tuple[int, ...], str]] = list(whosmat(path))
    for name, shape, _ in listing:
        if any(length < 0 for length in shape):
            raise InputError(f"{path}: {name!r} declares the impossible shape {shape}.")
        check_size(path, name, 8 * math.prod(shape))
    return listing


def _header_5(path: Path, reader: str) -> Header:
    listing = _check_sizes(path)
    deeper = {name for name, shape, kind in listing if kind == "struct" or _is_rate(name, shape)}
    loaded = _load(path, deeper)
    inside: dict[str, list[RawChannel]] = {}
    for name, values in _channels({key: value for key, value in loaded.items() if value.dtype.names}):
        inside.setdefault(re.split(r"[/(]", name)[0], []).append(RawChannel(name, values.size))
    channels: list[RawChannel] = []
    for name, shape, kind in listing:
        if kind in _NUMERIC and is_channel(np.dtype(float), shape):
            channels.append(RawChannel(name, math.prod(shape)))
        channels.extend(inside.get(name, []))
    scalars = {name: loaded[name] for name, shape, _ in listing if _is_rate(name, shape) and name in loaded}
    return Header(tuple(channels), rate_of(scalars), None, reader)


def _is_rate(name: str, shape: tuple[int, ...]) -> bool:
    return name.casefold() in RATES and math.prod(shape) == 1


def _load(path: Path, names: set[str]) -> dict[str, NDArray[Any]]:
    if not names:
        return {}
    from scipy.io import loadmat

    loaded = loadmat(path, variable_names=sorted(names), struct_as_record=True)
    return {
        name: value
        for name, value in loaded.items()
        if not name.startswith("__") and isinstance(value, np.ndarray)
    }


def _channels(variables: dict[str, NDArray[Any]]) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, value in variables.items():
        if value.dtype.names:
            elements = value.reshape(-1)
            for number, element in enumerate(elements, start=1):
                prefix = name if elements.size == 1 else f"{name}({number})"
                fields = {f"{prefix}/{field}": element[field] for field in value.dtype.names}
                yield from _channels(
                    {key: item for key, item in fields.items() if isinstance(item, np.ndarray)}
                )
        elif is_channel(value.dtype, value.shape):
            yield name, value
