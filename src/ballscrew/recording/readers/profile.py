"""Profiles: families of text exports that a TOML file describes, so that a new one needs no code."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.base.files import read_whole
from ballscrew.base.tomlfile import Fields, read_toml
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.dialect import TableDialect, lines_from, number, split_line, unique
from ballscrew.recording.readers.guard import check_size, missing_channel, refusing
from ballscrew.recording.readers.text import decoded, read_columns

FOLDER = "BALLSCREW_PROFILES"
"""Environment variable: a folder of profiles, which are asked before those of the package."""

_OWN = Path(__file__).with_name("profiles")
_ABOVE = 1 << 16  # bytes of a file in which its table begins
_FIELDS = (
    "match", "delimiter", "decimal", "names", "names_after", "names_line", "names_patterns", "units_line",
    "units_pattern", "first_line", "ends_before", "interval", "rate", "units", "start_pattern",
)  # fmt: skip
_DELIMITERS = (",", ";", "\t", "|", " ")

Pattern = re.Pattern[str]


@dataclass(frozen=True)
class TextProfile:
    """Family of text exports; the fields are those of its TOML file.

    Parameters
    ----------
    name : str
        Of the TOML file.
    match : Pattern
        Found at the beginning of each file of the family, and of no other.
    delimiter, decimal : str
        Of the cells and of the numbers.
    names : tuple of str
        Of the first columns.
    names_patterns : tuple of Pattern
        What they find above the table are the names of the other columns.
    units_pattern, start_pattern, names_after, ends_before : Pattern, optional
        Find the units, the start time, the line from which lines are counted, and that below the table.
    names_line, units_line, first_line : int
        Lines of names, of units (0 without) and of the first row, from 1.
    interval, rate : tuple of Pattern and float, optional
        Find the interval of the samples or their rate, and its unit in s or Hz.
    units : tuple of (Pattern, str)
        Units of the columns whose names match.
    """

    name: str
    match: Pattern
    delimiter: str
    decimal: str
    names: tuple[str, ...]
    names_patterns: tuple[Pattern, ...]
    units_pattern: Pattern | None
    start_pattern: Pattern | None
    names_after: Pattern | None
    ends_before: Pattern | None
    names_line: int
    units_line: int
    first_line: int
    interval: tuple[Pattern, float] | None
    rate: tuple[Pattern, float] | None
    units: tuple[tuple[Pattern, str], ...]


def read_profile(path: Path) -> TextProfile:
    """Read a profile.

    Raises
    ------
    InputError
        If the file cannot be read, a field is not known, is missing or has an impossible value.
    """
    fields = read_toml(path)
    fields.only(_FIELDS)
    names_line = fields.whole("names_line", 0)
    profile = TextProfile(
        name=path.stem,
        match=_pattern(fields, "match", fields.text("match")),
        delimiter=_delimiter(fields),
        decimal=fields.text("decimal", ".", choices=(".", ",")),
        names=_texts(fields, "names"),
        names_patterns=tuple(
            _pattern(fields, "names_patterns", each) for each in _texts(fields, "names_patterns")
        ),
        units_pattern=_optional(fields, "units_pattern"),
        start_pattern=_optional(fields, "start_pattern"),
        names_after=_optional(fields, "names_after"),
        ends_before=_optional(fields, "ends_before"),
        names_line=names_line,
        units_line=fields.whole("units_line", 0),
        first_line=fields.whole("first_line", least=1),
        interval=_scaled(fields, "interval", "s"),
        rate=_scaled(fields, "rate", "Hz"),
        units=_units(fields),
    )
    if not (names_line or profile.names or profile.names_patterns):
        raise fields.error("names_line", "given, or names or names_patterns in its place")
    return profile


def _delimiter(fields: Fields) -> str:
    delimiter = fields.table.get("delimiter", ",")
    if delimiter not in _DELIMITERS:
        raise fields.error("delimiter", "a comma, semicolon, tab, bar or blank")
    return str(delimiter)


def _pattern(fields: Fields, field: str, text: str) -> Pattern:
    try:
        return re.compile(text, re.MULTILINE)
    except (re.error, OverflowError, RecursionError) as error:
        raise InputError(f"{fields.source}: {field} is no regular expression: {error}.") from None


def _optional(fields: Fields, field: str) -> Pattern | None:
    text = fields.text(field, None)
    return None if text is None else _pattern(fields, field, text)


def _texts(fields: Fields, field: str) -> tuple[str, ...]:
    texts = fields.table.get(field, [])
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise fields.error(field, "a list of texts")
    return tuple(texts)


def _scaled(fields: Fields, field: str, unit: str) -> tuple[Pattern, float] | None:
    if field not in fields:
        return None
    table = fields.sub(field)
    table.only(("pattern", "unit"))
    pattern = _pattern(fields, f"{field}.pattern", table.text("pattern"))
    if pattern.groups != 1:
        raise table.error("pattern", "an expression with one group, the number")
    text = table.text("unit")
    scale = Fields({"unit": text if text[:1].isdigit() else f"1 {text}"}, fields.source, field)
    return pattern, scale.quantity("unit", unit, above=0.0)


def _units(fields: Fields) -> tuple[tuple[Pattern, str], ...]:
    if "units" not in fields:
        return ()
    table = fields.sub("units")
    return tuple((_pattern(fields, "units", name), table.text(name)) for name in table.table)


@cache
def profiles() -> tuple[tuple[TextProfile, ...], str]:
    """Profiles of the user's folder and of the package, and what is wrong with those of the user.

    They are read once, before a file is opened: the process that reads it can open no other.
    """
    read, failure = [], ""
    folder = os.environ.get(FOLDER)
    if folder:
        try:
            read = [read_profile(path) for path in sorted(Path(folder).glob("*.toml"))]
            failure = "" if read else f"{folder}: has no profile *.toml ({FOLDER})."
        except (InputError, OSError) as error:
            failure = f"{error} ({FOLDER})"
    read += [read_profile(path) for path in sorted(_OWN.glob("*.toml"))]
    return tuple(read), failure


class ProfileReader:
    """Text exports by profiles; the rows are read as those of any text."""

    name = "profile"

    def __init__(self) -> None:
        self._profiles, self._failure = profiles()

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002  the content alone decides
        """True if a profile matches the beginning; also for any text if a profile of the user is wrong."""
        if b"\0" in head:
            return False
        return bool(self._failure) or self._profile(head.decode("latin-1")) is not None

    def _profile(self, text: str) -> TextProfile | None:
        for profile in self._profiles:
            if profile.match.search(text.removeprefix("ï»¿")):
                return profile
        return None

    def read_header(self, path: Path) -> Header:
        """Read columns with units, rate and start as the profile states."""
        with refusing(path, "text"):
            raw, table, profile = self._open(path)
            rows = 1 + raw.count(b"\n", table.start)
            channels = [
                RawChannel(name, rows, unit) for name, unit in zip(table.names, table.units, strict=True)
            ]
            return Header(tuple(channels), table.sample_rate, table.started_at, f"{self.name} {profile.name}")

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the columns asked for."""
        with refusing(path, "text"):
            raw, table, _ = self._open(path)
            for name in names:
                if name not in table.names:
                    raise missing_channel(path, name)
            if not names:
                return {}
            indices = [table.names.index(name) for name in names]
            return dict(zip(names, read_columns(raw, table, indices, path), strict=True))

    def _open(self, path: Path) -> tuple[bytes, TableDialect, TextProfile]:
        if self._failure:
            raise InputError(self._failure)
        raw, codec = decoded(read_whole(path), path)
        head = raw[:_ABOVE]
        profile = self._profile(head[:4096].decode("latin-1"))
        if profile is None:
            raise InputError(f"{path}: does not begin as any profile states.")
        return (*_table(path, raw, codec, profile), profile)


