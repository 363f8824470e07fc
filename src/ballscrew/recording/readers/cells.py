"""The cells of a text table: lines apart, lines into cells, cells into kinds and numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator

__all__ = ["BLANKS", "COMMENTS", "kind_of", "lines_from", "number", "split_line"]

BLANKS = " "  # stands for any run of blanks and tabs as the delimiter
COMMENTS = ("#", "%")
_LINE = re.compile(rb"[^\r\n]*(?:\r\n|\r|\n|\Z)")
_NUMBER = re.compile(
    r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|nan|inf|infinity)\Z", re.IGNORECASE
)
_MOMENT = re.compile(r"(?:\d{1,4}[-./]\d{1,2}[-./]\d{1,4}|\d{1,2}:\d{2})[-0-9:.,TZ+ ]*\Z")
_WORD = re.compile(r"[^\W\d_]")
_MARKS = re.compile(r"""['"“„(\[<_*?!-]*""")


def lines_from(raw: bytes, start: int = 0) -> Iterator[tuple[int, bytes]]:
    """Yield offset and content, without its end, of each line; any of the three ends of line."""
    for match in _LINE.finditer(raw, start):
        if match.end() > match.start():
            yield match.start(), match[0].rstrip(b"\r\n")


def split_line(line: str, delimiter: str) -> list[str]:
    """Split a line into cells, blanks and quotes around them taken off."""
    if delimiter == BLANKS:
        return line.split()
    if '"' in line:
        try:
            return [
                cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
            ]
        except (csv.Error, StopIteration):
            pass
    return [cell.strip() for cell in line.split(delimiter)]


def number(cell: str, decimal: str) -> float | None:
    """Read the number in a cell; NaN for an empty one, None where there is another text."""
    if not cell:
        return float("nan")
    if decimal == ",":
        if "." in cell:
            return None
        cell = cell.replace(",", ".")
    return float(cell) if _NUMBER.match(cell) else None


def kind_of(cell: str, decimal: str) -> str:
    """Tell the kind of a cell: ``empty``, ``number``, ``moment`` (a date or time), ``word`` or ``other``."""
    if not cell:
        return "empty"
    if number(cell, decimal) is not None:
        return "number"
    if _MOMENT.match(cell):
        return "moment"
    marks = _MARKS.match(cell)
    return "word" if _WORD.match(cell, marks.end() if marks else 0) else "other"
