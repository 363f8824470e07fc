"""MDF 4, of ASAM, read by asammdf: rates by the master channels, invalid samples as NaN.

Source of the layout: ASAM MDF, Measurement Data Format, Programmers Guide 4.1, 2012. Of a damaged file
asammdf reads a part; here each number of samples is compared with the one that the file declares.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.grid import Series, at_interval
from ballscrew.recording.readers.guard import check_size, missing_channel, refusing, unique

try:
    from asammdf import MDF
    from asammdf.blocks import mdf_v4

    class _Mdf(mdf_v4.MDF4):  # type: ignore[misc]  # asammdf is an extra
        def __del__(self) -> None:
            """Do nothing: the base's fails on an object whose file was refused."""
except ImportError:
    MDF = None

_TAG = b"MDF     4"
_UNFINISHED = b"UnFinMF 4"
_VALUE, _MASTER, _VIRTUAL_MASTER, _VIRTUAL = 0, 2, 3, 6  # channel types
_TIME = 1  # synchronisation type of a master
_NUMBERS = range(6)  # data types: whole numbers and floating point, of either byte order
_TO_NUMBERS = (0, 1, 2, 4, 5, 6)  # conversions; 3 is a formula, which the file would have executed
_REMOTE_MASTER = 1 << 3
_LOCAL_TIME = 1
_ALL_INVALID, _INVALIDATION_BIT = 1, 1 << 1
_UNIFORM = 0.25  # of an interval, from which times may deviate


