"""Lines and cells of a text table, the kinds of cells and their numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from contextlib import suppress

BLANKS = " "  # stands for any run of blanks and tabs as the delimiter
COMMENTS = ("#", "%")
_LINE = re.compile(rb"[^\r\n]*(?:\r\n|\r|\n|\Z)")
_NUMBER = re.compile(
    r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|nan|inf|infinity)\Z", re.IGNORECASE
)
_MOMENT = re.compile(r"(?:\d{1,4}[-./]\d{1,2}[-./]\d{1,4}|\d{1,2}:\d{2})[-0-9:.,TZ+ ]*\Z")
_WORD = re.compile(r"""['"“„(\[<_*?!-]*[^\W\d_]""")  # a letter, after any marks


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


def kind_of(cell: str, decimal: str) -> str:
    """Kind of a cell: ``empty``, ``number``, ``moment`` (a date or time), ``word`` or ``other``."""
    if not cell:
        return "empty"
    if number(cell, decimal) is not None:
        return "number"
    if _MOMENT.match(cell):
        return "moment"
    return "word" if _WORD.match(cell) else "other"
