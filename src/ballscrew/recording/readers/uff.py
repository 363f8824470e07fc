"""Universal files: functions of time in datasets 58 (text) and 58b (binary).

Source: SDRC, Universal File Formats for Modal Analysis Testing, datasets 58, 58b and 164 (Structural Dynamics
Research Laboratory, University of Cincinnati).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.base.files import read_whole
from ballscrew.base.units import parse
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.guard import as_channel, missing_channel, refusing, unique

_MARK = re.compile(rb"(?:^|(?<=\n)) {0,4}-1[ \t]*\r?(?:\n|\Z)")  # before and after each dataset
_MARK_AFTER_BINARY = re.compile(rb"[\r\n]* {0,4}-1[ \t]*\r?(?:\n|\Z)")
_HEAD = re.compile(rb" {0,5}\d{1,6}b? *(?:\d[\d ]*)?\Z")
_NUMBER = re.compile(rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][+-]?\d+)?|NaN|[+-]?Inf")
_MOMENT = re.compile(r"(\d\d)-(\w{3})-(\d\d) +(\d\d:\d\d:\d\d)\Z")
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_BINARY_FIELDS = ((7, 13), (13, 19), (19, 31), (31, 43))  # order, kind of number, lines of the header, bytes
_LINES = 11  # of the header of a function
_TIME, _RESPONSE, _UNKNOWN = 17, 1, 0
_TYPES = {2: "f4", 4: "f8"}  # of real ordinates; 5 and 6 are complex
_SIDES = ("", "X", "Y", "Z", "RX", "RY", "RZ")
# Units by dataset 164: length and force of its systems; and their product for the quantities of a function.
_LENGTHS = {1: "m", 2: "ft", 3: "m", 5: "mm", 6: "cm", 7: "in", 8: "mm"}
_FORCES = {1: "N", 2: "lbf", 3: "kgf", 5: "mN", 6: "cN", 7: "lbf", 8: "kgf"}
_QUANTITIES = {8: "{length}", 11: "{length}/s", 12: "{length}/s^2", 9: "{force}", 13: "{force}"}


@dataclass(frozen=True, slots=True)
class _Function:
    name: str
    unit: str | None
    rate: float | None
    started_at: str | None
    samples: NDArray[Any]
    times: NDArray[Any] | None = None


class UffReader:
    """Real functions of time; their names consist of response, node, direction and label."""

    name = "uff"

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002  the content alone decides
        """True if the file begins with the mark of a dataset and its number."""
        lines = head.lstrip(b" \r\n").split(b"\n", 2)
        return (
            len(lines) == 3
            and _MARK.match(lines[0]) is not None
            and _HEAD.match(lines[1].rstrip()) is not None
        )

    def read_header(self, path: Path) -> Header:
        """Read channels with their units and rates, and the start time."""
        with refusing(path, "UFF"):
            found = _channels(path)
            starts = [each.started_at for each in found.values() if each.started_at]
            channels = [
                RawChannel(key, each.samples.size, each.unit, each.rate) for key, each in found.items()
            ]
            return Header(tuple(channels), None, min(starts, default=None), self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the channels asked for."""
        with refusing(path, "UFF"):
            found = _channels(path)
            for name in names:
                if name not in found:
                    raise missing_channel(path, name)
            return {name: as_channel(found[name].samples) for name in names}


def _channels(path: Path) -> dict[str, _Function]:
    raw = read_whole(path)
    system = 0
    found: dict[str, _Function] = {}
    kinds: set[str] = set()
    for head, start, end in _datasets(raw):
        kind = head[:6].decode("ascii").strip()
        kinds.add(kind)
        if kind == "164":
            system = int(raw[start : start + 10])
        function = _function(raw, head, start, end, system) if kind == "58" else None
        if function is not None:
            name = unique(function.name, found)
            found[name] = function
            if function.times is not None:
                found[unique(f"{name} time", found)] = _Function("", "s", None, None, function.times)
    if not found:
        raise InputError(
            f"{path}: has no real function of time; it has datasets {', '.join(sorted(kinds)) or 'none'}."
        )
    return found


