"""Both experiments of the paper as they were measured, and what is read off them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.cli.experiment import Measured
from ballscrew.modal.run import CellResult, Run

__all__ = [
    "Experiments",
    "at",
    "falls_before_backlash",
    "first_backlash",
    "frequency",
    "told",
    "truth_by_place",
]

Key = tuple[float, str]


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
    """

    sheet: DataSheet
    masses: tuple[Measured, ...]
    life: tuple[Measured, ...]


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


def falls_before_backlash(life: Sequence[Measured]) -> dict[Key, tuple[float, float]]:
    """By how much each cell fell from the first run to the last before backlash, and its u, Hz."""
    end = first_backlash(life)
    base = told(life[0].run)
    falls = {}
    for one in life[1:]:
        if end is not None and one.planned.day >= end:
            break
        for key, cell in told(one.run).items():
            if key in base:
                # What all runs share, the method's own bias, does not tell them apart.
                u = float(np.hypot(random_part(base[key]), random_part(cell)))
                falls[key] = (frequency(base[key]) - frequency(cell), u)
    return falls


def frequency(cell: CellResult) -> float:
    """Of a cell that is told, Hz."""
    assert cell.frequency_Hz is not None  # noqa: S101  told() leaves out the others
    return cell.frequency_Hz


def random_part(cell: CellResult) -> float:
    terms = cell.uncertainty_terms_Hz
    return float(np.hypot(terms.get("repetitions", 0.0), terms.get("window", 0.0)))


def at(table: Mapping[float, float], place: float) -> float | None:
    """Value at a position; None where there is none."""
    return next((value for known, value in table.items() if abs(known - place) < 1e-6), None)
