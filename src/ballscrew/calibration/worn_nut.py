"""Correction of a worn nut's frequency for the test's own load, which softens it more than a new nut."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.frequency_table import FrequencyTable

_LEAST_RATIO = 1e-3  # of preloads, for the logarithm


def frequency_loss_under_load(
    run: FrequencyTable, rows: Sequence[int], ratio: float, assumptions: Assumptions
) -> tuple[Array, Array]:
    """Relative error of a worn nut's frequencies by the load of the test.

    The frequency estimate assumes the softening of a new nut as far as one run does not determine it. By the
    nut's law the remaining error grows with the wear; its size depends on the load on the nut and on how far
    the run's own data determined the softening, and a run states neither. It states the product, as its
    uncertainty term "load". The correction is a multiple of that, so uncertain that its 95 % interval
    contains no correction and twice as much.

    Parameters
    ----------
    run : FrequencyTable
        At the reference of the ratio; states the term.
    rows : sequence of int
        Which of its cells.
    ratio : float
        P over the preload of that run.
    assumptions : Assumptions
        Multiple of the term, and its uncertainty.

    Returns
    -------
    ndarray, shape (rows,)
        Relative error: the frequency is too low by it.
    ndarray, shape (rows,)
        Its standard deviation.
    """
    term = nut_load_uncertainty(run)[list(rows)] / run.frequency[list(rows)]
    error = term * -math.log(max(ratio, _LEAST_RATIO))
    return error * assumptions.nut_load, np.abs(error) * assumptions.nut_load_spread


def nut_load_uncertainty(run: FrequencyTable) -> Array:
    """Uncertainty term "load" of each cell, Hz; 0 where the run has none."""
    total = np.zeros_like(run.frequency)
    for name, effect in zip(run.shared_names, run.shared, strict=True):
        if is_nut_load(name):
            total += effect**2
    return np.sqrt(total)


def is_nut_load(name: str) -> bool:
    """True for an error by the nut's load; in a run without shared errors it is a level and a tilt."""
    return name.split(":")[0] == "load"
