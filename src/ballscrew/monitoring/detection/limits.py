"""Limits by simulation: healthy histories with this epoch's days, temperatures, told errors and baseline.

At every visit the limits are such that a healthy axis which has not alarmed so far alarms there with
probability 1 − exp(−rate Δt), shared evenly by the two statistics, and by the first run and a repeat. False
alarms then come at the stated rate whatever the spacing of the runs, from the first judged run on. A limit is
made of runs up to its own alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import FARTHEST, Design
from ballscrew.monitoring.detection.odds import odds
from ballscrew.monitoring.detection.ramp import ramp
from ballscrew.monitoring.detection.robust import Residuals, residuals
from ballscrew.monitoring.detection.settings import MonitorSettings

__all__ = ["BEGIN", "Limits", "Statistics", "far_off", "healthy", "limits", "statistics"]

BEGIN = 3
"""Good runs before the first that is judged."""

_YEAR = 365.25
_LONGEST = 14.0  # d: a longer pause spends no more false alarms
_PART = 5000  # histories that are simulated at a time
_TOP = 0.02  # of the histories: the tail that is fitted
_TOP_AGAIN = 0.1  # of those with a repeat
_FIRST = 0.5  # of what a visit may spend, at least, is for its first run; of repeats no more may alarm
_NAMES = ("ramp", "odds", "watch_ramp", "watch_odds")
_NEIGHBOURS = 15  # runs whose tails are pooled, at most
_ENOUGH = 2.0  # histories above a limit from which on it is a plain quantile
_SAFE = 0.7  # of the rate: limits from finitely many draws err towards too many alarms
_MOST_SHAPE = 0.9
_BENT = (-0.5, 0.5)  # of γ²: P exponential in the temperature, or a nut that warmth presses


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Of n visits, or of n runs; infinite before the first that is judged.

    Parameters
    ----------
    ramp, odds : ndarray, shape (n,)
        Of alarm.
    watch_ramp, watch_odds : ndarray, shape (n,)
        Of watch.
    spent : ndarray, shape (n,)
        Probability of a false alarm at each visit.
    repeat : ndarray, shape (n,)
        Of the odds: above it a repeat is asked for.
    again : Limits or None
        Of visits: after the repeat.
    """

    ramp: Array
    odds: Array
    watch_ramp: Array
    watch_odds: Array
    spent: Array
    repeat: Array
    again: Limits | None = None

    def of(self, visit: NDArray[np.int_], repeated: NDArray[np.bool_]) -> Limits:
        """Of runs: by the visit of each, and whether it is a repeat."""
        other = self.again or self
        names = [one.name for one in fields(self) if one.name != "again"]
        return Limits(
            **{n: np.where(repeated, getattr(other, n)[visit], getattr(self, n)[visit]) for n in names}
        )

    def alarms(self, found: Statistics) -> NDArray[np.bool_]:
        """Where histories alarm, before or after a repeat; shape (n, m)."""
        other = self.again or self
        first = (found.ramp_first > self.ramp[:, None]) | (found.odds_first > self.odds[:, None])
        last = (found.ramp > other.ramp[:, None]) | (found.odds > other.odds[:, None])
        return np.asarray(first | (found.repeated & last))


@dataclass(frozen=True, slots=True, eq=False)
class Statistics:
    """Of n visits in m histories; see the modules ``ramp``, ``odds`` and ``robust``.

    Parameters
    ----------
    ramp_first, odds_first : ndarray, shape (n, m)
        After the first run of each visit.
    ramp, odds : ndarray, shape (n, m)
        After its repeat; the same where there was none.
    repeated : ndarray of bool, shape (n, m)
        Where one was made.
    onset : ndarray of int, shape (n, m)
        Visit at which the ramp seems to begin.
    seen : Residuals
        Levels, odd runs drawn back, and scatter.
    """

    ramp_first: Array
    odds_first: Array
    ramp: Array
    odds: Array
    repeated: NDArray[np.bool_]
    onset: NDArray[np.int_]
    seen: Residuals


