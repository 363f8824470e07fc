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
"""Change of :func:`log_residual` by which another fit is clearly better.

The product of the rms residuals of all blocks is then 20 % lower."""

SAMPLES_PER_INDEPENDENT = 5.0
"""Number of samples that contain as much information as an independent one.

Neighbouring samples are correlated, since the residual is limited to a band."""

# Levenberg-Marquardt: damping at the start, at least, and at least after a step that failed.
_FIRST_DAMPING, _LEAST_DAMPING, _LEAST_RAISED = 1e-3, 1e-8, 1e-4
_DAMPING_FACTOR = 8  # by which a step that succeeds lowers the damping, and one that fails raises it
_TRIALS = 7  # largest number of trials of a step, with increasing damping
_LONGEST_STEP = 0.4  # largest change of a parameter in a step, in its unit (1 for a logarithm)
_LEAST_RMS = 1e-100  # m/s², of a residual: keeps a weight, one over the rms, and its square finite


@dataclass(frozen=True, slots=True)
class Prior:
    """Prior distribution of a weighted sum of parameters that have the same value in both modes.

    Parameters
    ----------
    fields : tuple of (field, weight)
        Terms of the sum; for a logarithmic field, the logarithm.
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
        The data that were fitted.
    solved : tuple of Projection
        The linear part of each block.
    parameters : tuple of (field, mode index or None)
        The fitted parameters.
    jacobian : tuple of ndarray, shape (n * responses, parameters)
        Derivatives of each block's whitened model, less their projection on its columns, times its weight.
    residual : tuple of ndarray, shape (n * responses,)
        Whitened residual of each block times its weight.
    hessian : ndarray, shape (parameters, parameters)
        Of half the cost, in the Gauss-Newton approximation, with the priors.
    """

    modes: Modes
    blocks: tuple[Block, ...]
    solved: tuple[Projection, ...]
    parameters: tuple[Parameter, ...]
    jacobian: tuple[Array, ...]
    residual: tuple[Array, ...]
    hessian: Array

    @property
    def log_residual(self) -> float:
        """Result of :func:`log_residual`."""
        return log_residual(self.solved)


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
        Data.
    modes : sequence of AxialMode
        Initial modes, by the index ROTOR_FREE or ROTOR_HELD.
    fields : sequence of str
        Fields of AxialMode to fit. Those of MODE_FIELDS have a value for each mode, the others the same value
        for both.
    priors : sequence of Prior
        Priors of parameters that have the same value in both modes.
    most_steps : int
        Upper limit of the iterations.
    least_gain : float
        The iteration ends when a step lowers the cost by less than this part.

    Returns
    -------
    JointFit
        At the end of the iteration.
    """
    problem = _Problem.of(blocks, fields, priors)
    final = problem.minimised(modes, most_steps, least_gain)
    return problem.linearised(final)


def fit_modes(
    blocks: Sequence[Block],
    modes: Sequence[AxialMode],
    fields: Sequence[str],
    priors: Sequence[Prior] = (),
    most_steps: int = 12,
    least_gain: float = 2e-5,
) -> tuple[Modes, float]:
    """Fit all blocks together, without the Jacobian at the end, which takes time.

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
    final = _Problem.of(blocks, fields, priors).minimised(modes, most_steps, least_gain)
    return final.modes, log_residual(final.solved)


def log_residual(solved: Sequence[Projection]) -> float:
    """Logarithm of the rms of the whitened residual over that of the responses, summed over all blocks."""
    return sum(math.log(max(projection.unexplained, 1e-300)) / 2 for projection in solved)


@dataclass(frozen=True, slots=True)
class _State:
    """A point of the iteration: modes and solved linear parts of all blocks, values of the parameters.

    ``steps`` is the number of steps so far.
    """

    modes: Modes
    values: Array
    solved: tuple[Projection, ...]
    steps: int


