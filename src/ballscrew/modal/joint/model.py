"""What each response owes to the axis: a few columns per block, whose weights are found linearly."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.columns import gathered
from ballscrew.modal.joint.kernel import GIVE, ring
from ballscrew.modal.joint.shape import Shape, damping, frequency, local
from ballscrew.modal.joint.whitening import prepare, ringing
from ballscrew.modal.joint.windows import Windows

__all__ = [
    "Block",
    "Linear",
    "block",
    "left_over",
    "linear",
    "orthonormal",
    "prepared",
    "raw_columns",
    "whitened",
]

_POOR = 1e-4  # of the largest singular value: columns below are told apart by nothing
_ROUNDING = 1e-13  # of what was to be explained: less is told by no difference
_MEMORY = 8  # samples back from which a residual is foretold


@dataclass(frozen=True, slots=True)
class Block:
    """One way from a drive to responses.

    Parameters
    ----------
    name : str
        ``"torque-nut"``, ``"motor-nut"`` or ``"torque-motor"``.
    windows : Windows
        The data.
    keep : ndarray of bool, shape (n,)
        Samples that count.
    filter : ndarray
        Whitens the residual; ``[1]`` for none.
    beside : ndarray, shape (n, columns)
        What the responses owe to the drive whatever the mode is.
    ripple : ndarray, shape (n, k)
        Forces that repeat with every turn, over the whole mass, m/s²: each of a size that is to be found.
    """

    name: str
    windows: Windows
    keep: NDArray[np.bool_]
    filter: Array
    beside: Array
    ripple: Array

    @property
    def mode(self) -> int:
        """Which mode it tells of: 0 with the rotor free, 1 with it held."""
        return 1 if self.name == "motor-nut" else 0

    @property
    def drive(self) -> Array:
        """What drives the spring, m/s²."""
        return self.windows.motor if self.name == "motor-nut" else self.windows.force

    @property
    def target(self) -> Array:
        """What is to be explained, shape (n, responses)."""
        w = self.windows
        return w.motor_band[:, None] if self.name == "torque-motor" else w.nut.T


@dataclass(frozen=True, slots=True)
class Linear:
    """A block with its linear part solved.

    Parameters
    ----------
    residual, columns, basis : ndarray
        Shape (n, responses), (n, columns), and the columns' orthonormal basis.
    raw : ndarray, shape (n, columns)
        The columns before they are whitened.
    weights : ndarray, shape (columns, responses)
        Of the columns.
    model : ndarray, shape (n, responses)
        What they make of the raw columns.
    rings : ndarray, shape (n, 2)
        Of each window the free ringing that it may begin with, orthonormal.
    wanted : ndarray, shape (n, responses)
        What was to be explained.
    """

    residual: Array
    columns: Array
    basis: Array
    raw: Array
    weights: Array
    model: Array
    rings: Array
    wanted: Array

    @property
    def total(self) -> float:
        """Sum of squares of what was to be explained."""
        return float(np.sum(self.wanted**2))


def block(name: str, w: Windows, whole: bool, ripple: Array | None = None) -> Block:
    """A block without whitening.

    Parameters
    ----------
    name : str
        As of :class:`Block`.
    w : Windows
        The data.
    whole : bool
        Whether departures count from standstill on.
    ripple : ndarray, shape (n, k), optional
        See :class:`Block`. What the motor's motion drives has it in that motion, and keeps none.

    Returns
    -------
    Block
        The force's own second derivative stands in it for the modes above the band. Where the motor answers,
        its acceleration is force less what the spring takes. The ripple is in it too as it comes in the band:
        with what the mode makes of it, that tells forces at the motor and forces at the nut.
    """
    keep = (w.early if whole else w.late).copy()
    for (start, stop), turning in zip(w.spans, w.turning, strict=True):
        if turning and not whole:
            keep[start:stop] = False
    none = np.empty((len(w.place), 0))
    if name == "motor-nut":
        return Block(name, w, keep, np.ones(1), none, none)
    ripple = none if ripple is None else ripple
    late = np.gradient(w.force_band)
    own = [np.gradient(late)]
    if name == "torque-motor":
        own = [w.force_band, late, *own]
    return Block(name, w, keep, np.ones(1), np.column_stack([*own, _in_band(w, ripple)]), ripple)


def raw_columns(b: Block, shape: Shape) -> Array:
    """What the responses are made of, shape (n, columns).

    The derivative is a delay; the second one the rise of the gain towards the next mode; what the pitching
    mode makes of it adds two. Then what the mode does not change: first what is there without ripple, then
    the ripple in the band. Last, what the mode makes of the ripple.
    """
    out, moved = _response(b, shape)
    nut = b.name != "torque-motor"
    columns = np.empty((out.shape[1], (5 if nut else 2) + b.beside.shape[1] + moved.shape[1]))
    gathered(out, b.beside, moved, nut, columns)
    return columns


def _response(b: Block, shape: Shape) -> tuple[Array, Array]:
    """The table's acceleration in the band, m/s².

    Parameters
    ----------
    b : Block
        Data.
    shape : Shape
        The mode.

    Returns
    -------
    ndarray, shape (2, n)
        Under the drive, and what pitches with it.
    ndarray, shape (n, k)
        Under each force of the ripple, per unit of it.
    """
    w = b.windows
    out = np.empty((2, len(w.place)))
    moved = np.empty(b.ripple.shape)
    form = np.array(
        [shape.compliance, shape.slope, shape.curve, shape.damping, shape.load, shape.share, shape.power]
    )
    pitch = np.array([2 * math.pi * min(shape.pitch, 0.45 * w.rate), shape.pitch_damping])
    ring(
        b.drive,
        w.place,
        local(shape, w.place),
        shape.rubbing * w.way,
        b.ripple,
        w.first,
        form,
        GIVE,
        pitch,
        w.band.numerator,
        w.band.denominator,
        1 / w.rate,
        out,
        moved,
    )
    return out, moved


def _in_band(w: Windows, pushes: Array) -> Array:
    from scipy.signal import sosfilt

    if not pushes.size:
        return pushes
    return np.concatenate([sosfilt(w.band.sections, pushes[start:stop], axis=0) for start, stop in w.spans])


def rings(b: Block, shape: Shape) -> Array:
    """Orthonormal free ringing of each window, from its first sample that counts."""
    w = b.windows
    out = np.empty((len(w.place), 2))
    begin = np.array([start + int(np.argmax(b.keep[start:stop])) for start, stop in w.spans])
    there = frequency(shape, w.place[begin])
    ringing(w.first, begin, 2 * math.pi * there, damping(shape, there), 1 / w.rate, b.filter, b.keep, out)
    return out


def prepared(b: Block, values: Array, free: Array) -> Array:
    """Whiten, keep what counts, and take each window's free ringing out."""
    out = np.empty(values.shape)
    prepare(np.ascontiguousarray(values), b.windows.first, b.filter, b.keep, free, out)
    return out


