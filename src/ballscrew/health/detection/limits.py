"""Limits by simulation: healthy histories with this epoch's days, temperatures, told errors and baseline.

At every run the pair of limits is such that a healthy axis which has not alarmed so far alarms there with
probability 1 − exp(−rate Δt), shared evenly by the two statistics. False alarms then come at the stated rate
whatever the spacing of the runs, from the first judged run on. A limit is made of runs up to its own alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballscrew.health.detection.design import FARTHEST, Design
from ballscrew.health.detection.odds import odds
from ballscrew.health.detection.ramp import ramp
from ballscrew.health.detection.robust import residuals

__all__ = ["BEGIN", "Limits", "healthy", "limits", "statistics"]

Array = NDArray[np.float64]
BEGIN = 3
"""Good runs before the first that is judged."""

_YEAR = 365.25
_LONGEST = 14.0  # d: a longer pause spends no more false alarms
_PART = 5000  # histories that are simulated at a time
_TOP = 0.02  # of the histories: the tail that is fitted
_NEIGHBOURS = 15  # runs whose tails are pooled, at most
_ENOUGH = 2.0  # histories above a limit from which on it is a plain quantile
_SAFE = 0.8  # of the rate: limits from finitely many draws err towards too many alarms
_MOST_SHAPE = 0.9
_BENT = (-0.5, 0.5)  # of γ²: P exponential in the temperature, or a nut that warmth presses


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Of n runs; infinite before the first that is judged.

    Parameters
    ----------
    ramp, odds : ndarray, shape (n,)
        Of alarm.
    watch_ramp, watch_odds : ndarray, shape (n,)
        Of watch.
    spent : ndarray, shape (n,)
        Probability of a false alarm at each run.
    """

    ramp: Array
    odds: Array
    watch_ramp: Array
    watch_odds: Array
    spent: Array


def statistics(of: Design, levels: Array) -> tuple[Array, Array, Array]:
    """Both statistics of histories.

    Parameters
    ----------
    of : Design
        The epoch.
    levels : ndarray, shape (n, m)
        Its levels in m histories.

    Returns
    -------
    ramp, odds, scale : ndarray, shape (n, m)
        See the modules of these names, and ``robust`` beside them.
    """
    seen = residuals(of, levels)
    return ramp(of, seen.level, seen.scale, BEGIN)[0], odds(of, levels, BEGIN), seen.scale


def healthy(of: Design, draws: int, seed: Sequence[int]) -> Array:
    """Draw histories in which nothing wears.

    Parameters
    ----------
    of : Design
        The epoch.
    draws : int
        How many.
    seed : sequence of int
        Decides them. Every coefficient and every run has a stream of its own, so that a run more, with the
        first temperature or the first after a step, leaves those before as they were.

    Returns
    -------
    ndarray, shape (n, draws)
        Levels; temperature coefficient, steps, scatter and odd runs as the settings believe.
    """
    kept, count = of.settings, len(of.days)
    random = np.random.default_rng([*seed, 0])
    scale = kept.scale * np.sqrt(kept.scale_degrees / random.chisquare(kept.scale_degrees, draws))
    drawn = np.zeros((len(of.sizes), draws))
    if of.warm:
        random = np.random.default_rng([*seed, 1])
        drawn[1] = of.sizes[1] * random.standard_normal(draws)
        drawn[2] = random.uniform(*_BENT, draws) * drawn[1] ** 2
    for number, column in enumerate(range(len(of.sizes) - len(of.begun), len(of.sizes))):
        step = np.random.default_rng([*seed, 2, number]).standard_normal(draws)
        drawn[column] = of.sizes[column] * np.clip(step, -FARTHEST, FARTHEST)
    levels = of.columns @ drawn
    # What a wrong temperature does grows with what the temperature does.
    warm = np.abs(drawn[1]) / of.sizes[1] if of.warm else np.zeros(draws)
    # The runs' own scatter tells it; a run without a temperature has none that could be wrong.
    read = np.where(of.known, of.sizes[1] * kept.thermometer, 0.0) if of.warm else np.zeros(count)
    for k in range(count):
        random = np.random.default_rng([*seed, 3, k])
        odd = np.where(random.uniform(size=draws) < kept.odd, kept.odd_size, 1.0)
        levels[k] += scale * of.told[k] * odd * random.standard_normal(draws)
        levels[k] += np.hypot(of.loose[k], read[k]) * warm * random.standard_normal(draws)
    return np.asarray(levels)


