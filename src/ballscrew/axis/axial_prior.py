"""Prior of the axial model from a data sheet: mean and covariance of the working vector."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.axial import PARAMETERS, frequency, from_sheet, from_vector, gradient, to_vector
from ballscrew.axis.frequency import predicted_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.tolerances import Propagated, propagate
from ballscrew.base.arrays import Array

DISCREPANCY: Mapping[str, float] = MappingProxyType(
    {"compliance": 0.04, "mass": 0.02, "rotor": 0.05, "slope": 0.05, "curve": 0.05}
)
"""Relative standard uncertainty of the model itself, with every number of the sheet exact.

The bed, the nut's housing and the table between its nut and its sensor are soft and on no sheet: 4 % of
compliance. A third of the screw is what moves with the table only while the rest is as light as it should be:
2 % of mass. The disc behind the coupling and the screw's own inertia are not one: 5 % of the rotor. Slope and
curve lack the twist between coupling and bearing: 5 % of each.
"""

BED = (18.0, 0.4)
"""Mass of the bed in tables, and its relative standard uncertainty.

No data sheet states it. A bed on its mounts, far below the axial mode, swings against the table as the rotor
does: the reciprocal of the rotor's parameter is 1/m_r + 1/bed. Machine beds weigh 10 to 30 tables.
"""

KNOWN_PRELOAD = 0.02
"""Relative standard uncertainty of a known preload that states none."""

_LEAST = 1e-3  # least relative uncertainty of a preload, whatever the sheet states
_SOFT = 0.5  # prior standard deviation of a parameter in the fit to the rod
_CLOSE = 3e-4  # relative error of the frequencies in that fit
_STEPS = (1.0, 0.3, 0.1, 0.03, 0.01, 0.001, 0.0)  # parts of a step, until one lowers the cost
_LONGEST = 10.0  # step of any parameter: e^10 is within the range of numbers
_ROUNDING = 1e-6  # of the cost, which is a sum of about 24 squares


def prior(
    sheet: DataSheet,
    centre: float,
    discrepancy: Mapping[str, float] = DISCREPANCY,
    bed: tuple[float, float] = BED,
) -> tuple[Array, Array]:
    """Prior mean and covariance of the working vector from the data sheet.

    The mean is the lumped model that follows the distributed one (:func:`distributed`), with the bed beside
    the rotor. The tolerances of the sheet's fields are independent; K, k_b and P₀ each move compliance, share
    and preload: these three are strongly correlated. What the model itself lacks is added; missing compliance
    is not the nut's, so it takes from the nut's share what it adds to the whole.

    Parameters
    ----------
    sheet : DataSheet
        The axis, with its tolerances.
    centre : float
        Position at which the compliance is stated, m.
    discrepancy : mapping
        Relative standard uncertainty of the model itself, see ``DISCREPANCY``.
    bed : tuple of float
        Its mass in tables, and the relative standard uncertainty of that.

    Returns
    -------
    mean : ndarray, shape (7,)
        Working vector.
    covariance : ndarray, shape (7, 7)
        Covariance; 0 for the curve of a screw with one end fixed.

    Raises
    ------
    InputError
        If the centre is not on the screw.
    """
    spread = _propagated(sheet, centre).covariance
    mean = distributed(sheet, centre)
    model = from_vector(mean, centre)
    tables, relative = bed
    weight = sheet.table.mass * tables
    columns = np.zeros((len(PARAMETERS), 6))
    at = PARAMETERS.index
    for column, (name, scale) in enumerate(
        (("compliance", 1.0), ("slope", model.slope), ("curve", model.curve), ("mass", 1.0), ("rotor", 1.0))
    ):
        columns[at(name), column] = scale * discrepancy.get(name, 0.0)
    soft = discrepancy.get("compliance", 0.0)
    columns[at("share"), 0] = -soft / (1 - model.share)
    columns[at("slope"), 0] = -soft * model.slope
    columns[at("curve"), 0] = -soft * model.curve
    mean[at("rotor")] -= math.log1p(model.rotor / weight)
    columns[at("rotor"), 5] = relative * model.rotor / (model.rotor + weight)
    covariance = spread + columns @ columns.T
    covariance[at("preload"), at("preload")] += _LEAST**2
    return mean, covariance


def tolerated(sheet: DataSheet, centre: float) -> Mapping[str, Array]:
    """Effect of the tolerance of each number of the data sheet on the working vector.

    Parameters
    ----------
    sheet : DataSheet
        The axis, with its tolerances.
    centre : float
        Position at which the compliance is stated, m.

    Returns
    -------
    mapping of str to ndarray, shape (7,)
        Field to the effect of one standard uncertainty of it: its tolerance over √3.
    """
    return _propagated(sheet, centre).contributions


def _propagated(sheet: DataSheet, centre: float) -> Propagated:
    return propagate(sheet, lambda varied: to_vector(from_sheet(varied, centre)))


def distributed(sheet: DataSheet, centre: float) -> Array:
    """Working vector that follows a screw with its mass and its twist spread along it.

    Gauss-Newton steps from :func:`~ballscrew.axis.axial.from_sheet` to the frequencies of
    :func:`~ballscrew.axis.frequency.predicted_frequency` at four positions, three loads and two preloads.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    centre : float
        Position at which the compliance is stated, m.

    Returns
    -------
    ndarray, shape (7,)
        Its log preload is the sheet's.
    """
    plain = replace(sheet, tolerances={}, source="the data sheet")  # the same axis, whatever its file
    return np.array(_distributed(plain, centre))


def form_error(sheet: DataSheet, centre: float, position: ArrayLike, load: ArrayLike) -> Array:
    """Frequencies of the distributed screw that the lumped model nearest to it does not follow.

    Parameters
    ----------
    sheet : DataSheet
        The axis.
    centre : float
        Position at which the compliance is stated, m.
    position, load : array_like
        x_t, m; load on the table, kg.

    Returns
    -------
    ndarray
        ln f of the screw less that of the model, rotor free: 2 to 20e-4 along the travel.
    """
    lumped = frequency(from_vector(distributed(sheet, centre), centre), position, load)
    return np.asarray(np.log(predicted_frequency(sheet, position, load) / lumped))


def both_ends_curve(sheet: DataSheet, centre: float) -> float:
    """Return the curve that the same screw would have with both ends fixed, 1/m²."""
    return from_sheet(replace(sheet, support="fixed-fixed"), centre).curve


@lru_cache(maxsize=64)
def _distributed(sheet: DataSheet, centre: float) -> tuple[float, ...]:
    high = sheet.travel_limit
    places = np.linspace(min(0.0, centre), max(0.85 * high, centre), 4)
    points = np.array(
        [(x, load, ratio) for x in places for load in (0.0, 0.5, 1.5) for ratio in (1.0, 0.4)]
    ).T * np.array([[1.0], [sheet.table.mass], [1.0]])
    x, load, ratio = points
    target = np.log(predicted_frequency(sheet, x, load, ratio * sheet.nominal_preload))
    start = to_vector(from_sheet(sheet, centre))
    free = [
        k for k, name in enumerate(PARAMETERS) if name != "preload" and (name != "curve" or start[k] != 0)
    ]

    def deviation(vector: Array) -> tuple[Array, Array]:
        """Misfit of the frequencies and distance from the start, in standard deviations."""
        misfit = (target - np.log(frequency(from_vector(vector, centre), x, load, ratio))) / _CLOSE
        return misfit, (start - vector)[free] / _SOFT

    vector, (misfit, away) = start.copy(), deviation(start)
    for _ in range(8):
        jacobian = gradient(from_vector(vector, centre), x, load, ratio)[:, free] / _CLOSE
        matrix = jacobian.T @ jacobian + np.eye(len(free)) / _SOFT**2
        step = np.linalg.solve(matrix, jacobian.T @ misfit + away / _SOFT)
        step *= min(1.0, _LONGEST / np.abs(step).max())
        cost = misfit @ misfit + away @ away
        for part in _STEPS:
            trial = vector.copy()
            trial[free] += part * step
            misfit, away = deviation(trial)
            if misfit @ misfit + away @ away <= cost + _ROUNDING:
                break
        vector = trial
    return tuple(float(number) for number in vector)
