"""Information of a plan before anything moves: expected accuracy of the axis, and time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from ballscrew.axis.axial import PARAMETERS, AxialModel
from ballscrew.axis.information import d_information, fisher_information, gained_bits, posterior
from ballscrew.base.arrays import Array
from ballscrew.fcft.plan import Plan
from ballscrew.fcft.run_information import (
    RunRows,
    known_preload,
    known_preload_information,
    preload_ratio,
    reference_preload,
    run_rows,
    without_ratios,
)
from ballscrew.fcft.scatter import FrequencyScatter
from ballscrew.fcft.schedule import duration

LATER = (0.9, 0.5)
"""P/P₀ of later runs whose accuracy is predicted."""

_INDEPENDENT = 1e-6  # of the largest singular value of unit columns: rounding is 1e-15, real ones 1e-3
_STRAIGHT = 1e-9  # slope per m, and curve per m²: what is less is none
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
        compliance, slope, moving mass, and the curve of a screw with both ends fixed; with several known
        preloads, of the nut's share too.
    bits : float
        Information gained over the data sheet, bits.
    accuracy : tuple of Accuracy
        Accuracy of each parameter.
    later : tuple of Later
        Accuracy of later runs at the ratios :data:`LATER`.
    rank, parameters : int
        Number of combinations of compliance, slope, curve, mass and share that the frequencies determine
        without the data sheet, and number of these parameters.
    """

    minutes: float
    measuring_minutes: float
    information: float
    bits: float
    accuracy: tuple[Accuracy, ...]
    later: tuple[Later, ...]
    rank: int
    parameters: int

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
            "rank": self.rank,
            "parameters": self.parameters,
        }


def change_time(plan: Plan, change_minutes: float, adjust_minutes: float) -> float:
    """Time to change loads and preloads between the runs, min: all loads at one preload, then at the next."""
    preloads = max(len(plan.preloads), 1)
    return preloads * (len(plan.masses) - 1) * change_minutes + (preloads - 1) * adjust_minutes


def test_minutes(plan: Plan, change_minutes: float, adjust_minutes: float) -> tuple[float, float]:
    """Time of a plan with all its runs, min: with the changes of load and preload, and measuring alone."""
    measuring = plan.run_count * duration(plan) / 60
    return measuring + change_time(plan, change_minutes, adjust_minutes), measuring


test_minutes.__test__ = False  # type: ignore[attr-defined]  # pytest would take it for a test


def determined_parameters(model: AxialModel, preloads: int = 1) -> tuple[int, ...]:
    """Indices of the parameters that frequencies at so many preloads determine without the data sheet."""
    names = ["compliance", "slope", "mass"]
    if model.curve:
        names.append("curve")
    if preloads > 1:
        names.append("share")
    return tuple(map(PARAMETERS.index, names))


def marginal_precision(covariance: Array) -> Array:
    """Reciprocal prior variances of the working vector; infinite for a fixed parameter."""
    variance = np.diag(covariance)
    precision = np.full(len(variance), np.inf)
    precision[variance > 0] = 1 / variance[variance > 0]
    return precision


@dataclass(frozen=True, slots=True, eq=False)
class _PlannedRun:
    """One run: its load, kg, number of its log ratio (None for the reference's), preload, N, and rows."""

    load: float
    group: int | None
    preload: float | None
    rows: RunRows

    def slopes(self, unknowns: int) -> Array:
        """Derivative of ln f with respect to the working vector and all log ratios, shape (n, unknowns)."""
        size = len(PARAMETERS)
        slopes = np.zeros((len(self.rows.own), unknowns))
        slopes[:, :size] = self.rows.jacobian[:, :size]
        if self.group is not None:
            slopes[:, size + self.group] = self.rows.jacobian[:, -1]
        return slopes


def _planned_runs(
    plan: Plan, model: AxialModel, scatter: FrequencyScatter, span: tuple[float, float]
) -> list[_PlannedRun]:
    """All loads at the first preload, then at the next."""
    reference = reference_preload(plan.preloads, model.preload)
    runs: list[_PlannedRun] = []
    group = 0
    for preload in plan.preloads or (None,):
        ratio = preload_ratio(preload, reference, model)
        own = None if ratio == 1.0 else group
        rows = (run_rows(plan, load, model, scatter, span, ratio) for load in plan.masses)
        runs += [_PlannedRun(load, own, preload, each) for load, each in zip(plan.masses, rows, strict=True)]
        group += own is not None
    return runs


