"""Linear part of the model: each response is a weighted sum of a few signals, the columns.

A block is one drive with its responses. For a given mode the columns are known, and their weights (gains,
delays, amplitudes of the ripple) follow from linear least squares. The fit of the mode then minimises the
residual of this projection (variable projection, Golub and Pereyra, 1973, doi:10.1137/0710036).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.columns import (
    BELOW_NYQUIST,
    MOTOR_MODE_COLUMNS,
    NUT_MODE_COLUMNS,
    differences,
    fill_columns,
    pitching_response,
)
from ballscrew.modal.joint.mode import AxialMode, coupled_poles, local_compliance, mode_frequency
from ballscrew.modal.joint.simulation import SOFTENING, pass_band, simulate_mode, simulation_parameters
from ballscrew.modal.joint.whitening import free_responses, whiten_windows, whitening_filter
from ballscrew.modal.joint.windows import Windows

ROTOR_FREE, ROTOR_HELD = 0, 1
"""Indices of the two modes: rotor free, and rotor held."""

# Over the largest singular value of the columns scaled to length 1: smaller ones are not counted in the rank.
_RANK_TOLERANCE = 1e-4
_ROUNDING = 1e-13  # over a power: smaller differences of two powers are rounding errors


@dataclass(frozen=True, slots=True)
class Block:
    """One drive with the responses that are explained by it; in this package a variable ``b`` is a block.

    Parameters
    ----------
    name : str
        Drive and response: ``"torque-nut"``, ``"motor-nut"`` or ``"torque-motor"``. The drive ``motor`` is
        the motor's measured motion.
    windows : Windows
        The signals of all cells.
    counted : ndarray of bool, shape (n,)
        Samples of the windows that enter the fit.
    taps : ndarray, shape (taps,)
        Coefficients of the filter that whitens the residual; ``[1]`` for none.
    fixed_columns : ndarray, shape (n, columns)
        Columns that do not depend on the mode, in the band, m/s², derivatives per sample; see
        :func:`make_block`.
    ripple : ndarray, shape (n, k)
        Cosines and sines of forces that repeat along the screw, first those of passing balls, then those of
        whole orders, as accelerations with an amplitude of 1 m/s²; their true amplitudes are fitted.
    stop : ndarray, shape (n,)
        :attr:`Windows.stop_of_sample <ballscrew.modal.joint.windows.Windows.stop_of_sample>`, m.
    """

    name: str
    windows: Windows
    counted: NDArray[np.bool_]
    taps: Array
    fixed_columns: Array
    ripple: Array
    stop: Array

    @property
    def mode_index(self) -> int:
        """Mode of the drive: :data:`ROTOR_FREE` for the torque, :data:`ROTOR_HELD` for the motor's motion."""
        return ROTOR_HELD if self.name == "motor-nut" else ROTOR_FREE

    @property
    def drive(self) -> Array:
        """Drive of the simulated mode, m/s², shape (n,): the motor's motion, or force over total inertia."""
        return self.windows.motor if self.mode_index == ROTOR_HELD else self.windows.force

    @property
    def target(self) -> Array:
        """Responses that the model is fitted to, in the band, m/s², shape (n, responses)."""
        if self.name == "torque-motor":
            return self.windows.motor_band[:, None]
        return self.windows.nut.T

    @property
    def rows(self) -> list[slice]:
        """Elements of each window in a residual of shape (n, responses) that was flattened."""
        width = self.target.shape[1]
        return [slice(start * width, stop * width) for start, stop in self.windows.spans]

    def mean_square(self, residual: Array) -> float:
        """Mean square of a residual, shape (n, ...), over the whole windows, as long as Windows.lengths.

        Their ends, which were cut off, count as 0.
        """
        return float(np.mean(residual**2)) * len(residual) / int(self.windows.lengths.sum())


