"""MATLAB files: version 5, and version 7.3 as the HDF5 that it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.attributes import RATES, rate_of
from ballscrew.recording.readers.guard import as_channel, check_size, is_channel, missing_channel, refusing
from ballscrew.recording.readers.mat5 import Variable, variables

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
            found = list(variables(path))
            channels = tuple(RawChannel(v.name, math.prod(v.shape)) for v in found if _is_channel(v))
            rate = rate_of({v.name: v.values() for v in found if _is_rate(v)})
            return Header(channels, rate, None, self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the channels asked for."""
        with refusing(path, "MAT"):
            if _is_73(path):
                from ballscrew.recording.readers.hdf5 import open_file, read_from

                with open_file(path) as file:
                    return read_from(file, path, names)
            found = {variable.name: variable for variable in variables(path)}
            return {name: _values(found.get(name), path, name) for name in names}


def _is_73(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(10) == b"MATLAB 7.3"


def _is_matlab_number(name: str, dataset: Any) -> bool:
    if name.startswith("#") or "MATLAB_empty" in dataset.attrs:
        return False
    kind = dataset.attrs.get("MATLAB_class", b"double")
    return (kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)) in _NUMERIC


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
    check_size(path, name, math.prod(variable.shape) * np.dtype(np.float64).itemsize)
    return as_channel(variable.values())
