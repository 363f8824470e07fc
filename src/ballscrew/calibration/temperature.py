"""Change of the preload with the temperature, fitted to runs of one day and preload."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ballscrew.axis.axial import PARAMETERS, AxialModel, frequency, gradient
from ballscrew.base.arrays import Array
from ballscrew.base.quantity import NORMAL_95
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import Doubt, TemperatureSlope
from ballscrew.calibration.fit import SIZE, Fit
from ballscrew.calibration.frequency_table import FrequencyTable

# Largest standard uncertainty of a slope, as a part of the prior's: with more the runs do not determine it.
_INFORMATIVE = 0.5
_ANY_LEVEL = 0.3  # standard deviation of ln f of an unknown level: more than any preload changes it
_PER_KELVIN = (
    0.028  # relative change of P by 1 K of the screw above its nut: 14 % by 5 K (page on imitations)
)
_WARMER = 2.0  # K, which is 5.6 % of P: about the half-width of a good interval


def fit_temperature_slope(
    changes: Array, temperatures: Array, covariance: Array, prior: TemperatureSlope
) -> TemperatureSlope:
    """Change of ln P per kelvin, by generalised least squares (Aitken, 1936).

    Parameters
    ----------
    changes : ndarray, shape (n,)
        Of ln P, or of a quantity that depends on it.
    temperatures : ndarray, shape (n,)
        Differences of temperature, K, times the derivative of this quantity by ln P.
    covariance : ndarray, shape (n, n)
        Of the changes.
    prior : TemperatureSlope
        Slope before these runs.

    Returns
    -------
    TemperatureSlope
        Its ``shared`` is the error by a unit error that is common to all changes.
    """
    weights = np.linalg.solve(covariance, temperatures)
    weight_of_prior = prior.standard_uncertainty**-2
    variance = 1 / (weight_of_prior + float(temperatures @ weights))
    slope = variance * (weight_of_prior * prior.value + float(weights @ changes))
    return TemperatureSlope(slope, math.sqrt(variance), shared=variance * float(weights.sum()))


def temperature_prior(assumptions: Assumptions) -> TemperatureSlope:
    """The slope before any run: 0 with the assumed standard uncertainty, 1/K."""
    return TemperatureSlope(0.0, max(assumptions.temperature, 1e-9))


def temperature_effects(
    runs: Sequence[FrequencyTable],
    groups: Sequence[int],
    model: AxialModel,
    log_ratios: Sequence[float] | Array = (),
) -> tuple[Array, Array]:
    """Effect on ln f of a slope of 1/K, by the temperature of each run less the mean of its group.

    Between groups wear and temperature cannot be separated, since each group has a preload of its own.

    Parameters
    ----------
    runs, groups : sequence
        Of n cells together; the group of each run's preload.
    model : AxialModel
        Gives the nut's share of the compliance.
    log_ratios : sequence of float
        ln(P/P_ref) of each group; 0 by default.

    Returns
    -------
    effects : ndarray, shape (n,)
        Temperature difference of the cell's run times ∂ ln f/∂ ln P, K.
    differences : ndarray, shape (runs,)
        Temperature difference of each run, K; 0 for a run without a temperature.
    """
    celsius = np.array([math.nan if run.temperature is None else run.temperature for run in runs])
    differences = np.zeros(len(runs))
    for group in set(groups):
        members = (np.asarray(groups) == group) & np.isfinite(celsius)
        if members.any():
            differences[members] = celsius[members] - celsius[members].mean()
    ratios = np.ones(len(runs))
    if len(log_ratios):
        ratios = np.exp(np.asarray(log_ratios)[list(groups)])
    effects = []
    for run, difference, ratio in zip(runs, differences, ratios, strict=True):
        effects.append(difference * gradient(model, run.position, run.load, ratio)[:, len(PARAMETERS)])
    return np.concatenate(effects), differences


def slope_of_runs(
    runs: Sequence[FrequencyTable], fit: Fit, error: Array, assumptions: Assumptions
) -> TemperatureSlope | None:
    """Change of ln P per kelvin by runs of one day, preload and load at different temperatures.

    Parameters
    ----------
    runs : sequence of FrequencyTable
        Of the calibration.
    fit : Fit
        Its fit.
    error : ndarray, shape (n,)
        Effect on ln f by one standard deviation of the prior's slope; the covariance of the fit contains this
        error, which is subtracted here.
    assumptions : Assumptions
        Prior of the slope; error of the position.

    Returns
    -------
    TemperatureSlope or None
        None where its uncertainty is more than half of the prior's, or where a run has no time: wear between
        the runs is then not excluded.
    """
    problem, prior = fit.problem, temperature_prior(assumptions)
    n, model = len(problem.position), fit.model
    log_ratios = np.pad(fit.unknown[SIZE:], (1, 0))
    effects, differences = temperature_effects(runs, problem.run_groups, model, log_ratios)
    if not differences.any() or any(run.measured_at is None for run in runs):
        return None
    slopes = problem.jacobian(fit.unknown)[:n]
    # Residual and covariance of ln f by the prior of the unknowns, as if they were not fitted.
    residual = fit.residual[:n] + slopes @ problem.deviation(fit.unknown)
    covariance = problem.covariance[:n, :n] + slopes @ problem.prior @ slopes.T - np.outer(error, error)
    # So that a wrong load is not taken for a temperature, each group and load has a level of its own.
    x, load = problem.position, problem.load
    alike = (problem.group[:, None] == problem.group) & (load[:, None] == load)
    covariance += _ANY_LEVEL**2 * alike
    # Each run has a zero of the position of its own.
    shift = np.log(frequency(model, x + assumptions.position, load) / frequency(model, x, load))
    covariance += np.where(problem.run[:, None] == problem.run, np.outer(shift, shift), 0.0)
    slope = fit_temperature_slope(residual, effects, covariance, prior)
    if slope.standard_uncertainty > _INFORMATIVE * prior.standard_uncertainty:
        return None
    used = [run.temperature for run, difference in zip(runs, differences, strict=True) if difference]
    celsius = [value for value in used if value is not None]
    return TemperatureSlope(
        slope.value, slope.standard_uncertainty, lowest=min(celsius), highest=max(celsius)
    )


def temperature_notes(
    runs: Sequence[FrequencyTable],
    groups: Sequence[int],
    slope: TemperatureSlope | None,
    assumptions: Assumptions,
) -> list[str]:
    """A note where the temperatures of days or preloads differ, and no runs determine the effect."""
    known = {(group, run.temperature) for run, group in zip(runs, groups, strict=True)}
    celsius = [value for _, value in known if value is not None]
    different = celsius and max(celsius) - min(celsius) > NORMAL_95 * assumptions.temperature_unknown
    if slope is not None or not different or len({group for group, _ in known}) < 2:
        return []
    text = (
        f"the temperatures of the runs differ by {max(celsius) - min(celsius):.0f} K, and between days or "
        "preloads their effect looks like wear: analyse two runs of one load and day, one warm"
    )
    return [text]


def warm_screw_doubts(runs: Sequence[FrequencyTable]) -> list[Doubt]:
    """Doubts of a calibration with runs whose screw was warmer or colder than its nut."""
    doubts = []
    for run in runs:
        texts = describe_warm_screw(f"than its nut in run {run.id[:12]}", run.screw_excess)
        doubts += [Doubt("warm-screw", text) for text in texts]
    return doubts


def describe_warm_screw(compared: str, excess: float | None) -> list[str]:
    """A sentence on a screw that is warmer or colder than its nut by more than 2 K.

    Parameters
    ----------
    compared : str
        What the screw is compared with, and in which run: "than its nut in the run".
    excess : float or None
        Temperature of the screw above that of the nut, K; None where it was not recorded.

    Returns
    -------
    list of str
        Empty where it is small, or not known.
    """
    if excess is None or abs(excess) <= _WARMER:
        return []
    side, effect = ("warmer", "raises") if excess > 0 else ("colder", "lowers")
    text = (
        f"the screw was {abs(excess):.1f} K {side} {compared}, which {effect} the preload by up to "
        f"{100 * _PER_KELVIN * abs(excess):.0f} % for as long as it lasts: repeat the run when both have one "
        "temperature"
    )
    return [text]
