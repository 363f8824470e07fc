"""Covariance of the fitted curve along the axis, and the deviation of each cell from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.quantity import Quantity
from ballscrew.modal.joint.fit import LOCAL, SAMPLES_PER_INDEPENDENT, JointFit, Parameter
from ballscrew.modal.joint.mode import AxialMode, local_compliance, mode_frequency

_MEDIAN = 1.4826  # standard deviation of a normal variable over the median of its size
_RIDGE = 0.05  # of the whole fit's information, added to that of one condition
_ZERO = 1e-9  # of the largest variance: smaller ones are rounding
_LEAST_NUT = 0.3  # of the nut's share in the middle: local wear never lowers it further
_MOST_SHARE = 0.95
_LAW = 0.10  # relative uncertainty of the nut's law and of the data sheet's share, which no scatter shows
_MOST_DEVIATION = 0.35  # of the logarithm of mass over preload: less certain than the data sheet is useless
_LEAST_OWN = 0.01  # of the information about the load that must come from the run


def _covariance(found: JointFit) -> Array:
    """Covariance of the parameters from the scatter of cells, shape (parameters, parameters).

    A sandwich estimator with cells as clusters: cells are independent, samples and blocks of one cell are
    not. It contains noise of any colour, and model errors that differ from cell to cell.
    """
    scores = np.asarray(sum(_cell_scores(found, i) for i in range(len(found.blocks))))
    count, parameters = scores.shape
    inverse = np.linalg.pinv(found.hessian)
    whole = scores.T @ scores * (count / max(count - parameters, 1))
    return np.asarray(inverse @ whole @ inverse)


def _cell_scores(found: JointFit, index: int) -> Array:
    """Score (gradient of the log-likelihood) of each cell of a block, shape (cells, parameters)."""
    jacobian, residual = found.jacobian[index], found.residual[index]
    return np.array([jacobian[rows].T @ residual[rows] for rows in found.blocks[index].rows])


def _condition_covariance(found: JointFit) -> Array:
    """Covariance of the parameters from the scatter of conditions, shape (parameters, parameters).

    Window, motion and friction are shared by all cells of a condition, so that cells as clusters do not show
    them. One step of the fit is made with each condition's cells alone; zero with one condition only.
    """
    conditions = sorted({cell.condition for cell in found.blocks[0].windows.cells})
    if len(conditions) < 2:
        return np.zeros_like(found.hessian)
    steps = [_condition_step(found, condition) for condition in conditions]
    return np.asarray(np.cov(steps, rowvar=False) / len(steps))


def _condition_step(found: JointFit, condition: str) -> Array:
    """Step of the fit by the cells of one condition; what they do not determine stays as fitted."""
    hessian = np.zeros_like(found.hessian)
    score = np.zeros(len(hessian))
    for b, jacobian, residual in zip(found.blocks, found.jacobian, found.residual, strict=True):
        for rows, cell in zip(b.rows, b.windows.cells, strict=True):
            if cell.condition == condition:
                hessian += jacobian[rows].T @ jacobian[rows]
                score += jacobian[rows].T @ residual[rows]
    return np.asarray(np.linalg.pinv(hessian + _RIDGE * found.hessian) @ score)


def variance_inflation(found: JointFit, parameter: int) -> float:
    """Variance of a parameter by the scatter of cells or conditions, over that expected of white noise."""
    found = replace(found, hessian=np.asarray(sum(j.T @ j for j in found.jacobian)))
    white = float(np.linalg.pinv(found.hessian)[parameter, parameter])
    by_cells = float(_covariance(found)[parameter, parameter])
    by_conditions = float(_condition_covariance(found)[parameter, parameter])
    return max(max(by_cells, by_conditions) / max(white, 1e-300), 1.0)


@dataclass(frozen=True, slots=True)
class TiedCurves:
    """Modes after :func:`tie_slopes`, with two covariances of their parameters.

    Parameters
    ----------
    fit : JointFit
        The fit.
    modes : tuple of AxialMode
        One per block.
    noise, conditions : ndarray, shape (parameters, parameters)
        By the scatter of cells, and of conditions.
    """

    fit: JointFit
    modes: tuple[AxialMode, ...]
    noise: Array
    conditions: Array

    def curve(self, block: int, place: Array) -> Array:
        """Frequency of the mode of a block at positions from the middle (m), Hz."""
        return mode_frequency(self.modes[block], place)

    def effects(self, block: int, place: Array, part: Literal["noise", "conditions"]) -> Array:
        """Effects of independent causes on the frequency, shape (causes, places), Hz."""
        covariance = self.noise if part == "noise" else self.conditions
        gradient = _gradient(self.fit, block, place)
        variances, vectors = np.linalg.eigh(gradient @ covariance @ gradient.T)
        good = variances > _ZERO * max(float(variances[-1]), 1e-300)
        return np.asarray(vectors[:, good] * np.sqrt(variances[good])).T


def tie_slopes(found: JointFit, shrinkage: Array, deviation: float, reach: float) -> TiedCurves:
    """Tie the slopes of the two drives' curves.

    The two frequencies differ by the masses alone, so their squares keep nearly one ratio along the axis: a
    slope that one drive determines poorly may be known from the other.

    Parameters
    ----------
    found : JointFit
        Of one block or more.
    shrinkage : ndarray, shape (parameters, parameters)
        Covariance due to the prior of local compliances.
    deviation : float
        Standard deviation by which the ratio of the squared frequencies may change along the axis.
    reach : float
        Length of the axis, m.

    Returns
    -------
    TiedCurves
        Unchanged modes if there is one block.
    """
    noise, conditions = _covariance(found) + shrinkage, _condition_covariance(found) + shrinkage
    modes = found.modes
    parameters = found.parameters
    for power, field in enumerate(("slope", "curve"), start=1):
        if len(modes) < 2 or (field, 0) not in parameters:
            continue
        contrast = np.zeros(len(parameters))
        contrast[parameters.index((field, 0))] = 1.0
        contrast[parameters.index((field, 1))] = -1.0
        allowed = (deviation / reach**power) ** 2
        spread = (noise + conditions) @ contrast
        gain = spread / float(contrast @ spread + allowed)
        difference = getattr(modes[0], field) - getattr(modes[1], field)
        modes = _moved(modes, parameters, -gain * difference)
        remaining = np.eye(len(parameters)) - np.outer(gain, contrast)
        noise = remaining @ noise @ remaining.T + allowed * np.outer(gain, gain)
        conditions = remaining @ conditions @ remaining.T
    return TiedCurves(found, modes, noise, conditions)


def _moved(
    modes: Sequence[AxialMode], parameters: Sequence[Parameter], change: Array
) -> tuple[AxialMode, ...]:
    """Modes whose own parameters are changed; ``change`` has the shape (parameters,)."""
    out = list(modes)
    for (field, index), value in zip(parameters, change.tolist(), strict=True):
        if index is None:
            continue
        now = getattr(out[index], field)
        if field in ("compliance", "damping"):  # fitted as logarithms
            moved: dict[str, Any] = {field: float(now * np.exp(value))}
        else:
            moved = {field: float(now + value)}
        out[index] = replace(out[index], **moved)
    return tuple(out)


def _gradient(found: JointFit, block: int, place: Array) -> Array:
    """Gradient of a block's frequency over the parameters, shape (places, parameters), Hz."""
    mode = found.modes[block]
    f = mode_frequency(mode, place)
    relative = 1 + mode.slope * place + mode.curve * place**2 + local_compliance(mode, place)
    own = {"compliance": -f / 2, "slope": -f / 2 * place / relative, "curve": -f / 2 * place**2 / relative}
    out = np.zeros((len(place), len(found.parameters)))
    for k, (field, index) in enumerate(found.parameters):
        if index == block and field in own:
            out[:, k] = own[field]
        elif field.startswith(LOCAL):
            hat = np.zeros(len(mode.places))
            hat[int(field.removeprefix(LOCAL))] = 1.0
            out[:, k] = -f / 2 * np.interp(place, mode.places, hat) / relative
    return out


