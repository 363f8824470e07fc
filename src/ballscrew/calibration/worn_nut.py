"""Correction of a worn nut's frequency for the test's own load, which softens it more than a new nut."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.frequency_table import FrequencyTable

_LEAST_RATIO = 1e-3  # least ratio of preloads in the logarithm


def frequency_loss_under_load(
    run: FrequencyTable, rows: Sequence[int], ratio: float, assumptions: Assumptions
) -> tuple[Array, Array]:
    """Relative error of a worn nut's frequencies by the load of the test.

    Where one run does not determine the softening of the nut by the load, the frequency estimate assumes that
    of a new nut. By the nut's law the error of this assumption grows with the wear. It depends on the load on
    the nut, and on how far the run's own data determine the softening; a run states neither, but their
    product, as its uncertainty term "load". The correction is a multiple of this term, so uncertain that its
    95 % interval contains no correction and twice as much.

    Parameters
    ----------
    run : FrequencyTable
        Run that states the term; its preload is the reference of the ratio.
    rows : sequence of int
        Rows of the cells in ``run``.
    ratio : float
        Preload of the worn nut over that of ``run``.
    assumptions : Assumptions
        With the multiple of the term, ``nut_load``, and its uncertainty.

    Returns
    -------
    loss : ndarray, shape (rows,)
        Relative error by which the frequency is too low.
    spread : ndarray, shape (rows,)
        Standard deviation of the loss.
    """
    term = nut_load_uncertainty(run)[list(rows)] / run.frequency[list(rows)]
    error = term * -math.log(max(ratio, _LEAST_RATIO))
    return error * assumptions.nut_load, np.abs(error) * assumptions.nut_load_spread


def nut_load_uncertainty(run: FrequencyTable) -> Array:
    """Uncertainty term "load" of each cell, Hz, shape (n,); 0 where the run has none."""
    total = np.zeros_like(run.frequency)
    for name, effect in zip(run.shared_names, run.shared, strict=True):
        if is_nut_load(name):
            total += effect**2
    return np.sqrt(total)


def is_nut_load(name: str) -> bool:
    """Whether a shared error is that by the load on the nut, or its level or tilt: "load: level"."""
    return name.split(":")[0] == "load"
