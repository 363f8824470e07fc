"""LVM: text files of LabVIEW's *Write To Measurement File*.

Source: NI, Specification for the LabVIEW Measurement File (.lvm), 2023. Headers of a file and of its segments
are lines of a key and values; a table of the samples follows each header of a segment.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.files import read_whole
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.dialect import number
from ballscrew.recording.readers.guard import missing_channel, refusing, unique

_SIGNATURE = b"LabVIEW Measurement"
_END = "***End_of_Header***"
_SPECIAL, _SPECIAL_END = "***Start_Special***", "***End_Special***"
_SEPARATORS = {"Tab": "\t", "Comma": ","}
_X = "X_Value"
_SAME_STEP = 0.01  # of times written with six decimals


@dataclass(frozen=True, slots=True)
class _Channel:
    unit: str | None
    rate: float | None
    started_at: str | None
    samples: NDArray[Any]


class LvmReader:
    """Channels by the titles of their columns; of several segments as ``segment 2/Voltage``."""

    name = "lvm"

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002  the content alone decides
        """True if the file begins as LabVIEW's."""
        return head.startswith(_SIGNATURE)

    def read_header(self, path: Path) -> Header:
        """Read channels with their units and rates, and the start time."""
        with refusing(path, "LVM"):
            found = _read(path)
            channels = [RawChannel(name, c.samples.size, c.unit, c.rate) for name, c in found.items()]
            starts = [channel.started_at for channel in found.values() if channel.started_at]
            return Header(tuple(channels), None, min(starts, default=None), self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the channels asked for; an empty cell between others is NaN."""
        with refusing(path, "LVM"):
            found = _read(path)
            for name in names:
                if name not in found:
                    raise missing_channel(path, name)
            return {name: found[name].samples for name in names}


@dataclass(frozen=True, slots=True)
class _Text:
    lines: list[str]
    separator: str
    decimal: str
    multi_headings: bool


def _read(path: Path) -> dict[str, _Channel]:
    raw = read_whole(path)
    if not raw.endswith((b"\n", b"\r")):
        raise ValueError("the file is cut: it ends in the middle of a line")
    try:
        content = raw.decode("utf-8")
    except UnicodeDecodeError:
        content = raw.decode("latin-1")
    lines = content.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    # The separator is stated in a line that contains it.
    separator = "," if lines[1].count(",") > lines[1].count("\t") else "\t"
    about, at = _header(lines, 1, separator)
    separator = _SEPARATORS.get(about.get("Separator", [""])[0], separator)
    decimal = about.get("Decimal_Separator", [""])[0] or _decimal_of(lines, separator)
    if decimal not in (".", ",") or decimal == separator:
        raise ValueError(f"its decimal mark is {decimal!r}")
    many = about.get("Multi_Headings", ["No"])[0].casefold() == "yes"
    segments = list(_segments(_Text(lines, separator, decimal, many), at))
    if len(segments) == 1:
        return segments[0]
    found: dict[str, _Channel] = {}
    for index, segment in enumerate(segments, start=1):
        found |= {f"segment {index}/{name}": channel for name, channel in segment.items()}
    return found


def _decimal_of(lines: list[str], separator: str) -> str:
    """Decimal mark of an old file, which states none, from the interval between its samples."""
    step = next((line for line in lines if line.startswith(f"Delta_X{separator}")), "")
    return "," if "," in step.replace(separator, " ") else "."


def _header(lines: list[str], at: int, separator: str) -> tuple[dict[str, list[str]], int]:
    """Values of each key of a header, and the line after it."""
    values: dict[str, list[str]] = {}
    for index in range(at, len(lines)):
        cells = lines[index].split(separator)
        if cells[0].strip() == _END:
            return values, index + 1
        values[cells[0].strip()] = [cell.strip() for cell in cells[1:]]
    raise ValueError("the file is cut in a header")


def _segments(text: _Text, at: int) -> Iterator[dict[str, _Channel]]:
    """Channels of each segment; segments are separated by empty lines."""
    lines = text.lines
    while at < len(lines):
        if not lines[at].strip():
            at += 1
        elif lines[at].startswith(_SPECIAL):
            at = lines.index(next(line for line in lines[at:] if line.startswith(_SPECIAL_END)), at) + 1
        else:
            about, at = _header(lines, at, text.separator)
            end = at + 1
            while end < len(lines) and lines[end].strip():
                end += 1
            # The file's last line ends too: an empty line more closes the segment.
            yield _segment(text, about, at, end, closed=end < len(lines) - 1)
            at = end


def _segment(
    text: _Text, about: dict[str, list[str]], at: int, end: int, *, closed: bool
) -> dict[str, _Channel]:
    titles = list(map(str.strip, text.lines[at].split(text.separator)))
    if "Comment" in titles:
        titles = titles[: titles.index("Comment")]
    rows = end - at - 1
    declared = max([int(cell) for cell in about.get("Samples", []) if cell], default=0)
    if text.multi_headings and not closed and rows < declared:
        raise ValueError(f"the file is cut: it holds {rows} of {declared} samples")
    found: dict[str, _Channel] = {}
    times = np.empty(0)
    for column, samples in enumerate(_columns(text, at + 1, end, len(titles))):
        if titles[column] == _X:
            times = samples
            channel = _Channel("s", None, None, samples)
        else:
            channel = _channel(text, about, column, times[: samples.size], samples)
        if samples.size:
            found[unique(titles[column], found)] = channel
    return found


def _channel(
    text: _Text, about: dict[str, list[str]], column: int, times: NDArray[Any], samples: NDArray[Any]
) -> _Channel:
    # A header's key is where the table has its first column.
    fields = {key: values[column - 1] for key, values in about.items() if 0 < column <= len(values)}
    return _Channel(fields.get("Y_Unit_Label") or None, _rate(text, fields, times), _moment(fields), samples)


def _columns(text: _Text, first: int, end: int, count: int) -> list[NDArray[Any]]:
    """Numbers of each column, without the empty cells at its end."""
    columns = [array("d") for _ in range(count)]
    sizes = [0] * count
    for at in range(first, end):
        cells = text.lines[at].split(text.separator)
        for index, cell in enumerate(cells[:count]):
            value = number(cell.strip(), text.decimal)
            if value is None:
                raise ValueError(f"line {at + 1} has {cell[:40]!r} in place of a number")
            columns[index].extend([math.nan] * (at - first - len(columns[index])))
            columns[index].append(value)
            if cell.strip():
                sizes[index] = at - first + 1
    return [np.array(column[:size]) for column, size in zip(columns, sizes, strict=True)]


def _rate(text: _Text, fields: dict[str, str], times: NDArray[Any]) -> float | None:
    """Sample rate of a channel, Hz; None where the times of the table have another, or there is no time."""
    step = number(fields.get("Delta_X", ""), text.decimal)
    if fields.get("X_Dimension", "Time") != "Time" or not step or not step > 0:
        return None
    if times.size > 1 and not abs((times[-1] - times[0]) / (times.size - 1) / step - 1) < _SAME_STEP:
        return None
    return 1.0 / step


def _moment(fields: dict[str, str]) -> str | None:
    """Date and time, without a zone, which the file does not give."""
    text = f"{fields.get('Date', '')} {fields.get('Time', '').replace(',', '.')}"
    try:
        return datetime.fromisoformat(text.replace("/", "-")[:26]).isoformat()
    except ValueError:
        return None
