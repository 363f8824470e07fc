"""Derivatives of the models of all blocks, by difference quotients.

The weights of the columns stay as they are, and what other weights could compensate for is projected out
(variable projection in the approximation of Kaufman, 1975, doi:10.1007/BF01932995). So the ripple is
simulated as one force per response.
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

_STEP = 1e-4  # of a parameter, for the difference quotients; other steps by field:
_STEPS = {"slope": 1e-3, "curve": 1e-2, "mass_over_preload": 1e-2, "power": 1e-2}
_LOCAL_STEP = 1e-3
# No window reaches two stops that are three apart, so every third local compliance is varied in one
# simulation: each window is affected by one of them only.
_INTERLEAVED = 3


def model_jacobian(
    blocks: Sequence[Block],
    modes: Modes,
    solved: Sequence[Projection],
    weights: Sequence[float],
    parameters: Sequence[Parameter],
    values: Array,
) -> list[Array]:
    """Weighted derivatives of each block's whitened model, without their parts along its columns.

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
        To derive by.
    values : ndarray, shape (parameters,)
        Their values.

    Returns
    -------
    list of ndarray, shape (n * responses, parameters)
        One per block.
    """
    out = []
    derivatives = _whitened_derivatives(blocks, modes, solved, parameters, values)
    for s, weight, (own, of_model) in zip(solved, weights, derivatives, strict=True):
        column = weight * np.eye(len(parameters))[own]  # of each derivative among all
        out.append(s.without_columns(of_model).reshape(s.residual.size, len(own)) @ column)
    return out


def normal_equations(
    blocks: Sequence[Block],
    modes: Modes,
    solved: Sequence[Projection],
    weights: Sequence[float],
    parameters: Sequence[Parameter],
    values: Array,
) -> tuple[Array, Array]:
    """JᵀJ and Jᵀr of :func:`model_jacobian` and the weighted residuals, in less time than from J.

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
    for s, weight, (own, of_model) in zip(solved, weights, derivatives, strict=True):
        if not own:
            continue
        hessian[np.ix_(own, own)] += weight**2 * s.products(of_model, len(own))
        # The residual is orthogonal to the columns.
        descent[own] += weight**2 * (of_model.reshape(-1, len(own)).T @ s.residual.ravel())
    return hessian, descent


def _whitened_derivatives(
    blocks: Sequence[Block],
    modes: Modes,
    solved: Sequence[Projection],
    parameters: Sequence[Parameter],
    values: Array,
) -> Iterator[tuple[list[int], Array]]:
    """Whitened derivatives of each model, shape (n, responses * k), by the k parameters that it depends on.

    Their indices come first.
    """
    models = _FixedWeights(blocks, solved)
    changes: list[dict[int, Array]] = [{} for _ in solved]  # of each model, by parameter
    for k, (field, _) in enumerate(parameters):
        if field.startswith(LOCAL):
            continue
        step = _STEPS.get(field, _STEP)
        shifted = values.copy()
        shifted[k] += step
        for i, change in models.changes(modes, modes_with(modes, blocks, parameters, shifted), step):
            changes[i][k] = change
    columns = {stop_of(field): k for k, (field, _) in enumerate(parameters) if field.startswith(LOCAL)}
    if columns:
        _fill_local(models, modes, columns, changes)
    for b, s, of_model in zip(blocks, solved, changes, strict=True):
        stacked = np.empty((*s.residual.shape, len(of_model)))
        for place, change in enumerate(of_model.values()):
            stacked[:, :, place] = change
        yield list(of_model), whiten(b, stacked.reshape(len(stacked), -1), s.free)


class _FixedWeights:
    """Models of all blocks as functions of the modes alone; the weights of the columns are those given."""

    def __init__(self, blocks: Sequence[Block], solved: Sequence[Projection]) -> None:
        self.blocks: list[Block] = []
        self._weights: list[Array] = []
        self._now: list[Array] = []
        forces = {index: self._forces(blocks, solved, index) for index in {b.mode_index for b in blocks}}
        first = dict.fromkeys(forces, 0)
        for b, s in zip(blocks, solved, strict=True):
            force, responses = forces[b.mode_index], s.weights.shape[1]
            of_mode = len(s.weights) - b.known.shape[1] - b.ripple.shape[1]
            of_force = np.eye(force.shape[1], responses, -first[b.mode_index])
            weights = np.vstack([s.weights[:of_mode], of_force])
            first[b.mode_index] += responses
            self.blocks.append(replace(b, known=np.empty((len(force), 0)), ripple=force))
            self._weights.append(weights)
            self._now.append(s.model - b.known @ s.weights[of_mode : of_mode + b.known.shape[1]])

    @staticmethod
    def _forces(blocks: Sequence[Block], solved: Sequence[Projection], index: int) -> Array:
        """Force of the ripple in each response of the blocks with this mode, shape (n, responses).

        Without ripple, shape (n, 0): none is simulated.
        """
        forces = [np.empty((len(solved[0].model), 0))]
        for b, s in zip(blocks, solved, strict=True):
            if b.mode_index == index and b.ripple.size:
                forces.append(b.ripple @ s.weights[-b.ripple.shape[1] :])
        return np.column_stack(forces)

    def changes(self, modes: Modes, shifted: Sequence[AxialMode], step: float) -> Iterator[tuple[int, Array]]:
        """Index of each block whose mode is shifted, and the change of its model over the step."""
        concerned = [i for i, mode in enumerate(modes) if shifted[i] != mode]
        simulations = simulations_of([self.blocks[i] for i in concerned], [shifted[i] for i in concerned])
        for i, simulation in zip(concerned, simulations, strict=True):
            b, now = self.blocks[i], self._now[i]
            columns = simulation.response, pitching_of(b, shifted[i], simulation), simulation.to_ripple
            change = np.empty(now.shape)
            fill_change(*columns, b.windows.first, self._weights[i], now, step, change)
            yield i, change


def _fill_local(
    models: _FixedWeights, modes: Modes, columns: dict[int, int], changes: Sequence[dict[int, Array]]
) -> None:
    """Fill the columns of the local compliances; ``columns`` is the column of each stop.

    Every third local compliance is varied in one simulation, and each window attributed to the nearest of
    these.
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
                if stop in columns:
                    k = columns[stop]
                    if k not in changes[i]:
                        changes[i][k] = np.zeros_like(change)
                    changes[i][k][start:end] = change[start:end]
