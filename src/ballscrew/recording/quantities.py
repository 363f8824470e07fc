"""Quantities of channels, and their SI units."""

from __future__ import annotations

import re

from ballscrew.base.errors import InputError
from ballscrew.base.units import conversion

SI_UNITS = {
    "torque": "N m",
    "force": "N",
    "relative torque": "",
    "current": "A",
    "position": "m",
    "speed": "m/s",
    "acceleration": "m/s^2",
    "temperature": "kelvin",
    "backlash": "m",
    "time": "s",
}
INPUTS = ("torque", "force", "relative torque", "current")  # that drive the axis, the best first
_PERCENT = re.compile(r"\A(?:%|percent|pct)(?: (?:of )?rated|\s?M_?[Nn](?:enn)?)?\Z")

_POWER = r"(?:\^|\*\*)?"
# Spellings of sensors and drives beyond base.units; "g" is a mass there and an acceleration here.
_SPELLINGS = {
    "torque": ((re.compile(r"\b([kmc]?N)\s*[*·. ]?\s*(c?m)\Z"), r"\1 * \2"),),
    "temperature": (
        (re.compile(r"\A(?:deg(?:rees?)?[ _]?C(?:elsius)?|[Cc]elsius|C)\Z"), "degC"),
        (re.compile(r"\A(?:deg(?:rees?)?[ _]?F(?:ahrenheit)?|F|°F)\Z"), "degF"),
    ),
    "acceleration": (
        (re.compile(r"\A(m?)(?:g|gn|g0|g_n|g_0|G)\Z"), r"\1g_0"),
        (re.compile(rf"/\s*s{_POWER}2\Z"), "/s^2"),
        (re.compile(r"[ .*·]s(?:\^|\*\*)?(?:-2|⁻²)\Z"), "/s^2"),
    ),
    "speed": ((re.compile(r"[ .*·]s(?:\^|\*\*)?(?:-1|⁻¹)\Z"), "/s"),),
    "time": ((re.compile(r"\s+since\s.*\Z", re.DOTALL), ""),),
}


def to_si(unit: str, quantity: str) -> tuple[float, float]:
    """Slope and offset that take a channel's values to SI.

    Parameters
    ----------
    unit : str
        The unit as written; empty for SI.
    quantity : str
        One of :data:`SI_UNITS`.

    Returns
    -------
    slope, offset : float
        ``value_in_SI = slope * value + offset``.

    Raises
    ------
    InputError
        If the unit is not known or is of another kind.

    Examples
    --------
    >>> to_si("g", "acceleration")
    (9.80665, 0.0)
    """
    if not unit:
        return 1.0, 0.0
    if quantity == "relative torque":
        if _PERCENT.match(unit.strip()) is None:
            raise InputError(f"the unit {unit!r} is not %")
        return 0.01, 0.0
    spelled = unit.strip().replace("μ", "µ").replace("µ", "u")
    for pattern, word in _SPELLINGS.get(quantity, ()):
        spelled = pattern.sub(word, spelled)
    try:
        if spelled == "mg_0":
            return 1e-3 * conversion("g_0", SI_UNITS[quantity])[0], 0.0
        return conversion(spelled, SI_UNITS[quantity])
    except InputError as error:
        raise InputError(str(error).replace(repr(spelled), repr(unit))) from None
