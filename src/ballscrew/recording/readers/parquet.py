"""Parquet: a numeric column per channel."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.readers.attributes import rate_of, start_of, unit_of
from ballscrew.recording.readers.guard import as_channel, check_size, missing_channel, refusing

try:
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.parquet as pq
except ImportError:  # the extra `parquet`
    pa = None

_TICKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


class ParquetReader:
    """Numeric columns; units in a field's metadata, the rate in the schema's or in pandas' attrs."""

    name = "parquet"

    def can_open(self, path: Path, head: bytes) -> bool:  # noqa: ARG002  the content alone decides
        """True if the file begins with the signature of Parquet."""
        return head.startswith(b"PAR1")

    def read_header(self, path: Path) -> Header:
        """Read channels, rate and start time."""
        with refusing(path, "Parquet"), _open(path) as file:
            rows, schema = file.metadata.num_rows, file.schema_arrow
            about = _texts(schema.metadata)
            about |= _pandas_attributes(about)
            channels = []
            for field in schema:
                if _is_moment(field.type):
                    channels.append(RawChannel(field.name, rows, "s"))
                elif _is_number(field.type):
                    channels.append(RawChannel(field.name, rows, unit_of(_texts(field.metadata))))
            return Header(tuple(channels), rate_of(about), start_of(about), self.name)

    def read(self, path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read the channels asked for; moments in seconds since the first, nothing in a cell as NaN."""
        with refusing(path, "Parquet"), _open(path) as file:
            for name in names:
                if file.schema_arrow.names.count(name) != 1:
                    raise missing_channel(path, name)
            check_size(path, ", ".join(names), 8 * file.metadata.num_rows * len(names))
            table = file.read(columns=list(names))
            return {name: _values(table.column(name), path, name) for name in names}


def _open(path: Path) -> Any:
    if pa is None:
        raise InputError(
            f"{path}: Parquet needs pyarrow, which is not installed; install ballscrew[parquet]."
        )
    return pq.ParquetFile(path, page_checksum_verification=True)


def _is_number(kind: Any) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind))


def _is_moment(kind: Any) -> bool:
    return bool(pa.types.is_timestamp(kind) or pa.types.is_duration(kind))


def _values(column: Any, path: Path, name: str) -> NDArray[Any]:
    kind = column.type
    if _is_moment(kind):
        # Since the first: nanoseconds since 1970 do not fit into the 53 bits of a float64.
        ticks = column.cast(pa.int64())
        first = ticks.drop_null()[:1].to_pylist()
        if first:
            ticks = pc.subtract(ticks, first[0])
        return as_channel(ticks.cast(pa.float64(), safe=False).to_numpy() * _TICKS[kind.unit])
    if not _is_number(kind):
        raise InputError(f"{path}: {name!r} holds {kind}; a channel holds numbers.")
    if pa.types.is_decimal(kind) or (column.null_count and kind != pa.float32()):
        column = column.cast(pa.float64(), safe=False)
    return as_channel(column.to_numpy())


def _texts(metadata: Any) -> dict[str, Any]:
    texts = {}
    for key, value in (metadata or {}).items():
        texts[key.decode("utf-8", "replace")] = value.decode("utf-8", "replace")
    return texts


def _pandas_attributes(about: dict[str, Any]) -> dict[str, Any]:
    try:
        attributes = json.loads(about.get("PANDAS_ATTRS", "{}"))
    except (ValueError, RecursionError):
        return {}
    return attributes if isinstance(attributes, dict) else {}
