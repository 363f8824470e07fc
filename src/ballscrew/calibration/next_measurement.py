"""Expected uncertainty of share and preload after one more measurement."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from ballscrew.axis.axial import PARAMETERS, gradient
from ballscrew.axis.axial_prior import KNOWN_PRELOAD
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.calibration.anchors import LEVELS
from ballscrew.calibration.covariance import (
    FLOOR,
    ExperimentVariation,
    error_correlation,
    experiment_effects,
    relative_covariance,
    with_repeating_load,
    worn_nut_slopes,
)
from ballscrew.calibration.fit import SIZE, Fit
from ballscrew.calibration.frequency_table import FrequencyTable
from ballscrew.calibration.identifiability import covariance_by_rows
from ballscrew.calibration.preparation import CalibrationInput

# Distance of an additional stop beyond the outer ones, as a part of the distance between these; and its least
# value, as a part of that: a nearer stop is not an additional one.
_EXTENSION = 0.25
_LEAST_EXTENSION = 0.2
_SHARE, _PRELOAD, _MASS = (PARAMETERS.index(name) for name in ("share", "preload", "mass"))


def next_measurements(
    prepared: CalibrationInput, fit: Fit, scale: float, sheet: DataSheet
) -> tuple[dict[str, object], ...]:
    """Expected uncertainties after each of several possible measurements.

    Parameters
    ----------
    prepared, fit : CalibrationInput, Fit
        The calibration; a new run is assumed to be as good as the one with the heaviest load.
    scale : float
        Factor on the variances of the frequencies, which is assumed for new ones too.
    sheet : DataSheet
        For the travel of the axis.

    Returns
    -------
    tuple of dict
        ``kind``, ``what``, and the expected relative standard uncertainties ``share``, ``log_preload`` and
        ``mass``. The first is the present state.
    """
    heaviest = max(prepared.runs, key=lambda run: run.load)
    heavier = max(2 * heaviest.load, heaviest.load + 0.5 * fit.model.mass)  # kg
    heavier_run = replace(heaviest, id="", load=heavier)
    options = {"as it is": fit.covariance}
    name = f"one more load, {heavier:.3g} kg, if the machine can carry it"
    options[name] = _with_run(prepared, fit, scale, heavier_run)
    name = "the known preload of these runs, ±2 %"
    options[name] = _with_known_preload(fit, KNOWN_PRELOAD)
    name = "the known preload of these runs and a run at a known half of it, ±2 % each"
    options[name] = _with_half_preload(fit, heaviest, prepared.variation)
    name = f"two acceleration levels, which determine the preload to ±{100 * LEVELS:.0f} %"
    options[name] = _with_known_preload(fit, LEVELS)
    stop = next_stop(heaviest.position, sheet)
    if stop is not None:
        name = f"one more run with {heaviest.load:g} kg and another stop, at {1e3 * stop:.0f} mm"
        options[name] = _with_run(prepared, fit, scale, with_stop(heaviest, stop))
    found: list[dict[str, object]] = []
    for name, covariance in options.items():
        spread = np.sqrt(np.diag(covariance))
        share = float(spread[_SHARE] * (1 - fit.model.share))  # relative, from that of the logit
        preload, mass = float(spread[_PRELOAD]), float(spread[_MASS])
        found.append({"kind": "offer", "what": name, "share": share, "log_preload": preload, "mass": mass})
    return tuple(found)


def next_stop(position: Array, sheet: DataSheet) -> float | None:
    """Position of one more stop, beyond the outer ones.

    Parameters
    ----------
    position : ndarray, shape (n,)
        Of the cells, m.
    sheet : DataSheet
        Ends of the screw, and limits of the machine.

    Returns
    -------
    float or None
        m, within the soft limits, or one distance between stops from the screw's ends where the sheet has
        none; None where the stops fill the travel.
    """
    stops = np.unique(np.round(position, 6))
    if len(stops) < 2:
        return None
    reach, spacing = _EXTENSION * float(np.ptp(stops)), float(np.diff(stops).min())
    low, high = sheet.limits.lowest_position, sheet.limits.highest_position
    if low is None:
        low = -sheet.screw.bearing_to_zero + spacing
    if high is None:
        high = sheet.travel_limit - spacing
    below, above = min(stops[0] - low, reach), min(high - stops[-1], reach)
    if max(below, above) < _LEAST_EXTENSION * reach:
        return None
    if above >= below:
        return float(stops[-1] + above)
    return float(stops[0] - below)


def with_stop(run: FrequencyTable, position: float) -> FrequencyTable:
    """The run with an additional stop, its cells like those of the nearest stop.

    Shared errors are extrapolated by a straight line along the axis: those of a run are a level and a tilt.

    Parameters
    ----------
    run : FrequencyTable
        At two stops or more.
    position : float
        m.

    Returns
    -------
    FrequencyTable
        With more cells, and no id.
    """
    nearest = run.position[np.argmin(np.abs(run.position - position))]
    cells = np.flatnonzero(run.position == nearest)
    basis = np.stack([np.ones_like(run.position), run.position - position], axis=1)
    lines = np.linalg.lstsq(basis, (run.shared / run.frequency).T, rcond=None)[0]
    shared = lines[0][:, None] * run.frequency[cells]  # at the new stop, where the second column is 0
    return replace(
        run,
        id="",
        position=np.append(run.position, np.full(len(cells), position)),
        condition=(*run.condition, *(run.condition[i] for i in cells)),
        motion=(*run.motion, *(run.motion[i] for i in cells)),
        frequency=np.append(run.frequency, run.frequency[cells]),
        own=np.append(run.own, run.own[cells]),
        shared=np.concatenate([run.shared, shared], axis=1),
    )


def _with_known_preload(fit: Fit, spread: float) -> Array:
    """Covariance of the unknowns after a known P_ref of this relative standard uncertainty."""
    row = np.zeros((1, len(fit.unknown)))
    row[0, _PRELOAD] = 1.0
    return _update_covariance(fit.covariance, row, np.array([[spread**2]]))


def _with_run(prepared: CalibrationInput, fit: Fit, scale: float, run: FrequencyTable) -> Array:
    """Covariance of the unknowns after one more run, at the preload of that with the heaviest load."""
    problem, variation = fit.problem, prepared.variation
    group = prepared.groups[int(np.argmax([other.load for other in prepared.runs]))]
    runs, groups = [*prepared.runs, run], [*prepared.groups, group]
    cells = scale * relative_covariance(runs, groups, fit.model, variation)
    ratio = float(np.exp(np.pad(fit.unknown[SIZE:], (1, 0))[group]))
    gradients = gradient(fit.model, run.position, run.load, ratio)
    slopes = np.zeros((len(run.frequency), len(fit.unknown)))
    slopes[:, :SIZE] = gradients[:, :SIZE]
    if group:
        slopes[:, SIZE + group - 1] = gradients[:, SIZE] + worn_nut_slopes([run], variation.assumptions)
    all_slopes = np.vstack([problem.jacobian(fit.unknown), slopes])
    # The rows are the cells and anchors of the fit, then the cells of the run; ``cells`` has no anchors.
    old, n = len(problem.observed), len(problem.position)
    covariance = block_diag(problem.covariance, cells[n:, n:])
    covariance[:n, old:], covariance[old:, :n] = cells[:n, n:], cells[n:, :n]
    # The blocks are by the model before and after the calibration: the joint matrix need not be positive.
    values, vectors = np.linalg.eigh(covariance)
    covariance = vectors * np.maximum(values, 1e-12 * values.max()) @ vectors.T
    return covariance_by_rows(fit.directions, all_slopes, covariance)


def _with_half_preload(fit: Fit, run: FrequencyTable, variation: ExperimentVariation) -> Array:
    """Covariance of the unknowns after a run at half of P_ref, with both preloads known.

    Its rows are the changes of ln f from the reference to half of it, which errors that repeat hardly affect.
    """
    model = fit.model
    now = gradient(model, run.position, run.load, 1.0)
    half = gradient(model, run.position, run.load, 0.5)
    repeats = with_repeating_load(run).repeats
    correlation = [error_correlation(name, variation.assumptions.repeats) for name in run.shared_names]
    # Variance of a difference: twice that of one run, less what repeats in both.
    shared = run.shared * np.sqrt(2 * (1 - np.where(repeats, correlation, 0.0)))[:, None]
    noise = (shared.T @ shared + 2 * np.diag(run.own**2)) / np.outer(run.frequency, run.frequency)
    for effect in experiment_effects(run, model, variation, math.log(0.5)):
        noise += np.outer(effect, effect)
    noise += FLOOR**2 * np.eye(len(noise))
    by_ratio = half[:, SIZE] + worn_nut_slopes([run], variation.assumptions)
    noise += 2 * KNOWN_PRELOAD**2 * np.outer(by_ratio, by_ratio)  # error of the ratio of both preloads
    slopes = np.zeros((len(half), len(fit.unknown)))
    slopes[:, :SIZE] = half[:, :SIZE] - now[:, :SIZE]
    return _update_covariance(_with_known_preload(fit, KNOWN_PRELOAD), slopes, noise)


def _update_covariance(covariance: Array, slopes: Array, noise: Array) -> Array:
    """Covariance of the unknowns after additional rows, with ``noise`` the covariance of these."""
    gain = covariance @ slopes.T
    return np.asarray(covariance - gain @ np.linalg.solve(slopes @ gain + noise, gain.T))
