"""Evidence of a ramp: the largest slope over its standard deviation, a recursion over visits.

Generalised least squares estimate the slope of a ramp together with level, temperature and steps, for every
onset on a grid. The statistic is a generalised likelihood ratio (Willsky and Jones, 1976, DOI
10.1109/TAC.1976.1101146). Onsets lie on a grid that is finer towards the newest visit, since a ramp is found
about as well from an onset that is a little off. The grid is anchored: an onset is a visit of the epoch, and
none is added later, so that each needs only sums over the visits since it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import Design, Layout

_LEAST_INFORMATION = 1e-9  # on a slope, relative to that without other coefficients
_FINE = 4  # visits before the newest with every onset; then onsets are further apart by up to half their age


@dataclass(frozen=True, slots=True, eq=False)
class RampState:
    """Sums after some visits in m histories, for w onsets and p coefficients.

    Parameters
    ----------
    layout : Layout
        Of the coefficients.
    count : int
        Visits so far.
    onset : ndarray of int, shape (w,)
        Number of the visit at which each ramp begins, ascending.
    day : ndarray, shape (w,)
        Day of that visit.
    across : ndarray, shape (p, w)
        Weighted products of the columns with each ramp.
    alone : ndarray, shape (w,)
        Weighted squares of each ramp.
    moment : ndarray, shape (w, m)
        Weighted products of the levels with each ramp.
    inner : ndarray, shape (p, p)
        Weighted products of the columns.
    projected : ndarray, shape (p, m)
        Weighted products of the columns with the levels.
    """

    layout: Layout
    count: int
    onset: NDArray[np.int_]
    day: Array
    across: Array
    alone: Array
    moment: Array
    inner: Array
    projected: Array


@dataclass(frozen=True, slots=True, eq=False)
class Slopes:
    """Slopes over their standard deviations at a visit, in m histories.

    Parameters
    ----------
    largest, smallest : ndarray, shape (m,)
        Over all onsets; 0 where there is none yet.
    onset : ndarray of int, shape (m,)
        Visit at which the ramp of the largest begins.
    first : ndarray, shape (m,)
        The largest after the first run of the visit.
    """

    largest: Array
    smallest: Array
    onset: NDArray[np.int_]
    first: Array


def no_ramp(design: Design, draws: int) -> RampState:
    """State before the first visit."""
    p = design.columns.shape[1]
    return RampState(
        layout=design.layout,
        count=0,
        onset=np.zeros(0, dtype=int),
        day=np.zeros(0),
        across=np.zeros((p, 0)),
        alone=np.zeros(0),
        moment=np.zeros((0, draws)),
        inner=np.zeros((p, p)),
        projected=np.zeros((p, draws)),
    )


def onsets(k: int) -> NDArray[np.int_]:
    """Visits at which a ramp may have begun, before visit k.

    Parameters
    ----------
    k : int
        From 1.

    Returns
    -------
    ndarray of int
        Ascending: the first visit, and each other visit j until k − j exceeds four times the largest power of
        two that divides j.
    """
    return _within(np.arange(k), k)


def _within(onset: NDArray[np.int_], k: int) -> NDArray[np.int_]:
    """Onsets that remain on the grid at visit k."""
    return np.asarray(onset[(onset == 0) | (k - onset <= _FINE * (onset & -onset))])


def add_ramp(
    design: Design, k: int, state: RampState, level: Array, scale: Array, first: Array | None = None
) -> tuple[RampState, Slopes]:
    """Slopes at a visit.

    Parameters
    ----------
    design : Design
        With the visit.
    k : int
        Row of the visit.
    state : RampState
        Before the visit.
    level : ndarray, shape (m,)
        Outliers limited.
    scale : ndarray, shape (m,)
        Scatter over the stated uncertainty.
    first : ndarray, shape (m,), optional
        Level after the first run of the visit, where its repeat changed it.

    Returns
    -------
    RampState
        After the visit.
    Slopes
        Of all onsets before it.
    """
    state = _with_new_columns(state, design)
    noise = design.noise[k]
    if k in design.step_starts:
        # It is not limited, whatever it is.
        noise *= design.settings.odd_size**2
    weight = 1 / noise
    column = weight * design.columns[k]
    since = design.days[k] - state.day
    state = replace(
        state,
        across=state.across + column[:, None] * since,
        alone=state.alone + weight * since**2,
        moment=state.moment + (weight * since)[:, None] * level,
        inner=state.inner + column[:, None] * design.columns[k],
        projected=state.projected + column[:, None] * level,
    )
    profile = np.linalg.solve(state.inner + np.diag(design.information), state.across)
    information = state.alone - (state.across * profile).sum(axis=0)
    usable = information > _LEAST_INFORMATION * state.alone
    after = _with_onset(state, float(design.days[k]))
    if not usable.any():
        none = np.zeros_like(level)
        return after, Slopes(none, none, none.astype(int), none)
    profile, information = profile[:, usable], information[usable]
    # The noise is that of the scatter, the priors are what they are.
    by_prior = (design.prior_information[:, None] * profile**2).sum(axis=0)
    by_noise = np.maximum(information - by_prior, _LEAST_INFORMATION * information)
    inflation = (scale / design.settings.scale) ** 2
    deviation = np.sqrt(by_noise[:, None] * inflation + by_prior[:, None])
    values = (state.moment[usable] - profile.T @ state.projected) / deviation
    best = np.argmax(values, axis=0)
    largest = values[best, np.arange(values.shape[1])]
    largest_first = largest.copy()
    if first is not None:
        changed = np.flatnonzero(first != level)
        effect = (weight * since[usable] - profile.T @ column)[:, None] / deviation[:, changed]
        shifted = values[:, changed] + effect * (first[changed] - level[changed])
        if len(changed):
            largest_first[changed] = shifted.max(axis=0)
    return after, Slopes(largest, values.min(axis=0), state.onset[usable][best], largest_first)


def _with_new_columns(state: RampState, design: Design) -> RampState:
    """State with the columns that begin with the newest visit."""
    before, after = state.layout, design.layout
    if before == after:
        return state
    return replace(
        state,
        layout=after,
        across=before.extend(state.across, 0, after),
        inner=before.extend(before.extend(state.inner, 0, after), 1, after),
        projected=before.extend(state.projected, 0, after),
    )


def _with_onset(state: RampState, day: float) -> RampState:
    """State with a ramp that begins at the newest visit, and without those that leave the grid."""
    numbers = np.append(state.onset, state.count)
    onset = _within(numbers, state.count + 1)
    some = np.isin(numbers, onset)
    across = np.concatenate([state.across, np.zeros((len(state.across), 1))], axis=1)
    moment = np.concatenate([state.moment, np.zeros((1, state.moment.shape[1]))])
    return replace(
        state,
        count=state.count + 1,
        onset=onset,
        day=np.append(state.day, day)[some],
        across=across[:, some],
        alone=np.append(state.alone, 0.0)[some],
        moment=moment[some],
    )
