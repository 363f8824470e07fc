"""Effect of the axis's temperature on its preload: fitted to baselines, or assumed, and corrected.

ln P of a run against the first baseline changes in proportion to the difference of their temperatures; the
factor is called the slope. Its prior is that of the calibration, where its runs determine one; further
baselines are added (:func:`~ballscrew.calibration.temperature.fit_temperature_slope`). The slope is fitted
against the first baseline, and the run is compared with it too, so the errors of both contain that of this
baseline and are correlated; their covariance is returned.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import shown
from ballscrew.base.quantity import NORMAL_95
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import TemperatureSlope
from ballscrew.calibration.frequency_table import FrequencyTable
from ballscrew.calibration.preload_groups import preload_groups
from ballscrew.calibration.temperature import (
    describe_warm_screw,
    fit_temperature_slope,
    temperature_prior,
)
from ballscrew.estimation.change import ComplianceChange
from ballscrew.estimation.compliance import BASELINE, BASELINE_PART
from ballscrew.estimation.fusion import fuse
from ballscrew.estimation.nut import bearing_over_nut
from ballscrew.modal.run import Run

# Distance of a temperature from the range of those fitted, over that range, above which an extrapolation is
# reported.
_EXTRAPOLATION = 1.0
_LEAST_SPREAD = 1e-4  # least standard uncertainty of u of a run


@dataclass(frozen=True, slots=True)
class TemperatureCorrection:
    """Correction of one run's ln P.

    Parameters
    ----------
    shift, spread : float
        Change of ln P by the temperature, to be subtracted, and its standard uncertainty.
    shared : float
        Covariance of the errors of ``-shift`` and of ln(P/P₀) by the errors of the first baseline.
    name : str
        Of this term of the uncertainty, as printed.
    corrections, reasons, notes : tuple of str
        Sentences for the fields of these names of the estimate.
    """

    shift: float = 0.0
    spread: float = 0.0
    shared: float = 0.0
    name: str = "temperature"
    corrections: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


NO_CORRECTION = TemperatureCorrection()


@dataclass(frozen=True, slots=True, eq=False)
class FurtherBaselines:
    """Further baselines against the first one.

    Parameters
    ----------
    changes : ndarray, shape (n,)
        ln P of each less that of the first.
    differences : ndarray, shape (n,)
        Temperature of each less that of the first, K.
    covariance : ndarray, shape (n, n)
        Of the changes.
    baseline_spread : float
        Standard uncertainty of ln P by the errors of the first baseline alone; its square is part of every
        element of ``covariance``.
    """

    changes: Array
    differences: Array
    covariance: Array
    baseline_spread: float = 0.0


def further_baselines(
    base: FrequencyTable,
    others: Sequence[FrequencyTable],
    change_of: Callable[[FrequencyTable], ComplianceChange],
    assumptions: Assumptions,
) -> FurtherBaselines:
    """Changes of ln P of further baselines against the first.

    The support bearing drifts from day to day; baselines of one day share its drift, and those of the first
    baseline's day have none.

    Parameters
    ----------
    base : FrequencyTable
        The first baseline, of known temperature.
    others : sequence of FrequencyTable
        The further ones, of known temperature, with cells in common.
    change_of : callable
        Change of the compliance of one of them since the first.
    assumptions : Assumptions
        Drift of the bearing between days.

    Returns
    -------
    FurtherBaselines
        Empty without others.
    """
    rows = []
    for other in others:
        change = change_of(other)
        fused = fuse(change)
        # Standard deviations of u by the first baseline, by the other's own errors, and by the bearing.
        no_term = (0.0, False)
        noise, repeating = fused.terms.get(BASELINE, no_term)[0], fused.terms.get(BASELINE_PART, no_term)[0]
        by_base = math.hypot(noise, repeating)
        own = math.sqrt(max(fused.spread**2 - by_base**2, _LEAST_SPREAD**2))
        drift = assumptions.bearing_daily_drift / NORMAL_95 * bearing_over_nut(change, fused)
        rows.append((fused.log_ratio, *map(fused.log_preload_spread, (own, by_base, drift))))
    changes, own_spreads, base_spreads, drifts = np.array(rows).reshape(-1, 4).T
    every = [base, *others]
    # Groups without known preloads are days.
    days = np.array(preload_groups([run.id for run in every], [run.measured_at for run in every], {}))
    same_day = (days[1:, None] == days[1:]) & (days[1:] != days[0])
    baseline_spread = float(base_spreads.max(initial=0.0))
    covariance = np.diag(own_spreads**2) + baseline_spread**2
    covariance += np.where(same_day, np.outer(drifts, drifts), 0.0)
    celsius = [(run.temperature or 0.0) - (base.temperature or 0.0) for run in others]
    return FurtherBaselines(changes, np.array(celsius), covariance, baseline_spread)


def temperature_correction(
    temperature: float | None,
    reference: float | None,
    baselines: FurtherBaselines,
    assumptions: Assumptions,
    *,
    prior: TemperatureSlope | None = None,
    within: float = 0.0,
) -> TemperatureCorrection:
    """Correction of a run that is compared with a baseline.

    Parameters
    ----------
    temperature, reference : float or None
        Of the run and of the first baseline, °C; None where it was not recorded.
    baselines : FurtherBaselines
        Further baselines, to which the effect of the temperature is fitted.
    assumptions : Assumptions
        ``temperature``, the spread of a slope without prior; ``temperature_unknown``, that of a difference
        that was not recorded.
    prior : TemperatureSlope, optional
        Slope of the calibration.
    within : float
        Standard deviation of the temperature within run and baseline together, K.

    Returns
    -------
    TemperatureCorrection
        With its sentences.
    """
    start = prior or temperature_prior(assumptions)
    slope = start
    if len(baselines.changes):
        slope = fit_temperature_slope(baselines.changes, baselines.differences, baselines.covariance, start)
    rms_slope = math.hypot(slope.value, slope.standard_uncertainty)
    if temperature is None or reference is None:
        unknown = assumptions.temperature_unknown
        spread = unknown * rms_slope
        if not spread > 0:
            return NO_CORRECTION
        note = (
            "the temperature of the axis was not recorded in run or baseline: the interval allows for ± "
            f"{NORMAL_95 * unknown:.2g} K between the two"
        )
        return TemperatureCorrection(spread=spread, name="temperature (not recorded)", notes=(note,))
    difference = temperature - reference
    shift = slope.value * difference
    corrections: tuple[str, ...] = ()
    if shift:
        corrections = (f"temperature: {-100 * shift:+.1f} % for {difference:+.1f} K",)
    # Temperatures to which the slope was fitted, less the first baseline's, K.
    fitted = [float(value) for value in baselines.differences]
    if fitted:
        fitted.append(0.0)
    if start.lowest is not None and start.highest is not None:
        fitted += [start.lowest - reference, start.highest - reference]
    return TemperatureCorrection(
        shift=shift,
        spread=math.hypot(slope.standard_uncertainty * difference, rms_slope * within),
        shared=-difference * slope.shared * baselines.baseline_spread**2,
        corrections=corrections,
        reasons=_extrapolation(difference, fitted),
    )


def _extrapolation(difference: float, temperatures: Sequence[float]) -> tuple[str, ...]:
    """A sentence where run or baseline is much warmer or colder than the runs of the fit.

    Temperatures are differences from the first baseline, K.
    """
    if not temperatures or not difference:
        return ()
    low, high = min(temperatures), max(temperatures)
    outside = max(difference - high, low - difference, -high, low)  # of the run, and of the baseline at 0
    if not high > low or outside <= _EXTRAPOLATION * (high - low):
        return ()
    text = f"the effect of the temperature was fitted between {low:+.1f} and {high:+.1f} K of the baseline's"
    if low <= difference <= high:
        return (f"{text}, which lies outside: an extrapolation",)
    return (f"{text}, and the run is at {difference:+.1f} K: an extrapolation",)


def temperature_notes(run: Run, baseline: Run | None) -> list[str]:
    """Sentences on sensors that are missing, or not where the preload is.

    Parameters
    ----------
    run, baseline : Run
        Analysed.

    Returns
    -------
    list of str
        Empty where the temperature was stated, or recorded at nut or screw, and the screw's in both or none.
    """
    notes = []
    with_screw = [_has_screw(each) for each in (run, baseline) if each is not None]
    if any(with_screw) and not all(with_screw):
        name = "baseline" if with_screw[0] else "run"
        notes.append(f"the {name} has no temperature of screw and nut: they are assumed to have been equal")
    for name, each in (("run", run), ("baseline", baseline)):
        course = each.temperature if each else None
        if each is None or course is None or course.is_of_axis:
            continue
        if each.temperature_C != course.mean_C:  # it was stated
            continue
        place = shown(course.place) if course.place else "a place that the channel map does not state"
        notes.append(f"the temperature of the {name} was recorded at {place}, not at nut or screw")
    return notes


def _has_screw(run: Run) -> bool:
    """Whether the temperatures of both screw and nut were recorded."""
    return run.temperature is not None and run.temperature.screw_above_nut_K is not None


def warm_screw_doubts(run: FrequencyTable, baseline: FrequencyTable | None, *, calibrated: bool) -> list[str]:
    """Sentences where the screw was warmer or colder than its nut.

    Parameters
    ----------
    run, baseline : FrequencyTable
        With the temperature of the screw above that of the nut, where both were recorded.
    calibrated : bool
        Whether the baseline is a run of the calibration: P/P₀ and newtons then both refer to it, and only the
        difference of the two runs counts.

    Returns
    -------
    list of str
        Empty where it is not known, or small.
    """
    excess, of_baseline = run.screw_excess, None
    if baseline is not None:
        of_baseline = baseline.screw_excess
    doubts = []
    if excess is None or of_baseline is None or not calibrated:
        doubts += describe_warm_screw("than its nut in the run", excess)
        doubts += describe_warm_screw("than its nut in the baseline", of_baseline)
    if excess is not None and of_baseline is not None:
        doubts += describe_warm_screw("against its nut than in the baseline", excess - of_baseline)
    return doubts
