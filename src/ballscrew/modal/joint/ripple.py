"""Forces of the motor that repeat with every turn, and that no channel tells.

Cogging, poles and slots push with whole orders of a turn, where the motor is, in every trip alike: repetition
does not average them out. The drive reports the torque that it makes of its currents, not this. While the
axis gains speed an order sweeps through the mode. A sine and a cosine an order drive the spring beside the
torque; their sizes are found with all else that is linear, anew at every step of the fit: what they make of
the response where the mode is 1 Hz off does not let it move to where it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.fit import FEWER
from ballscrew.modal.joint.model import block, linear, orthonormal, prepared, raw_columns
from ballscrew.modal.joint.shape import Shape
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.windows import Windows

__all__ = ["ALIKE", "of_orders", "orders", "turning"]

_HIGHEST = 36
_LEAST = 0.004  # of what is left: less moves no frequency
_CHANCE = 20.0  # of what one independent sample leaves: chance takes that off once in 2000 or less
_STANDS_OUT = 12.0  # times what half of the orders take off: what is left is no white noise
_MOST = 5  # orders
ALIKE = 1e-6
"""Of the largest eigenvalue: columns below are told apart by nothing."""


def turning(trips: Sequence[TripSignals], w: Windows, lead: float) -> Array:
    """Cosine and sine of the orders of a turn, averaged over the trips as all else is.

    Parameters
    ----------
    trips : sequence of TripSignals
        The run.
    w : Windows
        Its averages.
    lead : float
        Way of a turn, m; 0 where nobody said.

    Returns
    -------
    ndarray, shape (n, orders, 2)
        From the first order on; each is 0 where a window starts. None without a lead.
    """
    if not lead > 0:
        return np.empty((len(w.place), 0, 2))
    out = np.empty((len(w.place), _HIGHEST, 2))
    for (start, stop), pieces in zip(w.spans, w.pieces, strict=True):
        total = np.zeros((stop - start, _HIGHEST), complex)
        for trip, first in pieces:
            place = trips[trip].position[first : first + stop - start]
            once = np.exp(2j * math.pi / lead * place)
            total += np.cumprod(np.repeat(once[:, None], _HIGHEST, axis=1), axis=1)
        mean = (total - total[0]) / len(pieces)
        out[start:stop, :, 0], out[start:stop, :, 1] = mean.real, mean.imag
    return out


def orders(name: str, w: Windows, whole: bool, shape: Shape, turns: Array) -> tuple[int, ...]:
    """Orders that explain something of what a block leaves without them.

    Parameters
    ----------
    name, w, whole
        Of the block, as for :func:`~ballscrew.modal.joint.model.block`; one that the torque drives.
    shape : Shape
        The mode, as far as it is known.
    turns : ndarray, shape (n, orders, 2)
        See :func:`turning`.

    Returns
    -------
    tuple of int
        Ascending; each explains something beside those that explain more.
    """
    count = turns.shape[1]
    if count == 0:
        return ()
    b = block(name, w, whole)
    solved = linear(b, shape)
    left, basis = solved.residual, solved.basis
    least = max(_LEAST, _CHANCE * FEWER / max(int(b.keep.sum()), 1)) * float(np.sum(left**2))
    made = raw_columns(block(name, w, whole, turns.reshape(len(turns), 2 * count)), shape)
    every = prepared(b, made[:, solved.raw.shape[1] :], solved.rings)
    every -= basis @ (basis.T @ every)
    of_order = np.arange(every.shape[1]).reshape(-1, count, 2).transpose(1, 0, 2).reshape(count, -1)
    # All that follows needs of the columns but their products.
    square, part = every.T @ every, every.T @ left
    found: list[int] = []
    while len(found) < _MOST:
        ways = {
            k: orthonormal(square[np.ix_(at, at)], ALIKE)
            for k, at in enumerate(of_order)
            if k + 1 not in found
        }
        gains = {k: float(np.sum((way.T @ part[of_order[k]]) ** 2)) for k, way in ways.items()}
        best = max(gains, key=lambda k: gains[k])
        if gains[best] < max(least, _STANDS_OUT * float(np.median(list(gains.values())))):
            break
        found.append(best + 1)
        beside, along = ways[best].T @ square[of_order[best]], ways[best].T @ part[of_order[best]]
        square, part = square - beside.T @ beside, part - beside.T @ along
    return tuple(sorted(found))


def of_orders(turns: Array, found: Sequence[int]) -> Array:
    """Of the orders of a turn those that were found, shape (n, k)."""
    picked = turns[:, [k - 1 for k in found]]
    return np.ascontiguousarray(picked.reshape(len(turns), 2 * len(found)))
