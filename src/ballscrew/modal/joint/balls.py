"""Balls that pass: a force at the nut whose order is no whole number.

Balls that enter and leave the loaded zone push the nut, with a phase that depends on the trip and the
direction of motion. At full speed their force is a tone. Near the mode it rings with it, at neighbouring
stops alike, so that no scatter of the cells shows its error. It is fitted as the ripple is, with a cosine and
a sine for each direction.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.blocks import (
    Block,
    Projection,
    make_block,
    orthonormaliser,
    project,
    ripple_columns,
    whiten,
)
from ballscrew.modal.joint.fit import SAMPLES_PER_INDEPENDENT
from ballscrew.modal.joint.mode import AxialMode, damping_ratio, mode_frequency
from ballscrew.modal.joint.windows import Windows

# The force is significant if the power of the residual that it explains exceeds each of these: as of a whole
# order in ballscrew.modal.joint.ripple, but with twice as many columns.
_LEAST_POWER = 0.004  # of the residual's
_CHANCE = 40.0  # of an independent sample's
_OUTSTANDING = 12.0  # of what the median order explains

_NEAR = (0.7, 1.25)  # frequency at full speed over those of the mode along the axis
_STEP = 3.0  # candidates per resolution of orders, one over the turns along the axis
_REFINED = np.linspace(-0.5, 0.5, 9)  # around the best candidate, in the same unit
_EVERY = 3  # samples: the band ends below half of this lower rate
_RANK_TOLERANCE = 1e-6  # as for whole orders


def ball_forces(w: Windows, lead: float, order: float | None) -> Array:
    """Cosine and sine of an order for each direction, shape (n, 4); no columns without an order."""
    if order is None:
        return np.empty((len(w.place), 0))
    angle = 2 * math.pi * order / lead * w.place
    columns = []
    for sign in np.unique(w.direction):
        columns += [np.cos(angle) * (w.direction == sign), np.sin(angle) * (w.direction == sign)]
    return np.column_stack(columns)


def find_balls(
    name: str, w: Windows, mode: AxialMode, lead: float, ripple: Array, *, from_rest: bool = False
) -> float | None:
    """Order of the balls' force, if it explains a significant part of the residual.

    Parameters
    ----------
    name, w, from_rest, mode
        As for :func:`~ballscrew.modal.joint.ripple.select_orders`.
    lead : float
        Travel per turn, m.
    ripple : ndarray, shape (n, k)
        Of the whole orders.

    Returns
    -------
    float or None
        Per turn; by a filter matched to the response of each cell at full speed, then refined.
    """
    turns = float(np.ptp(w.place)) / lead
    b = make_block(name, w, from_rest=from_rest, ripple=ripple)
    solved = project(b, mode)
    orders, scores = _matched_scores(w, mode, lead, turns, solved.residual)
    if not len(orders):
        return None
    best = int(np.argmax(scores))
    if scores[best] < _OUTSTANDING * float(np.median(scores)):
        return None
    near = np.round(orders[best] + _REFINED / turns, 4).tolist()
    gains = [_explained(b, mode, solved, ball_forces(w, lead, order)) for order in near]
    independent = max(int(b.counted.sum()), 1) / SAMPLES_PER_INDEPENDENT
    least = max(_LEAST_POWER, _CHANCE / independent) * float(np.sum(solved.residual**2))
    if max(gains) < least:
        return None
    return float(near[int(np.argmax(gains))])


def _matched_scores(
    w: Windows, mode: AxialMode, lead: float, turns: float, residual: Array
) -> tuple[Array, Array]:
    """Orders between whole ones, and the power of the residual that each would explain, at full speed."""
    speeds = np.array([np.abs(w.speed[start:stop]).max() for start, stop in w.spans]) / lead  # turns per s
    frequencies = mode_frequency(mode, w.stops)
    damping = damping_ratio(mode, frequencies)
    low = _NEAR[0] * frequencies.min() / speeds.max()
    high = _NEAR[1] * frequencies.max() / speeds.max()
    orders = np.arange(low, high, 1 / (_STEP * turns))
    orders = orders[np.abs(orders - np.round(orders)) * turns > 1]
    scores = np.zeros(len(orders))
    directions = np.array([w.direction[start] for start, _ in w.spans])
    for sign in np.unique(directions):
        total, power = np.zeros((len(orders), residual.shape[1]), complex), np.zeros(len(orders))
        for cell in np.flatnonzero(directions == sign).tolist():
            rows = slice(*w.spans[cell], _EVERY)
            ratio = orders * speeds[cell] / frequencies[cell]
            gain = 1 / (1 - ratio**2 + 2j * sign * damping[cell] * ratio)
            turn = np.outer(orders, w.place[rows] / lead)
            angle = (2 * math.pi * (turn - np.round(turn))).astype(np.float32)  # its cosine takes a third
            wave = np.cos(angle) @ residual[rows] - 1j * (np.sin(angle) @ residual[rows])
            total += gain.conj()[:, None] * wave
            power += np.abs(gain) ** 2 * len(w.place[rows])
        scores += np.sum(np.abs(total) ** 2, axis=1) / power
    return orders, scores


def _explained(block: Block, mode: AxialMode, solved: Projection, forces: Array) -> float:
    """Power of the residual that forces explain."""
    b = replace(make_block(block.name, block.windows, ripple=forces), counted=block.counted)
    columns = whiten(b, ripple_columns(b, mode), solved.free)
    to_basis = orthonormaliser(solved.products(columns, columns.shape[1]), _RANK_TOLERANCE)
    return float(np.sum((to_basis.T @ (columns.T @ solved.residual)) ** 2))
