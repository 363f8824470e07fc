"""Cells, then whole runs, then anchors that do not fit the rest: found, weighed down and named."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.calibration.fit import Fit, Problem, solve

__all__ = ["ANCHOR", "CELL", "MOST", "RUN", "Robust", "fit_robustly", "left_out"]


CELL = 4.0
"""Standard deviations from what all other rows foretell, beyond which a cell loses weight."""

RUN = 16.0
"""χ² of a run's level and tilt against all other rows, beyond which the run loses weight: 1 in 3000."""

ANCHOR = 3.0
"""Standard deviations from what all other rows foretell, beyond which an anchor is named."""

MOST = 0.25
"""Part of a run's cells of which no more may lose weight: beyond it, it is the run that does not fit."""

_ROUNDS = 24
_NORMAL = 1.4826  # standard deviation over the median distance


@dataclass(frozen=True, slots=True, eq=False)
class Robust:
    """A fit that single cells and single runs cannot spoil.

    Parameters
    ----------
    fit : Fit
        The last one.
    problem : Problem
        With the covariance that it was made with.
    cells : mapping of int to float
        Rows that lost weight, and the variance that was added to each.
    excused : mapping of int to ndarray
        Runs that lost weight, and the covariance that was added for each.
    weights : ndarray, shape (runs,)
        1; less where a run lost weight.
    disagree : tuple of int
        Runs that do not fit, and nothing tells which of them is wrong.
    anchors : tuple of (int, float)
        Anchors that do not fit the rest, and by how many standard deviations.
    refused : tuple of int
        Runs of which too many cells do not fit.
    unfinished : bool
        Whether more does not fit than there were rounds to find.
    """

    fit: Fit
    problem: Problem
    cells: Mapping[int, float]
    excused: Mapping[int, Array]
    weights: Array
    disagree: tuple[int, ...]
    anchors: tuple[tuple[int, float], ...]
    refused: tuple[int, ...] = ()
    unfinished: bool = False


def fit_robustly(problem: Problem) -> Robust:
    """Fit; weigh down the worst row or run; fit again until all fit, or 24 times.

    What one row or run says is compared with what all others foretell of it, parameters and common errors
    taken into account. A row gets its own misfit as additional uncertainty; a run that of its level and tilt.
    Where most cells lie further off than they say, none of them is to blame: a cell is held against what
    cells scatter by then.

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
    weights, disagree, refused = np.ones(runs), set[int](), set[int]()
    cells, excused = dict[int, float](), dict[int, Array]()
    unfinished, found = False, solve(problem)
    for turn in range(_ROUNDS + 1):
        inverse, pulled = left_out(problem, found)
        own = _own(inverse, pulled, n, cells)
        # A run that is off as a whole pulls all its cells: it comes first.
        levels = [_run(problem, inverse, pulled, i) for i in range(runs)]
        scores = np.array([0.0 if i in excused else levels[i][0] for i in range(runs)])
        worst, cell = int(np.argmax(scores)), int(np.argmax(own))
        mates = np.flatnonzero(
            [problem.group[problem.run == i][0] == _group(problem, worst) for i in range(runs)]
        )
        by_run = scores[worst] > RUN and scores[worst] > own[cell] ** 2
        if not by_run and own[cell] <= CELL:
            break
        if turn == _ROUNDS:
            unfinished = True
            break
        if by_run:
            if len(mates) < 3 or len(excused) >= (runs - 1) // 2:
                disagree |= {int(i) for i in mates if scores[i] > RUN or int(i) in excused}
                break
            extra = excused[worst] = levels[worst][1]
            rows = problem.run == worst
            before = np.mean(np.diag(problem.covariance)[:n][rows])
            weights[worst] = float(before / (before + np.mean(np.diag(extra)[:n][rows])))
            problem = replace(problem, covariance=problem.covariance + extra)
        else:
            cells[cell] = float((pulled[cell] / inverse[cell, cell]) ** 2)
            wider = problem.covariance.copy()
            wider[cell, cell] += cells[cell]
            problem = replace(problem, covariance=wider)
            run = int(problem.run[cell])
            if np.sum(problem.run[list(cells)] == run) > MOST * np.sum(problem.run == run):
                refused.add(run)
                break
        found = solve(problem, found.unknown)
    score = pulled[n:] / np.sqrt(np.diag(inverse)[n:])
    bad = tuple((int(i), float(score[i])) for i in np.flatnonzero(np.abs(score) > ANCHOR))
    return Robust(
        found, problem, cells, excused, weights, tuple(sorted(disagree)), bad, tuple(refused), unfinished
    )


def _own(inverse: Array, pulled: Array, n: int, out: Mapping[int, float]) -> Array:
    """How far each cell is from what the others foretell, in what it may err or in what cells scatter by."""
    own = np.abs(pulled / np.sqrt(np.diag(inverse)))[:n]
    own[list(out)] = 0.0
    rest = np.delete(own, list(out))
    return np.asarray(own / max(1.0, _NORMAL * float(np.median(rest)) if len(rest) else 1.0))


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