def statistics(
    of: Design,
    levels: Array,
    again: Array | None = None,
    asked: Callable[[int, Array], float] | None = None,
) -> Statistics:
    """Both statistics of histories.

    Parameters
    ----------
    of : Design
        The epoch, a row a visit.
    levels : ndarray, shape (n, m)
        Its levels in m histories.
    again : ndarray, shape (n, m), optional
        Levels of repeats; nan where there is none.
    asked : callable, optional
        See :func:`~ballscrew.monitoring.detection.odds.odds`: repeats count only where they are asked for, or
        where the first run is far off.

    Returns
    -------
    Statistics
        What comes later changes nothing.
    """
    far = None if again is None or asked is None else far_off(of, levels)
    worn = odds(of, levels, BEGIN, again, asked, far)
    made = None if again is None else np.where(worn.repeated, again, np.nan)
    seen = residuals(of, levels, made)
    grown, onset, early = ramp(of, seen.level, seen.scale, BEGIN, seen.first)
    return Statistics(early, worn.first, grown, worn.all, worn.repeated, onset, seen)


def far_off(of: Design, levels: Array) -> NDArray[np.bool_]:
    """Runs that stand too far up to count in full, as they are known before any repeat.

    Parameters
    ----------
    of : Design
        The epoch, a row a visit.
    levels : ndarray, shape (n, m)
        Its levels in m histories.

    Returns
    -------
    ndarray of bool, shape (n, m)
        They are to be repeated, however small the odds: far beyond what wear does these fall again.
    """
    return np.asarray(residuals(of, levels).first < levels)


def healthy(of: Design, draws: int, seed: Sequence[int]) -> tuple[Array, Array]:
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
    levels, again : ndarray, shape (n, draws)
        Of each visit and of a repeat of it; temperature coefficient, steps, scatter and odd runs as the
        settings believe. A repeat shares what the temperature does.
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
    again = np.empty_like(levels)
    for k in range(count):
        random = np.random.default_rng([*seed, 3, k])
        own = scale * of.told[k]
        odd = _odd(random, kept, draws)
        noise = np.where(odd, kept.odd_size, 1.0) * own * random.standard_normal(draws)
        levels[k] += np.hypot(of.loose[k], read[k]) * warm * random.standard_normal(draws)
        other = np.where(_odd(random, kept, draws), kept.odd_size, 1.0) * own * random.standard_normal(draws)
        stays = odd & (random.uniform(size=draws) < kept.odd_stays)
        again[k] = levels[k] + np.where(stays, noise, other)
        levels[k] += noise
    return levels, again


def _odd(random: np.random.Generator, kept: MonitorSettings, draws: int) -> NDArray[np.bool_]:
    return np.asarray(random.uniform(size=draws) < kept.odd)


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
    gaps = np.diff(of.days, prepend=of.days[:1])
    if count > BEGIN:
        gaps[BEGIN] = of.days[BEGIN] - of.days[0]
    gaps[:BEGIN] = 0.0
    rate = _SAFE * kept.false_alarms_per_year / _YEAR
    spent = -np.expm1(-rate * np.minimum(gaps, _LONGEST))
    share = -np.expm1(-kept.repeats_per_year / _YEAR * np.minimum(gaps, _LONGEST))
    repeat = np.full(count, np.inf)
    first, again = ({n: np.full(count, np.inf) for n in _NAMES} for _ in range(2))
    if count > BEGIN:
        before, after, made, repeat = _drawn(of, share)
        one, other = (_Tail(_TOP), _Tail(_TOP)), (_Tail(_TOP_AGAIN), _Tail(_TOP_AGAIN))
        alive = np.ones(kept.draws, dtype=bool)
        for k in range(BEGIN, count):
            part = 1.0 if share[k] == 0 else max(_FIRST, 1 - _FIRST * float(share[k] / spent[k]))
            _limit(first, k, one, before[:, k, alive], part * spent[k], kept.watch)
            alarmed = (before[0, k] > first["ramp"][k]) | (before[1, k] > first["odds"][k])
            repeated = made[k] & alive
            often = float(repeated[alive].mean())
            if often > 0:
                each = min((1 - part) * float(spent[k]) / often, _FIRST)
                _limit(again, k, other, after[:, k, repeated], each, kept.watch)
                alarmed |= made[k] & ((after[0, k] > again["ramp"][k]) | (after[1, k] > again["odds"][k]))
            alive &= ~alarmed
    one_run, two = (
        Limits(one["ramp"], one["odds"], one["watch_ramp"], one["watch_odds"], spent, repeat)
        for one in (first, again)
    )
    return replace(one_run, again=two)


