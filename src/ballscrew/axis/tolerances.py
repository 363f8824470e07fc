"""How sure a data sheet is: the makers' tolerances, and what they make of any number computed from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.equations import Theta
from ballscrew.axis.frequency import Rotor, predicted_frequency
from ballscrew.axis.model import theta
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

__all__ = [
    "DEFAULT_TOLERANCES",
    "Propagated",
    "propagate",
    "relative_uncertainties",
    "theta_with_uncertainty",
    "tolerances",
    "with_uncertainty",
]


DEFAULT_TOLERANCES: Mapping[str, float] = MappingProxyType(
    {"rigidity": 0.20, "stiffness": 0.30, "preload_ratio": 0.15}
)
"""K, k_b and P₀ of a data sheet that states none: ± as a part of the value."""

_PARTS = ("screw", "bearing", "table", "drive", "guide")
_STEP = 1e-4  # of a value, for central differences: errors of 1e-8 by curvature and 1e-12 by rounding


@dataclass(frozen=True, slots=True, eq=False)
class Propagated:
    """Numbers computed from a data sheet, and what its tolerances make of them.

    Parameters
    ----------
    value : ndarray
        As the sheet's values give them.
    contributions : mapping of str to ndarray
        Field to the standard uncertainty that it adds, with sign: the fields are independent.
    """

    value: Array
    contributions: Mapping[str, Array]

    @property
    def covariance(self) -> Array:
        """Of the raveled values: all share the same few fields, so they are far from independent."""
        columns = [np.ravel(part) for part in self.contributions.values()]
        spread = np.stack(columns, axis=1) if columns else np.zeros((self.value.size, 0))
        return np.asarray(spread @ spread.T)

    @property
    def standard_uncertainty(self) -> Array:
        """Of each value alone, in its shape."""
        squares = sum((part**2 for part in self.contributions.values()), np.zeros_like(self.value))
        return np.asarray(np.sqrt(squares))


def tolerances(sheet: DataSheet) -> dict[str, float]:
    """Relative tolerances of a data sheet: those that it states, and the defaults for K, k_b and P₀."""
    return {**DEFAULT_TOLERANCES, **sheet.tolerances}


def relative_uncertainties(sheet: DataSheet) -> dict[str, float]:
    """Relative standard uncertainty of each field that has a tolerance.

    A tolerance is taken as the half-width of a rectangular distribution, so its standard uncertainty is
    tolerance / √3 (JCGM 100:2008, 4.3.7). Fields that the sheet leaves out have none.

    Parameters
    ----------
    sheet : DataSheet
        The axis.

    Returns
    -------
    dict of str to float
        Field to u(value)/value.
    """
    return {
        name: tolerance / math.sqrt(3)
        for name, tolerance in tolerances(sheet).items()
        if tolerance and _value(sheet, name) is not None
    }


def propagate(sheet: DataSheet, function: Callable[[DataSheet], ArrayLike]) -> Propagated:
    """Carry the tolerances of a data sheet through a function of it, to first order.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    function : callable
        Takes a data sheet, returns numbers.

    Returns
    -------
    Propagated
        The numbers with what each field adds: ∂y/∂ln p · u(p)/p by central differences
        (JCGM 100:2008, eq. (10)).
    """
    value = np.asarray(function(sheet), dtype=np.float64)
    return Propagated(
        value=value,
        contributions=MappingProxyType(
            {
                name: u * _slope(sheet, name, function, value)
                for name, u in relative_uncertainties(sheet).items()
            }
        ),
    )


def theta_with_uncertainty(sheet: DataSheet, *, torsion: bool = False) -> Propagated:
    """θ = {a, b, c, d} of a data sheet with the covariance that the tolerances give.

    a, b and c share κ, and with it the tolerance of K: they are strongly correlated.

    Parameters
    ----------
    sheet : DataSheet
        The axis, carried at one end.
    torsion : bool
        As in :func:`~ballscrew.axis.model.theta`.

    Returns
    -------
    Propagated
        ``value`` is a, b, c, d; ``covariance`` has shape (4, 4).

    Raises
    ------
    InputError
        As :func:`~ballscrew.axis.model.theta`.
    """

    def numbers(one: DataSheet) -> Array:
        got: Theta = theta(one, torsion=torsion)
        return np.array([got.a, got.b, got.c, got.d])

    return propagate(sheet, numbers)


def with_uncertainty(
    sheet: DataSheet, position: ArrayLike, load: ArrayLike, rotor: Rotor = "free"
) -> Propagated:
    """Frequency that a data sheet predicts at its nominal preload, with what its tolerances make of it.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    position, load : array_like
        x_t, m; what lies on the table, kg.
    rotor : {"free", "held"}
        Whether the motor can turn.

    Returns
    -------
    Propagated
        Hz. That the model itself is a per cent or two off is not in it.

    Raises
    ------
    InputError
        As :func:`~ballscrew.axis.frequency.predicted_frequency`.
    """
    return propagate(sheet, lambda one: predicted_frequency(one, position, load, rotor=rotor))


def _slope(sheet: DataSheet, name: str, function: Callable[[DataSheet], ArrayLike], value: Array) -> Array:
    """∂y/∂ln p; from one side where the other is no possible axis."""
    sides = []
    for step in (_STEP, -_STEP):
        try:
            sides.append((step, np.asarray(function(_scaled(sheet, name, 1 + step)), dtype=np.float64)))
        except InputError:
            sides.append((0.0, value))
    (up, above), (down, below) = sides
    return np.asarray((above - below) / ((up - down) or 1.0))


def _value(sheet: DataSheet, name: str) -> float | None:
    for part in _PARTS:
        if hasattr(getattr(sheet, part), name):
            found: float | None = getattr(getattr(sheet, part), name)
            return found
    raise InputError(f"{sheet.source}: tolerances.{name} is no field of a data sheet that has a tolerance.")


def _scaled(sheet: DataSheet, name: str, factor: float) -> DataSheet:
    part = next(part for part in _PARTS if hasattr(getattr(sheet, part), name))
    value = _value(sheet, name)
    return replace(sheet, **{part: replace(getattr(sheet, part), **{name: (value or 0.0) * factor})})