def plan_information(
    plan: Plan,
    model: AxialModel,
    covariance: Array,
    scatter: FrequencyScatter,
    change_minutes: float,
    span: tuple[float, float] | None = None,
    *,
    adjust_minutes: float = 0.0,
    preloads: int | None = None,
) -> PlanInformation:
    """Information and accuracy of a plan on an axis.

    Parameters
    ----------
    plan : Plan
        The test.
    model : AxialModel
        Expected axis; of a plan with preloads, at the one nearest to its own.
    covariance : ndarray, shape (7, 7)
        Prior covariance of the working vector.
    scatter : FrequencyScatter
        Scatter of the runs.
    change_minutes, adjust_minutes : float
        Time to change the load on the table, and to set another preload, min.
    span : tuple of float, optional
        Positions at which the tilt of a run is −1 and 1, m; by default the ends of the plan.
    preloads : int, optional
        Number of preloads that determines which parameters the information is about; by default the plan's.

    Returns
    -------
    PlanInformation
        To first order about the model, nut unloaded, rotor free. Each preload is known to 2 %
        (:data:`~ballscrew.axis.axial_prior.KNOWN_PRELOAD`).

    Raises
    ------
    InputError
        If a stop leaves the screw.
    """
    if span is None:
        span = (plan.positions[0], plan.positions[-1])
    precision = marginal_precision(covariance)
    runs = _planned_runs(plan, model, scatter, span)
    information = without_ratios(_joint_information(runs))
    after = posterior(covariance, information)
    minutes, measuring = test_minutes(plan, change_minutes, adjust_minutes)
    scale = np.ones(len(PARAMETERS))  # logarithms are relative as they are
    for name in ("slope", "curve"):
        size = abs(getattr(model, name))
        if size > _STRAIGHT:
            scale[PARAMETERS.index(name)] = size
    scale[PARAMETERS.index("share")] = 1 / (1 - model.share)
    before_uncertainty = np.sqrt(np.diag(covariance)) / scale
    after_uncertainty = np.sqrt(np.maximum(np.diag(after), 0.0)) / scale
    accuracy = []
    for name, before, then in zip(PARAMETERS, before_uncertainty, after_uncertainty, strict=True):
        if name != "curve" or model.curve:
            accuracy.append(Accuracy(name, float(before), float(then)))
    counted = len(plan.preloads) if preloads is None else preloads
    wanted = determined_parameters(model, counted)
    wholly = determined_parameters(model, 2)
    return PlanInformation(
        minutes=minutes,
        measuring_minutes=measuring,
        information=d_information(_information_of_runs(runs), wanted, precision),
        bits=gained_bits(covariance, information),
        accuracy=tuple(accuracy),
        later=tuple(_later(ratio, plan, model, covariance, scatter, span, runs) for ratio in LATER),
        rank=_rank(np.concatenate([run.rows.jacobian[:, list(wholly)] for run in runs])),
        parameters=len(wholly),
    )


def _information_of_runs(runs: Sequence[_PlannedRun]) -> Array:
    """Information about the working vector, shape (7, 7), without lasting errors."""
    total = np.zeros((len(PARAMETERS),) * 2)
    for preload in dict.fromkeys(run.preload for run in runs):
        alike = [run for run in runs if run.preload == preload]
        of_runs = np.sum([run.rows.information() for run in alike], axis=0)
        if preload is None:
            total += of_runs[:-1, :-1]
        else:
            total += known_preload_information(of_runs, alike[0].group is None)
    return total


def _rank(slopes: Array) -> int:
    """Number of independent columns; a column of zeros is none."""
    sizes = np.linalg.norm(slopes, axis=0)
    slopes = slopes[:, sizes > 0] / sizes[sizes > 0]
    return int(np.linalg.matrix_rank(slopes, rtol=_INDEPENDENT))


def _later(
    ratio: float,
    plan: Plan,
    model: AxialModel,
    covariance: Array,
    scatter: FrequencyScatter,
    span: tuple[float, float],
    first: Sequence[_PlannedRun],
) -> Later:
    """Accuracy of one more run with the heaviest load, at a part of the preload."""
    load = max(plan.masses)
    again = run_rows(plan, load, model, scatter, span, ratio)
    group = len({run.group for run in first} - {None})
    information = _joint_information([*first, _PlannedRun(load, group, None, again)])
    wide = np.diag(np.full(len(information), _FLAT))
    size = len(PARAMETERS)
    wide[:size, :size] = covariance
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


def _joint_information(runs: Sequence[_PlannedRun]) -> Array:
    """Information of several runs about the working vector and the log ratios of their groups.

    Errors of level and tilt are independent between runs, and lasting errors are common to all. Runs with
    one load have the same weight on the table. Each known preload counts once.
    """
    own, levels, lasting, loads = zip(
        *((run.rows.own, run.rows.runs, run.rows.lasting, run.rows.loads) for run in runs), strict=True
    )
    unknowns = len(PARAMETERS) + len({run.group for run in runs} - {None})
    of_runs = block_diag(*loads)
    weights = dict.fromkeys(run.load for run in runs)
    by_load = np.stack([of_runs[[run.load == weight for run in runs]].sum(axis=0) for weight in weights])
    shared = np.concatenate([np.concatenate(lasting, axis=1), block_diag(*levels), by_load])
    information = fisher_information(
        np.concatenate([run.slopes(unknowns) for run in runs]), np.concatenate(own), shared
    )
    for group in {run.group for run in runs if run.preload is not None}:
        information += known_preload(unknowns, group)
    return information
