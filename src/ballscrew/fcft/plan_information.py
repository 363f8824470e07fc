"""What a plan is worth before anything moves: what it will tell of the axis, how surely, in which time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ballscrew.axis import axial
from ballscrew.axis.axial import PARAMETERS, AxialModel
from ballscrew.axis.information import d_information, fisher_information, gained_bits, posterior
from ballscrew.base.arrays import Array
from ballscrew.fcft.conditions import conditions_at
from ballscrew.fcft.plan import Plan
from ballscrew.fcft.scatter import Scatter, run_causes
from ballscrew.fcft.schedule import duration

__all__ = [
    "LATER",
    "Accuracy",
    "Later",
    "PlanInformation",
    "RunRows",
    "plan_information",
    "run_rows",
    "test_minutes",
    "wanted",
]


LATER = (0.9, 0.5)
"""P/P₀ of later runs whose accuracy is told."""


@dataclass(frozen=True, slots=True)
class Accuracy:
    """How well one number is known before and after.

    Parameters
    ----------
    name : str
        One of :data:`ballscrew.axis.axial.PARAMETERS`.
    before, after : float
        Standard uncertainty as a part of the value: by the data sheet, and with the test.
    """

    name: str
    before: float
    after: float


@dataclass(frozen=True, slots=True)
class Later:
    """How well a later run of the same stops with one load will tell the preload.

    Parameters
    ----------
    ratio : float
        P/P₀ that it has.
    standard_uncertainty : float
        Of P/P₀, all told.
    random : float
        What runs scatter by of it; the rest is what is not known of the axis, and no run mends it.
    preload : float
        Standard uncertainty of P in newtons, as a part of P.
    """

    ratio: float
    standard_uncertainty: float
    random: float
    preload: float


@dataclass(frozen=True, slots=True)
class PlanInformation:
    """What a plan tells.

    Parameters
    ----------
    minutes, measuring_minutes : float
        Of all loads with changing them, and without.
    information : float
        det^(1/p) of the information about what frequencies know at one preload: compliance, slope, moving
        mass, and the curve of a screw that is held at both ends.
    bits : float
        By how much it narrows what the data sheet knows.
    accuracy : tuple of Accuracy
        Number by number.
    later : tuple of Later
        Of :data:`LATER`.
    """

    minutes: float
    measuring_minutes: float
    information: float
    bits: float
    accuracy: tuple[Accuracy, ...]
    later: tuple[Later, ...]

    @property
    def per_minute(self) -> float:
        """Information per minute: two plans are compared by it."""
        return self.information / self.minutes

    def to_json(self) -> dict[str, Any]:
        """With units in the keys."""
        return {
            "minutes": self.minutes,
            "measuring_minutes": self.measuring_minutes,
            "information": self.information,
            "information_per_minute": self.per_minute,
            "bits": self.bits,
            "accuracy": [asdict(one) for one in self.accuracy],
            "later_runs": [asdict(one) for one in self.later],
        }


def test_minutes(plan: Plan, change_minutes: float) -> tuple[float, float]:
    """Time of a plan with all its loads, min: with the changes of load, and measuring alone."""
    measuring = len(plan.masses) * duration(plan) / 60
    return measuring + (len(plan.masses) - 1) * change_minutes, measuring


test_minutes.__test__ = False  # type: ignore[attr-defined]  # pytest would take it for a test


def wanted(model: AxialModel) -> tuple[int, ...]:
    """Which numbers of the working vector frequencies at one preload know, whatever the sheet says."""
    names = ("compliance", "slope", "mass") + (("curve",) if model.curve else ())
    return tuple(PARAMETERS.index(name) for name in names)


@dataclass(frozen=True, slots=True, eq=False)
class RunRows:
    """What one run is expected to tell, a row a stop: all errors as a part of the frequency.

    Parameters
    ----------
    jacobian : ndarray, shape (n, 8)
        Of ln f by the working vector and log ratio; that of log ratio is 0 in a run that is the reference.
    own : ndarray, shape (n,)
        Standard deviation of what the cells of a stop err by together, each by itself.
    runs, lasting : ndarray, shape (2, n)
        Level and tilt, drawn anew each run, and once for the axis.
    loads : ndarray, shape (n,)
        Of what lies on the table.
    """

    jacobian: Array
    own: Array
    runs: Array
    lasting: Array
    loads: Array

    def information(self, stops: Sequence[int] | None = None) -> Array:
        """About the working vector, shape (7, 7); lasting errors, which no plan mends, are left out.

        Parameters
        ----------
        stops : sequence of int, optional
            Some rows only.
        """
        rows = slice(None) if stops is None else list(stops)
        shared = np.concatenate([self.runs, self.loads[None]])
        return fisher_information(self.jacobian[rows, : len(PARAMETERS)], self.own[rows], shared[:, rows])


def run_rows(
    plan: Plan,
    load: float,
    model: AxialModel,
    scatter: Scatter,
    span: tuple[float, float],
    ratio: float = 1.0,
) -> RunRows:
    """What the run with one load of a plan is expected to tell.

    Parameters
    ----------
    plan : Plan
        The test.
    load : float
        On the table, kg.
    model : AxialModel
        About which it is taken.
    scatter : Scatter
        Of its runs.
    span : tuple of float
        Where a run's tilt is −1 and 1, m.
    ratio : float
        P/P_ref; a run with 1 is the reference.

    Returns
    -------
    RunRows
        A row a stop.

    Raises
    ------
    InputError
        If a stop leaves the screw.
    """
    x = np.array(plan.positions)
    f = axial.frequency(model, x, load, ratio)
    slopes = axial.gradient(model, x, load, ratio)
    if ratio == 1.0:
        slopes[:, -1] = 0.0  # it says nothing of a later run's preload
    cells = len(plan.motions) * np.array([len(conditions_at(i, len(x))) for i in range(len(x))])
    by_load = slopes[:, PARAMETERS.index("mass")] / model.mass  # load and table are felt alike
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
    scatter: Scatter,
    change_minutes: float,
    span: tuple[float, float] | None = None,
) -> PlanInformation:
    """What a plan is worth on an axis.

    Parameters
    ----------
    plan : Plan
        The test.
    model : AxialModel
        The axis as it is expected to be.
    covariance : ndarray, shape (7, 7)
        Of its working vector, before the test.
    scatter : Scatter
        Of the runs.
    change_minutes : float
        To change the load on the table, min.
    span : tuple of float, optional
        Where a run's tilt is −1 and 1, m; by default the plan's own.

    Returns
    -------
    PlanInformation
        To first order about the model, nut unloaded, rotor free.

    Raises
    ------
    InputError
        If a stop leaves the screw.
    """
    span = (plan.positions[0], plan.positions[-1]) if span is None else span
    precision = np.array([1 / v if v > 0 else np.inf for v in np.diag(covariance)])
    first = [run_rows(plan, load, model, scatter, span) for load in plan.masses]
    whole = sum((run.information() for run in first), np.zeros((len(PARAMETERS),) * 2))
    told = _stacked(first)
    after = posterior(covariance, told)
    minutes, measuring = test_minutes(plan, change_minutes)
    known = [1.0] * len(PARAMETERS)  # logarithms: a part of the value as they stand
    known[PARAMETERS.index("slope")] = abs(model.slope) or 1.0
    known[PARAMETERS.index("curve")] = abs(model.curve) or 1.0
    known[PARAMETERS.index("share")] = 1 / (1 - model.share)
    shown = [i for i, name in enumerate(PARAMETERS) if name != "curve" or model.curve]
    return PlanInformation(
        minutes=minutes,
        measuring_minutes=measuring,
        information=d_information(whole, wanted(model), precision),
        bits=gained_bits(covariance, told),
        accuracy=tuple(
            Accuracy(
                PARAMETERS[i],
                float(np.sqrt(covariance[i, i])) / known[i],
                float(np.sqrt(max(after[i, i], 0.0))) / known[i],
            )
            for i in shown
        ),
        later=tuple(_later(ratio, plan, model, covariance, scatter, span, first) for ratio in LATER),
    )


def _later(
    ratio: float,
    plan: Plan,
    model: AxialModel,
    covariance: Array,
    scatter: Scatter,
    span: tuple[float, float],
    first: Sequence[RunRows],
) -> Later:
    """One more run, with the heaviest load, once the preload is a part of what it was."""
    load = max(plan.masses)
    again = run_rows(plan, load, model, scatter, span, ratio)
    told = _stacked([*first, again], pairs=((plan.masses.index(load), len(first)),))
    open_ = 1e4  # variance of log ratio beforehand: nothing is known of it
    wide = np.zeros((len(PARAMETERS) + 1,) * 2)
    wide[:-1, :-1] = covariance
    wide[-1, -1] = open_
    after = posterior(wide, told)
    # Against a baseline of the same load, the axis known: what runs and cells scatter by, twice over.
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


def _stacked(runs: Sequence[RunRows], pairs: Sequence[tuple[int, int]] = ()) -> Array:
    """Information of several runs about the working vector, with log ratio where a later one is among them.

    Each run has draws of its own, lasting errors are shared by all, and a pair of runs has one and the same
    weight on the table.
    """
    counts = [len(run.own) for run in runs]
    starts = np.concatenate([[0], np.cumsum(counts)])
    total = int(starts[-1])
    same = {b: a for a, b in pairs}
    causes = [np.concatenate([run.lasting for run in runs], axis=1)]
    weights = {i: np.zeros(total) for i in range(len(runs)) if i not in same}
    for i, run in enumerate(runs):
        at = slice(int(starts[i]), int(starts[i + 1]))
        draws = np.zeros((len(run.runs), total))
        draws[:, at] = run.runs
        causes.append(draws)
        weights[same.get(i, i)][at] = run.loads
    causes.append(np.stack(list(weights.values())))
    jacobian = np.concatenate([run.jacobian for run in runs])
    whole = fisher_information(jacobian, np.concatenate([run.own for run in runs]), np.concatenate(causes))
    return whole if pairs else whole[:-1, :-1]
