"""Scatter of one run, from a baseline and from axes of its size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.axis import axial
from ballscrew.axis.axial import AxialModel
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown
from ballscrew.calibration.frequency_table import FrequencyTable, frequency_table
from ballscrew.fcft.scatter import DOUBT, FrequencyScatter, run_causes
from ballscrew.modal.run import Run

Cell = tuple[float, str, int]

_FEWEST_CELLS = 4  # that all runs must have in common
_SAME_LOAD = 1e-6  # relative


@dataclass(frozen=True, slots=True, eq=False)
class Baseline:
    """Runs of a new axis with one load, at the n cells that they share.

    Parameters
    ----------
    load : float
        On the table, kg.
    position : ndarray, shape (n,)
        Positions of the cells, m.
    log_frequency : ndarray, shape (r, n)
        Logarithm of the frequencies of r runs.
    """

    load: float
    position: Array
    log_frequency: Array


@dataclass(frozen=True, slots=True)
class RunScatter:
    """Scatter of the fused change of one run.

    Parameters
    ----------
    load_kg : float
        On the table.
    log_ratio : float
        Standard deviation of ln P of one run, all cells fused.
    level_Hz : float
        The same as a common change of all frequencies, Hz.
    degrees : float
        Degrees of freedom of these.
    runs : int
        Runs of the baseline from which it was measured; 0 where it is the default alone.
    excess : float
        Standard deviation of the baseline over the default; 1 where there is none.
    weights : tuple of float
        Weight of each cell's ln f in the fused ln P.
    """

    load_kg: float
    log_ratio: float
    level_Hz: float  # noqa: N815  the unit's own letters
    degrees: float
    runs: int
    excess: float
    weights: tuple[float, ...]


def read_baseline(runs: Sequence[Run], sheet: DataSheet) -> Baseline:
    """Baseline from its runs, checked to be usable and of one axis and load.

    Parameters
    ----------
    runs : sequence of Run
        One or more.
    sheet : DataSheet
        The axis.

    Returns
    -------
    Baseline
        At the cells that all runs share.

    Raises
    ------
    InputError
        If a run is of another axis or load, is given twice, or was a bad measurement, or the runs share fewer
        than four cells.
    """
    tables = [frequency_table(run) for run in runs]
    _check_runs(tables, sheet)
    rows = [_by_cell(table) for table in tables]
    cells = sorted(set(rows[0]).intersection(*rows[1:]))
    position = np.array([place for place, _, _ in cells])
    if len(cells) < _FEWEST_CELLS or len(np.unique(position)) < 2:
        raise InputError(
            f"the runs of the baseline share {len(cells)} cells; they must share {_FEWEST_CELLS} or more at "
            "two stops or more: were they made with one plan?"
        )
    frequency = np.array([[row[cell] for cell in cells] for row in rows])
    return Baseline(tables[0].load, position, np.log(frequency))


def _check_runs(tables: Sequence[FrequencyTable], sheet: DataSheet) -> None:
    first = tables[0]
    for table in tables:
        name = table.name
        if table.axis is not None and table.axis != sheet.name:
            raise InputError(
                f"{name} is of the axis {shown(table.axis)}; {sheet.source} is that of {shown(sheet.name)}."
            )
        if table.verdict == "bad":
            raise InputError(f"{name} is a bad measurement; a baseline must be made of good runs.")
        if abs(table.load - first.load) > _SAME_LOAD * max(first.load, 1.0):
            raise InputError(
                f"{name} has a load of {table.load:g} kg, {first.name} one of {first.load:g} kg; "
                "all runs of a baseline must have the same."
            )
    if len({table.id for table in tables}) < len(tables):
        raise InputError("a run is given twice in the baseline; each must be given once.")


def _by_cell(table: FrequencyTable) -> dict[Cell, float]:
    cells = zip(np.round(table.position, 6).tolist(), table.condition, table.motion, strict=True)
    return dict(zip(cells, table.frequency.tolist(), strict=True))


def run_scatter(
    position: Array,
    load: float,
    model: AxialModel,
    scatter: FrequencyScatter,
    repetitions: int,
    baseline: Baseline | None = None,
) -> RunScatter:
    """Scatter of one run's fused ln P.

    A baseline of R runs has R − 1 degrees of freedom; the default counts as :data:`DOUBT` more, and the two
    variances are averaged by them.

    Parameters
    ----------
    position : ndarray, shape (n,)
        Positions of the cells, m; those of the baseline if there is one.
    load : float
        kg.
    model : AxialModel
        The axis.
    scatter : FrequencyScatter
        The default.
    repetitions : int
        Repetitions of a cell in a run.
    baseline : Baseline, optional
        Measured baseline of the axis.

    Returns
    -------
    RunScatter
        With the weights of the cells.
    """
    f = axial.frequency(model, position, load)
    slope = axial.gradient(model, position, load)[:, -1]
    first, last = float(position.min()), float(position.max())
    causes = run_causes(scatter.of_run(repetitions), position, first, last) / f
    covariance = causes.T @ causes + np.diag((scatter.own(repetitions) / f) ** 2)
    fused = np.linalg.solve(covariance, slope)
    weights = fused / (fused @ slope)
    variance = default = float(weights @ covariance @ weights)
    degrees, excess, runs = DOUBT, 1.0, 0
    if baseline is not None and len(baseline.log_frequency) > 1:
        runs = len(baseline.log_frequency)
        measured = float(np.var(baseline.log_frequency @ weights, ddof=1))
        degrees += runs - 1
        variance = (DOUBT * default + (runs - 1) * measured) / degrees
        excess = float(np.sqrt(measured / default))
    middle = len(f) // 2
    return RunScatter(
        load_kg=load,
        log_ratio=float(np.sqrt(variance)),
        level_Hz=float(np.sqrt(variance) * slope[middle] * f[middle]),
        degrees=degrees,
        runs=runs,
        excess=excess,
        weights=tuple(weights.tolist()),
    )
