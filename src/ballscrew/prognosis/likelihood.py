"""How probable the runs of a course are in each of many lives."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from ballscrew.base.arrays import Array
from ballscrew.prognosis.course import Course
from ballscrew.prognosis.life_prior import WAVES, LifePrior, Lives
from ballscrew.prognosis.wear_path import left_after, worn_time

__all__ = ["left_on", "level_misfit", "log_likelihood", "ratio_of", "wander_waves", "warmth_known"]

_FREEDOM = 5.0  # of Student's law: one run in thirty is four times as far off
_LEAST = 1e-4  # of x: below it the preload is gone


def left_on(lives: Lives, days: Array, span: float) -> Array:
    """What is left, x, of each life on each day of the history.

    Parameters
    ----------
    lives : Lives
        m of them.
    days : ndarray, shape (n,)
        Of the epoch.
    span : float
        Day up to which the pace's wander is told.

    Returns
    -------
    ndarray, shape (m, n)
        1 − w/δ₀.
    """
    since = days - lives.onset[:, None]
    worn = worn_time(since, lives.relaxing[:, None], lives.relaxation[:, None])
    begin = np.sum(lives.wander * wander_waves(lives.onset, span).T, axis=1)
    astray = lives.wander @ wander_waves(days, span) - begin[:, None]
    worn = np.where(since > 0, np.maximum(worn + astray, 0.0), 0.0)
    return left_after(lives.rate[:, None] * worn, lives.exponent[:, None], lives.load[:, None])


def wander_waves(days: Array, span: float) -> Array:
    """The largest waves of Brownian motion up to a day (its Karhunen–Loève expansion); held from there on.

    Parameters
    ----------
    days : ndarray, shape (n,)
        Of the epoch.
    span : float
        The day.

    Returns
    -------
    ndarray, shape (5, n)
        The sum of each times a standard normal number is the motion, of unit variance after a day.
    """
    size = max(span, 1.0)
    turns = (np.arange(WAVES)[:, None] + 0.5) * np.pi
    return np.asarray(math.sqrt(2 * size) / turns * np.sin(turns * np.clip(days / size, 0.0, 1.0)))


def warmth_known(course: Course, prior: LifePrior) -> Course:
    """A course without unknown temperatures.

    Parameters
    ----------
    course : Course
        As it is.
    prior : LifePrior
        What is believed of a kelvin.

    Returns
    -------
    Course
        Where a temperature is not known it is the mean of the others, and the run so much less certain.
    """
    warmer = course.temperature
    blind = ~np.isfinite(warmer)
    known = warmer[~blind] if not blind.all() else np.zeros(1)
    doubt = np.where(blind, prior.temperature * float(np.std(known)), 0.0)
    return replace(
        course,
        temperature=np.where(blind, float(np.mean(known)), warmer),
        random=np.hypot(course.random, doubt),
    )


def ratio_of(left: Array) -> Array:
    """P/P₀ of what is left of the approach."""
    return np.asarray(np.maximum(left, 0.0) ** 1.5)


def log_likelihood(lives: Lives, course: Course, prior: LifePrior, span: float) -> Array:
    """Of every run in every life.

    Parameters
    ----------
    lives : Lives
        m of them.
    course : Course
        n runs; of known temperature (:func:`warmth_known`).
    prior : LifePrior
        What is believed: of the days in which a bearing drifts.
    span : float
        As in :func:`left_on`.

    Returns
    -------
    ndarray, shape (m, n)
        Logarithm of the density, up to a constant of the run.
    """
    left = left_on(lives, course.days, span)
    total = np.zeros_like(left)
    seen = np.isfinite(course.level)
    if seen.any():
        total[:, seen] += _levels(lives, course, prior, left, seen)
    touched = np.isfinite(course.backlash)
    if touched.any():
        total[:, touched] += _backlash(course, left, touched)
    rubbed = np.isfinite(course.friction)
    if rubbed.any():
        total[:, rubbed] += _friction(lives, course, prior, left, rubbed)
    return total


def level_misfit(lives: Lives, course: Course, prior: LifePrior, span: float) -> Array:
    """By how many of the standard deviations that it tells each level is off; parameters as above.

    Returns
    -------
    ndarray, shape (m, k)
        In each life, of the k runs that tell a level. The life's own noise would grow with the misfit.
    """
    seen = np.isfinite(course.level)
    off, _ = _off_level(lives, course, prior, left_on(lives, course.days, span), seen)
    return off / course.random[seen]


def _levels(lives: Lives, course: Course, prior: LifePrior, left: Array, seen: NDArray[np.bool_]) -> Array:
    return _student(*_off_level(lives, course, prior, left, seen))


def _off_level(
    lives: Lives, course: Course, prior: LifePrior, left: Array, seen: NDArray[np.bool_]
) -> tuple[Array, Array]:
    t = course.days[seen]
    softer = np.exp(-0.5 * np.log(np.maximum(left[:, seen], _LEAST))) - 1
    expected = np.minimum(softer, course.ceiling) * lives.scale[:, None] + lives.offset[:, None]
    expected = expected + lives.bearing[:, None] * (t / (t + prior.bearing_days))
    expected = expected + lives.temperature[:, None] * course.temperature[seen]
    return course.level[seen] - expected, lives.noise[:, None] * course.random[seen]


def _friction(lives: Lives, course: Course, prior: LifePrior, left: Array, seen: NDArray[np.bool_]) -> Array:
    t = course.days[seen]
    share = lives.friction_share[:, None]
    rest = (1 - share) * (1 + lives.friction_drift[:, None] * (t / (t + prior.bearing_days)))
    expected = lives.friction[:, None] * (rest + share * ratio_of(left[:, seen]))
    spread = lives.friction_noise[:, None] * course.friction_uncertainty[seen]
    return _student(course.friction[seen] - expected, spread)


def _backlash(course: Course, left: Array, seen: NDArray[np.bool_]) -> Array:
    expected = 2 * course.pressed * np.maximum(-left[:, seen], 0.0)
    told, spread = course.backlash[seen], course.backlash_uncertainty[seen]
    unseen = told < course.resolution
    below = log_ndtr((course.resolution - expected) / spread)
    return np.where(unseen, below, _student(told - expected, np.broadcast_to(spread, expected.shape)))


def _student(off: Array, spread: Array) -> Array:
    constant = (
        math.lgamma((_FREEDOM + 1) / 2) - math.lgamma(_FREEDOM / 2) - 0.5 * math.log(_FREEDOM * math.pi)
    )
    return np.asarray(
        constant - (_FREEDOM + 1) / 2 * np.log1p((off / spread) ** 2 / _FREEDOM) - np.log(spread)
    )
