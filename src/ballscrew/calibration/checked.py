"""Numbers of a document that was written by others, checked where they are read."""

from __future__ import annotations

import math
from typing import Any

from ballscrew.base.errors import InputError, shown
from ballscrew.base.quantity import Quantity

__all__ = ["mass_of", "number", "quantity_of"]


def number(value: Any, where: str, least: float = -math.inf, above: bool = False) -> float:
    """Take a finite number.

    Parameters
    ----------
    value : object
        What stands there.
    where : str
        For the message.
    least : float
        The least that is allowed.
    above : bool
        Whether it must be more than that.

    Returns
    -------
    float
        The number.

    Raises
    ------
    InputError
        If it is none.
    """
    wrong = isinstance(value, bool) or not isinstance(value, (int, float))
    try:
        told = math.nan if wrong else float(value)
    except OverflowError:
        told = math.nan
    if not math.isfinite(told) or told < least or (above and told == least):
        bound = "" if least == -math.inf else (f" above {least:g}" if above else f", {least:g} or more")
        raise InputError(f"{where} is {shown(value)}; it must be a number{bound}.")
    return told


def mass_of(value: Any, spreads: Any, key: str) -> Quantity | None:
    """Take a mass of the rigid body; None where it or its uncertainty is not told."""
    if value is None:
        return None
    spread = spreads.get(key) if isinstance(spreads, dict) else None
    told = number(value, f"rigid_body.{key}")
    return None if spread is None else Quantity(told, number(spread, f"uncertainty of {key}", 0.0), "kg")


def quantity_of(value: Any, name: str) -> Quantity | None:
    """Take the mass over the preload; None where it is not told."""
    if value is None:
        return None
    where = f"{name}: mass_over_preload_kg_per_N"
    if isinstance(value, Quantity):
        told: Any = (value.value, value.standard_uncertainty)
    elif isinstance(value, dict):
        told = (value.get("value"), value.get("standard_uncertainty"))
    else:
        raise InputError(f"{where} is {shown(value)}; it must hold a value and its standard uncertainty.")
    return Quantity(number(told[0], where, 0.0, True), number(told[1], where, 0.0), "kg/N")
