"""Effect of the axis's temperature on its preload: fitted to baselines, or assumed, and corrected.

The change of ln P since the first baseline is in proportion to the difference of the temperatures; the factor
is called the slope. Its prior is that of the calibration, if the calibration's runs determine one, and it is
fitted to further baselines (:func:`~ballscrew.calibration.temperature.fit_temperature_slope`). These and the
run are compared with the first baseline, so the errors of the slope and of the run's change both contain the
error of this baseline. Their covariance is part of the correction.
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
        Covariance of ``-shift`` and ln(P/P₀) by the error of the first baseline, which both contain.
    name : str
        Printed name of this term of the uncertainty.
    corrections, reasons, notes : tuple of str
        Sentences for the fields of the same names of the estimate.
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
    """Changes of further baselines against the first one.

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

    The support bearing changes from day to day: its change is common to baselines of one day, and 0 on the
    day of the first baseline.

    Parameters
    ----------
    base : FrequencyTable
        The first baseline; its temperature is known if there are others.
    others : sequence of FrequencyTable
        The further ones, of known temperature, each with cells in common with the first.
    change_of : callable
        Change of the compliance of one of them since the first.
    assumptions : Assumptions
        With the change of the bearing between days.

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
        noise, _ = fused.terms.get(BASELINE, no_term)
        repeating, _ = fused.terms.get(BASELINE_PART, no_term)
        by_base = math.hypot(noise, repeating)
        own = math.sqrt(max(fused.spread**2 - by_base**2, _LEAST_SPREAD**2))
        by_bearing = assumptions.bearing_daily_drift / NORMAL_95 * bearing_over_nut(change, fused)
        spreads = [fused.log_preload_spread(spread) for spread in (own, by_base, by_bearing)]
        rows.append([fused.log_ratio, *spreads])
    changes, own_spreads, base_spreads, bearing_spreads = np.array(rows).reshape(-1, 4).T
    every = [base, *others]
    # Without known preloads the runs of a day are a group.
    days = np.array(preload_groups([run.id for run in every], [run.measured_at for run in every], {}))
    same_day = (days[1:, None] == days[1:]) & (days[1:] != days[0])
    # The error of the first baseline is common to all; the others give about the same value of it, of which
    # the largest is used.
    baseline_spread = float(base_spreads.max(initial=0.0))
    covariance = np.diag(own_spreads**2) + baseline_spread**2
    covariance += np.where(same_day, np.outer(bearing_spreads, bearing_spreads), 0.0)
    differences = [(run.temperature or 0.0) - (base.temperature or 0.0) for run in others]
    return FurtherBaselines(changes, np.array(differences), covariance, baseline_spread)


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
        With ``temperature``, the standard deviation of a slope that no run determines, 1/K, and
        ``temperature_unknown``, that of a difference of temperatures that was not recorded, K.
    prior : TemperatureSlope, optional
        Slope of the calibration.
    within : float
        Standard deviation of the temperature within run and baseline together, K.

    Returns
    -------
    TemperatureCorrection
        Of the run, with its sentences.
    """
    if prior is None:
        prior = temperature_prior(assumptions)
    slope = prior
    if len(baselines.changes):
        slope = fit_temperature_slope(baselines.changes, baselines.differences, baselines.covariance, prior)
    # A random difference of temperatures with mean 0 changes ln P by its standard deviation times this.
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
    if prior.lowest is not None and prior.highest is not None:
        fitted += [prior.lowest - reference, prior.highest - reference]
    # An error of the first baseline changes ln P of the run and of all baselines against it alike, and so the
    # slope that is fitted to these: by ``slope.shared`` for a unit of ln P.
    return TemperatureCorrection(
        shift=shift,
        spread=math.hypot(slope.standard_uncertainty * difference, rms_slope * within),
        shared=-difference * slope.shared * baselines.baseline_spread**2,
        corrections=corrections,
        reasons=_extrapolation(difference, fitted),
    )


def _extrapolation(difference: float, temperatures: Sequence[float]) -> tuple[str, ...]:
    """A sentence where run or first baseline is much warmer or colder than the runs of the fit; else none.

    ``difference`` is the temperature of the run minus that of the first baseline, K; ``temperatures`` are
    those of the runs of the fit, likewise.
    """
    if not temperatures or not difference:
        return ()
    low, high = min(temperatures), max(temperatures)
    outside = max(difference - high, low - difference, -high, low)  # of the run, and of the baseline at 0
    if not high > low or outside <= _EXTRAPOLATION * (high - low):
        return ()
    text = f"the effect of the temperature was fitted at {low:+.1f} to {high:+.1f} K from the baseline"
    if low <= difference <= high:
        return (f"{text}, which is outside this range: an extrapolation",)
    return (f"{text}, and the run is at {difference:+.1f} K: an extrapolation",)


def temperature_notes(run: Run, baseline: Run | None) -> list[str]:
    """Sentences on temperature sensors that are missing, or not at nut or screw.

    Parameters
    ----------
    run : Run
        Analysed.
    baseline : Run or None
        Likewise.

    Returns
    -------
    list of str
        Empty where each temperature was stated by the user, or recorded at nut or screw, and both or none of
        the runs have temperatures of screw and nut.
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
        if each.temperature_C != course.mean_C:  # stated by the user, not recorded
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
    run : FrequencyTable
        With the temperature of the screw above that of the nut, where both were recorded.
    baseline : FrequencyTable or None
        Likewise.
    calibrated : bool
        Whether the baseline is a run of the calibration: P/P₀ and newtons then both refer to it, and only the
        difference of the two runs counts.

    Returns
    -------
    list of str
        Empty where the difference of screw and nut is not known or small.
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
