"""Derivatives of the models of all blocks, by difference quotients.

The weights of the columns are constant, and the projection of the derivatives on the columns is subtracted,
since other weights would compensate for it (variable projection in the approximation of Kaufman, 1975,
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

# Steps of the parameters in the difference quotients, in the unit of the parameter (1 for a logarithm).
_STEPS = {
    "slope": 1e-3,
    "curve": 1e-2,
    "form": 1e-2,
    "mass_over_preload": 1e-2,
    "guide_part": 1e-2,
    "damping_exponent": 1e-2,
}
_STEP = 1e-4  # of the other fields
_LOCAL_STEP = 1e-3  # of a local compliance
# Every third local compliance is varied in the same simulation. Each has an effect up to the neighbouring
# stops, and a window extends from its stop to the next at most: only one of those varied affects it.
_INTERLEAVED = 3


def model_jacobian(
    blocks: Sequence[Block],
    modes: Modes,
    projections: Sequence[Projection],
    weights: Sequence[float],
    parameters: Sequence[Parameter],
    values: Array,
) -> list[Array]:
    """Weighted derivatives of each block's whitened model, less their projection on its columns.

    Parameters
    ----------
    blocks : sequence of Block
        Drives and responses.
    modes : tuple of AxialMode
        One per block.
    projections : sequence of Projection
        The linear part of each block.
    weights : sequence of float
        Weight of each block.
    parameters : sequence of (field, mode index or None)
        Parameters by which the models are differentiated.
    values : ndarray, shape (parameters,)
        Values of the parameters in ``modes``.

    Returns
    -------
    list of ndarray, shape (n * responses, parameters)
        One per block; columns of 0 for parameters of the other mode. Rows are the elements of a residual of
        shape (n, responses) that was flattened.
    """
    out = []
    derivatives = _whitened_derivatives(blocks, modes, projections, parameters, values)
    for projection, weight, (indices, derivative) in zip(projections, weights, derivatives, strict=True):
        # This matrix moves each derivative to the column of its parameter among all parameters.
        to_parameters = weight * np.eye(len(parameters))[indices]
        rows = projection.without_columns(derivative).reshape(projection.residual.size, len(indices))
        out.append(rows @ to_parameters)
    return out


def normal_equations(
    blocks: Sequence[Block],
    modes: Modes,
    projections: Sequence[Projection],
    weights: Sequence[float],
    parameters: Sequence[Parameter],
    values: Array,
) -> tuple[Array, Array]:
    """JᵀJ and Jᵀr, with J of :func:`model_jacobian` and r the weighted residuals, in less time than from J.

    Parameters
    ----------
    blocks, modes, projections, weights, parameters, values
        As for :func:`model_jacobian`.

    Returns
    -------
    hessian : ndarray, shape (parameters, parameters)
        JᵀJ, summed over the blocks.
    descent : ndarray, shape (parameters,)
        Jᵀr, summed over the blocks.
    """
    hessian, descent = np.zeros((len(parameters),) * 2), np.zeros(len(parameters))
    derivatives = _whitened_derivatives(blocks, modes, projections, parameters, values)
    for projection, weight, (indices, derivative) in zip(projections, weights, derivatives, strict=True):
        if not indices:
            continue
        count = len(indices)
        hessian[np.ix_(indices, indices)] += weight**2 * projection.products(derivative, count)
        # The residual is orthogonal to the columns: no projection on them needs to be subtracted.
        descent[indices] += weight**2 * (derivative.reshape(-1, count).T @ projection.residual.ravel())
    return hessian, descent


def _whitened_derivatives(
    blocks: Sequence[Block],
    modes: Modes,
    projections: Sequence[Projection],
    parameters: Sequence[Parameter],
    values: Array,
) -> Iterator[tuple[list[int], Array]]:
    """For each block, indices of the k parameters that its model depends on, and the whitened derivatives.

    The derivatives have the shape (n, responses * k): those of the first response by all parameters, then
    those of the second, and so on. The arguments are those of :func:`model_jacobian`.
    """
    models = _FixedWeights(blocks, projections)
    changes: list[dict[int, Array]] = [{} for _ in projections]  # derivatives of each model, by parameter
    for k, (field, _) in enumerate(parameters):
        if field.startswith(LOCAL):
            continue
        step = _STEPS.get(field, _STEP)
        shifted = values.copy()
        shifted[k] += step
        for i, change in models.changes(modes, modes_with(modes, blocks, parameters, shifted), step):
            changes[i][k] = change
    parameter_of_stop = {}
    for k, (field, _) in enumerate(parameters):
        if field.startswith(LOCAL):
            parameter_of_stop[stop_of(field)] = k
    if parameter_of_stop:
        _add_local_derivatives(models, modes, parameter_of_stop, changes)
    for b, projection, by_parameter in zip(blocks, projections, changes, strict=True):
        stacked = np.empty((*projection.residual.shape, len(by_parameter)))
        for column, change in enumerate(by_parameter.values()):
            stacked[:, :, column] = change
        yield list(by_parameter), whiten(b, stacked.reshape(len(stacked), -1), projection.free_vibration)


class _FixedWeights:
    """Models of all blocks as functions of the modes alone, with constant weights of the columns.

    Fixed columns are omitted. All blocks with the same drive have the same ripple, the result of
    :meth:`_sum_ripple`, so that they share its simulation.
    """

    def __init__(self, blocks: Sequence[Block], projections: Sequence[Projection]) -> None:
        self.blocks: list[Block] = []
        self._weights: list[Array] = []  # of the columns in each response, as for fill_change
        self._present: list[Array] = []  # models before a change of the modes, as for fill_change
        forces = {}
        for index in {b.mode_index for b in blocks}:
            forces[index] = self._sum_ripple(blocks, projections, index)
        first = dict.fromkeys(forces, 0)  # index of the first force that belongs to the next block
        for b, projection in zip(blocks, projections, strict=True):
            force, responses = forces[b.mode_index], projection.weights.shape[1]
            # The weights are those of the columns of the modes, of the fixed columns, and of the ripple.
            mode_columns = len(projection.weights) - b.fixed_columns.shape[1] - b.ripple.shape[1]
            fixed_weights = projection.weights[mode_columns : mode_columns + b.fixed_columns.shape[1]]
            # Each response has its own force, with a weight of 1.
            force_weights = np.eye(force.shape[1], responses, -first[b.mode_index])
            first[b.mode_index] += responses
            self.blocks.append(replace(b, fixed_columns=np.empty((len(force), 0)), ripple=force))
            self._weights.append(np.vstack([projection.weights[:mode_columns], force_weights]))
            self._present.append(projection.model - b.fixed_columns @ fixed_weights)

    @staticmethod
    def _sum_ripple(blocks: Sequence[Block], projections: Sequence[Projection], index: int) -> Array:
        """Sum the forces of the ripple, each with its weight in a response, of the blocks with this mode.

        Shape (n, responses of these blocks), m/s²; without ripple, shape (n, 0), so that no force is
        simulated.
        """
        forces = [np.empty((len(projections[0].model), 0))]
        for b, projection in zip(blocks, projections, strict=True):
            if b.mode_index == index and b.ripple.size:
                forces.append(b.ripple @ projection.weights[-b.ripple.shape[1] :])
        return np.column_stack(forces)

    def changes(self, modes: Modes, shifted: Sequence[AxialMode], step: float) -> Iterator[tuple[int, Array]]:
        """Index of each block whose mode is shifted, and the change of its model divided by ``step``.

        ``shifted`` are the modes after the change of a parameter by ``step``. The quotient has the shape
        (n, responses) and the unit m/s² per unit of the parameter.
        """
        affected = [i for i, mode in enumerate(modes) if shifted[i] != mode]
        simulations = simulations_of([self.blocks[i] for i in affected], [shifted[i] for i in affected])
        for i, simulation in zip(affected, simulations, strict=True):
            b, present = self.blocks[i], self._present[i]
            pitching = pitching_of(b, shifted[i], simulation)
            change = np.empty(present.shape)
            fill_change(
                simulation.response,
                pitching,
                simulation.ripple_response,
                b.stop,
                b.windows.starts,
                self._weights[i],
                present,
                step,
                change,
            )
            yield i, change


def _add_local_derivatives(
    models: _FixedWeights,
    modes: Modes,
    parameter_of_stop: dict[int, int],
    changes: Sequence[dict[int, Array]],
) -> None:
    """Add the derivatives by local compliances to ``changes``, those of each block by parameter.

    The change in each window is attributed to the nearest of the stops that are varied together.
    """
    stops = np.array(modes[0].stops)
    for first in range(min(_INTERLEAVED, len(stops))):
        varied = []
        for mode in modes:
            local = np.array(mode.local)
            local[first::_INTERLEAVED] += _LOCAL_STEP
            varied.append(replace(mode, local=tuple(local.tolist())))
        for i, change in models.changes(modes, varied, _LOCAL_STEP):
            w = models.blocks[i].windows
            for start, end in w.spans:
                positions = w.centred_position[start:end]
                middle = (positions.min() + positions.max()) / 2
                nearest = np.abs(stops - middle).argsort()
                stop = int(nearest[nearest % _INTERLEAVED == first][0])
                if stop in parameter_of_stop:
                    k = parameter_of_stop[stop]
                    if k not in changes[i]:
                        changes[i][k] = np.zeros_like(change)
                    changes[i][k][start:end] = change[start:end]
