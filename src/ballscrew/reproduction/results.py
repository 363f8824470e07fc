"""Both experiments of the paper as they were measured, and what is read off them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.modal.run import CellResult, Run
from ballscrew.reproduction.experiment import Measured

__all__ = [
    "Claim",
    "Experiments",
    "at",
    "falls_before_backlash",
    "first_backlash",
    "frequency",
    "mean_preload",
    "told",
    "truth_by_place",
    "whole_runs",
]

Key = tuple[float, str]

_NEARLY_ALL = 0.95
_SHARED = ("method", "model", "conditions", "moving table")  # terms that two runs of one axis have in common


@dataclass(frozen=True, slots=True)
class Claim:
    """One sentence of the paper.

    Parameters
    ----------
    paper : str
        What it says, and where.
    measured : str
        What our recordings say.
    holds : str
        yes, partly, no, or open where our bench cannot tell.
    differs : str
        Where our bench differs, or why.
    """

    paper: str
    measured: str
    holds: str
    differs: str


@dataclass(frozen=True, slots=True)
class Experiments:
    """Both experiments as they were measured.

    Parameters
    ----------
    sheet : DataSheet
        Of the machine.
    masses : tuple of Measured
        By ascending load.
    life : tuple of Measured
        By day.
    few : Run, optional
        The first run of the life again, from its first three recordings.
    """

    sheet: DataSheet
    masses: tuple[Measured, ...]
    life: tuple[Measured, ...]
    few: Run | None = None


def told(run: Run) -> dict[Key, CellResult]:
    """Cells that are not refused, by position and condition."""
    return {(cell.position_m, cell.condition): cell for cell in run.cells if cell.frequency_Hz is not None}


def truth_by_place(measured: Measured, key: str = "axial_natural_frequency_Hz") -> dict[float, float]:
    """A true quantity by position, m; empty where there is none."""
    table = measured.truth[key]
    assert isinstance(table, Mapping)  # noqa: S101  truth() makes it so
    return {float(place): float(value) for place, value in table.items()}


def first_backlash(life: Sequence[Measured]) -> float | None:
    """Day of the first run at which the nut truly has backlash at some stop."""
    return next(
        (one.planned.day for one in life if max(truth_by_place(one, "local_backlash_m").values()) > 0), None
    )


def whole_runs(life: Sequence[Measured]) -> tuple[Measured, ...]:
    """Runs before any backlash in which nearly all cells of the first run are told, the first among them."""
    end = first_backlash(life)
    base = told(life[0].run)
    early = [one for one in life if end is None or one.planned.day < end]
    return tuple(one for one in early if len(told(one.run).keys() & base.keys()) >= _NEARLY_ALL * len(base))


def falls_before_backlash(life: Sequence[Measured]) -> dict[Key, tuple[float, float]]:
    """By how much each cell fell from the first to the last of the whole runs, and its u, Hz."""
    runs = whole_runs(life)
    first, last = told(runs[0].run), told(runs[-1].run)
    if len(runs) < 2:
        return {}
    # What both runs share, the method's own bias, does not tell them apart.
    return {
        key: (
            frequency(first[key]) - frequency(last[key]),
            float(np.hypot(random_part(first[key]), random_part(last[key]))),
        )
        for key in first
        if key in last
    }


def frequency(cell: CellResult) -> float:
    """Of a cell that is told, Hz."""
    assert cell.frequency_Hz is not None  # noqa: S101  told() leaves out the others
    return cell.frequency_Hz


def random_part(cell: CellResult) -> float:
    """The part of a cell's standard uncertainty that differs from run to run, Hz."""
    terms = cell.uncertainty_terms_Hz
    return float(np.sqrt(sum(value**2 for name, value in terms.items() if name not in _SHARED)))


def at(table: Mapping[float, float], place: float) -> float | None:
    """Value at a position; None where there is none."""
    return next((value for known, value in table.items() if abs(known - place) < 1e-6), None)


def mean_preload(one: Measured) -> float:
    """True preload, mean over the stops, N."""
    return float(np.mean(list(truth_by_place(one, "local_preload_N").values())))
