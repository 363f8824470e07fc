"""A value with its uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from ballscrew.base.errors import InputError, shown
from ballscrew.base.units import conversion

NORMAL_95 = 1.959963984540054
"""Half of a 95 % interval of a normal distribution, in standard deviations."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A value, its standard uncertainty and its unit.

    Parameters
    ----------
    value : float
        Best estimate, in ``unit``.
    standard_uncertainty : float
        One standard deviation of what the value may be (GUM, JCGM 100:2008), in ``unit``.
    unit : str
        SI unit.
    interval95 : tuple of float, optional
        95 % interval where it is not the symmetric normal one.
    """

    value: float
    standard_uncertainty: float
    unit: str = ""
    interval95: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Refuse a negative or missing uncertainty: a number without one is no measurement."""
        try:
            finite = math.isfinite(self.value) and math.isfinite(self.standard_uncertainty)
        except TypeError:  # a text
            finite = False
        if not finite:
            raise InputError(
                "value and standard uncertainty of a quantity must be finite numbers; they are "
                f"{shown(self.value)} and {shown(self.standard_uncertainty)}."
            )
        if self.standard_uncertainty < 0:
            raise InputError(f"a standard uncertainty cannot be negative: {self.standard_uncertainty}")
        if self.interval95 is not None:
            low, high = self.interval95
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise InputError(f"an interval must be two finite numbers in ascending order: {low}, {high}")

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval, in ``unit``."""
        if self.interval95 is not None:
            return self.interval95
        half = NORMAL_95 * self.standard_uncertainty
        return (self.value - half, self.value + half)

    def to(self, unit: str) -> Quantity:
        """Convert to another unit.

        Parameters
        ----------
        unit : str
            SI unit; a quantity without a unit is already in it.

        Returns
        -------
        Quantity
            The same quantity in ``unit``.

        Raises
        ------
        InputError
            If its unit is of another kind.
        """
        if self.unit in ("", unit):
            return replace(self, unit=unit)
        slope, offset = conversion(self.unit, unit)
        interval = self.interval95
        if interval is not None:
            interval = (slope * interval[0] + offset, slope * interval[1] + offset)
        return Quantity(slope * self.value + offset, slope * self.standard_uncertainty, unit, interval)

    def to_json(self) -> dict[str, Any]:
        """As the interfaces print it: value, standard_uncertainty, interval95."""
        return {
            "value": self.value,
            "standard_uncertainty": self.standard_uncertainty,
            "interval95": list(self.interval),
        }

    def __str__(self) -> str:
        """Value ± standard uncertainty, rounded to two digits of the uncertainty."""
        if self.standard_uncertainty == 0:
            return f"{self.value:g} {self.unit}".strip()
        return (
            f"{self.value:.{self.digits}f} ± {self.standard_uncertainty:.{self.digits}f} {self.unit}".strip()
        )

    @property
    def digits(self) -> int:
        """Decimals that show two digits of the standard uncertainty, which is above 0."""
        return max(0, 1 - math.floor(math.log10(self.standard_uncertainty)))


def quantity_numbers(quantity: Quantity | None) -> tuple[float, float, float] | None:
    """Value and both ends of the 95 % interval of a quantity, or None."""
    if quantity is None:
        return None
    return quantity.value, *quantity.interval


def quantity_json(quantity: Quantity | None) -> dict[str, Any] | None:
    """JSON of a quantity, or None."""
    if quantity is None:
        return None
    return quantity.to_json()
