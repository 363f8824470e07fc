"""The chart of an epoch: statistics beside their limits, and the states that follow, with hysteresis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballscrew.health.detection.design import Design, Step, coefficients, design, told_by
from ballscrew.health.detection.limits import BEGIN, Limits, limits
from ballscrew.health.detection.odds import odds
from ballscrew.health.detection.ramp import ramp
from ballscrew.health.detection.robust import residuals
from ballscrew.health.detection.settings import MonitorSettings

__all__ = ["Chart", "State", "chart", "states"]

Array = NDArray[np.float64]
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
    u = 1 + np.maximum(np.asarray(level, dtype=float), _STIFFEST)
    lost = 1 - 1 / u
    # A run that stands far off must not be the sharper for it: no further up than the run before it.
    calm = np.minimum(u, np.maximum(np.concatenate([u[:1], u[:-1]]), 1.0))
    of = design(days, np.asarray(told, dtype=float) / calm**2, temperature, steps, kept)
    y = lost[:, None]
    seen = residuals(of, y)
    grown, onset = ramp(of, seen.level, seen.scale, BEGIN)
    known = limits(of)
    worn = odds(of, y, BEGIN)
    fallen = ramp(of, -seen.level, seen.scale, BEGIN)[0][:, 0]
    found = states(grown[:, 0], worn[:, 0], known, kept.calm_runs)
    reference = _reference(of, found, onset[:, 0])
    best, covariance = np.zeros(of.columns.shape[1]), np.zeros((of.columns.shape[1],) * 2)
    if len(reference):
        told_of = told_by(of, reference, len(of.days))
        best = coefficients(of, told_of, seen.taught[:, 0])
        wider = (float(seen.scale[-1, 0]) / kept.scale) ** 2
        covariance = wider * told_of.by_noise + told_of.by_prior
    return Chart(
        of, seen.level[:, 0], grown[:, 0], worn[:, 0], onset[:, 0], known, seen.scale[:, 0], found,
        reference, best, covariance, fallen > known.ramp,
    )  # fmt: skip


def states(grown: Array, worn: Array, known: Limits, calm_runs: int) -> tuple[State, ...]:
    """States of runs: an alarm or a watch stays until several runs in a row lie below both limits of watch.

    Parameters
    ----------
    grown, worn : ndarray, shape (n,)
        The two statistics.
    known : Limits
        Of both.
    calm_runs : int
        How many runs.

    Returns
    -------
    tuple of str
        One a run.
    """
    found: list[State] = []
    state: State = "learning"
    calm = 0
    for k in range(len(grown)):
        if k < BEGIN:
            found.append("learning")
            continue
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
