"""Difference of the frequencies of two runs in each cell, with its uncertainty."""

from __future__ import annotations

import numpy as np

from ballscrew.base.quantity import Quantity
from ballscrew.calibration.assumptions import REPEATS
from ballscrew.calibration.covariance import joint_covariance, with_repeating_load
from ballscrew.calibration.frequency_table import frequency_table, paired_cells
from ballscrew.modal.cell import CellKey
from ballscrew.modal.run import Run


def frequency_changes(run: Run, other: Run) -> dict[CellKey, Quantity]:
    """Frequency of each cell of a run less that of the same cell of another run.

    Errors that repeat from run to run of one axis cancel as far as they are correlated; those of two axes are
    independent. The error by the load on the nut is taken to repeat, as it does at one preload. A change of
    load or temperature is not corrected.

    Parameters
    ----------
    run, other : Run
        Both with their loads.

    Returns
    -------
    dict of CellKey to Quantity
        Differences, Hz, of the cells that have a frequency in both runs, by their keys in ``run``.

    Raises
    ------
    InputError
        If a run has no load.
    """
    # A table states the error by the load on the nut as random, since it depends on the wear. At one preload
    # it repeats.
    table = with_repeating_load(frequency_table(run))
    other_table = with_repeating_load(frequency_table(other))
    rows, other_rows = paired_cells(table, other_table)
    if not rows:
        return {}
    correlation = 0.0
    if run.axis is not None and run.axis == other.axis:
        correlation = REPEATS
    covariance = joint_covariance([table, other_table], correlation)
    joint_rows = np.array(other_rows) + len(table.frequency)  # of the other run's cells in the covariance
    variance = covariance[rows, rows] + covariance[joint_rows, joint_rows] - 2 * covariance[rows, joint_rows]
    spread = np.sqrt(np.maximum(variance, 0.0))
    changes = {}
    for row, other_row, uncertainty in zip(rows, other_rows, spread.tolist(), strict=True):
        value = float(table.frequency[row] - other_table.frequency[other_row])
        key = CellKey(float(table.position[row]), table.condition[row], table.motion[row])
        changes[key] = Quantity(value, uncertainty, "Hz")
    return changes
