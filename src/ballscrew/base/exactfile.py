"""Dataclasses and arrays as bytes and back, to the last bit; the same object always gives the same bytes.

The text is JSON, compressed. Only the classes that the caller names are read, and nothing is executed.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from ballscrew.base.errors import InputError

_ARRAYS = {"<f4", "<f8", "<i8", "|b1"}  # types of numbers that are read
_LARGEST = 1 << 28  # bytes of the text
_CLASS, _ARRAY, _MAPPING = "class", "array", "mapping"

Writers = Mapping[type[Any], Callable[[Any], Any]]
"""Classes with a document of their own, and how it is written."""

Readers = Mapping[str, Callable[..., Any]]
"""Name of a class to the class, or to what reads its document."""


def to_bytes(value: Any, writers: Writers) -> bytes:
    """Write a value.

    Parameters
    ----------
    value : object
        Dataclass of plain values, arrays, tuples, mappings with texts as keys, and such dataclasses.
    writers : mapping
        See :data:`Writers`.

    Returns
    -------
    bytes
        Compressed JSON.
    """
    text = json.dumps(_plain(value, writers), separators=(",", ":"))
    return zlib.compress(text.encode("ascii"), 6)


def from_bytes(data: bytes, readers: Readers, source: str) -> Any:
    """Read a value back.

    Parameters
    ----------
    data : bytes
        As :func:`to_bytes` returned it.
    readers : mapping
        See :data:`Readers`.
    source : str
        Its name, for messages.

    Returns
    -------
    object
        Equal to what was written, to the last bit.

    Raises
    ------
    InputError
        If the bytes are damaged or of something else.
    """
    try:
        unpack = zlib.decompressobj()
        text = unpack.decompress(data, _LARGEST)
        if not unpack.eof:
            raise ValueError("too long or cut off")
        return _value(json.loads(text), readers)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, zlib.error) as error:
        raise InputError(f"{source}: is damaged, or not of ballscrew: {error}.") from None


def _plain(value: Any, writers: Writers) -> Any:
    writer = writers.get(type(value))
    if writer is not None:
        return {_CLASS: type(value).__name__, "document": writer(value)}
    if is_dataclass(value):
        content = {item.name: _plain(getattr(value, item.name), writers) for item in fields(value)}
        return {_CLASS: type(value).__name__, **content}
    if isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        numbers = base64.b64encode(array.tobytes()).decode("ascii")
        return {_ARRAY: array.dtype.str, "shape": list(value.shape), "numbers": numbers}
    if isinstance(value, Mapping):
        return {_MAPPING: {str(key): _plain(item, writers) for key, item in value.items()}}
    if isinstance(value, tuple | list):
        return [_plain(item, writers) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    return value


def _value(document: Any, readers: Readers) -> Any:
    if isinstance(document, list):
        return tuple(_value(item, readers) for item in document)
    if not isinstance(document, dict):
        return document
    if _ARRAY in document:
        return _array(document)
    if _MAPPING in document:
        return {key: _value(item, readers) for key, item in document[_MAPPING].items()}
    content = dict(document)
    reader = readers[content.pop(_CLASS)]
    if "document" in content:
        return reader(content["document"])
    return reader(**{key: _value(item, readers) for key, item in content.items()})


def _array(document: dict[str, Any]) -> Any:
    if document[_ARRAY] not in _ARRAYS:
        raise ValueError(f"an array of {document[_ARRAY]!r}")
    numbers = base64.b64decode(document["numbers"], validate=True)
    return np.frombuffer(numbers, document[_ARRAY]).reshape(document["shape"]).copy()
