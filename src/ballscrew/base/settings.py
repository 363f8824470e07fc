"""One check for the numbers of settings."""

from __future__ import annotations

import math
from datetime import datetime
from numbers import Integral, Real

from ballscrew.base.errors import InputError, shown


def limits_in_words(least: float, above: float, most: float) -> str:
    """Limits of a number, ``"more than 0 and 1 or less"``; empty without limits."""
    limits = []
    if above > -math.inf:
        limits.append(f"more than {above:g}")
    if least > -math.inf:
        limits.append(f"{least:g} or more")
    if most < math.inf:
        limits.append(f"{most:g} or less")
    return " and ".join(limits)


def check_setting(
    name: str, value: object, *, least: float = -math.inf, above: float = -math.inf, most: float = math.inf
) -> None:
    """Check that a setting is a finite number within its limits.

    Parameters
    ----------
    name : str
        Name of the setting, for the message.
    value : object
        Its value.
    least, above, most : float
        Limits; ``least`` and ``most`` themselves are allowed, ``above`` is not.

    Raises
    ------
    InputError
        If it is not.
    """
    is_number = not isinstance(value, bool) and isinstance(value, Real) and math.isfinite(value)
    if is_number and least <= value <= most and value > above:  # type: ignore[operator]
        return
    allowed = f"a number, {limits_in_words(least, above, most)}".removesuffix(", ")
    raise InputError(f"{name} is {shown(value)}; it must be {allowed}.")


def check_whole(name: str, value: object, least: int, most: float = math.inf) -> None:
    """Check that a setting is a whole number within its limits.

    Parameters
    ----------
    name : str
        Name of the setting, for the message.
    value : object
        Its value.
    least, most : float
        Limits, both allowed.

    Raises
    ------
    InputError
        If it is not.
    """
    is_whole = not isinstance(value, bool) and isinstance(value, Integral)
    if not is_whole or not least <= value <= most:  # type: ignore[operator]
        limits = limits_in_words(least, -math.inf, most)
        raise InputError(f"{name} is {shown(value)}; it must be a whole number, {limits}.")


def timestamp(text: str | datetime, where: str) -> str:
    """Check a time and return it in ISO 8601.

    Parameters
    ----------
    text : str or datetime
        ``"2026-01-31T08:00Z"``.
    where : str
        Its place, for the message.

    Returns
    -------
    str
        The same time, as written by :meth:`datetime.datetime.isoformat`.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        if isinstance(text, datetime):
            text = text.isoformat()
        return datetime.fromisoformat(text).isoformat()
    except (ValueError, TypeError):
        raise InputError(
            f"{where} is {shown(text)}; it must be a time in ISO 8601, such as 2026-01-31T08:00Z."
        ) from None
