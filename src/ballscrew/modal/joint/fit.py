"""Fit of the modes to all blocks of a run, by Levenberg-Marquardt.

Only the parameters of the modes are iterated; the weights of each block's columns are solved for at every
step, see :mod:`ballscrew.modal.joint.blocks`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.blocks import (
    ROTOR_FREE,
    Block,
    Projection,
    project,
    raw_columns_of,
    remaining_power,
)
from ballscrew.modal.joint.jacobian import model_jacobian, normal_equations
from ballscrew.modal.joint.mode import AxialMode
from ballscrew.modal.joint.parameters import (
    MODE_FIELDS,
    Modes,
    Parameter,
    limits_of,
    modes_with,
    read_parameter,
)

CLEAR_REDUCTION = math.log(0.8)
"""Difference of :func:`log_residual` (negative) from which on another fit is clearly better.

The product of the rms residuals of all blocks is then 20 % lower."""

SAMPLES_PER_INDEPENDENT = 5.0
"""Number of samples that contain as much information as an independent one.

Neighbouring samples are correlated, since the residual is limited to a band."""

# Damping of the Levenberg-Marquardt iteration, over the diagonal of the Hessian: usual values, which affect
# how fast the iteration converges.
_FIRST_DAMPING = 1e-3  # of the first step
_LEAST_DAMPING = 1e-8
_LEAST_RAISED = 1e-4  # least damping after a step that failed
_DAMPING_FACTOR = 8  # by which a step that succeeds lowers the damping, and a step that fails raises it
_LEAST_DIAGONAL = 1e-12  # added to the diagonal: a parameter without effect has a diagonal element of 0
_TRIALS = 7  # largest number of trials of a step, with increasing damping
_LONGEST_STEP = 0.4  # largest change of a parameter in a step, in its unit (1 for a logarithm)
_LEAST_RMS = 1e-100  # m/s², of a residual: keeps a weight, one over the rms, and its square finite


@dataclass(frozen=True, slots=True)
class Prior:
    """Normal prior distribution of a weighted sum of parameters that have the same value in both modes.

    Parameters
    ----------
    fields : tuple of (field, weight)
        Terms of the sum; a logarithmic field enters it by its logarithm.
    value, deviation : float
        Expected value and standard deviation of the sum.
    """

    fields: tuple[tuple[str, float], ...]
    value: float
    deviation: float


@dataclass(frozen=True, slots=True)
class JointFit:
    """Final state of a fit.

    The weight of a block is one over the rms of its whitened residual.

    Parameters
    ----------
    modes : tuple of AxialMode
        One per block.
    blocks : tuple of Block
        The blocks that were fitted.
    projections : tuple of Projection
        The linear part of each block.
    parameters : tuple of (field, mode index or None)
        The fitted parameters.
    jacobian : tuple of ndarray, shape (n * responses, parameters)
        Derivatives of each block's whitened model, less their projection on its columns, times its weight.
    residual : tuple of ndarray, shape (n * responses,)
        Whitened residual of each block times its weight.
    information : ndarray, shape (parameters, parameters)
        Part of ``hessian`` by the data, without the priors.
    hessian : ndarray, shape (parameters, parameters)
        Hessian of half the cost, in the Gauss-Newton approximation, with the priors. The cost is the sum of
        the squares of ``residual`` and of the deviations from the priors, in standard deviations times the
        root of SAMPLES_PER_INDEPENDENT.
    """

    modes: Modes
    blocks: tuple[Block, ...]
    projections: tuple[Projection, ...]
    parameters: tuple[Parameter, ...]
    jacobian: tuple[Array, ...]
    residual: tuple[Array, ...]
    information: Array
    hessian: Array

    @property
    def log_residual(self) -> float:
        """Result of :func:`log_residual`."""
        return log_residual(self.projections)


def fit_blocks(
    blocks: Sequence[Block],
    modes: Sequence[AxialMode],
    fields: Sequence[str],
    priors: Sequence[Prior] = (),
    most_steps: int = 12,
    least_gain: float = 2e-5,
) -> JointFit:
    """Fit all blocks together.

    Parameters
    ----------
    blocks : sequence of Block
        Drives and responses.
    modes : sequence of AxialMode
        Initial modes. That of a block is the element ROTOR_FREE (0) or ROTOR_HELD (1).
    fields : sequence of str
        Fields of AxialMode to fit. Those of MODE_FIELDS have a value for each mode, the others the same value
        for both.
    priors : sequence of Prior
        Priors of parameters that have the same value in both modes.
    most_steps : int
        Upper limit of the iterations.
    least_gain : float
        The iteration ends when a step lowers the cost by less than this fraction.

    Returns
    -------
    JointFit
        Its state at the end of the iteration.
    """
    problem = _Problem.of(blocks, fields, priors)
    final = problem.minimise(modes, most_steps, least_gain)
    return problem.linearise(final)


def fit_modes(
    blocks: Sequence[Block],
    modes: Sequence[AxialMode],
    fields: Sequence[str],
    priors: Sequence[Prior] = (),
    most_steps: int = 12,
    least_gain: float = 2e-5,
) -> tuple[Modes, float]:
    """Fit all blocks together, but omit the Jacobian at the end, which takes time.

    Parameters
    ----------
    blocks, modes, fields, priors, most_steps, least_gain
        As for :func:`fit_blocks`.

    Returns
    -------
    modes : tuple of AxialMode
        One per block.
    log_residual : float
        Result of :func:`log_residual`.
    """
    final = _Problem.of(blocks, fields, priors).minimise(modes, most_steps, least_gain)
    return final.modes, log_residual(final.projections)


def log_residual(projections: Sequence[Projection]) -> float:
    """Sum over all blocks: logarithm of the rms of the whitened residual over that of the responses."""
    return sum(math.log(max(projection.unexplained, 1e-300)) / 2 for projection in projections)


@dataclass(frozen=True, slots=True)
class _State:
    """State of the iteration.

    Parameters
    ----------
    modes : tuple of AxialMode
        One per block.
    values : ndarray, shape (parameters,)
        Values of the parameters in them.
    projections : tuple of Projection
        The linear part of each block.
    steps : int
        Number of steps so far.
    """

    modes: Modes
    values: Array
    projections: tuple[Projection, ...]
    steps: int


@dataclass(frozen=True, slots=True)
class _Problem:
    """Blocks, parameters and priors of a fit.

    Parameters
    ----------
    blocks : tuple of Block
        Drives and responses.
    parameters : tuple of (field, mode index or None)
        The fitted parameters.
    prior_rows, prior_values : ndarray, shape (priors, parameters) and (priors,)
        A row of ``prior_rows @ values - prior_values`` is the deviation from a prior, in its standard
        deviations times the root of SAMPLES_PER_INDEPENDENT, see :meth:`of`.
    """

    blocks: tuple[Block, ...]
    parameters: tuple[Parameter, ...]
    prior_rows: Array
    prior_values: Array

    @classmethod
    def of(cls, blocks: Sequence[Block], fields: Sequence[str], priors: Sequence[Prior]) -> _Problem:
        """Problem with the parameters of :func:`fit_blocks`.

        In the cost every sample counts as if it were independent, so the information of the data is too large
        by the factor SAMPLES_PER_INDEPENDENT. The information of the priors is multiplied by the same factor.
        """
        parameters: list[Parameter] = [(f, None) for f in fields if f not in MODE_FIELDS]
        for index in sorted({b.mode_index for b in blocks}):
            parameters += [(f, index) for f in fields if f in MODE_FIELDS]
        rows = np.zeros((len(priors), len(parameters)))
        values = np.zeros(len(priors))
        for row, prior in enumerate(priors):
            weight = math.sqrt(SAMPLES_PER_INDEPENDENT) / prior.deviation
            for field, factor in prior.fields:
                rows[row, parameters.index((field, None))] = factor
            rows[row] *= weight
            values[row] = prior.value * weight
        return cls(tuple(blocks), tuple(parameters), rows, values)

    def read(self, modes: Modes) -> Array:
        """Values of the parameters, shape (parameters,), in modes by their index."""
        values = np.empty(len(self.parameters))
        for k, (field, index) in enumerate(self.parameters):
            if index is None:
                index = ROTOR_FREE  # both modes have the same value
            values[k] = read_parameter(modes[index], field)
        return values

    def minimise(self, modes: Sequence[AxialMode], most_steps: int, least_gain: float) -> _State:
        """Minimise the cost, from initial modes by their index; the state at the end of the iteration."""
        of_blocks = tuple(modes[b.mode_index] for b in self.blocks)
        values = np.clip(self.read(of_blocks), *limits_of(self.parameters))
        first = modes_with(of_blocks, self.blocks, self.parameters, values)
        state = self._solve(first, values, raw_columns_of(self.blocks, first), 0)
        damping = _FIRST_DAMPING
        while state.steps < most_steps:
            step = self._damped_step(state, damping)
            if step is None:
                break
            values, raw, damping, gain = step
            changed = modes_with(state.modes, self.blocks, self.parameters, values)
            state = self._solve(changed, values, raw, state.steps + 1)
            if gain < least_gain:
                break
        return state

    def _solve(self, modes: Modes, values: Array, raw: Sequence[Array], steps: int) -> _State:
        """Solve the linear part of each block for its mode and unwhitened columns; the resulting state."""
        each = zip(self.blocks, modes, raw, strict=True)
        projections = tuple(project(b, mode, raw=columns) for b, mode, columns in each)
        return _State(modes, values, projections, steps)

    def linearise(self, state: _State) -> JointFit:
        """Compute the Jacobian at a state; the state as a fit."""
        modes, projections = state.modes, state.projections
        weights = _weights(self.blocks, projections)
        jacobian = model_jacobian(self.blocks, modes, projections, weights, self.parameters, state.values)
        residual = tuple(
            (projection.residual * weight).ravel()
            for projection, weight in zip(projections, weights, strict=True)
        )
        information = _information(jacobian)
        hessian = information + self.prior_rows.T @ self.prior_rows
        return JointFit(
            modes,
            self.blocks,
            projections,
            self.parameters,
            tuple(jacobian),
            residual,
            information,
            hessian,
        )

    def _damped_step(self, state: _State, damping: float) -> tuple[Array, list[Array], float, float] | None:
        """Try steps with increasing damping, until one lowers the cost.

        A step does not cross a limit of a parameter. The weights of the blocks are those before the step.

        Parameters
        ----------
        state : _State
            State before the step.
        damping : float
            Damping of the first step, over the diagonal of the Hessian.

        Returns
        -------
        tuple or None
            Values of the parameters after the step, unwhitened columns of each block, damping for the next
            step, and reduction of the cost over the cost. None if no step lowers the cost.
        """
        values = state.values
        weights = _weights(self.blocks, state.projections)
        powers = [
            float(np.sum((projection.residual * weight) ** 2))
            for projection, weight in zip(state.projections, weights, strict=True)
        ]
        cost = self._cost(powers, values)
        hessian, descent = normal_equations(
            self.blocks, state.modes, state.projections, weights, self.parameters, values
        )
        deviations = self.prior_rows @ values - self.prior_values
        hessian += self.prior_rows.T @ self.prior_rows
        descent -= self.prior_rows.T @ deviations  # half the gradient of the cost, with the opposite sign
        low, high = limits_of(self.parameters)
        # A parameter at a limit is not changed if the descent leads beyond the limit.
        at_low, at_high = (values <= low) & (descent < 0), (values >= high) & (descent > 0)
        varied = ~(at_low | at_high)
        if not varied.any():
            return None
        hessian = hessian[np.ix_(varied, varied)]
        change = np.zeros(len(values))
        for _ in range(_TRIALS):
            damped = hessian + damping * np.diag(np.diag(hessian) + _LEAST_DIAGONAL)
            change[varied] = np.linalg.solve(damped, descent[varied])
            trial = np.clip(values + np.clip(change, -_LONGEST_STEP, _LONGEST_STEP), low, high)
            raw = raw_columns_of(self.blocks, modes_with(state.modes, self.blocks, self.parameters, trial))
            powers = []
            for i, b in enumerate(self.blocks):
                powers.append(remaining_power(b, raw[i], state.projections[i]) * weights[i] ** 2)
            gain = cost - self._cost(powers, trial)
            if gain > 0:
                return trial, raw, max(damping / _DAMPING_FACTOR, _LEAST_DAMPING), gain / cost
            damping = max(damping * _DAMPING_FACTOR, _LEAST_RAISED)
        return None

    def _cost(self, powers: Sequence[float], values: Array) -> float:
        """Sum of the blocks' weighted powers and of the squared deviations from the priors."""
        cost = sum(powers) + float(np.sum((self.prior_rows @ values - self.prior_values) ** 2))
        if not math.isfinite(cost):
            return math.inf  # and not nan, which no comparison would exclude
        return cost


