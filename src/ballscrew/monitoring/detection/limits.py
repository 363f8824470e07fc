"""Control limits by simulation: healthy histories with the days, temperatures and uncertainties of an epoch.

At every visit the limits are such that a healthy axis without an alarm so far alarms there with probability
1 − exp(−rate Δt), shared evenly by the two statistics, and by the first run and a repeat. False alarms then
occur at the stated rate whatever the spacing of the runs, from the first run with a statistic on. A limit
depends on the runs up to its own alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import LARGEST_STEP, Design
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.detection.statistics import BEGIN, Statistics, statistics

Floats = NDArray[np.floating[Any]]
_YEAR = 365.25
_LONGEST_GAP = 14.0  # d: a longer pause spends no more false alarms
_BATCH = 5000  # histories that are simulated at a time
_TAIL = 0.02  # of the histories: the tail that is fitted
_REPEAT_TAIL = 0.1  # of those with a repeat
_FIRST_SHARE = (
    0.5  # least share of the first run in a visit's false alarms; largest part of repeats that alarm
)
_POOLED_RUNS = 15  # runs whose tails are pooled, at most
_EMPIRICAL = 2.0  # histories above a limit from which on it is an empirical quantile
_SAFETY = 0.7  # of the rate: limits from finitely many histories err towards too many alarms
_LEAST_SHAPE, _LARGEST_SHAPE = -0.5, 0.9  # ξ of the tail
_ARRAYS = ("ramp", "odds", "watch_ramp", "watch_odds", "spent", "repeat")
_CURVATURE = (-0.5, 0.5)  # of γ²: P exponential in the temperature, or temperature preloads the nut


@dataclass(frozen=True, slots=True, eq=False)
class ControlLimits:
    """Limits of n visits, or of n runs; infinite before the first with a statistic.

    Parameters
    ----------
    ramp, odds : ndarray, shape (n,)
        Limits of an alarm.
    watch_ramp, watch_odds : ndarray, shape (n,)
        Limits of a watch.
    spent : ndarray, shape (n,)
        Probability of a false alarm at each visit.
    repeat : ndarray, shape (n,)
        Odds above which a repeat is requested.
    again : ControlLimits or None
        Limits of the visits after their repeats; None for limits of runs.
    """

    ramp: Array
    odds: Array
    watch_ramp: Array
    watch_odds: Array
    spent: Array
    repeat: Array
    again: ControlLimits | None = None

    def of_runs(self, visit: NDArray[np.int_], repeated: NDArray[np.bool_]) -> ControlLimits:
        """Limits of runs, given the visit of each and which of them are repeats."""
        after = self.again or self
        columns = {
            name: np.where(repeated, getattr(after, name)[visit], getattr(self, name)[visit])
            for name in _ARRAYS
        }
        return ControlLimits(**columns)

    def alarms(self, values: Statistics) -> NDArray[np.bool_]:
        """Visits at which histories alarm, before or after a repeat; shape (n, m)."""
        after = self.again or self
        first = (values.ramp_first > self.ramp[:, None]) | (values.odds_first > self.odds[:, None])
        last = (values.ramp > after.ramp[:, None]) | (values.odds > after.odds[:, None])
        return np.asarray(first | (values.repeated & last))


def simulate_healthy(design: Design, draws: int, seed: Sequence[int]) -> tuple[Array, Array]:
    """Simulate histories without wear.

    Parameters
    ----------
    design : Design
        The epoch.
    draws : int
        Number of histories.
    seed : sequence of int
        Every coefficient and every run has a stream of its own, so that one more run, also the first with a
        temperature or the first after a step, leaves those before unchanged.

    Returns
    -------
    levels, again : ndarray, shape (n, draws)
        Levels of each visit and of a repeat of it, with temperature coefficient, steps, scatter and outliers
        as in the settings. A repeat has the same effect of the temperature.
    """
    settings, count = design.settings, len(design.days)
    random = np.random.default_rng([*seed, 0])
    degrees = settings.scale_degrees
    scale = settings.scale * np.sqrt(degrees / random.chisquare(degrees, draws))
    samples = np.zeros((len(design.sizes), draws))
    # The effect of a wrong temperature is proportional to that of the temperature. The scatter of the runs
    # shows it; a run without a temperature has none that could be wrong.
    effect, thermometer = np.zeros(draws), np.zeros(count)
    if design.has_temperature:
        random = np.random.default_rng([*seed, 1])
        samples[1] = design.sizes[1] * random.standard_normal(draws)
        samples[2] = random.uniform(*_CURVATURE, draws) * samples[1] ** 2
        effect = np.abs(samples[1]) / design.sizes[1]
        thermometer = np.where(design.temperature_known, design.sizes[1] * settings.thermometer, 0.0)
    for column in range(3 if design.has_temperature else 1, len(design.sizes) - len(design.step_starts)):
        random = np.random.default_rng([*seed, 4])
        samples[column] = design.sizes[column] * random.standard_normal(draws)
    for number, column in enumerate(range(len(design.sizes))[design.step_columns]):
        step = np.random.default_rng([*seed, 2, number]).standard_normal(draws)
        samples[column] = design.sizes[column] * np.clip(step, -LARGEST_STEP, LARGEST_STEP)
    levels = design.columns @ samples
    again = np.empty_like(levels)
    for k in range(count):
        random = np.random.default_rng([*seed, 3, k])
        own = scale * design.uncertainty[k]
        outlier = random.uniform(size=draws) < settings.odd
        noise = _scaled(own, outlier, settings) * random.standard_normal(draws)
        temperature = np.hypot(design.unknown_temperature[k], thermometer[k]) * effect
        levels[k] += temperature * random.standard_normal(draws)
        repeat_outlier = random.uniform(size=draws) < settings.odd
        repeat_noise = _scaled(own, repeat_outlier, settings) * random.standard_normal(draws)
        persists = outlier & (random.uniform(size=draws) < settings.odd_stays)
        again[k] = levels[k] + np.where(persists, noise, repeat_noise)
        levels[k] += noise
    return levels, again


def _scaled(own: Array, outlier: NDArray[np.bool_], settings: MonitorSettings) -> Array:
    """Standard deviation of runs that may be outliers."""
    return np.where(outlier, settings.odd_size, 1.0) * own


def compute_limits(design: Design) -> ControlLimits:
    """Limits of every visit of an epoch.

    Parameters
    ----------
    design : Design
        The epoch.

    Returns
    -------
    ControlLimits
        Limits before and after a repeat; the same epoch always has the same.
    """
    settings, count = design.settings, len(design.days)
    gaps = np.diff(design.days, prepend=design.days[:1])
    if count > BEGIN:
        gaps[BEGIN] = design.days[BEGIN] - design.days[0]
    gaps[:BEGIN] = 0.0
    gaps = np.minimum(gaps, _LONGEST_GAP)
    spent = -np.expm1(-_SAFETY * settings.false_alarms_per_year / _YEAR * gaps)
    repeats = -np.expm1(-settings.repeats_per_year / _YEAR * gaps)
    first, again = _unlimited(spent), _unlimited(spent)
    if count <= BEGIN:
        return replace(first, again=again)
    simulated = _simulate(design, repeats)
    first.repeat[:] = again.repeat[:] = simulated.threshold
    first_tails, repeat_tails = (_Tail(_TAIL), _Tail(_TAIL)), (_Tail(_REPEAT_TAIL), _Tail(_REPEAT_TAIL))
    alive = np.ones(settings.draws, dtype=bool)
    for k in range(BEGIN, count):
        # The first run of a visit spends its share of the false alarms, the repeat the rest.
        share = 1.0
        if repeats[k] > 0:
            share = max(_FIRST_SHARE, 1 - _FIRST_SHARE * float(repeats[k] / spent[k]))
        before, after = simulated.before[:, k], simulated.after[:, k]
        _set_limits(first, k, first_tails, before[:, alive], share * spent[k], settings.watch)
        alarmed = (before[0] > first.ramp[k]) | (before[1] > first.odds[k])
        repeated = simulated.repeated[k] & alive
        part_repeated = float(repeated[alive].mean())
        if part_repeated > 0:
            of_repeat = min((1 - share) * float(spent[k]) / part_repeated, _FIRST_SHARE)
            _set_limits(again, k, repeat_tails, after[:, repeated], of_repeat, settings.watch)
            alarmed_again = (after[0] > again.ramp[k]) | (after[1] > again.odds[k])
            alarmed |= simulated.repeated[k] & alarmed_again
        alive &= ~alarmed
    return replace(first, again=again)


def _unlimited(spent: Array) -> ControlLimits:
    ramp, odds, watch_ramp, watch_odds, repeat = np.full((5, len(spent)), np.inf)
    return ControlLimits(ramp, odds, watch_ramp, watch_odds, spent, repeat)


def _set_limits(
    limits: ControlLimits, k: int, tails: tuple[_Tail, _Tail], values: Floats, spent: float, watch: float
) -> None:
    """Set the limits of a visit; both statistics share the probability of a false alarm evenly."""
    ramp, odds = tails
    ramp.add(values[0])
    odds.add(values[1])
    either = float(np.mean((values[0] > ramp.top) | (values[1] > odds.top))) / ramp.part
    each = spent / min(max(either, 1.0), 2.0)
    limits.ramp[k], limits.odds[k] = ramp.limit(each), odds.limit(each)
    watched = min(each * watch, 0.5)
    limits.watch_ramp[k] = min(ramp.limit(watched), limits.ramp[k])
    limits.watch_odds[k] = min(odds.limit(watched), limits.odds[k])


@dataclass(frozen=True, slots=True, eq=False)
class _Simulated:
    """Ramp and odds of all healthy histories before and after repeats, (2, n, m); where one was made."""

    before: NDArray[np.float32]
    after: NDArray[np.float32]
    repeated: NDArray[np.bool_]
    threshold: Array


def _simulate(design: Design, repeats: Array) -> _Simulated:
    """Simulate healthy histories in batches, since years of runs fill the memory.

    A repeat is made where the odds exceed their quantile for the requested probability of repeats.
    """
    count, draws = len(design.days), design.settings.draws
    before, after = np.empty((2, 2, count, draws), dtype=np.float32)
    repeated = np.empty((count, draws), dtype=bool)
    thresholds = []
    for number, start in enumerate(range(0, draws, _BATCH)):
        stop = min(start + _BATCH, draws)
        threshold = np.full(count, np.inf)

        def exceeded(k: int, odds: Array, threshold: Array = threshold) -> float:
            if repeats[k] > 0:
                threshold[k] = np.quantile(odds, 1 - repeats[k])
            return float(threshold[k])

        levels, again = simulate_healthy(design, stop - start, (design.settings.seed, 0xA1A3, number))
        values = statistics(design, levels, again, exceeded) if repeats.any() else statistics(design, levels)
        before[:, :, start:stop] = values.ramp_first, values.odds_first
        after[:, :, start:stop] = values.ramp, values.odds
        repeated[:, start:stop] = values.repeated
        thresholds.append(threshold)
    return _Simulated(before, after, repeated, np.asarray(np.mean(thresholds, axis=0)))


@dataclass(slots=True, eq=False)
class _Tail:
    """Upper tail of a statistic among the histories without an alarm, pooled over the newest runs.

    Above its top quantile the tail is a generalised Pareto distribution, its two parameters by probability
    weighted moments (Hosking and Wallis, 1987, DOI 10.1080/00401706.1987.10488243).
    """

    part: float
    values: Floats = field(default_factory=lambda: np.zeros(0))
    top: float = 0.0
    runs: int = 0
    pooled: list[Floats] = field(default_factory=list)

    def add(self, values: Floats) -> None:
        """Add the values of the next run."""
        self.values = values
        self.top = float(np.quantile(values, 1 - self.part))
        excess = (values[values > self.top] - self.top) / (1 + self.top)
        self.runs += 1
        newest = min(1 + self.runs // 3, _POOLED_RUNS)
        self.pooled = [*self.pooled, excess][-newest:]

    def limit(self, probability: float) -> float:
        """Value that is exceeded with a probability."""
        if probability <= 0:
            return math.inf
        if probability >= self.part:
            return float(np.quantile(self.values, 1 - probability))
        excess = np.sort(np.concatenate(self.pooled))
        if len(excess) < 2:
            return self.top
        rank = len(excess) * probability / self.part
        if rank >= _EMPIRICAL:
            # Exceeded by the rank plus one.
            quantile = float(np.interp(len(excess) - rank, np.arange(len(excess)), excess))
        else:
            quantile = _pareto_quantile(excess, math.log(self.part / probability))
        return self.top + (1 + self.top) * quantile


def _pareto_quantile(excess: Floats, log_ratio: float) -> float:
    """Quantile of a generalised Pareto distribution; ``log_ratio`` is −ln of the probability to exceed it."""
    mean = float(excess.mean())
    part = (np.arange(1, len(excess) + 1) - 0.35) / len(excess)
    lower = float(np.mean((1 - part) * excess))
    shape = mean / max(mean - 2 * lower, 1e-12) - 2
    shape = min(max(shape, _LEAST_SHAPE), _LARGEST_SHAPE)
    size = mean * (1 - shape)
    if abs(shape) > 1e-6:
        return size * math.expm1(shape * log_ratio) / shape
    return size * log_ratio
