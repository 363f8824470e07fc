"""How strongly what repeats with every turn pushes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ballscrew.modal.joint.fit import FEWER, Fit
from ballscrew.modal.joint.model import orthonormal
from ballscrew.modal.joint.result import Push
from ballscrew.modal.joint.ripple import ALIKE
from ballscrew.modal.joint.shape import frequency

__all__ = ["pushes"]

_ROUGH = {"torque-nut": 0.04, "torque-motor": 0.07}  # of a size: what the model is off by on the testbed
_REACHED = 0.65  # of the mode's frequency, at full speed: below, the two columns of an order are much alike
_SIDE = 3  # orders nearer than this to each other are made by one between them
_NONE = 1e-12  # m/s²


def pushes(found: Fit, told: Sequence[int], lead: float) -> tuple[Push, ...]:
    """How strongly each order pushes.

    Parameters
    ----------
    found : Fit
        Of a run; its first block is the one that the torque drives.
    told : sequence of int
        The orders that stand in it.
    lead : float
        Of the screw, m.

    Returns
    -------
    tuple of Push
        By what the mode makes of a push, against what it makes of the torque; in the mean of the responses.
        Without a size where the order stays well below the mode, where what is told beside the mode and what
        the mode makes of it are alike, and where orders are found beside each other, which one between
        them makes.
    """
    solved, b, shape = found.solved[0], found.blocks[0], found.shapes[0]
    weights, left = solved.weights.mean(axis=1), solved.residual.mean(axis=1)
    ways = orthonormal(solved.columns.T @ solved.columns, ALIKE)
    spread = FEWER * float(np.mean(left**2)) * ways @ ways.T
    # The torque's answer stands beside its slopes and what pitches with it; at the mode all add up.
    f = float(frequency(shape, np.zeros(1))[0])
    turn, over = 1j * math.sin(2 * math.pi * f / b.windows.rate), f / shape.pitch
    made = [1, turn]
    if b.name != "torque-motor":
        pitched = 1 / (1 - over**2 + 2j * shape.pitch_damping * over)
        made += [turn**2, pitched, pitched * turn]
    gain = abs(complex(weights[: len(made)] @ np.array(made)))
    turns = float(np.abs(b.windows.speed).max()) / lead if lead > 0 else 0.0
    out = []
    for k, order in enumerate(told):
        at = [len(weights) - 2 * (len(told) - k) + i for i in range(2)]
        size = math.hypot(*weights[at])
        near = order * turns >= _REACHED * f
        alone = all(other == order or abs(other - order) > _SIDE for other in told)
        if not alone or not near or size < _NONE or gain < _NONE:
            out.append(Push(order, None, None, near and not alone))
            continue
        slope = weights[at] / size / gain
        noise = math.sqrt(slope @ spread[np.ix_(at, at)] @ slope)
        out.append(Push(order, size / gain, math.hypot(noise, _ROUGH[b.name] * size / gain)))
    return tuple(out)
