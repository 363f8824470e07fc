"""How a text file writes its table: delimiter, decimal mark, first row of numbers, titles and units."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from ballscrew.base.errors import InputError
from ballscrew.recording.readers.cells import BLANKS, COMMENTS, kind_of, lines_from, number, split_line
from ballscrew.recording.readers.labels import is_unit, split_label

__all__ = ["Dialect", "sniff"]

_MOST_LINES = 400
_MOST_BYTES = 1 << 20
_LEAST_LINES = 8
_CANDIDATES = [(delimiter, decimal) for delimiter in ("\t", ";", ",", "|", BLANKS) for decimal in (".", ",")]
_LABEL = re.compile(r"[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?")
_RATE = re.compile(
    r"\b(?:sampl\w*[ _-]*(?:rate|freq\w*)|abtast(?:rate|frequenz)|fs)\b"
    r"[^\d\r\n]*([0-9]+(?:[.,][0-9]+)?)\s*(?:[kM]?Hz)?\W*\Z",
    re.IGNORECASE,
)
_HERTZ = re.compile(r"(k|M|)Hz", re.IGNORECASE)
_START = re.compile(
    r"\b(?:start\w*|began|beginn|recorded|measured|messbeginn)\b.*?"
    r"(\d{4}-\d{2}-\d{2}(?:[T ][0-9:.]+(?:Z|[+-]\d\d:?\d\d)?)?)",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a text file writes its table.

    Parameters
    ----------
    delimiter : str
        One character; a blank stands for any run of blanks and tabs.
    decimal : str
        Point or comma.
    names, units : tuple of str
        Of each column; the name is the whole header as written.
    first : int
        Number of the first line of numbers, from 0.
    start : int
        Its offset in bytes.
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
    """A reading of the sample: which lines are rows of numbers."""

    rows: int
    titled: bool
    columns: int
    trailing: bool  # every row ends with a delimiter
    first: int
    delimiter: str
    decimal: str


def sniff(raw: bytes, codec: str, path: Path) -> Dialect:
    """Find out how a text file writes its table.

    Parameters
    ----------
    raw : bytes
        The file, in an encoding that contains ASCII.
    codec : str
        Its name.
    path : path-like
        The file, for messages.

    Returns
    -------
    Dialect
        The reading under which most lines are rows of numbers.

    Raises
    ------
    InputError
        If under no reading there is a row of numbers.
    """
    offsets, lines = _sample(raw, codec)
    best: _Table | None = None
    for delimiter, decimal in _CANDIDATES:
        if delimiter == decimal and not any('"' in line for line in lines):
            continue
        table = _read_as(lines, delimiter, decimal)
        if table and (best is None or _rank(table) > _rank(best)):
            best = table
    if best is None:
        raise InputError(f"{path}: holds no table: no line in its beginning is a row of numbers.")
    names, units = _header(lines[: best.first], best)
    above = [line.strip().lstrip("#% ") for line in lines[: best.first]]
    return Dialect(
        best.delimiter,
        best.decimal,
        names,
        units,
        best.first,
        offsets[best.first],
        _rate(above, best.decimal),
        _start(above),
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


def _rank(table: _Table) -> tuple[int, bool, int]:
    return table.rows, table.titled, table.columns


def _is_blank(line: str, delimiter: str) -> bool:
    return not line.strip().strip(delimiter + '"').strip()


def _read_as(lines: list[str], delimiter: str, decimal: str) -> _Table | None:
    filled = [
        i
        for i, line in enumerate(lines)
        if not _is_blank(line, delimiter) and not line.lstrip().startswith(COMMENTS)
    ]
    # From the end: there the header is over, and a wrong reading fails at the first cell.
    if not any(_fits(split_line(lines[i], delimiter), decimal) for i in filled[-3:]):
        return None
    cells = {i: split_line(lines[i], delimiter) for i in filled}
    lower = filled[len(filled) // 2 :]
    columns = Counter(len(cells[i]) for i in lower).most_common(1)[0][0]
    typical = [cells[i] for i in lower if len(cells[i]) == columns][-_LEAST_LINES:]
    numeric = [any(number(row[j], decimal) is not None and row[j] for row in typical) for j in range(columns)]
    rows = [i for i in filled if _is_row(cells[i], numeric, decimal)]
    first = next((i for k, i in enumerate(rows) if _goes_on(i, rows[k:], filled)), None)
    if first is None or not any(numeric):
        return None
    trailing = not any(row[-1] for row in typical)
    above = [line for line in lines[:first] if not _is_blank(line, delimiter)]
    titled = bool(above) and _titles(above[-1], delimiter, columns, trailing) is not None
    return _Table(len(rows), titled, columns, trailing, first, delimiter, decimal)


def _fits(row: list[str], decimal: str) -> bool:
    seen = False
    for cell in row:
        kind = kind_of(cell, decimal)
        if kind == "other":
            return False
        seen |= kind == "number"
    return seen


def _is_row(row: list[str], numeric: list[bool], decimal: str) -> bool:
    if len(row) != len(numeric):
        return False
    fitting = (
        number(cell, decimal) is not None or not wanted for cell, wanted in zip(row, numeric, strict=True)
    )
    return all(fitting) and _fits(row, decimal)


def _goes_on(first: int, rows: list[int], filled: list[int]) -> bool:
    """Whether the next lines are rows too, bar one: a number above the table is not its beginning."""
    following = [i for i in filled if i >= first][:5]
    return len(set(following) & set(rows)) >= max(1, len(following) - 1)


def _titles(line: str, delimiter: str, columns: int, trailing: bool) -> list[str] | None:
    """Find titles of the columns in the line above the numbers, or None if it is something else."""
    bare = line.strip(" ")
    if bare.startswith(COMMENTS):
        bare = bare.lstrip("#% ")
    rows = [split_line(bare, delimiter)]
    if delimiter == BLANKS:  # titles may have blanks of their own
        rows += [re.split(r"\t+|\s{2,}", bare.strip()), _LABEL.findall(bare)]
    for row in rows:
        cells = row[:-1] if len(row) == columns + 1 and not row[-1] else row
        if any(cells) and (len(cells) == columns or (trailing and len(cells) == columns - 1)):
            return cells + [""] * (columns - len(cells))
    return None


def _header(above: list[str], table: _Table) -> tuple[tuple[str, ...], tuple[str | None, ...]]:
    lines = [line for line in above if not _is_blank(line, table.delimiter)]
    units: list[str | None] = [None] * table.columns
    titles: list[str] | None = None
    if lines:
        titles = _titles(lines[-1], table.delimiter, table.columns, table.trailing)
        over = _titles(lines[-2], table.delimiter, table.columns, table.trailing) if len(lines) > 1 else None
        if titles and over and all(not cell or is_unit(_bare(cell)) for cell in titles):
            units = [_bare(cell) or None for cell in titles]
            titles = over
    labels = [_unquoted(label) for label in titles or [""] * table.columns]
    units = [unit or split_label(label)[1] for unit, label in zip(units, labels, strict=True)]
    return _unique([label or f"column_{i}" for i, label in enumerate(labels, start=1)]), tuple(units)


def _bare(cell: str) -> str:
    return _unquoted(cell).strip("[]()").strip()


def _unquoted(cell: str) -> str:
    cell = cell.strip()
    return cell[1:-1].strip() if len(cell) > 1 and cell[0] == cell[-1] == '"' else cell


def _unique(labels: list[str]) -> tuple[str, ...]:
    taken: set[str] = set()
    names: list[str] = []
    for label in labels:
        name, count = label, 1
        while name in taken:
            count += 1
            name = f"{label}_{count}"
        taken.add(name)
        names.append(name)
    return tuple(names)


def _rate(above: list[str], decimal: str) -> float | None:
    for line in above:
        match = _RATE.search(line)
        value = number(match[1], decimal) if match else None
        if match and value is not None:
            unit = _HERTZ.search(match[0])
            return value * {"k": 1e3, "m": 1e6, "": 1.0}[unit[1].casefold() if unit else ""]
    return None


def _start(above: list[str]) -> str | None:
    return next((match[1] for match in map(_START.search, above) if match), None)