def limits(of: Design) -> Limits:
    """Compute the limits of every run.

    Parameters
    ----------
    of : Design
        The epoch.

    Returns
    -------
    Limits
        The same for the same epoch.
    """
    kept, count = of.settings, len(of.days)
    found = {name: np.full(count, np.inf) for name in ("ramp", "odds", "watch_ramp", "watch_odds")}
    gaps = np.diff(of.days, prepend=of.days[:1])
    if count > BEGIN:
        gaps[BEGIN] = of.days[BEGIN] - of.days[0]
    gaps[:BEGIN] = 0.0
    rate = _SAFE * kept.false_alarms_per_year / _YEAR
    spent = -np.expm1(-rate * np.minimum(gaps, _LONGEST))
    if count > BEGIN:
        first, second = _drawn(of)
        tails = _Tail(), _Tail()
        alive = np.ones(kept.draws, dtype=bool)
        for k in range(BEGIN, count):
            pair = first[k, alive], second[k, alive]
            for tail, values in zip(tails, pair, strict=True):
                tail.add(values)
            both = float(np.mean((pair[0] > tails[0].top) | (pair[1] > tails[1].top))) / _TOP
            each = spent[k] / min(max(both, 1.0), 2.0)
            found["ramp"][k], found["odds"][k] = (tail.limit(each) for tail in tails)
            more = min(each * kept.watch, 0.5)
            for name, tail in zip(("ramp", "odds"), tails, strict=True):
                found[f"watch_{name}"][k] = min(tail.limit(more), found[name][k])
            alive &= (first[k] <= found["ramp"][k]) & (second[k] <= found["odds"][k])
    return Limits(**found, spent=spent)


def _drawn(of: Design) -> tuple[Array, Array]:
    """Both statistics of all healthy histories; a part at a time, since years of runs fill a memory."""
    edges = np.arange(0, of.settings.draws + _PART, _PART).clip(max=of.settings.draws)
    found = np.empty((2, len(of.days), of.settings.draws), dtype=np.float32)
    for number, (start, stop) in enumerate(pairwise(np.unique(edges).tolist())):
        seed = of.settings.seed, 0xA1A3, number
        found[:, :, start:stop] = statistics(of, healthy(of, stop - start, seed))[:2]
    return found[0], found[1]


class _Tail:
    """Upper tail of a statistic among the histories that have not alarmed, pooled over the newest runs.

    Above its top quantile the tail is a generalised Pareto distribution, its two numbers by probability
    weighted moments (Hosking and Wallis, 1987, DOI 10.1080/00401706.1987.10488243).
    """

    def __init__(self) -> None:
        self.values = np.zeros(0)
        self.top, self.seen = 0.0, 0
        self.pooled: list[Array] = []

    def add(self, values: Array) -> None:
        """Take the next run."""
        self.values = values
        self.top = float(np.quantile(values, 1 - _TOP))
        excess = (values[values > self.top] - self.top) / (1 + self.top)
        self.seen += 1
        newest = min(1 + self.seen // 3, _NEIGHBOURS)
        self.pooled = [*self.pooled, excess][-newest:]

    def limit(self, probability: float) -> float:
        """The value that is exceeded with a probability."""
        if probability <= 0:
            return math.inf
        if probability >= _TOP:
            return float(np.quantile(self.values, 1 - probability))
        excess = np.sort(np.concatenate(self.pooled))
        if len(excess) < 2:
            return self.top
        rank = len(excess) * probability / _TOP
        if rank >= _ENOUGH:
            middle = np.interp(
                len(excess) - rank, np.arange(len(excess)), excess
            )  # is exceeded by so many + 1
            return self.top + (1 + self.top) * float(middle)
        mean = float(excess.mean())
        part = (np.arange(1, len(excess) + 1) - 0.35) / len(excess)
        lower = float(np.mean((1 - part) * excess))
        shape = 2 - mean / max(mean - 2 * lower, 1e-12)  # ξ is its negative
        xi = min(max(-shape, -0.5), _MOST_SHAPE)
        size = mean * (1 - xi)
        far = math.log(_TOP / probability)
        return self.top + (1 + self.top) * size * (math.expm1(xi * far) / xi if abs(xi) > 1e-6 else far)
