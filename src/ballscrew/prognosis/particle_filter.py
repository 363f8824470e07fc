"""Remaining life by the laws of wear: a particle filter over lives (:mod:`~.life_prior`)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.forecast import FAN, Forecast, fan_days, reach_of
from ballscrew.prognosis.life_prior import NUMBERS, OF_FRICTION, LifePrior, Lives, lives_from_normal
from ballscrew.prognosis.likelihood import (
    fill_temperature,
    fits_newest_runs,
    log_likelihood,
    preload_ratio,
    wander_waves,
)
from ballscrew.prognosis.preload_history import MOST_RUNS, PreloadHistory, pool_runs
from ballscrew.prognosis.resample_move import filtered, tempered
from ballscrew.prognosis.wear_path import day_of, named_laws, remaining_after, travel_until, worn_time

_NEVER = 1e9  # days
_FIRST_FRICTIONS = 5  # runs whose median is the initial friction


@dataclass(frozen=True, slots=True)
class ParticleFilter:
    """Lives weighted by their likelihood.

    Parameters
    ----------
    prior : LifePrior
        Prior of a life.
    particles : int
        Number of lives.
    moves : int
        Markov steps after each resampling, and five times as many before a forecast; up to four times that
        where few are accepted.
    seed : int
        The same seed gives the same forecast.
    most : int
        Runs that are taken singly; of more, neighbours are pooled.
    """

    prior: LifePrior = field(default_factory=LifePrior)
    particles: int = 2000
    moves: int = 12
    seed: int = 1
    most: int = MOST_RUNS

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.particles < 100 or self.moves < 1:
            raise InputError(
                f"a particle filter of {self.particles} particles and {self.moves} moves was requested; it "
                "needs at least 100 and 1."
            )

    def forecast(self, history: PreloadHistory, failure: Failure, *, at: float | None = None) -> Forecast:
        """Remaining life as known at the end of a day.

        Parameters
        ----------
        history : PreloadHistory
            Runs after ``at`` are ignored.
        failure : Failure
            End of life.
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
        if not len(history):
            raise InputError("there is no run to forecast from; at least one is needed.")
        day = history.last_day if at is None else at
        return next(self.forecasts(history, failure, [day]))

    def forecasts(self, history: PreloadHistory, failure: Failure, at: Sequence[float]) -> Iterator[Forecast]:
        """Forecasts on several days, ascending; each uses only the runs until then.

        Parameters
        ----------
        history, failure
            As in :meth:`forecast`.
        at : sequence of float
            Days of the epoch.

        Yields
        ------
        Forecast
            One per day.
        """
        _check_ascending(at)
        for day in at:
            # One pass over all days would reveal to the first of them how long the pace wanders.
            _, lives = next(self.lives(history, [day]))
            yield self._forecast(float(day), lives, history, failure)

    def lives(self, history: PreloadHistory, at: Sequence[float]) -> Iterator[tuple[float, Lives]]:
        """Equally probable lives at the end of several days, in one pass; parameters as :meth:`forecasts`.

        The random walk of the pace, and the pooling of many runs, are those up to the last day.
        """
        _check_ascending(at)
        span = float(at[-1])
        pooled, last = pool_runs(history.until(at[-1]), self.most)
        known = fill_temperature(pooled, self.prior)
        frictions = known.friction[np.isfinite(known.friction)]
        friction, size = 1.0, NUMBERS - OF_FRICTION
        if len(frictions):
            friction, size = float(np.median(frictions[:_FIRST_FRICTIONS])), NUMBERS
        stated = known.level_uncertainty[np.isfinite(known.level)]
        offset = 0.0
        if len(stated):
            offset = self.prior.noise * float(np.median(stated))

        def lives(z: Array) -> Lives:
            return lives_from_normal(z, self.prior, history.scale, offset, friction)

        def likelihood(z: Array, start: int, stop: int) -> Array:
            selected = np.zeros(len(known), dtype=np.bool_)
            selected[start:stop] = True
            return log_likelihood(lives(z), known.part(selected), self.prior, span)

        marks = np.searchsorted(last, at, side="right").tolist()
        posteriors = filtered(likelihood, size, marks, self.particles, self.moves, self.seed)
        for day, mark, z in zip(at, marks, posteriors, strict=True):
            sampled = lives(z)
            so_far = known.part(np.arange(len(known)) < mark)
            if not fits_newest_runs(sampled, so_far, self.prior, span):
                sampled = lives(tempered(likelihood, size, mark, self.particles, self.moves, self.seed))
            yield float(day), sampled

    def _forecast(self, day: float, lives: Lives, history: PreloadHistory, failure: Failure) -> Forecast:
        newest = fill_temperature(pool_runs(history.until(day), self.most)[0], self.prior)
        fits = fits_newest_runs(lives, newest, self.prior, day)
        reach = reach_of(max(day - float(history.days[0]), 0.0))
        random = np.random.default_rng([self.seed, 1])
        z = random.standard_normal((2, len(lives.rate)))
        wandered = wandered_days(lives, day)
        remaining = remaining_days(lives, failure.remaining(history.approach), day, wandered)
        # The future pace is that of the past, but never quite; over a longer time it averages out.
        walk = self.prior.wander * z[1] / np.sqrt(np.clip(remaining, 1.0, reach))
        pace = np.exp(self.prior.pace_spread * z[0]) * np.clip(1 + walk, 0.3, 3.0)
        remaining = remaining / pace
        open_end = (remaining > reach) | (not fits)
        rul_days = np.sort(np.where(open_end, np.inf, remaining))
        days = fan_days(rul_days, reach)
        ratio = np.stack([preload_ratio(_remaining_later(lives, day, d * pace, wandered)) for d in days])
        fan = np.quantile(ratio, FAN, axis=1).T
        if not fits:
            fan = np.full_like(fan, np.nan)
        mode, end = failure.mode(history.approach)
        return Forecast(
            at=day,
            rul_days=rul_days,
            reach=reach,
            mode=mode,
            end=end,
            days=days,
            ratio=fan,
            fits=fits,
            method="particle filter over the laws of wear",
            begun=float(np.mean(lives.onset < day)),
            laws=named_laws(lives.exponent),
            parameters=_parameters(lives, ratio[0]),
        )