@dataclass(frozen=True, slots=True)
class Projection:
    """Solution of the linear part of a block.

    A *whitened* signal is filtered by :attr:`Block.taps`, is 0 at samples that are not counted, and does not
    contain the free vibration with which its window may begin. Its unit is m/s².

    Parameters
    ----------
    residual : ndarray, shape (n, responses)
        Whitened responses less whitened model.
    columns : ndarray, shape (n, columns)
        Whitened columns.
    to_basis : ndarray, shape (columns, rank)
        ``columns`` times this matrix is an orthonormal basis.
    raw : ndarray, shape (n, columns)
        The columns before they are whitened.
    weights : ndarray, shape (columns, responses)
        Weights of the columns in each response.
    model : ndarray, shape (n, responses)
        Product of ``raw`` and ``weights``, m/s².
    free_vibration : ndarray, shape (n, 2 * modes)
        Free vibration with which each window may begin, filtered and orthonormal in each window.
    target : ndarray, shape (n, responses)
        Whitened responses.
    """

    residual: Array
    columns: Array
    to_basis: Array
    raw: Array
    weights: Array
    model: Array
    free_vibration: Array
    target: Array

    @property
    def total(self) -> float:
        """Power of the target: its sum of squares."""
        return float(np.sum(self.target**2))

    @property
    def unexplained(self) -> float:
        """Part of the power of the target that is not explained."""
        return float(np.sum(self.residual**2)) / max(self.total, 1e-300)

    def without_columns(self, values: Array) -> Array:
        """Whitened signals, shape (n, k), less their projection on the columns."""
        return values - self.columns @ (self.to_basis @ self._along_columns(values))

    def products(self, values: Array, count: int) -> Array:
        """AᵀA, where A are whitened signals less their projection on the columns.

        In less time than by :meth:`without_columns`.

        Parameters
        ----------
        values : ndarray, shape (n, responses * count)
            Whitened signals; ``count`` of them for each response.
        count : int
            Number of columns of A, whose rows are those of all responses.

        Returns
        -------
        ndarray, shape (count, count)
            With a small addition to the diagonal, so that rounding errors make no power negative.
        """
        along = self._along_columns(values).reshape(-1, count)
        values = values.reshape(-1, count)
        whole = values.T @ values
        rounding = _ROUNDING * np.diag(np.diag(whole))
        return whole - along.T @ along + rounding

    def _along_columns(self, values: Array) -> Array:
        """Coordinates of whitened signals in the basis of the columns, shape (rank, k)."""
        return self.to_basis.T @ (self.columns.T @ values)


@dataclass(frozen=True, slots=True)
class Simulation:
    """Response of the axial mode to the drive of a block, and to its ripple.

    Parameters
    ----------
    response : ndarray, shape (n,)
        Acceleration of the table in the band, m/s².
    ripple_response : ndarray, shape (n, k)
        The same by each force of :attr:`Block.ripple`, m/s².
    """

    response: Array
    ripple_response: Array


def make_block(
    name: str,
    w: Windows,
    *,
    from_rest: bool = False,
    ripple: Array | None = None,
    balls: Array | None = None,
) -> Block:
    """Make a block without whitening.

    Its fixed columns, in this order: for the motor's response the force and its derivative, since the torque
    accelerates the motor against the force of the spring; for a block that the torque drives the second
    derivative of the force, which stands for the modes above the band; and the ripple itself. Each force of
    the ripple also has a column that depends on the mode, the response of the mode to it. The weights of the
    two depend on where the force acts, at the motor or at the nut.

    Parameters
    ----------
    name : str
        As for :class:`Block`.
    w : Windows
        The signals of all cells.
    from_rest : bool
        Whether departures are fitted from standstill on. If not, they are fitted from the start of sliding,
        and not at all where the table departs against the direction of its arrival, since the guide then
        sticks longer.
    ripple : ndarray, shape (n, k), optional
        Forces at the motor, see :class:`Block`. A block that the motor's motion drives has none: that motion
        contains their effect.
    balls : ndarray, shape (n, k), optional
        Forces between screw and nut, whose effect the motor's motion does not contain.

    Returns
    -------
    Block
        With the taps ``[1]``.
    """
    counted = w.from_rest.copy()
    if not from_rest:
        counted = w.in_motion.copy()
        for (start, stop), reversing in zip(w.spans, w.reversing, strict=True):
            if reversing:
                counted[start:stop] = False
    no_forces = np.empty((len(w.centred_position), 0))
    if balls is None:
        balls = no_forces
    if ripple is None:
        ripple = no_forces
    if name == "motor-nut":
        return Block(name, w, counted, np.ones(1), _in_band(w, balls), balls, w.stop_of_sample)
    ripple = np.column_stack([balls, ripple])
    force_rate = differences(w.force_band, w.starts)
    columns = [differences(force_rate, w.starts)]
    if name == "torque-motor":
        columns = [w.force_band, force_rate, *columns]
    fixed_columns = np.column_stack([*columns, _in_band(w, ripple)])
    return Block(name, w, counted, np.ones(1), fixed_columns, ripple, w.stop_of_sample)


