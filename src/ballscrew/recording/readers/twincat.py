"""TwinCAT Scope: text exports with a time column and a sample time for each channel."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.files import read_whole
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.dialect import TableDialect, lines_from, number, unique
from ballscrew.recording.readers.grid import Series, at_interval, on_change, written_on_change
from ballscrew.recording.readers.guard import check_size, missing_channel, refusing
from ballscrew.recording.readers.text import decoded, read_columns

_HEAD = re.compile(rb"\A(?:\xef\xbb\xbf)?\"?Name\"?([\t;:, ])[^\r\n]*[\r\n]+\"?File\"?\1")
_DIGITS = re.compile(r"[0-9]{1,19}\Z")
_SCALES = {"ScaleFactor": 1.0, "Offset": 0.0, "Unit ScaleFactor": 1.0, "Unit Offset": 0.0}
_TICKS = 1e7  # a second, of the times of Windows
_EPOCH = datetime(1601, 1, 1, tzinfo=UTC)
_LONGEST = 1e12  # ms; longer times are those of Windows, "full timestamps"
_MOST_LINES = 64  # of the header: name, file, times, and up to 20 fields of the channels


class TwinCatReader:
    """Text exports of TwinCAT Scope, of any separator but comma and blank, and either decimal mark."""

    name = "twincat-scope"

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002  the content alone decides
        """True if the file begins with the name and the file of a scope."""
        return _HEAD.match(head) is not None

    def read_header(self, path: Path) -> Header:
        """Read channels with unit, rate and first time, and the start time in UTC."""
        with refusing(path, "TwinCAT Scope"):
            raw, table = _open(path)
            series = _series(path, raw, table, [column.name for column in table.channels])
            first = min(each.start for each in series)
            channels = []
            for each, column in zip(series, table.channels, strict=True):
                rate = 1.0 / each.interval
                late = each.start - first
                channels.append(
                    RawChannel(column.name, each.values.size, column.unit, rate, late, column.scaled)
                )
            return Header(tuple(channels), None, table.started_at(), self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the channels asked for.

        A sample that is missing in the middle is NaN, or the one before in a signal written on change.
        """
        with refusing(path, "TwinCAT Scope"):
            raw, table = _open(path)
            known = {column.name for column in table.channels}
            for name in names:
                if name not in known:
                    raise missing_channel(path, name)
            series = _series(path, raw, table, names)
            return {name: each.values for name, each in zip(names, series, strict=True)}


@dataclass(frozen=True, slots=True)
class _Column:
    name: str
    index: int
    time: int
    interval: float
    unit: str | None
    scaled: bool


