"""Chart of an epoch: statistics beside their limits, and the states that follow, with hysteresis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import (
    Design,
    LevelStep,
    coefficients,
    design_of,
    fit_coefficients,
)
from ballscrew.monitoring.detection.limits import ControlLimits, compute_limits
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.statistics import BEGIN, Statistics, far_off, ramp, statistics
from ballscrew.monitoring.detection.visits import Visits, group_visits

# Prior probability that wear begins within the baseline. With 0.02 the 95 % interval contains P/P0 in 87 % of
# the runs of 60 axes that wear from the first on (81 % without), and in 92 % of 120 that do not (93 %).
_WEARS = 0.02
_RATES = np.geomspace(1 / 3000, 1 / 50, 12)  # of that wear, of the level per day: lives in days
_EVIDENCE = 2  # baselines of visits that show when wear began
_STIFFEST = -0.5  # level of P/P₀ = 8: less is no measurement
State = Literal["learning", "normal", "watch", "alarm"]


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
    onset : ndarray of int, shape (n,)
        Run at which the ramp seems to begin.
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
    far_off : ndarray of bool, shape (n,)
        Runs, no repeats, that are too far up to count in full.
    """

    design: Design
    lost: Array
    ramp: Array
    odds: Array
    onset: NDArray[np.int_]
    limits: ControlLimits
    scale: Array
    states: tuple[State, ...]
    baseline: NDArray[np.int_]
    coefficients: Array
    covariance: Array
    stiffer: NDArray[np.bool_]
    visits: Visits
    far_off: NDArray[np.bool_]

    @property
    def repeat_asked(self) -> bool:
        """True if the newest run should be repeated on the same day.

        Its odds exceed the limit of repeats, or it is too far off to count in full; there is no alarm, and it
        is no repeat itself.
        """
        if not len(self.states) or self.visits.repeated[-1] or self.states[-1] == "alarm":
            return False
        limit = self.limits.repeat[-1]
        return bool(np.isfinite(limit) and (self.odds[-1] > limit or self.far_off[-1]))

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
    settings = settings or MonitorSettings()
    lost, lost_uncertainty = relative_loss(level, uncertainty)
    repeats = settings.repeats_per_year > 0
    visits = group_visits(days, lost_uncertainty, temperature, steps, repeats)
    first, at = visits.first, visits.of_run
    # The bearing's drift is part of the stiffness, and none of the baseline's coefficients.
    plain = design_of(days[first], lost_uncertainty[first], temperature[first], steps, settings)
    design = design_of(days[first], lost_uncertainty[first], temperature[first], steps, settings, drift)
    again = np.full((len(first), 1), np.nan)
    again[visits.repeated, 0] = lost[visits.again[visits.repeated]]
    lost_first = lost[first][:, None]
    limits = compute_limits(design)
    # A repeat counts where it is requested: the limits are those of healthy axes without other repeats.
    values = statistics(design, lost_first, again, lambda k, _: float(limits.repeat[k]))
    grown, worn = values.ramp[at, 0], values.odds[at, 0]
    grown[first], worn[first] = values.ramp_first[:, 0], values.odds_first[:, 0]
    far = np.zeros(len(at), dtype=bool)
    far[first] = far_off(design, lost_first)[:, 0]
    repeated = values.repeated[at, 0]
    repeated[first] = False
    run_limits = limits.of_runs(at, repeated)
    robust = values.residuals
    reversed_ramp = ramp(design, -robust.level, robust.scale, BEGIN)[0][at, 0]
    states = chart_states(grown, worn, run_limits, settings.calm_runs, at)
    last = np.maximum(first, visits.again)
    reference = _reference(design, [states[k] for k in last], values.onset[:, 0])
    estimate, covariance = _baseline_fit(plain, lost[first], reference, values)
    return Chart(
        design=design_of(days, lost_uncertainty, temperature, steps, settings),
        lost=robust.level[at, 0],
        ramp=grown,
        odds=worn,
        onset=first[values.onset[at, 0]],
        limits=run_limits,
        scale=robust.scale[at, 0],
        states=states,
        baseline=visits.runs(reference),
        coefficients=estimate,
        covariance=covariance,
        stiffer=reversed_ramp > run_limits.ramp,
        visits=visits,
        far_off=far,
    )