def simulate(b: Block, mode: AxialMode) -> Simulation:
    """Simulate the response of the axial mode to the drive of a block, without the pitching mode."""
    w = b.windows
    slow_load = mode.friction * w.direction + mode.guide_part * mode.viscous * w.speed + mode.weight
    if b.mode_index == ROTOR_FREE:
        slow_load -= w.drag  # the torque that overcomes friction does not load the nut
    response, ripple_response = np.empty(len(w.centred_position)), np.empty(b.ripple.shape)
    longest_first = np.argsort(w.starts[:-1] - w.starts[1:])  # by minus the length
    simulate_mode(
        b.drive,
        w.centred_position,
        local_compliance(mode, w.centred_position),
        slow_load,
        b.ripple,
        w.starts,
        longest_first,
        simulation_parameters(mode),
        SOFTENING,
        w.band.numerator,
        w.band.denominator,
        1 / w.rate,
        response,
        ripple_response,
    )
    return Simulation(response, ripple_response)


def raw_columns(b: Block, mode: AxialMode, simulation: Simulation | None = None) -> Array:
    """Columns of a block before whitening, shape (n, columns).

    In this order: the table's acceleration; its derivative, for a delay between the channels; for the
    accelerometers at the nut its second derivative, since their gain rises towards the next mode, and the
    response of the pitching mode with its derivative; the acceleration times the position of the stop, since
    the gain changes along the axis; :attr:`Block.fixed_columns`; the response of the mode to each force of
    :attr:`Block.ripple`.
    """
    if simulation is None:
        simulation = simulate(b, mode)
    w = b.windows
    pitching = pitching_of(b, mode, simulation)
    mode_columns = MOTOR_MODE_COLUMNS
    if len(pitching):
        mode_columns = NUT_MODE_COLUMNS
    count = mode_columns + b.fixed_columns.shape[1] + b.ripple.shape[1]
    columns = np.empty((len(w.centred_position), count))
    fill_columns(
        simulation.response,
        pitching,
        b.fixed_columns,
        simulation.ripple_response,
        b.stop,
        w.starts,
        columns,
    )
    return columns


def pitching_of(b: Block, mode: AxialMode, simulation: Simulation) -> Array:
    """Response of the pitching mode, m/s², shape (n,); shape (0,) for the motor, which does not pitch."""
    if b.name == "torque-motor":
        return np.empty(0)
    w, out = b.windows, np.empty(len(b.windows.centred_position))
    angular = _pitch_angular(mode, w)
    pitching_response(simulation.response, w.starts, angular, mode.pitch_damping, 1 / w.rate, out)
    return out


def ripple_columns(b: Block, mode: AxialMode) -> Array:
    """The last of :func:`raw_columns`: the ripple in the band, and the response of the mode to it.

    Shape (n, 2 * k) for k forces.
    """
    first = b.fixed_columns.shape[1] - b.ripple.shape[1]  # the ripple in the band is the last part of them
    return np.hstack([b.fixed_columns[:, first:], simulate(b, mode).ripple_response])


def raw_columns_of(blocks: Sequence[Block], modes: Sequence[AxialMode]) -> list[Array]:
    """Columns of each block before whitening; blocks with the same drive share its simulation.

    Parameters
    ----------
    blocks : sequence of Block
        Those with the same drive have the same windows and ripple.
    modes : sequence of AxialMode
        One per block.

    Returns
    -------
    list of ndarray, shape (n, columns)
        As of :func:`raw_columns`, one per block.
    """
    simulations = simulations_of(blocks, modes)
    return [raw_columns(*each) for each in zip(blocks, modes, simulations, strict=True)]


def simulations_of(blocks: Sequence[Block], modes: Sequence[AxialMode]) -> list[Simulation]:
    """Simulation of each block; those with the same drive and mode share it."""
    simulations: dict[tuple[int, AxialMode], Simulation] = {}  # the index of the mode determines the drive
    out = []
    for b, mode in zip(blocks, modes, strict=True):
        key = (b.mode_index, mode)
        if key not in simulations:
            simulations[key] = simulate(b, mode)
        out.append(simulations[key])
    return out


def _in_band(w: Windows, forces: Array) -> Array:
    """Forces, shape (n, k), after the filter of the band, which begins each window at rest."""
    filtered = np.array(forces, order="C")  # always this layout: pass_band is compiled anew for another
    if filtered.size:
        pass_band(w.starts, w.band.numerator, w.band.denominator, filtered)
    return filtered


def _pitch_angular(mode: AxialMode, w: Windows) -> float:
    """Angular frequency of the pitching mode, rad/s, below the Nyquist frequency."""
    return 2 * math.pi * min(mode.pitch, BELOW_NYQUIST * w.rate)


