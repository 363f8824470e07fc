"""Readers of foreign formats, found by the entry-point group ``ballscrew.readers``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from numpy.typing import NDArray

from ballscrew._version import __version__
from ballscrew.base.errors import InputError
from ballscrew.base.files import open_regular
from ballscrew.recording.header import Header
from ballscrew.recording.readers.guard import reason
from ballscrew.recording.readers.unread import name_unread

GROUP = "ballscrew.readers"
HEAD = 4096
# In the order of asking: formats with a signature first, text last.
_BUILT_IN = {
    "hdf5": "ballscrew.recording.readers.hdf5:Hdf5Reader",
    "mat": "ballscrew.recording.readers.mat:MatReader",
    "parquet": "ballscrew.recording.readers.parquet:ParquetReader",
    "npz": "ballscrew.recording.readers.npz:NpzReader",
    "sinumerik-trace": "ballscrew.recording.readers.sinumerik:TraceReader",
    "sinumerik-response": "ballscrew.recording.readers.sinumerik:ResponseReader",
    "twincat-scope": "ballscrew.recording.readers.twincat:TwinCatReader",
    "tdms": "ballscrew.recording.readers.tdms:TdmsReader",
    "mdf4": "ballscrew.recording.readers.mdf4:Mdf4Reader",
    "wav": "ballscrew.recording.readers.wav:WavReader",
    "uff": "ballscrew.recording.readers.uff:UffReader",
    "lvm": "ballscrew.recording.readers.lvm:LvmReader",
    "profile": "ballscrew.recording.readers.profile:ProfileReader",
    "text": "ballscrew.recording.readers.text:TextReader",
}
_BINARY_NAMES = {
    ".h5": "HDF5", ".hdf5": "HDF5", ".hdf": "HDF5", ".nc": "netCDF-4", ".mat": "MAT", ".parquet": "Parquet",
    ".npz": "NPZ", ".uff": "UFF", ".unv": "UFF", ".wav": "WAV", ".tdms": "TDMS",
    ".mf4": "MDF", ".mdf": "MDF",
}  # fmt: skip


@runtime_checkable
class Reader(Protocol):
    """Interface of a reader of a format."""

    name: str

    def can_open(self, path: Path, head: bytes) -> bool:
        """True if this reader knows the file, from its name and its first 4096 bytes."""
        ...

    def read_header(self, path: Path) -> Header:
        """Read what the file says about itself, without its samples."""
        ...

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the channels asked for, raw: whole numbers as float64, float32 as it is."""
        ...


def readers() -> tuple[Reader, ...]:
    """Load all readers that can be loaded, in the order in which they are asked.

    Returns
    -------
    tuple of Reader
        The package's own, then those of other packages, the reader of text last.
    """
    return tuple(reader for reader, _ in _load() if reader is not None)


def reader_for(path: str | Path) -> Reader:
    """Find the reader that knows a file.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    Reader
        The first that says it can open the file.

    Raises
    ------
    InputError
        If the file cannot be read, is empty, is not what its name says, or no reader knows it.
    """
    path = Path(path)
    with open_regular(path, links=False) as stream:
        head = stream.read(HEAD)
    if not head:
        raise InputError(f"{path}: is empty.")
    known: list[str] = []
    broken: list[str] = []
    for reader, failure in _load():
        if reader is None:
            broken.append(failure)
            continue
        if reader.name == "text":
            _refuse_unread(path, head)
        known.append(reader.name)
        try:
            claimed = reader.can_open(path, head)
        except Exception as error:  # noqa: BLE001  a fault of another package must not affect the others
            broken.append(f"{reader.name}: {reason(error)}")
            continue
        if claimed:
            _check_name(path, reader)
            return reader
    text = f"{path}: is of a kind that no reader knows; there are readers of {', '.join(known)}"
    if broken:
        text += f"; readers that could not be used: {'; '.join(broken)}"
    raise InputError(f"{text}.")


def version_of(name: str) -> str:
    """Package of a reader, and its version.

    Parameters
    ----------
    name : str
        Of the reader.

    Returns
    -------
    str
        Such as ``"ballscrew 0.1.0"``; empty where no installed package has a reader of this name.
    """
    if name in _BUILT_IN:
        return f"ballscrew {__version__}"
    for point in entry_points(group=GROUP, name=name):
        if point.dist is not None:
            return f"{point.dist.name} {point.dist.version}"
    return ""


def _refuse_unread(path: Path, head: bytes) -> None:
    """Refuse a format that is known and not read, much of which the reader of text would accept."""
    known = name_unread(path, head)
    if known:
        raise InputError(f"{path}: {known}.")


def _check_name(path: Path, reader: Reader) -> None:
    kind = _BINARY_NAMES.get(path.suffix.casefold())
    if reader.name == "text" and kind is not None:
        raise InputError(f"{path}: is named as {kind}, but its content is not {kind}.")


def _points() -> Iterator[EntryPoint]:
    # The package's own come from the table, so that they are there without installed metadata, in its order.
    for name, value in _BUILT_IN.items():
        if name == "text":
            yield from (point for point in entry_points(group=GROUP) if point.name not in _BUILT_IN)
        yield EntryPoint(name, value, GROUP)


def _load() -> Iterator[tuple[Reader | None, str]]:
    # One by one: a file's reader is often the first, and the libraries of the others need not be imported.
    for point in _points():
        try:
            reader = point.load()()
            if not isinstance(reader, Reader):
                raise TypeError("it has not the methods of a reader")
        except Exception as error:  # noqa: BLE001  a fault of another package must not affect the others
            yield None, f"{point.name}: {reason(error)}"
        else:
            yield reader, ""
