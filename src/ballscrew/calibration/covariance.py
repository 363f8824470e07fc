"""Covariance of the frequencies of several runs.

It consists of the errors of each run, the errors that repeat from run to run, and what differs between
experiments besides the preload: the bearing, and the error by the test's load on a worn nut. ``preload``
allows for the last two between a run and its baseline. A calibration with runs of several days or preloads
allows for them too: else a second known preload would attribute a change of the bearing to the nut.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.axis.axial import PARAMETERS, AxialModel, frequency, gradient
from ballscrew.base.arrays import Array
from ballscrew.base.quantity import NORMAL_95
from ballscrew.calibration.assumptions import DEFAULT_ASSUMPTIONS, FORM, LOAD, REPEATS, Assumptions
from ballscrew.calibration.frequency_table import FrequencyTable
from ballscrew.calibration.preload_groups import preload_groups
from ballscrew.calibration.worn_nut import is_nut_load, nut_load_uncertainty

FLOOR = 1e-4
"""Relative error of each cell's frequency by the form of the model, independent of other cells."""

WORN_NUT = 1e-3
"""Relative error of the frequencies at another preload, if their run does not state the effect of the load.

On random axes at 60 % of their preload the frequency was 0.5 to 1.5e-3 too low. It does not repeat."""

_LASTING = ("damping",)  # errors that depend on the build of the machine, and on nothing that a run changes

_MOST_LOG_COMPLIANCE = 10.0  # largest change of ln C; beyond it a frequency is not of this axis
_LEAST_U = 0.2  # least (P/P_ref)^(−1/3): that of more than a hundred times the preload


@dataclass(frozen=True, slots=True)
class ExperimentVariation:
    """Assumed variation between experiments.

    Parameters
    ----------
    bearing_share : float
        The thrust bearing's share of the compliance at the model's centre.
    assumptions : Assumptions
        ``bearing_drift``, ``nut_load``, ``nut_load_spread`` and ``repeats`` are used.
    """

    bearing_share: float
    assumptions: Assumptions = DEFAULT_ASSUMPTIONS


def run_covariance(run: FrequencyTable) -> Array:
    """Covariance of a run's frequencies, Hz², shape (n, n)."""
    return np.asarray(run.shared.T @ run.shared + np.diag(run.own**2))


def joint_covariance(runs: Sequence[FrequencyTable], correlation: float = REPEATS) -> Array:
    """Covariance of the frequencies of several runs, one after the other, Hz².

    A repeating error is correlated with the error of its name in every other run; where a run has several of
    one name, the first with the first. All others are independent.

    Parameters
    ----------
    runs : sequence of FrequencyTable
        Of n cells together.
    correlation : float
        Of a repeating error from run to run, 0 to 1.

    Returns
    -------
    ndarray, shape (n, n)
        Positive semi-definite.
    """
    size, spans = 0, []
    for run in runs:
        spans.append(slice(size, size + len(run.frequency)))
        size += len(run.frequency)
    repeating = list(map(repeating_effects, runs))
    total = np.zeros((size, size))
    for i, run in enumerate(runs):
        total[spans[i], spans[i]] = run_covariance(run)
        for j in range(i):
            for key in sorted(repeating[i].keys() & repeating[j].keys()):
                common = error_correlation(key[0], correlation)
                block = common * np.outer(repeating[i][key], repeating[j][key])
                total[spans[i], spans[j]] += block
                total[spans[j], spans[i]] += block.T
    return total


def with_repeating_load(run: FrequencyTable) -> FrequencyTable:
    """The run with its error by the load on the nut as one that repeats.

    A run states this error as random, since the wear of the nut is unknown when the frequency is estimated.
    At one preload it is the same in every run; between preloads :func:`worn_nut_slopes` and
    :func:`experiment_effects` describe it, so that it would count twice as a random error of every run.
    """
    by_load = np.array(list(map(is_nut_load, run.shared_names)), dtype=bool)
    return replace(run, repeats=run.repeats | by_load)


def worn_nut_slopes(runs: Sequence[FrequencyTable], assumptions: Assumptions) -> Array:
    """∂ ln f/∂ ln(P/P_ref) of each cell by the test's own load on a worn nut, shape (n,).

    It is :func:`~ballscrew.calibration.worn_nut.frequency_loss_under_load` over ln(P_ref/P): the frequency of
    a worn nut is too low.
    """
    return np.concatenate([assumptions.nut_load * nut_load_uncertainty(run) / run.frequency for run in runs])


def experiment_effects(
    run: FrequencyTable, model: AxialModel, variation: ExperimentVariation, log_ratio: float
) -> tuple[Array, Array]:
    """Effects on ln f of one standard deviation of the changes of bearing and worn nut since the reference.

    Parameters
    ----------
    run : FrequencyTable
        Of n cells, of another day and preload than the reference.
    model : AxialModel
        Of the axis.
    variation : ExperimentVariation
        Sizes of the changes.
    log_ratio : float
        Approximate ln(P/P_ref).

    Returns
    -------
    bearing, worn_nut : ndarray, shape (n,)
        By a drift of the bearing, and by the correction for the load on a worn nut.
    """
    from_centre = run.position - model.centre
    compliance = 1 + model.slope * from_centre + model.curve * from_centre**2
    drift = variation.assumptions.bearing_daily_drift / NORMAL_95
    bearing = drift * variation.bearing_share / (2 * compliance)  # f² ∝ 1/C
    if not any(map(is_nut_load, run.shared_names)):
        return bearing, np.full_like(run.frequency, WORN_NUT)
    spread = variation.assumptions.nut_load_spread * abs(log_ratio)
    return bearing, spread * nut_load_uncertainty(run) / run.frequency


