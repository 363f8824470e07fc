"""Robust fit of a calibration: outlying cells, runs and anchors lose weight and are named."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.calibration.fit import Fit, Problem, solve

_CELL_LIMIT = 4.0
"""Standard deviations from the prediction by all other rows, beyond which a cell loses weight."""

_RUN_LIMIT = 16.0
"""χ² of a run's level and tilt against all other rows, beyond which the run loses weight: 1 in 3000."""

_ANCHOR_LIMIT = 3.0
"""Standard deviations from the prediction by all other rows, beyond which an anchor is named."""

_MOST_OUTLIERS = 0.25
"""Largest part of a run's cells that may lose weight: beyond it, the run is refused."""

_ROUNDS = 24  # most fits, each with less weight of another cell or run
_NORMAL = 1.4826  # standard deviation of a normal distribution over its median absolute deviation


@dataclass(slots=True, eq=False)
class RobustFit:
    """A fit with less weight of outlying cells and runs; the search for these changes it.

    Parameters
    ----------
    fit : Fit
        The last one, of the problem with the added covariances.
    weights : ndarray, shape (runs,)
        1; less where a run lost weight.
    cells : dict of int to float
        Rows of cells that lost weight, and the variance of ln f that was added to each.
    runs : dict of int to ndarray, shape (n + m, n + m)
        Runs that lost weight, and the covariance of the rows that was added for each.
    contradicting : set of int
        Runs of one preload that contradict each other; the data do not show which is wrong.
    refused : set of int
        Runs with too many outlying cells.
    anchors : tuple of (int, float)
        Outlying anchors, and their distances from the prediction in standard deviations.
    unfinished : bool
        Whether more outliers remain after the last round.
    """

    fit: Fit
    weights: Array
    cells: dict[int, float] = field(default_factory=dict)
    runs: dict[int, Array] = field(default_factory=dict)
    contradicting: set[int] = field(default_factory=set)
    refused: set[int] = field(default_factory=set)
    anchors: tuple[tuple[int, float], ...] = ()
    unfinished: bool = False


def fit_robustly(problem: Problem) -> RobustFit:
    """Fit; reduce the weight of the worst cell or run; fit again until all fit, or 24 times.

    Each row is compared with its prediction by all others, with the uncertainty of parameters and common
    errors. An outlying cell gets its deviation as additional uncertainty, an outlying run that of its level
    and tilt. Where most cells deviate by more than their uncertainty, these are no outliers: a cell is then
    compared with the scatter of the cells.

    Parameters
    ----------
    problem : Problem
        Rows and prior.

    Returns
    -------
    RobustFit
        The fit, and the outliers.

    Raises
    ------
    MeasurementError
        If it does not converge.
    """
    robust = RobustFit(solve(problem), np.ones(problem.runs))
    for _ in range(_ROUNDS):
        reduced = _reduce_worst(robust)
        if reduced is None:
            break
        robust.fit = solve(reduced, robust.fit.unknown)
    else:
        robust.unfinished = _worst(robust, *leave_one_out(robust.fit)) is not None
    n = len(problem.position)
    inverse, weighted = leave_one_out(robust.fit)
    distance = weighted[n:] / np.sqrt(np.diag(inverse)[n:])
    outlying = np.flatnonzero(np.abs(distance) > _ANCHOR_LIMIT).tolist()
    robust.anchors = tuple((i, float(distance[i])) for i in outlying)
    return robust


def leave_one_out(fit: Fit) -> tuple[Array, Array]:
    """Inverse covariance of the rows, prior included, and its product with their deviations from the prior.

    Row i deviates from its prediction by all others by ``weighted[i] / inverse[i, i]``, with a variance of
    1 / inverse[i, i]; for a block of rows, the inverse of the block takes the place of 1 / inverse[i, i].

    Returns
    -------
    inverse : ndarray, shape (n + m, n + m)
        Of the covariance of the rows about their prediction by the prior's mean.
    weighted : ndarray, shape (n + m,)
        ``inverse`` times the rows less that prediction.
    """
    problem, slopes = fit.problem, fit.problem.jacobian(fit.unknown)
    inverse = np.linalg.inv(problem.covariance + slopes @ problem.prior @ slopes.T)
    inverse = (inverse + inverse.T) / 2
    return inverse, np.asarray(inverse @ (fit.residual + slopes @ problem.deviation(fit.unknown)))


