"""Levenberg-Marquardt over the blocks of a run, all that is linear eliminated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.model import Block, Linear, left_over, linear, prepared, raw_columns
from ballscrew.modal.joint.shape import Shape

__all__ = ["CLEARLY", "FEWER", "Fit", "Prior", "fit", "with_places"]

Shapes = tuple[Shape, ...]
_OWN = ("compliance", "slope", "curve", "damping")
_LOG = ("compliance", "damping", "load", "pitch", "pitch_damping")
_STEP = 1e-4
_STEPS = {"slope": 1e-3, "curve": 1e-2, "load": 1e-2, "power": 1e-2}
_HATS = 3  # places whose parts of the compliance no window sees at once, counted along the axis
_LOCAL = "local:"
_POWER = 2.0  # no damping goes faster with the frequency, nor does the kernel's series hold beyond
CLEARLY = math.log(0.8)  # less is left by so much: not by chance
FEWER = 5.0  # samples for one that is independent, by which priors are weighed


@dataclass(frozen=True, slots=True)
class Prior:
    """What is expected of a sum of fields that all blocks share: its value and deviation.

    ``fields`` are their names and factors; of some it is the logarithm.
    """

    fields: tuple[tuple[str, float], ...]
    value: float
    deviation: float


@dataclass(frozen=True, slots=True)
class Fit:
    """Where the iteration ended.

    Parameters
    ----------
    shapes : tuple of Shape
        One a block.
    blocks : tuple of Block
        As fitted.
    solved : tuple of Linear
        Their linear parts.
    keys : tuple of (field, mode or None)
        The parameters.
    jacobian : tuple of ndarray, shape (n * responses, keys)
        Of each block's model, weighted.
    residual : tuple of ndarray, shape (n * responses,)
        Weighted.
    hessian : ndarray, shape (keys, keys)
        With the priors.
    steps : int
        Of the iteration.
    """

    shapes: Shapes
    blocks: tuple[Block, ...]
    solved: tuple[Linear, ...]
    keys: tuple[tuple[str, int | None], ...]
    jacobian: tuple[Array, ...]
    residual: tuple[Array, ...]
    hessian: Array
    steps: int

    def unexplained(self, index: int) -> float:
        """Part of a block's power that is left."""
        solved = self.solved[index]
        return float(np.sum(solved.residual**2)) / max(solved.total, 1e-300)

    @property
    def left(self) -> float:
        """Logarithm of what is left, over all blocks."""
        return sum(math.log(max(self.unexplained(i), 1e-300)) / 2 for i in range(len(self.blocks)))


def fit(
    blocks: Sequence[Block],
    shapes: Sequence[Shape],
    fields: Sequence[str],
    priors: Sequence[Prior] = (),
    most: int = 12,
    enough: float = 2e-5,
) -> Fit:
    """Fit all blocks together.

    Parameters
    ----------
    blocks : sequence of Block
        Data.
    shapes : sequence of Shape
        Where to start, one a block.
    fields : sequence of str
        Of Shape that are free; those of :data:`_OWN` are each mode's own, the others one for all blocks.
        ``"local:3"`` is the part of the compliance at the fourth place.
    priors : sequence of Prior
        What is expected.
    most : int
        Iterations.
    enough : float
        Relative gain at which to end.

    Returns
    -------
    Fit
        The best found.
    """
    blocks = tuple(blocks)
    now = tuple(shapes[b.mode] for b in blocks)
    keys: list[tuple[str, int | None]] = [(f, None) for f in fields if f not in _OWN]
    keys += [(f, i) for i in sorted({b.mode for b in blocks}) for f in fields if f in _OWN]
    values = np.array([_read(now[i or 0], f) for f, i in keys])
    rows, wanted = _prior_rows(keys, priors)
    damp, steps = 1e-3, 0
    known: Sequence[Array | None] = [None] * len(blocks)
    while True:
        solved = tuple(linear(b, s, raw=raw) for b, s, raw in zip(blocks, now, known, strict=True))
        weight = [_weight(s) for s in solved]
        jacobian = _jacobian(blocks, now, solved, keys, values, weight)
        residual = tuple((s.residual * w).ravel() for s, w in zip(solved, weight, strict=True))
        hessian = sum((j.T @ j for j in jacobian), rows.T @ rows)
        result = Fit(now, blocks, solved, tuple(keys), jacobian, residual, hessian, steps)
        if steps >= most:
            return result
        cost = _cost([float(r @ r) for r in residual], rows, wanted, values)
        slope = sum((j.T @ r for j, r in zip(jacobian, residual, strict=True)), np.zeros(len(keys)))
        slope = slope - rows.T @ (rows @ values - wanted)
        gain = 0.0
        for _ in range(7):
            change = np.linalg.solve(hessian + damp * np.diag(np.diag(hessian) + 1e-12), slope)
            trial = values + np.clip(change, -0.4, 0.4)
            shapes_there = _written(now, blocks, keys, trial)
            there = [left_over(b, s, e) for b, s, e in zip(blocks, shapes_there, solved, strict=True)]
            left = [size * w**2 for (size, _), w in zip(there, weight, strict=True)]
            gain = cost - _cost(left, rows, wanted, trial)
            if gain > 0:
                break
            damp = max(damp * 8, 1e-4)
        if not gain > 0:
            return result
        values, now, damp, steps = trial, shapes_there, max(damp / 8, 1e-8), steps + 1
        known = [raw for _, raw in there]
        if gain < enough * cost:
            most = steps


