"""Fit of the modes to all blocks of a run by Levenberg-Marquardt, with the linear parts eliminated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.blocks import (
    Block,
    Projection,
    project,
    raw_columns_of,
    remaining_power,
    whiten,
)
from ballscrew.modal.joint.mode import AxialMode

Modes = tuple[AxialMode, ...]
Parameter = tuple[str, int | None]
"""A field of AxialMode and the index of its mode; None for a field that all blocks share.

``"local:3"`` is the local compliance at the fourth stop."""

LOCAL = "local:"
CLEARLY = math.log(0.8)  # a logarithm of the residual lower by this much is not by chance
SAMPLES_PER_INDEPENDENT = 5.0  # a residual in a band is not white; priors are weighted by this

_MODE_FIELDS = ("compliance", "slope", "curve", "damping")  # fields that each mode has of its own
_LOGARITHMIC = ("compliance", "damping", "load", "pitch", "pitch_damping")
_STEP = 1e-4  # of a difference quotient
_STEPS = {"slope": 1e-3, "curve": 1e-2, "load": 1e-2, "power": 1e-2}
_LOCAL_STEP = 1e-3
_INTERLEAVED = 3  # stops of which no window reaches two, counted along the axis
_LIMITS = {"damping": (1e-3, 0.5), "pitch_damping": (1e-3, 0.5), "power": (-2.0, 2.0)}
_LOCAL_LIMITS = (-0.8, 20.0)

# Damping of the Levenberg-Marquardt steps.
_FIRST_DAMPING, _LEAST_DAMPING, _LEAST_RAISED = 1e-3, 1e-8, 1e-4
_FACTOR = 8
_TRIALS = 7
_LONGEST = 0.4  # of a step, in every parameter


@dataclass(frozen=True, slots=True)
class Prior:
    """Expected value and standard deviation of a weighted sum of shared parameters.

    ``fields`` are their names and weights; of logarithmic fields it is the logarithm.
    """

    fields: tuple[tuple[str, float], ...]
    value: float
    deviation: float


@dataclass(frozen=True, slots=True)
class JointFit:
    """Final state of a fit.

    Parameters
    ----------
    modes : tuple of AxialMode
        One per block.
    blocks : tuple of Block
        As fitted.
    solved : tuple of Projection
        Their linear parts.
    parameters : tuple of (field, mode index or None)
        The fitted parameters.
    jacobian : tuple of ndarray, shape (n * responses, parameters)
        Of the model of each block, weighted.
    residual : tuple of ndarray, shape (n * responses,)
        Weighted.
    hessian : ndarray, shape (parameters, parameters)
        Gauss-Newton approximation, with the priors.
    steps : int
        Of the iteration.
    """

    modes: Modes
    blocks: tuple[Block, ...]
    solved: tuple[Projection, ...]
    parameters: tuple[Parameter, ...]
    jacobian: tuple[Array, ...]
    residual: tuple[Array, ...]
    hessian: Array
    steps: int

    @property
    def log_residual(self) -> float:
        """Logarithm of the relative residual, summed over all blocks."""
        return log_residual(self.solved)


def fit_blocks(
    blocks: Sequence[Block],
    modes: Sequence[AxialMode],
    fields: Sequence[str],
    priors: Sequence[Prior] = (),
    most: int = 12,
    least_gain: float = 2e-5,
) -> JointFit:
    """Fit all blocks together.

    Parameters
    ----------
    blocks : sequence of Block
        Data.
    modes : sequence of AxialMode
        Initial values, one per mode.
    fields : sequence of str
        Free fields of AxialMode; compliance, slope, curve and damping are each mode's own, the others are
        shared by all blocks.
    priors : sequence of Prior
        On shared fields.
    most : int
        Upper limit of the iterations.
    least_gain : float
        Relative gain of a step that ends the iteration.

    Returns
    -------
    JointFit
        The best found.
    """
    problem = _Problem.of(blocks, fields, priors)
    end = problem.minimised(modes, most, least_gain)
    return problem.linearised(end)


def fit_modes(
    blocks: Sequence[Block],
    modes: Sequence[AxialMode],
    fields: Sequence[str],
    priors: Sequence[Prior] = (),
    most: int = 12,
    least_gain: float = 2e-5,
) -> tuple[Modes, float]:
    """Modes that :func:`fit_blocks` finds, one per block, and the logarithm of their residual.

    Without the derivatives at the end, in less time.
    """
    end = _Problem.of(blocks, fields, priors).minimised(modes, most, least_gain)
    return end.modes, log_residual(end.solved)


def log_residual(solved: Sequence[Projection]) -> float:
    """Logarithm of the relative residual, summed over all blocks."""
    return sum(math.log(max(projection.unexplained, 1e-300)) / 2 for projection in solved)


@dataclass(frozen=True, slots=True)
class _State:
    """Modes of all blocks, the values of their parameters, and the solved linear parts."""

    modes: Modes
    values: Array
    solved: tuple[Projection, ...]
    steps: int


@dataclass(frozen=True, slots=True)
class _Problem:
    """Blocks, parameters and priors of a fit; priors as rows of a linear system."""

    blocks: tuple[Block, ...]
    parameters: tuple[Parameter, ...]
    prior_rows: Array
    prior_values: Array

    @classmethod
    def of(cls, blocks: Sequence[Block], fields: Sequence[str], priors: Sequence[Prior]) -> _Problem:
        parameters: list[Parameter] = [(f, None) for f in fields if f not in _MODE_FIELDS]
        for index in sorted({b.mode_index for b in blocks}):
            parameters += [(f, index) for f in fields if f in _MODE_FIELDS]
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
        """Values of the parameters, of some the logarithm."""
        return np.array([_read(modes[index or 0], field) for field, index in self.parameters])

    def minimised(self, modes: Sequence[AxialMode], most: int, least_gain: float) -> _State:
        """The end of the iteration from these modes."""
        now = tuple(modes[b.mode_index] for b in self.blocks)
        state = self._solved(now, self.read(now), raw_columns_of(self.blocks, now), 0)
        damping = _FIRST_DAMPING
        while state.steps < most:
            linear = self.linearised(state)
            cost = self._cost([float(r @ r) for r in linear.residual], state.values)
            step = self._damped_step(linear, state.values, cost, damping)
            if step is None:
                break
            values, raw, damping, gain = step
            modes_there = _modes_with(state.modes, self.blocks, self.parameters, values)
            state = self._solved(modes_there, values, raw, state.steps + 1)
            if gain < least_gain * cost:
                break
        return state

    def _solved(self, modes: Modes, values: Array, raw: Sequence[Array], steps: int) -> _State:
        solved = tuple(project(b, s, raw=r) for b, s, r in zip(self.blocks, modes, raw, strict=True))
        return _State(modes, values, solved, steps)

    def linearised(self, state: _State) -> JointFit:
        """The fit at a state, with its Jacobian."""
        modes, solved = state.modes, state.solved
        weights = [_weight(s) for s in solved]
        jacobian = _jacobian(self.blocks, modes, solved, self.parameters, state.values, weights)
        residual = tuple((s.residual * w).ravel() for s, w in zip(solved, weights, strict=True))
        hessian = sum((j.T @ j for j in jacobian), self.prior_rows.T @ self.prior_rows)
        return JointFit(modes, self.blocks, solved, self.parameters, jacobian, residual, hessian, state.steps)

    def _damped_step(
        self, now: JointFit, values: Array, cost: float, damping: float
    ) -> tuple[Array, list[Array], float, float] | None:
        """The first step that lowers the cost, with ever more damping; None if there is none.

        Values, raw columns, damping of the next step, and gain.
        """
        weights = [_weight(s) for s in now.solved]
        slope = sum(
            (j.T @ r for j, r in zip(now.jacobian, now.residual, strict=True)), np.zeros(len(self.parameters))
        )
        slope = slope - self.prior_rows.T @ (self.prior_rows @ values - self.prior_values)
        for _ in range(_TRIALS):
            damped = now.hessian + damping * np.diag(np.diag(now.hessian) + 1e-12)
            change = np.linalg.solve(damped, slope)
            trial = values + np.clip(change, -_LONGEST, _LONGEST)
            raw = raw_columns_of(self.blocks, _modes_with(now.modes, self.blocks, self.parameters, trial))
            powers = []
            for b, columns, solved, weight in zip(self.blocks, raw, now.solved, weights, strict=True):
                powers.append(remaining_power(b, columns, solved) * weight**2)
            gain = cost - self._cost(powers, trial)
            if gain > 0:
                return trial, raw, max(damping / _FACTOR, _LEAST_DAMPING), gain
            damping = max(damping * _FACTOR, _LEAST_RAISED)
        return None

    def _cost(self, powers: Sequence[float], values: Array) -> float:
        cost = sum(powers) + float(np.sum((self.prior_rows @ values - self.prior_values) ** 2))
        return cost if math.isfinite(cost) else math.inf


def with_local_parameters(found: JointFit, modes: Modes, names: Sequence[str]) -> JointFit:
    """A finished fit with the local compliances at the stops among its parameters.

    Parameters
    ----------
    found : JointFit
        Without them.
    modes : tuple of AxialMode
        Its own, with local compliances of 0.
    names : sequence of str
        ``"local:0"`` and so on.

    Returns
    -------
    JointFit
        As a fit of no step would return it; without priors.
    """
    parameters = (*found.parameters, *((name, None) for name in names))
    weights = [_weight(s) for s in found.solved]
    columns = {k: k for k in range(len(names))}
    local = [np.zeros((len(own), len(names))) for own in found.jacobian]
    _fill_local_jacobian(found.blocks, modes, found.solved, columns, weights, local)
    jacobian = [np.column_stack(pair) for pair in zip(found.jacobian, local, strict=True)]
    hessian = np.asarray(sum(j.T @ j for j in jacobian))
    return replace(found, modes=modes, parameters=parameters, jacobian=tuple(jacobian), hessian=hessian)


def _weight(solved: Projection) -> float:
    return 1 / max(math.sqrt(np.mean(solved.residual**2)), 1e-300)


def _jacobian(
    blocks: Sequence[Block],
    modes: Modes,
    solved: Sequence[Projection],
    parameters: Sequence[Parameter],
    values: Array,
    weights: Sequence[float],
) -> tuple[Array, ...]:
    """Weighted derivatives of the models, by difference quotients."""
    out = [np.zeros((s.residual.size, len(parameters)), order="F") for s in solved]
    local = {_stop(f): k for k, (f, _) in enumerate(parameters) if f.startswith(LOCAL)}
    _fill_local_jacobian(blocks, modes, solved, local, weights, out)
    for k, (field, index) in enumerate(parameters):
        if field.startswith(LOCAL):
            continue
        step = _STEPS.get(field, _STEP)
        shifted = values.copy()
        shifted[k] += step
        shifted_modes = _modes_with(modes, blocks, parameters, shifted)
        concerned = [i for i, b in enumerate(blocks) if index is None or index == b.mode_index]
        raw = raw_columns_of([blocks[i] for i in concerned], [shifted_modes[i] for i in concerned])
        for i, columns in zip(concerned, raw, strict=True):
            change = _change(blocks[i], columns, solved[i]) / step
            out[i][:, k] = _without_columns(change, solved[i]).ravel() * weights[i]
    return tuple(out)


def _fill_local_jacobian(
    blocks: Sequence[Block],
    modes: Modes,
    solved: Sequence[Projection],
    columns: dict[int, int],
    weights: Sequence[float],
    out: Sequence[Array],
) -> None:
    """Fill the columns of the local compliances, given as column of each stop.

    Every third stop is moved at once, since a window is at one of them only.
    """
    if not columns:
        return
    places = np.array(modes[0].places)
    for turn in range(min(_INTERLEAVED, len(places))):
        bent_modes = []
        for mode in modes:
            local = np.array(mode.local)
            local[turn::_INTERLEAVED] += _LOCAL_STEP
            bent_modes.append(replace(mode, local=tuple(local.tolist())))
        for i, raw in enumerate(raw_columns_of(blocks, bent_modes)):
            change = _change(blocks[i], raw, solved[i]) / _LOCAL_STEP
            parts = {stop: np.zeros_like(change) for stop in columns if stop % _INTERLEAVED == turn}
            for start, end in blocks[i].windows.spans:
                place = blocks[i].windows.place[start:end]
                nearest = np.abs(places - (place.min() + place.max()) / 2).argsort()
                stop = int(nearest[nearest % _INTERLEAVED == turn][0])
                if stop in parts:
                    parts[stop][start:end] = change[start:end]
            for stop, part in parts.items():
                out[i][:, columns[stop]] = _without_columns(part, solved[i]).ravel() * weights[i]


def _change(b: Block, raw: Array, now: Projection) -> Array:
    """Change of the model with other columns and the same weights."""
    return whiten(b, raw @ now.weights - now.model, now.free)


def _without_columns(change: Array, now: Projection) -> Array:
    """Part of a change that is orthogonal to the columns: the part that the weights do not follow."""
    return np.asarray(change - now.basis @ (now.basis.T @ change))


def _stop(field: str) -> int:
    """Index of the stop of a local compliance."""
    return int(field.removeprefix(LOCAL))


def _read(mode: AxialMode, field: str) -> float:
    if field.startswith(LOCAL):
        return mode.local[_stop(field)]
    value = float(getattr(mode, field))
    return math.log(value) if field in _LOGARITHMIC else value


def _modes_with(
    modes: Modes, blocks: Sequence[Block], parameters: Sequence[Parameter], values: Array
) -> Modes:
    """Modes with these values of the parameters, within their limits."""
    out = []
    for mode, b in zip(modes, blocks, strict=True):
        changes: dict[str, Any] = {}
        local = list(mode.local)
        for (field, index), value in zip(parameters, values.tolist(), strict=True):
            if index is not None and index != b.mode_index:
                continue
            if field.startswith(LOCAL):
                local[_stop(field)] = min(max(value, _LOCAL_LIMITS[0]), _LOCAL_LIMITS[1])
                continue
            if field in _LOGARITHMIC:
                value = math.exp(value)
            low, high = _LIMITS.get(field, (-math.inf, math.inf))
            changes[field] = min(max(value, low), high)
        out.append(replace(mode, local=tuple(local), **changes))
    return tuple(out)
