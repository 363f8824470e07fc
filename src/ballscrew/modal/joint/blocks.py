"""Linear part of the model: each response as a sum of a few columns that the mode determines.

A block is one drive with its responses. Given the mode, the weights of its columns are a linear least-squares
problem; fitting the mode then minimises what this projection leaves (variable projection, Golub and Pereyra).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.compiled import (
    SOFTENING,
    fill_columns,
    free_responses,
    pitching_response,
    simulate_mode,
    whiten_windows,
)
from ballscrew.modal.joint.mode import AxialMode, damping_ratio, local_compliance, mode_frequency
from ballscrew.modal.joint.windows import Windows

ROTOR_FREE, ROTOR_HELD = 0, 1
"""Indices of the two modes: rotor free, and rotor held."""
_RANK = 1e-4  # of the largest singular value: smaller ones of the columns are taken for rounding
_ROUNDING = 1e-13  # of the target's power: smaller differences of powers are rounding
_ORDER = 8  # of the autoregressive model of a residual


@dataclass(frozen=True, slots=True)
class Block:
    """One way from a drive to responses.

    Parameters
    ----------
    name : str
        ``"torque-nut"``, ``"motor-nut"`` or ``"torque-motor"``.
    windows : Windows
        The data.
    counted : ndarray of bool, shape (n,)
        Samples that count.
    filter : ndarray
        Whitens the residual; ``[1]`` for none.
    known : ndarray, shape (n, columns)
        Columns that do not depend on the mode.
    ripple : ndarray, shape (n, k)
        Forces that repeat with every turn, over the total inertia, m/s²: their amplitudes are fitted.
    """

    name: str
    windows: Windows
    counted: NDArray[np.bool_]
    filter: Array
    known: Array
    ripple: Array

    @property
    def mode_index(self) -> int:
        """Mode excited: :data:`ROTOR_FREE` by the torque, :data:`ROTOR_HELD` by the motor's motion."""
        return ROTOR_HELD if self.name == "motor-nut" else ROTOR_FREE

    @property
    def drive(self) -> Array:
        """Drive of the spring, m/s²."""
        return self.windows.motor if self.mode_index == ROTOR_HELD else self.windows.force

    @property
    def target(self) -> Array:
        """Responses to be explained, shape (n, responses)."""
        if self.name == "torque-motor":
            return self.windows.motor_band[:, None]
        return self.windows.nut.T

    @property
    def rows(self) -> list[slice]:
        """Rows of each window in a flattened residual of all responses."""
        width = self.target.shape[1]
        return [slice(start * width, stop * width) for start, stop in self.windows.spans]


