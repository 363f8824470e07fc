"""Dialect of a text table: delimiter, decimal mark, kinds of cells, first row, titles and units."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import compress
from pathlib import Path

from ballscrew.base.errors import InputError
from ballscrew.recording.readers.labels import is_unit, split_label

BLANKS = " "  # stands for any run of blanks and tabs as the delimiter
COMMENTS = ("#", "%")
_LINE = re.compile(rb"[^\r\n]*(?:\r\n|\r|\n|\Z)")
_NUMBER = re.compile(
    r"[+-]?(?:(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|nan|inf|infinity)\Z", re.IGNORECASE
)
_MOMENT = re.compile(r"(?:\d{1,4}[-./]\d{1,2}[-./]\d{1,4}|\d{1,2}:\d{2})[-0-9:.,TZ+ ]*\Z")
_WORD = re.compile(r"""['"“„(\[<_*?!-]*[^\W\d_]""")  # a letter, after any marks
_MOST_LINES = 400
_MOST_BYTES = 1 << 20
_LEAST_LINES = 8
_CANDIDATES = [(delimiter, decimal) for delimiter in ("\t", ";", ",", "|", BLANKS) for decimal in (".", ",")]
# Bounded, as is the length of a note: the time of a search then increases linearly with the file.
_LONGEST_NOTE = 300
_LABEL = re.compile(r"[^\s\[(]+(?:\s{0,20}[\[(][^\])]{0,80}[\])])?")
_RATE = re.compile(
    r"\b(?:sampl\w*[ _-]*(?:rate|freq\w*)|abtast(?:rate|frequenz)|fs)\b"
    r"[^\d\r\n]*([0-9]+(?:[.,][0-9]+)?)\s*(?:[kM]?Hz)?\W*\Z",
    re.IGNORECASE,
)
_HERTZ = re.compile(r"(k|M|)Hz", re.IGNORECASE)
_PREFIXES = {"": 1.0, "k": 1e3, "m": 1e6}
_START = re.compile(
    r"\b(?:start\w*|began|beginn|recorded|measured|messbeginn)\b.*?"
    r"(\d{4}-\d{2}-\d{2}(?:[T ][0-9:.]+(?:Z|[+-]\d\d:?\d\d)?)?)",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class TableDialect:
    """Dialect of a text table.

    Parameters
    ----------
    delimiter : str
        One character; a blank stands for any run of blanks and tabs.
    decimal : str
        Point or comma.
    names, units : tuple of str
        Name and unit of each column; the name is the whole header as written.
    first : int
        Number of the first line of numbers, from 0.
    start : int
        Offset of that line in bytes.
    sample_rate : float, optional
        From a line above the table, Hz.
    started_at : str, optional
        From a line above the table.
    """

    delimiter: str
    decimal: str
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    first: int
    start: int
    sample_rate: float | None = None
    started_at: str | None = None


@dataclass(frozen=True, slots=True)
class _Table:
    """Reading of the first lines as a table with rows of numbers."""

    rows: int
    titled: bool
    columns: int
    trailing: bool  # every row ends with a delimiter
    first: int
    delimiter: str
    decimal: str

    @property
    def rank(self) -> tuple[int, bool, int]:
        """The reading with the largest rank is the best."""
        return self.rows, self.titled, self.columns


def lines_from(raw: bytes, start: int = 0) -> Iterator[tuple[int, bytes]]:
    """Yield offset and content, without its end, of each line; any of the three ends of line."""
    for match in _LINE.finditer(raw, start):
        if match.end() > match.start():
            yield match.start(), match[0].rstrip(b"\r\n")


def split_line(line: str, delimiter: str) -> list[str]:
    """Split a line into cells, without the blanks and quotes around them."""
    if delimiter == BLANKS:
        return line.split()
    cells = line.split(delimiter)
    if '"' in line:
        with suppress(csv.Error, StopIteration):
            cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    return list(map(str.strip, cells))


def number(cell: str, decimal: str) -> float | None:
    """Number in a cell; NaN for an empty cell, None for another text."""
    if not cell:
        return float("nan")
    if decimal == ",":
        if "." in cell:
            return None
        cell = cell.replace(",", ".")
    if _NUMBER.match(cell) is None:
        return None
    return float(cell)


def _kind_of(cell: str, decimal: str) -> str:
    """Kind of a cell: ``empty``, ``number``, ``moment`` (a date or time), ``word`` or ``other``."""
    if not cell:
        return "empty"
    if number(cell, decimal) is not None:
        return "number"
    if _MOMENT.match(cell):
        return "moment"
    return "word" if _WORD.match(cell) else "other"


def sniff(raw: bytes, codec: str, path: Path) -> TableDialect:
    """Find the dialect of a text table.

    Parameters
    ----------
    raw : bytes
        The file, in an encoding that contains ASCII.
    codec : str
        Name of the encoding.
    path : path-like
        The file, for messages.

    Returns
    -------
    TableDialect
        Reading with the most rows of numbers.

    Raises
    ------
    InputError
        If no reading has a row of numbers, or a comma is both separator and decimal mark.
    """
    offsets, lines = _sample(raw, codec)
    best = _best_table(lines)
    if best is None:
        raise InputError(f"{path}: holds no table: no line in its beginning is a row of numbers.")
    above = [line for line in lines[: best.first] if not _is_blank(line, best.delimiter)]
    _check_comma(above, lines[best.first], best, path)
    names, units = _header(above, best)
    notes = [line.strip().lstrip("#% ") for line in lines[: best.first]]
    notes = [note for note in notes if len(note) <= _LONGEST_NOTE]
    return TableDialect(
        best.delimiter,
        best.decimal,
        names,
        units,
        best.first,
        offsets[best.first],
        _rate(notes, best.decimal),
        _start(notes),
    )


def _sample(raw: bytes, codec: str) -> tuple[list[int], list[str]]:
    offsets, lines, size, filled = [], [], 0, 0
    for offset, line in lines_from(raw):
        offsets.append(offset)
        lines.append(line.decode(codec, "replace"))
        size += len(line)
        filled += bool(line.strip())
        if filled >= _MOST_LINES or (size > _MOST_BYTES and filled >= _LEAST_LINES):
            break
    return offsets, lines


def _best_table(lines: list[str]) -> _Table | None:
    quoted = '"' in "".join(lines)
    tables = []
    for delimiter, decimal in _CANDIDATES:
        if delimiter != decimal or quoted:
            tables.append(_read_as(lines, delimiter, decimal))
    return max(filter(None, tables), key=lambda table: table.rank, default=None)


def _is_blank(line: str, delimiter: str) -> bool:
    return not line.strip().strip(delimiter + '"').strip()


def _read_as(lines: list[str], delimiter: str, decimal: str) -> _Table | None:
    """Table of the lines with a delimiter and a decimal mark; None where it has no rows of numbers."""
    filled = _filled(lines, delimiter)
    # From the end, below any header: a wrong reading fails at once.
    if not any(_is_numeric(split_line(lines[index], delimiter), decimal) for index in filled[-3:]):
        return None
    cells = {index: split_line(lines[index], delimiter) for index in filled}
    typical = _typical_rows([cells[index] for index in filled[len(filled) // 2 :]])
    numeric = [_has_number(column, decimal) for column in zip(*typical, strict=True)]
    columns = len(numeric)
    rows = [index for index in filled if _is_row(cells[index], numeric, decimal)]
    first = _first_row(rows, filled)
    if first is None or not any(numeric):
        return None
    trailing = not any(row[-1] for row in typical)
    titled = False
    above = [line for line in lines[:first] if not _is_blank(line, delimiter)]
    if above:
        titled = _titles(above[-1], delimiter, columns, trailing) is not None
    return _Table(len(rows), titled, columns, trailing, first, delimiter, decimal)


def _filled(lines: list[str], delimiter: str) -> list[int]:
    """Numbers of the lines that are neither blank nor comments."""
    filled = []
    for index, line in enumerate(lines):
        if not _is_blank(line, delimiter) and not line.lstrip().startswith(COMMENTS):
            filled.append(index)
    return filled


def _typical_rows(rows: list[list[str]]) -> list[list[str]]:
    """Last rows of the most common length."""
    columns = Counter(map(len, rows)).most_common(1)[0][0]
    return [row for row in rows if len(row) == columns][-_LEAST_LINES:]


def _has_number(column: tuple[str, ...], decimal: str) -> bool:
    return any(cell and number(cell, decimal) is not None for cell in column)


def _is_numeric(row: list[str], decimal: str) -> bool:
    """True if a row has a number, and nothing but numbers, words and times."""
    kinds = {_kind_of(cell, decimal) for cell in row}
    return "number" in kinds and "other" not in kinds


def _is_row(row: list[str], numeric: list[bool], decimal: str) -> bool:
    """True if a row has numbers in all numeric columns."""
    if len(row) != len(numeric):
        return False
    for cell in compress(row, numeric):
        if number(cell, decimal) is None:
            return False
    return _is_numeric(row, decimal)


def _first_row(rows: list[int], filled: list[int]) -> int | None:
    """First row whose next lines are rows too, except one: a number above the table is not its beginning."""
    for first in rows:
        at = filled.index(first)
        following = filled[at : at + 5]
        if len(set(following).intersection(rows)) >= max(1, len(following) - 1):
            return first
    return None


def _titles(line: str, delimiter: str, columns: int, trailing: bool) -> list[str] | None:
    """Titles of the columns in the line above the numbers; None where it has none."""
    bare = line.strip(" ")
    if bare.startswith(COMMENTS):
        bare = bare.lstrip("#% ")
    rows = [split_line(bare, delimiter)]
    if delimiter == BLANKS:  # titles may have blanks of their own
        rows += [re.split(r"\t+|\s{2,}", bare.strip()), _LABEL.findall(bare)]
    for row in rows:
        cells = row
        if len(row) == columns + 1 and not row[-1]:
            cells = row[:-1]
        complete = len(cells) == columns or (trailing and len(cells) == columns - 1)
        if any(cells) and complete:
            return cells + [""] * (columns - len(cells))
    return None


def _header(above: list[str], table: _Table) -> tuple[tuple[str, ...], tuple[str | None, ...]]:
    """Names and units of the columns, from the last two lines above the table."""
    below, over = _titles_of(above[-1:], table), _titles_of(above[-2:-1], table)
    unit_line = [""] * table.columns
    if any(below) and any(over) and all(not cell or is_unit(_bare(cell)) for cell in below):
        unit_line, below = below, over
    names, units = [], []
    for index, (title, unit) in enumerate(zip(below, unit_line, strict=True), start=1):
        title = _unquoted(title)
        names.append(title or f"column_{index}")
        units.append(_bare(unit) or split_label(title)[1])
    return unique(names), tuple(units)


def _check_comma(above: list[str], row: str, table: _Table, path: Path) -> None:
    """Refuse rows of more cells than the heading, without a decimal point: their commas are decimal marks."""
    if not above or table.titled or table.delimiter != "," or "." in row:
        return
    names = split_line(above[-1], ",")
    are_words = all(name.strip() and number(name, ".") is None for name in names)
    if are_words and 1 < len(names) < table.columns <= 2 * len(names):
        raise InputError(
            f"{path}: the heading has {len(names)} names and the rows have {table.columns} numbers, as where "
            "the comma is both separator and decimal mark: export it with semicolons, or with decimal points."
        )


def _titles_of(lines: list[str], table: _Table) -> list[str]:
    """Titles in a line; empty ones without a line, or where it has none."""
    titles = None
    if lines:
        titles = _titles(lines[0], table.delimiter, table.columns, table.trailing)
    return titles or [""] * table.columns


def _bare(cell: str) -> str:
    return _unquoted(cell).strip("[]()").strip()


def _unquoted(cell: str) -> str:
    cell = cell.strip()
    if len(cell) > 1 and cell[0] == cell[-1] == '"':
        return cell[1:-1].strip()
    return cell


def unique(labels: Iterable[str]) -> tuple[str, ...]:
    """Labels with numbers where they are equal: ``x``, ``x_2``."""
    names: dict[str, None] = {}
    counts: Counter[str] = Counter()
    for label in labels:
        counts[label] += 1
        name = label
        while name in names:
            if name != label:
                counts[label] += 1
            name = f"{label}_{max(2, counts[label])}"
        names[name] = None
    return tuple(names)


def _rate(notes: list[str], decimal: str) -> float | None:
    """Sample rate in a line above the table, Hz."""
    for line in notes:
        match = _RATE.search(line)
        value = None
        if match is not None:
            value = number(match[1], decimal)
        if match is not None and value is not None:
            unit = _HERTZ.search(match[0])
            prefix = "" if unit is None else unit[1].casefold()
            return value * _PREFIXES[prefix]
    return None


def _start(notes: list[str]) -> str | None:
    """Start time in a line above the table, as written."""
    for match in filter(None, map(_START.search, notes)):
        return match[1]
    return None
