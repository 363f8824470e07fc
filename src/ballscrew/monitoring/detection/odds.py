"""Odds that wear began at one of the newest runs, against no wear.

The statistic of Shiryaev and Roberts (Roberts, 1966, DOI 10.1080/00401706.1966.10490374). For every onset,
rate of wear and size of the scatter, the likelihood ratio against a healthy axis is updated from run to run;
the statistic is log(1 + the sum of these over onsets and their mean over rates), averaged over scatters by
the likelihood of each. Level, temperature and steps are estimated by a Kalman filter whose gain is the
same in all histories. A run is an outlier as often as the settings state, and rarely anything at all. The
single run with the largest likelihood ratio counts at most ``_RUN_CAP``: one outlier is no wear.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import Design, Layout
from ballscrew.monitoring.detection.kernels import (
    VisitUpdate,
    pair_mixture,
    put_histories,
    run_mixture,
    update_histories,
)

Single = NDArray[np.float32]
Real = TypeVar("Real", np.float32, np.float64)
_RATES = np.array([1 / 350, 1 / 160, 1 / 90])  # of the level per day: lives in days under contact pressure
_ONSETS = 5  # newest runs before which wear may have begun; the ramp covers earlier ones
_SCALES = np.exp(np.linspace(-1.2, 1.0, 6))  # of the scatter, over that of the settings
_SCALE_SPREAD = 0.6  # of ln: axes differ by more than the runs of one axis leave open
_RUN_CAP = np.exp(4.0)  # largest likelihood ratio of a single run
_REPEAT_CAP = np.exp(4.0)  # the same factor of its repeat
_LARGEST_RATIO = 1e20
_CAPS = np.array([1 / _RUN_CAP, 1 / _REPEAT_CAP, _LARGEST_RATIO], np.float32)
_BOUND = 3.0  # standard deviations of an innovation that updates the coefficients
_LEVEL = 0.3  # prior standard deviation of the level
_THERMOMETER = 0.5  # of the squared effect of a wrong temperature on a typical axis
_LARGEST_LEVEL = 1e12  # its square is still a number
_EMPTY: Single = np.empty(0, np.float32)
Threshold = Callable[[Array], float]


@dataclass(frozen=True, slots=True, eq=False)
class OddsState:
    """State of m histories for s sizes of the scatter, without wear and with wear since each of o onsets.

    Parameters
    ----------
    layout : Layout
        Of the coefficients.
    day : float
        Day of the newest visit.
    onsets, gaps : ndarray, shape (o,)
        Days on which wear may have begun, the newest first, and the days from the run before to the run after
        each, by which it is weighted.
    healthy, worn : ndarray of float32, shapes (s, p, 1, m) and (s, o, p, r, m)
        Expected coefficients without wear, and with wear at r rates.
    healthy_covariance, worn_covariance : ndarray, shapes (s, p, p) and (s, o, p, p)
        Covariance of these, common to all histories.
    ratio, largest : ndarray of float32, shape (s, o, r, m)
        Likelihood ratio so far, and the largest factor of a single run.
    log_likelihood : ndarray, shape (s, m)
        Logarithm of the likelihood of each size of the scatter, without wear.
    """

    layout: Layout
    day: float
    onsets: Array
    gaps: Array
    healthy: Single
    worn: Single
    healthy_covariance: Array
    worn_covariance: Array
    ratio: Single
    largest: Single
    log_likelihood: Array

    def part(self, which: NDArray[np.int_]) -> OddsState:
        """Select histories."""
        columns: dict[str, Any] = {}
        for name in _BY_HISTORY:
            columns[name] = np.take(getattr(self, name), which, axis=-1)
        return replace(self, **columns)

    def put(self, which: NDArray[np.int_], part: OddsState) -> None:
        """Overwrite histories by those of another state."""
        for name in _BY_HISTORY:
            put_histories(_by_history(getattr(part, name)), which, _by_history(getattr(self, name)))


def _by_history(numbers: NDArray[Real]) -> NDArray[Real]:
    """View of contiguous numbers, shape (n, m)."""
    return numbers.reshape(math.prod(numbers.shape[:-1]), numbers.shape[-1])


_OF_ONSETS = ("worn", "ratio", "largest")
_BY_HISTORY = ("healthy", *_OF_ONSETS, "log_likelihood")


@dataclass(frozen=True, slots=True, eq=False)
class Coefficients:
    """Coefficients of healthy histories as known so far, averaged over sizes of the scatter.

    Parameters
    ----------
    mean : ndarray, shape (p, m)
        Expected values.
    share : ndarray, shape (s, m)
        Probability of each size of the scatter.
    covariance : ndarray, shape (s, p, p)
        For each size.
    """

    mean: Array
    share: Array
    covariance: Array

    def expected(self, x: Array) -> Array:
        """Level by coefficients x, shape (m,)."""
        return np.asarray(x @ self.mean)

    def variance(self, x: Array) -> Array:
        """Variance of the same, shape (m,)."""
        return np.asarray((self.covariance @ x @ x) @ self.share)


def known_coefficients(state: OddsState) -> Coefficients:
    """Coefficients as known at a state.

    Parameters
    ----------
    state : OddsState
        Just before a visit.

    Returns
    -------
    Coefficients
        Of healthy histories. Their level follows a wearing axis, but late.
    """
    share = np.exp(state.log_likelihood - state.log_likelihood.max(axis=0))
    share /= share.sum(axis=0)
    mean = np.einsum("sm,spm->pm", share, state.healthy[:, :, 0])
    return Coefficients(mean, share, state.healthy_covariance)


@dataclass(frozen=True, slots=True)
class _Visit:
    """Level of a visit, and that of its repeat, each (m,); empty where there is none."""

    level: Single
    repeat: Single


def no_odds(design: Design, draws: int) -> OddsState:
    """State before the first visit: prior of coefficients and scales.

    Parameters
    ----------
    design : Design
        With the first visit.
    draws : int
        Number of histories.

    Returns
    -------
    OddsState
        Without onsets.
    """
    prior = _prior(design)
    scales, p, rates = len(_SCALES), len(prior), len(_RATES)
    log_prior = -0.5 * (np.log(_SCALES) / _SCALE_SPREAD)[:, None] ** 2
    no_ratio = np.empty((scales, 0, rates, draws), np.float32)
    return OddsState(
        layout=design.layout,
        day=float(design.days[0]),
        onsets=np.empty(0),
        gaps=np.empty(0),
        healthy=np.zeros((scales, p, 1, draws), np.float32),
        worn=np.empty((scales, 0, p, rates, draws), np.float32),
        healthy_covariance=np.repeat(np.diag(prior)[None], scales, axis=0),
        worn_covariance=np.empty((scales, 0, p, p)),
        ratio=no_ratio,
        largest=no_ratio,
        log_likelihood=np.repeat(log_prior, draws, axis=1),
    )


def _prior(design: Design) -> Array:
    """Prior variance of each coefficient."""
    return np.asarray(np.where(np.isfinite(design.sizes), design.sizes, _LEVEL) ** 2)


def prepare_odds(design: Design, k: int, state: OddsState, *, begun: bool) -> OddsState:
    """State with the coefficients that begin with a visit, and with wear that begins just before it.

    Parameters
    ----------
    design : Design
        With the visit.
    k : int
        Its row.
    state : OddsState
        After the visit before.
    begun : bool
        False while learning: wear may begin from the next visit on.

    Returns
    -------
    OddsState
        Just before the visit. ``onsets``, ``gaps`` and ``worn_covariance`` have the new onset first;
        ``worn``, ``ratio`` and ``largest`` do not have it yet.
    """
    if state.layout != design.layout:
        state = _with_new_columns(state, design)
    if begun:
        state = _with_new_onset(design, k, state)
    return replace(state, day=float(design.days[k]))


def add_odds(
    design: Design, k: int, state: OddsState, levels: Array, *, begun: bool
) -> tuple[OddsState, Array]:
    """Log odds at a visit, after its first run, of wear that began lately.

    Parameters
    ----------
    design : Design
        With the visit.
    k : int
        Its row.
    state : OddsState
        Just before the visit, see :func:`prepare_odds`.
    levels : ndarray, shape (m,)
        As measured; finite.
    begun : bool
        False while learning.

    Returns
    -------
    OddsState
        After the visit.
    ndarray, shape (m,)
        0 or more; 0 while learning. Later visits do not change them.
    """
    return _update(design, k, state, _Visit(_bounded(levels), _EMPTY), begun=begun)


def repeat_odds(
    design: Design,
    k: int,
    before: OddsState,
    after: OddsState,
    found: Array,
    levels: Array,
    again: Array,
) -> tuple[OddsState, Array]:
    """Log odds at a visit after its repeat.

    Parameters
    ----------
    design, k, levels
        As for :func:`add_odds`.
    before, after : OddsState
        Just before the visit, and after its first run; the second is overwritten.
    found : ndarray, shape (m,)
        Log odds after its first run.
    again : ndarray, shape (m,)
        Levels of the repeats; nan where there is none.

    Returns
    -------
    OddsState
        After the visit.
    ndarray, shape (m,)
        Log odds, as after the first run where there is no repeat.
    """
    which = np.flatnonzero(np.isfinite(again))
    if not len(which):
        return after, found
    both = _Visit(np.ascontiguousarray(_bounded(levels)[which]), _bounded(again[which]))
    part, odds_again = _update(design, k, before.part(which), both, begun=True)
    after.put(which, part)
    found = found.copy()
    found[which] = odds_again
    return after, found


def _bounded(levels: Array) -> Single:
    return np.clip(levels, -_LARGEST_LEVEL, _LARGEST_LEVEL).astype(np.float32)


def _with_new_columns(state: OddsState, design: Design) -> OddsState:
    """State with the prior of the coefficients that begin with the newest visit."""
    before, after = state.layout, design.layout
    new = before.extend(np.ones(state.healthy.shape[1]), 0, after) == 0
    prior = np.diag(np.where(new, _prior(design), 0.0))
    covariances = {
        name: prior + before.extend(before.extend(getattr(state, name), axis, after), axis + 1, after)
        for name, axis in (("healthy_covariance", 1), ("worn_covariance", 2))
    }
    return replace(
        state,
        layout=after,
        healthy=before.extend(state.healthy, 1, after),
        worn=before.extend(state.worn, 2, after),
        **covariances,
    )


def _noise(design: Design, k: int) -> Array:
    """Variance of a run with each size of the scatter, shape (scales,)."""
    settings = design.settings
    thermometer = 0.0
    if design.has_temperature:
        thermometer = _THERMOMETER * (design.sizes[1] * settings.thermometer) ** 2
    own = (settings.scale * _SCALES * design.uncertainty[k]) ** 2
    return np.asarray(own + design.unknown_temperature[k] ** 2 + thermometer * design.temperature_known[k])


def _with_new_onset(design: Design, k: int, state: OddsState) -> OddsState:
    """State with wear that begins midway between a run and the one before."""
    gap = float(design.days[k]) - state.day
    covariance = np.concatenate([state.healthy_covariance[:, None], state.worn_covariance], axis=1)
    return replace(
        state,
        onsets=np.append(design.days[k] - gap / 2, state.onsets)[:_ONSETS],
        gaps=np.append(gap, state.gaps)[:_ONSETS],
        worn_covariance=covariance[:, :_ONSETS],
    )


def _update(
    design: Design, k: int, before: OddsState, visit: _Visit, *, begun: bool
) -> tuple[OddsState, Array]:
    """State after a visit, and the log odds."""
    x, noise = design.columns[k], _noise(design, k)
    repeated = len(visit.repeat) > 0
    healthy_update, healthy_covariance = _update_of(
        design, x, noise, before.healthy_covariance, repeated=repeated
    )
    worn_update, worn_covariance = _update_of(
        design, x, noise[:, None], before.worn_covariance, repeated=repeated
    )
    columns: dict[str, Any] = {"healthy": np.empty_like(before.healthy)}
    for name in _OF_ONSETS:
        scales, _, *others = getattr(before, name).shape
        columns[name] = np.empty((scales, len(before.onsets), *others), np.float32)
    density = np.empty(before.log_likelihood.shape, np.float32)
    summed = np.zeros_like(before.log_likelihood)
    update_histories(
        (visit.level, visit.repeat, x.astype(np.float32)),
        ((design.days[k] - before.onsets)[:, None] * _RATES).astype(np.float32),
        healthy_update,
        worn_update,
        before.gaps.astype(np.float32),
        _CAPS,
        (before.healthy, before.worn, before.ratio, before.largest),
        (columns["healthy"], columns["worn"], columns["ratio"], columns["largest"]),
        int(begun),
        density,
        summed,
    )
    likelihood = before.log_likelihood + np.log(density)
    after = replace(
        before,
        healthy_covariance=healthy_covariance,
        worn_covariance=worn_covariance,
        log_likelihood=likelihood - likelihood.max(axis=0),
        **columns,
    )
    if not begun:
        return after, np.zeros(summed.shape[1])
    share = np.exp(after.log_likelihood)
    return after, np.log1p((share * summed).sum(axis=0) / share.sum(axis=0))


def _update_of(
    design: Design, x: Array, noise: Array, covariance: Array, *, repeated: bool
) -> tuple[VisitUpdate, Array]:
    """How a visit updates coefficients of these covariances, and the covariances after it."""
    # One product at a time: a stack of matrices is multiplied in another order of sums.
    matrices = covariance.reshape(-1, len(x), len(x))
    gain = np.array([matrix @ x for matrix in matrices]).reshape(covariance.shape[:-1])
    doubt = np.array([x @ each for each in gain.reshape(-1, len(x))]).reshape(covariance.shape[:-2])
    variance = noise + doubt
    outer = gain[..., :, None] * gain[..., None, :]
    both = np.empty((*doubt.shape, 0, 0), np.float32)
    if repeated:
        both = pair_mixture(noise, doubt, design.settings)
    bounds = (_BOUND * np.sqrt(variance)).astype(np.float32)
    mixture = run_mixture(noise, doubt, design.settings)
    update = (gain / variance[..., None]).astype(np.float32), bounds, mixture, both
    return update, covariance - outer / variance[..., None, None]
