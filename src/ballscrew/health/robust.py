"""Cells, then whole runs, then anchors that do not fit the rest: found, weighed down and named."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.health.fit import Fit, Problem, solve

__all__ = ["ANCHOR", "CELL", "RUN", "Robust", "fit_robustly", "left_out"]

Array = NDArray[np.float64]

CELL = 4.0
"""Standard deviations from what all other rows foretell, beyond which a cell loses weight."""

RUN = 16.0
"""χ² of a run's level and tilt against all other rows, beyond which the run loses weight: 1 in 3000."""

ANCHOR = 3.0
"""Standard deviations from what all other rows foretell, beyond which an anchor is named."""

_ROUNDS = 12


@dataclass(frozen=True, slots=True, eq=False)
class Robust:
    """A fit that single cells and single runs cannot spoil.

    Parameters
    ----------
    fit : Fit
        The last one.
    problem : Problem
        With the covariance that it was made with.
    cells : tuple of int
        Rows that lost weight.
    weights : ndarray, shape (runs,)
        1; less where a run lost weight.
    disagree : tuple of int
        Runs that do not fit, and nothing tells which of them is wrong.
    anchors : tuple of (int, float)
        Anchors that do not fit the rest, and by how many standard deviations.
    """

    fit: Fit
    problem: Problem
    cells: tuple[int, ...]
    weights: Array
    disagree: tuple[int, ...]
    anchors: tuple[tuple[int, float], ...]


def fit_robustly(problem: Problem) -> Robust:
    """Fit; weigh down the worst row or run; fit again until all fit.

    What one row or run says is compared with what all others foretell of it, parameters and common errors
    taken into account. A row gets its own misfit as additional uncertainty; a run that of its level and tilt.

    Parameters
    ----------
    problem : Problem
        Rows and prior.

    Returns
    -------
    Robust
        The fit, and what did not fit.

    Raises
    ------
    MeasurementError
        If it does not settle.
    """
    n, runs = len(problem.position), int(problem.run.max()) + 1
    weights, disagree = np.ones(runs), set[int]()
    cells: list[int] = []
    found = solve(problem)
    for _ in range(_ROUNDS):
        inverse, pulled = left_out(problem, found)
        own = np.abs(pulled / np.sqrt(np.diag(inverse)))[:n]
        own[cells] = 0.0
        # A run that is off as a whole pulls all its cells: it comes first.
        levels = [_run(problem, inverse, pulled, i) for i in range(runs)]
        scores = np.array([0.0 if weights[i] < 1 else levels[i][0] for i in range(runs)])
        worst, cell = int(np.argmax(scores)), int(np.argmax(own))
        mates = np.flatnonzero(
            [problem.group[problem.run == i][0] == _group(problem, worst) for i in range(runs)]
        )
        if scores[worst] > RUN and scores[worst] > own[cell] ** 2:
            if len(mates) < 3 or np.sum(weights < 1) >= (runs - 1) // 2:
                disagree |= {int(i) for i in mates if scores[i] > RUN}
                break
            extra = levels[worst][1]
            before = np.mean(np.diag(problem.covariance)[:n][problem.run == worst])
            weights[worst] = float(before / (before + np.mean(np.diag(extra)[:n][problem.run == worst])))
            problem = replace(problem, covariance=problem.covariance + extra)
        elif own[cell] > CELL:
            cells.append(cell)
            wider = problem.covariance.copy()
            wider[cell, cell] += (pulled[cell] / inverse[cell, cell]) ** 2
            problem = replace(problem, covariance=wider)
        else:
            break
        found = solve(problem, found.unknown)
    inverse, pulled = left_out(problem, found)
    score = pulled[n:] / np.sqrt(np.diag(inverse)[n:])
    bad = tuple((int(i), float(score[i])) for i in np.flatnonzero(np.abs(score) > ANCHOR))
    return Robust(found, problem, tuple(cells), weights, tuple(sorted(disagree)), bad)


def left_out(problem: Problem, found: Fit) -> tuple[Array, Array]:
    """Inverse covariance of the rows with the prior in it, and that times what is left at the prior's mean.

    Row i differs from what all others foretell by ``pulled[i] / inverse[i, i]``, with a variance of
    1 / inverse[i, i]; of a block of rows the same holds with the block's inverse.
    """
    slopes = problem.jacobian(found.unknown)
    whole = problem.covariance + slopes @ problem.prior @ slopes.T
    finite = np.isfinite(problem.mean)
    away = np.where(finite, np.where(finite, found.unknown, 0.0) - np.where(finite, problem.mean, 0.0), 0.0)
    inverse = np.linalg.inv(whole)
    inverse = (inverse + inverse.T) / 2
    return inverse, np.asarray(inverse @ (found.residual + slopes @ away))


def _group(problem: Problem, run: int) -> int:
    return int(problem.group[problem.run == run][0])


def _run(problem: Problem, inverse: Array, pulled: Array, run: int) -> tuple[float, Array]:
    """χ² of a run's level and tilt against all other rows, and the covariance that would excuse them."""
    rows = np.flatnonzero(problem.run == run)
    x = problem.position[rows]
    shapes = [np.ones(len(rows))]
    if np.ptp(x) > 0:
        shapes.append((x - x.mean()) / np.ptp(x) * 2)
    basis = np.stack(shapes, axis=1)
    matrix = basis.T @ inverse[np.ix_(rows, rows)] @ basis
    moved = np.linalg.solve(matrix, basis.T @ pulled[rows])
    extra = np.zeros_like(inverse)
    extra[np.ix_(rows, rows)] = basis @ np.diag(moved**2) @ basis.T
    return float(moved @ matrix @ moved), extra
