"""Fields of a JSON document, read by kind and range."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Any, get_type_hints

from ballscrew.base.errors import InputError, printable, shown
from ballscrew.base.quantity import Quantity

_LONGEST, _MOST = 10_000, 100_000
_LARGEST = 1e300  # number: sums of larger ones overflow
_LARGEST_COUNT = 1_000_000

Field = Callable[[Any, str], Any]
"""Takes a value and where it stands; returns it, or raises."""


def number(low: float = -_LARGEST, high: float = _LARGEST, *, optional: bool = False) -> Field:
    """A finite number between two others.

    Parameters
    ----------
    low, high : float
        Both are allowed.
    optional : bool
        Whether null is. NaN, which a result that was never in a file may hold, is null then.

    Returns
    -------
    callable
        Check of a value, with its place for messages; returns the value.
    """

    def read(value: Any, where: str) -> Any:
        if optional and (value is None or value != value):
            return None
        right = isinstance(value, int | float) and not isinstance(value, bool)
        if not right or not low <= value <= high:
            raise wrong(value, where, f"a number from {low:g} to {high:g}{' or null' if optional else ''}")
        return value

    return read


def whole(high: int) -> Field:
    """A whole number from 0 on."""

    def read(value: Any, where: str) -> Any:
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= high:
            raise wrong(value, where, f"a whole number from 0 to {high}")
        return value

    return read


def text(*, optional: bool = False) -> Field:
    """A text of a length that people read; control characters are escaped."""

    def read(value: Any, where: str) -> Any:
        if optional and value is None:
            return None
        if not isinstance(value, str) or len(value) > _LONGEST:
            raise wrong(value, where, f"a text of {_LONGEST} characters at most{' or null' * optional}")
        return printable(value)

    return read


def time(value: Any, where: str) -> str | None:
    """A time in ISO 8601, or null."""
    try:
        if value is not None:
            datetime.fromisoformat(value)
    except (ValueError, TypeError):
        raise wrong(value, where, "a time in ISO 8601 or null") from None
    return None if value is None else str(value)


def choice(*choices: str) -> Field:
    """One of a few texts."""

    def read(value: Any, where: str) -> Any:
        if not (isinstance(value, str) and value in choices):
            raise wrong(value, where, f"{', '.join(choices[:-1])} or {choices[-1]}")
        return value

    return read


def flag(value: Any, where: str) -> Any:
    """True or false."""
    if not isinstance(value, bool):
        raise wrong(value, where, "true or false")
    return value


def listed(inner: Field, *, length: int | None = None, optional: bool = False) -> Field:
    """A list of one kind, as a tuple."""

    def read(value: Any, where: str) -> Any:
        if optional and value is None:
            return None
        right = isinstance(value, list | tuple) and len(value) <= _MOST
        if not right or (length is not None and len(value) != length):
            raise wrong(value, where, f"a list{'' if length is None else f' of {length}'}")
        return tuple(inner(item, f"{where}[{index}]") for index, item in enumerate(value))

    return read


def mapping(inner: Field) -> Field:
    """An object whose values are of one kind."""

    def read(value: Any, where: str) -> Any:
        if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
            raise wrong(value, where, "an object")
        return {key: inner(item, f"{where}.{key[:40]}") for key, item in value.items()}

    return read


def anything(value: Any, where: str) -> Any:  # noqa: ARG001
    """Whatever it is: it is kept, and decides nothing."""
    return value


def record(kinds: Mapping[str, Field]) -> Field:
    """An object in which each of these keys is required."""

    def read(value: Any, where: str) -> Any:
        return fields(kinds, value, where, required=tuple(kinds))

    return read


def optional(inner: Field) -> Field:
    """A field that may be null."""

    def read(value: Any, where: str) -> Any:
        return None if value is None else inner(value, where)

    return read


def number_or_nan(value: Any, where: str) -> float:
    """A finite number, or NaN for null."""
    return math.nan if value is None else float(number()(value, where))


def quantity(low: float = -_LARGEST, high: float = _LARGEST, *, unit: str = "") -> Field:
    """A :class:`~ballscrew.base.quantity.Quantity` within bounds; None where there is none."""
    bounds = number(low, high)
    kinds: dict[str, Field] = {
        "value": bounds,
        "standard_uncertainty": number(0.0, high),
        "interval95": listed(number(-high, high), length=2),
    }

    def read(value: Any, where: str) -> Any:
        found = fields(kinds, value, where, required=tuple(kinds))
        if not found["interval95"][0] <= found["interval95"][1]:
            raise wrong(value["interval95"], f"{where}.interval95", "two numbers in ascending order")
        return Quantity(**found, unit=unit)

    return optional(read)


def instance(kind: type[Any], **kinds: Field) -> Field:
    """An object as a dataclass of which every field is required.

    Parameters
    ----------
    kind : type
        The dataclass.
    **kinds : callable
        Fields by name; the others are read by their type.

    Returns
    -------
    callable
        Reader of an object, with its place for messages.
    """
    hints = get_type_hints(kind)
    readers = {
        field.name: kinds.get(field.name) or _BY_TYPE[hints[field.name]] for field in dataclasses.fields(kind)
    }
    return lambda row, where: kind(**fields(readers, row, where, required=tuple(readers)))


_BY_TYPE: dict[Any, Field] = {
    str: text(),
    str | None: text(optional=True),
    tuple[str, ...]: listed(text()),
    bool: flag,
    int: whole(_LARGEST_COUNT),
    float: number_or_nan,
    float | None: number(optional=True),
    dict[str, str]: mapping(anything),
    dict[str, Any]: mapping(anything),
}
"""Fields by the type of a dataclass' attribute."""


def fields(
    kinds: Mapping[str, Field], row: Any, where: str, required: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Read those keys of an object that are known; what a later version added is passed over.

    Parameters
    ----------
    kinds : mapping of str to callable
        What each key may hold.
    row : object
        As it stands in the document.
    where : str
        Its place, for messages; empty for the document itself.
    required : tuple of str
        Keys that must be there.

    Returns
    -------
    dict
        Values by key, for the keys that are there.

    Raises
    ------
    InputError
        If it is no object, lacks a key, or a value is none that it can be.
    """
    if not isinstance(row, Mapping):
        raise wrong(row, where, "an object")
    before = f"{where}." if where else ""
    for key in required:
        if key not in row:
            raise InputError(f"{before}{key} is missing.")
    return {key: read(row[key], before + key) for key, read in kinds.items() if key in row}


def wrong(value: Any, where: str, allowed: str) -> InputError:
    """Say what stands where, and what may."""
    return InputError(f"{where} is {shown(value)}; it must be {allowed}.")