def _reduce_worst(robust: RobustFit) -> Problem | None:
    """The problem with less weight of the worst outlier, which is entered in ``robust``; None at the end."""
    inverse, weighted = leave_one_out(robust.fit)
    worst = _worst(robust, inverse, weighted)
    if worst is None:
        return None
    kind, index = worst
    if kind == "run":
        return _reduce_run(robust, inverse, weighted, index)
    return _reduce_cell(robust, float((weighted[index] / inverse[index, index]) ** 2), index)


def _worst(robust: RobustFit, inverse: Array, weighted: Array) -> tuple[str, int] | None:
    """Kind and index of the worst outlier, a run before its cells, since it shifts them all; or None."""
    distances = _cell_distances(robust, inverse, weighted)
    scores = _run_scores(robust, inverse, weighted)
    cell, run = int(np.argmax(distances)), int(np.argmax(scores))
    if scores[run] > _RUN_LIMIT and scores[run] > distances[cell] ** 2:
        return "run", run
    if distances[cell] > _CELL_LIMIT:
        return "cell", cell
    return None


def _reduce_run(robust: RobustFit, inverse: Array, weighted: Array, run: int) -> Problem | None:
    """The problem with a level and a tilt added to the errors of a run; None where others may be wrong."""
    problem = robust.fit.problem
    groups = np.array(problem.run_groups)
    mates = np.flatnonzero(groups == groups[run])
    # A run is an outlier only among three or more of its preload, and only while most runs are none.
    if len(mates) < 3 or len(robust.runs) >= (problem.runs - 1) // 2:
        scores = _run_scores(robust, inverse, weighted)
        robust.contradicting |= {int(i) for i in mates if scores[i] > _RUN_LIMIT or int(i) in robust.runs}
        return None
    _, added = _score_run(problem, inverse, weighted, run)
    rows = np.flatnonzero(problem.run == run)
    before = np.mean(np.diag(problem.covariance)[rows])
    robust.weights[run] = float(before / (before + np.mean(np.diag(added)[rows])))
    robust.runs[run] = added
    return replace(problem, covariance=problem.covariance + added)


def _reduce_cell(robust: RobustFit, variance: float, cell: int) -> Problem | None:
    """The problem with a variance added to a cell; None where the run has too many such cells."""
    problem = robust.fit.problem
    robust.cells[cell] = variance
    run = int(problem.run[cell])
    outlying = np.sum(problem.run[list(robust.cells)] == run)
    if outlying > _MOST_OUTLIERS * np.sum(problem.run == run):
        robust.refused.add(run)
        return None
    covariance = problem.covariance.copy()
    covariance[cell, cell] += variance
    return replace(problem, covariance=covariance)


def _cell_distances(robust: RobustFit, inverse: Array, weighted: Array) -> Array:
    """Distance of each cell from its prediction, shape (n,), over its uncertainty and the cells' scatter."""
    n, outliers = len(robust.fit.problem.position), list(robust.cells)
    distances = np.abs(weighted / np.sqrt(np.diag(inverse)))[:n]
    distances[outliers] = 0.0
    others = np.delete(distances, outliers)
    scatter = 1.0
    if len(others):
        scatter = max(1.0, _NORMAL * float(np.median(others)))
    return np.asarray(distances / scatter)


def _run_scores(robust: RobustFit, inverse: Array, weighted: Array) -> Array:
    """χ² of the level and tilt of each run, shape (runs,); 0 for those that have lost weight."""
    scores = np.zeros(robust.fit.problem.runs)
    for run in range(len(scores)):
        if run not in robust.runs:
            scores[run], _ = _score_run(robust.fit.problem, inverse, weighted, run)
    return scores


def _score_run(problem: Problem, inverse: Array, weighted: Array, run: int) -> tuple[float, Array]:
    """χ² of a run's level and tilt against all other rows, and the covariance by which they fit.

    The covariance, shape (n + m, n + m), has the squares of both as variances.
    """
    rows = np.flatnonzero(problem.run == run)
    x = problem.position[rows]
    basis = np.ones((len(rows), 1))
    if np.ptp(x) > 0:
        basis = np.stack([np.ones(len(rows)), (x - x.mean()) / np.ptp(x) * 2], axis=1)
    precision = basis.T @ inverse[np.ix_(rows, rows)] @ basis
    deviation = np.linalg.solve(precision, basis.T @ weighted[rows])
    added = np.zeros_like(inverse)
    added[np.ix_(rows, rows)] = basis @ np.diag(deviation**2) @ basis.T
    return float(deviation @ precision @ deviation), added
