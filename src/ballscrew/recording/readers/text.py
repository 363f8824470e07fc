"""Text tables: CSV, TSV and what loggers write, with the dialect found out."""

from __future__ import annotations

import codecs
from array import array
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.cells import BLANKS, COMMENTS, lines_from, number, split_line
from ballscrew.recording.readers.dialect import Dialect, sniff
from ballscrew.recording.readers.guard import missing_channel, refusing

__all__ = ["TextReader"]

_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_NOTHING = ["", "nan", "NaN", "NAN", "Nan", "-nan", "+nan", "-NaN", "+NaN"]
_BLOCK = 1 << 24


class TextReader:
    """Any table of numbers in text; asked last, since it takes what is left."""

    name = "text"

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002  the content alone decides
        """Whether the file begins like text: a mark of its encoding, or no zero byte."""
        return head.startswith(tuple(mark for mark, _ in _MARKS)) or b"\0" not in head

    def read_header(self, path: Path) -> Header:
        """Read columns with their units; the rate from a line above the table."""
        with refusing(path, "text"):
            raw, dialect = _open(path)
            rows = 1 + (raw.count(b"\n", dialect.start) or raw.count(b"\r", dialect.start))
            channels = tuple(
                RawChannel(name, rows, unit) for name, unit in zip(dialect.names, dialect.units, strict=True)
            )
            return Header(channels, dialect.sample_rate, dialect.started_at, self.name)

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
            wanted = [dialect.names.index(name) for name in names]
            columns = _read_fast(raw, dialect, wanted)
            if columns is None:
                columns = _read_slowly(raw, dialect, wanted, path)
            return dict(zip(names, columns, strict=True))


def _open(path: Path) -> tuple[bytes, Dialect]:
    raw, codec = _decoded(path.read_bytes(), path)
    dialect = sniff(raw, codec, path)
    # Spreadsheets leave thousands of empty rows behind the last one.
    end = len(raw.rstrip(b' \t\r\n\x1a"' + dialect.delimiter.encode()))
    stop = min((at for at in (raw.find(b"\n", end), raw.find(b"\r", end)) if at >= 0), default=len(raw))
    return raw[:stop].rstrip(b"\x1a"), dialect


def _decoded(raw: bytes, path: Path) -> tuple[bytes, str]:
    """Bring the file into an encoding that contains ASCII, and which one."""
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


def _read_fast(raw: bytes, dialect: Dialect, wanted: list[int]) -> list[NDArray[np.float64]] | None:
    """Read the columns by Arrow's reader; None if one thing in the table is out of the ordinary."""
    import pyarrow as pa
    from pyarrow import csv

    table = memoryview(raw)[dialect.start :]
    delimiter = dialect.delimiter
    if delimiter == BLANKS:
        table, delimiter = memoryview(_single_tabs(bytes(table))), "\t"
    keys = [f"f{i}" for i in wanted]
    try:
        read = csv.read_csv(
            pa.BufferReader(table),
            read_options=csv.ReadOptions(
                autogenerate_column_names=True, block_size=max(1 << 20, min(_BLOCK, len(table)))
            ),
            parse_options=csv.ParseOptions(delimiter=delimiter),
            convert_options=csv.ConvertOptions(
                check_utf8=False,
                column_types=dict.fromkeys(keys, pa.float64()),
                include_columns=keys,
                null_values=_NOTHING,
                decimal_point=dialect.decimal,
            ),
        )
    except (pa.ArrowException, ValueError, KeyError):
        return None
    return [np.array(read.column(key).to_numpy(), dtype=np.float64) for key in keys]


def _single_tabs(table: bytes) -> bytes:
    # Plain replacements run at the speed of memory; a regular expression is ten times slower.
    table = table.replace(b"\t", b" ")
    while b"  " in table:
        table = table.replace(b"  ", b" ")
    table = table.replace(b" \r", b"\r").replace(b" \n", b"\n").replace(b"\n ", b"\n").replace(b"\r ", b"\r")
    return table.strip(b" ").replace(b" ", b"\t")


def _read_slowly(
    raw: bytes, dialect: Dialect, wanted: list[int], path: Path, *, again: bool = True
) -> list[NDArray[np.float64]]:
    """Read the columns line by line: comments in the table, odd numbers, and the place of what is wrong."""
    columns = [array("d") for _ in wanted]
    count = len(dialect.names)
    for at, (_, line) in enumerate(lines_from(raw, dialect.start), start=dialect.first + 1):
        text = line.decode("latin-1")
        if not text.strip() or text.lstrip().startswith(COMMENTS):
            continue
        row = split_line(text, dialect.delimiter)
        if len(row) < count or any(row[count:]):
            raise InputError(f"{path}: line {at} has {len(row)} cells; the table has {count} columns.")
        for column, j in zip(columns, wanted, strict=True):
            value = number(row[j], dialect.decimal)
            if value is None:
                other = replace(dialect, decimal="," if dialect.decimal == "." else ".")
                # The beginning may have held whole numbers only, and so have hidden the decimal mark.
                if again and other.decimal != dialect.delimiter and number(row[j], other.decimal) is not None:
                    return _read_slowly(raw, other, wanted, path, again=False)
                raise InputError(
                    f"{path}: line {at}, column {dialect.names[j]!r} is {row[j][:40]!r}; it must be a number."
                )
            column.append(value)
    return [np.array(column, dtype=np.float64) for column in columns]
