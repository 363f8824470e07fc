"""Odds that wear began at one of the newest runs, against no wear.

The statistic of Shiryaev and Roberts (Roberts, 1966, DOI 10.1080/00401706.1966.10490374). For every onset,
rate of wear and size of the scatter, the likelihood ratio against a healthy axis is updated from run to run;
the statistic is log(1 + the sum of these over onsets and their mean over rates), averaged over scatters by
the likelihood of each. Level, temperature and steps are estimated by a Kalman filter whose gain is the
same in all histories. A run is an outlier as often as the settings state, and rarely anything at all. The
single run with the largest likelihood ratio counts at most ``_RUN_CAP``: one outlier is no wear.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import Design
from ballscrew.monitoring.detection.kernels import (
    accumulate_ratio,
    innovation,
    mean_or_lower,
    pair_density,
    pair_mixture,
    run_density,
    run_mixture,
    update_coefficients,
)

Single = NDArray[np.float32]
Real = TypeVar("Real", np.float32, np.float64)
_RATES = np.array([1 / 350, 1 / 160, 1 / 90])  # of the level per day: lives in days under contact pressure
_ONSETS = 5  # newest runs before which wear may have begun; the ramp covers earlier ones
_SCALES = np.exp(np.linspace(-1.2, 1.0, 6))  # of the scatter, over that of the settings
_SCALE_SPREAD = 0.6  # of ln: axes differ by more than the runs of one axis leave open
_RUN_CAP = np.float32(np.exp(4.0))  # largest likelihood ratio of a single run
_REPEAT_CAP = np.float32(np.exp(4.0))  # the same factor of its repeat
_LARGEST_RATIO = np.float32(1e20)
_CAPS = np.array([_RUN_CAP, _REPEAT_CAP, _LARGEST_RATIO])
_BOUND = 3.0  # standard deviations of an innovation that updates the coefficients
_LEVEL = 0.3  # prior standard deviation of the level
_THERMOMETER = 0.5  # of the squared effect of a wrong temperature on a typical axis
_LARGEST_LEVEL = 1e12  # its square is still a number
_EMPTY: Single = np.empty(0, np.float32)
_HEALTHY: Single = np.zeros(1, np.float32)  # wear of a healthy axis


@dataclass(frozen=True, slots=True, eq=False)
class Odds:
    """Log odds of wear of n visits in m histories.

    Parameters
    ----------
    first : ndarray, shape (n, m)
        After the first run of each visit.
    all : ndarray, shape (n, m)
        After its repeat too; the same where there was none.
    repeated : ndarray of bool, shape (n, m)
        Where there is a repeat.
    """

    first: Array
    all: Array
    repeated: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class _Coefficients:
    """Coefficients of m histories at r rates: mean (p, r, m), and covariance (p, p), common to all."""

    mean: Single
    covariance: Array

    def part(self, which: NDArray[np.int_]) -> _Coefficients:
        return _Coefficients(np.ascontiguousarray(self.mean[:, :, which]), self.covariance)

    def put(self, which: NDArray[np.int_], other: _Coefficients) -> _Coefficients:
        return _Coefficients(_put(self.mean, which, other.mean), self.covariance)


@dataclass(frozen=True, slots=True)
class _Onset:
    """Wear since a day: coefficients, likelihood ratio so far, and largest factor of a single run, (r, m)."""

    coefficients: _Coefficients
    ratio: Single
    largest: Single
    day: float
    weight: float

    def part(self, which: NDArray[np.int_]) -> _Onset:
        return replace(
            self,
            coefficients=self.coefficients.part(which),
            ratio=self.ratio[:, which],
            largest=self.largest[:, which],
        )

    def put(self, which: NDArray[np.int_], other: _Onset) -> _Onset:
        return replace(
            self,
            coefficients=self.coefficients.put(which, other.coefficients),
            ratio=_put(self.ratio, which, other.ratio),
            largest=_put(self.largest, which, other.largest),
        )


@dataclass(frozen=True, slots=True)
class _Visit:
    """Level of a visit, and that of its repeat, each (m,); empty where there is none."""

    level: Single
    repeat: Single


@dataclass(frozen=True, slots=True)
class _Scale:
    """One size of the scatter: coefficients without wear, and with wear since each onset."""

    healthy: _Coefficients
    onsets: tuple[_Onset, ...] = ()

    def part(self, which: NDArray[np.int_]) -> _Scale:
        onsets = [onset.part(which) for onset in self.onsets]
        return _Scale(self.healthy.part(which), tuple(onsets))

    def put(self, which: NDArray[np.int_], other: _Scale) -> _Scale:
        onsets = [onset.put(which, new) for onset, new in zip(self.onsets, other.onsets, strict=True)]
        return _Scale(self.healthy.put(which, other.healthy), tuple(onsets))


@dataclass(frozen=True, slots=True)
class _Filter:
    """State of m histories: every scale, and the logarithm of its likelihood, (scales, m)."""

    scales: tuple[_Scale, ...]
    log_likelihood: Array

    def part(self, which: NDArray[np.int_]) -> _Filter:
        """Select histories."""
        scales = [scale.part(which) for scale in self.scales]
        return _Filter(tuple(scales), self.log_likelihood[:, which])

    def put(self, which: NDArray[np.int_], other: _Filter) -> _Filter:
        """Replace histories by those of another state."""
        scales = [scale.put(which, new) for scale, new in zip(self.scales, other.scales, strict=True)]
        return _Filter(tuple(scales), _put(self.log_likelihood, which, other.log_likelihood))


def odds(
    design: Design,
    levels: Array,
    begin: int,
    again: Array | None = None,
    threshold: Callable[[int, Array], float] | None = None,
    besides: NDArray[np.bool_] | None = None,
) -> Odds:
    """Log odds at each visit of wear that began lately.

    Parameters
    ----------
    design : Design
        The epoch, a row per visit.
    levels : ndarray, shape (n, m)
        Of m histories, as measured; finite.
    begin : int
        First visit with a statistic, 1 or more.
    again : ndarray, shape (n, m), optional
        Levels of the repeats; nan where there is none.
    threshold : callable, optional
        From a visit's number and the odds after its first run: odds above which a repeat is used. By default
        every repeat is used.
    besides : ndarray of bool, shape (n, m), optional
        Where a repeat is used whatever the odds.

    Returns
    -------
    Odds
        0 or more; 0 before ``begin``. Later runs do not change them.
    """
    count, draws = levels.shape
    measured = np.clip(levels, -_LARGEST_LEVEL, _LARGEST_LEVEL).astype(np.float32)
    noise = _noise(design)
    state = _initial(design, draws)
    first, after = np.zeros((2, count, draws))
    repeated = np.zeros((count, draws), dtype=bool)
    for k in range(count):
        visit = _Visit(measured[k], _EMPTY)
        if k >= begin:
            state = _with_new_onset(design, k, state)
        before = state
        state, after[k] = _update(design, k, before, visit, noise[:, k], begin)
        first[k] = after[k]
        if again is None or k < begin:
            continue
        repeated[k] = np.isfinite(again[k])
        if threshold is not None:
            wanted = after[k] > threshold(k, after[k])
            if besides is not None:
                wanted |= besides[k]
            repeated[k] &= wanted
        which = np.flatnonzero(repeated[k])
        if len(which):
            second = np.clip(again[k, which], -_LARGEST_LEVEL, _LARGEST_LEVEL).astype(np.float32)
            both = _Visit(np.ascontiguousarray(visit.level[which]), second)
            part, after[k, which] = _update(design, k, before.part(which), both, noise[:, k], begin)
            state = state.put(which, part)
    return Odds(first, after, repeated)


def _initial(design: Design, draws: int) -> _Filter:
    """State before the first run: prior of coefficients and scales."""
    prior = np.where(np.isfinite(design.sizes), design.sizes, _LEVEL) ** 2
    coefficients = _Coefficients(np.zeros((len(prior), 1, draws), np.float32), np.diag(prior))
    log_prior = -0.5 * (np.log(_SCALES) / _SCALE_SPREAD)[:, None] ** 2
    return _Filter((_Scale(coefficients),) * len(_SCALES), np.repeat(log_prior, draws, axis=1))


def _noise(design: Design) -> Array:
    """Variance of each run with each size of the scatter, shape (scales, n)."""
    settings = design.settings
    thermometer = 0.0
    if design.has_temperature:
        thermometer = _THERMOMETER * (design.sizes[1] * settings.thermometer) ** 2
    own = (settings.scale * _SCALES[:, None] * design.uncertainty) ** 2
    return np.asarray(own + design.unknown_temperature**2 + thermometer * design.temperature_known)


def _with_new_onset(design: Design, k: int, state: _Filter) -> _Filter:
    """State with wear that begins midway between a run and the one before; weighted by that gap."""
    gap = float(design.days[k] - design.days[k - 1])
    scales = []
    for scale in state.scales:
        mean = np.repeat(scale.healthy.mean, len(_RATES), axis=1)
        ratio = np.ones(mean.shape[1:], np.float32)
        coefficients = _Coefficients(mean, scale.healthy.covariance)
        onset = _Onset(coefficients, ratio, ratio, float(design.days[k]) - gap / 2, gap)
        scales.append(_Scale(scale.healthy, (onset, *scale.onsets)[:_ONSETS]))
    return _Filter(tuple(scales), state.log_likelihood)


def _update(
    design: Design, k: int, before: _Filter, visit: _Visit, noise: Array, begin: int
) -> tuple[_Filter, Array]:
    """State after a visit, and the log odds."""
    log_likelihood = np.array(before.log_likelihood)
    summed = np.zeros_like(log_likelihood)
    scales = []
    for g, scale in enumerate(before.scales):
        variance = float(noise[g])
        density, healthy = _update_coefficients(design, k, scale.healthy, visit, variance)
        log_likelihood[g] += np.log(density[0])
        onsets = [
            _update_onset(design, k, onset, visit, variance, density[0], summed[g]) for onset in scale.onsets
        ]
        scales.append(_Scale(healthy, tuple(onsets)))
    log_likelihood -= log_likelihood.max(axis=0)
    after = _Filter(tuple(scales), log_likelihood)
    if k < begin:
        return after, np.zeros(log_likelihood.shape[1])
    share = np.exp(log_likelihood)
    return after, np.log1p((share * summed).sum(axis=0) / share.sum(axis=0))


def _update_onset(
    design: Design, k: int, onset: _Onset, visit: _Visit, noise: float, healthy: Single, summed: Array
) -> _Onset:
    """Onset after a visit; its likelihood ratio is added to ``summed``."""
    wear = (_RATES * (design.days[k] - onset.day)).astype(np.float32)
    density, coefficients = _update_coefficients(design, k, onset.coefficients, visit, noise, wear)
    ratio, largest = np.empty_like(onset.ratio), np.empty_like(onset.largest)
    weight, repeated = np.float32(onset.weight), bool(len(visit.repeat))
    accumulate_ratio(
        density, healthy, repeated, _CAPS, weight, onset.ratio, onset.largest, ratio, largest, summed
    )
    return _Onset(coefficients, ratio, largest, onset.day, onset.weight)


def _update_coefficients(
    design: Design, k: int, before: _Coefficients, visit: _Visit, noise: float, wear: Single = _HEALTHY
) -> tuple[Single, _Coefficients]:
    """Density of a visit, and the coefficients after it."""
    x, settings = design.columns[k], design.settings
    row = x.astype(np.float32)
    gain = before.covariance @ x
    doubt = float(x @ gain)
    variance = noise + doubt
    most = np.float32(_BOUND * np.sqrt(variance))
    error, density = np.empty((2, *before.mean.shape[1:]), np.float32)
    mean = np.empty_like(before.mean)
    innovation(visit.level, wear, row, before.mean, error)
    mixture = run_mixture(noise, doubt, settings)
    if len(visit.repeat):
        repeat = np.empty_like(error)
        innovation(visit.repeat, wear, row, before.mean, repeat)
        pair_density(error, repeat, mixture, pair_mixture(noise, doubt, settings), density)
        mean_or_lower(error, repeat, most)
    else:
        run_density(error, mixture, density)
    update_coefficients(error, (gain / variance).astype(np.float32), most, before.mean, mean)
    return density, _Coefficients(mean, before.covariance - np.outer(gain, gain) / variance)


def _put(whole: NDArray[Real], which: NDArray[np.int_], part: NDArray[Real]) -> NDArray[Real]:
    copy = whole.copy()
    copy[..., which] = part
    return copy
