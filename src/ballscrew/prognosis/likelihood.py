"""Likelihood of the runs of a history in each of many lives, and whether the newest runs fit them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from ballscrew.base.arrays import Array
from ballscrew.prognosis.life_prior import WAVES, LifePrior, Lives
from ballscrew.prognosis.preload_history import PreloadHistory
from ballscrew.prognosis.wear_path import remaining_after, worn_time

_FREEDOM = 5.0  # degrees of freedom of Student's distribution: one run in thirty is four times as far off
_LEAST_REMAINING = 1e-4  # of x: below it the preload is gone
_NEWEST = 5  # runs: of fewer, one outlier is half
_MISFIT = 3.0  # standard deviations, of the median of the newest runs
_LAST_MISFIT = 6.0  # of the last run, where it agrees with the runs before it


def remaining_on(lives: Lives, days: Array, span: float) -> Array:
    """Remaining part x of the flanks' approach of each life on each day of the history.

    Parameters
    ----------
    lives : Lives
        m of them.
    days : ndarray, shape (n,)
        Days of the epoch.
    span : float
        Day up to which the pace wanders.

    Returns
    -------
    ndarray, shape (m, n)
        1 − w/δ₀.
    """
    since = days - lives.onset[:, None]
    worn = worn_time(since, lives.relaxing[:, None], lives.relaxation[:, None])
    at_onset = np.sum(lives.wander * wander_waves(lives.onset, span).T, axis=1)
    wandered = lives.wander @ wander_waves(days, span) - at_onset[:, None]
    worn = np.where(since > 0, np.maximum(worn + wandered, 0.0), 0.0)
    return remaining_after(lives.rate[:, None] * worn, lives.exponent[:, None], lives.load[:, None])


def wander_waves(days: Array, span: float) -> Array:
    """Largest waves of Brownian motion up to a day (its Karhunen–Loève expansion); constant from there on.

    Parameters
    ----------
    days : ndarray, shape (n,)
        Days of the epoch.
    span : float
        The day.

    Returns
    -------
    ndarray, shape (5, n)
        The sum of the waves, each times a standard normal number, is the motion, of unit variance after a
        day.
    """
    size = max(span, 1.0)
    turns = (np.arange(WAVES)[:, None] + 0.5) * np.pi
    return np.asarray(math.sqrt(2 * size) / turns * np.sin(turns * np.clip(days / size, 0.0, 1.0)))


def fill_temperature(history: PreloadHistory, prior: LifePrior) -> PreloadHistory:
    """Replace unknown temperatures by the mean of the known ones.

    Parameters
    ----------
    history : PreloadHistory
        As recorded.
    prior : LifePrior
        With the effect of a kelvin.

    Returns
    -------
    PreloadHistory
        A run without a temperature has a correspondingly larger uncertainty.
    """
    unknown = ~np.isfinite(history.temperature)
    known = history.temperature[~unknown]
    if not len(known):
        known = np.zeros(1)
    doubt = np.where(unknown, prior.temperature * float(np.std(known)), 0.0)
    return replace(
        history,
        temperature=np.where(unknown, float(np.mean(known)), history.temperature),
        level_uncertainty=np.hypot(history.level_uncertainty, doubt),
    )


def preload_ratio(remaining: Array) -> Array:
    """P/P₀ from the remaining part x of the approach: x^1.5, and 0 with backlash."""
    return np.asarray(np.maximum(remaining, 0.0) ** 1.5)


def log_likelihood(lives: Lives, history: PreloadHistory, prior: LifePrior, span: float) -> Array:
    """Logarithm of the likelihood of every run in every life.

    Parameters
    ----------
    lives : Lives
        m of them.
    history : PreloadHistory
        n runs; of known temperature (:func:`fill_temperature`).
    prior : LifePrior
        With the days in which a bearing drifts.
    span : float
        As in :func:`remaining_on`.

    Returns
    -------
    ndarray, shape (m, n)
        Up to a constant of the run.
    """
    remaining = remaining_on(lives, history.days, span)
    total = np.zeros_like(remaining)
    with_level = np.isfinite(history.level)
    if with_level.any():
        error = _level_error(lives, history, prior, remaining, with_level)
        spread = lives.noise[:, None] * history.level_uncertainty[with_level]
        total[:, with_level] += _log_student(error, spread)
    with_backlash = np.isfinite(history.backlash)
    if with_backlash.any():
        total[:, with_backlash] += _log_backlash(history, remaining, with_backlash)
    with_friction = np.isfinite(history.friction)
    if with_friction.any():
        total[:, with_friction] += _log_friction(lives, history, prior, remaining, with_friction)
    return total


def fits_newest_runs(lives: Lives, history: PreloadHistory, prior: LifePrior, span: float) -> bool:
    """Check whether lives agree with the newest levels, relative to the scatter of a run.

    A forecast is meaningless where its lives do not have the preload of the newest runs.

    Parameters
    ----------
    lives : Lives
        m of them, equally probable.
    history : PreloadHistory
        Up to the day of the forecast; of known temperature.
    prior : LifePrior
        As in :func:`log_likelihood`.
    span : float
        Day up to which the pace wanders.

    Returns
    -------
    bool
        True where no run gives a level. The scale that all runs share is in the lives. An outlying last run
        does not count, but a last run that agrees with those before it does where only the lives differ: its
        time may be wrong.
    """
    with_level = np.isfinite(history.level)
    newest = history.part(with_level & (np.cumsum(with_level) > with_level.sum() - _NEWEST))
    if not len(newest):
        return True
    every = np.ones(len(newest), dtype=np.bool_)
    error = _level_error(lives, newest, prior, remaining_on(lives, newest.days, span), every)
    stated = newest.level_uncertainty
    median = np.median(error / stated, axis=0)
    spread = np.maximum(stated, _median_step(newest.level))
    misfit = median * stated / spread
    if abs(np.median(misfit)) > _MISFIT:
        return False
    before = newest.level[:-1]
    agrees = len(before) > 1 and abs(newest.level[-1] - np.median(before)) < _MISFIT * spread[-1]
    return not (agrees and abs(misfit[-1]) > _LAST_MISFIT)


def _median_step(level: Array) -> float:
    """Scatter from run to run, by the median difference; wear from run to run is in it, and small."""
    steps = np.abs(np.diff(level))
    return float(np.median(steps)) if len(steps) else 0.0


def _level_error(
    lives: Lives, history: PreloadHistory, prior: LifePrior, remaining: Array, runs: NDArray[np.bool_]
) -> Array:
    """Observed minus expected level of some of the runs, shape (m, k)."""
    t = history.days[runs]
    softer = np.exp(-0.5 * np.log(np.maximum(remaining[:, runs], _LEAST_REMAINING))) - 1
    expected = np.minimum(softer, history.ceiling) * lives.scale[:, None] + lives.offset[:, None]
    expected = expected + lives.bearing[:, None] * (t / (t + prior.bearing_days))
    expected = expected + lives.temperature[:, None] * history.temperature[runs]
    return np.asarray(history.level[runs] - expected)


def _log_friction(
    lives: Lives, history: PreloadHistory, prior: LifePrior, remaining: Array, runs: NDArray[np.bool_]
) -> Array:
    t = history.days[runs]
    share = lives.friction_share[:, None]
    rest = (1 - share) * (1 + lives.friction_drift[:, None] * (t / (t + prior.bearing_days)))
    expected = lives.friction[:, None] * (rest + share * preload_ratio(remaining[:, runs]))
    spread = lives.friction_noise[:, None] * history.friction_uncertainty[runs]
    return _log_student(history.friction[runs] - expected, spread)


def _log_backlash(history: PreloadHistory, remaining: Array, runs: NDArray[np.bool_]) -> Array:
    expected = 2 * history.approach * np.maximum(-remaining[:, runs], 0.0)
    measured, spread = history.backlash[runs], history.backlash_uncertainty[runs]
    unresolved = measured < history.resolution
    below = log_ndtr((history.resolution - expected) / spread)
    resolved = _log_student(measured - expected, np.broadcast_to(spread, expected.shape))
    return np.where(unresolved, below, resolved)


def _log_student(error: Array, spread: Array) -> Array:
    constant = (
        math.lgamma((_FREEDOM + 1) / 2) - math.lgamma(_FREEDOM / 2) - 0.5 * math.log(_FREEDOM * math.pi)
    )
    tail = np.log1p((error / spread) ** 2 / _FREEDOM)
    return np.asarray(constant - (_FREEDOM + 1) / 2 * tail - np.log(spread))
