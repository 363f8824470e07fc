"""Derivatives of the models of all blocks, by difference quotients.

The weights of the columns are constant, and the projection of the derivatives on the columns, for which other
weights would compensate, is subtracted (variable projection in the approximation of Kaufman, 1975,
doi:10.1007/BF01932995). With constant weights, the forces of the ripple can be summed before the simulation:
a single force for each response remains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.blocks import Block, Projection, pitching_of, simulations_of, whiten
from ballscrew.modal.joint.columns import fill_change
from ballscrew.modal.joint.mode import AxialMode
from ballscrew.modal.joint.parameters import LOCAL, Modes, Parameter, modes_with, stop_of

# Steps of the parameters in the difference quotients, in the unit of the parameter (1 for a logarithm): in
# general, of some fields, and of local compliances.
_STEP = 1e-4
_STEPS = {"slope": 1e-3, "curve": 1e-2, "form": 1e-2, "mass_over_preload": 1e-2, "power": 1e-2}
_LOCAL_STEP = 1e-3
# Every third local compliance is varied in the same simulation. Each has an effect up to the neighbouring
# stops, and a window extends from its stop to the next at most: only one of those varied affects it.
_INTERLEAVED = 3


def model_jacobian(
    blocks: Sequence[Block],
    modes: Modes,
    solved: Sequence[Projection],
    weights: Sequence[float],
    parameters: Sequence[Parameter],
    values: Array,
) -> list[Array]:
    """Weighted derivatives of each block's whitened model, less their projection on its columns.

    Parameters
    ----------
    blocks : sequence of Block
        Data.
    modes : tuple of AxialMode
        One per block.
    solved : sequence of Projection
        The linear part of each block.
    weights : sequence of float
        Weight of each block.
    parameters : sequence of (field, mode index or None)
        Parameters of the derivatives.
    values : ndarray, shape (parameters,)
        Their values.

    Returns
    -------
    list of ndarray, shape (n * responses, parameters)
        One per block; columns of 0 for parameters of the other mode.
    """
    out = []
    derivatives = _whitened_derivatives(blocks, modes, solved, parameters, values)
    for s, weight, (indices, derivative) in zip(solved, weights, derivatives, strict=True):
        # This matrix puts the derivatives in their columns among all parameters.
        to_columns = weight * np.eye(len(parameters))[indices]
        rows = s.without_columns(derivative).reshape(s.residual.size, len(indices))
        out.append(rows @ to_columns)
    return out


def normal_equations(
    blocks: Sequence[Block],
    modes: Modes,
    solved: Sequence[Projection],
    weights: Sequence[float],
    parameters: Sequence[Parameter],
    values: Array,
) -> tuple[Array, Array]:
    """JᵀJ and Jᵀr, with J of :func:`model_jacobian` and r the weighted residuals, in less time than from J.

    Parameters
    ----------
    blocks, modes, solved, weights, parameters, values
        As for :func:`model_jacobian`.

    Returns
    -------
    hessian : ndarray, shape (parameters, parameters)
        JᵀJ, summed over the blocks.
    descent : ndarray, shape (parameters,)
        Jᵀr, summed over the blocks.
    """
    hessian, descent = np.zeros((len(parameters),) * 2), np.zeros(len(parameters))
    derivatives = _whitened_derivatives(blocks, modes, solved, parameters, values)
    for s, weight, (indices, derivative) in zip(solved, weights, derivatives, strict=True):
        if not indices:
            continue
        count = len(indices)
        hessian[np.ix_(indices, indices)] += weight**2 * s.products(derivative, count)
        # The residual is orthogonal to the columns: no projection on them needs to be subtracted.
        descent[indices] += weight**2 * (derivative.reshape(-1, count).T @ s.residual.ravel())
    return hessian, descent


def _whitened_derivatives(
    blocks: Sequence[Block],
    modes: Modes,
    solved: Sequence[Projection],
    parameters: Sequence[Parameter],
    values: Array,
) -> Iterator[tuple[list[int], Array]]:
    """For each block, indices of the k parameters that its model depends on, and the whitened derivatives.

    The derivatives have the shape (n, responses * k); those by all parameters follow each other for each
    response.
    """
    models = _FixedWeights(blocks, solved)
    changes: list[dict[int, Array]] = [{} for _ in solved]  # derivatives of each model, by parameter
    for k, (field, _) in enumerate(parameters):
        if field.startswith(LOCAL):
            continue
        step = _STEPS.get(field, _STEP)
        shifted = values.copy()
        shifted[k] += step
        for i, change in models.changes(modes, modes_with(modes, blocks, parameters, shifted), step):
            changes[i][k] = change
    of_stop = {stop_of(field): k for k, (field, _) in enumerate(parameters) if field.startswith(LOCAL)}
    if of_stop:
        _fill_local(models, modes, of_stop, changes)
    for b, s, by_parameter in zip(blocks, solved, changes, strict=True):
        stacked = np.empty((*s.residual.shape, len(by_parameter)))
        for position, change in enumerate(by_parameter.values()):
            stacked[:, :, position] = change
        yield list(by_parameter), whiten(b, stacked.reshape(len(stacked), -1), s.free)


class _FixedWeights:
    """Models of all blocks as functions of the modes alone, with constant weights of the columns.

    Columns that do not depend on the modes are omitted. All blocks with the same drive have the same ripple,
    the forces of :meth:`_forces`, so that they share its simulation.
    """

    def __init__(self, blocks: Sequence[Block], solved: Sequence[Projection]) -> None:
        self.blocks: list[Block] = []
        self._weights: list[Array] = []  # of the columns in each response, as for fill_change
        self._now: list[Array] = []  # models before a change of the modes
        forces = {index: self._forces(blocks, solved, index) for index in {b.mode_index for b in blocks}}
        first = dict.fromkeys(forces, 0)  # number of the first force that belongs to the next block
        for b, s in zip(blocks, solved, strict=True):
            force, responses = forces[b.mode_index], s.weights.shape[1]
            known = b.known.shape[1]
            of_mode = len(s.weights) - known - b.ripple.shape[1]
            # Each response has its own force, with a weight of 1.
            of_force = np.eye(force.shape[1], responses, -first[b.mode_index])
            weights = np.vstack([s.weights[:of_mode], of_force])
            first[b.mode_index] += responses
            self.blocks.append(replace(b, known=np.empty((len(force), 0)), ripple=force))
            self._weights.append(weights)
            self._now.append(s.model - b.known @ s.weights[of_mode : of_mode + known])

    @staticmethod
    def _forces(blocks: Sequence[Block], solved: Sequence[Projection], index: int) -> Array:
        """Sum of the forces of the ripple in each response of the blocks with this mode.

        Shape (n, responses of these blocks); without ripple, shape (n, 0), so that no force is simulated.
        """
        forces = [np.empty((len(solved[0].model), 0))]
        for b, s in zip(blocks, solved, strict=True):
            if b.mode_index == index and b.ripple.size:
                forces.append(b.ripple @ s.weights[-b.ripple.shape[1] :])
        return np.column_stack(forces)

    def changes(self, modes: Modes, shifted: Sequence[AxialMode], step: float) -> Iterator[tuple[int, Array]]:
        """Index of each block whose mode is shifted, and the change of its model divided by ``step``.

        The change has the shape (n, responses).
        """
        affected = [i for i, mode in enumerate(modes) if shifted[i] != mode]
        simulations = simulations_of([self.blocks[i] for i in affected], [shifted[i] for i in affected])
        for i, simulation in zip(affected, simulations, strict=True):
            b, now = self.blocks[i], self._now[i]
            columns = simulation.response, pitching_of(b, shifted[i], simulation), simulation.to_ripple
            change = np.empty(now.shape)
            fill_change(*columns, b.windows.first, self._weights[i], now, step, change)
            yield i, change


def _fill_local(
    models: _FixedWeights, modes: Modes, of_stop: dict[int, int], changes: Sequence[dict[int, Array]]
) -> None:
    """Add to ``changes`` the derivatives by local compliances; ``of_stop`` is the parameter of each stop.

    The change in each window is attributed to the nearest of the stops that are varied together.
    """
    places = np.array(modes[0].places)
    for offset in range(min(_INTERLEAVED, len(places))):
        varied = []
        for mode in modes:
            local = np.array(mode.local)
            local[offset::_INTERLEAVED] += _LOCAL_STEP
            varied.append(replace(mode, local=tuple(local.tolist())))
        for i, change in models.changes(modes, varied, _LOCAL_STEP):
            w = models.blocks[i].windows
            for start, end in w.spans:
                place = w.place[start:end]
                nearest = np.abs(places - (place.min() + place.max()) / 2).argsort()
                stop = int(nearest[nearest % _INTERLEAVED == offset][0])
                if stop in of_stop:
                    k = of_stop[stop]
                    if k not in changes[i]:
                        changes[i][k] = np.zeros_like(change)
                    changes[i][k][start:end] = change[start:end]
