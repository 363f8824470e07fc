"""Covariance of the fitted curve along the axis, and the deviation of each cell from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.quantity import Quantity
from ballscrew.modal.joint.blocks import ROTOR_FREE, ROTOR_HELD
from ballscrew.modal.joint.fit import SAMPLES_PER_INDEPENDENT, JointFit
from ballscrew.modal.joint.mode import AxialMode, local_compliance, mode_frequency, relative_compliance
from ballscrew.modal.joint.parameters import LOCAL, LOGARITHMIC, Parameter, stop_of
from ballscrew.modal.joint.simulation import LEAST_COMPLIANCE, LEAST_NUT, MOST_SHARE
from ballscrew.modal.run import SOFTENING_SPREAD

_MEDIAN = 1.4826  # standard deviation of a normal variable over the median of its absolute value
# Part of the information of the whole fit that is added to that of a single condition, so that parameters
# which the condition does not determine stay as fitted; and to that of a single response.
_RIDGE = 0.05
_RIDGE_OF_RESPONSE = 0.01
_ROUNDING = 1e-9  # of the largest variance: smaller ones are rounding errors

# Largest standard deviation of ln(mass over preload) by the run alone for which it is reported, as large as
# that by the tolerances of a data sheet.
_MOST_DEVIATION = 0.35
_LEAST_OWN = 0.01  # least part of the information about mass over preload that must come from the run


def _cell_covariance(found: JointFit) -> Array:
    """Covariance of the parameters from the scatter of cells, shape (parameters, parameters).

    A sandwich estimator with cells as clusters: cells are independent, samples and blocks of the same cell
    are not. It contains noise of any colour, and model errors that differ from cell to cell.
    """
    scores = np.asarray(sum(_cell_scores(found, i) for i in range(len(found.blocks))))
    inverse = np.linalg.pinv(found.hessian)
    # Parameters that the data determine: those that priors determine count less.
    parameters = float(np.trace(inverse @ _data_information(found)))
    count = len(scores)
    scatter = scores.T @ scores * (count / max(count - parameters, 1.0))
    return np.asarray(inverse @ scatter @ inverse)


def _data_information(found: JointFit) -> Array:
    """Information of the data, without that of the priors, shape (parameters, parameters)."""
    return np.asarray(sum(jacobian.T @ jacobian for jacobian in found.jacobian))


def _cell_scores(found: JointFit, index: int) -> Array:
    """Score (gradient of the log-likelihood) of each cell of a block, shape (cells, parameters)."""
    jacobian, residual = found.jacobian[index], found.residual[index]
    return np.array([jacobian[rows].T @ residual[rows] for rows in found.blocks[index].rows])


def _condition_covariance(found: JointFit) -> Array:
    """Covariance of the parameters from the scatter of conditions, shape (parameters, parameters).

    Errors by the window, the motion and friction are common to all cells of a condition, so the scatter of
    cells does not contain them. From the data of each condition alone, one step of the fit changes the
    parameters; the covariance is that of the mean of these steps, and 0 if there is a single condition.
    """
    conditions = sorted({cell.condition for cell in found.blocks[0].windows.cells})
    if len(conditions) < 2:
        return np.zeros_like(found.hessian)
    steps = [_condition_step(found, condition) for condition in conditions]
    return np.asarray(np.cov(steps, rowvar=False) / len(steps))


def _condition_step(found: JointFit, condition: str) -> Array:
    """Step of the fit by the cells of a single condition, shape (parameters,)."""
    hessian = np.zeros_like(found.hessian)
    score = np.zeros(len(hessian))
    for b, jacobian, residual in zip(found.blocks, found.jacobian, found.residual, strict=True):
        for rows, cell in zip(b.rows, b.windows.cells, strict=True):
            if cell.condition == condition:
                hessian += jacobian[rows].T @ jacobian[rows]
                score += jacobian[rows].T @ residual[rows]
    return np.asarray(np.linalg.pinv(hessian + _RIDGE * found.hessian) @ score)


def response_difference(found: JointFit) -> tuple[Array, Array] | None:
    """Compare the frequencies by the motor's response to the torque and by the nut's.

    Each is one step from the fit of both, by the data of one response alone. Errors common to both cancel in
    the difference, so its standard deviation is computed from the scatter of the difference between cells,
    or between conditions if that is larger.

    Parameters
    ----------
    found : JointFit
        The fit of both responses.

    Returns
    -------
    tuple of ndarray, shape (cells,), or None
        Frequency by the motor's response less that by the nut's at the stop of each cell, and its standard
        deviation, Hz; None if the fit does not contain both responses.
    """
    names = [b.name for b in found.blocks]
    if "torque-nut" not in names or "torque-motor" not in names:
        return None
    windows = found.blocks[0].windows
    gradient = _frequency_gradient(found, ROTOR_FREE, windows.stops)
    step, noise = _step_of_block(found, names.index("torque-motor"))
    nut_step, nut_noise = _step_of_block(found, names.index("torque-nut"))
    by_cell = (noise - nut_noise) @ gradient.T
    conditions = np.array([cell.condition for cell in windows.cells])
    by_condition = np.array([by_cell[conditions == name].sum(axis=0) for name in np.unique(conditions)])
    variance = _variance_of_sum(by_cell)
    if len(by_condition) > 1:
        variance = np.maximum(variance, _variance_of_sum(by_condition))
    return gradient @ (step - nut_step), np.sqrt(variance)


def _step_of_block(found: JointFit, block: int) -> tuple[Array, Array]:
    """Step of the fit by a single block, and the contribution of each cell's noise to it.

    Shapes (parameters,) and (cells, parameters).
    """
    jacobian, residual = found.jacobian[block], found.residual[block]
    of_priors = found.hessian - _data_information(found)
    inverse = np.linalg.pinv(jacobian.T @ jacobian + of_priors + _RIDGE_OF_RESPONSE * found.hessian)
    step = inverse @ (jacobian.T @ residual)
    noise = residual - jacobian @ step
    scores = np.array([jacobian[rows].T @ noise[rows] for rows in found.blocks[block].rows])
    return step, scores @ inverse


def _variance_of_sum(parts: Array) -> Array:
    """Variance of the sum of two or more independent parts, along the first axis, by their scatter."""
    return np.asarray(len(parts) * np.var(parts, axis=0, ddof=1))


def variance_inflation(found: JointFit, parameter: int) -> float:
    """Variance of a parameter by the scatter of cells or of conditions, over that for white residuals.

    The larger of the two, at least 1: the variance according to a fit that takes its residuals for white
    noise, sample by sample, is too small by this factor. ``parameter`` is the index among those of the fit.
    """
    found = replace(found, hessian=np.asarray(sum(j.T @ j for j in found.jacobian)))
    white = float(np.linalg.pinv(found.hessian)[parameter, parameter])
    by_cells = float(_cell_covariance(found)[parameter, parameter])
    by_conditions = float(_condition_covariance(found)[parameter, parameter])
    return max(max(by_cells, by_conditions) / max(white, 1e-300), 1.0)


def parameter_deviation(found: JointFit, parameter: int) -> float:
    """Standard deviation of a parameter, in its unit, by the scatter of cells and of conditions."""
    covariance = _cell_covariance(found) + _condition_covariance(found)
    return math.sqrt(float(covariance[parameter, parameter]))


@dataclass(frozen=True, slots=True)
class TiedCurves:
    """Modes after :func:`tie_slopes`, with two covariances of their parameters.

    Parameters
    ----------
    fit : JointFit
        The fit before.
    modes : tuple of AxialMode
        One per block.
    noise, conditions : ndarray, shape (parameters, parameters)
        Covariance by the scatter of cells, and by that of conditions and the shrinkage.
    """

    fit: JointFit
    modes: tuple[AxialMode, ...]
    noise: Array
    conditions: Array

    def curve(self, mode: int, place: Array) -> Array:
        """Frequency (Hz) of the mode ROTOR_FREE or ROTOR_HELD at positions from the middle (m)."""
        return mode_frequency(self.modes[mode], place)

    def effects(self, mode: int, place: Array, part: Literal["noise", "conditions"]) -> Array:
        """Effects of independent causes, each of one standard deviation, on the frequency of a mode.

        Shape (causes, places), Hz. The causes are the eigenvectors of its covariance along the axis.
        """
        covariance = self.conditions
        if part == "noise":
            covariance = self.noise
        gradient = _frequency_gradient(self.fit, mode, place)
        variances, vectors = np.linalg.eigh(gradient @ covariance @ gradient.T)
        good = variances > _ROUNDING * max(float(variances[-1]), 1e-300)
        return np.asarray(vectors[:, good] * np.sqrt(variances[good])).T


def tie_slopes(found: JointFit, shrinkage: Array, deviation: float, reach: float) -> TiedCurves:
    """Tie slope and curvature of the rotor-free and the rotor-held compliance to each other.

    The two frequencies differ by the masses alone, so the ratio of their squares is nearly constant along the
    axis: a slope that one drive determines poorly is improved by that of the other. This is a Kalman update
    with the observation that the two slopes, and then the two curvatures, are equal within a standard
    deviation: ``deviation`` over ``reach``, or over its square.

    Parameters
    ----------
    found : JointFit
        Of one block or more.
    shrinkage : ndarray, shape (parameters, parameters)
        Covariance as of :func:`~ballscrew.modal.joint.local_wear.shrinkage_covariance`.
    deviation : float
        Standard deviation of the relative change of the ratio of the squared frequencies along the axis.
    reach : float
        Length of the axis, m.

    Returns
    -------
    TiedCurves
        Unchanged modes if there is a single block.
    """
    noise, conditions = _cell_covariance(found), _condition_covariance(found) + shrinkage
    modes = found.modes
    parameters = found.parameters
    for power, field in enumerate(("slope", "curve"), start=1):
        if len(modes) < 2 or (field, ROTOR_FREE) not in parameters:
            continue
        contrast = np.zeros(len(parameters))
        contrast[parameters.index((field, ROTOR_FREE))] = 1.0
        contrast[parameters.index((field, ROTOR_HELD))] = -1.0
        allowed = (deviation / reach**power) ** 2  # variance of the observation
        with_contrast = (noise + conditions) @ contrast  # covariances of the parameters with the contrast
        gain = with_contrast / float(contrast @ with_contrast + allowed)
        gain[[index is None for _, index in parameters]] = 0.0  # those common to both modes stay
        difference = getattr(modes[0], field) - getattr(modes[1], field)
        modes = _add_to_parameters(modes, parameters, -gain * difference)
        remaining = np.eye(len(parameters)) - np.outer(gain, contrast)
        noise = remaining @ noise @ remaining.T + allowed * np.outer(gain, gain)
        conditions = remaining @ conditions @ remaining.T
    return TiedCurves(found, modes, noise, conditions)


def _add_to_parameters(
    modes: Sequence[AxialMode], parameters: Sequence[Parameter], change: Array
) -> tuple[AxialMode, ...]:
    """Modes with a change, shape (parameters,), of the parameters that are not common to both modes."""
    out = list(modes)
    for (field, index), value in zip(parameters, change.tolist(), strict=True):
        if index is None:
            continue
        changed = getattr(out[index], field) + value
        if field in LOGARITHMIC:
            changed = getattr(out[index], field) * math.exp(value)
        values: dict[str, Any] = {field: changed}
        out[index] = replace(out[index], **values)
    return tuple(out)


def _frequency_gradient(found: JointFit, mode_index: int, place: Array) -> Array:
    """Derivatives of the frequency (Hz) of a mode by the parameters, shape (places, parameters).

    ``place`` are positions from the middle, m. The frequency is undamped and of the unloaded nut, so those by
    damping and mass over preload are 0.
    """
    mode = found.modes[mode_index]
    f = mode_frequency(mode, place)
    relative = relative_compliance(mode, place)
    by_compliance = -f / 2  # by its logarithm, which is the parameter
    by_slope = -f / 2 * place / relative
    by_curve = -f / 2 * place**2 / relative
    derivatives = {"compliance": by_compliance, "slope": by_slope, "curve": by_curve}
    out = np.zeros((len(place), len(found.parameters)))
    for k, (field, index) in enumerate(found.parameters):
        if index == mode_index and field in derivatives:
            out[:, k] = derivatives[field]
        elif field == "form":
            out[:, k] = mode.form_curve * by_curve
        elif field.startswith(LOCAL):
            unit = np.zeros(len(mode.places))
            unit[stop_of(field)] = 1.0
            out[:, k] = -f / 2 * np.interp(place, mode.places, unit) / relative
    return out


def cell_steps(found: JointFit, parameter: int, blocks: Sequence[int]) -> tuple[Array, Array]:
    """Step of a parameter by the data of each cell alone, and their information about it.

    Parameters
    ----------
    found : JointFit
        The fit.
    parameter : int
        Index of the parameter; all others stay as fitted.
    blocks : sequence of int
        Indices of the blocks whose data are used.

    Returns
    -------
    steps, information : ndarray, shape (cells,)
        In the unit of the parameter; and one over the variance of the step for white residuals.
    """
    score = np.zeros(len(found.blocks[0].windows.cells))
    information = np.zeros_like(score)
    for index in blocks:
        column = found.jacobian[index][:, parameter]
        starts = [rows.start for rows in found.blocks[index].rows]
        score += np.add.reduceat(column * found.residual[index], starts)
        information += np.add.reduceat(column**2, starts)
    return score / np.maximum(information, 1e-300), information


def cell_deviations(found: JointFit, block: int) -> tuple[Array, Array]:
    """Deviation of each cell's own data in a block from the curve, and its standard deviation.

    The deviation is one step of a fit in which only this cell's frequency is free. Its standard deviation is
    computed from the residual of the cell, and multiplied by a factor common to all cells where they scatter
    more than that. Both have the shape (cells,) and the unit Hz.
    """
    # The first two blocks are those of the two modes, in this order.
    parameter = found.parameters.index(("compliance", block))
    steps, information = cell_steps(found, parameter, (block,))
    b, residual = found.blocks[block], found.residual[block]
    f = mode_frequency(found.modes[block], b.windows.stops)
    squares = np.array([np.sum(residual[rows] ** 2) for rows in b.rows])
    noise = SAMPLES_PER_INDEPENDENT * squares / (b.windows.lengths * b.target.shape[1])
    deviation = -f / 2 * steps  # a step is that of ln(compliance)
    spread = f / 2 * np.sqrt(noise / np.maximum(information, 1e-300))
    scatter = float(np.median(np.abs(deviation) / np.maximum(spread, 1e-300))) * _MEDIAN
    return deviation, spread * max(1.0, scatter)


def nut_loads(found: JointFit) -> tuple[Array, Array]:
    """Highest load on the nut over its preload in every cell, and the nut's share of the compliance there.

    Both have the shape (cells,); they are 0 where the mode has no load on the nut.
    """
    w, mode = found.blocks[0].windows, found.modes[0]
    loads, shares = np.zeros(len(w.cells)), np.zeros(len(w.cells))
    if not mode.mass_over_preload > 0:
        return loads, shares
    nuts = np.maximum(mode.nut_share + local_compliance(mode, w.stops), LEAST_NUT * mode.nut_share)
    shares = np.minimum(nuts / np.maximum(relative_compliance(mode, w.stops), LEAST_COMPLIANCE), MOST_SHARE)
    for i, (start, stop) in enumerate(w.spans):
        force = w.force[start:stop][w.from_rest[start:stop]]
        highest, lowest = float(force.max()) + mode.friction, float(force.min()) - mode.friction
        peak = max(abs(highest + mode.weight), abs(lowest + mode.weight))  # m/s²
        # The nut's compliance is proportional to P^(-1/3): local wear is a lower preload there.
        loads[i] = mode.mass_over_preload * (nuts[i] / mode.nut_share) ** 3 * peak
    return loads, shares


def sheet_weight(found: JointFit, prior_weight: float) -> float:
    """Part of the information about ln(mass over preload) that comes from the data sheet's prior, 0 to 1.

    ``prior_weight`` is the information of this prior in the fit: the inverse of its variance there.
    """
    if ("mass_over_preload", None) not in found.parameters:
        return 0.0
    at = found.parameters.index(("mass_over_preload", None))
    return float(min(max(prior_weight * np.linalg.pinv(found.hessian)[at, at], 0.0), 1.0))


def mass_over_preload(found: JointFit, prior_weight: float, expected: float) -> Quantity | None:
    """Moving mass over preload by the run alone: the prior of the data sheet is removed.

    Parameters
    ----------
    found : JointFit
        With mass over preload among its parameters.
    prior_weight : float
        Information of the prior in the fit, as of :func:`sheet_weight`.
    expected : float
        Median of the prior, kg/N.

    Returns
    -------
    Quantity or None
        kg/N; None if it is less certain than by the tolerances of a data sheet. A test with two accelerations
        determines it best.
    """
    if ("mass_over_preload", None) not in found.parameters or not expected > 0:
        return None
    at = found.parameters.index(("mass_over_preload", None))
    information = 1 / float(np.linalg.pinv(found.hessian)[at, at])
    information_of_run = information - prior_weight
    if not information_of_run > _LEAST_OWN * information:
        return None
    spread = math.sqrt(variance_inflation(found, at) / information_of_run)
    if spread > _MOST_DEVIATION:
        return None
    # The fitted logarithm is the mean of those of run and prior, weighted with their information.
    fitted = math.log(found.modes[0].mass_over_preload)
    value = math.exp(fitted + prior_weight / information_of_run * (fitted - math.log(expected)))
    return Quantity(value, value * math.hypot(spread, SOFTENING_SPREAD), "kg/N")