def _parameters(lives: Lives, ratio: Array) -> dict[str, float]:
    """Estimates of a life's parameters, and of the preload ratio today."""
    rate = np.quantile(lives.rate, [0.05, 0.5, 0.95]).tolist()
    today = np.quantile(ratio, [0.05, 0.5, 0.95]).tolist()
    return {
        "rate_low": rate[0],
        "rate_median": rate[1],
        "rate_high": rate[2],
        "ratio_low": today[0],
        "ratio_median": today[1],
        "ratio_high": today[2],
        "exponent": float(np.mean(lives.exponent)) / 1.5,
        "noise": float(np.median(lives.noise)),
        "temperature": float(np.mean(lives.temperature)),
    }


def _check_ascending(at: Sequence[float]) -> None:
    if not np.isfinite(at).all() or np.any(np.diff(at) < 0):
        raise InputError("the days of forecasts must be finite and ascend.")


def wandered_days(lives: Lives, day: float) -> Array:
    """Days of wear by which the pace's random walk has deviated up to a day, shape (m,)."""
    waves = wander_waves(np.append(lives.onset, day), day)
    deviation = lives.wander @ waves[:, -1] - np.sum(lives.wander * waves[:, :-1].T, axis=1)
    return np.asarray(np.where(lives.onset < day, deviation, 0.0))


def remaining_days(lives: Lives, remaining: float, day: float, wandered: Array) -> Array:
    """Days from a day on until x remains, at the pace of the past.

    Parameters
    ----------
    lives : Lives
        m of them.
    remaining : float
        x at the end of life.
    day : float
        Day of the epoch.
    wandered : ndarray, shape (m,)
        As :func:`wandered_days` returns it.

    Returns
    -------
    ndarray, shape (m,)
        Days; 0 where the end is past, infinite where it never comes.
    """
    with np.errstate(over="ignore"):
        worn = travel_until(remaining, lives.exponent, lives.load) / lives.rate - wandered
    worn = np.where(worn < _NEVER, np.maximum(worn, 0.0), math.inf)
    end = lives.onset + day_of(worn, lives.relaxing, lives.relaxation)
    return np.asarray(np.maximum(end - day, 0.0))


def _remaining_later(lives: Lives, day: float, later: Array, wandered: Array) -> Array:
    """Remaining part x of the approach of each life, at its own later day."""
    worn = worn_time(day + later - lives.onset, lives.relaxing, lives.relaxation) + wandered
    return remaining_after(lives.rate * np.maximum(worn, 0.0), lives.exponent, lives.load)
