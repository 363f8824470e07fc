"""Both experiments of the paper as they were measured, and the quantities that its claims need."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.modal.cell import CellResult
from ballscrew.modal.run import Run
from ballscrew.reproduction.experiment import Measured

Key = tuple[float, str]  # position, m, and condition of a cell

_COMPLETE = 0.95  # part of the first run's cells that a run must report to count as complete
_SHARED = ("method", "model", "conditions", "moving table")  # uncertainty terms common to all runs of an axis


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement of the paper and the corresponding result.

    Parameters
    ----------
    paper : str
        The statement, and where it stands.
    measured : str
        The result of the recordings.
    holds : str
        yes, partly, no, or open where the testbed cannot decide.
    remark : str
        Differences of the testbed from the paper's bench, or the explanation.
    """

    paper: str
    measured: str
    holds: str
    remark: str


@dataclass(frozen=True, slots=True)
class Experiments:
    """Both experiments as they were measured.

    Parameters
    ----------
    sheet : DataSheet
        Data sheet of the machine.
    masses : tuple of Measured
        Multi-level-mass experiment, by ascending load.
    life : tuple of Measured
        Run-to-failure experiment, by day.
    short_run : Run, optional
        The first run of the life, analysed again from its first three recordings only.
    gentle : tuple of Measured
        Further runs of the life with a gentler motion, by day, the first on day 0.
    """

    sheet: DataSheet
    masses: tuple[Measured, ...]
    life: tuple[Measured, ...]
    short_run: Run | None = None
    gentle: tuple[Measured, ...] = ()


def reported_cells(run: Run) -> dict[Key, CellResult]:
    """Cells with a frequency, by position and condition."""
    return {(cell.position_m, cell.condition): cell for cell in run.cells if cell.frequency_Hz is not None}


def frequencies(run: Run) -> dict[Key, float]:
    """Frequencies of the reported cells, Hz, by position and condition."""
    return {(c.position_m, c.condition): c.frequency_Hz for c in run.cells if c.frequency_Hz is not None}


def theory_error(experiments: Experiments, theory: Callable[[float, float], Array]) -> float:
    """Root mean square of measured minus theoretical frequency, over every cell under every load, Hz.

    The theory takes position, m, and load, kg.
    """
    errors = []
    for measured in experiments.masses:
        for (position, _), value in frequencies(measured.run).items():
            errors.append(value - float(theory(position, measured.planned.load)))
    return rms_of(errors) if errors else float("nan")


def rms_of(values: Sequence[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def true_values(measured: Measured, key: str = "axial_natural_frequency_Hz") -> dict[float, float]:
    """True values of a quantity by position, m; empty where the quantity does not exist."""
    table = measured.truth[key]
    assert isinstance(table, Mapping)  # noqa: S101  truth() makes it so
    return {float(position): float(value) for position, value in table.items()}


def value_at(table: Mapping[float, float], position: float) -> float:
    """Value of a table at a position, m; NaN where the table lacks it."""
    for known, value in table.items():
        if abs(known - position) < 1e-6:
            return value
    return float("nan")


def mean_preload(measured: Measured) -> float:
    """True preload, N, mean over the stops."""
    return float(np.mean(list(true_values(measured, "local_preload_N").values())))


def first_backlash(life: Sequence[Measured]) -> float | None:
    """Day of the first run in which the nut truly has backlash at some stop."""
    for measured in life:
        if max(true_values(measured, "local_backlash_m").values()) > 0:
            return measured.planned.day
    return None


def runs_before_backlash(life: Sequence[Measured]) -> list[Measured]:
    """Runs earlier than the first one with backlash."""
    day = first_backlash(life)
    if day is None:
        return list(life)
    return [measured for measured in life if measured.planned.day < day]


def complete_runs(life: Sequence[Measured]) -> tuple[Measured, ...]:
    """Runs before any backlash that report nearly all cells of the first run, including the first."""
    first = reported_cells(life[0].run).keys()
    complete = []
    for measured in runs_before_backlash(life):
        common = reported_cells(measured.run).keys() & first
        if len(common) >= _COMPLETE * len(first):
            complete.append(measured)
    return tuple(complete)


def falls_before_backlash(life: Sequence[Measured]) -> dict[Key, tuple[float, float]]:
    """Fall of each cell's frequency from the first to the last complete run, Hz, and its uncertainty.

    Terms of the uncertainty that both runs share, such as the bias of the method, cancel in the difference.
    """
    runs = complete_runs(life)
    if len(runs) < 2:
        return {}
    first, last = reported_cells(runs[0].run), reported_cells(runs[-1].run)
    falls = {}
    for key in first.keys() & last.keys():
        before, after = first[key], last[key]
        assert before.frequency_Hz is not None  # noqa: S101  these cells are reported
        assert after.frequency_Hz is not None  # noqa: S101
        uncertainty = np.hypot(_random_uncertainty(before), _random_uncertainty(after))
        falls[key] = (before.frequency_Hz - after.frequency_Hz, float(uncertainty))
    return {key: falls[key] for key in first if key in falls}


def _random_uncertainty(cell: CellResult) -> float:
    """Part of a cell's standard uncertainty that differs from run to run, Hz."""
    variance = 0.0
    for name, value in cell.uncertainty_terms_Hz.items():
        if name not in _SHARED:
            variance += value**2
    return float(np.sqrt(variance))