@dataclass(frozen=True, slots=True)
class _Scope:
    dialect: TableDialect
    channels: tuple[_Column, ...]
    ticks: int | None

    def started_at(self) -> str | None:
        if self.ticks is None:
            return None
        try:
            return (_EPOCH + timedelta(microseconds=self.ticks // 10)).isoformat()
        except OverflowError:
            return None


def _open(path: Path) -> tuple[bytes, _Scope]:
    """Rows of the table, all of one length, and what the lines above say."""
    raw, codec = decoded(read_whole(path), path)
    head = _HEAD.match(raw)
    if head is None:
        raise InputError(f"{path}: does not begin as an export of TwinCAT Scope.")
    delimiter = head[1].decode("ascii")
    if delimiter in ", ":
        raise InputError(
            f"{path}: is separated by commas or blanks, which its header contains too;"
            " export it with tabs or semicolons."
        )
    ticks, rows, first, start = _above(raw, codec, delimiter, path)
    names = rows["Name"]
    table = raw[start:].rstrip(b" \t\r\n;:\x1a")
    if table.endswith((b"\nEOF", b"\rEOF")):
        table = table[:-3].rstrip()
    decimal = "," if b"," in table else "."
    dialect = TableDialect(delimiter, decimal, tuple(names), (None,) * len(names), first, 0)
    return _filled(path, table, delimiter, len(names)), _Scope(dialect, _channels(path, rows), ticks)


def _above(
    raw: bytes, codec: str, delimiter: str, path: Path
) -> tuple[int | None, dict[str, list[str]], int, int]:
    """Start in ticks, rows about the channels by their labels, and number and offset of the first line."""
    ticks = None
    rows: dict[str, list[str]] = {}
    for line, (start, content) in enumerate(islice(lines_from(raw), _MOST_LINES)):
        cells = [cell.strip(' "') for cell in content.decode(codec, "replace").split(delimiter)]
        label = cells[0]
        if not rows:
            ticks = _ticks(cells) or ticks
            if line > 1 and label == "Name":
                rows[label] = cells
        elif label and _value(label) is not None:
            return ticks, rows, line, start
        else:
            rows.setdefault(label, cells)
    raise InputError(f"{path}: has no row of numbers below its header.")


def _ticks(cells: list[str]) -> int | None:
    if cells[0].startswith("Starttime") and _DIGITS.match("".join(cells[1:2])):
        return int(cells[1])
    return None


def _value(text: str) -> float | None:
    """Number of either decimal mark; the header's is that of the system, the table's that of the export."""
    return number(text.replace(",", "."), ".")


def _channels(path: Path, rows: dict[str, list[str]]) -> tuple[_Column, ...]:
    """Channels with their time columns."""
    times = _time_columns(rows)
    if 0 not in times:
        raise InputError(f"{path}: has no column of times; export it with timelines.")
    channels = []
    time = 0
    for index, name in enumerate(unique(rows["Name"])):
        if index in times:
            time = index
        elif rows["Name"][index]:
            interval = _value(_cell(rows, "SampleTime[ms]", index) or "nan")
            stated = interval / 1e3 if interval else math.nan
            unit = _cell(rows, "Unit", index).partition("(")[0].strip() or None  # of "V (Voltage)"
            channels.append(_Column(name, index, time, stated, unit, _is_scaled(rows, index)))
    return tuple(channels)


def _time_columns(rows: dict[str, list[str]]) -> set[int]:
    """Columns that have the label of each row as their cell."""
    times = set(range(len(rows["Name"])))
    for label, cells in rows.items():
        if label:
            times.intersection_update([index for index, cell in enumerate(cells) if cell == label])
    return times


def _cell(rows: dict[str, list[str]], label: str, index: int) -> str:
    cells = rows.get(label, [])
    return cells[index] if index < len(cells) else ""


def _is_scaled(rows: dict[str, list[str]], index: int) -> bool:
    """False for a channel with a scale: its values may be exported with it and without."""
    for label, neutral in _SCALES.items():
        stated = _cell(rows, label, index)
        if stated and _value(stated) != neutral:
            return False
    return True


def _filled(path: Path, table: bytes, delimiter: str, columns: int) -> bytes:
    """Table whose rows are all of one length: cells that are empty up to the end of a row are left out."""
    mark = delimiter.encode("ascii")
    rows = table.splitlines()
    check_size(path, "the table", sum(map(len, rows)) + len(rows) * columns)
    filled = [row.rstrip(mark) for row in rows]
    longest = 1 + max(row.count(mark) for row in filled)
    if longest > columns:
        raise InputError(f"{path}: a row has {longest} cells; the table has {columns} columns.")
    return b"\n".join([row + mark * (columns - 1 - row.count(mark)) for row in filled])


def _series(path: Path, table: bytes, scope: _Scope, names: Sequence[str]) -> list[Series]:
    """Samples of channels; all of the file show together whether they were written on change."""
    indices = sorted({index for channel in scope.channels for index in (channel.index, channel.time)})
    columns = dict(zip(indices, read_columns(table, scope.dialect, indices, path), strict=True))
    signals = {channel.name: _samples(path, scope, channel, columns) for channel in scope.channels}
    changed = dict(zip(signals, written_on_change(list(signals.values())), strict=True))
    series = []
    for name in names:
        signal = signals[name]
        if changed[name]:
            series.append(on_change(path, name, *signal, signal[0], lost=False))
        else:
            series.append(at_interval(path, name, *signal))
    return series


def _samples(
    path: Path, scope: _Scope, channel: _Column, columns: dict[int, Array]
) -> tuple[Array, Array, float]:
    """Times in s and values of a channel, and its interval in s."""
    present = np.isfinite(columns[channel.index])
    times, values = columns[channel.time][present], columns[channel.index][present]
    if not values.size:
        raise InputError(f"{path}: {channel.name!r} has no value.")
    if not np.isfinite(times).all():
        raise InputError(f"{path}: {channel.name!r} has values without a time.")
    seconds = times / 1e3
    if times[0] > _LONGEST:
        seconds = (times - (scope.ticks or times[0])) / _TICKS
    interval = channel.interval
    if math.isnan(interval) and seconds.size > 1:
        interval = float(np.median(np.diff(seconds)))
    return seconds, values, interval
