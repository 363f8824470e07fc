"""Change of the preload with the temperature, fitted to runs without wear between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.axis.axial import AxialModel, gradient
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.frequency_table import FrequencyTable, paired_cells

_LEAST_SPREAD = 1e-6  # standard uncertainty of ln P: keeps the covariance regular
_INFORMATIVE = 0.5  # of the prior's standard uncertainty: runs that leave more determine no slope


@dataclass(frozen=True, slots=True)
class TemperatureSlope:
    """Change of ln P per kelvin.

    Parameters
    ----------
    value, standard_uncertainty : float
        1/K.
    shared : float
        Error of the slope per unit of the first baseline's error in ln P, 1/K.
    """

    value: float
    standard_uncertainty: float
    shared: float = 0.0


def fit_temperature_slope(
    log_ratios: Sequence[tuple[float, float]],
    temperatures: Sequence[float],
    prior: TemperatureSlope,
    baseline_spread: float = 0.0,
) -> TemperatureSlope:
    """Change of ln P per kelvin, fitted to runs without wear between them.

    All runs are compared with the first one, so its error is common to them: generalised least squares with
    this common error (Aitken, 1936).

    Parameters
    ----------
    log_ratios : sequence of (float, float)
        ln P of each run against the first, with its own standard uncertainty.
    temperatures : sequence of float
        Of each run less the first's, K.
    prior : TemperatureSlope
        Before these runs.
    baseline_spread : float
        Standard uncertainty of ln P by the first run's error, common to all ratios.

    Returns
    -------
    TemperatureSlope
        With the part of its error that is the first run's.
    """
    if not log_ratios:
        return prior
    values, spreads = np.array(log_ratios, dtype=np.float64).T
    differences = np.array(temperatures, dtype=np.float64)
    covariance = np.diag(np.maximum(spreads, _LEAST_SPREAD) ** 2) + baseline_spread**2
    weights = np.linalg.solve(covariance, differences)
    weight_of_prior = prior.standard_uncertainty**-2
    variance = 1 / (weight_of_prior + float(differences @ weights))
    slope = variance * (weight_of_prior * prior.value + float(weights @ values))
    # The first run's error adds to every ratio alike.
    return TemperatureSlope(slope, math.sqrt(variance), shared=variance * float(weights.sum()))


def slope_of_runs(
    runs: Sequence[FrequencyTable], model: AxialModel, assumptions: Assumptions
) -> TemperatureSlope | None:
    """Change of ln P per kelvin by runs of one preload at different temperatures.

    Runs are compared with the first of the same load, cell by cell, so that errors that repeat cancel and
    loads are not mistaken for temperatures.

    Parameters
    ----------
    runs : sequence of FrequencyTable
        Without wear between them.
    model : AxialModel
        Gives the nut's share of the compliance.
    assumptions : Assumptions
        Prior of the slope, and correlation of errors that repeat.

    Returns
    -------
    TemperatureSlope or None
        None where the runs do not determine it better than by half of the prior's uncertainty.
    """
    prior = TemperatureSlope(0.0, max(assumptions.temperature, 1e-9))
    slope = prior
    measured = [run for run in runs if run.temperature is not None]
    for load in sorted({run.load for run in measured}):
        first, *others = [run for run in measured if run.load == load]
        ratios, differences, baseline_spread = [], [], 0.0
        for run in others:
            rows, first_rows = paired_cells(run, first)
            if not rows:
                continue
            sensitivity = float(gradient(model, run.position[rows], load)[:, -1].mean())
            change = float(np.log(run.frequency[rows] / first.frequency[first_rows]).mean())
            ratios.append((change / sensitivity, _spread(run, rows, assumptions) / sensitivity))
            differences.append((run.temperature or 0.0) - (first.temperature or 0.0))
            baseline_spread = max(baseline_spread, _spread(first, first_rows, assumptions) / sensitivity)
        slope = fit_temperature_slope(ratios, differences, slope, baseline_spread)
    if slope.standard_uncertainty > _INFORMATIVE * prior.standard_uncertainty:
        return None
    return TemperatureSlope(slope.value, slope.standard_uncertainty)


def _spread(run: FrequencyTable, rows: list[int], assumptions: Assumptions) -> float:
    """Standard uncertainty of the mean of ln f, without what repeats in another run."""
    f = run.frequency[rows]
    shared = (run.shared[:, rows] / f).mean(axis=1)
    shared = shared * np.where(run.repeats, math.sqrt(1 - assumptions.repeats), 1.0)
    own = np.linalg.norm(run.own[rows] / f) / len(rows)
    return float(np.sqrt(shared @ shared + own**2 + assumptions.floor**2))
