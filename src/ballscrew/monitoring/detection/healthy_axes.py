"""Healthy axes for the limits: levels of visits without wear, all unknowns sampled from their priors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.monitoring.detection.design import LARGEST_STEP, Design
from ballscrew.monitoring.detection.settings import MonitorSettings

_CURVATURE = (-0.5, 0.5)  # of γ²: P exponential in the temperature, or temperature preloads the nut


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
    axes = HealthyAxes(design, draws, tuple(seed))
    levels, again = np.empty((2, len(design.days), draws))
    for k in range(len(design.days)):
        levels[k], again[k] = axes.visit(design, k)
    return levels, again


class HealthyAxes:
    """Coefficients of healthy histories, and the levels of their visits.

    Parameters
    ----------
    design : Design
        With the first visit.
    draws : int
        Number of histories.
    seed : tuple of int
        Every coefficient and every visit has a stream of its own.
    """

    def __init__(self, design: Design, draws: int, seed: tuple[int, ...]) -> None:
        settings = design.settings
        random = np.random.default_rng([*seed, 0])
        degrees = settings.scale_degrees
        self.scale = settings.scale * np.sqrt(degrees / random.chisquare(degrees, draws))
        self.draws, self.seed = draws, seed
        self._sample(design)

    def _sample(self, design: Design) -> None:
        """Sample the coefficients of a design; those of an earlier one remain the same."""
        draws, seed, sizes = self.draws, self.seed, design.sizes
        self.layout = design.layout
        self.samples, self.effect = np.zeros((len(sizes), draws)), np.zeros(draws)
        if design.has_temperature:
            random = np.random.default_rng([*seed, 1])
            self.samples[1] = sizes[1] * random.standard_normal(draws)
            self.samples[2] = random.uniform(*_CURVATURE, draws) * self.samples[1] ** 2
            # The effect of a wrong temperature is proportional to that of the temperature.
            self.effect = np.abs(self.samples[1]) / sizes[1]
        steps = design.step_columns
        for column in range(3 if design.has_temperature else 1, steps.start):
            random = np.random.default_rng([*seed, 4])
            self.samples[column] = sizes[column] * random.standard_normal(draws)
        for number, column in enumerate(range(steps.start, len(sizes))):
            step = np.random.default_rng([*seed, 2, number]).standard_normal(draws)
            self.samples[column] = sizes[column] * np.clip(step, -LARGEST_STEP, LARGEST_STEP)

    def visit(self, design: Design, k: int) -> tuple[Array, Array]:
        """Levels of a visit and of its repeat.

        Parameters
        ----------
        design : Design
            With the visit.
        k : int
            Its row, which is its number in the epoch.

        Returns
        -------
        levels, again : ndarray, shape (draws,)
            As measured.
        """
        if self.layout != design.layout:
            self._sample(design)
        settings, draws = design.settings, self.draws
        random = np.random.default_rng([*self.seed, 3, k])
        own = self.scale * design.uncertainty[k]
        outlier = random.uniform(size=draws) < settings.odd
        noise = _scaled(own, outlier, settings) * random.standard_normal(draws)
        # The scatter of the runs shows a wrong temperature; without a temperature none could be wrong.
        thermometer = 0.0
        if design.has_temperature and design.temperature_known[k]:
            thermometer = design.sizes[1] * settings.thermometer
        temperature = np.hypot(design.unknown_temperature[k], thermometer) * self.effect
        true = design.columns[k] @ self.samples + temperature * random.standard_normal(draws)
        repeat_outlier = random.uniform(size=draws) < settings.odd
        repeat_noise = _scaled(own, repeat_outlier, settings) * random.standard_normal(draws)
        persists = outlier & (random.uniform(size=draws) < settings.odd_stays)
        return true + noise, true + np.where(persists, noise, repeat_noise)


def _scaled(own: Array, outlier: NDArray[np.bool_], settings: MonitorSettings) -> Array:
    """Standard deviation of runs that may be outliers."""
    return np.where(outlier, settings.odd_size, 1.0) * own
