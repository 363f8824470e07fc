"""Linear model of an epoch's levels without wear: level, temperature, and steps by events.

    y = 1 − (P/P₀)^(1/3) = μ + γ ΔT + γ₂ ΔT² + β t/(t + 60 d) + Σ steps + noise,   noise ~ s · u

with the stated uncertainty u of each run and priors on γ, γ₂, the settling β of the support bearing, the
steps and s. What is exponential in the
temperature is not quite linear in it; in this y, which also grows linearly by wear under contact pressure, it
nearly is. The estimates are linear in y but for the bound of a step; s is estimated separately.

A step is estimated from the runs just before and just after it, with a level and a slope of their own: wear
that continues across it, and the loss since the baseline, are excluded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.settings import MonitorSettings

Real = TypeVar("Real", np.float32, np.float64)
_FLAT = 1e-8  # prior information on μ, relative to that of one run
LEAST_UNCERTAINTY = 1e-5
"""Of a level: no preload is measured to 30 ppm."""

CURVATURE = 0.5
"""Of γ²: within ± γ²/2 whether temperature preloads the nut or P is exponential in it."""

SETTLING = 60.0
"""Days in which half of a bearing's drift happens."""

UNKNOWN = 5.0
"""Standard deviation of a temperature that was not recorded where others were, K."""

LARGEST_STEP = 3.0
"""Prior standard deviations: the excess over it is attributed to wear."""

STEP_RUNS = 5
"""Runs on each side of a step from which it is estimated."""


@dataclass(frozen=True, slots=True)
class LevelStep:
    """Step of the level by a known event.

    Parameters
    ----------
    day : float
        When.
    size : float
        Prior standard deviation of its size.
    expected : float
        Size that it is expected to have, which levels no longer contain when they are charted.
    """

    day: float
    size: float
    expected: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """Design of an epoch's n good runs, in time order.

    Parameters
    ----------
    days : ndarray, shape (n,)
        Ascending.
    uncertainty : ndarray, shape (n,)
        Stated standard uncertainty of each level, its random part.
    columns : ndarray, shape (n, p)
        1, ΔT and its square in K where known, the bearing's drift, and each step.
    sizes : ndarray, shape (p,)
        Prior standard deviation of their coefficients; that of μ is infinite.
    unknown_temperature : ndarray, shape (n,)
        Standard deviation of the level by a temperature that is not known.
    temperature_known : ndarray of bool, shape (n,)
        Runs with a temperature.
    has_temperature : bool
        True if the temperature of any run is known.
    step_starts : tuple of int
        First run after each step.
    settings : MonitorSettings
        Priors.
    """

    days: Array
    uncertainty: Array
    columns: Array
    sizes: Array
    unknown_temperature: Array
    temperature_known: NDArray[np.bool_]
    has_temperature: bool
    step_starts: tuple[int, ...]
    settings: MonitorSettings

    @property
    def layout(self) -> Layout:
        """Columns by kind."""
        steps = len(self.step_starts)
        warm = 2 * self.has_temperature
        return Layout(self.has_temperature, len(self.sizes) - 1 - warm - steps > 0, steps)

    @property
    def step_columns(self) -> slice:
        """Columns of the steps."""
        return slice(len(self.sizes) - len(self.step_starts), None)

    @property
    def noise(self) -> Array:
        """Prior variance of each run, shape (n,)."""
        return np.asarray((self.settings.scale * self.uncertainty) ** 2 + self.unknown_temperature**2)

    @property
    def information(self) -> Array:
        """Prior information on the coefficients, shape (p,)."""
        flat = 1.0
        if len(self.days):
            flat = _FLAT / self.noise[0]
        return np.where(np.isfinite(self.sizes), 1 / self.sizes**2, flat)

    @property
    def prior_information(self) -> Array:
        """The same without that on the level, which is none, shape (p,)."""
        return np.where(np.isfinite(self.sizes), self.information, 0.0)

    def reference(self, k: int) -> NDArray[np.int_]:
        """Earlier runs that are the reference of run k."""
        return np.arange(min(k, self.settings.baseline_runs))

    def until(self, k: int) -> Design:
        """Design as known with run k, without the columns that begin later."""
        known = self.temperature_known[: k + 1]
        starts = tuple(start for start in self.step_starts if start <= k)
        warm = bool(known.any())
        columns = [0, *range(1, 1 + 2 * warm)]
        drift = 1 + 2 * self.has_temperature
        columns += range(drift, drift + self.layout.drift)
        columns += [self.step_columns.start + number for number in range(len(starts))]
        return Design(
            days=self.days[: k + 1],
            uncertainty=self.uncertainty[: k + 1],
            columns=self.columns[: k + 1, columns],
            sizes=self.sizes[columns],
            unknown_temperature=self.unknown_temperature[: k + 1],
            temperature_known=known,
            has_temperature=warm,
            step_starts=starts,
            settings=self.settings,
        )

    def without_drift(self) -> Design:
        """Design without the bearing's drift."""
        at = 1 + 2 * self.has_temperature
        if not self.layout.drift:
            return self
        return replace(self, columns=np.delete(self.columns, at, axis=1), sizes=np.delete(self.sizes, at))


