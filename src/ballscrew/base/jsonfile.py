"""Versioned JSON in and out: no NaN, no silent loss, every later version reads every earlier one."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from ballscrew.base.errors import InputError
from ballscrew.base.files import decode, read_whole

SCHEMA = 2
"""Version of the layout of all documents. Version 1 was never released, and nothing reads it."""

_LARGEST = 1 << 28  # bytes; far beyond any result


def plain(value: Any, digits: int = 9) -> Any:
    """Turn a result into what JSON can hold: NaN becomes null, floats keep ``digits`` digits.

    Parameters
    ----------
    value : object
        Dataclasses, dicts, sequences, numbers, texts; NumPy scalars and arrays too.
    digits : int
        Significant digits: enough for any measurement, few enough to read.

    Returns
    -------
    object
        The same, of plain Python types.
    """
    if isinstance(value, float):
        return float(f"{value:.{digits}g}") if math.isfinite(value) else None
    if value is None or isinstance(value, (str, int)):
        return value
    if isinstance(value, dict):
        return {str(key): plain(item, digits) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item, digits) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name), digits) for name in value.__dataclass_fields__}
    if hasattr(value, "tolist"):
        return plain(value.tolist(), digits)
    return value


def write_json(document: dict[str, Any], *, indent: int | None = 1) -> str:
    """Text of a result's JSON.

    Parameters
    ----------
    document : dict
        Has a ``"schema"`` key.
    indent : int, optional
        As in :func:`json.dumps`.

    Returns
    -------
    str
        JSON text in ASCII, so that no console's code page can spoil it.
    """
    return json.dumps(plain(document), indent=indent, allow_nan=False)


def read_json(path: str | Path) -> dict[str, Any]:
    """Read a result that a command printed.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    dict
        The document, its schema version checked.

    Raises
    ------
    InputError
        If it cannot be read, is not JSON, or was written by a later version.
    """
    path = Path(path)
    try:
        text = decode(read_whole(path, _LARGEST))
        document = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not JSON ({error}).") from None
    if not isinstance(document, dict):
        document = {}
    version = document.get("schema")
    if version is None:
        raise InputError(f"{path}: is not a result of ballscrew: it has no schema version.")
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise InputError(f"{path}: schema is {version!r}; it must be {SCHEMA}.")
    if version < SCHEMA:
        raise InputError(
            f"{path}: was written by a version of ballscrew before the first release (schema {version}); "
            "make it again from the recordings."
        )
    if version > SCHEMA:
        raise InputError(
            f"{path}: was written by a later version of ballscrew "
            f"(schema {version}; this one reads schema {SCHEMA})."
        )
    return document


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not a number that JSON knows")
