"""Rows of the store: types of their columns, checksums, and documents in them.

A row with a ``checksum`` is verified against it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, TypeVar

import zstandard
from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Float,
    Integer,
    LargeBinary,
    MetaData,
    Text,
    event,
    inspect,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, Mapper, mapped_column

from ballscrew.base.errors import InputError

_LEVEL = 10  # of zstd
_MOST_PARAMETERS = 500  # of a statement; databases have limits

Key = TypeVar("Key", int, str)


class Base(DeclarativeBase):
    """A table; JSON, integers and numbers have one type on every database."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(column_0_N_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    """Names of constraints."""
    type_annotation_map: ClassVar[dict[Any, Any]] = {
        str: Text,
        float: Float(53),
        int: Integer,
        bool: Boolean,
        bytes: LargeBinary,
        dict[str, Any]: JSON,
        list[Any]: JSON(none_as_null=True),
    }


class Checked:
    """A row whose values have a checksum, so that a changed byte in the database is found."""

    checksum: Mapped[int] = mapped_column(BigInteger, default=0)


def checksum_of(row: Checked) -> int:
    """Checksum of a row by its values.

    Parameters
    ----------
    row : Checked
        Its number, which the database assigns, has no effect.

    Returns
    -------
    int
        Of 64 bits, with sign.
    """
    names = [column.key for column in inspect(type(row)).columns]
    return checksum_of_values({name: getattr(row, name) for name in names if name not in ("id", "checksum")})


def checksum_of_values(row: Mapping[str, Any]) -> int:
    """Checksum of a row that is a mapping of its columns, without ``id`` and ``checksum``."""
    values = dict(row)
    for name, value in row.items():
        if isinstance(value, bytes):
            values[name] = value.hex()
    text = json.dumps(values, sort_keys=True)
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "big", signed=True)


@event.listens_for(Checked, "before_insert", propagate=True)
@event.listens_for(Checked, "before_update", propagate=True)
def _set_checksum(mapper: Mapper[Any], connection: Any, row: Any) -> None:  # noqa: ARG001  as SQLAlchemy calls it
    row.checksum = checksum_of(row)


def pack(document: Any) -> bytes:
    """A document as canonical JSON, compressed."""
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return zstandard.ZstdCompressor(level=_LEVEL).compress(text.encode())


def unpack(content: bytes) -> Any:
    """Document of :func:`pack`."""
    try:
        return json.loads(zstandard.ZstdDecompressor().decompress(content))
    except (zstandard.ZstdError, ValueError):
        raise InputError("a document in the store cannot be read: the database is damaged.") from None


def named_columns(row: Any, *names: str) -> dict[str, Any]:
    """Columns of a row by their names."""
    return {name: getattr(row, name) for name in names}


def batched(values: Sequence[Key]) -> Iterator[Sequence[Key]]:
    """As many values at a time as a statement may have parameters."""
    for start in range(0, len(values), _MOST_PARAMETERS):
        yield values[start : start + _MOST_PARAMETERS]
