"""Tolerances of a data sheet, and the uncertainty by them of any number computed from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from ballscrew.axis import rigidity
from ballscrew.axis.frequency import Rotor, predicted_modes
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

DEFAULT_TOLERANCES: Mapping[str, float] = MappingProxyType(
    {
        "rigidity": rigidity.TOLERANCE,
        "stiffness": 0.30,
        "far_stiffness": 0.30,
        "preload_ratio": 0.15,
    }
)
"""K, k_b (of each bearing that is stated) and P₀ of a sheet that states none: ± as a part of the value; K by
its convention."""

CLEAR_RATIO = 2.0
"""Two modes in which the shares of the table differ by less may both be the axial one of a test: it shows the
one that its torque excites more, and plans that excite one five times as much as the other are accepted."""
_COVERAGE = 1.96  # standard uncertainties that ln CLEAR_RATIO is taken as

_PARTS = ("screw", "bearing", "table", "drive", "guide")
_STEP = 1e-4  # of a value, for central differences: errors of 1e-8 by curvature and 1e-12 by rounding


@dataclass(frozen=True, slots=True, eq=False)
class Propagated:
    """Numbers computed from a data sheet, with their uncertainty by its tolerances.

    Parameters
    ----------
    value : ndarray
        Values by the data sheet.
    contributions : mapping of str to ndarray
        Field to the standard uncertainty that it adds, with sign: the fields are independent.
    """

    value: Array
    contributions: Mapping[str, Array]

    @property
    def covariance(self) -> Array:
        """Covariance of the flattened values; common fields correlate them."""
        spread = np.ascontiguousarray(np.reshape([*self.contributions.values()], (-1, self.value.size)).T)
        return np.asarray(spread @ spread.T)

    @property
    def standard_uncertainty(self) -> Array:
        """Standard uncertainty of each value, in its shape."""
        squares = np.zeros_like(self.value)
        for contribution in self.contributions.values():
            squares = squares + contribution**2
        return np.asarray(np.sqrt(squares))


def tolerances(sheet: DataSheet) -> dict[str, float]:
    """Relative tolerances of a data sheet: those that it states, and the defaults for K, k_b and P₀."""
    defaults = {**DEFAULT_TOLERANCES, "rigidity": rigidity.tolerance(sheet.screw)}
    if sheet.bearing.far_stiffness is None:
        del defaults["far_stiffness"]
    return {**defaults, **sheet.tolerances}


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
    uncertainties = {}
    for name, tolerance in tolerances(sheet).items():
        if tolerance and _value(sheet, name) is not None:
            uncertainties[name] = tolerance / math.sqrt(3)
    return uncertainties


def propagate(sheet: DataSheet, function: Callable[[DataSheet], ArrayLike]) -> Propagated:
    """Propagate the tolerances of a data sheet through a function of it, to first order.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    function : callable
        Takes a data sheet, returns numbers.

    Returns
    -------
    Propagated
        Values with the contribution of each field: ∂y/∂ln p · u(p)/p by central differences
        (JCGM 100:2008, eq. (10)).
    """
    value = np.asarray(function(sheet), dtype=np.float64)
    contributions = {}
    for name, u in relative_uncertainties(sheet).items():
        contributions[name] = u * _slope(sheet, name, function, value)
    return Propagated(value, MappingProxyType(contributions))


@dataclass(frozen=True, slots=True, eq=False)
class PredictedMode(Propagated):
    """Predicted frequency of the axial mode, and of the mode that may be the axial one instead.

    Parameters
    ----------
    second_frequency : ndarray
        Of the mode with the next largest table share, Hz.
    ambiguous : ndarray of bool
        Whether the shares differ by a factor of less than ``CLEAR_RATIO``.
    """

    second_frequency: Array
    ambiguous: NDArray[np.bool_]


def with_uncertainty(
    sheet: DataSheet, position: ArrayLike, load: ArrayLike, rotor: Rotor = "free"
) -> PredictedMode:
    """Frequency that a data sheet predicts at its nominal preload, with its uncertainty by the tolerances.

    Where two modes have nearly equal shares of the table, a test may show either. With the probability p that
    it shows the second one, 2.5 % where the shares differ by a factor of ``CLEAR_RATIO``, √p times the
    difference of the frequencies is one more contribution, ``"second mode"``.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    position, load : array_like
        x_t, m; load on the table, kg.
    rotor : {"free", "held"}
        Whether the motor can turn.

    Returns
    -------
    PredictedMode
        Frequency, Hz, without what no data sheet states: the bed, and the softness of housings.

    Raises
    ------
    InputError
        As :func:`~ballscrew.axis.frequency.predicted_frequency`.
    """
    nominal = predicted_modes(sheet, position, load, rotor=rotor)

    def same_mode(varied: DataSheet) -> Array:
        return predicted_modes(varied, position, load, rotor=rotor).nearest(nominal.frequency)

    predicted = propagate(sheet, same_mode)
    in_limits = nominal.log_odds / math.log(CLEAR_RATIO)
    second = np.sqrt(ndtr(-_COVERAGE * in_limits)) * (nominal.second_frequency - nominal.frequency)
    return PredictedMode(
        predicted.value,
        MappingProxyType({**predicted.contributions, "second mode": second}),
        nominal.second_frequency,
        np.asarray(in_limits < 1),
    )


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
    value: float | None = getattr(getattr(sheet, _part(sheet, name)), name)
    return value


def _part(sheet: DataSheet, name: str) -> str:
    """Part of the data sheet that has a field."""
    for part in _PARTS:
        if hasattr(getattr(sheet, part), name):
            return part
    raise InputError(f"{sheet.source}: tolerances.{name} is no field of a data sheet that has a tolerance.")


def _scaled(sheet: DataSheet, name: str, factor: float) -> DataSheet:
    part = _part(sheet, name)
    value = _value(sheet, name)
    return replace(sheet, **{part: replace(getattr(sheet, part), **{name: (value or 0.0) * factor})})