def with_local_parameters(fit: JointFit, modes: Modes, names: Sequence[str]) -> JointFit:
    """Add derivatives by the local compliances at the stops to a fit.

    Parameters
    ----------
    fit : JointFit
        Fit without local compliances.
    modes : tuple of AxialMode
        Modes of the fit, with local compliances of 0.
    names : sequence of str
        Fields of the local compliances: ``"local:0"`` and so on.

    Returns
    -------
    JointFit
        At the same values, with the local compliances among its parameters and without priors.
    """
    added: list[Parameter] = [(name, None) for name in names]
    weights = _weights(fit.blocks, fit.projections)
    by_local = model_jacobian(fit.blocks, modes, fit.projections, weights, added, np.zeros(len(names)))
    jacobian = tuple(np.column_stack(pair) for pair in zip(fit.jacobian, by_local, strict=True))
    information = _information(jacobian)
    return replace(
        fit,
        modes=modes,
        parameters=(*fit.parameters, *added),
        jacobian=jacobian,
        information=information,
        hessian=information,
    )


def _information(jacobian: Sequence[Array]) -> Array:
    """JᵀJ, summed over the blocks, shape (parameters, parameters)."""
    return np.asarray(sum(j.T @ j for j in jacobian))


def _weights(blocks: Sequence[Block], projections: Sequence[Projection]) -> list[float]:
    """Weight of each block, (m/s²)⁻¹: one over the rms of its residual."""
    mean_squares = [
        b.mean_square(projection.residual) for b, projection in zip(blocks, projections, strict=True)
    ]
    return [1 / max(math.sqrt(mean_square), _LEAST_RMS) for mean_square in mean_squares]
