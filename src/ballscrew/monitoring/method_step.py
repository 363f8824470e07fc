"""Step of the level where the results of one revision of a method follow those of another."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ballscrew.base.quantity import NORMAL_95
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.frequency_table import frequency_table, paired_cells
from ballscrew.modal.run import Run
from ballscrew.monitoring.assessment import fused_change
from ballscrew.monitoring.detection.settings import MonitorSettings

LEAST_RUNS = 3
"""Runs with both results from which a step is estimated."""


@dataclass(frozen=True, slots=True)
class MethodStep:
    """Step of the relative change of the nut's compliance from the results of one method to those of another.

    Parameters
    ----------
    value : float
        Mean difference of the runs that have both.
    standard_uncertainty : float
        Of the mean, by the scatter of the differences. It is larger than that by the ratio of Student's
        quantile to the normal one, so that intervals of normal width contain the step as often as stated.
    runs : int
        With both results.
    """

    value: float
    standard_uncertainty: float
    runs: int


def method_step(
    pairs: Iterable[tuple[Run, Run]], model: CalibratedAxis, settings: MonitorSettings | None = None
) -> MethodStep | None:
    """Estimate the step between two methods from the runs that were analysed by both.

    Parameters
    ----------
    pairs : iterable of (Run, Run)
        The same run by the one and by the other. Those of a bad or suspect measurement do not count.
    model : CalibratedAxis
        The axis.
    settings : MonitorSettings, optional
        Assumptions.

    Returns
    -------
    MethodStep or None
        None where fewer than :data:`LEAST_RUNS` runs count.
    """
    from scipy.special import stdtrit

    settings = settings or MonitorSettings()
    differences = []
    for run, other in pairs:
        if run.quality.verdict != "good" or other.quality.verdict != "good":
            continue
        before, after = frequency_table(run), frequency_table(other)
        if len(before.frequency) and len(after.frequency) and paired_cells(after, before)[0]:
            _, fused = fused_change(after, before, model, settings)
            differences.append(fused.level)
    count = len(differences)
    if count < LEAST_RUNS:
        return None
    spread = float(np.std(differences, ddof=1)) * float(stdtrit(count - 1, 0.975)) / NORMAL_95
    return MethodStep(float(np.mean(differences)), spread / math.sqrt(count), count)
