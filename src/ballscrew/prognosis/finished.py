"""What finished lives of like axes teach about the next one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.base.errors import InputError, shown
from ballscrew.prognosis.course import Course
from ballscrew.prognosis.life_prior import LifePrior
from ballscrew.prognosis.particle_filter import ParticleFilter

__all__ = ["FinishedLife", "prior_from"]

_FEWEST = 2
_LEAST_RATE, _LEAST_EXPONENT = 0.35, 0.2  # lives of one make differ by this much at least


@dataclass(frozen=True, slots=True)
class FinishedLife:
    """How one axis wore.

    Parameters
    ----------
    rate : float
        r: part of δ₀ that wore off in a day when new.
    exponent : float
        p of the law, 0 to 1.5.
    """

    rate: float
    exponent: float

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        if not (math.isfinite(self.rate) and self.rate > 0):
            raise InputError(f"the rate of a finished life is {shown(self.rate)}; it must be more than 0.")
        if not 0 <= self.exponent <= 2:
            raise InputError(
                f"the exponent of a finished life is {shown(self.exponent)}; it must be from 0 to 2."
            )

    @classmethod
    def of(cls, course: Course, model: ParticleFilter | None = None) -> FinishedLife:
        """What the whole course of a life tells.

        Parameters
        ----------
        course : Course
            To its end.
        model : ParticleFilter, optional
            Which reads it.

        Returns
        -------
        FinishedLife
            Medians.

        Raises
        ------
        InputError
            If the course has no run.
        """
        if not len(course):
            raise InputError("a finished life has no run; one at least is needed.")
        _, lives = next((model or ParticleFilter()).lives(course, [float(course.days[-1])]))
        return cls(float(np.median(lives.rate)), float(np.median(lives.exponent)))


def prior_from(lives: Sequence[FinishedLife], before: LifePrior | None = None) -> LifePrior:
    """The prior of the next life.

    Parameters
    ----------
    lives : sequence of FinishedLife
        Of like axes under a like duty; two at least.
    before : LifePrior, optional
        What was believed without them.

    Returns
    -------
    LifePrior
        Rate and law as in the lives. The spread is wider than theirs by what so few can be wrong
        (a predictive standard deviation, s √(1 + 1/n) times Student's 84 % point over 1), a floor added, and
        never wider than before.

    Raises
    ------
    InputError
        If there are fewer than two.
    """
    from scipy.stats import t as student

    usual = before or LifePrior()
    n = len(lives)
    if n < _FEWEST:
        raise InputError(f"{n} finished lives were given; a prior takes {_FEWEST} at least.")
    rates = np.log([one.rate for one in lives])
    exponents = np.array([one.exponent for one in lives])
    wider = float(student.ppf(0.8413, n - 1)) * math.sqrt(1 + 1 / n)
    rate_spread = math.hypot(wider * float(np.std(rates, ddof=1)), _LEAST_RATE)
    exponent_spread = math.hypot(wider * float(np.std(exponents, ddof=1)), _LEAST_EXPONENT)
    return replace(
        usual,
        rate=float(np.exp(np.mean(rates))),
        rate_spread=min(rate_spread, usual.rate_spread),
        exponent=float(np.mean(exponents)),
        exponent_spread=min(exponent_spread, 0.5),
    )
