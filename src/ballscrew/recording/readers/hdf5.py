"""HDF5: a dataset per channel, in any groups; netCDF-4 too."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.attributes import RATES, rate_of, start_of, unit_of
from ballscrew.recording.readers.guard import as_channel, check_size, is_channel, missing_channel, refusing

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_PURE_DIMENSION = b"This is a netCDF dimension but not a netCDF variable"


class Hdf5Reader:
    """One-dimensional numeric datasets; attributes ``unit``, ``sample_rate``, ``started_at``."""

    name = "hdf5"

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002  the content alone decides
        """True if the file has the HDF5 signature and is not MATLAB's."""
        return is_hdf5(head) and not head.startswith(b"MATLAB")

    def read_header(self, path: Path) -> Header:
        """Read channels, rate and start time."""
        with refusing(path, "HDF5"), open_file(path) as file:
            return header_of(file, self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the channels asked for."""
        with refusing(path, "HDF5"), open_file(path) as file:
            return read_from(file, path, names)


def is_hdf5(head: bytes) -> bool:
    """True if the first bytes have the signature at a place that HDF5 allows."""
    return _SIGNATURE in (head[:8], head[512:520], head[1024:1032], head[2048:2056])


def open_file(path: Path) -> Any:
    """Open the file; without a lock where the file system has none."""
    return h5py.File(path, "r", locking="best-effort")


def header_of(file: Any, reader: str, accept: Callable[[str, Any], bool] | None = None) -> Header:
    """Read the header of an open file.

    Parameters
    ----------
    file : h5py.File
        The file.
    reader : str
        Name of the reader.
    accept : callable, optional
        Called with the name of a dataset and the dataset; False where it is no channel.

    Returns
    -------
    Header
        Datasets that are linked softly or from another file are not listed: a recording is one file.
    """
    found: list[RawChannel] = []
    scalars: dict[str, Any] = {}

    # visititems() follows hard links only, and visits each object once: no link leads outside or in a circle.
    def visit(name: str | bytes, item: Any) -> None:
        # A name that is no Unicode comes as bytes, and no channel map can have it.
        if not isinstance(name, str) or not isinstance(item, h5py.Dataset):
            return
        if accept is not None and not accept(name, item):
            return
        if item.shape is not None and item.size == 1 and name.casefold() in RATES:
            scalars[name] = item[...]
        elif _own_channel(item):
            found.append(RawChannel(name, int(item.size), unit_of(item.attrs), _nearest_rate(item)))

    file.visititems(visit)
    rate = rate_of(file.attrs)
    if rate is None:
        rate = rate_of(scalars)
    return Header(tuple(found), rate, start_of(file.attrs), reader)


def read_from(file: Any, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Read channels of an open file, packed values (netCDF ``scale_factor``) unpacked.

    Raises
    ------
    InputError
        If a channel is not there, is not one, or keeps its data in another file.
    """
    return {name: _values(_find(file, path, name), path, name) for name in names}


def _own_channel(dataset: Any) -> bool:
    if dataset.shape is None or not is_channel(dataset.dtype, dataset.shape):
        return False
    label = dataset.attrs.get("NAME")
    if isinstance(label, bytes) and label.startswith(_PURE_DIMENSION):
        return False
    return not (dataset.is_virtual or dataset.external)


def _nearest_rate(dataset: Any) -> float | None:
    """Sample rate of a dataset or of the innermost of its groups that has one, Hz."""
    item = dataset
    while item.name not in (None, "/"):
        rate = rate_of(item.attrs)
        if rate is not None:
            return rate
        item = item.parent
    return None


def _find(file: Any, path: Path, name: str) -> Any:
    item = file
    for part in name.strip("/").split("/"):
        if not isinstance(item, h5py.Group):
            raise missing_channel(path, name)
        link = None
        if part not in ("", "."):
            link = item.get(part, getlink=True)
        if link is None:
            raise missing_channel(path, name)
        if not isinstance(link, h5py.HardLink):
            raise InputError(f"{path}: {name!r} is a link and is not followed: a recording is one file.")
        item = item[part]
    if not isinstance(item, h5py.Dataset):
        raise missing_channel(path, name)
    if item.is_virtual or item.external:
        raise InputError(f"{path}: {name!r} keeps its data in another file: a recording is one file.")
    if not _own_channel(item):
        raise InputError(
            f"{path}: {name!r} is {item.dtype} of shape {item.shape}; a channel is one row of numbers."
        )
    return item


def _values(dataset: Any, path: Path, name: str) -> NDArray[Any]:
    check_size(path, name, int(dataset.size) * int(dataset.dtype.itemsize))
    raw = dataset[...]
    values = as_channel(raw)
    attributes = dataset.attrs
    for key in ("_FillValue", "missing_value"):
        fill = np.asarray(attributes.get(key, np.nan))
        if fill.size == 1 and fill.dtype.kind in "iuf" and np.isfinite(fill).all():
            missing = raw.reshape(-1) == fill.reshape(-1)[0]
            values = np.where(missing, np.asarray(np.nan, values.dtype), values)
    for key, combine in (("scale_factor", np.multiply), ("add_offset", np.add)):
        if key in attributes:
            values = combine(values, float(np.asarray(attributes[key]).reshape(-1)[0]), dtype=np.float64)
    return values
