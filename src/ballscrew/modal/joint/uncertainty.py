"""Covariance of the fitted curve along the axis, and the deviation of each cell from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.quantity import Quantity
from ballscrew.modal.joint.blocks import ROTOR_FREE, ROTOR_HELD
from ballscrew.modal.joint.fit import SAMPLES_PER_INDEPENDENT, JointFit
from ballscrew.modal.joint.mode import AxialMode, local_compliance, mode_frequency, relative_compliance
from ballscrew.modal.joint.parameters import LOCAL, LOGARITHMIC, Parameter, stop_of
from ballscrew.modal.joint.simulation import LEAST_COMPLIANCE, LEAST_NUT, MOST_SHARE
from ballscrew.modal.run import SOFTENING_SPREAD

_MEDIAN = 1.4826  # standard deviation of a normal variable over the median of its absolute value
# Part of the information of the whole fit that is added to that of a single condition or of a single
# response: parameters that these do not determine then stay as fitted.
_RIDGE = 0.05
_RIDGE_OF_RESPONSE = 0.01
_ROUNDING = 1e-9  # over the largest variance: smaller ones are rounding errors

# Largest standard deviation of ln(mass over preload) by the run alone for which it is reported: that by the
# tolerances of a data sheet.
_MOST_DEVIATION = 0.35
_LEAST_OWN = 0.01  # least part of the information about mass over preload that must come from the run


def _cell_covariance(fit: JointFit) -> Array:
    """Covariance of the parameters from the scatter of cells, shape (parameters, parameters).

    This is a sandwich estimator with cells as clusters: cells are independent, samples and blocks of the same
    cell are not. It contains noise of any spectrum, and model errors that differ from cell to cell.
    """
    scores = np.asarray(sum(_cell_scores(fit, i) for i in range(len(fit.blocks))))
    inverse = np.linalg.pinv(fit.hessian)
    # Effective number of parameters: a parameter counts by the part of its information that is from the data.
    parameters = float(np.trace(inverse @ fit.information))
    count = len(scores)
    scatter = scores.T @ scores * (count / max(count - parameters, 1.0))
    return np.asarray(inverse @ scatter @ inverse)


def _cell_scores(fit: JointFit, index: int) -> Array:
    """Score (gradient of the log-likelihood) of each cell of a block, shape (cells, parameters)."""
    jacobian, residual = fit.jacobian[index], fit.residual[index]
    return np.array([jacobian[rows].T @ residual[rows] for rows in fit.blocks[index].rows])


def _condition_covariance(fit: JointFit) -> Array:
    """Covariance of the parameters from the scatter of conditions, shape (parameters, parameters).

    Errors by the window, the motion and friction are common to all cells of a condition, so the scatter of
    cells does not contain them. The data of each condition alone give one step of the fit; the covariance is
    that of the mean of these steps, and 0 if there is a single condition.
    """
    conditions = sorted({cell.condition for cell in fit.blocks[0].windows.cells})
    if len(conditions) < 2:
        return np.zeros_like(fit.hessian)
    steps = [_condition_step(fit, condition) for condition in conditions]
    return np.asarray(np.cov(steps, rowvar=False) / len(steps))


def _condition_step(fit: JointFit, condition: str) -> Array:
    """Step of the fit by the data of a single condition, shape (parameters,)."""
    hessian = np.zeros_like(fit.hessian)
    score = np.zeros(len(hessian))
    for b, jacobian, residual in zip(fit.blocks, fit.jacobian, fit.residual, strict=True):
        for rows, cell in zip(b.rows, b.windows.cells, strict=True):
            if cell.condition == condition:
                hessian += jacobian[rows].T @ jacobian[rows]
                score += jacobian[rows].T @ residual[rows]
    return np.asarray(np.linalg.pinv(hessian + _RIDGE * fit.hessian) @ score)


def response_difference(fit: JointFit) -> tuple[Array, Array] | None:
    """Compare the frequencies by the motor's response to the torque and by the nut's.

    Each is that of one step from the fit of both, by the data of one response alone. Errors common to both
    cancel in the difference, so its standard deviation is computed from the scatter of the difference between
    cells, or between conditions if that is larger.

    Parameters
    ----------
    fit : JointFit
        Fit of both responses.

    Returns
    -------
    tuple of ndarray, shape (cells,), or None
        Frequency by the motor's response less that by the nut's at the stop of each cell, and its standard
        deviation, Hz; None if the fit does not contain both responses.
    """
    names = [b.name for b in fit.blocks]
    if "torque-nut" not in names or "torque-motor" not in names:
        return None
    windows = fit.blocks[0].windows
    gradient = _frequency_gradient(fit, ROTOR_FREE, windows.stops)
    motor_step, motor_noise = _step_of_block(fit, names.index("torque-motor"))
    nut_step, nut_noise = _step_of_block(fit, names.index("torque-nut"))
    by_cell = (motor_noise - nut_noise) @ gradient.T  # contribution of each cell to the difference, Hz
    conditions = np.array([cell.condition for cell in windows.cells])
    by_condition = np.array([by_cell[conditions == name].sum(axis=0) for name in np.unique(conditions)])
    variance = _variance_of_sum(by_cell)
    if len(by_condition) > 1:
        variance = np.maximum(variance, _variance_of_sum(by_condition))
    return gradient @ (motor_step - nut_step), np.sqrt(variance)


def _step_of_block(fit: JointFit, block: int) -> tuple[Array, Array]:
    """Step of the fit by a single block, and the contribution of each cell's noise to it.

    Shapes (parameters,) and (cells, parameters).
    """
    jacobian, residual = fit.jacobian[block], fit.residual[block]
    prior_information = fit.hessian - fit.information
    information = jacobian.T @ jacobian + prior_information + _RIDGE_OF_RESPONSE * fit.hessian
    inverse = np.linalg.pinv(information)
    step = inverse @ (jacobian.T @ residual)
    noise = residual - jacobian @ step
    scores = np.array([jacobian[rows].T @ noise[rows] for rows in fit.blocks[block].rows])
    return step, scores @ inverse


def _variance_of_sum(parts: Array) -> Array:
    """Variance of the sum, along the first axis, of two or more independent parts, by their scatter."""
    return np.asarray(len(parts) * np.var(parts, axis=0, ddof=1))


def variance_inflation(fit: JointFit, parameter: int) -> float:
    """Variance of a parameter by the scatter of cells or of conditions, over that for white residuals.

    Parameters
    ----------
    fit : JointFit
        The fit; its priors are not used, and the guide's part is not varied.
    parameter : int
        Index of the parameter.

    Returns
    -------
    float
        The larger of the two ratios, at least 1. A fit that takes its residuals for white noise, sample by
        sample, gives a variance that is too small by this factor.
    """
    information, jacobian = fit.information.copy(), fit.jacobian
    if ("guide_part", None) in fit.parameters:
        # It has almost the effect of the load. Without its prior, neither would be determined.
        index = fit.parameters.index(("guide_part", None))
        information[index], information[:, index] = 0.0, 0.0
        varied = np.arange(len(fit.parameters)) != index
        jacobian = tuple(rows * varied for rows in jacobian)
    fit = replace(fit, jacobian=jacobian, information=information, hessian=information)
    white = float(np.linalg.pinv(fit.hessian)[parameter, parameter])
    by_cells = float(_cell_covariance(fit)[parameter, parameter])
    by_conditions = float(_condition_covariance(fit)[parameter, parameter])
    return max(max(by_cells, by_conditions) / max(white, 1e-300), 1.0)


def parameter_deviation(fit: JointFit, parameter: int) -> float:
    """Standard deviation of a parameter, given by its index, by the scatter of cells and of conditions.

    In the unit of the parameter; without unit for a logarithmic field.
    """
    covariance = _cell_covariance(fit) + _condition_covariance(fit)
    return math.sqrt(float(covariance[parameter, parameter]))


@dataclass(frozen=True, slots=True)
class TiedCurves:
    """Modes after :func:`tie_slopes`, with two covariances of their parameters.

    Parameters
    ----------
    fit : JointFit
        The fit before :func:`tie_slopes`.
    modes : tuple of AxialMode
        Modes after it, one per block.
    noise : ndarray, shape (parameters, parameters)
        Covariance by the scatter of cells.
    conditions : ndarray, shape (parameters, parameters)
        Covariance by the scatter of conditions and by the shrinkage.
    """

    fit: JointFit
    modes: tuple[AxialMode, ...]
    noise: Array
    conditions: Array

    def curve(self, mode: int, centred_position: Array) -> Array:
        """Frequency (Hz) of the mode ROTOR_FREE or ROTOR_HELD at positions from the middle (m)."""
        return mode_frequency(self.modes[mode], centred_position)

    def effects(self, mode: int, centred_position: Array, part: Literal["noise", "conditions"]) -> Array:
        """Effects of independent causes, each of one standard deviation, on the frequency of a mode.

        Shape (causes, positions), Hz, at positions from the middle (m). The causes are the eigenvectors of
        the frequency's covariance along the axis by ``part``.
        """
        covariance = self.conditions
        if part == "noise":
            covariance = self.noise
        gradient = _frequency_gradient(self.fit, mode, centred_position)
        variances, vectors = np.linalg.eigh(gradient @ covariance @ gradient.T)
        counted = variances > _ROUNDING * max(float(variances[-1]), 1e-300)
        return np.asarray(vectors[:, counted] * np.sqrt(variances[counted])).T


def tie_slopes(fit: JointFit, shrinkage: Array, deviation: float, length: float) -> TiedCurves:
    """Tie slope and curvature of the rotor-free and the rotor-held compliance to each other.

    The two frequencies differ by the masses alone, so the ratio of their squares is nearly constant along the
    axis: a slope that one drive determines poorly is improved by that of the other. This is a Kalman update
    with the observation that the two slopes, and then the two curvatures, are equal within a standard
    deviation: ``deviation`` over ``length``, or over its square.

    Parameters
    ----------
    fit : JointFit
        Fit of one block or more.
    shrinkage : ndarray, shape (parameters, parameters)
        Result of :func:`~ballscrew.modal.joint.local_wear.shrinkage_covariance`.
    deviation : float
        Standard deviation of the relative change of the ratio of the squared frequencies along the axis.
    length : float
        Length of the axis between the first and the last stop, m.

    Returns
    -------
    TiedCurves
        Unchanged modes if there is a single block.
    """
    noise, conditions = _cell_covariance(fit), _condition_covariance(fit) + shrinkage
    modes = fit.modes
    parameters = fit.parameters
    for power, field in enumerate(("slope", "curve"), start=1):
        if len(modes) < 2 or (field, ROTOR_FREE) not in parameters:
            continue
        contrast = np.zeros(len(parameters))
        contrast[parameters.index((field, ROTOR_FREE))] = 1.0
        contrast[parameters.index((field, ROTOR_HELD))] = -1.0
        allowed = (deviation / length**power) ** 2  # variance of the observation
        with_contrast = (noise + conditions) @ contrast  # covariances of the parameters with the contrast
        gain = with_contrast / float(contrast @ with_contrast + allowed)
        # Parameters that are common to both modes stay as fitted: an update of them moves the frequencies of
        # ten random axes by 0.012 of their uncertainty at most. The covariances below are valid for any gain
        # (Joseph's form); the variance of the observation is counted in one of them.
        gain[[index is None for _, index in parameters]] = 0.0
        difference = getattr(modes[0], field) - getattr(modes[1], field)
        modes = _add_to_parameters(modes, parameters, -gain * difference)
        remaining = np.eye(len(parameters)) - np.outer(gain, contrast)
        noise = remaining @ noise @ remaining.T + allowed * np.outer(gain, gain)
        conditions = remaining @ conditions @ remaining.T
    return TiedCurves(fit, modes, noise, conditions)


def _add_to_parameters(
    modes: Sequence[AxialMode], parameters: Sequence[Parameter], change: Array
) -> tuple[AxialMode, ...]:
    """Modes with a change, shape (parameters,), of those parameters that are not common to both modes."""
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


def _frequency_gradient(fit: JointFit, mode_index: int, centred_position: Array) -> Array:
    """Derivatives of a mode's frequency (Hz) with respect to the parameters, shape (positions, parameters).

    ``centred_position`` are positions from the middle, m. The frequency is undamped and that of the unloaded
    nut, so the derivatives by damping, mass over preload and the guide's part are 0.
    """
    mode = fit.modes[mode_index]
    f = mode_frequency(mode, centred_position)
    relative = relative_compliance(mode, centred_position)
    by_compliance = -f / 2  # by ln(compliance), which is the parameter
    by_slope = -f / 2 * centred_position / relative
    by_curve = -f / 2 * centred_position**2 / relative
    derivatives = {"compliance": by_compliance, "slope": by_slope, "curve": by_curve}
    out = np.zeros((len(centred_position), len(fit.parameters)))
    for k, (field, index) in enumerate(fit.parameters):
        if index == mode_index and field in derivatives:
            out[:, k] = derivatives[field]
        elif field == "form":
            out[:, k] = mode.form_curve * by_curve
        elif field.startswith(LOCAL):
            unit = np.zeros(len(mode.stops))
            unit[stop_of(field)] = 1.0
            out[:, k] = -f / 2 * np.interp(centred_position, mode.stops, unit) / relative
    return out


def cell_steps(fit: JointFit, parameters: NDArray[np.intp], blocks: Sequence[int]) -> tuple[Array, Array]:
    """Step of one parameter of each cell by its data alone, and the information of these data about it.

    Parameters
    ----------
    fit : JointFit
        The fit.
    parameters : ndarray of int, shape (cells,)
        Index of the parameter of each cell; all others stay as fitted.
    blocks : sequence of int
        Indices of the blocks whose data are used.

    Returns
    -------
    steps : ndarray, shape (cells,)
        In the unit of the parameter.
    information : ndarray, shape (cells,)
        One over the variance of each step, if residuals were white.
    """
    score, information = np.zeros(len(parameters)), np.zeros(len(parameters))
    for index in blocks:
        jacobian, residual = fit.jacobian[index], fit.residual[index]
        for cell, rows in enumerate(fit.blocks[index].rows):
            derivative = jacobian[rows, parameters[cell]]
            score[cell] += derivative @ residual[rows]
            information[cell] += derivative @ derivative
    return score / np.maximum(information, 1e-300), information


def cell_deviations(fit: JointFit, block: int) -> tuple[Array, Array]:
    """Deviation of the frequency by each cell's own data from the fitted curve along the axis.

    The deviation is one step of a fit in which only this cell's frequency is free.

    Parameters
    ----------
    fit : JointFit
        The fit.
    block : int
        Index of the block whose data are used: 0 or 1, which is also the index of its mode.

    Returns
    -------
    deviation, uncertainty : ndarray, shape (cells,)
        Hz. The standard uncertainty is computed from the residual of the cell. If the deviations scatter more
        than that, it is multiplied by a factor common to all cells.
    """
    # The first block is that of the mode with the rotor free, and the second that with the rotor held.
    parameter = fit.parameters.index(("compliance", block))
    parameters = np.full(len(fit.blocks[block].windows.cells), parameter)
    steps, information = cell_steps(fit, parameters, (block,))
    b, residual = fit.blocks[block], fit.residual[block]
    f = mode_frequency(fit.modes[block], b.windows.stops)
    squares = np.array([np.sum(residual[rows] ** 2) for rows in b.rows])
    noise = SAMPLES_PER_INDEPENDENT * squares / (b.windows.lengths * b.target.shape[1])
    deviation = -f / 2 * steps  # the steps are those of ln(compliance)
    uncertainty = f / 2 * np.sqrt(noise / np.maximum(information, 1e-300))
    scatter = float(np.median(np.abs(deviation) / np.maximum(uncertainty, 1e-300))) * _MEDIAN
    return deviation, uncertainty * max(1.0, scatter)


def nut_loads(fit: JointFit) -> tuple[Array, Array]:
    """Highest load on the nut over its preload in every cell, and the nut's share of the compliance there.

    The load is that of the table's motion as a rigid body, without vibration. Both have the shape (cells,);
    they are 0 if the mode has no mass over preload.
    """
    w, mode = fit.blocks[0].windows, fit.modes[0]
    loads, shares = np.zeros(len(w.cells)), np.zeros(len(w.cells))
    if not mode.mass_over_preload > 0:
        return loads, shares
    nuts = np.maximum(mode.nut_share + local_compliance(mode, w.stops), LEAST_NUT * mode.nut_share)
    shares = np.minimum(nuts / np.maximum(relative_compliance(mode, w.stops), LEAST_COMPLIANCE), MOST_SHARE)
    along = w.force - w.drag + mode.guide_part * mode.viscous * w.speed
    for i, (start, stop) in enumerate(w.spans):
        force = along[start:stop][w.from_rest[start:stop]]  # m/s²
        highest, lowest = float(force.max()) + mode.friction, float(force.min()) - mode.friction
        peak = max(abs(highest + mode.weight), abs(lowest + mode.weight))  # m/s²
        # Local wear is a lower preload there: the nut's compliance is proportional to P^(-1/3).
        loads[i] = mode.mass_over_preload * (nuts[i] / mode.nut_share) ** 3 * peak
    return loads, shares


def sheet_weight(fit: JointFit, prior_information: float) -> float:
    """Part of the information about ln(mass over preload) that comes from the data sheet's prior, 0 to 1.

    ``prior_information`` is that of this prior in the fit: the inverse of its variance there.
    """
    if ("mass_over_preload", None) not in fit.parameters:
        return 0.0
    at = fit.parameters.index(("mass_over_preload", None))
    return float(min(max(prior_information * np.linalg.pinv(fit.hessian)[at, at], 0.0), 1.0))


def mass_over_preload(fit: JointFit, prior_information: float, expected: float) -> Quantity | None:
    """Estimate the moving mass over the preload by the run alone, without the prior of the data sheet.

    Parameters
    ----------
    fit : JointFit
        The fit.
    prior_information : float
        Information of the prior in the fit, as for :func:`sheet_weight`.
    expected : float
        Median of the prior, kg/N.

    Returns
    -------
    Quantity or None
        kg/N; None if it was not fitted, if less than 1 % of the information is the run's, or if its
        uncertainty is larger than that by the tolerances of a data sheet. A test with two accelerations
        determines it best.
    """
    if ("mass_over_preload", None) not in fit.parameters or not expected > 0:
        return None
    at = fit.parameters.index(("mass_over_preload", None))
    information = 1 / float(np.linalg.pinv(fit.hessian)[at, at])
    information_of_run = information - prior_information
    if not information_of_run > _LEAST_OWN * information:
        return None
    spread = math.sqrt(variance_inflation(fit, at) / information_of_run)
    if spread > _MOST_DEVIATION:
        return None
    # The fitted logarithm is the mean of those by the run and by the prior, weighted by their information.
    fitted = math.log(fit.modes[0].mass_over_preload)
    value = math.exp(fitted + prior_information / information_of_run * (fitted - math.log(expected)))
    # The law of the softening is uncertain too, by SOFTENING_SPREAD; no scatter of a run shows that.
    return Quantity(value, value * math.hypot(spread, SOFTENING_SPREAD), "kg/N")
