"""The model of an epoch's levels while nothing wears: level, temperature, and steps that events make.

    y = 1 − (P/P₀)^(1/3) = μ + γ ΔT + γ₂ ΔT² + Σ steps + noise,   noise ~ s · told

with priors on γ, γ₂, the steps and s. What is exponential in the temperature
is not quite linear in it; in this y, which also grows linearly by wear under contact pressure, it nearly is.
All that follows is linear in y, but for the bound of a step; s is estimated beside.

A step is told from the runs just before it against those just after, about a level and a slope of their own:
wear that goes on across it, and what was lost since the baseline, are no part of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.settings import MonitorSettings

__all__ = ["FARTHEST", "LEARNT", "Design", "Step", "Told", "coefficients", "design", "told_by"]

_FLAT = 1e-8  # information on μ before the first run, relative to one run
_LEAST = 1e-5  # of a told level: nobody measures a preload to 30 ppm
_BENT = 0.5  # of γ²: within ± γ²/2 whether warmth presses the nut or P is exponential in it
_UNKNOWN = 5.0  # K, of a run whose temperature was not recorded where only one was
FARTHEST = 3.0
"""Prior standard deviations: beyond it a step is no step alone."""

LEARNT = 5
"""Runs on each side of a step that teach how large it was."""


@dataclass(frozen=True, slots=True)
class Step:
    """From a day on the level may stand elsewhere, by a standard deviation."""

    day: float
    size: float


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """Of an epoch's n good runs, in time order.

    Parameters
    ----------
    days : ndarray, shape (n,)
        Ascending.
    told : ndarray, shape (n,)
        Standard uncertainty of each level that another run draws anew.
    columns : ndarray, shape (n, p)
        1, ΔT and its square in K where known, and each step.
    sizes : ndarray, shape (p,)
        Prior standard deviation of their coefficients; that of μ is infinite.
    loose : ndarray, shape (n,)
        Standard deviation that a temperature that is not known adds.
    known : ndarray of bool, shape (n,)
        Whose temperature is known.
    begun : tuple of int
        Of each step, the first run after it.
    baseline : tuple of ndarray of int
        For each run, which runs before it are its reference.
    settings : MonitorSettings
        Priors.
    """

    days: Array
    told: Array
    columns: Array
    sizes: Array
    loose: Array
    known: NDArray[np.bool_]
    begun: tuple[int, ...]
    baseline: tuple[NDArray[np.int_], ...]
    settings: MonitorSettings

    @property
    def warm(self) -> bool:
        """Whether a temperature is known."""
        return bool(self.known.any())

    @property
    def step_columns(self) -> slice:
        """Columns of the steps."""
        return slice(len(self.sizes) - len(self.begun), None)

    @property
    def noise(self) -> Array:
        """Variance of each run as it is believed before, shape (n,)."""
        return np.asarray((self.settings.scale * self.told) ** 2 + self.loose**2)

    @property
    def information(self) -> Array:
        """Prior information, shape (p,)."""
        size = np.where(np.isfinite(self.sizes), self.sizes, 1.0)
        flat = _FLAT / self.noise[0] if len(self.days) else 1.0
        return np.where(np.isfinite(self.sizes), 1 / size**2, flat)


def design(
    days: Array,
    told: Array,
    temperature: Array,
    steps: Sequence[Step] = (),
    settings: MonitorSettings | None = None,
) -> Design:
    """Lay out an epoch.

    Parameters
    ----------
    days, told, temperature : ndarray, shape (n,)
        Of the good runs, in time order; d, level, °C (nan where not recorded).
    steps : sequence of Step
        Known events that begin no new epoch.
    settings : MonitorSettings, optional
        Priors.

    Returns
    -------
    Design
        What a run is judged by depends on the runs before it alone.
    """
    kept = settings or MonitorSettings()
    days, told = np.asarray(days, dtype=float), np.maximum(np.asarray(told, dtype=float), _LEAST)
    warm, known = np.asarray(temperature, dtype=float), np.isfinite(temperature)
    slope = kept.assumptions.temperature / 3  # of ln P by a kelvin; the level is its third
    columns, sizes = [np.ones_like(days)], [np.inf]
    loose = np.zeros_like(days)
    if known.any():
        first = warm[known][0]
        warmer = np.where(known, warm - first, 0.0)
        columns += [warmer, warmer**2]
        sizes += [max(slope, 1e-9), _BENT * max(slope, 1e-9) ** 2]
        loose[~known & (np.cumsum(known) > 0)] = slope * _UNKNOWN  # not before one was known
    begun = []
    for step in sorted(steps, key=lambda one: one.day):
        after = days >= step.day
        if after.any() and not after.all() and step.size > 0:
            columns.append(after.astype(float))
            sizes.append(step.size)
            begun.append(int(np.argmax(after)))
    baseline = tuple(np.arange(min(k, kept.baseline_runs)) for k in range(len(days)))
    return Design(
        days, told, np.stack(columns, axis=1), np.array(sizes), loose, known, tuple(begun), baseline, kept
    )


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """What some runs tell of the coefficients.

    Parameters
    ----------
    rows : ndarray of int, shape (m,)
        Which runs.
    how : ndarray, shape (p, m)
        Coefficients = this · levels.
    by_noise, by_prior : ndarray, shape (p, p)
        Covariance of what they err by: the runs' noise as it is believed before, and what the runs leave of
        the priors.
    """

    rows: NDArray[np.int_]
    how: Array
    by_noise: Array
    by_prior: Array

    def doubt(self, x: Array) -> tuple[float, float]:
        """Variance of a combination of the coefficients, by both."""
        return float(x @ self.by_noise @ x), float(x @ self.by_prior @ x)


def told_by(of: Design, rows: NDArray[np.int_], until: int) -> Told:
    """What a baseline, and the runs around each step, tell of the coefficients.

    Parameters
    ----------
    of : Design
        The epoch.
    rows : ndarray of int, shape (b,)
        The baseline's runs; one or more.
    until : int
        Runs that are known: none from this one on teaches a step.

    Returns
    -------
    Told
        Of level, temperature and steps.
    """
    groups = _around(of, until)
    every = np.unique(np.concatenate([rows, *groups]))
    x = np.concatenate([of.columns[every], _drifts(of, rows, groups, every)], axis=1)
    weight, p = 1 / of.noise[every], of.columns.shape[1]
    beside = x.shape[1] - p
    information = np.append(of.information, np.full(beside, _FLAT / of.noise[0]))
    prior = np.append(np.where(np.isfinite(of.sizes), of.information, 0.0), np.zeros(beside))
    inner = x.T @ (weight[:, None] * x)
    inverse = np.linalg.inv(inner + np.diag(information))
    return Told(
        every,
        (inverse @ (x * weight[:, None]).T)[:p],
        (inverse @ inner @ inverse)[:p, :p],
        (inverse @ np.diag(prior) @ inverse)[:p, :p],
    )


def coefficients(of: Design, told: Told, levels: Array) -> Array:
    """Coefficients of histories, no step larger than a few of its prior standard deviations.

    Parameters
    ----------
    of : Design
        The epoch.
    told : Told
        How they follow from levels.
    levels : ndarray, shape (n, m) or (n,)
        Of m histories.

    Returns
    -------
    ndarray, shape (p, m) or (p,)
        What a step would be beyond that bound is left to wear.
    """
    found = np.asarray(told.how @ levels[told.rows])
    plain = len(of.sizes) - len(of.begun)
    most = FARTHEST * of.sizes[plain:].reshape(-1, *[1] * (found.ndim - 1))
    found[plain:] = np.clip(found[plain:], -most, most)
    return found


def _around(of: Design, until: int) -> list[NDArray[np.int_]]:
    """Runs around each step that is over; steps that share runs are one group."""
    groups: list[NDArray[np.int_]] = []
    for index in of.begun:
        near = np.arange(max(index - LEARNT, 0), min(index + LEARNT, until))
        if index >= until:
            continue
        if groups and near[0] <= groups[-1][-1]:
            groups[-1] = np.union1d(groups[-1], near)
        else:
            groups.append(near)
    return groups


def _drifts(
    of: Design, rows: NDArray[np.int_], groups: list[NDArray[np.int_]], every: NDArray[np.int_]
) -> Array:
    """What may have been lost around steps and not in the baseline: a level and a slope of each group.

    A group that reaches into the baseline has its level, and drifts from the last of these runs on.
    """
    columns = []
    for group in groups:
        inside, shared = np.isin(every, group), np.intersect1d(group, rows)
        span = max(float(of.days[group[-1]] - of.days[group[0]]), _LEAST)
        if not len(shared):
            columns.append(inside.astype(float))
        start = of.days[shared[-1] if len(shared) else group[0]]
        columns.append(np.where(inside, np.maximum(of.days[every] - start, 0.0) / span, 0.0))
    return np.stack(columns, axis=1) if columns else np.zeros((len(every), 0))
