"""The rows that a calibration fits: frequencies of all runs with their joint covariance, and anchors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ballscrew.axis.axial import PARAMETERS, AxialModel, gradient
from ballscrew.base.arrays import Array
from ballscrew.calibration.anchors import Row, told_covariance
from ballscrew.calibration.between import Between, covariance_between, loads_repeat, worn_slopes
from ballscrew.calibration.fit import Problem, extended
from ballscrew.calibration.frequency_table import FrequencyTable, joint_covariance

__all__ = ["FLOOR", "FORM", "LOAD", "RATIOS", "problem", "relative_covariance"]


FORM = 3e-4
"""What the form of the model leaves of a frequency that is bent along the travel or by the load.

A third of a screw moves with the table only on average: near the bearing it is less. Fitted to the exact
modes of 30 axes with a bed, a spread screw and a coupling, the model leaves 1.5 to 4e-4 (root mean square).
"""

FLOOR = 1e-4
"""What is each cell's own however well it was measured: the same form, without a pattern."""

LOAD = 1e-3
"""Relative standard uncertainty of a declared load."""

RATIOS = 1.5
"""Spread of ln(P/P_ref) of another preload before anything is measured: a factor of 4.5 either way."""


def relative_covariance(
    runs: Sequence[FrequencyTable],
    groups: Sequence[int],
    model: AxialModel,
    correlation: float,
    between: Between,
) -> Array:
    """Covariance of ln f over all runs, with what no run can know of itself.

    Parameters
    ----------
    runs : sequence of FrequencyTable
        Of n cells together.
    groups : sequence of int
        Of each run that of its preload, 0 the reference.
    model : AxialModel
        For the effects of a wrong load and of a bearing that drifts.
    correlation : float
        Of causes that repeat, from run to run.
    between : Between
        What differs from one experiment to another.

    Returns
    -------
    ndarray, shape (n, n)
        The runs' own (:func:`~ballscrew.calibration.frequency_table.joint_covariance`), the loads', the
        covariance
        of experiments (:func:`~ballscrew.calibration.between.covariance_between`), the model's form.
    """
    f = np.concatenate([run.frequency for run in runs])
    x = np.concatenate([run.position for run in runs])
    load = np.concatenate([np.full(len(run.frequency), run.load) for run in runs])
    which = np.concatenate([np.full(len(run.frequency), i) for i, run in enumerate(runs)])
    whole = joint_covariance([loads_repeat(run) for run in runs], correlation) / np.outer(f, f)
    by_load = gradient(model, x, load)[:, PARAMETERS.index("mass")] / model.mass * LOAD * load
    same = which[:, None] == which[None, :]
    whole += np.where(same, np.outer(by_load, by_load), 0.0)
    whole += covariance_between(runs, groups, model, between)
    along, heavy = _centred(x), _centred(load)
    for bend in (1.5 * along**2 - 0.5, along * heavy, 1.5 * heavy**2 - 0.5):
        whole += FORM**2 * np.outer(bend, bend)
    return np.asarray(whole + FLOOR**2 * np.eye(len(f)))


def problem(
    runs: Sequence[FrequencyTable],
    groups: Sequence[int],
    rows: Sequence[Row],
    prior: tuple[Array, Array],
    centre: float,
    covariance: Array,
    between: Between,
) -> Problem:
    """Put runs, anchors and prior together.

    Parameters
    ----------
    runs, groups : sequence
        Of each run its cells, and the group of its preload.
    rows : sequence of Row
        Anchors.
    prior : tuple of ndarray
        Mean (7,) and covariance (7, 7) of the working vector.
    centre : float
        m.
    covariance : ndarray, shape (n, n)
        Of ln f.
    between : Between
        What the test's own load makes of another preload.

    Returns
    -------
    Problem
        With n + m rows.
    """
    mean, spread = extended(*prior, max(groups), RATIOS)
    counts = [len(run.frequency) for run in runs]
    n, m = sum(counts), len(rows)
    whole = np.zeros((n + m, n + m))
    whole[:n, :n] = covariance
    if m:
        whole[n:, n:] = told_covariance(rows)
    return Problem(
        centre=centre,
        position=np.concatenate([run.position for run in runs]),
        load=np.repeat([run.load for run in runs], counts).astype(float),
        group=np.repeat(np.asarray(groups, dtype=np.intp), counts),
        run=np.repeat(np.arange(len(runs), dtype=np.intp), counts),
        told=np.concatenate([*(np.log(run.frequency) for run in runs), [row.told for row in rows]]),
        covariance=whole,
        anchors=np.array([row.slopes(len(mean)) for row in rows]).reshape(m, len(mean)),
        mean=mean,
        prior=spread,
        worn=worn_slopes(runs, between.kept),
    )


def _centred(values: Array) -> Array:
    """From −1 to 1; 0 where there is one value only."""
    low, high = float(values.min()), float(values.max())
    if not high > low:
        return np.zeros_like(values)
    return np.asarray(2 * (values - low) / (high - low) - 1)
