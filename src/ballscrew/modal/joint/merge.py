"""Puts the curves of the two drives together.

The two frequencies part by the masses alone, so their squares keep nearly one ratio along the axis. What one
drive tells badly of its slope, the other may tell well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.fit import Fit
from ballscrew.modal.joint.shape import Shape, frequency
from ballscrew.modal.joint.uncertainty import condition_covariance, covariance, gradient

__all__ = ["Merged", "merged"]

_NOUGHT = 1e-9  # of the largest variance: rounding


@dataclass(frozen=True, slots=True)
class Merged:
    """Shapes after the merger, and the covariance of their parameters in two views.

    Parameters
    ----------
    fit : Fit
        Where it came from.
    shapes : tuple of Shape
        One a block.
    noise, conditions : ndarray, shape (keys, keys)
        By the scatter of cells, and of conditions.
    """

    fit: Fit
    shapes: tuple[Shape, ...]
    noise: Array
    conditions: Array

    def curve(self, block: int, place: Array) -> Array:
        """Frequency, Hz."""
        return frequency(self.shapes[block], place)

    def effects(self, block: int, place: Array, part: str) -> Array:
        """What independent causes do to it by ``"noise"`` or ``"conditions"``, shape (causes, places), Hz."""
        slope = gradient(self.fit, block, place)
        size, ways = np.linalg.eigh(slope @ getattr(self, part) @ slope.T)
        told = size > _NOUGHT * max(float(size[-1]), 1e-300)
        return np.asarray(ways[:, told] * np.sqrt(size[told])).T


def merged(found: Fit, taken: Array, part: float, reach: float) -> Merged:
    """Tie the slopes of the two blocks.

    Parameters
    ----------
    found : Fit
        Of one block or two.
    taken : ndarray, shape (keys, keys)
        Covariance by what a prior takes off.
    part : float
        Standard deviation by which the two frequencies' squares may part along the axis, as a part.
    reach : float
        Of the axis, m.

    Returns
    -------
    Merged
        The same, where there is one block.
    """
    noise, conditions = covariance(found) + taken, condition_covariance(found) + taken
    shapes = found.shapes
    keys = list(found.keys)
    for power, field in enumerate(("slope", "curve"), start=1):
        if len(shapes) < 2 or (field, 0) not in keys:
            continue
        row = np.zeros(len(keys))
        row[keys.index((field, 0))], row[keys.index((field, 1))] = 1.0, -1.0
        allowed = (part / reach**power) ** 2
        spread = (noise + conditions) @ row
        pull = spread / float(row @ spread + allowed)
        apart = getattr(shapes[0], field) - getattr(shapes[1], field)
        shapes = _moved(shapes, keys, -pull * apart)
        keep = np.eye(len(keys)) - np.outer(pull, row)
        noise = keep @ noise @ keep.T + allowed * np.outer(pull, pull)
        conditions = keep @ conditions @ keep.T
    return Merged(found, shapes, noise, conditions)


def _moved(
    shapes: Sequence[Shape], keys: Sequence[tuple[str, int | None]], change: Array
) -> tuple[Shape, ...]:
    out = list(shapes)
    for (field, block), value in zip(keys, change.tolist(), strict=True):
        if block is None:
            continue
        now = getattr(out[block], field)
        fresh = now * np.exp(value) if field in ("compliance", "damping") else now + value
        moved: dict[str, Any] = {field: float(fresh)}
        out[block] = replace(out[block], **moved)
    return tuple(out)
