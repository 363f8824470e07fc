"""Fit of the modes to all blocks of a run by Levenberg-Marquardt, with the linear parts eliminated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.blocks import Block, Projection, project, raw_columns, remaining_power, whiten
from ballscrew.modal.joint.mode import AxialMode

Modes = tuple[AxialMode, ...]
Parameter = tuple[str, int | None]
"""A field of AxialMode and the index of its mode; None for a field that all blocks share.

``"local:3"`` is the local compliance at the fourth stop."""

LOCAL = "local:"
CLEARLY = math.log(0.8)  # a logarithm of the residual lower by this much is not by chance
SAMPLES_PER_INDEPENDENT = 5.0  # a residual in a band is not white; priors are weighted by this

_OWN = ("compliance", "slope", "curve", "damping")  # fields that each mode has of its own
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

    def unexplained(self, index: int) -> float:
        """Part of the power of a block that is not explained."""
        solved = self.solved[index]
        return float(np.sum(solved.residual**2)) / max(solved.total, 1e-300)

    @property
    def log_residual(self) -> float:
        """Logarithm of the relative residual, summed over all blocks."""
        return sum(math.log(max(self.unexplained(i), 1e-300)) / 2 for i in range(len(self.blocks)))


def fit_blocks(
    blocks: Sequence[Block],
    modes: Sequence[AxialMode],
    fields: Sequence[str],
    priors: Sequence[Prior] = (),
    most: int = 12,
    enough: float = 2e-5,
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
    enough : float
        Relative gain of a step that ends the iteration.

    Returns
    -------
    JointFit
        The best found.
    """
    problem = _Problem.of(blocks, fields, priors)
    now = tuple(modes[b.mode_index] for b in problem.blocks)
    values = problem.read(now)
    raw: Sequence[Array | None] = [None] * len(problem.blocks)
    damping, steps = _FIRST_DAMPING, 0
    while True:
        result = problem.linearised(now, values, raw, steps)
        if steps >= most:
            return result
        trial = problem.damped_step(result, values, damping)
        if trial is None:
            return result
        values, now, raw, damping = trial.values, trial.modes, trial.raw, trial.damping
        steps += 1
        if trial.gain < enough * trial.cost:
            most = steps


@dataclass(frozen=True, slots=True)
class _Trial:
    """A step that lowers the cost: new values, the gain, and the cost before."""

    values: Array
    modes: Modes
    raw: Sequence[Array]
    damping: float
    gain: float
    cost: float


@dataclass(frozen=True, slots=True)
class _Problem:
    """Blocks, parameters and priors of a fit; priors as rows of a linear system."""

    blocks: tuple[Block, ...]
    parameters: tuple[Parameter, ...]
    prior_rows: Array
    prior_values: Array

    @classmethod
    def of(cls, blocks: Sequence[Block], fields: Sequence[str], priors: Sequence[Prior]) -> _Problem:
        parameters: list[Parameter] = [(f, None) for f in fields if f not in _OWN]
        for index in sorted({b.mode_index for b in blocks}):
            parameters += [(f, index) for f in fields if f in _OWN]
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

    def linearised(self, modes: Modes, values: Array, raw: Sequence[Array | None], steps: int) -> JointFit:
        """The fit at these values, with its linear parts solved and its Jacobian."""
        solved = tuple(project(b, s, raw=r) for b, s, r in zip(self.blocks, modes, raw, strict=True))
        weights = [_weight(s) for s in solved]
        jacobian = _jacobian(self.blocks, modes, solved, self.parameters, values, weights)
        residual = tuple((s.residual * w).ravel() for s, w in zip(solved, weights, strict=True))
        hessian = sum((j.T @ j for j in jacobian), self.prior_rows.T @ self.prior_rows)
        return JointFit(modes, self.blocks, solved, self.parameters, jacobian, residual, hessian, steps)

    def damped_step(self, now: JointFit, values: Array, damping: float) -> _Trial | None:
        """The first step that lowers the cost, with ever more damping; None if there is none."""
        weights = [_weight(s) for s in now.solved]
        cost = self._cost([float(r @ r) for r in now.residual], values)
        slope = sum(
            (j.T @ r for j, r in zip(now.jacobian, now.residual, strict=True)), np.zeros(len(self.parameters))
        )
        slope = slope - self.prior_rows.T @ (self.prior_rows @ values - self.prior_values)
        for _ in range(_TRIALS):
            damped = now.hessian + damping * np.diag(np.diag(now.hessian) + 1e-12)
            change = np.linalg.solve(damped, slope)
            trial = values + np.clip(change, -_LONGEST, _LONGEST)
            modes = _written(now.modes, self.blocks, self.parameters, trial)
            remaining = [
                remaining_power(b, s, e) for b, s, e in zip(self.blocks, modes, now.solved, strict=True)
            ]
            powers = [power * w**2 for (power, _), w in zip(remaining, weights, strict=True)]
            gain = cost - self._cost(powers, trial)
            if gain > 0:
                raw = [columns for _, columns in remaining]
                return _Trial(trial, modes, raw, max(damping / _FACTOR, _LEAST_DAMPING), gain, cost)
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
    jacobian = []
    for i, own in enumerate(found.jacobian):
        local = np.zeros((len(own), len(names)))
        _fill_local_jacobian(found.blocks[i], modes[i], found.solved[i], columns, weights[i], local)
        jacobian.append(np.column_stack([own, local]))
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
    for i, b in enumerate(blocks):
        _fill_local_jacobian(b, modes[i], solved[i], local, weights[i], out[i])
    for k, (field, index) in enumerate(parameters):
        if field.startswith(LOCAL):
            continue
        step = _STEPS.get(field, _STEP)
        moved = values.copy()
        moved[k] += step
        there = _written(modes, blocks, parameters, moved)
        for i, (b, s) in enumerate(zip(blocks, solved, strict=True)):
            if index is None or index == b.mode_index:
                out[i][:, k] = _derivative(b, there[i], s, step).ravel() * weights[i]
    return tuple(out)


