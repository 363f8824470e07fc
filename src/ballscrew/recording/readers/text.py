"""Text tables: CSV, TSV and the output of loggers, with the dialect detected."""

from __future__ import annotations

import codecs
import re
from array import array
from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.files import read_whole
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.dialect import (
    BLANKS,
    COMMENTS,
    TableDialect,
    lines_from,
    number,
    sniff,
    split_line,
)  # fmt: skip
from ballscrew.recording.readers.guard import missing_channel, refusing

_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_NOTHING = ["", " ", "nan", "NaN", "NAN", "Nan", "-nan", "+nan", "-NaN", "+NaN"]
_BLOCK = 1 << 24
_LINE_FEED = ord("\n")
_LINE_END = re.compile(rb"[\r\n]")


class TextReader:
    """Any table of numbers in text; asked last, since it accepts any text."""

    name = "text"

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002  the content alone decides
        """True if the file begins like text: a mark of its encoding, or no zero byte."""
        return head.startswith(tuple(mark for mark, _ in _MARKS)) or b"\0" not in head

    def read_header(self, path: Path) -> Header:
        """Read columns with their units; the rate from a line above the table."""
        with refusing(path, "text"):
            raw, dialect = _open(path)
            rows = 1 + (raw.count(b"\n", dialect.start) or raw.count(b"\r", dialect.start))
            channels = map(RawChannel, dialect.names, repeat(rows), dialect.units)
            return Header(tuple(channels), dialect.sample_rate, dialect.started_at, self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the columns asked for; an empty cell is NaN, any other text an error that names its place."""
        with refusing(path, "text"):
            raw, dialect = _open(path)
            names = list(dict.fromkeys(names))
            for name in names:
                if name not in dialect.names:
                    raise missing_channel(path, name)
            if not names:
                return {}
            indices = [dialect.names.index(name) for name in names]
            return dict(zip(names, read_columns(raw, dialect, indices, path), strict=True))


def _open(path: Path) -> tuple[bytes, TableDialect]:
    raw, codec = decoded(read_whole(path), path)
    dialect = sniff(raw, codec, path)
    # Spreadsheets leave thousands of empty rows behind the last one.
    end = len(raw.rstrip(b' \t\r\n\x1a"' + dialect.delimiter.encode()))
    line_end = _LINE_END.search(raw, end)
    if line_end is None:
        return _without_doubtful_line(raw, dialect).rstrip(b"\x1a"), dialect
    return raw[: line_end.start()].rstrip(b"\x1a"), dialect


def _without_doubtful_line(raw: bytes, dialect: TableDialect) -> bytes:
    """Table that ends in the middle of a line, without that line where its last number may be cut."""
    last = max(raw.rfind(b"\n"), raw.rfind(b"\r")) + 1
    before = raw[:last].rstrip(b"\r\n")
    previous = before[max(before.rfind(b"\n"), before.rfind(b"\r")) + 1 :]
    if last <= dialect.start or _last_decimals(raw[last:], dialect) == _last_decimals(previous, dialect):
        return raw
    return before


def _last_decimals(line: bytes, dialect: TableDialect) -> int:
    """Number of decimals in the last cell of a line; -1 without a decimal mark."""
    cell = line.rstrip(b"\x1a").rpartition(dialect.delimiter.encode())[2]
    _, mark, decimals = cell.strip(b' \t"').partition(dialect.decimal.encode())
    return len(decimals) if mark else -1


def decoded(raw: bytes, path: Path) -> tuple[bytes, str]:
    """Decode the content of a file to an encoding that contains ASCII, and name that.

    Raises
    ------
    InputError
        If it is not text.
    """
    for mark, codec in _MARKS:
        if raw.startswith(mark):
            raw = raw.decode(codec).encode("utf-8")
            break
    if b"\0" in raw:
        raise InputError(f"{path}: is not text: it has zero bytes in it.")
    raw = raw.removeprefix(codecs.BOM_UTF8)
    try:
        codecs.getincrementaldecoder("utf-8")().decode(raw[:_BLOCK])
    except UnicodeDecodeError:
        return raw, "latin-1"
    return raw, "utf-8"


def read_columns(raw: bytes, dialect: TableDialect, indices: list[int], path: Path) -> list[Array]:
    """Read columns of a table.

    Parameters
    ----------
    raw : bytes
        The file up to the end of the table.
    dialect : TableDialect
        Its dialect.
    indices : list of int
        Numbers of the columns, from 0.
    path : Path
        The file, for messages.

    Returns
    -------
    list of ndarray, shape (rows,)
        NaN for an empty cell.

    Raises
    ------
    InputError
        If a cell is no number, or a row too short.
    """
    columns = _read_fast(raw, dialect, indices)
    if columns is None:
        columns = _read_slowly(raw, dialect, indices, path)
    return columns


def _read_fast(raw: bytes, dialect: TableDialect, indices: list[int]) -> list[Array] | None:
    """Read the columns by pandas; None where it cannot read the table, or would fill it."""
    import pandas as pd

    delimiter = dialect.delimiter
    table = b"".join((memoryview(raw)[dialect.start :], b"\n"))
    if delimiter == BLANKS:
        table, delimiter = _single_tabs(table) + b"\n", "\t"
    if table.count(b"\n") == 1:
        table = table.replace(b"\r", b"\n")
    rows = _count_rows(table, delimiter)
    if rows is None:
        return None
    # From 3.1 on, every number is rounded correctly, and the option is deprecated.
    correct: dict[str, Any] = {"float_precision": "round_trip"} if _version(pd) < (3, 1) else {}
    try:
        read = pd.read_csv(
            BytesIO(table),
            sep=delimiter,
            header=None,
            usecols=indices,
            dtype=np.float64,
            keep_default_na=False,
            na_values=_NOTHING,
            decimal=dialect.decimal,
            encoding="latin-1",
            **correct,
        )
    except (ValueError, OverflowError):
        return None
    return [read[index].to_numpy() for index in indices] if len(read) == rows else None


def _version(module: Any) -> tuple[int, ...]:
    return tuple(map(int, module.__version__.split(".")[:2]))


def _count_rows(table: bytes, delimiter: str) -> int | None:
    """Number of rows; None if one has more cells than another, since pandas fills the shorter with NaN."""
    codes = np.frombuffer(table, np.uint8)
    marks = codes[(codes == _LINE_FEED) | (codes == ord(delimiter))]
    width = int(np.argmax(marks == _LINE_FEED)) + 1
    rows, rest = divmod(len(marks), width)
    if rest or (marks.reshape(rows, width) != marks[:width]).any():
        return None
    return rows


def _single_tabs(table: bytes) -> bytes:
    # Plain replacements run at the speed of memory; a regular expression is ten times slower.
    table = table.replace(b"\t", b" ")
    while b"  " in table:
        table = table.replace(b"  ", b" ")
    table = table.replace(b" \r", b"\r").replace(b" \n", b"\n").replace(b"\n ", b"\n").replace(b"\r ", b"\r")
    return table.strip(b" ").replace(b" ", b"\t")


def _read_slowly(raw: bytes, dialect: TableDialect, indices: list[int], path: Path) -> list[Array]:
    """Read the columns line by line: comments in the table, odd numbers, and the place of an error."""
    try:
        return _read_lines(raw, dialect, indices, path)
    except _CellError as error:
        # The first lines may have whole numbers only, without a decimal mark.
        other = replace(dialect, decimal="," if dialect.decimal == "." else ".")
        if other.decimal == dialect.delimiter or number(error.cell, other.decimal) is None:
            raise
    return _read_lines(raw, other, indices, path)


class _CellError(InputError):
    """Error of a cell that is no number."""

    def __init__(self, message: str, cell: str) -> None:
        super().__init__(message)
        self.cell = cell


def _read_lines(raw: bytes, dialect: TableDialect, indices: list[int], path: Path) -> list[Array]:
    columns = [array("d") for _ in indices]
    count = len(dialect.names)
    for at, (_, line) in enumerate(lines_from(raw, dialect.start), start=dialect.first + 1):
        text = line.decode("latin-1")
        if not text.strip() or text.lstrip().startswith(COMMENTS):
            continue
        row = split_line(text, dialect.delimiter)
        if len(row) < count or any(row[count:]):
            raise InputError(f"{path}: line {at} has {len(row)} cells; the table has {count} columns.")
        for column, index in zip(columns, indices, strict=True):
            cell = row[index]
            value = number(cell, dialect.decimal)
            if value is None:
                name = dialect.names[index]
                raise _CellError(
                    f"{path}: line {at}, column {name!r} is {cell[:40]!r}; it must be a number.", cell
                )
            column.append(value)
    return [np.array(column, dtype=np.float64) for column in columns]