def with_places(found: Fit, shapes: Shapes, names: Sequence[str]) -> Fit:
    """Where a fit ended, as seen with the parts of the compliance at single places among its parameters.

    Parameters
    ----------
    found : Fit
        Without them.
    shapes : tuple of Shape
        Its own, with parts of 0.
    names : sequence of str
        ``"local:0"`` and so on.

    Returns
    -------
    Fit
        As a fit of no step would leave it; without priors.
    """
    keys = (*found.keys, *((name, None) for name in names))
    weight = [_weight(s) for s in found.solved]
    parts = [np.zeros((s.residual.size, len(names))) for s in found.solved]
    _local_jacobian(found.blocks, shapes, found.solved, {k: k for k in range(len(names))}, weight, parts)
    jacobian = tuple(np.column_stack([j, part]) for j, part in zip(found.jacobian, parts, strict=True))
    hessian = np.asarray(sum(j.T @ j for j in jacobian))
    return replace(found, shapes=shapes, keys=keys, jacobian=jacobian, hessian=hessian)


def _weight(solved: Linear) -> float:
    return 1 / max(math.sqrt(np.mean(solved.residual**2)), 1e-300)


def _jacobian(
    blocks: Sequence[Block],
    shapes: Shapes,
    solved: Sequence[Linear],
    keys: Sequence[tuple[str, int | None]],
    values: Array,
    weight: Sequence[float],
) -> tuple[Array, ...]:
    out = [np.zeros((s.residual.size, len(keys)), order="F") for s in solved]
    hats = {int(f.split(":")[1]): k for k, (f, _) in enumerate(keys) if f.startswith(_LOCAL)}
    _local_jacobian(blocks, shapes, solved, hats, weight, out)
    for k, (field, own) in enumerate(keys):
        if k in hats.values():
            continue
        step = _STEPS.get(field, _STEP)
        moved = values.copy()
        moved[k] += step
        there = _written(shapes, blocks, keys, moved)
        for i, (b, s) in enumerate(zip(blocks, solved, strict=True)):
            if own is not None and own != b.mode:
                continue
            change = _moved(b, there[i], s) / step
            change -= s.basis @ (s.basis.T @ change)
            out[i][:, k] = change.ravel() * weight[i]
    return tuple(out)


def _local_jacobian(
    blocks: Sequence[Block],
    shapes: Shapes,
    solved: Sequence[Linear],
    hats: dict[int, int],
    weight: Sequence[float],
    out: Sequence[Array],
) -> None:
    """Columns of the places: every third one is moved at once; a window is at one of them."""
    if not hats:
        return
    places = np.array(shapes[0].places)
    step = _STEP * 10
    for i, (b, shape, s) in enumerate(zip(blocks, shapes, solved, strict=True)):
        nearest = []
        for start, stop in b.windows.spans:
            there = b.windows.place[start:stop]
            nearest.append(np.abs(places - (there.min() + there.max()) / 2).argsort())
        for turn in range(min(_HATS, len(places))):
            moved = np.array(shape.local)
            moved[turn::_HATS] += step
            bent = replace(shape, local=tuple(moved.tolist()))
            change = _moved(b, bent, s) / step
            parts = {k: np.zeros_like(change) for k in hats if k % _HATS == turn}
            for (start, stop), order in zip(b.windows.spans, nearest, strict=True):
                here = next(int(p) for p in order if p % _HATS == turn)
                if here in parts:
                    parts[here][start:stop] = change[start:stop]
            for place, part in parts.items():
                part = part - s.basis @ (s.basis.T @ part)
                out[i][:, hats[place]] = part.ravel() * weight[i]


def _moved(b: Block, there: Shape, now: Linear) -> Array:
    """By how much the model moves where its mode does, with the weights as they are."""
    return prepared(b, raw_columns(b, there) @ now.weights - now.model, now.rings)


def _cost(left: Sequence[float], rows: Array, wanted: Array, values: Array) -> float:
    cost = sum(left) + float(np.sum((rows @ values - wanted) ** 2))
    return cost if math.isfinite(cost) else math.inf


def _read(shape: Shape, field: str) -> float:
    if field.startswith(_LOCAL):
        return shape.local[int(field.split(":")[1])]
    value = float(getattr(shape, field))
    return math.log(value) if field in _LOG else value


def _written(
    shapes: Shapes, blocks: Sequence[Block], keys: Sequence[tuple[str, int | None]], values: Array
) -> Shapes:
    out = list(shapes)
    for (field, own), value in zip(keys, values.tolist(), strict=True):
        real = math.exp(value) if field in _LOG else value
        if field in ("damping", "pitch_damping"):
            real = min(max(real, 1e-3), 0.5)
        if field == "power":
            real = min(max(real, -_POWER), _POWER)
        for i in (i for i, b in enumerate(blocks) if own is None or own == b.mode):
            if field.startswith(_LOCAL):
                parts = list(out[i].local)
                parts[int(field.split(":")[1])] = min(max(value, -0.8), 20.0)
                out[i] = replace(out[i], local=tuple(parts))
                continue
            change: dict[str, Any] = {field: real}
            out[i] = replace(out[i], **change)
    return tuple(out)


def _prior_rows(keys: Sequence[tuple[str, int | None]], priors: Sequence[Prior]) -> tuple[Array, Array]:
    rows, wanted = [], []
    for prior in priors:
        row = np.zeros(len(keys))
        for field, factor in prior.fields:
            row[keys.index((field, None))] = factor
        weight = math.sqrt(FEWER) / prior.deviation
        rows.append(row * weight)
        wanted.append(prior.value * weight)
    return np.array(rows).reshape(len(rows), len(keys)), np.array(wanted)