def _derivative(b: Block, there: AxialMode, now: Projection, step: float) -> Array:
    """Change of the model per step, orthogonal to its columns: the part that the weights do not follow."""
    change = _change(b, there, now) / step
    return np.asarray(change - now.basis @ (now.basis.T @ change))


def _fill_local_jacobian(
    b: Block, mode: AxialMode, solved: Projection, columns: dict[int, int], weight: float, out: Array
) -> None:
    """Fill the columns of the local compliances, given as column of each stop.

    Every third stop is moved at once, since a window is at one of them only.
    """
    if not columns:
        return
    places = np.array(mode.places)
    for turn in range(min(_INTERLEAVED, len(places))):
        moved = np.array(mode.local)
        moved[turn::_INTERLEAVED] += _LOCAL_STEP
        bent = replace(mode, local=tuple(moved.tolist()))
        change = _change(b, bent, solved) / _LOCAL_STEP
        parts = {stop: np.zeros_like(change) for stop in columns if stop % _INTERLEAVED == turn}
        for start, end in b.windows.spans:
            there = b.windows.place[start:end]
            nearest = np.abs(places - (there.min() + there.max()) / 2).argsort()
            stop = int(nearest[nearest % _INTERLEAVED == turn][0])
            if stop in parts:
                parts[stop][start:end] = change[start:end]
        for stop, part in parts.items():
            part -= solved.basis @ (solved.basis.T @ part)
            out[:, columns[stop]] = part.ravel() * weight


def _change(b: Block, there: AxialMode, now: Projection) -> Array:
    """Change of the model with another mode and the same weights."""
    return whiten(b, raw_columns(b, there) @ now.weights - now.model, now.free)


def _stop(field: str) -> int:
    """Index of the stop of a local compliance."""
    return int(field.removeprefix(LOCAL))


def _read(mode: AxialMode, field: str) -> float:
    if field.startswith(LOCAL):
        return mode.local[_stop(field)]
    value = float(getattr(mode, field))
    return math.log(value) if field in _LOGARITHMIC else value


def _written(modes: Modes, blocks: Sequence[Block], parameters: Sequence[Parameter], values: Array) -> Modes:
    """Modes with these values of the parameters, within their limits."""
    out = list(modes)
    for (field, index), value in zip(parameters, values.tolist(), strict=True):
        for i, b in enumerate(blocks):
            if index is None or index == b.mode_index:
                out[i] = _with_value(out[i], field, value)
    return tuple(out)


def _with_value(mode: AxialMode, field: str, value: float) -> AxialMode:
    if field.startswith(LOCAL):
        local = list(mode.local)
        local[_stop(field)] = min(max(value, _LOCAL_LIMITS[0]), _LOCAL_LIMITS[1])
        return replace(mode, local=tuple(local))
    if field in _LOGARITHMIC:
        value = math.exp(value)
    low, high = _LIMITS.get(field, (-math.inf, math.inf))
    change: dict[str, Any] = {field: min(max(value, low), high)}
    return replace(mode, **change)
