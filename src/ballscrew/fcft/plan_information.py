"""Information of a plan before anything moves: expected accuracy of the axis, and time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from ballscrew.axis import axial
from ballscrew.axis.axial import PARAMETERS, AxialModel
from ballscrew.axis.information import d_information, fisher_information, gained_bits, posterior
from ballscrew.base.arrays import Array
from ballscrew.fcft.conditions import conditions_at
from ballscrew.fcft.plan import Plan
from ballscrew.fcft.scatter import FrequencyScatter, run_causes
from ballscrew.fcft.schedule import duration

LATER = (0.9, 0.5)
"""P/P₀ of later runs whose accuracy is predicted."""

_FLAT = 1e4  # prior variance of the log ratio of a later run: nothing is known of it


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Uncertainty of one parameter before and after the test.

    Parameters
    ----------
    name : str
        One of :data:`ballscrew.axis.axial.PARAMETERS`.
    before, after : float
        Relative standard uncertainty: by the data sheet, and with the test.
    """

    name: str
    before: float
    after: float


@dataclass(frozen=True, slots=True)
class Later:
    """Expected accuracy of the preload from a later run of the same stops with one load.

    Parameters
    ----------
    ratio : float
        P/P₀ that it has.
    standard_uncertainty : float
        Standard uncertainty of P/P₀.
    random : float
        Part by the scatter of runs; the rest is uncertainty of the axis, which no run reduces.
    preload : float
        Standard uncertainty of P in newtons, as a part of P.
    """

    ratio: float
    standard_uncertainty: float
    random: float
    preload: float


@dataclass(frozen=True, slots=True)
class PlanInformation:
    """Information and expected accuracy of a plan.

    Parameters
    ----------
    minutes, measuring_minutes : float
        Time with all loads, with and without changing them, min.
    information : float
        det^(1/p) of the information about the parameters that frequencies at one preload determine:
        compliance, slope, moving mass, and the curve of a screw with both ends fixed.
    bits : float
        Information gained over the data sheet, bits.
    accuracy : tuple of Accuracy
        Accuracy of each parameter.
    later : tuple of Later
        Accuracy of later runs at the ratios :data:`LATER`.
    """

    minutes: float
    measuring_minutes: float
    information: float
    bits: float
    accuracy: tuple[Accuracy, ...]
    later: tuple[Later, ...]

    @property
    def per_minute(self) -> float:
        """Information per minute, by which plans are compared."""
        return self.information / self.minutes

    def to_json(self) -> dict[str, Any]:
        """Document with units in the keys."""
        return {
            "minutes": self.minutes,
            "measuring_minutes": self.measuring_minutes,
            "information": self.information,
            "information_per_minute": self.per_minute,
            "bits": self.bits,
            "accuracy": list(map(asdict, self.accuracy)),
            "later_runs": list(map(asdict, self.later)),
        }


def test_minutes(plan: Plan, change_minutes: float) -> tuple[float, float]:
    """Time of a plan with all its loads, min: with the changes of load, and measuring alone."""
    measuring = len(plan.masses) * duration(plan) / 60
    return measuring + (len(plan.masses) - 1) * change_minutes, measuring


test_minutes.__test__ = False  # type: ignore[attr-defined]  # pytest would take it for a test


def determined_parameters(model: AxialModel) -> tuple[int, ...]:
    """Indices of the parameters that frequencies at one preload determine without the data sheet."""
    names = ["compliance", "slope", "mass"]
    if model.curve:
        names.append("curve")
    return tuple(map(PARAMETERS.index, names))


def marginal_precision(covariance: Array) -> Array:
    """Reciprocal prior variances of the working vector; infinite for a fixed parameter."""
    variance = np.diag(covariance)
    precision = np.full(len(variance), np.inf)
    precision[variance > 0] = 1 / variance[variance > 0]
    return precision


