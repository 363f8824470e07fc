"""Units, at the edges only: everything inside is SI and plain numbers."""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from ballscrew.base.errors import InputError, shown

if TYPE_CHECKING:
    import pint

# What TOML files and people write, and pint reads otherwise or not at all.
_SPELLINGS = (
    (re.compile(r"\bN ?/ ?u(?:m)\b"), "N/micrometer"),
    (re.compile(r"\b([kMm]?)N([cm]?m)\b"), r"\1N*\2"),
    (re.compile(r"\br(?:ev)?/min\b|\brpm\b", re.IGNORECASE), "revolution/minute"),
    (re.compile(r"(?<![A-Za-z])g0?_n\b"), "standard_gravity"),
    (re.compile(r"°C|\bdegC\b"), "degC"),
    (re.compile(r"²"), "^2"),
    (re.compile(r"³"), "^3"),
    (re.compile(r"·"), "*"),
)

# Slope and offset of common units: pint needs 1 s of processor time to read its definitions, once.
COMMON = {
    ("mm", "m"): (1e-3, 0.0),
    ("um", "m"): (1e-6, 0.0),
    ("mm/s", "m/s"): (1e-3, 0.0),
    ("N/um", "N/m"): (1e6, 0.0),
    ("kN", "N"): (1e3, 0.0),
    ("Nm", "N m"): (1.0, 0.0),
    ("N*m", "N m"): (1.0, 0.0),
    ("N * m", "N m"): (1.0, 0.0),
    ("kN m/rad", "N m/rad"): (1e3, 0.0),
    ("kHz", "Hz"): (1e3, 0.0),
    ("ms", "s"): (1e-3, 0.0),
    ("min", "s"): (60.0, 0.0),
    ("GPa", "Pa"): (1e9, 0.0),
    ("degC", "kelvin"): (1.0, 273.15),
    ("°C", "kelvin"): (1.0, 273.15),
}

_LONGEST = 60
_LARGEST = 1e30  # no quantity of a machine; products of a few of them stay finite
# pint works a power out before it looks at the kind of unit, and "m^9^9^9" would keep it busy for ever.
_WILD_POWER = re.compile(r"\)\s*\^|\^(?!\s*[-+]?\d(?!\s*[\d.^eE]))")


@lru_cache(maxsize=1)
def _registry() -> pint.UnitRegistry[Any]:
    import pint  # only where an uncommon unit is read

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True, on_redefinition="raise")


def _spelled(text: str) -> str:
    for pattern, word in _SPELLINGS:
        text = pattern.sub(word, text)
    return text.strip()


@lru_cache(maxsize=256)
def conversion(unit: str, to: str) -> tuple[float, float]:
    """Slope and offset that take a value in ``unit`` to the SI unit ``to``.

    Parameters
    ----------
    unit : str
        The unit as written, ``"mm"``; empty for no unit.
    to : str
        The unit wanted, ``"m"``.

    Returns
    -------
    slope, offset : float
        ``value_in_to = slope * value + offset``.

    Raises
    ------
    InputError
        If the unit is not known or is of another kind.
    """
    if unit == to:
        return 1.0, 0.0
    found = COMMON.get((re.sub("[µμ]", "u", unit), to))
    if found is not None:
        return found
    return conversion_by_pint(unit, to)


class NoDefinitionsError(InputError):
    """The definitions of uncommon units cannot be loaded in this process."""


def conversion_by_pint(unit: str, to: str) -> tuple[float, float]:
    """As :func:`conversion`, of any unit; NoDefinitionsError in a process that may open no further file."""
    if len(unit) > _LONGEST or _WILD_POWER.search(_spelled(unit).replace("**", "^")):
        raise InputError(f"the unit {unit[:_LONGEST]!r} is not known")
    try:
        import pint

        registry = _registry()
    except (ImportError, OSError) as error:
        raise NoDefinitionsError(f"the unit {unit!r} needs pint, which cannot be loaded") from error
    if not unit.isascii() and _spelled(unit) == unit:
        unit = unit.replace("µ", "u").replace("μ", "u")
    try:
        quantity = registry.Unit(_spelled(unit))
        target = registry.Unit(to)
        zero = registry.Quantity(0.0, quantity).to(target).magnitude
        unity = registry.Quantity(1.0, quantity).to(target).magnitude
        # Pint's radian has no dimension, so that it would read 1 rad/s as 1 Hz.
        angular = "radian" in str(registry.Quantity(1.0, quantity).to_root_units().units)
        if to == "Hz" and angular:
            unity /= 2 * math.pi
    except pint.DimensionalityError:
        raise InputError(
            f"the unit {unit!r} is not one that can be turned into {to or 'a plain number'}"
        ) from None
    except Exception as error:
        raise InputError(f"the unit {unit!r} is not known") from error
    return float(unity - zero), float(zero)


_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)\Z", re.DOTALL)


def _plain(value: Any) -> Any:
    """A NumPy scalar, or an array of one number as of a MAT file, as a plain number; else the value."""
    item = getattr(value, "item", None)
    return item() if callable(item) and getattr(value, "size", 0) == 1 else value


def parse(value: str | float, to: str) -> float:
    """A quantity as people write it, in SI.

    Parameters
    ----------
    value : str or float
        ``"10 mm"``; a bare number, also of NumPy, is SI already.
    to : str
        The SI unit, ``"m"``; ``""`` for a plain number.

    Returns
    -------
    float
        The value in ``to``.

    Raises
    ------
    InputError
        If it is not a number with a unit of that kind, not finite, or far from any quantity of a machine.

    Examples
    --------
    >>> parse("10 mm", "m")
    0.01
    >>> parse(0.01, "m")
    0.01
    """
    value = _plain(value)
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise InputError(f"{shown(value)} is not a number with a unit, such as '10 {to}'")
    if isinstance(value, str):
        match = _NUMBER.match(value)
        if match is None:
            raise InputError(f"{shown(value)} is not a number with a unit, such as '10 {to}'")
        number, unit = float(match[1]), match[2].strip()
        slope, offset = conversion(unit, to) if unit else (1.0, 0.0)
        result = slope * number + offset
    else:
        try:
            result = float(value)
        except OverflowError:  # TOML's whole numbers have no end
            result = math.inf
    if not math.isfinite(result):
        raise InputError(f"{shown(value)} is not a finite number")
    if abs(result) > _LARGEST:
        raise InputError(f"{shown(value)} is too large")
    return result


def parse_named(what: str, value: str | float, to: str) -> float:
    """As :func:`parse`; an error names what the quantity is, such as ``"the load (mass)"``."""
    try:
        return parse(value, to)
    except InputError as error:
        raise InputError(f"{what} is {shown(value)}; it must be a quantity in {to} ({error}).") from None
