"""SINUMERIK: traces, and measurements of frequency responses (AST), both XML."""

from __future__ import annotations

import re
from array import array
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.files import read_whole
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.dialect import unique
from ballscrew.recording.readers.grid import Series, on_change
from ballscrew.recording.readers.guard import check_size, missing_channel, refusing

# Of a trace's ``unitsType``; in the traces of public repositories, velo is mm/min where posn is mm.
_UNITS = {"posn": "mm", "velo": "mm/min", "current": "A", "torque": "N m", "percent": "%"}
_DIGITS = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ!#$`()*+-/:;=?@[]^_{|}~"
_WORDS = re.compile(rb"(?:\.|[^.]{5})*\Z")  # groups of five digits, or a point for the word 0
_DATE = re.compile(r"(\d{4})(\d\d)(\d\d)\Z")
_TIME = re.compile(r"(\d\d)(\d\d)(\d\d(?:\.\d+)?)\Z")


class TraceReader:
    """Traces of SINUMERIK Operate: signals written when they change, each with an interval of its own."""

    name = "sinumerik-trace"

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002  the content alone decides
        """True if the file begins as XML with a session of traces."""
        return b"<traceSession" in head

    def read_header(self, path: Path) -> Header:
        """Read signals with unit, rate and first time; the start is that of the control's clock."""
        with refusing(path, "SINUMERIK trace"):
            trace = _Trace(path)
            return _header(trace.series(), trace.units(), trace.started_at, self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the signals asked for; an omitted value is the one before."""
        with refusing(path, "SINUMERIK trace"):
            return _chosen(path, _Trace(path).series(), names)


class ResponseReader:
    """Time series of a frequency response that SINUMERIK measured (AST)."""

    name = "sinumerik-response"

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002  the content alone decides
        """True if the file begins as XML with classes of the servo tuning."""
        return b"satclassid=" in head and head.lstrip(b"\xef\xbb\xbf \r\n").startswith(b"<")

    def read_header(self, path: Path) -> Header:
        """Read the time series of each signal, with rate; the file states no unit."""
        with refusing(path, "SINUMERIK frequency response"):
            response = _Response(path)
            return _header(response.series(), {}, response.started_at(), self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the time series asked for."""
        with refusing(path, "SINUMERIK frequency response"):
            return _chosen(path, _Response(path).series(), names)


def _header(
    series: dict[str, Series], units: dict[str, str | None], started_at: str | None, reader: str
) -> Header:
    first = min(each.start for each in series.values())
    channels = []
    for name, each in series.items():
        rate = 1.0 / each.interval
        channels.append(RawChannel(name, each.values.size, units.get(name), rate, each.start - first))
    return Header(tuple(channels), None, started_at, reader)


def _chosen(path: Path, series: dict[str, Series], names: Iterable[str]) -> dict[str, NDArray[Any]]:
    chosen: dict[str, NDArray[Any]] = {}
    for name in names:
        if name not in series:
            raise missing_channel(path, name)
        chosen[name] = series[name].values
    return chosen


class _Elements:
    """Receiver of the elements of a file."""

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Receive the start of an element."""

    def end(self, tag: str) -> None:
        """Receive its end."""

    def text(self, text: str) -> None:
        """Receive text."""


def _parse(path: Path, elements: _Elements) -> None:
    """Pass the elements of a file to their receiver, in one pass and without a tree."""
    parser = expat.ParserCreate()
    parser.buffer_text = True

    def refuse(*_: Any) -> None:
        raise InputError(f"{path}: declares a document type, which no file of a control does.")

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = elements.start
    parser.EndElementHandler = elements.end
    parser.CharacterDataHandler = elements.text
    try:
        parser.Parse(read_whole(path), True)
    except expat.ExpatError as error:
        raise InputError(f"{path}: is damaged or cut off: its XML ends with an error ({error}).") from None


@dataclass
class _Signal:
    name: str
    unit: str
    key: str
    interval: float
    records: array[int] = field(default_factory=lambda: array("q"))
    values: list[str] = field(default_factory=list)


class _Trace(_Elements):
    """Signals and records of a trace."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.started_at: str | None = None
        self.signals: dict[str, _Signal] = {}
        self._times: list[str] = []
        self._frames = 0
        self._lost = False
        self._set_up: dict[str, str] = {}
        _parse(path, self)

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if tag == "rec":
            self._record(attributes)
        elif tag == "dataSignal":
            self._signal(attributes)
        elif tag == "frameHeader":
            self.started_at = attributes.get("startTime")
            self._lost = attributes.get("dropOuts", "0").strip() not in ("", "0")
        elif tag == "dataFrame":
            self._frames += 1
            if self._frames > 1:
                raise InputError(f"{self.path}: has several recordings; save each to a file of its own.")
        elif tag == "signal":  # as it was set up, before the data
            self._set_up.setdefault(attributes.get("key", ""), attributes.get("unitsType", ""))

    def _signal(self, attributes: dict[str, str]) -> None:
        name = attributes["name"]
        if "interval" not in attributes:
            raise InputError(f"{self.path}: {name!r} has no interval, so its rate is unknown.")
        interval = _number(self.path, "interval", attributes["interval"])
        signal = _Signal(name, attributes.get("unitsType", ""), attributes.get("key", ""), interval)
        if attributes["id"] in self.signals:
            raise InputError(f"{self.path}: two signals have the id {attributes['id']!r}.")
        self.signals[attributes["id"]] = signal

    def _record(self, attributes: dict[str, str]) -> None:
        number = len(self._times)
        self._times.append(attributes.pop("time"))
        for key, text in attributes.items():
            signal = self.signals.get(key)
            if signal is not None:
                signal.records.append(number)
                signal.values.append(text)

    def series(self) -> dict[str, Series]:
        """Samples by name, of the signals that have any."""
        recorded = self._recorded()
        if not recorded:
            raise InputError(f"{self.path}: holds no recorded signal.")
        times = _numbers(self.path, "time", self._times)
        series: dict[str, Series] = {}
        size = 0
        for name, signal in recorded.items():
            values = _numbers(self.path, name, signal.values)
            at = times[np.array(signal.records)]
            each = on_change(self.path, name, at, values, signal.interval, times, self._lost)
            size += each.values.nbytes
            check_size(self.path, "all signals", size)
            series[name] = each
        return series

    def units(self) -> dict[str, str | None]:
        """Units by name; one that the data do not state is that of the set-up."""
        units = {}
        for name, signal in self._recorded().items():
            units[name] = _UNITS.get(signal.unit) or _UNITS.get(self._set_up.get(signal.key, ""))
        return units

    def _recorded(self) -> dict[str, _Signal]:
        signals = [signal for signal in self.signals.values() if signal.values]
        return dict(zip(unique([signal.name for signal in signals]), signals, strict=True))


class _Response(_Elements):
    """Time series of a measurement of frequency responses."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._fields: list[tuple[str, dict[str, str]]] = []  # of each time series, with its signal
        self._stamp: dict[str, str] = {}
        self._node = ""
        self._name = ""
        self._inside = ""
        self._pieces: list[str] = []
        _parse(path, self)

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        name = attributes.get("name", "")
        if tag in ("TimeSeries", "SatTimeStamp"):
            self._inside = tag
            if tag == "TimeSeries":
                self._fields.append((self._node, {}))
        self._name = "raw" if tag == "raw" else name
        self._pieces = []

    def text(self, text: str) -> None:
        if self._name:
            self._pieces.append(text)

    def end(self, tag: str) -> None:
        if self._name:
            text = "".join(self._pieces).strip()
            if self._inside == "TimeSeries":
                self._fields[-1][1].setdefault(self._name, text)
            elif self._inside == "SatTimeStamp":
                self._stamp.setdefault(self._name, text)
            elif self._name == "m_uNodeId":
                self._node = text
        self._name = ""
        if tag == self._inside:
            self._inside = ""

    def started_at(self) -> str | None:
        """Time of the measurement by the control's clock, ISO 8601."""
        date = _DATE.match(self._stamp.get("Date", ""))
        time = _TIME.match(self._stamp.get("Time", ""))
        if date is None or time is None:
            return None
        return f"{date[1]}-{date[2]}-{date[3]}T{time[1]}:{time[2]}:{time[3]}"

    def series(self) -> dict[str, Series]:
        """Samples by the number of the signal and that of the series."""
        if not self._fields:
            raise InputError(f"{self.path}: has no time series; measure with the time series saved.")
        counts: Counter[str] = Counter()
        series = {}
        for node, fields in self._fields:
            counts[node] += 1
            name = f"signal {node}, series {counts[node]}"
            series[name] = self._samples(name, fields)
        return series

    def _samples(self, name: str, fields: dict[str, str]) -> Series:
        values = _decoded(self.path, name, fields.get("raw", ""))
        stated = {}
        for key in ("m_length", "m_TimeVector.length", "m_TimeVector.start", "m_TimeVector.end"):
            if key not in fields:
                raise InputError(f"{self.path}: {name!r} has no {key}.")
            stated[key] = _number(self.path, key, fields[key])
        if values.size < 2 or {stated["m_length"], stated["m_TimeVector.length"]} != {values.size}:
            raise InputError(f"{self.path}: {name!r} has {values.size} values, not as many as it declares.")
        interval = (stated["m_TimeVector.end"] - stated["m_TimeVector.start"]) / (values.size - 1)
        if not (np.isfinite(interval) and interval > 0):
            raise InputError(
                f"{self.path}: {name!r} has the interval {interval:g} s; it must be more than 0."
            )
        return Series(stated["m_TimeVector.start"], interval, values)


def _decoded(path: Path, name: str, text: str) -> Array:
    """Numbers of 8 bytes, each of two words in base 85."""
    digits = "".join(text.split()).encode("latin-1", "replace")
    if _WORDS.match(digits) is None:
        raise InputError(f"{path}: {name!r} is damaged: its text is no sequence of words.")
    table = np.full(256, 255, dtype=np.uint8)
    table[np.frombuffer(_DIGITS.encode("ascii"), np.uint8)] = np.arange(85)
    numbers = table[np.frombuffer(digits.replace(b".", b"00000"), np.uint8)]
    if np.any(numbers == 255) or numbers.size % 10:
        raise InputError(f"{path}: {name!r} is damaged: its text has letters that are no digits, or too few.")
    powers = 85 ** np.arange(4, -1, -1, dtype=np.uint64)
    words = numbers.reshape(-1, 5).astype(np.uint64) @ powers
    if np.any(words >> np.uint64(32)):
        raise InputError(f"{path}: {name!r} is damaged: a word of it is too large.")
    return np.frombuffer(words.astype(">u4").tobytes(), ">f8").astype(np.float64)


def _numbers(path: Path, name: str, texts: list[str]) -> Array:
    try:
        numbers = np.array(list(map(float, texts)))
    except ValueError:
        numbers = np.full(1, np.nan)
    # Python's numbers may have "_" in them.
    if "_" in "".join(texts) or not np.isfinite(numbers).all():
        raise InputError(f"{path}: {name!r} has values that are no numbers.")
    return numbers


def _number(path: Path, name: str, text: str) -> float:
    return float(_numbers(path, name, [text])[0])
