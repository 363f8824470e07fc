"""Least squares by variable projection: only the poles are searched, everything linear is eliminated.

Source: G. H. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413, DOI 10.1137/0710036, with L. Kaufman's
Jacobian, BIT 15 (1975) 49, DOI 10.1007/BF01932995.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.modal.output_error.lines import CellLines
from ballscrew.modal.output_error.model import Poles, forced, forced_slopes, transient, transient_slopes

__all__ = ["Fit", "fit", "one_step"]

Real = NDArray[np.float64]
_ROUNDS = 25
_ENOUGH = 1e-3  # of the variance, that a step may still promise: a thirtieth of a standard deviation
_NEARLY = 0.05  # likewise, where the rounds end
_USUAL, _SPREAD = 0.03, 1.0  # damping ratio, and the spread of its logarithm: 0.4 to 20 % in two spreads
_FARTHEST = 0.1  # a step's longest move of ln f; of ln ζ ten times that


@dataclass(frozen=True, slots=True)
class Fit:
    """A model fitted to a cell.

    Parameters
    ----------
    poles : Poles
        Found.
    factor : ndarray, shape (responses, functions)
        Real factors of H's functions.
    cost : float
        What is least: the weighted squares, less what noise on the force adds to them.
    squares : float
        Sum of squares of the weighted residual.
    residual : ndarray of complex, shape (responses, repetitions, n)
        Not weighted.
    information : ndarray, shape (parameters, parameters)
        Of :attr:`Poles.vector`, everything else being unknown; weighted.
    scores : ndarray, shape (repetitions, parameters)
        Each repetition's part of the gradient, weighted.
    free : int
        Real residuals less real parameters.
    converged : bool
        Whether it came to rest.
    """

    poles: Poles
    factor: Real
    cost: float
    squares: float
    residual: NDArray[np.complex128]
    information: Real
    scores: Real
    free: int
    converged: bool


@dataclass(frozen=True, slots=True)
class _State:
    """All of one point of the search."""

    fit: Fit
    gradient: Real


def fit(
    lines: CellLines,
    start: Poles,
    weight: Real | None = None,
    *,
    input_noise: float = 0.0,
    rounds: int = _ROUNDS,
    enough: float = _ENOUGH,
) -> Fit:
    """Fit poles, and all that is linear, to a cell's lines.

    Parameters
    ----------
    lines : CellLines
        Of the cell.
    start : Poles
        Where the search starts; its structure is kept.
    weight : ndarray, shape (responses, n), optional
        One over the residual's standard deviation; by default 1.
    input_noise : float
        Variance of the noise on the real, and on the imaginary, part of the force's lines. With it the normal
        equations are free of the bias that such noise brings, an errors-in-variables estimate.
    rounds : int
        Steps at most.
    enough : float
        It ends where a step promises less than this, in units of the residual's variance.

    Returns
    -------
    Fit
        The best point met.
    """
    weight = np.ones((len(lines.response), len(lines.omega))) if weight is None else weight
    state = _at(lines, start, weight, input_noise)
    damping, promise = 1e-3, np.inf
    for _ in range(rounds):
        variance = state.fit.squares / max(state.fit.free, 1)
        information, gradient = _with_prior(state, variance)
        scale = np.diag(np.maximum(np.diag(information), 1e-300))
        step: Real = np.asarray(np.linalg.solve(information + damping * scale, gradient), dtype=np.float64)
        # What an undamped step promises: a damped one is short, which says nothing of how far it is.
        promise = float(gradient @ np.linalg.solve(information, gradient)) / variance
        if abs(promise) < enough:
            break
        trial = state.fit.poles.moved(step * min(1.0, _FARTHEST / _reach(step, start)))
        other = _at(lines, trial, weight, input_noise) if _possible(trial, lines) else None
        if other and _total(other, variance) < _total(state, variance):
            state, damping = other, damping / 10
        else:
            damping = max(10 * damping, 1e-3)
    return replace(state.fit, converged=abs(promise) < max(_NEARLY, enough))


def one_step(lines: CellLines, poles: Poles, weight: Real, input_noise: float) -> tuple[Real, Real]:
    """Where other lines would move a fit, to first order.

    Parameters
    ----------
    lines : CellLines
        Some of the lines.
    poles : Poles
        Of the fit.
    weight : ndarray, shape (responses, n)
        As in :func:`fit`.
    input_noise : float
        Likewise.

    Returns
    -------
    step : ndarray, shape (parameters,)
        Of :attr:`Poles.vector`.
    covariance : ndarray, shape (parameters, parameters)
        Of where it would lie.
    """
    state = _at(lines, poles, weight, input_noise)
    inverse = np.linalg.pinv(state.fit.information, hermitian=True)
    return inverse @ state.gradient, inverse * state.fit.squares / max(state.fit.free, 1)


def _with_prior(state: _State, variance: float) -> tuple[Real, Real]:
    """Information and gradient with what is known of dampings: without it a mode too many has none."""
    count = len(state.fit.poles.frequency)
    at = np.arange(count, 2 * count)
    information, gradient = state.fit.information.copy(), state.gradient.copy()
    information[at, at] += variance / _SPREAD**2
    gradient[at] -= variance * np.log(state.fit.poles.damping / _USUAL) / _SPREAD**2
    return information, gradient


def _total(state: _State, variance: float) -> float:
    prior = np.sum(np.log(state.fit.poles.damping / _USUAL) ** 2) / _SPREAD**2
    return state.fit.cost + variance * float(prior)


def _reach(step: Real, poles: Poles) -> float:
    count = len(poles.frequency)
    return float(
        max(np.abs(step[:count]).max(), 0.1 * np.abs(step[count : 2 * count]).max(), 0.1 * abs(step[-1]))
    )


def _possible(poles: Poles, lines: CellLines) -> bool:
    """Whether poles are any that lines of this band could show."""
    low, high = lines.omega[0] / (2 * np.pi), lines.omega[-1] / (2 * np.pi)
    inside = (poles.frequency > 0.7 * low) & (poles.frequency < 1.2 * high)
    return bool(inside.all() and (poles.damping < 0.5).all() and (poles.damping > 5e-4).all())


def _real(array: NDArray[np.complex128]) -> Real:
    """Real and imaginary parts side by side."""
    return np.ascontiguousarray(array).view(np.float64)


def _at(lines: CellLines, poles: Poles, weight: Real, input_noise: float) -> _State:
    """Residual, information and gradient at given poles."""
    omega, count = lines.omega, len(poles.frequency)
    functions = forced(poles, omega)
    own, own_slopes = transient(poles, omega), transient_slopes(poles, omega)
    repetitions, parameters = len(lines.force), len(poles.vector)
    shape = (repetitions, 2 * len(omega))
    information = np.zeros((parameters, parameters))
    scores = np.zeros((repetitions, parameters))
    cost, squares, factors, residuals = 0.0, 0.0, [], []
    # Noise on the force adds its power to what the force seems to be; the eliminated start takes its share.
    share = 2 * input_noise * repetitions * (1 - len(own) / (2 * len(omega)))
    for response, w in zip(lines.response, weight, strict=True):
        basis, triangle = np.linalg.qr(_real(own * w).T)
        known = _real((functions * w)[:, None, :] * lines.force)
        answer = _real(response * w)
        along_known, along = known @ basis, answer @ basis
        flat = (known - along_known @ basis.T).reshape(len(functions), -1)
        target = (answer - along @ basis.T).ravel()
        seen = _real(functions * w)
        gram = flat @ flat.T - share * seen @ seen.T
        factor = np.linalg.solve(gram, flat @ target)
        residual = target - factor @ flat
        # What each record starts with, given the forced response.
        given = along - np.tensordot(factor, along_known, 1)
        start = np.linalg.solve(triangle, given.T)[len(own) - 2 * count :]
        pairs = np.concatenate([start.reshape(2, count, repetitions)] * 2, axis=1).transpose(1, 2, 0)
        forced_columns = forced_slopes(poles, omega, factor) * w
        columns = forced_columns[:, None, :] * lines.force
        columns[: 2 * count] += pairs @ (own_slopes * w)
        slopes = _real(columns)
        slopes -= (slopes @ basis) @ basis.T
        slopes = slopes.reshape(parameters, target.size)
        moved = _real(forced_columns)
        mixing = np.linalg.solve(gram, flat @ slopes.T - share * seen @ moved.T).T
        slopes -= mixing @ flat
        moved -= mixing @ seen
        information += slopes @ slopes.T - share * moved @ moved.T
        each = (slopes * residual).reshape(parameters, *shape).sum(axis=-1).T
        scores += each + share / repetitions * (moved @ (factor @ seen))
        squares += float(residual @ residual)
        cost += float(residual @ residual) - share * float(np.sum((factor @ seen) ** 2))
        factors.append(factor)
        residuals.append(residual.reshape(shape).view(np.complex128) / w)
    used = len(lines.response) * (len(functions) + repetitions * len(own)) + parameters
    free = 2 * lines.response.size - used
    found = Fit(
        poles,
        np.stack(factors),
        cost,
        squares,
        np.stack(residuals),
        information,
        scores,
        free,
        converged=False,
    )
    return _State(found, scores.sum(axis=0))
