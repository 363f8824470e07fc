"""Expected errors of the frequencies of a run, by cause."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.settings import check_setting

DOUBT = 8.0
"""Degrees of freedom of the default of ``FrequencyScatter.run``.

Two axes of one size differ in it by a quarter or so, which is what a variance from eight numbers would.
"""

# Change between two runs of one state, docs/explanation/identification.md: 0.05 Hz on larger axes, 0.15 Hz on
# the smallest; and the noise of one trip that the bound of an isolated cell with ten trips leaves there.
_SMALL, _LARGE = 0.016, 0.025  # nominal diameter, m
_CHANGE = (0.15, 0.05)  # Hz
_TRIP = (0.22, 0.013)  # Hz: 0.07 and 0.004 Hz with ten trips
_CELL = 0.10  # Hz: a median error of 0.07 Hz, which more trips do not mend
_TRIPS = 10  # of the runs that this was measured with; three made it 0.8 to 2.1 times as large
_LOAD = 1e-3


@dataclass(frozen=True, slots=True)
class FrequencyScatter:
    """Standard deviations of the errors of a run's frequencies, each cause independent of the others.

    Parameters
    ----------
    cell : float
        Error of a single cell, whatever the number of repetitions, Hz.
    trip : float
        Error of a single cell in a single repetition, Hz; repetitions average it out.
    run : float
        Error common to all cells of a run of ten trips or more, new in each run; and once more tilted along
        the stops, at the first stop with the other sign than at the last, Hz. Cells do not average it out.
    lasting : float
        Error common to all cells in every run of this axis, and once more tilted, Hz: error of the method.
        It cancels in a change.
    load : float
        Error of a load on the table, as a part of it; the same whenever the same weight is laid on.
    source : str
        Where the numbers are from, for people.

    Raises
    ------
    InputError
        If one is not finite, negative, or nothing is left of a cell's own.
    """

    cell: float
    trip: float
    run: float
    lasting: float
    load: float = _LOAD
    source: str = "given"

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        for name in ("cell", "trip", "run", "lasting", "load"):
            check_setting(f"a scatter's {name}", getattr(self, name), least=0)
        if not self.cell > 0:
            raise InputError("a scatter's cell of 0 was given; a cell always has an error of its own.")

    def own(self, repetitions: int) -> float:
        """Standard deviation of a cell's average over its repetitions, Hz."""
        return math.hypot(self.cell, self.trip / math.sqrt(repetitions))

    def of_run(self, repetitions: int) -> float:
        """Standard deviation of a run's level and of its tilt, Hz; larger with fewer trips than ten."""
        return self.run * math.sqrt(max(1.0, _TRIPS / repetitions))


def default_scatter(sheet: DataSheet) -> FrequencyScatter:
    """Scatter of an axis that was never measured, by its size.

    Two runs of one state were found to differ by 0.05 Hz on larger axes and by 0.15 Hz on the smallest, in
    all cells alike, with ten trips each: one run scatters by 1/√2 of that. Sizes in between lie in between.

    Parameters
    ----------
    sheet : DataSheet
        Gives the screw's nominal diameter.

    Returns
    -------
    FrequencyScatter
        Hz.
    """
    small, large = _CHANGE
    size = np.clip((sheet.screw.nominal_diameter - _SMALL) / (_LARGE - _SMALL), 0, 1)
    run = (small + (large - small) * float(size)) / math.sqrt(2)
    trip = _TRIP[0] * (_TRIP[1] / _TRIP[0]) ** float(size)
    return FrequencyScatter(_CELL, trip, run, _CELL, source="default for a screw of this size")


def run_causes(scatter: float, position: ArrayLike, first: float, last: float) -> Array:
    """Effects of two causes on the cells of a run: level, and tilt from −1 at the first stop to 1.

    The frequencies of a run come from one smooth curve. So it has a level and a tilt that no number of stops
    makes surer.

    Parameters
    ----------
    scatter : float
        Standard deviation of either effect, Hz.
    position : array_like, shape (n,)
        Positions of the cells, m.
    first, last : float
        The stops where the tilt is −1 and 1, m.

    Returns
    -------
    ndarray, shape (2, n)
        Hz.
    """
    x = np.asarray(position, dtype=np.float64)
    tilt = (2 * x - first - last) / (last - first)
    return scatter * np.stack([np.ones_like(x), tilt])
