"""The remaining life by the laws of wear: a particle filter over lives (:mod:`~.life_prior`)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.prognosis.course import Course
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.forecast import FAN, Forecast, ahead, reach_of
from ballscrew.prognosis.gathered import MOST, gathered
from ballscrew.prognosis.life_prior import NUMBERS, OF_FRICTION, LifePrior, Lives, lives_of
from ballscrew.prognosis.likelihood import log_likelihood, ratio_of, wander_waves, warmth_known
from ballscrew.prognosis.newest_runs import fits
from ballscrew.prognosis.resample_move import filtered, tempered
from ballscrew.prognosis.wear_path import day_of, left_after, named_laws, spent_at, worn_time

__all__ = ["ParticleFilter"]

_NEVER = 1e9  # days
_BEGIN = 5  # runs that tell about the friction in the beginning


@dataclass(frozen=True, slots=True)
class ParticleFilter:
    """Lives that fit what was observed, weighed by how well they do.

    Parameters
    ----------
    prior : LifePrior
        What is believed before.
    particles : int
        Lives that are followed.
    moves : int
        Markov steps after each resampling, and five times as many before anything is told; up to four times
        that where few are taken.
    seed : int
        The same seed gives the same forecast.
    most : int
        Runs that are looked at one by one; of more, neighbours are gathered.
    """

    prior: LifePrior = field(default_factory=LifePrior)
    particles: int = 2000
    moves: int = 12
    seed: int = 1
    most: int = MOST

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        if self.particles < 100 or self.moves < 1:
            raise InputError(
                f"a particle filter of {self.particles} particles and {self.moves} moves was asked for; it "
                "takes 100 and 1 at least."
            )

    def forecast(self, course: Course, failure: Failure, *, at: float | None = None) -> Forecast:
        """The remaining life as known at the end of a day.

        Parameters
        ----------
        course : Course
            History; what comes after ``at`` is not looked at.
        failure : Failure
            What counts as the end.
        at : float, optional
            Day of the epoch; by default that of the last run.

        Returns
        -------
        Forecast
            With laws, and with the probability that wear has begun.

        Raises
        ------
        InputError
            If there is no run.
        """
        if not len(course):
            raise InputError("there is no run to forecast from; one at least is needed.")
        day = float(course.days[-1]) if at is None else at
        return next(self.forecasts(course, failure, [day]))

    def forecasts(self, course: Course, failure: Failure, at: Sequence[float]) -> Iterator[Forecast]:
        """Forecasts of several days, ascending; each knows only what was known then.

        Parameters
        ----------
        course, failure
            As in :meth:`forecast`.
        at : sequence of float
            Days of the epoch.

        Yields
        ------
        Forecast
            One a day.
        """
        _ascending(at)
        for each in at:
            # One pass over all days would tell the first of them how long the pace's wander is followed.
            day, lives = next(self.lives(course, [each]))
            yield self._told(day, lives, course, failure, float(each))

    def lives(self, course: Course, at: Sequence[float]) -> Iterator[tuple[float, Lives]]:
        """Equally probable lives at the end of several days, in one pass; parameters as :meth:`forecasts`.

        The pace's wander, and runs that are gathered where they are many, are those up to the last day.
        """
        _ascending(at)
        few, last = gathered(course.until(at[-1]), self.most)
        known = warmth_known(few, self.prior)
        rubbed = known.friction[np.isfinite(known.friction)]
        friction = float(np.median(rubbed[:_BEGIN])) if len(rubbed) else 1.0
        told = known.random[np.isfinite(known.level)]
        offset = self.prior.noise * float(np.median(told)) if len(told) else 0.0
        size = NUMBERS if len(rubbed) else NUMBERS - OF_FRICTION

        def lives(z: Array) -> Lives:
            return lives_of(z, self.prior, course.scale, offset, friction)

        def likelihood(z: Array, start: int, stop: int) -> Array:
            some = np.zeros(len(known), dtype=np.bool_)
            some[start:stop] = True
            return log_likelihood(lives(z), known.part(some), self.prior, float(at[-1]))

        marks = np.searchsorted(last, at, side="right").tolist()
        filters = filtered(likelihood, size, marks, self.particles, self.moves, self.seed)
        for day, mark, z in zip(at, marks, filters, strict=True):
            found = lives(z)
            newest = known.part(np.arange(len(known)) < mark)
            if not fits(found, newest, self.prior, float(at[-1])):
                found = lives(tempered(likelihood, size, mark, self.particles, self.moves, self.seed))
            yield float(day), found

    def _told(self, day: float, lives: Lives, course: Course, failure: Failure, span: float) -> Forecast:
        history = max(day - float(course.days[0]), 0.0)
        newest = warmth_known(gathered(course.until(day), self.most)[0], self.prior)
        true = fits(lives, newest, self.prior, span)
        reach = reach_of(history)
        random = np.random.default_rng([self.seed, 1])
        z = random.standard_normal((2, len(lives.rate)))
        astray = astray_by(lives, day, span)
        remaining = remaining_days(lives, failure.left(course.pressed), day, astray)
        # The pace ahead is that of the past, but never quite; the longer it goes on the more it evens out.
        even = self.prior.wander * z[1] / np.sqrt(np.clip(remaining, 1.0, reach))
        pace = np.exp(self.prior.chance * z[0]) * np.clip(1 + even, 0.3, 3.0)
        remaining = remaining / pace
        lasting = np.sort(np.where((remaining > reach) | (not true), np.inf, remaining))
        days = ahead(lasting, reach)
        ratio = np.stack([ratio_of(_left_later(lives, day, d * pace, astray)) for d in days])
        mode, end = failure.mode(course.pressed)
        rate = np.quantile(lives.rate, [0.05, 0.5, 0.95]).tolist()
        now = np.quantile(ratio[0], [0.05, 0.5, 0.95]).tolist()
        begun = lives.onset < day
        return Forecast(
            at=day,
            rul_days=lasting,
            reach=reach,
            mode=mode,
            end=end,
            days=days,
            ratio=np.quantile(ratio, FAN, axis=1).T if true else np.full((len(days), len(FAN)), np.nan),
            fits=true,
            method="particle filter over the laws of wear",
            begun=float(np.mean(begun)),
            laws=named_laws(lives.exponent),
            told={
                **{
                    f"rate_{name}": value for name, value in zip(("low", "median", "high"), rate, strict=True)
                },
                **{
                    f"ratio_{name}": value for name, value in zip(("low", "median", "high"), now, strict=True)
                },
                "exponent": float(np.mean(lives.exponent)) / 1.5,
                "noise": float(np.median(lives.noise)),
                "temperature": float(np.mean(lives.temperature)),
            },
        )


def _ascending(at: Sequence[float]) -> None:
    if not np.isfinite(at).all() or any(later < sooner for sooner, later in pairwise(at)):
        raise InputError("the days of forecasts must be finite and ascend.")


def astray_by(lives: Lives, day: float, span: float) -> Array:
    """Days of wear by which the pace has gone astray up to a day, shape (m,)."""
    waves = wander_waves(np.append(lives.onset, day), span)
    gone = lives.wander @ waves[:, -1] - np.sum(lives.wander * waves[:, :-1].T, axis=1)
    return np.asarray(np.where(lives.onset < day, gone, 0.0))


def remaining_days(lives: Lives, left: float, day: float, astray: Array) -> Array:
    """Days until x is left, from a day on, at the pace of the past.

    Parameters
    ----------
    lives : Lives
        m of them.
    left : float
        x at the end.
    day : float
        Of the epoch.
    astray : ndarray, shape (m,)
        Of :func:`astray_by`.

    Returns
    -------
    ndarray, shape (m,)
        Days; 0 where the end has been, infinite where it never comes.
    """
    with np.errstate(over="ignore"):
        worn = spent_at(left, lives.exponent, lives.load) / lives.rate - astray
    worn = np.where(worn < _NEVER, np.maximum(worn, 0.0), math.inf)
    end = lives.onset + day_of(worn, lives.relaxing, lives.relaxation)
    return np.asarray(np.maximum(end - day, 0.0))


def _left_later(lives: Lives, day: float, later: Array, astray: Array) -> Array:
    """What is left, x, of each life at its own later day."""
    worn = worn_time(day + later - lives.onset, lives.relaxing, lives.relaxation) + astray
    return left_after(lives.rate * np.maximum(worn, 0.0), lives.exponent, lives.load)
