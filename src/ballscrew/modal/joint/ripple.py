"""Forces of the motor that repeat with every turn, and that no channel tells.

Cogging, poles and slots push with whole orders of a turn. The drive reports the torque that it makes of its
currents, not this. While the axis gains speed an order sweeps through the mode; repetitions do not average
it out where its phase is the same in every trip. A sine and a cosine an order tell it; where trips differ, or
their phases do, as many a trip, of which those are kept that an average over trips leaves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.modal.joint.fit import FEWER, Fit
from ballscrew.modal.joint.model import Block, Shape, prepared, response
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.windows import Windows, of_trip

__all__ = ["rippled"]

Array = NDArray[np.float64]
_HIGHEST = 36
_LEAST = 0.004  # of what is left: less moves no frequency
_CHANCE = 20.0  # of what one independent sample leaves, which a pair takes off by chance once in 20 000
_MOST = 5  # orders
_SMALL = 0.2  # of an order's largest column: what trips add below it is left out
_WIDEST = 8  # columns of an order
_TRIPS = 6  # from which the ways are taken in which trips differ


def rippled(trips: Sequence[TripSignals], now: Fit, mass: float, lead: float) -> list[Block]:
    """Blocks with columns for the motor's ripple, where some stands out.

    Parameters
    ----------
    trips : sequence of TripSignals
        The run.
    now : Fit
        What is known of the mode so far. The ripple is small: its columns need not follow a later fit.
    mass : float
        Whole mass, in units of force per m/s².
    lead : float
        Way of a turn, m.

    Returns
    -------
    list of Block
        Those that the motor's motion drives as they were: it has the ripple in it.
    """
    w = now.blocks[0].windows
    used = sorted({trip for cell in w.pieces for trip, _ in cell})
    step = -(-len(used) // _TRIPS)
    alone = [of_trip(trips, w, trip, mass) for trip in used[::step]]
    found = _orders(now, lead)
    out = []
    for b, shape in zip(now.blocks, now.shapes, strict=True):
        if b.mode or not found:
            out.append(b)
            continue
        columns = [_averaged(b, shape, k, lead, alone) for k in found]
        out.append(replace(b, ripple=np.concatenate(columns, axis=1)))
    return out


def _orders(now: Fit, lead: float) -> tuple[int, ...]:
    """Orders that explain something of what is left, the strongest first, each beside those before it."""
    b, shape, solved = now.blocks[0], now.shapes[0], now.solved[0]
    left, basis = solved.residual, solved.basis
    least = max(_LEAST, _CHANCE * FEWER / max(int(b.keep.sum()), 1)) * float(np.sum(left**2))
    pairs = {}
    for k in range(1, _HIGHEST + 1):
        pair = prepared(b, _columns(b, shape, k, lead), solved.rings)
        pairs[k] = pair - basis @ (basis.T @ pair)
    found: list[int] = []
    while len(found) < _MOST:
        ways = {k: _basis(pair) for k, pair in pairs.items()}
        gains = {k: float(np.sum((q.T @ left) ** 2)) for k, q in ways.items()}
        best = max(gains, key=lambda k: gains[k])
        if gains[best] < least:
            break
        found.append(best)
        q = ways[best]
        left = left - q @ (q.T @ left)
        pairs = {k: pair - q @ (q.T @ pair) for k, pair in pairs.items() if k != best}
    return tuple(found)


def _basis(pair: Array) -> Array:
    size = np.sqrt(np.sum(pair**2, axis=0)) + 1e-300
    ways, turned, _ = np.linalg.svd(pair / size, full_matrices=False)
    return np.asarray(ways[:, turned > 1e-3])


def _averaged(b: Block, shape: Shape, order: int, lead: float, alone: Sequence[Windows]) -> Array:
    """Columns of an order in the average over trips, each trip with a phase of its own."""
    w = b.windows
    at = {cell: i for i, cell in enumerate(w.cells)}
    parts = []
    for one in alone:
        made = _columns(replace(b, windows=one), shape, order, lead)
        part = np.zeros((len(w.place), made.shape[1]))
        for cell, (start, stop) in zip(one.cells, one.spans, strict=True):
            i = at[cell]
            part[slice(*w.spans[i])] = made[start:stop] / w.repetitions[i]
        parts.append(part)
    every = np.concatenate(parts, axis=1)
    size, ways = np.linalg.eigh(every.T @ every)
    good = np.flatnonzero(size > _SMALL**2 * size[-1])[-_WIDEST:]
    return np.asarray(every @ ways[:, good] / np.sqrt(size[good]))


def _columns(b: Block, shape: Shape, order: int, lead: float) -> Array:
    """What a sine and a cosine of an order make of the response, shape (n, columns)."""
    w = b.windows
    angle = 2 * math.pi * order / lead * w.place
    out = []
    for wave in (np.cos(angle), np.sin(angle)):
        push = wave - np.repeat(wave[w.first[:-1]], np.diff(w.first))
        out.append(response(b, replace(shape, load=0.0), push)[0])
        if b.name == "torque-motor":
            out.append(_in_band(w, push))
    return np.stack(out, axis=1)


def _in_band(w: Windows, x: Array) -> Array:
    from scipy.signal import sosfilt

    return np.concatenate([sosfilt(w.band.sections, x[start:stop]) for start, stop in w.spans])
