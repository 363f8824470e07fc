"""HDF5: a dataset per channel, in any groups; netCDF-4 too."""

from __future__ import annotations

import math
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
_ALWAYS_APPLIED = (1, 2, 3)  # deflate, shuffle, Fletcher-32; others skip a chunk that they cannot compress
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
        # Before anything else is asked: its data would be read from another file.
        if _is_elsewhere(item):
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
    datasets = {name: _find(file, path, name) for name in names}
    check_size(path, ", ".join(names), sum(map(_size, datasets.values())))
    return {name: _values(dataset, path, name) for name, dataset in datasets.items()}


def _is_elsewhere(dataset: Any) -> bool:
    """True if the data are not in the file; asks for neither shape nor size, which may open another file."""
    return bool(dataset.is_virtual or dataset.external)


def _size(dataset: Any) -> int:
    """Size in memory, or that of a chunk where it is larger, bytes."""
    return max(int(dataset.size), math.prod(dataset.chunks or ())) * int(dataset.dtype.itemsize)


def _own_channel(dataset: Any) -> bool:
    if dataset.shape is None or not is_channel(dataset.dtype, dataset.shape):
        return False
    label = dataset.attrs.get("NAME")
    return not (isinstance(label, bytes) and label.startswith(_PURE_DIMENSION))


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
    if _is_elsewhere(item):
        raise InputError(f"{path}: {name!r} keeps its data in another file: a recording is one file.")
    if not _own_channel(item):
        raise InputError(
            f"{path}: {name!r} is {item.dtype} of shape {item.shape}; a channel is one row of numbers."
        )
    return item


def _values(dataset: Any, path: Path, name: str) -> NDArray[Any]:
    _check_stored(dataset, path, name)
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


def _check_stored(dataset: Any, path: Path, name: str) -> None:
    """Refuse a dataset of which a part was never written or has lost its place: it would be read as zeros."""
    size = int(dataset.size) * int(dataset.dtype.itemsize)
    contiguous = dataset.chunks is None and dataset.id.get_storage_size() == size
    if not contiguous and (dataset.chunks is None or not _chunks_are_whole(dataset)):
        raise InputError(f"{path}: {name!r} is damaged or was never completely written.")


def _chunks_are_whole(dataset: Any) -> bool:
    """True if every chunk is in the file, once, and has passed all filters."""
    chunks = dataset.chunks
    filters = dataset.id.get_create_plist()
    skippable = 0
    for index in range(filters.get_nfilters()):
        if filters.get_filter(index)[0] not in _ALWAYS_APPLIED:
            skippable |= 1 << index
    plain = math.prod(chunks) * int(dataset.dtype.itemsize)
    expected = math.prod(-(-size // chunk) for size, chunk in zip(dataset.shape, chunks, strict=True))
    places: set[tuple[int, ...]] = set()
    sound = True

    def visit(chunk: Any) -> None:
        nonlocal sound
        places.add(chunk.chunk_offset)
        skipped = chunk.filter_mask
        if skipped and (skipped & ~skippable or chunk.size != plain):
            sound = False

    dataset.id.chunk_iter(visit)
    inside = all(at < size for place in places for at, size in zip(place, dataset.shape, strict=True))
    return sound and inside and len(places) == expected == dataset.id.get_num_chunks()