def cell_deviations(found: JointFit, block: int) -> tuple[Array, Array]:
    """Deviation of each cell's own data from the curve, and its standard deviation, Hz.

    One step of a fit in which only this cell's frequency is free. The standard deviation is that of noise,
    inflated by the scatter of all cells.
    """
    parameter = found.parameters.index(("compliance", block))
    column, residual = found.jacobian[block][:, parameter], found.residual[block]
    b = found.blocks[block]
    deviation, spread = np.zeros(len(b.rows)), np.zeros(len(b.rows))
    for i, (rows, (start, stop)) in enumerate(zip(b.rows, b.windows.spans, strict=True)):
        weight = max(float(column[rows] @ column[rows]), 1e-300)
        f = float(np.mean(mode_frequency(found.modes[block], b.windows.place[start:stop])))
        noise = float(np.mean(residual[rows] ** 2)) * SAMPLES_PER_INDEPENDENT
        deviation[i] = -f / 2 * float(column[rows] @ residual[rows]) / weight
        spread[i] = f / 2 * np.sqrt(noise / weight)
    inflation = float(np.median(np.abs(deviation) / np.maximum(spread, 1e-300))) * _MEDIAN
    return deviation, spread * max(1.0, inflation)


def nut_loads(found: JointFit) -> tuple[Array, Array]:
    """Highest load on the nut over its preload in every cell, and the nut's share of the compliance there."""
    w, mode = found.blocks[0].windows, found.modes[0]
    loads, shares = np.zeros(len(w.cells)), np.zeros(len(w.cells))
    if not mode.load > 0:
        return loads, shares
    for i, (start, stop) in enumerate(w.spans):
        x = w.stops[i]
        local = float(local_compliance(mode, np.array([x]))[0])
        nut = max(mode.nut_share + local, _LEAST_NUT * mode.nut_share)
        relative = 1 + mode.slope * x + mode.curve * x**2 + local
        peak = float(np.abs(w.force[start:stop][w.from_rest[start:stop]]).max()) + mode.friction
        loads[i] = mode.load * (nut / mode.nut_share) ** 3 * peak
        shares[i] = min(nut / max(relative, 0.1), _MOST_SHARE)
    return loads, shares


