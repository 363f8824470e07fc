"""TOML in, field by field, with errors that name the file and the field."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ballscrew.base.errors import InputError, field_error, shown
from ballscrew.base.files import decode, read_whole
from ballscrew.base.settings import limits_in_words
from ballscrew.base.units import parse

_MISSING: Any = object()
_LARGEST = 1 << 20  # a data sheet is a page, not a recording


def read_toml(path: str | Path) -> Fields:
    """Read a TOML file.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    Fields
        Its top table.

    Raises
    ------
    InputError
        If there is no such file, or it is not TOML.
    """
    path = Path(path)
    try:
        text = decode(read_whole(path, _LARGEST))
        return Fields(tomllib.loads(text), path.name)
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not a text file in UTF-8, so it is not TOML.") from None
    except tomllib.TOMLDecodeError as error:
        remedy = ""
        if "\\" in text:
            remedy = " A path with \\ needs single quotes, or / in its place."
        raise InputError(f"{path}: is not TOML: {error}.{remedy}") from None
    except RecursionError:
        raise InputError(f"{path}: is not TOML that can be read: it is nested too deeply.") from None
    except ValueError as error:  # a NUL in the path, a whole number of thousands of digits
        raise InputError(f"{str(path)!r}: cannot be read ({error}).") from None


class Fields:
    """One table of a TOML file, read field by field.

    Parameters
    ----------
    table : mapping
        What was read.
    source : str
        The file's name, for the messages.
    prefix : str
        Where the table lies in the file, ``"screw"``.
    """

    def __init__(self, table: Mapping[str, Any], source: str, prefix: str = "") -> None:
        if not isinstance(table, Mapping):
            raise field_error(source, prefix or "the file", table, "a table")
        self.table = dict(table)
        self.source = source
        self.prefix = prefix

    def name(self, field: str) -> str:
        """The field's full name in the file."""
        return f"{self.prefix}.{field}" if self.prefix else field

    def error(self, field: str, allowed: str) -> InputError:
        """The error that this field's value is not allowed."""
        return field_error(self.source, self.name(field), self.table.get(field), allowed)

    def __contains__(self, field: str) -> bool:
        """True if the field is given."""
        return field in self.table

    def only(self, fields: Iterable[str]) -> None:
        """Refuse fields that are not known: a misspelt field would otherwise be silently ignored."""
        known = list(fields)
        for field in self.table:
            if field not in known:
                raise InputError(
                    f"{self.source}: {self.name(field)} is not a known field; known are {', '.join(known)}."
                )

    def sub(self, field: str, *, required: bool = True) -> Fields:
        """The table ``[field]``; an empty one where it is optional and absent."""
        if field not in self.table and required:
            raise field_error(self.source, f"[{self.name(field)}]", None, "a table")
        return Fields(self.table.get(field, {}), self.source, self.name(field))

    def subs(self, field: str) -> Sequence[Fields]:
        """The tables ``[[field]]``."""
        rows = self.table.get(field, [])
        if not isinstance(rows, list):
            raise self.error(field, f"a list of tables, each headed [[{self.name(field)}]]")
        return [Fields(row, self.source, f"{self.name(field)}[{i}]") for i, row in enumerate(rows)]

    def text(self, field: str, default: Any = _MISSING, *, choices: Sequence[str] = ()) -> Any:
        """A word; with ``choices``, one of them."""
        allowed = "one of " + ", ".join(choices) if choices else "a text"
        value = self._value(field, default, allowed)
        if value is default and field not in self.table:
            return default
        if not isinstance(value, str) or not value.strip() or (choices and value not in choices):
            raise self.error(field, allowed)
        return value

    def whole(self, field: str, default: Any = _MISSING, *, least: int = 0) -> Any:
        """A whole number, at least ``least``."""
        allowed = f"a whole number, {least} or more"
        value = self._value(field, default, allowed)
        if value is default and field not in self.table:
            return default
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise self.error(field, allowed)
        return value

    def flag(self, field: str, default: Any = _MISSING) -> Any:
        """Either true or false."""
        value = self._value(field, default, "true or false")
        if value is default and field not in self.table:
            return default
        if not isinstance(value, bool):
            raise self.error(field, "true or false")
        return value

    def quantity(
        self,
        field: str,
        unit: str,
        default: Any = _MISSING,
        *,
        least: float = -math.inf,
        above: float = -math.inf,
        most: float = math.inf,
    ) -> Any:
        """A number with a unit, in SI; ``least`` and ``most`` are allowed, ``above`` is not."""
        allowed = _allowed(unit, least, above, most)
        raw = self._value(field, default, allowed)
        if raw is default and field not in self.table:
            return default
        return self._checked(field, raw, unit, allowed, least, above, most)

    def quantities(
        self,
        field: str,
        unit: str,
        default: Any = _MISSING,
        *,
        least: float = -math.inf,
        most: float = math.inf,
    ) -> Any:
        """A list of numbers with units, in SI."""
        allowed = f"a list, each {_allowed(unit, least, -math.inf, most)}"
        raw = self._value(field, default, allowed)
        if raw is default and field not in self.table:
            return default
        if not isinstance(raw, list) or not raw:
            raise self.error(field, allowed)
        return [self._checked(field, item, unit, allowed, least, -math.inf, most) for item in raw]

    def _checked(
        self, field: str, raw: Any, unit: str, allowed: str, least: float, above: float, most: float
    ) -> float:
        try:
            value = parse(raw, unit)
        except InputError as error:
            raise InputError(
                f"{self.source}: {self.name(field)} is {shown(raw)}; it must be {allowed} ({error})."
            ) from None
        if not (value >= least and value > above and value <= most):
            raise self.error(field, allowed)
        return value

    def _value(self, field: str, default: Any, allowed: str) -> Any:
        if field in self.table:
            return self.table[field]
        if default is _MISSING:
            raise self.error(field, allowed)
        return default


def _allowed(unit: str, least: float, above: float, most: float) -> str:
    kind = f"a number with a unit that converts to {unit}" if unit else "a plain number"
    return f"{kind}, {limits_in_words(least, above, most)}".removesuffix(", ")