@dataclass(frozen=True, slots=True)
class Projection:
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
        Raw columns times weights.
    free : ndarray, shape (n, 2)
        Free response with which each window may begin, orthonormal.
    target : ndarray, shape (n, responses)
        Whitened responses.
    """

    residual: Array
    columns: Array
    basis: Array
    raw: Array
    weights: Array
    model: Array
    free: Array
    target: Array

    @property
    def total(self) -> float:
        """Sum of squares of the target."""
        return float(np.sum(self.target**2))

    @property
    def unexplained(self) -> float:
        """Part of the power of the target that is not explained."""
        return float(np.sum(self.residual**2)) / max(self.total, 1e-300)


@dataclass(frozen=True, slots=True)
class Simulation:
    """Response of the axial mode to the drive of a block.

    Parameters
    ----------
    response : ndarray, shape (n,)
        Acceleration of the table in the band, m/s².
    to_ripple : ndarray, shape (n, k)
        The same under each force of the ripple, m/s².
    """

    response: Array
    to_ripple: Array


def make_block(name: str, w: Windows, *, departures: bool, ripple: Array | None = None) -> Block:
    """A block without whitening.

    The second derivative of the force is a column for the modes above the band. The acceleration of the motor
    is the force less that of the spring, so the force is one of its columns. The ripple is a column in the
    band as well as through the mode, which separates forces at the motor from forces at the nut.

    Parameters
    ----------
    name : str
        As of :class:`Block`.
    w : Windows
        The data.
    departures : bool
        Whether departures count from standstill on.
    ripple : ndarray, shape (n, k), optional
        See :class:`Block`. The motor's motion contains the ripple, so a block driven by it has none.

    Returns
    -------
    Block
        With a filter that changes nothing.
    """
    counted = w.from_rest.copy()
    if not departures:
        counted = w.in_motion.copy()
        for (start, stop), reversing in zip(w.spans, w.reversing, strict=True):
            if reversing:
                counted[start:stop] = False
    none = np.empty((len(w.place), 0))
    if name == "motor-nut":
        return Block(name, w, counted, np.ones(1), none, none)
    if ripple is None:
        ripple = none
    first = np.gradient(w.force_band)
    known = [np.gradient(first)]
    if name == "torque-motor":
        known = [w.force_band, first, *known]
    return Block(name, w, counted, np.ones(1), np.column_stack([*known, _in_band(w, ripple)]), ripple)


def simulate(b: Block, mode: AxialMode) -> Simulation:
    """Response of the axial mode to the drive of a block; the pitching mode does not matter."""
    w = b.windows
    response, to_ripple = np.empty(len(w.place)), np.empty(b.ripple.shape)
    parameters = np.array(
        [mode.compliance, mode.slope, mode.curve, mode.damping, mode.load, mode.nut_share, mode.power]
    )
    simulate_mode(
        b.drive,
        w.place,
        local_compliance(mode, w.place),
        mode.friction * w.direction,
        b.ripple,
        w.first,
        parameters,
        SOFTENING,
        w.band.numerator,
        w.band.denominator,
        1 / w.rate,
        response,
        to_ripple,
    )
    return Simulation(response, to_ripple)


def raw_columns(b: Block, mode: AxialMode, simulation: Simulation | None = None) -> Array:
    """Columns of a block before whitening, shape (n, columns).

    Acceleration of the table, and its derivative for a delay; at the nut also its second derivative, for the
    rise of the gain towards the next mode, and the pitching mode with its derivative. Then the columns that
    do not depend on the mode, the ripple in the band among them. Last, the response of the mode to ripple.
    """
    if simulation is None:
        simulation = simulate(b, mode)
    w = b.windows
    own, pitching = 2, np.empty(0)
    if b.name != "torque-motor":
        own, pitching = 5, np.empty(len(w.place))
        angular = 2 * math.pi * min(mode.pitch, 0.45 * w.rate)
        pitching_response(simulation.response, w.first, angular, mode.pitch_damping, 1 / w.rate, pitching)
    columns = np.empty((len(w.place), own + b.known.shape[1] + b.ripple.shape[1]))
    fill_columns(simulation.response, pitching, b.known, simulation.to_ripple, columns)
    return columns


def raw_columns_of(blocks: Sequence[Block], modes: Sequence[AxialMode]) -> list[Array]:
    """Columns of each block before whitening; blocks with the same drive share its simulation.

    Parameters
    ----------
    blocks : sequence of Block
        Of the same windows and ripple.
    modes : sequence of AxialMode
        The mode of each.
    """
    simulations: dict[tuple[int, AxialMode], Simulation] = {}
    out = []
    for b, mode in zip(blocks, modes, strict=True):
        drive = (b.mode_index, mode)
        if drive not in simulations:
            simulations[drive] = simulate(b, mode)
        out.append(raw_columns(b, mode, simulations[drive]))
    return out


def _in_band(w: Windows, forces: Array) -> Array:
    from scipy.signal import sosfilt

    if not forces.size:
        return forces
    return np.concatenate([sosfilt(w.band.sections, forces[start:stop], axis=0) for start, stop in w.spans])


def _free_responses(b: Block, mode: AxialMode) -> Array:
    """Orthonormal free response of each window, from its first sample that counts."""
    w = b.windows
    out = np.empty((len(w.place), 2))
    begin = np.array([start + int(np.argmax(b.counted[start:stop])) for start, stop in w.spans])
    f = mode_frequency(mode, w.place[begin])
    zeta = damping_ratio(mode, f)
    free_responses(w.first, begin, 2 * math.pi * f, zeta, 1 / w.rate, b.filter, b.counted, out)
    return out


def whiten(b: Block, values: Array, free: Array) -> Array:
    """Signals whitened, 0 at samples that do not count, without the free response of each window."""
    out = np.empty(values.shape)
    whiten_windows(np.ascontiguousarray(values), b.windows.first, b.filter, b.counted, free, out)
    return out


def project(b: Block, mode: AxialMode, free: Array | None = None, raw: Array | None = None) -> Projection:
    """Solve the linear part of a block.

    Parameters
    ----------
    b : Block
        Data.
    mode : AxialMode
        The mode.
    free : ndarray, optional
        Free response of the windows; by default that of ``mode``.
    raw : ndarray, optional
        The columns of ``mode`` if they are known; see :func:`raw_columns`.

    Returns
    -------
    Projection
        The best weights and the residual.
    """
    if free is None:
        free = _free_responses(b, mode)
    target = whiten(b, b.target, free)
    if raw is None:
        raw = raw_columns(b, mode)
    columns = whiten(b, raw, free)
    to_basis = orthonormaliser(columns.T @ columns, _RANK**2)
    basis = columns @ to_basis
    part = basis.T @ target
    weights = to_basis @ part
    return Projection(target - basis @ part, columns, basis, raw, weights, raw @ weights, free, target)


def remaining_power(b: Block, raw: Array, reference: Projection) -> float:
    """Sum of squares of the residual, in less time than by :func:`project`.

    Parameters
    ----------
    b : Block
        Data.
    raw : ndarray, shape (n, columns)
        Columns of the mode; see :func:`raw_columns`.
    reference : Projection
        With the free response that is removed, and the target.

    Returns
    -------
    float
        To the accuracy of a difference of powers.
    """
    columns = whiten(b, raw, reference.free)
    part = orthonormaliser(columns.T @ columns, _RANK**2).T @ (columns.T @ reference.target)
    return max(reference.total - float(np.sum(part**2)), _ROUNDING * reference.total)


def orthonormaliser(square: Array, rank: float) -> Array:
    """Matrix that makes columns with these products orthonormal, shape (columns, rank).

    Parameters
    ----------
    square : ndarray, shape (columns, columns)
        The products.
    rank : float
        Part of the largest eigenvalue below which others count as zero, for columns of length 1.
    """
    length = np.sqrt(np.maximum(np.diag(square), 0.0)) + 1e-300
    values, vectors = np.linalg.eigh(square / np.outer(length, length))
    good = values > rank * values[-1]
    return np.asarray(vectors[:, good] / np.sqrt(values[good]) / length[:, None])


def with_whitening(b: Block, residual: Array, floor: float) -> Block:
    """The block with a filter that makes its residual partly white.

    Parameters
    ----------
    b : Block
        Without a filter.
    residual : ndarray, shape (n, responses)
        Residual of the block without a filter.
    floor : float
        White noise added before, as a part of the residual's power: without it model errors would count most
        at frequencies with little noise.

    Returns
    -------
    Block
        With an autoregressive filter.
    """
    from scipy.linalg import solve_toeplitz

    lags = np.zeros(_ORDER + 1)
    for start, stop in b.windows.spans:
        part = residual[start:stop]
        for k in range(_ORDER + 1):
            lags[k] += np.sum(part[k:] * part[: len(part) - k])
    if not lags[0] > 0:
        return b
    lags[0] *= 1 + floor
    coefficients = solve_toeplitz(lags[:_ORDER], lags[1:])
    return replace(b, filter=np.concatenate([[1.0], -coefficients]))
