"""Passing balls: a force at the nut whose order, in periods per turn, is not a whole number.

Balls that enter and leave the loaded zone push the nut, with a phase that depends on the trip and on the
direction of motion. At full speed their force is a tone. If its frequency is near the mode, it excites the
mode, at neighbouring stops in the same way, so that the scatter of the cells does not contain the error that
it causes. It is fitted like the ripple, with a cosine and a sine for each direction.
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

# The force is significant if the power of the residual that it explains exceeds each of these. They have the
# reasons of those in ballscrew.modal.joint.ripple, with twice the columns and many orders tried.
_LEAST_POWER = 0.004  # over the power of the residual
_CHANCE = 40.0  # over the mean power of an independent sample
_OUTSTANDING = 12.0  # over the power that the median order explains

_NEAR = (0.7, 1.25)  # range of the frequency at full speed, over the frequencies of the mode along the axis
_STEP = 3.0  # number of orders tried within the resolution of orders, which is 1 / (turns along the axis)
_REFINED = np.linspace(-0.5, 0.5, 9)  # orders tried around the best of the first ones, over the resolution
# Step of the samples that the search uses. At 16 samples per period of the mode, the default, the band
# ends below half of the resulting rate.
_EVERY = 3
_RANK_TOLERANCE = 1e-6  # over the largest eigenvalue of AᵀA of the columns A: smaller are rounding errors


def ball_forces(w: Windows, lead: float, order: float | None) -> Array:
    """Cosine and sine of an order for each direction of motion.

    Parameters
    ----------
    w : Windows
        Averaged windows.
    lead : float
        Travel per turn of the motor, m.
    order : float or None
        Periods per turn; None for no force.

    Returns
    -------
    ndarray, shape (n, 4)
        As ``balls`` of :func:`~ballscrew.modal.joint.blocks.make_block`; shape (n, 2) if all windows have the
        same direction, and (n, 0) without an order.
    """
    if order is None:
        return np.empty((len(w.centred_position), 0))
    angle = 2 * math.pi * order / lead * w.centred_position
    columns = []
    for sign in np.unique(w.direction):
        columns += [np.cos(angle) * (w.direction == sign), np.sin(angle) * (w.direction == sign)]
    return np.column_stack(columns)


def find_balls(
    name: str, w: Windows, mode: AxialMode, lead: float, ripple: Array, *, from_rest: bool = False
) -> float | None:
    """Find the order of the balls' force, if it explains a significant part of the residual.

    Parameters
    ----------
    name, w, from_rest, mode
        As for :func:`~ballscrew.modal.joint.ripple.select_orders`.
    lead : float
        Travel per turn of the motor, m.
    ripple : ndarray, shape (n, k)
        Cosine and sine of the whole orders that are fitted.

    Returns
    -------
    float or None
        Periods per turn, found by a filter that is matched to the response of each cell at full speed, then
        refined; None if no order is significant.
    """
    turns = float(np.ptp(w.centred_position)) / lead  # along the axis
    b = make_block(name, w, from_rest=from_rest, ripple=ripple)
    projection = project(b, mode)
    orders, scores = _matched_scores(w, mode, lead, turns, projection.residual)
    if not len(orders):
        return None
    best = int(np.argmax(scores))
    if scores[best] < _OUTSTANDING * float(np.median(scores)):
        return None
    near = np.round(orders[best] + _REFINED / turns, 4).tolist()
    gains = [_explained(b, mode, projection, ball_forces(w, lead, order)) for order in near]
    independent = max(int(b.counted.sum()), 1) / SAMPLES_PER_INDEPENDENT
    least = max(_LEAST_POWER, _CHANCE / independent) * float(np.sum(projection.residual**2))
    if max(gains) < least:
        return None
    return float(near[int(np.argmax(gains))])


def _matched_scores(
    w: Windows, mode: AxialMode, lead: float, turns: float, residual: Array
) -> tuple[Array, Array]:
    """Orders between whole ones, and approximately the power of the residual that each explains.

    At full speed the force is a tone, and the response to it in a cell has the gain and the phase of the
    resonance there; the tone is assumed over the whole window. Orders nearer to a whole one than the
    resolution are excluded. ``turns`` is the number of turns along the axis. Both results have the shape
    (orders,).
    """
    speeds = np.array([np.abs(w.speed[start:stop]).max() for start, stop in w.spans]) / lead  # turns/s
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
            # In the negative direction the angle of the force falls with time, so the phase changes its sign.
            gain = 1 / (1 - ratio**2 + 2j * sign * damping[cell] * ratio)
            periods = np.outer(orders, w.centred_position[rows] / lead)
            # The cosine of an angle in single precision takes a third of the time.
            angle = (2 * math.pi * (periods - np.round(periods))).astype(np.float32)
            wave = np.cos(angle) @ residual[rows] - 1j * (np.sin(angle) @ residual[rows])
            total += gain.conj()[:, None] * wave
            power += np.abs(gain) ** 2 * len(w.centred_position[rows])
        scores += np.sum(np.abs(total) ** 2, axis=1) / power
    return orders, scores


def _explained(block: Block, mode: AxialMode, projection: Projection, forces: Array) -> float:
    """Power of the residual of a projection, of this block and mode, that forces, shape (n, k), explain."""
    b = replace(make_block(block.name, block.windows, ripple=forces), counted=block.counted)
    columns = whiten(b, ripple_columns(b, mode), projection.free_vibration)
    to_basis = orthonormaliser(projection.products(columns, columns.shape[1]), _RANK_TOLERANCE)
    return float(np.sum((to_basis.T @ (columns.T @ projection.residual)) ** 2))