def _table(path: Path, raw: bytes, codec: str, profile: TextProfile) -> tuple[bytes, TableDialect]:
    """Content up to the end of the table, and the dialect of that."""
    lines, offsets = [], []
    for offset, content in lines_from(raw[:_ABOVE]):
        lines.append(content.decode(codec, "replace"))
        offsets.append(offset)
    after = _line_after(path, lines, profile)
    first = after + profile.first_line - 1
    if first >= len(lines):
        raise InputError(f"{path}: ends before its table, by the profile {profile.name}.")
    above = "\n".join(lines[:first])
    names = _names(path, lines, after, above, profile)
    units = _units_of(lines, after, above, names, profile)
    check_size(path, "the columns", len(names))
    started_at = _found(profile.start_pattern, above)
    rate = _rate(path, above, profile)
    table = TableDialect(
        profile.delimiter, profile.decimal, names, units, first, offsets[first], rate, started_at
    )
    return _without_end(raw, codec, profile), table


def _line_after(path: Path, lines: list[str], profile: TextProfile) -> int:
    """Number of the line from which the profile counts, from 0."""
    if profile.names_after is None:
        return 0
    for index, line in enumerate(lines):
        if profile.names_after.search(line):
            return index + 1
    raise InputError(f"{path}: has no line {profile.names_after.pattern!r}, which {profile.name} requires.")


