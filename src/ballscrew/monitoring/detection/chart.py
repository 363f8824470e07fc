"""The chart of an epoch: statistics beside their limits, and the states that follow, with hysteresis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import Design, Step, coefficients, design, told_by
from ballscrew.monitoring.detection.limits import BEGIN, Limits, far_off, limits, statistics
from ballscrew.monitoring.detection.ramp import ramp
from ballscrew.monitoring.detection.repeat import Visits, visits
from ballscrew.monitoring.detection.settings import MonitorSettings

__all__ = ["Chart", "State", "chart", "charted", "states"]

_STIFFEST = -0.5  # P/P₀ of 8: nothing was measured
State = Literal["learning", "normal", "watch", "alarm"]


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """Of an epoch's n good runs, in time order.

    Parameters
    ----------
    design : Design
        Its model.
    lost : ndarray, shape (n,)
        1 − (P/P₀)^(1/3): what was charted, odd runs drawn back.
    ramp, odds : ndarray, shape (n,)
        Statistics.
    onset : ndarray of int, shape (n,)
        Run at which the ramp seems to begin.
    limits : Limits
        Of both.
    scale : ndarray, shape (n,)
        Scatter from run to run over the told one, as known at each run.
    states : tuple of str
        learning, normal, watch or alarm.
    baseline : ndarray of int, shape (b,)
        Runs that the preload is told relative to: the first ones; where an alarm began in them, those before.
    coefficients : ndarray, shape (p,)
        Of ``lost``: baseline, effect of a kelvin and of its square, and steps.
    covariance : ndarray, shape (p, p)
        Of these.
    stiffer : ndarray of bool, shape (n,)
        Whether a ramp downwards lies above the limit of one upwards: no wear does that.
    visits : Visits
        Which runs are repeats. The statistics of a run are those before its repeat.
    far_off : ndarray of bool, shape (n,)
        Runs, no repeats, that stand too far up to count in full.
    """

    design: Design
    lost: Array
    ramp: Array
    odds: Array
    onset: NDArray[np.int_]
    limits: Limits
    scale: Array
    states: tuple[State, ...]
    baseline: NDArray[np.int_]
    coefficients: Array
    covariance: Array
    stiffer: NDArray[np.bool_]
    visits: Visits
    far_off: NDArray[np.bool_]


def chart(
    days: Array,
    level: Array,
    told: Array,
    temperature: Array,
    steps: Sequence[Step] = (),
    settings: MonitorSettings | None = None,
) -> Chart:
    """Chart the good runs of an epoch.

    Parameters
    ----------
    days, level, told, temperature : ndarray, shape (n,)
        In time order; d, change of the nut's compliance, its standard uncertainty that a run draws anew, and
        °C (nan where not recorded).
    steps : sequence of Step
        Events that begin no new epoch.
    settings : MonitorSettings, optional
        Rate of false alarms, and priors.

    Returns
    -------
    Chart
        A later run changes no earlier state.
    """
    kept = settings or MonitorSettings()
    lost, sharp = charted(level, told)
    visit = visits(days, sharp, temperature, steps, kept.repeats_per_year > 0)
    first, at = visit.first, visit.of_run
    of = design(days[first], sharp[first], temperature[first], steps, kept)
    again = np.full(len(first), np.nan)
    again[visit.repeated] = lost[visit.again[visit.repeated]]
    known = limits(of)
    # A repeat counts where one is asked for: the limits are made of healthy axes on which no other is made.
    seen = statistics(of, lost[first][:, None], again[:, None], lambda k, _: float(known.repeat[k]))
    grown, worn = seen.ramp[at, 0], seen.odds[at, 0]
    grown[first], worn[first] = seen.ramp_first[:, 0], seen.odds_first[:, 0]
    beyond = np.zeros(len(at), dtype=bool)
    beyond[first] = far_off(of, lost[first][:, None])[:, 0]
    repeated = seen.repeated[at, 0]
    repeated[first] = False
    known = known.of(at, repeated)
    fallen = ramp(of, -seen.seen.level, seen.seen.scale, BEGIN)[0][at, 0]
    found = states(grown, worn, known, kept.calm_runs, at)
    last = np.maximum(first, visit.again)
    reference = _reference(of, [found[k] for k in last], seen.onset[:, 0])
    best, covariance = np.zeros(of.columns.shape[1]), np.zeros((of.columns.shape[1],) * 2)
    if len(reference):
        told_of = told_by(of, reference, len(of.days))
        best = coefficients(of, told_of, seen.seen.taught[:, 0])
        wider = (float(seen.seen.scale[-1, 0]) / kept.scale) ** 2
        covariance = wider * told_of.by_noise + told_of.by_prior
    return Chart(
        design(days, sharp, temperature, steps, kept), seen.seen.level[at, 0], grown, worn,
        first[seen.onset[at, 0]], known, seen.seen.scale[at, 0], found, visit.runs(reference), best,
        covariance, fallen > known.ramp, visit, beyond,
    )  # fmt: skip


def charted(level: Array, told: Array) -> tuple[Array, Array]:
    """What is charted of runs: 1 − (P/P₀)^(1/3), and its standard uncertainty.

    Parameters
    ----------
    level, told : ndarray, shape (n,)
        As in :func:`chart`.

    Returns
    -------
    lost, told : ndarray, shape (n,)
        Of each run.
    """
    u = 1 + np.maximum(np.asarray(level, dtype=float), _STIFFEST)
    # A run that stands far off must not be the sharper for it: no further up than the run before it.
    calm = np.minimum(u, np.maximum(np.concatenate([u[:1], u[:-1]]), 1.0))
    return 1 - 1 / u, np.asarray(told, dtype=float) / calm**2


def states(
    grown: Array, worn: Array, known: Limits, calm_runs: int, visit: NDArray[np.int_] | None = None
) -> tuple[State, ...]:
    """States of runs: an alarm or a watch stays until several runs in a row lie below both limits of watch.

    A repeat is judged in place of the run it repeats, unless that has alarmed.

    Parameters
    ----------
    grown, worn : ndarray, shape (n,)
        The two statistics.
    known : Limits
        Of both.
    calm_runs : int
        How many runs.
    visit : ndarray of int, shape (n,), optional
        Of each run; by default each run is one.

    Returns
    -------
    tuple of str
        One a run.
    """
    at = np.arange(len(grown)) if visit is None else visit
    found: list[State] = []
    state: State = "learning"
    before: tuple[State, int] = state, 0
    calm = 0
    for k in range(len(grown)):
        if at[k] < BEGIN:
            found.append("learning")
            continue
        if at[k] != at[k - 1]:
            before = state, calm
        elif state != "alarm":
            state, calm = before
        watched = grown[k] > known.watch_ramp[k] or worn[k] > known.watch_odds[k]
        calm = 0 if watched else calm + 1
        if grown[k] > known.ramp[k] or worn[k] > known.odds[k]:
            state = "alarm"
        elif state == "alarm":
            state = "alarm" if calm < calm_runs else "normal"
        elif watched:
            state = "watch"
        elif state == "learning" or calm >= min(calm_runs, 2):
            state = "normal"
        found.append(state)
    return tuple(found)


def _reference(of: Design, found: Sequence[State], onset: NDArray[np.int_]) -> NDArray[np.int_]:
    """Wear must not hide in its own baseline: where an alarm began in it, only what lies before counts.

    A watch that no alarm followed is no reason: a healthy axis has one now and then.
    """
    count = min(of.settings.baseline_runs, len(found))
    for k in range(min(BEGIN, count), count):
        if found[k] in ("watch", "alarm") and "alarm" in _spell(found, k):
            return np.arange(min(int(onset[k]) + 1, BEGIN))
    return np.arange(count)


def _spell(found: Sequence[State], k: int) -> Sequence[State]:
    """From a run on, up to the next that is normal."""
    return found[k : next((i for i in range(k, len(found)) if found[i] == "normal"), len(found))]
