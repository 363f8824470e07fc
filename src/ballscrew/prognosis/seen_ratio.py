"""What models that know one number only are given: the preload ratio as every run tells it."""

from __future__ import annotations

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.prognosis.course import Course

__all__ = ["cube_root"]

_BEGIN = 5
_FEWEST = 3


def cube_root(course: Course) -> tuple[Array, Array, Array, Array]:
    """(P/P₀)^(1/3) of each run.

    Parameters
    ----------
    course : Course
        With levels, or else with friction, which is then taken for all the preload's.

    Returns
    -------
    days, value, standard_uncertainty, temperature : ndarray, shape (n,)
        Temperature in K, 0 where it is not known.

    Raises
    ------
    InputError
        If fewer than three runs tell it.
    """
    seen = np.isfinite(course.level)
    if seen.any():
        value = 1 / (1 + course.level[seen])
        spread = value**2 * course.random[seen]
    else:
        seen = np.isfinite(course.friction) & (course.friction > 0)
        force = course.friction[seen]
        begin = float(np.mean(force[:_BEGIN])) if len(force) else 1.0
        value = np.cbrt(force / begin)
        spread = value / 3 * course.friction_uncertainty[seen] / force
    if seen.sum() < _FEWEST:
        raise InputError(
            f"{int(seen.sum())} runs tell of the preload; this life model takes {_FEWEST} at least."
        )
    return course.days[seen], value, spread, np.nan_to_num(course.temperature[seen])