class Mdf4Reader:
    """Channels of numbers of all groups, with their conversions to numbers."""

    name = "mdf4"

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002  the content alone decides
        """True if the file begins with the identification of MDF 4."""
        return head.startswith((_TAG, _UNFINISHED))

    def read_header(self, path: Path) -> Header:
        """Read channels with units, and rates and starts by the masters; the start time of the file."""
        with refusing(path, "MDF"), _opened(path) as file:
            starts = [group.times.start for group in file.groups if group.times is not None]
            first = min(starts, default=0.0)
            channels = []
            for name, (group, index) in file.channels.items():
                size, rate, late = group.size, None, None
                if group.times is not None:
                    size, rate = group.times.values.size, 1.0 / group.times.interval
                    late = group.times.start - first
                channels.append(RawChannel(name, size, _unit(group.block.channels[index]), rate, late))
            return Header(tuple(channels), None, _started_at(file.mdf.header), self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the channels asked for; a sample that is invalid, or whose record is absent, is NaN."""
        with refusing(path, "MDF"), _opened(path) as file:
            samples = {}
            for name in names:
                if name not in file.channels:
                    raise missing_channel(path, name)
                group, index = file.channels[name]
                values = _values(file.mdf, group, index)
                if group.times is not None:
                    values = np.append(values, np.nan)[group.times.values.astype(np.intp)]
                samples[name] = values
            return samples


@dataclass(frozen=True, slots=True)
class _RecordGroup:
    """A group of channels; ``times`` has the index of the record of each sample, -1 where it is absent."""

    number: int
    block: Any
    size: int
    times: Series | None


@dataclass(frozen=True, slots=True)
class _OpenMdf:
    mdf: Any
    groups: Sequence[_RecordGroup]
    channels: dict[str, tuple[_RecordGroup, int]]


@contextmanager
def _in_memory() -> Iterator[None]:
    """Let asammdf sort records in memory, since a reader process cannot write, and log nothing."""
    logger = logging.getLogger("asammdf")
    own, temporary_file, level = mdf_v4.MDF4, mdf_v4.NamedTemporaryFile, logger.level
    mdf_v4.MDF4, mdf_v4.NamedTemporaryFile = _Mdf, lambda **_: BytesIO()
    logger.setLevel(logging.CRITICAL)  # what it warns of is refused
    try:
        yield
    finally:
        mdf_v4.MDF4, mdf_v4.NamedTemporaryFile = own, temporary_file
        logger.setLevel(level)


@contextmanager
def _opened(path: Path) -> Iterator[_OpenMdf]:
    """Groups with samples, and their channels of numbers by name, while the file is open."""
    if MDF is None:
        raise InputError(f'{path}: is an MDF file, which asammdf reads: pip install "ballscrew[mdf4]".')
    with path.open("rb") as stream, _in_memory():
        if stream.read(len(_UNFINISHED)) == _UNFINISHED:
            raise ValueError("it was not finalised; open and save it in the program that wrote it")
        stream.seek(0)
        with MDF(stream, process_bus_logging=False, use_display_names=False) as mdf:
            groups = [
                _RecordGroup(number, block, size, _times(path, mdf, number, size))
                for number, block in enumerate(mdf.groups)
                if (size := _checked_size(path, block, number))
            ]
            yield _OpenMdf(mdf, groups, _channels(groups))


def _checked_size(path: Path, block: Any, number: int) -> int:
    """Number of records of a group."""
    size = int(block.channel_group.cycles_nr)
    check_size(path, f"group {number + 1}", 8 * size)
    return size


def _channels(groups: Sequence[_RecordGroup]) -> dict[str, tuple[_RecordGroup, int]]:
    """Channels of numbers by their names."""
    channels: dict[str, tuple[_RecordGroup, int]] = {}
    for group in groups:
        for index, channel in enumerate(group.block.channels):
            # The master of irregular times is a channel of them, by which the rate is checked.
            is_used_master = group.times is not None and channel.channel_type in (_MASTER, _VIRTUAL_MASTER)
            if _is_number(group.block, index) and not is_used_master:
                channels[unique(channel.name, channels)] = group, index
    return channels


def _is_number(block: Any, index: int) -> bool:
    """Whether a channel has one number in each record; refuses one that lies outside its record."""
    channel = block.channels[index]
    if channel.channel_type not in (_VALUE, _MASTER, _VIRTUAL_MASTER, _VIRTUAL):
        return False
    if block.channel_dependencies[index] or channel.data_type not in _NUMBERS:
        return False
    if channel.conversion is not None and channel.conversion.conversion_type not in _TO_NUMBERS:
        return False
    bits = channel.bit_offset + channel.bit_count
    virtual = channel.channel_type in (_VIRTUAL_MASTER, _VIRTUAL)
    if not virtual and (not bits or 8 * channel.byte_offset + bits > 8 * block.channel_group.samples_byte_nr):
        raise ValueError(f"{channel.name!r} lies outside its record")
    return True


def _times(path: Path, mdf: Any, number: int, size: int) -> Series | None:
    """Times of a group at a constant interval; None without a master of time, or where they are irregular."""
    block = mdf.groups[number]
    if block.channel_group.flags & _REMOTE_MASTER:
        number = block.channel_group.cg_master_index
        block = mdf.groups[number]
    master = mdf.masters_db.get(number)
    if master is None or block.channels[master].sync_type != _TIME or not _is_number(block, master):
        return None
    times = _values(mdf, _RecordGroup(number, block, size, None), master)
    if size < 2 or not np.isfinite(times).all():
        return None
    rows = np.arange(float(size))
    interval = float((times[-1] - times[0]) / (size - 1))
    if interval > 0 and np.abs(times - times[0] - interval * rows).max() <= _UNIFORM * interval:
        return Series(float(times[0]), interval, rows)
    try:
        series = at_interval(path, "time", times, rows, float(np.median(np.diff(times))))
    except InputError:
        return None
    return Series(series.start, series.interval, np.nan_to_num(series.values, nan=-1.0))


def _values(mdf: Any, group: _RecordGroup, index: int) -> Array:
    """Physical values of a channel, NaN where they are invalid."""
    channel = group.block.channels[index]
    raw, invalid = mdf.get(
        group=group.number, index=index, raw=True, samples_only=True, ignore_invalidation_bits=True
    )
    if raw.shape != (group.size,):
        few = f"{channel.name!r} has {len(raw)} of {group.size} samples"
        raise ValueError(f"{few}: the file is cut off; copy or export it again")
    # In floating point: asammdf computes conversions of whole numbers with their few bits.
    values: Array = raw.astype(np.float64)
    if channel.conversion is not None:
        values = np.asarray(channel.conversion.convert(values), dtype=np.float64)
    if channel.flags & _ALL_INVALID:
        return np.full(group.size, np.nan)
    if channel.flags & _INVALIDATION_BIT and invalid is not None:
        values[np.asarray(invalid, dtype=bool)] = np.nan
    return values


def _unit(channel: Any) -> str | None:
    """Unit of the conversion, else of the channel."""
    unit = (channel.conversion.unit if channel.conversion is not None else "") or channel.unit
    return unit or None


def _started_at(header: Any) -> str | None:
    """Start of the measurement: in UTC, or as the recorder's clock had it where the zone is not known."""
    if not header.abs_time:
        return None
    local = header.time_flags & _LOCAL_TIME
    try:
        moment = datetime.fromtimestamp(header.abs_time // 10**9, UTC)
    except (OverflowError, OSError, ValueError):
        return None
    moment = moment.replace(microsecond=header.abs_time % 10**9 // 1000, tzinfo=None if local else UTC)
    return moment.isoformat()