def _names(path: Path, lines: list[str], after: int, above: str, profile: TextProfile) -> tuple[str, ...]:
    names = list(profile.names)
    if profile.names_line:
        names += _cells(lines, after, profile.names_line, profile)
    found = [pattern.findall(above) for pattern in profile.names_patterns]
    for parts in zip_longest(*found, fillvalue=""):
        names.append(" ".join(filter(None, map(str.strip, parts))))
    if not any(names):
        raise InputError(f"{path}: has no names of columns where the profile {profile.name} expects them.")
    return unique(name or f"column_{index}" for index, name in enumerate(names, start=1))


def _units_of(
    lines: list[str], after: int, above: str, names: tuple[str, ...], profile: TextProfile
) -> tuple[str | None, ...]:
    stated: list[str] = []
    if profile.units_line:
        stated = [cell.strip("[]() ") for cell in _cells(lines, after, profile.units_line, profile)]
    elif profile.units_pattern is not None:
        stated = [""] * len(profile.names) + [each.strip() for each in profile.units_pattern.findall(above)]
    units: list[str | None] = []
    for unit, name in zip_longest(stated[: len(names)], names, fillvalue=""):
        units.append(unit or _unit_by_name(name, profile))
    return tuple(units)


def _unit_by_name(name: str, profile: TextProfile) -> str | None:
    for pattern, unit in profile.units:
        if pattern.fullmatch(name):
            return unit
    return None


def _cells(lines: list[str], after: int, line: int, profile: TextProfile) -> list[str]:
    index = after + line - 1
    return split_line(lines[index], profile.delimiter) if index < len(lines) else []


def _found(pattern: Pattern | None, above: str) -> str | None:
    match = None if pattern is None else pattern.search(above)
    return None if match is None else match[match.re.groups and 1]


def _rate(path: Path, above: str, profile: TextProfile) -> float | None:
    """Sample rate, Hz."""
    stated = profile.interval or profile.rate
    if stated is None:
        return None
    pattern, scale = stated
    values = {number(text.strip(), profile.decimal) for text in pattern.findall(above)}
    if len(values) > 1:
        raise InputError(f"{path}: states several intervals or rates; record all channels at one.")
    value = values.pop() if values else None
    if not value or not value > 0:
        raise InputError(f"{path}: states no rate where the profile {profile.name} expects it.")
    return 1.0 / (value * scale) if profile.interval else value * scale


def _without_end(raw: bytes, codec: str, profile: TextProfile) -> bytes:
    """Content up to the line below the table, without empty rows."""
    if profile.ends_before is not None:
        match = re.compile(profile.ends_before.pattern.encode(codec), re.MULTILINE).search(raw)
        if match is not None:
            raw = raw[: match.start()]
    return raw.rstrip(b" \t\r\n\x1a" + profile.delimiter.encode())
