"""Which of all groups of neighbouring stops stands out most, and how far one does by chance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ballscrew.base.arrays import Array

__all__ = ["CALM", "largest_contrast", "windows"]


CALM = 0.005
"""Probability that an evenly worn axis shows a place, one in two hundred."""

_WIDEST = 1 / 3  # of the stops that a local loss may hold: more is no place but a course
_TRIALS = 8_000
_SEED = 4242


def windows(count: int) -> list[tuple[int, int]]:
    """Every run of neighbouring stops that may be a place: first, and one past the last.

    Parameters
    ----------
    count : int
        Stops.

    Returns
    -------
    list of (int, int)
        Of a third of the stops at most.
    """
    widest = max(int(count * _WIDEST), 1)
    return [(a, a + n) for n in range(1, widest + 1) for a in range(count - n + 1)]


def largest_contrast(
    means: Array,
    noise: Array,
    free: int,
    nut: Array,
    basis: Array,
    places: Sequence[tuple[int, int]],
    alarm: float = CALM,
) -> tuple[float, float, int]:
    """The place that stands out most, and how far the largest does where nothing is there.

    Parameters
    ----------
    means : ndarray, shape (stops,)
        What each stop says beyond the smooth course.
    noise : ndarray, shape (stops,)
        Variance of each.
    free : int
        Degrees of freedom that the variance was told from.
    nut : ndarray, shape (stops,)
        The nut's share at each.
    basis : ndarray, shape (stops, k)
        What belongs to the smooth course.
    places : sequence of (int, int)
        As :func:`windows` lists them.
    alarm : float
        Probability that the largest exceeds the limit where nothing is there.

    Returns
    -------
    statistic, limit : float
        In standard deviations; a loss is positive.
    best : int
        Which of the places.
    """
    weight = 1 / np.sqrt(noise)
    course = np.linalg.qr(weight[:, None] * basis)[0]
    shapes = np.zeros((len(places), len(means)))
    for row, (first, past) in zip(shapes, places, strict=True):
        row[first:past] = nut[first:past]
    shapes = shapes * weight
    shapes = shapes - (shapes @ course) @ course.T
    length = np.linalg.norm(shapes, axis=1)
    usable = length > 1e-6 * max(float(length.max()), 1e-300)
    shapes = np.where(usable[:, None], shapes / np.where(usable, length, 1.0)[:, None], 0.0)
    told = shapes @ (weight * means)
    rng = np.random.default_rng(_SEED)
    drawn = rng.standard_normal((_TRIALS, len(means))) @ shapes.T
    guessed = np.sqrt(rng.chisquare(free, _TRIALS) / free)
    limit = float(np.quantile(drawn.max(axis=1) / guessed, 1 - alarm))
    best = int(np.argmax(told))
    return float(told[best]), limit, best