def linear(b: Block, shape: Shape, free: Array | None = None, raw: Array | None = None) -> Linear:
    """Solve for all that is linear.

    Parameters
    ----------
    b : Block
        Data.
    shape : Shape
        The mode.
    free : ndarray, optional
        The windows' free ringing; by default that of ``shape``.
    raw : ndarray, optional
        The columns of ``shape`` where they are known; see :func:`raw_columns`.

    Returns
    -------
    Linear
        The best weights and what they leave.
    """
    free = rings(b, shape) if free is None else free
    wanted = prepared(b, b.target, free)
    raw = raw_columns(b, shape) if raw is None else raw
    columns = prepared(b, raw, free)
    ways = orthonormal(columns.T @ columns, _POOR**2)
    basis = columns @ ways
    part = basis.T @ wanted
    weights = ways @ part
    left = wanted - basis @ part
    return Linear(left, columns, basis, raw, weights, raw @ weights, free, wanted)


def left_over(b: Block, shape: Shape, like: Linear) -> tuple[float, Array]:
    """What the best weights would leave: of :func:`linear` what a search looks at, in less time.

    Parameters
    ----------
    b : Block
        Data.
    shape : Shape
        The mode.
    like : Linear
        With the ringing that is taken out, and what is to be explained.

    Returns
    -------
    float
        Sum of squares, as far as a difference of powers tells it.
    ndarray, shape (n, columns)
        The columns before they are whitened.
    """
    raw = raw_columns(b, shape)
    columns = prepared(b, raw, like.rings)
    part = orthonormal(columns.T @ columns, _POOR**2).T @ (columns.T @ like.wanted)
    return max(like.total - float(np.sum(part**2)), _ROUNDING * like.total), raw


def orthonormal(square: Array, poor: float) -> Array:
    """What makes columns with these products orthonormal, shape (columns, rank).

    Parameters
    ----------
    square : ndarray, shape (columns, columns)
        The products.
    poor : float
        Of columns of length 1, part of the largest eigenvalue below which nothing tells them apart.
    """
    size = np.sqrt(np.maximum(np.diag(square), 0.0)) + 1e-300
    values, ways = np.linalg.eigh(square / np.outer(size, size))
    good = values > poor * values[-1]
    return np.asarray(ways[:, good] / np.sqrt(values[good]) / size[:, None])


def whitened(b: Block, residual: Array, floor: float) -> Block:
    """The block with a filter that makes its residual white in part.

    Parameters
    ----------
    b : Block
        Without a filter.
    residual : ndarray, shape (n, responses)
        Of it.
    floor : float
        White noise that is added before, as a part of the residual's power: without it what the model
        misses where there is little noise would count most.

    Returns
    -------
    Block
        With an autoregressive filter.
    """
    from scipy.linalg import solve_toeplitz

    lags = np.zeros(_MEMORY + 1)
    for start, stop in b.windows.spans:
        part = residual[start:stop]
        for k in range(_MEMORY + 1):
            lags[k] += np.sum(part[k:] * part[: len(part) - k])
    if not lags[0] > 0:
        return b
    lags[0] *= 1 + floor
    ahead = solve_toeplitz(lags[:_MEMORY], lags[1:])
    return replace(b, filter=np.concatenate([[1.0], -ahead]))
