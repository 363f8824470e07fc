"""Forces of the motor that repeat with every turn, and that no channel tells: found, and taken off.

Cogging, poles and slots push with whole orders of a turn. The drive reports the torque that it makes of its
currents, not this. While the axis gains speed an order sweeps through the mode, at the same places in every
trip, so that repetitions do not average it out. A sine and a cosine an order tell it, in each trip anew.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.modal.joint.fit import Fit
from ballscrew.modal.joint.model import Block, Linear, Shape, linear, prepared, response
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.windows import Windows, of_trip

__all__ = ["without_ripple"]

Array = NDArray[np.float64]
_HIGHEST = 36
_LEAST = 0.004  # of what is left; chance takes off a tenth of it
_MOST = 6
_LOOKED_AT = 4  # trips in which orders are sought


def without_ripple(trips: Sequence[TripSignals], now: Fit, mass: float, lead: float) -> Windows | None:
    """Take the motor's ripple off the responses, trip by trip, and average again.

    Parameters
    ----------
    trips : sequence of TripSignals
        The run.
    now : Fit
        What is known of the mode so far; of its blocks those count that the torque drives.
    mass : float
        Whole mass, in units of force per m/s².
    lead : float
        Way of a turn, m.

    Returns
    -------
    Windows or None
        None where no order stands out.
    """
    w = now.blocks[0].windows
    used = sorted({trip for cell in w.pieces for trip, _ in cell})
    alone = {trip: of_trip(trips, w, trip, mass) for trip in used}
    pairs = [(b, s) for b, s in zip(now.blocks, now.shapes, strict=True) if b.mode == 0]
    looked = [_of(alone[trip], *pairs[0]) for trip in used[:: max(1, len(used) // _LOOKED_AT)]]
    found = _orders(looked, pairs[0][1], lead)
    if not found:
        return None
    nut, motor = w.nut.copy(), w.motor_band.copy()
    for trip, one in alone.items():
        for b, shape in pairs:
            off = _made(_of(one, b, shape), shape, found, lead)
            into = motor[None] if b.name == "torque-motor" else nut
            _subtract(into, off, w, one, trip)
    return replace(w, nut=nut, motor_band=motor)


def _of(one: Windows, b: Block, shape: Shape) -> tuple[Block, Linear]:
    """A block with the windows of one trip."""
    taken = {cell: i for i, cell in enumerate(b.windows.cells)}
    spans = b.windows.spans
    keep = np.concatenate([b.keep[slice(*spans[taken[cell]])] for cell in one.cells])
    own = replace(b, windows=one, keep=keep)
    return own, linear(own, shape)


def _orders(looked: Sequence[tuple[Block, Linear]], shape: Shape, lead: float) -> tuple[int, ...]:
    """Orders that explain something of what is left, the strongest first, each beside those before it."""
    left = [solved.residual for _, solved in looked]
    whole = sum(float(np.sum(r**2)) for r in left)
    pairs: dict[int, list[Array]] = {}
    for k in range(1, _HIGHEST + 1):
        columns = [prepared(b, _columns(b, shape, (k,), lead), solved.rings) for b, solved in looked]
        pairs[k] = [c - s.basis @ (s.basis.T @ c) for c, (_, s) in zip(columns, looked, strict=True)]
    found: list[int] = []
    while len(found) < _MOST and pairs:
        ways = {k: [_basis(c) for c in columns] for k, columns in pairs.items()}
        gains = {
            k: sum(float(np.sum((q.T @ r) ** 2)) for q, r in zip(each, left, strict=True))
            for k, each in ways.items()
        }
        best = max(gains, key=lambda k: gains[k])
        if gains[best] < _LEAST * whole:
            break
        found.append(best)
        left = [r - q @ (q.T @ r) for q, r in zip(ways[best], left, strict=True)]
        pairs = {
            k: [c - q @ (q.T @ c) for q, c in zip(ways[best], columns, strict=True)]
            for k, columns in pairs.items()
            if k != best
        }
    return tuple(found)


def _basis(pair: Array) -> Array:
    size = np.sqrt(np.sum(pair**2, axis=0)) + 1e-300
    ways, turned, _ = np.linalg.svd(pair / size, full_matrices=False)
    return np.asarray(ways[:, turned > 1e-3])


def _made(of: tuple[Block, Linear], shape: Shape, found: Sequence[int], lead: float) -> Array:
    """What the ripple made of a trip's responses, shape (responses, n)."""
    b, solved = of
    raw = _columns(b, shape, found, lead)
    columns = prepared(b, raw, solved.rings)
    columns -= solved.basis @ (solved.basis.T @ columns)
    weights = np.linalg.lstsq(columns, solved.residual, rcond=1e-4)[0]
    return np.asarray((raw @ weights).T)


def _subtract(into: Array, off: Array, w: Windows, one: Windows, trip: int) -> None:
    """Take one trip's part of an average off, in place."""
    at = {cell: i for i, cell in enumerate(one.cells)}
    for i, cell in enumerate(w.cells):
        share = sum(t == trip for t, _ in w.pieces[i]) / len(w.pieces[i])
        if share:
            into[:, slice(*w.spans[i])] -= share * off[:, slice(*one.spans[at[cell]])]


def _columns(b: Block, shape: Shape, found: Sequence[int], lead: float) -> Array:
    """Of each order what a sine and a cosine make of the responses, shape (n, columns)."""
    w = b.windows
    angle = 2 * math.pi / lead * w.place
    out = []
    for k in found:
        for wave in (np.cos(k * angle), np.sin(k * angle)):
            push = wave - np.repeat(wave[w.first[:-1]], np.diff(w.first))
            out.append(response(b, replace(shape, load=0.0), push)[0])
            if b.name == "torque-motor":
                out.append(_in_band(w, push))
    return np.stack(out, axis=1)


def _in_band(w: Windows, x: Array) -> Array:
    from scipy.signal import sosfilt

    sections = np.hstack([w.band.numerator, np.ones((len(w.band.numerator), 1)), w.band.denominator])
    return np.concatenate([sosfilt(sections, x[start:stop]) for start, stop in w.spans])