@dataclass(frozen=True, slots=True)
class Layout:
    """Columns of a design: whether it has a temperature and a drift, and its number of steps.

    Columns are added as the epoch grows: those of the temperature after the first, steps at the end.
    """

    temperature: bool
    drift: bool
    steps: int

    def extend(self, array: NDArray[Real], axis: int, later: Layout) -> NDArray[Real]:
        """Array with zeros for the columns that a later layout has more.

        Parameters
        ----------
        array : ndarray
            Its axis ``axis`` is that of the columns.
        axis : int
            0 or more.
        later : Layout
            With more columns, or the same.

        Returns
        -------
        ndarray
            A copy.
        """
        if later == self:
            return array.copy()
        if later.temperature and not self.temperature:
            array = np.insert(array, [1, 1], 0, axis=axis)
        shape = list(array.shape)
        shape[axis] = later.steps - self.steps
        return np.concatenate([array, np.zeros(shape, array.dtype)], axis=axis)


def design_of(
    days: Array,
    uncertainty: Array,
    temperature: Array,
    steps: Sequence[LevelStep] = (),
    settings: MonitorSettings | None = None,
    drift: float = 0.0,
) -> Design:
    """Design of an epoch.

    Parameters
    ----------
    days, uncertainty, temperature : ndarray, shape (n,)
        Day, standard uncertainty of the level and temperature in °C (nan where not recorded) of the good
        runs, in time order.
    steps : sequence of LevelStep
        Known events that begin no new epoch.
    settings : MonitorSettings, optional
        Priors.
    drift : float
        Standard deviation of the level by the drift of a healthy support bearing.

    Returns
    -------
    Design
        The design of a run depends on the runs before it alone.
    """
    settings = settings or MonitorSettings()
    days = np.asarray(days, dtype=float)
    uncertainty = np.maximum(np.asarray(uncertainty, dtype=float), LEAST_UNCERTAINTY)
    temperature = np.asarray(temperature, dtype=float)
    known = np.isfinite(temperature)
    slope = settings.assumptions.temperature / 3  # of ln P per kelvin; the level changes by a third of it
    columns, sizes = [np.ones_like(days)], [np.inf]
    unknown_temperature = np.zeros_like(days)
    if known.any():
        warmer = np.where(known, temperature - temperature[known][0], 0.0)
        columns += [warmer, warmer**2]
        sizes += [max(slope, 1e-9), CURVATURE * max(slope, 1e-9) ** 2]
        unknown_temperature[~known & (np.cumsum(known) > 0)] = slope * UNKNOWN  # not before the first known
    if drift > 0:
        since = days - days[:1].sum()
        columns.append(since / (since + SETTLING))
        sizes.append(drift)
    starts = []
    for step in sorted(steps, key=lambda step: step.day):
        after = days >= step.day
        if after.any() and not after.all() and step.size > 0:
            columns.append(after.astype(float))
            sizes.append(step.size)
            starts.append(int(np.argmax(after)))
    return Design(
        days=days,
        uncertainty=uncertainty,
        columns=np.stack(columns, axis=1),
        sizes=np.array(sizes),
        unknown_temperature=unknown_temperature,
        temperature_known=known,
        has_temperature=bool(known.any()),
        step_starts=tuple(starts),
        settings=settings,
    )