def _free_responses(b: Block, mode: AxialMode) -> Array:
    """Free vibration of each window from its first counted sample on, filtered and orthonormal.

    Shape (n, 2 * modes). The modes are the axial mode, that of a frame that moves, and in responses of the
    nut the pitching mode: the table may already pitch when a window begins.
    """
    w = b.windows
    begin = np.array([start + int(np.argmax(b.counted[start:stop])) for start, stop in w.spans])
    omega, zeta = coupled_poles(mode, mode_frequency(mode, w.centred_position[begin]))
    if b.name != "torque-motor":
        omega = np.column_stack([omega, np.full(len(begin), _pitch_angular(mode, w))])
        zeta = np.column_stack([zeta, np.full(len(begin), mode.pitch_damping)])
    out = np.empty((len(w.centred_position), 2 * omega.shape[1]))
    free_responses(w.starts, begin, omega, zeta, 1 / w.rate, b.taps, b.counted, out)
    return out


def whiten(b: Block, values: Array, free_vibration: Array) -> Array:
    """Whiten signals, shape (n, k), and remove the free vibration of each window.

    ``free_vibration`` is that of :class:`Projection`. Samples that are not counted are 0 in the result.
    """
    out = np.empty(values.shape)
    whiten_windows(np.ascontiguousarray(values), b.windows.starts, b.taps, b.counted, free_vibration, out)
    return out


def project(
    b: Block, mode: AxialMode, free_vibration: Array | None = None, raw: Array | None = None
) -> Projection:
    """Solve the linear part of a block.

    Parameters
    ----------
    b : Block
        Drive and responses.
    mode : AxialMode
        The mode.
    free_vibration : ndarray, shape (n, 2 * modes), optional
        Free vibration of the windows, see :class:`Projection`; by default that of ``mode``.
    raw : ndarray, shape (n, columns), optional
        Columns of ``mode``; by default :func:`raw_columns` computes them.

    Returns
    -------
    Projection
        With the weights of least squares.
    """
    if free_vibration is None:
        free_vibration = _free_responses(b, mode)
    target = whiten(b, b.target, free_vibration)
    if raw is None:
        raw = raw_columns(b, mode)
    columns = whiten(b, raw, free_vibration)
    # An eigenvalue of the products is the square of a singular value of the columns.
    to_basis = orthonormaliser(columns.T @ columns, _RANK_TOLERANCE**2)
    weights = to_basis @ (to_basis.T @ (columns.T @ target))
    residual = target - columns @ weights
    return Projection(residual, columns, to_basis, raw, weights, raw @ weights, free_vibration, target)


def remaining_power(b: Block, raw: Array, reference: Projection) -> float:
    """Power (sum of squares) of the residual alone, in less time than by :func:`project`.

    Parameters
    ----------
    b : Block
        Drive and responses.
    raw : ndarray, shape (n, columns)
        Columns of the mode; see :func:`raw_columns`.
    reference : Projection
        Projection of the same block with any mode: its free vibration and its target are used.

    Returns
    -------
    float
        Computed as a difference of two powers, hence with a rounding error; never 0 unless the target is.
    """
    columns = whiten(b, raw, reference.free_vibration)
    to_basis = orthonormaliser(columns.T @ columns, _RANK_TOLERANCE**2)
    in_basis = to_basis.T @ (columns.T @ reference.target)
    return max(reference.total - float(np.sum(in_basis**2)), _ROUNDING * reference.total)


def orthonormaliser(products: Array, tolerance: float) -> Array:
    """Matrix T such that the columns of A T are orthonormal.

    Parameters
    ----------
    products : ndarray, shape (columns, columns)
        AᵀA.
    tolerance : float
        For columns scaled to length 1: directions whose eigenvalue of AᵀA is not above this part of the
        largest eigenvalue are excluded.

    Returns
    -------
    ndarray, shape (columns, rank)
        The matrix T.
    """
    length = np.sqrt(np.maximum(np.diag(products), 0.0))
    length[length == 0] = 1.0  # a column of zeros
    values, vectors = np.linalg.eigh(products / np.outer(length, length))
    counted = values > tolerance * values[-1]
    return np.asarray(vectors[:, counted] / np.sqrt(values[counted]) / length[:, None])


def with_whitening(b: Block, residual: Array, floor: float) -> Block:
    """A block with the filter that whitens its residual plus white noise.

    Parameters
    ----------
    b : Block
        Block without a filter.
    residual : ndarray, shape (n, responses)
        Its residual, m/s².
    floor : float
        Power of the white noise, over that of the residual. Without it, frequencies with little noise, where
        errors of the model dominate, would have most weight.

    Returns
    -------
    Block
        The same with other taps, see :func:`~ballscrew.modal.joint.whitening.whitening_filter`.
    """
    taps = whitening_filter([residual[start:stop] for start, stop in b.windows.spans], floor)
    return replace(b, taps=taps)