def _baseline_fit(
    design: Design, lost: Array, reference: NDArray[np.int_], values: Statistics
) -> tuple[Array, Array]:
    """Coefficients from the baseline's visits, and their covariance.

    They are averaged over courses of wear within the baseline: what wears while it is learnt is neither its
    level nor an effect of the temperature, and where that is in doubt so are both.
    """
    p = design.columns.shape[1]
    if not len(reference):
        return np.zeros(p), np.zeros((p, p))
    fit = fit_coefficients(design, reference, len(design.days))
    inflation = (float(values.residuals.scale[-1, 0]) / design.settings.scale) ** 2
    covariance = inflation * fit.noise_covariance + fit.prior_covariance
    wear, weight = _wear_of_baseline(design, lost, inflation)
    estimates = coefficients(design, fit, values.residuals.baseline[:, :1] - wear.T).T
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
    first = slice(0, _EVIDENCE * settings.baseline_runs)
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
    u = 1 + np.maximum(np.asarray(level, dtype=float), _STIFFEST)
    # An outlier must not be the more certain for it: no further up than the run before it.
    before = np.concatenate([u[:1], u[:-1]])
    bounded = np.minimum(u, np.maximum(before, 1.0))
    return 1 - 1 / u, np.asarray(uncertainty, dtype=float) / bounded**2


def chart_states(
    ramp: Array, odds: Array, limits: ControlLimits, calm_runs: int, visit: NDArray[np.int_] | None = None
) -> tuple[State, ...]:
    """States of runs: an alarm or a watch lasts until several runs in a row are below both limits of watch.

    A repeat replaces the run before it, unless that has alarmed.

    Parameters
    ----------
    ramp, odds : ndarray, shape (n,)
        The two statistics.
    limits : ControlLimits
        Limits of both.
    calm_runs : int
        Number of runs in a row.
    visit : ndarray of int, shape (n,), optional
        Visit of each run; by default each run is a visit.

    Returns
    -------
    tuple of str
        One per run.
    """
    if visit is None:
        visit = np.arange(len(ramp))
    alarmed = (ramp > limits.ramp) | (odds > limits.odds)
    watched = (ramp > limits.watch_ramp) | (odds > limits.watch_odds)
    states: list[State] = []
    state: State = "learning"
    calm = 0
    before = state, calm
    for k in range(len(ramp)):
        if visit[k] < BEGIN:
            states.append("learning")
            continue
        if visit[k] != visit[k - 1]:
            before = state, calm
        elif state != "alarm":
            state, calm = before
        calm = 0 if watched[k] else calm + 1
        state = _next_state(state, bool(alarmed[k]), bool(watched[k]), calm, calm_runs)
        states.append(state)
    return tuple(states)


def _next_state(state: State, alarmed: bool, watched: bool, calm: int, calm_runs: int) -> State:
    if alarmed:
        return "alarm"
    if state == "alarm":
        return "alarm" if calm < calm_runs else "normal"
    if watched:
        return "watch"
    if state == "learning" or calm >= min(calm_runs, 2):
        return "normal"
    return state


def _reference(design: Design, states: Sequence[State], onset: NDArray[np.int_]) -> NDArray[np.int_]:
    """Visits of the baseline; if an alarm began among them, only those before it, which contain no wear.

    A watch that leads to no alarm does not shorten the baseline: a healthy axis has one now and then.
    """
    count = min(design.settings.baseline_runs, len(states))
    for k in range(min(BEGIN, count), count):
        if states[k] in ("watch", "alarm") and _leads_to_alarm(states[k:]):
            return np.arange(min(int(onset[k]) + 1, BEGIN))
    return np.arange(count)


def _leads_to_alarm(states: Sequence[State]) -> bool:
    """Check whether an alarm precedes the next normal state."""
    for state in states:
        if state in ("alarm", "normal"):
            return state == "alarm"
    return False
