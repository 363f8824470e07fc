"""Where the fit starts: the data choose among many starts; a data sheet only says where to look first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.modal.joint.model import Block, left_over, linear
from ballscrew.modal.joint.shape import Shape

__all__ = ["SCALES", "starts"]

SCALES = np.exp(np.arange(-0.40, 0.401, 0.04))
RATIOS = (1.3, 1.45, 1.6, 1.75, 1.9, 2.05, 2.2, 2.35)


def starts(
    blocks: Sequence[Block], first: Sequence[Shape], told: tuple[float, float] | None
) -> tuple[Shape, ...]:
    """Try frequencies around a first guess, with the pitching mode told or tried too.

    Parameters
    ----------
    blocks : sequence of Block
        Data.
    first : sequence of Shape
        A guess, one a block.
    told : tuple of float or None
        The pitching mode's frequency and damping where the accelerometers tell it.

    Returns
    -------
    tuple of Shape
        The best, with one pitching mode for all.
    """
    base = 1 / (2 * math.pi * math.sqrt(first[0].compliance))
    modes = [told] if told else [(r * base, 0.03) for r in RATIOS]
    best: tuple[float, tuple[Shape, ...]] | None = None
    for mode in modes:
        cost, shapes = 0.0, []
        for b, shape in zip(blocks, first, strict=True):
            tried = [
                replace(shape, compliance=shape.compliance / s**2, pitch=mode[0], pitch_damping=mode[1])
                for s in SCALES
            ]
            left = _left(b, tried)
            cost += math.log(max(min(left), 1e-12))
            shapes.append(tried[int(np.argmin(left))])
        if best is None or cost < best[0]:
            best = (cost, tuple(shapes))
    assert best is not None  # noqa: S101  there is always a mode to try
    return best[1]


def _left(b: Block, tried: Sequence[Shape]) -> list[float]:
    """What each mode would leave of the power; no window is taken to begin with a ringing."""
    none: NDArray[np.float64] = np.zeros((len(b.windows.place), 2))
    first = linear(b, tried[0], none)
    return [left_over(b, one, first)[0] / max(first.total, 1e-300) for one in tried]
