"""The other reference: exponential degradation, P = P₀ e^(−λt), with a plain particle filter.

As in tutorials of prognostics (An, Choi and Kim, *Prognostics 101: a tutorial for particle filter-based
prognostics algorithm using Matlab*, Reliab. Eng. Syst. Saf. 115, 2013, DOI 10.1016/j.ress.2013.02.019): a
loss of ln P and its rate are carried on from run to run, weighed by each run and resampled; rates are kept
apart by a shrunken kernel (Liu and West, 2001, DOI 10.1007/978-1-4757-3437-9_10).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.resampling import systematic
from ballscrew.prognosis.course import Course
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.forecast import FAN, Forecast, ahead, reach_of
from ballscrew.prognosis.seen_ratio import cube_root

__all__ = ["ExponentialFilter"]

_RATE, _RATE_SPREAD = 3e-3, 1.8  # 1/day: of ln P; of its logarithm
_SHRINK = 0.99
_LEAST_NOISE = 0.3  # of what is told


@dataclass(frozen=True, slots=True)
class ExponentialFilter:
    """Exponential degradation.

    Parameters
    ----------
    particles : int
        How many.
    wander : float
        By which the logarithm of the rate changes in a day, standard deviation.
    seed : int
        The same seed gives the same forecast.
    """

    particles: int = 2000
    wander: float = 0.02
    seed: int = 1

    def forecast(self, course: Course, failure: Failure, *, at: float | None = None) -> Forecast:
        """The remaining life; parameters, result and errors as of every life model."""
        day = float(course.days[-1]) if at is None and len(course) else float(at or 0.0)
        random = np.random.default_rng(self.seed)
        t, value, spread, warmer = cube_root(course.until(day))
        seen = -3 * np.log(np.maximum(value, 1e-3))
        told = 3 * spread / value
        if np.ptp(warmer) > 0 and len(t) > 5:
            # A kelvin's share by least squares beside a parabola: this model knows no temperature.
            design = np.column_stack([np.ones_like(t), t - t[0], (t - t[0]) ** 2, warmer])
            seen = seen - np.linalg.lstsq(design, seen, rcond=None)[0][3] * warmer
        noise = told * max(_LEAST_NOISE, _scatter(seen / told))
        loss, log_rate = self._followed(t, seen, noise, random)
        loss = loss + np.exp(log_rate) * (day - float(t[-1]))
        ratio_end = max(failure.left(course.pressed), 0.0) ** 1.5
        end = -math.log(ratio_end) if ratio_end > 0 else math.inf
        lives = np.maximum(end - loss, 0.0) / np.exp(log_rate)
        reach = reach_of(day - float(course.days[0]))
        lives = np.sort(np.where(lives > reach, np.inf, lives))
        days = ahead(lives, reach)
        ratio = np.exp(-loss - np.exp(log_rate) * days[:, None])
        mode, text = failure.mode(course.pressed)
        fan = np.quantile(ratio, FAN, axis=1).T
        return Forecast(day, lives, reach, mode, text, days, fan, "exponential degradation, particle filter")

    def _followed(
        self, t: Array, seen: Array, noise: Array, random: np.random.Generator
    ) -> tuple[Array, Array]:
        """Loss of ln P on the last day, and the logarithm of its rate."""
        count = self.particles
        loss = noise[0] * random.standard_normal(count)
        log_rate = math.log(_RATE) + _RATE_SPREAD * random.standard_normal(count)
        weight = np.full(count, 1 / count)
        before = t[0]
        for day, value, spread in zip(t.tolist(), seen.tolist(), noise.tolist(), strict=True):
            gone = day - before
            log_rate = log_rate + self.wander * math.sqrt(gone) * random.standard_normal(count)
            loss = loss + np.exp(log_rate) * gone
            log_weight = np.log(weight + 1e-300) - 2.5 * np.log1p(((value - loss) / spread) ** 2 / 4)
            weight = np.exp(log_weight - log_weight.max())
            weight = weight / weight.sum()
            before = day
            if 1 / (weight**2).sum() < count / 2:
                kept = systematic(weight, random.uniform())
                loss = _kernel(loss[kept], random)
                log_rate = _kernel(log_rate[kept], random)
                weight = np.full(count, 1 / count)
        kept = systematic(weight, 0.5)
        return loss[kept], log_rate[kept]


def _kernel(values: Array, random: np.random.Generator) -> Array:
    """Shrunken towards the mean, and as wide as before."""
    wide = math.sqrt(1 - _SHRINK**2) * float(np.std(values))
    mean = float(np.mean(values))
    return np.asarray(_SHRINK * values + (1 - _SHRINK) * mean + wide * random.standard_normal(len(values)))


def _scatter(standardised: Array) -> float:
    """Scatter from run to run, of second differences: no course is in it, and no odd run."""
    second = standardised[2:] - 2 * standardised[1:-1] + standardised[:-2]
    return float(np.median(np.abs(second))) / 0.6745 / math.sqrt(6) if len(second) > 2 else 1.0
