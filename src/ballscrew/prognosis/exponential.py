"""Exponential degradation, P = P₀ e^(−λt), by a plain particle filter: a reference model.

As in tutorials of prognostics (An, Choi and Kim, *Prognostics 101: a tutorial for particle filter-based
prognostics algorithm using Matlab*, Reliab. Eng. Syst. Saf. 115, 2013, DOI 10.1016/j.ress.2013.02.019): the
loss of ln P and its rate are propagated from run to run, weighted by each run and resampled; the rates of the
particles remain distinct by a shrunken kernel (Liu and West, 2001, DOI 10.1007/978-1-4757-3437-9_10).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.resampling import systematic
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.forecast import FAN, Forecast, fan_days, reach_of
from ballscrew.prognosis.preload_history import PreloadHistory, preload_cube_root

_RATE, _RATE_SPREAD = 3e-3, 1.8  # 1/day, of ln P; standard deviation of its logarithm
_SHRINK = 0.99
_LEAST_NOISE = 0.3  # of the stated uncertainty


@dataclass(frozen=True, slots=True)
class ExponentialFilter:
    """Exponential degradation.

    Parameters
    ----------
    particles : int
        Number of particles.
    wander : float
        Standard deviation of the change of the rate's logarithm in a day.
    seed : int
        The same seed gives the same forecast.
    """

    particles: int = 2000
    wander: float = 0.02
    seed: int = 1

    def forecast(self, history: PreloadHistory, failure: Failure, *, at: float | None = None) -> Forecast:
        """Remaining life; parameters, result and errors as of every life model."""
        day = history.last_day if at is None else at
        random = np.random.default_rng(self.seed)
        t, value, spread, warmer = preload_cube_root(history.until(day))
        loss_of_log = -3 * np.log(np.maximum(value, 1e-3))
        stated = 3 * spread / value
        if np.ptp(warmer) > 0 and len(t) > 5:
            # The effect of temperature by least squares beside a parabola: this model has no temperature.
            design = np.column_stack([np.ones_like(t), t - t[0], (t - t[0]) ** 2, warmer])
            loss_of_log = loss_of_log - np.linalg.lstsq(design, loss_of_log, rcond=None)[0][3] * warmer
        noise = stated * max(_LEAST_NOISE, _scatter(loss_of_log / stated))
        loss, log_rate = self._filter(t, loss_of_log, noise, random)
        loss = loss + np.exp(log_rate) * (day - float(t[-1]))
        ratio_at_end = max(failure.remaining(history.approach), 0.0) ** 1.5
        end = math.inf
        if ratio_at_end > 0:
            end = -math.log(ratio_at_end)
        lives = np.maximum(end - loss, 0.0) / np.exp(log_rate)
        reach = reach_of(day - float(history.days[0]))
        lives = np.sort(np.where(lives > reach, np.inf, lives))
        days = fan_days(lives, reach)
        ratio = np.exp(-loss - np.exp(log_rate) * days[:, None])
        mode, text = failure.mode(history.approach)
        fan = np.quantile(ratio, FAN, axis=1).T
        return Forecast(day, lives, reach, mode, text, days, fan, "exponential degradation, particle filter")

    def _filter(
        self, t: Array, measured: Array, noise: Array, random: np.random.Generator
    ) -> tuple[Array, Array]:
        """Particles of the loss of ln P on the last day, and of the logarithm of its rate."""
        count = self.particles
        loss = noise[0] * random.standard_normal(count)
        log_rate = math.log(_RATE) + _RATE_SPREAD * random.standard_normal(count)
        weight = np.full(count, 1 / count)
        before = t[0]
        for day, value, spread in zip(t.tolist(), measured.tolist(), noise.tolist(), strict=True):
            gap = day - before
            log_rate = log_rate + self.wander * math.sqrt(gap) * random.standard_normal(count)
            loss = loss + np.exp(log_rate) * gap
            log_weight = np.log(weight + 1e-300) - 2.5 * np.log1p(((value - loss) / spread) ** 2 / 4)
            weight = np.exp(log_weight - log_weight.max())
            weight = weight / weight.sum()
            before = day
            if 1 / (weight**2).sum() < count / 2:
                parents = systematic(weight, random.uniform())
                loss = _kernel(loss[parents], random)
                log_rate = _kernel(log_rate[parents], random)
                weight = np.full(count, 1 / count)
        parents = systematic(weight, 0.5)
        return loss[parents], log_rate[parents]


def _kernel(values: Array, random: np.random.Generator) -> Array:
    """Values shrunken towards their mean, plus noise that restores their variance."""
    width = math.sqrt(1 - _SHRINK**2) * float(np.std(values))
    mean = float(np.mean(values))
    return np.asarray(_SHRINK * values + (1 - _SHRINK) * mean + width * random.standard_normal(len(values)))


def _scatter(standardised: Array) -> float:
    """Scatter from run to run by second differences: independent of the trend, and robust."""
    second = standardised[2:] - 2 * standardised[1:-1] + standardised[:-2]
    if len(second) <= 2:
        return 1.0
    return float(np.median(np.abs(second))) / 0.6745 / math.sqrt(6)
