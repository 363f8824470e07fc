"""Whether lives have the preload that the last runs tell: what does not fit today foretells nothing."""

from __future__ import annotations

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.prognosis.course import Course
from ballscrew.prognosis.life_prior import LifePrior, Lives
from ballscrew.prognosis.likelihood import level_misfit

__all__ = ["fits"]

_NEWEST = 5  # runs: of fewer one odd run is half
_LOST = 3.0  # standard deviations, of the middle of them
_ALONE = 6.0  # of the last run, where it agrees with the runs before it


def fits(lives: Lives, course: Course, prior: LifePrior, span: float) -> bool:
    """Whether the lives fit the newest levels, by what a run scatters.

    Parameters
    ----------
    lives : Lives
        m of them, equally probable.
    course : Course
        Up to the day of the forecast; of known temperature.
    prior : LifePrior
        What is believed.
    span : float
        Day up to which the pace's wander is told.

    Returns
    -------
    bool
        True where no run tells a level. The scale that all runs share is in the lives. An odd last run does
        not count; one that is as those before it while the lives are elsewhere does: its time may be wrong.
    """
    seen = np.isfinite(course.level)
    few = course.part(seen & (np.cumsum(seen) > seen.sum() - _NEWEST))
    if not len(few):
        return True
    off = np.median(level_misfit(lives, few, prior, span), axis=0)
    spread = np.maximum(few.random, _scatter(few.level))
    off = off * few.random / spread
    if abs(np.median(off)) > _LOST:
        return False
    usual = few.level[:-1]
    alike = len(usual) > 1 and abs(few.level[-1] - np.median(usual)) < _LOST * spread[-1]
    return not (alike and abs(off[-1]) > _ALONE)


def _scatter(level: Array) -> float:
    """From run to run, by the middle of the differences; wear from run to run is in it, and small."""
    steps = np.abs(np.diff(level))
    return float(np.median(steps)) if len(steps) else 0.0