def sheet_weight(found: JointFit, prior_weight: float) -> float:
    """Part of the information about the nut's load that comes from the data sheet's prior, 0 to 1."""
    if ("load", None) not in found.parameters:
        return 0.0
    at = found.parameters.index(("load", None))
    return float(min(max(prior_weight * np.linalg.pinv(found.hessian)[at, at], 0.0), 1.0))


def mass_over_preload(found: JointFit, prior_weight: float, expected: float) -> Quantity | None:
    """Moving mass over preload as the run determines it, with the prior of the data sheet removed.

    Parameters
    ----------
    found : JointFit
        With the load among its parameters.
    prior_weight : float
        Weight of the prior in the fit.
    expected : float
        The data sheet's value, kg/N.

    Returns
    -------
    Quantity or None
        kg/N; None if the run determines it less well than the tolerances of a data sheet. A test with two
        accelerations determines it best.
    """
    if ("load", None) not in found.parameters or not expected > 0:
        return None
    at = found.parameters.index(("load", None))
    information = 1 / float(np.linalg.pinv(found.hessian)[at, at])
    own = information - prior_weight
    if not own > _LEAST_OWN * information:
        return None
    spread = math.sqrt(variance_inflation(found, at) / own)
    if spread > _MOST_DEVIATION:
        return None
    fitted = math.log(found.modes[0].load)
    value = math.exp(fitted + prior_weight / own * (fitted - math.log(expected)))
    return Quantity(value, value * math.hypot(spread, _LAW), "kg/N")
