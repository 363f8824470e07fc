"""Design of an epoch that grows by a visit, of the visits alone that a later one refers to.

These are the first ones, from which the baseline is estimated, those around steps, and the newest. Their
number does not grow with the epoch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.monitoring.detection.design import (
    CURVATURE,
    LEAST_UNCERTAINTY,
    SETTLING,
    STEP_RUNS,
    UNKNOWN,
    Design,
    Layout,
    LevelStep,
    design_of,
)
from ballscrew.monitoring.detection.settings import MonitorSettings

BASELINES = 2
"""Baselines of visits that show when wear began."""

LEARNT = 20
"""Visits whose own design determines the limits."""


@dataclass(frozen=True, slots=True, eq=False)
class GrowingDesign:
    """Design after some visits.

    Parameters
    ----------
    design : Design
        A row for each visit that is retained.
    count : int
        Visits so far.
    temperature : float
        First recorded temperature, °C; nan while there is none.
    step : int or None
        Number of the first visit after the newest step.
    """

    design: Design
    count: int
    temperature: float
    step: int | None = None

    @property
    def since_step(self) -> int | None:
        """Visits since the first after the newest step; None where there was none."""
        return None if self.step is None else self.count - 1 - self.step

    def extended(
        self, day: float, uncertainty: float, temperature: float, steps: Sequence[LevelStep]
    ) -> GrowingDesign:
        """Design with one more visit.

        Parameters
        ----------
        day, uncertainty, temperature : float
            Of its first run; nan where the temperature is not known.
        steps : sequence of LevelStep
            Of the epoch; those since the visit before begin with this one.

        Returns
        -------
        GrowingDesign
            The same rows and the new one.
        """
        before, settings = self.design, self.design.settings
        new = _steps_since(steps, float(before.days[-1]), day)
        known = math.isfinite(temperature)
        warm = before.has_temperature or known
        layout = Layout(warm, before.layout.drift, before.layout.steps + len(new))
        sizes, first = before.layout.extend(before.sizes, 0, layout), self.temperature
        sizes[len(sizes) - len(new) :] = [step.size for step in new]
        if known and not before.has_temperature:
            first, slope = temperature, max(settings.assumptions.temperature / 3, 1e-9)
            sizes[1:3] = slope, CURVATURE * slope**2
        unknown = 0.0
        if warm and not known:
            unknown = settings.assumptions.temperature / 3 * UNKNOWN
        row = _row(layout, temperature - first if known else 0.0, day - float(before.days[0]))
        design = Design(
            days=np.append(before.days, day),
            uncertainty=np.append(before.uncertainty, max(uncertainty, LEAST_UNCERTAINTY)),
            columns=np.vstack([before.layout.extend(before.columns, 1, layout), row]),
            sizes=sizes,
            unknown_temperature=np.append(before.unknown_temperature, unknown),
            temperature_known=np.append(before.temperature_known, known),
            has_temperature=warm,
            step_starts=(*before.step_starts, *[len(before.days)] * len(new)),
            settings=settings,
        )
        step = self.count if new else self.step
        return GrowingDesign(design, self.count + 1, first, step)

    def retained(self) -> NDArray[np.int_]:
        """Rows that a later visit may refer to."""
        design, count = self.design, len(self.design.days)
        rows = np.arange(count)
        retained = rows < max(BASELINES * design.settings.baseline_runs, LEARNT)
        retained |= rows >= count - STEP_RUNS
        for start in design.step_starts:
            retained |= (rows >= start - STEP_RUNS) & (rows < start + STEP_RUNS)
        return np.flatnonzero(retained)

    def part(self, rows: NDArray[np.int_]) -> GrowingDesign:
        """Design of some of its rows, the first after each step among them."""
        design = self.design
        starts = tuple(int(np.searchsorted(rows, start)) for start in design.step_starts)
        names = ("days", "uncertainty", "columns", "unknown_temperature", "temperature_known")
        columns = {name: getattr(design, name)[rows] for name in names}
        return replace(self, design=replace(design, step_starts=starts, **columns))


def first_design(
    day: float, uncertainty: float, temperature: float, settings: MonitorSettings, drift: float
) -> GrowingDesign:
    """Design of the first visit of an epoch.

    Parameters
    ----------
    day, uncertainty, temperature : float
        Of its first run.
    settings : MonitorSettings
        Priors.
    drift : float
        Standard deviation of the level by the drift of a healthy support bearing.

    Returns
    -------
    GrowingDesign
        Of one row.
    """
    days, spread, warm = np.array([[day], [uncertainty], [temperature]])
    return GrowingDesign(design_of(days, spread, warm, (), settings, drift), 1, temperature)


def _steps_since(steps: Sequence[LevelStep], before: float, day: float) -> list[LevelStep]:
    """Steps after one day and until another, by day."""
    later = [step for step in steps if before < step.day <= day and step.size > 0]
    return sorted(later, key=lambda step: step.day)


def _row(layout: Layout, warmer: float, since: float) -> list[float]:
    """Columns of a visit, by its temperature and the days since the first one; all steps are past."""
    row = [1.0]
    if layout.temperature:
        row += [warmer, warmer**2]
    if layout.drift:
        row.append(since / (since + SETTLING))
    return row + [1.0] * layout.steps