def experiment_covariance(
    runs: Sequence[FrequencyTable], groups: Sequence[int], model: AxialModel, variation: ExperimentVariation
) -> Array:
    """Covariance of ln f over all cells by the differences between days and between preloads.

    Parameters
    ----------
    runs, groups : sequence
        Of n cells together; the group of each run's preload, 0 the reference.
    model : AxialModel
        Of the axis, as known before the calibration.
    variation : ExperimentVariation
        Sizes of the differences.

    Returns
    -------
    ndarray, shape (n, n)
        The bearing's change is common to the runs of a day, the worn nut's to those of a preload; both are 0
        for the day and preload of the first run.
    """
    # Groups without known preloads are days.
    days = preload_groups([run.id for run in runs], [run.measured_at for run in runs], {})
    counts = [len(run.frequency) for run in runs]
    bearing, worn_nut = [], []
    for run, log_ratio in zip(runs, _log_ratios(runs, groups, model), strict=True):
        by_bearing, by_nut = experiment_effects(run, model, variation, log_ratio)
        bearing.append(by_bearing)
        worn_nut.append(by_nut)
    total = np.zeros((sum(counts), sum(counts)))
    for labels, effects in ((days, np.concatenate(bearing)), (groups, np.concatenate(worn_nut))):
        of_cell = np.repeat(np.asarray(labels), counts)
        common = (of_cell[:, None] == of_cell) & (of_cell > 0)
        total += np.where(common, np.outer(effects, effects), 0.0)
    return total


def relative_covariance(
    runs: Sequence[FrequencyTable],
    groups: Sequence[int],
    model: AxialModel,
    variation: ExperimentVariation,
) -> Array:
    """Covariance of ln f over all runs, with the errors that no run determines.

    Parameters
    ----------
    runs : sequence of FrequencyTable
        Of n cells together.
    groups : sequence of int
        Group of each run's preload, 0 the reference.
    model : AxialModel
        For the effects of a wrong load and of a drift of the bearing.
    variation : ExperimentVariation
        Between experiments.

    Returns
    -------
    ndarray, shape (n, n)
        Of the runs (:func:`joint_covariance`), the loads, the experiments (:func:`experiment_covariance`)
        and the form of the model.
    """
    counts = [len(run.frequency) for run in runs]
    f = np.concatenate([run.frequency for run in runs])
    x = np.concatenate([run.position for run in runs])
    load = np.repeat([run.load for run in runs], counts).astype(float)
    run_of_cell = np.repeat(np.arange(len(runs)), counts)
    repeating = [with_repeating_load(run) for run in runs]
    total = joint_covariance(repeating, variation.assumptions.repeats) / np.outer(f, f)
    by_load = gradient(model, x, load)[:, PARAMETERS.index("mass")] / model.mass * LOAD * load
    total += np.where(run_of_cell[:, None] == run_of_cell, np.outer(by_load, by_load), 0.0)
    total += experiment_covariance(runs, groups, model, variation)
    along, heavy = _centred(x), _centred(load)
    # Levels and slopes are fitted; the errors of the form are the Legendre polynomials of second order.
    for bend in (1.5 * along**2 - 0.5, along * heavy, 1.5 * heavy**2 - 0.5):
        total += FORM**2 * np.outer(bend, bend)
    return np.asarray(total + FLOOR**2 * np.eye(len(f)))


def error_correlation(name: str, correlation: float) -> float:
    """Correlation of a repeating error from run to run.

    Parameters
    ----------
    name : str
        Of the error. That by the place of the dampers is the same in all runs of an axis; each run states its
        size by its own damping ratio.
    correlation : float
        Of other errors, 0 to 1; 0 for runs of different axes.

    Returns
    -------
    float
        0 to 1.
    """
    if correlation > 0 and name in _LASTING:
        return 1.0
    return correlation


def repeating_effects(run: FrequencyTable) -> dict[tuple[str, int], Array]:
    """Effects of repeating errors on n cells, Hz, by name and number among the errors of that name."""
    count: Counter[str] = Counter()
    effects = {}
    for name, repeats, effect in zip(run.shared_names, run.repeats, run.shared, strict=True):
        if repeats:
            effects[name, count[name]] = effect
            count[name] += 1
    return effects


def _log_ratios(runs: Sequence[FrequencyTable], groups: Sequence[int], model: AxialModel) -> list[float]:
    """ln(P/P_ref) of each run's group by the model before the calibration: for the size of errors only."""
    # Mean over the cells of each run of ln f less the model's.
    levels = [np.mean(np.log(run.frequency / frequency(model, run.position, run.load))) for run in runs]
    group_of_run, deviations = np.asarray(groups), np.array(levels)
    reference = 0.0
    if 0 in groups:
        reference = float(deviations[group_of_run == 0].mean())
    ratios = []
    for group in groups:
        level = float(deviations[group_of_run == group].mean()) - reference
        # C ∝ 1/f² has changed by −2 level in ln C, and only by the nut's part.
        u = 1 + math.expm1(min(-2 * level, _MOST_LOG_COMPLIANCE)) / model.share
        ratios.append(-3 * math.log(max(u, _LEAST_U)))
    return ratios


def _centred(values: Array) -> Array:
    """Values, linear from −1 at the least to 1 at the largest; 0 where all are equal."""
    low, high = float(values.min()), float(values.max())
    if not high > low:
        return np.zeros_like(values)
    return np.asarray(2 * (values - low) / (high - low) - 1)
