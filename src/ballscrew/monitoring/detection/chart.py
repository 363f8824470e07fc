"""Chart of an epoch: statistics beside their limits, the states that follow, and the baseline.

A chart is a recursion over runs (:mod:`~.chart_state`); :func:`chart_of` applies it from the first run on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.chart_state import (
    ChartedRun,
    ChartState,
    State,
    chart_run,
    relative_loss_of,
)
from ballscrew.monitoring.detection.design import (
    Design,
    LevelStep,
    coefficients,
    design_of,
    fit_coefficients,
)
from ballscrew.monitoring.detection.growing_design import BASELINES
from ballscrew.monitoring.detection.limit_values import ControlLimits, stacked_limits
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.visits import Visits, visits_of

# Prior probability that wear begins within the baseline. With 0.02 the 95 % interval contains P/P0 in 87 % of
# the runs of 60 axes that wear from the first on (81 % without), and in 92 % of 120 that do not (93 %).
_WEARS = 0.02
_RATES = np.geomspace(1 / 3000, 1 / 50, 12)  # of that wear, of the level per day: lives in days


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """Chart of an epoch's n good runs, in time order.

    Parameters
    ----------
    design : Design
        Linear model of the runs.
    lost : ndarray, shape (n,)
        1 − (P/P₀)^(1/3), outliers limited.
    ramp, odds : ndarray, shape (n,)
        The two statistics.
    limits : ControlLimits
        Limits of both.
    scale : ndarray, shape (n,)
        Scatter from run to run over the stated uncertainty, as known at each run.
    states : tuple of str
        learning, normal, watch or alarm.
    baseline : ndarray of int, shape (b,)
        Runs that the preload is relative to: the first ones; where an alarm began in them, those before.
    coefficients : ndarray, shape (p,)
        Coefficients of ``lost``: level before wear, effect of a kelvin and of its square, and steps.
    covariance : ndarray, shape (p, p)
        Covariance of the coefficients.
    stiffer : ndarray of bool, shape (n,)
        True where a ramp downwards exceeds the limit of one upwards: the axis became stiffer, not worn.
    visits : Visits
        Runs and their repeats. The statistics of a run are those before its repeat.
    repeat_asked : bool
        True if the newest run should be repeated on the same day.
    """

    design: Design
    lost: Array
    ramp: Array
    odds: Array
    limits: ControlLimits
    scale: Array
    states: tuple[State, ...]
    baseline: NDArray[np.int_]
    coefficients: Array
    covariance: Array
    stiffer: NDArray[np.bool_]
    visits: Visits
    repeat_asked: bool

    @property
    def newest_stiffer(self) -> bool:
        """True if the newest run is stiffer than the baseline."""
        return bool(self.stiffer[-1:].any())


def chart_of(
    days: Array,
    level: Array,
    uncertainty: Array,
    temperature: Array,
    steps: Sequence[LevelStep] = (),
    settings: MonitorSettings | None = None,
    drift: float = 0.0,
) -> Chart:
    """Chart of the good runs of an epoch.

    Parameters
    ----------
    days, level, uncertainty, temperature : ndarray, shape (n,)
        Day, change of the nut's compliance, random part of its standard uncertainty, and temperature in °C
        (nan where not recorded), in time order.
    steps : sequence of LevelStep
        Events that begin no new epoch.
    settings : MonitorSettings, optional
        Rate of false alarms, and priors.
    drift : float
        Standard deviation of the level by the drift of a healthy support bearing.

    Returns
    -------
    Chart
        A later run changes no earlier state.
    """
    state, charted = ChartState(settings or MonitorSettings(), drift), []
    for day, each, spread, warm in zip(days, level, uncertainty, temperature, strict=True):
        state, run = chart_run(state, float(day), float(each), float(spread), float(warm), steps)
        charted.append(run)
    return completed_chart(state, charted, days, level, uncertainty, temperature, steps)


def completed_chart(
    state: ChartState,
    charted: Sequence[ChartedRun],
    days: Array,
    level: Array,
    uncertainty: Array,
    temperature: Array,
    steps: Sequence[LevelStep],
) -> Chart:
    """Chart of runs that have been charted one by one.

    Parameters
    ----------
    state : ChartState
        After the newest of them.
    charted : sequence of ChartedRun
        n runs.
    days, level, uncertainty, temperature, steps
        As for :func:`chart_of`.

    Returns
    -------
    Chart
        With the baseline as known now.
    """
    _, lost_uncertainty = relative_loss(level, uncertainty)
    estimate, covariance = _baseline_fit(state)
    visits, lost = visits_of([run.repeat for run in charted]), _column(charted, "lost")
    lost[visits.first[visits.repeated]] = lost[visits.again[visits.repeated]]
    spent, repeat = _column(charted, "spent"), _column(charted, "repeat_limit")
    return Chart(
        design=design_of(days, lost_uncertainty, temperature, steps, state.settings),
        lost=lost,
        ramp=_column(charted, "ramp"),
        odds=_column(charted, "odds"),
        limits=stacked_limits([run.limits for run in charted], spent, repeat),
        scale=_column(charted, "scale"),
        states=tuple(run.state for run in charted),
        baseline=state.baseline,
        coefficients=estimate,
        covariance=covariance,
        stiffer=_column(charted, "stiffer").astype(bool),
        visits=visits,
        repeat_asked=bool(charted) and charted[-1].repeat_asked,
    )


def _column(charted: Sequence[ChartedRun], name: str) -> Array:
    return np.array([getattr(run, name) for run in charted])


def _baseline_fit(state: ChartState) -> tuple[Array, Array]:
    """Coefficients from the baseline's visits, and their covariance.

    They are averaged over courses of wear within the baseline: what wears while it is learnt is neither its
    level nor an effect of the temperature, and where that is in doubt so are both.
    """
    now = state.now
    if now is None:
        return np.zeros(1), np.zeros((1, 1))
    # The bearing's drift is part of the stiffness, and none of the baseline's coefficients.
    design = now.grown.design.without_drift()
    fit = fit_coefficients(design, now.baseline.visits, len(design.days))
    inflation = (now.scale / design.settings.scale) ** 2
    covariance = inflation * fit.noise_covariance + fit.prior_covariance
    wear, weight = _wear_of_baseline(design, np.array(now.lost), inflation)
    levels = np.array([now.statistics.robust.baseline[row][0] for row in fit.rows])
    estimates = coefficients(design, fit, levels[:, None] - wear.T[fit.rows]).T
    mean = weight @ estimates
    off = estimates - mean
    return mean, covariance + (weight[:, None] * off).T @ off


def _wear_of_baseline(design: Design, lost: Array, inflation: float) -> tuple[Array, Array]:
    """Courses of wear that begins at one of the first visits, and their probabilities.

    Parameters
    ----------
    design : Design
        n visits.
    lost : ndarray, shape (n,)
        Level of each, as measured.
    inflation : float
        Variance of the scatter over the prior one.

    Returns
    -------
    wear : ndarray, shape (c, n)
        No wear first, then ramps of every onset and rate.
    weight : ndarray, shape (c,)
        Probabilities given the first visits: Student's t, since the scatter is estimated from a few runs.
    """
    settings, days = design.settings, design.days
    first = slice(0, BASELINES * settings.baseline_runs)
    onset = days[first][:-1]
    ramps = _RATES[:, None, None] * np.maximum(days - onset[:, None], 0.0)
    wear = np.concatenate([np.zeros((1, len(days))), ramps.reshape(-1, len(days))])
    columns = design.columns[first]
    noise = inflation * (settings.scale * design.uncertainty[first]) ** 2
    covariance = np.diag(noise + design.unknown_temperature[first] ** 2)
    covariance += columns / design.information @ columns.T
    residual = lost[first] - wear[:, first]
    square = np.sum(residual * np.linalg.solve(covariance, residual.T).T, axis=1)
    degrees, count = settings.scale_degrees, len(noise)
    degrees += count / 2  # the scatter is partly estimated from these visits
    prior = np.full(len(wear), _WEARS / settings.baseline_runs / len(_RATES))
    prior[0] = 1 - prior[1:].sum()
    log_weight = np.log(prior) - (degrees + count) / 2 * np.log1p(square / degrees)
    weight = np.exp(log_weight - log_weight.max())
    return wear, weight / weight.sum()


def relative_loss(level: Array, uncertainty: Array) -> tuple[Array, Array]:
    """Charted quantity of runs, 1 − (P/P₀)^(1/3), and its standard uncertainty.

    Parameters
    ----------
    level, uncertainty : ndarray, shape (n,)
        As in :func:`chart_of`.

    Returns
    -------
    lost, uncertainty : ndarray, shape (n,)
        Loss of each run.
    """
    found, before = [], math.nan
    for each, spread in zip(level, uncertainty, strict=True):
        lost, lost_spread, before = relative_loss_of(float(each), float(spread), before)
        found.append((lost, lost_spread))
    table = np.array(found).reshape(-1, 2)
    return table[:, 0], table[:, 1]