def _datasets(raw: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Line with the number of each dataset, and where its content begins and ends."""
    at = _after_blank(raw, 0)
    while at < len(raw):
        mark = _MARK.match(raw, at)
        if mark is None:
            raise ValueError(f"byte {at} is not the mark of a dataset")
        start = raw.find(b"\n", mark.end()) + 1
        head = raw[mark.end() : start].rstrip()
        if not start or _HEAD.match(head) is None:
            raise ValueError(f"byte {mark.end()} is not the number of a dataset")
        if head[6:7] == b"b":
            end = _end_of_binary(raw, head, start)
            mark = _MARK_AFTER_BINARY.match(raw, end)
        else:
            mark = _MARK.search(raw, start)
            end = mark.start() if mark else 0
        if mark is None:
            raise ValueError("the file is cut, or a dataset is longer than it says")
        yield head, start, end
        at = _after_blank(raw, mark.end())


def _after_blank(raw: bytes, at: int) -> int:
    """Begin of the first line that is not blank."""
    while at < len(raw):
        end = raw.find(b"\n", at) + 1 or len(raw)
        if raw[at:end].strip():
            return at
        at = end
    return at


def _end_of_binary(raw: bytes, head: bytes, start: int) -> int:
    order, kind, lines, size = (int(head[at:end]) for at, end in _BINARY_FIELDS)
    if order not in (1, 2) or kind != 2 or lines != _LINES:
        raise ValueError("its binary numbers are not of IEEE 754")
    end = _after_lines(raw, start) + size
    if end > len(raw):
        raise ValueError(f"the file is cut: it holds {len(raw)} of {end} bytes")
    return end


def _after_lines(raw: bytes, at: int) -> int:
    for _ in range(_LINES):
        at = raw.index(b"\n", at) + 1
    return at


def _function(raw: bytes, head: bytes, start: int, end: int, system: int) -> _Function | None:
    """Function of a dataset 58; None unless it is a real one of time."""
    data = _after_lines(raw, start)
    lines = [_decoded(line) for line in raw[start:data].splitlines()]
    if len(lines) != _LINES or data > end:
        raise ValueError("the header of a function is cut")
    if not _is_of_time(lines):
        return None
    samples, times = _values(raw[data:end], head, lines)
    size = int(lines[6][10:20])
    if samples.size != size or not size:
        raise ValueError(f"a function holds {samples.size} of {size} values")
    second = _seconds(lines[7][47:67].strip())
    step = _numbers(lines[6][30:].encode())[1]
    rate = None
    if times is not None:
        times = times * second
    elif step > 0:
        rate = 1.0 / (step * second)
    return _Function(_name(lines), _unit_of(lines[8], system), rate, _moment(lines[2]), samples, times)


def _is_of_time(lines: list[str]) -> bool:
    """True for real values over time, also where only their kind, a response in time, says so."""
    kind, abscissa, response = int(lines[6][:10]), int(lines[7][:10]), int(lines[5][:5])
    of_time = abscissa == _TIME or (abscissa, response) == (_UNKNOWN, _RESPONSE)
    return of_time and kind in _TYPES


def _values(content: bytes, head: bytes, lines: list[str]) -> tuple[NDArray[Any], NDArray[Any] | None]:
    """Ordinates, and abscissae where the header gives no interval."""
    even = int(lines[6][20:30]) == 1
    if head[6:7] == b"b":
        order = "<" if int(head[7:13]) == 1 else ">"
        return _binary(content, order + _TYPES[int(lines[6][:10])], int(lines[6][10:20]), even=even)
    found = _numbers(content)
    if even:
        return found, None
    times, samples = found.reshape(-1, 2).T
    return samples, times


def _decoded(line: bytes) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _numbers(text: bytes) -> NDArray[np.float64]:
    """Numbers that fill a text; those of fixed width may touch each other."""
    found = _NUMBER.findall(text)
    if len(b"".join(found)) != len(b"".join(text.split())):
        raise ValueError("a function holds other text than numbers")
    return np.array([float(each.replace(b"D", b"E").replace(b"d", b"e")) for each in found])


def _binary(raw: bytes, kind: str, size: int, *, even: bool) -> tuple[NDArray[Any], NDArray[Any] | None]:
    """Ordinates, and abscissae of the same or of single precision."""
    width = int(kind[2:])
    if even and len(raw) == size * width:
        return np.frombuffer(raw, kind), None
    for other in (kind, kind[:2] + "4"):
        pair = np.dtype([("x", other), ("y", kind)])
        if not even and len(raw) == size * pair.itemsize:
            pairs = np.frombuffer(raw, pair)
            return pairs["y"], pairs["x"]
    raise ValueError(f"a function has {len(raw)} bytes and declares {size} values")


def _seconds(unit: str) -> float:
    """Seconds in a unit of time; 1 where it is not understood, as the format states."""
    try:
        return parse(f"1 {unit}", "s")
    except InputError:
        return 1.0


def _unit_of(ordinate: str, system: int) -> str | None:
    """Unit by its label, else of the quantity in the system of dataset 164; None without either."""
    label = ordinate[47:67].strip()
    if label not in ("", "NONE"):
        return label
    unit = _QUANTITIES.get(int(ordinate[:10]), "")
    if not unit or system not in _LENGTHS:
        return None
    return unit.format(length=_LENGTHS[system], force=_FORCES[system])


def _name(lines: list[str]) -> str:
    """Response, node, direction and label, ``"NUT 3+X Acceleration"``; else the title of the function."""
    node, side = int(lines[5][41:51]), int(lines[5][51:55])
    place = ""
    if node:
        sign = "-" if side < 0 else "+"
        place = f"{node}{sign}{_SIDES[abs(side)]}" if side else str(node)
    response = lines[5][31:41].strip()
    parts = [response, place if place not in response else "", lines[8][26:46].strip()]
    name = " ".join(part for part in parts if part not in ("", "NONE"))
    return name or lines[0].strip() or "function"


def _moment(text: str) -> str | None:
    """Date and time of ``31-Jan-26 08:00:00``, without a zone; None for other texts."""
    match = _MOMENT.match(text.strip())
    if match is None or match[2].casefold() not in _MONTHS:
        return None
    month = 1 + _MONTHS.index(match[2].casefold())
    century = 19 if int(match[3]) > 68 else 20  # as POSIX
    try:
        return datetime.fromisoformat(f"{century}{match[3]}-{month:02}-{match[1]} {match[4]}").isoformat()
    except ValueError:
        return None
