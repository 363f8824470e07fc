"""Expected information of one run of a plan about the axis, at its own or at another preload."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.axis import axial
from ballscrew.axis.axial import PARAMETERS, AxialModel, from_vector
from ballscrew.axis.axial_prior import KNOWN_PRELOAD, prior
from ballscrew.axis.information import fisher_information
from ballscrew.axis.rigidity import at_preload
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.fcft.conditions import conditions_at
from ballscrew.fcft.plan import Plan
from ballscrew.fcft.scatter import FrequencyScatter, run_causes

_SAME = 0.1  # relative difference of preloads below which a run is one at the model's own


@dataclass(frozen=True, slots=True, eq=False)
class RunRows:
    """Expected information of one run, one row per stop; all errors relative to the frequency.

    Parameters
    ----------
    jacobian : ndarray, shape (n, 8)
        Derivative of ln f with respect to the working vector and the log ratio (0 for that of the reference
        run).
    own : ndarray, shape (n,)
        Standard deviation of the independent error of the mean of a stop's cells.
    runs, lasting : ndarray, shape (2, n)
        Errors of level and tilt: random per run, and constant for the axis.
    loads : ndarray, shape (n,)
        Errors by the uncertainty of the load.
    """

    jacobian: Array
    own: Array
    runs: Array
    lasting: Array
    loads: Array

    def information(self, stops: Sequence[int] | None = None) -> Array:
        """Fisher information about working vector and log ratio, shape (8, 8), without lasting errors.

        Parameters
        ----------
        stops : sequence of int, optional
            Rows to use; by default all.
        """
        rows = slice(None) if stops is None else list(stops)
        shared = np.concatenate([self.runs, self.loads[None]])
        return fisher_information(self.jacobian[rows], self.own[rows], shared[:, rows])


def run_rows(
    plan: Plan,
    load: float,
    model: AxialModel,
    scatter: FrequencyScatter,
    span: tuple[float, float],
    ratio: float = 1.0,
) -> RunRows:
    """Expected information of the run of a plan with one load.

    Parameters
    ----------
    plan : Plan
        The test.
    load : float
        Load on the table, kg.
    model : AxialModel
        Point of linearisation.
    scatter : FrequencyScatter
        Scatter of the runs.
    span : tuple of float
        Positions at which the tilt of a run is −1 and 1, m.
    ratio : float
        P/P_ref; 1 for the reference run.

    Returns
    -------
    RunRows
        One row per stop.

    Raises
    ------
    InputError
        If a stop leaves the screw.
    """
    x = np.array(plan.positions)
    f = axial.frequency(model, x, load, ratio)
    slopes = axial.gradient(model, x, load, ratio)
    if ratio == 1.0:
        slopes[:, -1] = 0.0  # the reference run has no information on a later preload
    cells = len(plan.motions) * np.array([len(conditions_at(i, len(x))) for i in range(len(x))])
    by_load = slopes[:, PARAMETERS.index("mass")] / model.mass  # load and table have the same effect
    return RunRows(
        jacobian=slopes,
        own=scatter.own(plan.repetitions) / np.sqrt(cells) / f,
        runs=run_causes(scatter.of_run(plan.repetitions), x, *span) / f,
        lasting=run_causes(scatter.lasting, x, *span) / f,
        loads=by_load * scatter.load * load,
    )


def reference_preload(preloads: Sequence[float], nominal: float) -> float:
    """Planned preload nearest to the nominal one: the axis is in use with it."""
    return min(preloads, key=lambda preload: abs(np.log(preload / nominal)), default=nominal)


def sheet_prior(plan: Plan, sheet: DataSheet) -> tuple[AxialModel, Array]:
    """Expected axis by the data sheet and its covariance, at the reference preload of a plan.

    Parameters
    ----------
    plan : Plan
        The test.
    sheet : DataSheet
        The axis.

    Returns
    -------
    model : AxialModel
        With its centre in the middle of the stops.
    covariance : ndarray, shape (7, 7)
        Covariance of its working vector.
    """
    if plan.preloads:
        sheet = at_preload(sheet, reference_preload(plan.preloads, sheet.nominal_preload))
    centre = (plan.positions[0] + plan.positions[-1]) / 2
    mean, covariance = prior(sheet, centre)
    return from_vector(mean, centre), covariance


def preload_ratio(preload: float | None, reference: float | None, model: AxialModel) -> float:
    """P/P_ref of a run; 1 for the reference preload of a plan, where that is the model's, and without one."""
    if preload is None or (preload == reference and abs(preload / model.preload - 1) < _SAME):
        return 1.0
    return preload / model.preload


def known_preload_information(runs: Array, reference: bool) -> Array:
    """Information of the runs at one known preload about the working vector, shape (7, 7).

    Parameters
    ----------
    runs : ndarray, shape (8, 8)
        Their information about working vector and log ratio.
    reference : bool
        Whether the preload is the reference preload, so that there is no log ratio.

    Returns
    -------
    ndarray
        With the log ratio unknown but for the statement of the preload.
    """
    return without_ratios(runs + known_preload(len(runs), None if reference else 0))


def known_preload(unknowns: int, group: int | None) -> Array:
    """Information of the statement of a preload, shape (unknowns, unknowns).

    Parameters
    ----------
    unknowns : int
        Number of parameters of working vector and log ratios.
    group : int or None
        Number of the log ratio that is added to ln P_ref; None for the reference preload.

    Returns
    -------
    ndarray
        With :data:`~ballscrew.axis.axial_prior.KNOWN_PRELOAD` as its standard uncertainty.
    """
    row = np.zeros(unknowns)
    row[PARAMETERS.index("preload")] = 1.0
    if group is not None:
        row[len(PARAMETERS) + group] = 1.0
    return np.outer(row, row) / KNOWN_PRELOAD**2


def without_ratios(information: Array) -> Array:
    """Information about the working vector alone, with the log ratios that follow it unknown.

    Parameters
    ----------
    information : ndarray, shape (7 + k, 7 + k)
        About working vector and k log ratios.

    Returns
    -------
    ndarray, shape (7, 7)
        The same where there is no information about any log ratio.
    """
    size = len(PARAMETERS)
    inner, across = information[size:, size:], information[:size, size:]
    if not inner.any():
        return information[:size, :size]
    return np.asarray(information[:size, :size] - across @ np.linalg.pinv(inner, hermitian=True) @ across.T)
