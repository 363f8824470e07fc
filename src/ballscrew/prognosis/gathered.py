"""Many runs as fewer: what a filter has to look at must not grow without end."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.prognosis.course import Course

__all__ = ["MOST", "gathered"]

MOST = 400
_MEDIAN = math.sqrt(math.pi / 2)  # standard deviation of a median over that of a mean


def gathered(course: Course, most: int = MOST) -> tuple[Course, Array]:
    """Neighbouring runs as one, where there are more than so many.

    Parameters
    ----------
    course : Course
        n runs.
    most : int
        Of what comes out.

    Returns
    -------
    course : Course
        Medians of levels, frictions and backlashes, so that an odd run does no harm; means of days and
        temperatures; standard uncertainties as a median of so many has them.
    last : ndarray, shape (m,)
        Day of the last run in each.
    """
    size = math.ceil(len(course) / most)
    if size <= 1:
        return course, course.days
    edges = np.arange(0, len(course), size)
    parts = [slice(int(start), int(start) + size) for start in edges]

    def middle(values: Array) -> Array:
        return np.array([_of(np.median, values[part]) for part in parts])

    def mean(values: Array) -> Array:
        return np.array([_of(np.mean, values[part]) for part in parts])

    def spread(values: Array, told: Array) -> Array:
        count = np.array([np.isfinite(values[part]).sum() for part in parts])
        surer = np.where(count > 2, _MEDIAN / np.sqrt(np.maximum(count, 1)), 1.0)
        return np.asarray(middle(np.where(np.isfinite(values), told, np.nan)) * surer)

    small = replace(
        course,
        days=mean(course.days),
        level=middle(course.level),
        random=spread(course.level, course.random),
        temperature=mean(course.temperature),
        backlash=middle(course.backlash),
        backlash_uncertainty=spread(course.backlash, course.backlash_uncertainty),
        friction=middle(course.friction),
        friction_uncertainty=spread(course.friction, course.friction_uncertainty),
    )
    return small, np.array([course.days[part][-1] for part in parts])


def _of(what: Callable[[Array], Any], values: Array) -> float:
    seen = values[np.isfinite(values)]
    return float(what(seen)) if len(seen) else math.nan