def _limit(
    found: dict[str, Array], k: int, tails: tuple[_Tail, _Tail], pair: Array, spent: float, watch: float
) -> None:
    """Add the limits of a visit for what may be spent there, shared evenly by the two statistics."""
    for tail, values in zip(tails, pair, strict=True):
        tail.add(values)
    both = float(np.mean((pair[0] > tails[0].top) | (pair[1] > tails[1].top))) / tails[0].part
    each = spent / min(max(both, 1.0), 2.0)
    for name, tail in zip(("ramp", "odds"), tails, strict=True):
        found[name][k] = tail.limit(each)
        found[f"watch_{name}"][k] = min(tail.limit(min(each * watch, 0.5)), found[name][k])


def _drawn(of: Design, share: Array) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_], Array]:
    """Both statistics of all healthy histories before and after the repeats that were asked for.

    Which were made, and above what odds; a part at a time, since years of runs fill a memory.
    """
    edges = np.arange(0, of.settings.draws + _PART, _PART).clip(max=of.settings.draws)
    shape = len(of.days), of.settings.draws
    before, after = (np.empty((2, *shape), dtype=np.float32) for _ in range(2))
    made = np.empty(shape, dtype=bool)
    above = []
    for number, (start, stop) in enumerate(pairwise(np.unique(edges).tolist())):
        seed = of.settings.seed, 0xA1A3, number
        limit = np.full(len(of.days), np.inf)

        def asked(k: int, values: Array, limit: Array = limit) -> float:
            if share[k] > 0:
                limit[k] = np.quantile(values, 1 - share[k])
            return float(limit[k])

        levels, again = healthy(of, stop - start, seed)
        found = statistics(of, levels, again, asked) if share.any() else statistics(of, levels)
        before[:, :, start:stop] = found.ramp_first, found.odds_first
        after[:, :, start:stop] = found.ramp, found.odds
        made[:, start:stop] = found.repeated
        above.append(limit)
    return before, after, made, np.asarray(np.mean(above, axis=0))


class _Tail:
    """Upper tail of a statistic among the histories that have not alarmed, pooled over the newest runs.

    Above its top quantile the tail is a generalised Pareto distribution, its two numbers by probability
    weighted moments (Hosking and Wallis, 1987, DOI 10.1080/00401706.1987.10488243).
    """

    def __init__(self, part: float) -> None:
        self.part = part
        self.values = np.zeros(0)
        self.top, self.seen = 0.0, 0
        self.pooled: list[Array] = []

    def add(self, values: Array) -> None:
        """Take the next run."""
        self.values = values
        self.top = float(np.quantile(values, 1 - self.part))
        excess = (values[values > self.top] - self.top) / (1 + self.top)
        self.seen += 1
        newest = min(1 + self.seen // 3, _NEIGHBOURS)
        self.pooled = [*self.pooled, excess][-newest:]

    def limit(self, probability: float) -> float:
        """The value that is exceeded with a probability."""
        if probability <= 0:
            return math.inf
        if probability >= self.part:
            return float(np.quantile(self.values, 1 - probability))
        excess = np.sort(np.concatenate(self.pooled))
        if len(excess) < 2:
            return self.top
        rank = len(excess) * probability / self.part
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
        far = math.log(self.part / probability)
        return self.top + (1 + self.top) * size * (math.expm1(xi * far) / xi if abs(xi) > 1e-6 else far)