@dataclass(frozen=True, slots=True)
class _Problem:
    """Blocks, parameters and priors of a fit.

    A prior is a row of ``prior_rows @ values = prior_values``, in units of its standard deviation: see
    :meth:`of`.
    """

    blocks: tuple[Block, ...]
    parameters: tuple[Parameter, ...]
    prior_rows: Array
    prior_values: Array

    @classmethod
    def of(cls, blocks: Sequence[Block], fields: Sequence[str], priors: Sequence[Prior]) -> _Problem:
        """The problem of :func:`fit_blocks`.

        In the cost every sample counts as if it were independent, so its information is too large by the
        factor SAMPLES_PER_INDEPENDENT; the priors are multiplied by the same factor.
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
        """Values of the parameters in modes by their index, shape (parameters,)."""
        return np.array([read_parameter(modes[index or 0], field) for field, index in self.parameters])

    def minimised(self, modes: Sequence[AxialMode], most_steps: int, least_gain: float) -> _State:
        """The state at the end of the iteration that begins with these modes, given by their index."""
        of_blocks = tuple(modes[b.mode_index] for b in self.blocks)
        values = np.clip(self.read(of_blocks), *limits_of(self.parameters))
        first = modes_with(of_blocks, self.blocks, self.parameters, values)
        state = self._solved(first, values, raw_columns_of(self.blocks, first), 0)
        damping = _FIRST_DAMPING
        while state.steps < most_steps:
            step = self._damped_step(state, damping)
            if step is None:
                break
            values, raw, damping, gain = step
            changed = modes_with(state.modes, self.blocks, self.parameters, values)
            state = self._solved(changed, values, raw, state.steps + 1)
            if gain < least_gain:
                break
        return state

    def _solved(self, modes: Modes, values: Array, raw: Sequence[Array], steps: int) -> _State:
        """The state at these modes, one per block, with ``raw`` columns: solves the linear part of each."""
        each = zip(self.blocks, modes, raw, strict=True)
        solved = tuple(project(b, mode, raw=columns) for b, mode, columns in each)
        return _State(modes, values, solved, steps)

    def linearised(self, state: _State) -> JointFit:
        """The fit at a state, with its Jacobian."""
        modes, solved = state.modes, state.solved
        weights = _weights(self.blocks, solved)
        jacobian = model_jacobian(self.blocks, modes, solved, weights, self.parameters, state.values)
        residual = tuple((s.residual * weight).ravel() for s, weight in zip(solved, weights, strict=True))
        hessian = sum((j.T @ j for j in jacobian), self.prior_rows.T @ self.prior_rows)
        return JointFit(modes, self.blocks, solved, self.parameters, tuple(jacobian), residual, hessian)

    def _damped_step(self, now: _State, damping: float) -> tuple[Array, list[Array], float, float] | None:
        """The first step with increasing damping that lowers the cost; not across a limit of a parameter.

        Returns values, raw columns, damping for the next step, and the reduction of the cost over the cost;
        None if no step lowers it. The weights of the blocks are those before the step.
        """
        values = now.values
        weights = _weights(self.blocks, now.solved)
        powers = [
            float(np.sum((solved.residual * weight) ** 2))
            for solved, weight in zip(now.solved, weights, strict=True)
        ]
        cost = self._cost(powers, values)
        hessian, descent = normal_equations(
            self.blocks, now.modes, now.solved, weights, self.parameters, values
        )
        deviations = self.prior_rows @ values - self.prior_values
        hessian += self.prior_rows.T @ self.prior_rows
        descent -= self.prior_rows.T @ deviations  # descent: minus half the gradient of the cost
        low, high = limits_of(self.parameters)
        # At a limit, a parameter stays if the descent leads beyond.
        free = ~((values <= low) & (descent < 0) | (values >= high) & (descent > 0))
        if not free.any():
            return None
        hessian = hessian[np.ix_(free, free)]
        change = np.zeros(len(values))
        for _ in range(_TRIALS):
            damped = hessian + damping * np.diag(np.diag(hessian) + 1e-12)
            change[free] = np.linalg.solve(damped, descent[free])
            trial = np.clip(values + np.clip(change, -_LONGEST_STEP, _LONGEST_STEP), low, high)
            raw = raw_columns_of(self.blocks, modes_with(now.modes, self.blocks, self.parameters, trial))
            powers = []
            for b, columns, solved, weight in zip(self.blocks, raw, now.solved, weights, strict=True):
                powers.append(remaining_power(b, columns, solved) * weight**2)
            gain = cost - self._cost(powers, trial)
            if gain > 0:
                return trial, raw, max(damping / _DAMPING_FACTOR, _LEAST_DAMPING), gain / cost
            damping = max(damping * _DAMPING_FACTOR, _LEAST_RAISED)
        return None

    def _cost(self, powers: Sequence[float], values: Array) -> float:
        """Sum of the blocks' weighted powers and of the squared deviations from the priors."""
        cost = sum(powers) + float(np.sum((self.prior_rows @ values - self.prior_values) ** 2))
        return cost if math.isfinite(cost) else math.inf  # not nan


def with_local_parameters(found: JointFit, modes: Modes, names: Sequence[str]) -> JointFit:
    """A fit with derivatives also by the local compliances at the stops.

    Parameters
    ----------
    found : JointFit
        Without local compliances.
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
    weights = _weights(found.blocks, found.solved)
    by_local = model_jacobian(found.blocks, modes, found.solved, weights, added, np.zeros(len(names)))
    jacobian = tuple(np.column_stack(pair) for pair in zip(found.jacobian, by_local, strict=True))
    hessian = np.asarray(sum(j.T @ j for j in jacobian))
    parameters = (*found.parameters, *added)
    return replace(found, modes=modes, parameters=parameters, jacobian=jacobian, hessian=hessian)


def _weights(blocks: Sequence[Block], solved: Sequence[Projection]) -> list[float]:
    """Weight of each block: one over the rms of its residual."""
    mean_squares = [b.mean_square(s.residual) for b, s in zip(blocks, solved, strict=True)]
    return [1 / max(math.sqrt(mean_square), _LEAST_RMS) for mean_square in mean_squares]