@dataclass(frozen=True, slots=True, eq=False)
class CoefficientFit:
    """Least-squares fit of the coefficients as a linear map of levels.

    Parameters
    ----------
    rows : ndarray of int, shape (m,)
        Runs of the fit.
    gain : ndarray, shape (p, m)
        Coefficients = gain · levels.
    noise_covariance, prior_covariance : ndarray, shape (p, p)
        Covariance of the coefficients by the runs' prior noise, and by the priors.
    """

    rows: NDArray[np.int_]
    gain: Array
    noise_covariance: Array
    prior_covariance: Array

    def variances(self, x: Array) -> tuple[float, float]:
        """Variance of a combination of the coefficients by noise, and by the priors."""
        return float(x @ self.noise_covariance @ x), float(x @ self.prior_covariance @ x)


def fit_coefficients(design: Design, rows: NDArray[np.int_], until: int) -> CoefficientFit:
    """Fit the coefficients to a baseline and the runs around each step.

    Parameters
    ----------
    design : Design
        The epoch.
    rows : ndarray of int, shape (b,)
        Runs of the baseline; one or more.
    until : int
        First run that is not used around a step.

    Returns
    -------
    CoefficientFit
        Fit of level, temperature and steps.
    """
    groups = _step_groups(design, until)
    runs = np.unique(np.concatenate([rows, *groups]))
    x = np.concatenate([design.columns[runs], _drift_columns(design, rows, groups, runs)], axis=1)
    weight, p = 1 / design.noise[runs], design.columns.shape[1]
    drifts = x.shape[1] - p
    information = np.append(design.information, np.full(drifts, _FLAT / design.noise[0]))
    prior = np.append(design.prior_information, np.zeros(drifts))
    inner = x.T @ (weight[:, None] * x)
    inverse = np.linalg.inv(inner + np.diag(information))
    return CoefficientFit(
        rows=runs,
        gain=(inverse @ (x * weight[:, None]).T)[:p],
        noise_covariance=(inverse @ inner @ inverse)[:p, :p],
        prior_covariance=(inverse @ np.diag(prior) @ inverse)[:p, :p],
    )


def coefficients(design: Design, fit: CoefficientFit, levels: Array) -> Array:
    """Coefficients of histories, with bounded steps.

    Parameters
    ----------
    design : Design
        The epoch.
    fit : CoefficientFit
        Fit of the coefficients.
    levels : ndarray, shape (r, m) or (r,)
        Levels of the runs of the fit in m histories.

    Returns
    -------
    ndarray, shape (p, m) or (p,)
        A step is at most :data:`LARGEST_STEP` prior standard deviations; the rest is attributed to wear.
    """
    values = np.asarray(fit.gain @ levels)
    steps = design.step_columns
    most = LARGEST_STEP * design.sizes[steps].reshape(-1, *[1] * (values.ndim - 1))
    values[steps] = np.clip(values[steps], -most, most)
    return values


def _step_groups(design: Design, until: int) -> list[NDArray[np.int_]]:
    """Runs around each step that is past; steps that share runs are one group."""
    groups: list[NDArray[np.int_]] = []
    for index in design.step_starts:
        near = np.arange(max(index - STEP_RUNS, 0), min(index + STEP_RUNS, until))
        if index >= until:
            continue
        if groups and near[0] <= groups[-1][-1]:
            groups[-1] = np.union1d(groups[-1], near)
        else:
            groups.append(near)
    return groups


def _drift_columns(
    design: Design, rows: NDArray[np.int_], groups: list[NDArray[np.int_]], runs: NDArray[np.int_]
) -> Array:
    """Columns of the loss around steps that is not in the baseline: a level and a slope of each group.

    A group that overlaps the baseline has its level, and drifts from the last of the shared runs on.
    """
    columns = [np.zeros((len(runs), 0))]
    for group in groups:
        inside, shared = np.isin(runs, group), np.intersect1d(group, rows)
        span = max(float(design.days[group[-1]] - design.days[group[0]]), LEAST_UNCERTAINTY)
        first = group[0]
        if len(shared):
            first = shared[-1]
        else:
            columns.append(inside[:, None].astype(float))
        drift = np.maximum(design.days[runs] - design.days[first], 0.0) / span
        columns.append(np.where(inside, drift, 0.0)[:, None])
    return np.concatenate(columns, axis=1)