@dataclass(frozen=True, slots=True, eq=False)
class RunRows:
    """Expected information of one run, one row per stop; all errors relative to the frequency.

    Parameters
    ----------
    jacobian : ndarray, shape (n, 8)
        Derivative of ln f by the working vector and the log ratio (0 for the log ratio of the reference run).
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
        """Fisher information about the working vector, shape (7, 7), without lasting errors.

        Parameters
        ----------
        stops : sequence of int, optional
            Rows to use; by default all.
        """
        rows = slice(None) if stops is None else list(stops)
        shared = np.concatenate([self.runs, self.loads[None]])
        return fisher_information(self.jacobian[rows, : len(PARAMETERS)], self.own[rows], shared[:, rows])


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


def plan_information(
    plan: Plan,
    model: AxialModel,
    covariance: Array,
    scatter: FrequencyScatter,
    change_minutes: float,
    span: tuple[float, float] | None = None,
) -> PlanInformation:
    """Information and accuracy of a plan on an axis.

    Parameters
    ----------
    plan : Plan
        The test.
    model : AxialModel
        Expected axis.
    covariance : ndarray, shape (7, 7)
        Prior covariance of the working vector.
    scatter : FrequencyScatter
        Scatter of the runs.
    change_minutes : float
        Time to change the load on the table, min.
    span : tuple of float, optional
        Positions at which the tilt of a run is −1 and 1, m; by default the ends of the plan.

    Returns
    -------
    PlanInformation
        To first order about the model, nut unloaded, rotor free.

    Raises
    ------
    InputError
        If a stop leaves the screw.
    """
    if span is None:
        span = (plan.positions[0], plan.positions[-1])
    precision = marginal_precision(covariance)
    first = [run_rows(plan, load, model, scatter, span) for load in plan.masses]
    of_runs = np.sum([run.information() for run in first], axis=0)
    information = _joint_information(first)[:-1, :-1]
    after = posterior(covariance, information)
    minutes, measuring = test_minutes(plan, change_minutes)
    scale = np.ones(len(PARAMETERS))  # logarithms are relative as they are
    scale[PARAMETERS.index("slope")] = abs(model.slope) or 1.0
    scale[PARAMETERS.index("curve")] = abs(model.curve) or 1.0
    scale[PARAMETERS.index("share")] = 1 / (1 - model.share)
    before_uncertainty = np.sqrt(np.diag(covariance)) / scale
    after_uncertainty = np.sqrt(np.maximum(np.diag(after), 0.0)) / scale
    accuracy = []
    for name, before, then in zip(PARAMETERS, before_uncertainty, after_uncertainty, strict=True):
        if name != "curve" or model.curve:
            accuracy.append(Accuracy(name, float(before), float(then)))
    return PlanInformation(
        minutes=minutes,
        measuring_minutes=measuring,
        information=d_information(of_runs, determined_parameters(model), precision),
        bits=gained_bits(covariance, information),
        accuracy=tuple(accuracy),
        later=tuple(_later(ratio, plan, model, covariance, scatter, span, first) for ratio in LATER),
    )


def _later(
    ratio: float,
    plan: Plan,
    model: AxialModel,
    covariance: Array,
    scatter: FrequencyScatter,
    span: tuple[float, float],
    first: Sequence[RunRows],
) -> Later:
    """Accuracy of one more run with the heaviest load, at a part of the preload."""
    load = max(plan.masses)
    again = run_rows(plan, load, model, scatter, span, ratio)
    information = _joint_information([*first, again], same_load=plan.masses.index(load))
    wide = np.zeros((len(PARAMETERS) + 1,) * 2)
    wide[:-1, :-1] = covariance
    wide[-1, -1] = _FLAT
    after = posterior(wide, information)
    # Relative to a baseline of the same load, with a known axis: the scatter of two runs and their cells.
    shared = np.concatenate([again.runs, again.runs])
    scattered = fisher_information(again.jacobian[:, -1:], np.sqrt(2) * again.own, shared)[0, 0]
    newtons = PARAMETERS.index("preload")
    absolute = after[-1, -1] + after[newtons, newtons] + 2 * after[-1, newtons]
    whole = float(np.sqrt(after[-1, -1]))
    return Later(
        ratio=ratio,
        standard_uncertainty=ratio * whole,
        random=ratio * min(whole, float(1 / np.sqrt(scattered))),
        preload=float(np.sqrt(max(absolute, 0.0))),
    )


def _joint_information(runs: Sequence[RunRows], same_load: int | None = None) -> Array:
    """Information of several runs about the working vector and the log ratio of a later run, shape (8, 8).

    Errors of level and tilt are independent between runs, and lasting errors are common to all. The last run
    has the same weight on the table as run ``same_load``, if that is given.
    """
    jacobian, own, levels, lasting, loads = zip(
        *((run.jacobian, run.own, run.runs, run.lasting, run.loads) for run in runs), strict=True
    )
    by_load = block_diag(*loads)
    if same_load is not None:
        by_load[same_load] += by_load[-1]
        by_load = by_load[:-1]
    shared = np.concatenate([np.concatenate(lasting, axis=1), block_diag(*levels), by_load])
    return fisher_information(np.concatenate(jacobian), np.concatenate(own), shared)
