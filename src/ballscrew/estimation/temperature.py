"""Effect of the axis's temperature on its preload: fitted to baselines, or assumed, and corrected.

ln P of a run against the first baseline changes in proportion to the difference of their temperatures; the
factor is called the slope. Its prior is that of the calibration, where its runs determine one; further
baselines are added (:func:`~ballscrew.calibration.temperature.fit_temperature_slope`). The run that is
corrected is compared with the same baseline, so its error and that of the slope are correlated; the
covariance is returned too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ballscrew.base.errors import shown
from ballscrew.base.quantity import NORMAL_95
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.frequency_table import FrequencyTable
from ballscrew.calibration.temperature import TemperatureSlope, fit_temperature_slope
from ballscrew.modal.run import Run

_PER_KELVIN = 0.028  # of P by a screw warmer than its nut: 14 % by 5 K (page on imitations)
_WARMER = 2.0  # K, which is 5.6 % of P: about the half-width of a good interval
# Temperature difference of a run outside the baselines' range, over the range: more is reported.
_EXTRAPOLATION = 1.0


@dataclass(frozen=True, slots=True)
class TemperatureCorrection:
    """Correction of one run's ln P.

    Parameters
    ----------
    shift, spread : float
        Change of ln P by the temperature, to be subtracted, and its standard uncertainty.
    shared : float
        Covariance of the errors of ``-shift`` and of the first baseline's ln P.
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


def temperature_correction(
    difference: float | None,
    log_ratios: Sequence[tuple[float, float]],
    temperatures: Sequence[float],
    assumptions: Assumptions,
    baseline_spread: float = 0.0,
    *,
    prior: TemperatureSlope | None = None,
    within: float = 0.0,
) -> TemperatureCorrection:
    """Correction of a run that is compared with a baseline.

    Parameters
    ----------
    difference : float or None
        The run's temperature less the first baseline's, K; None where either was not recorded.
    log_ratios, temperatures, baseline_spread
        As for :func:`~ballscrew.calibration.temperature.fit_temperature_slope`.
    assumptions : Assumptions
        Slope of 0 ± ``temperature`` where there is no prior, and a temperature that was not recorded.
    prior : TemperatureSlope, optional
        Of the calibration.
    within : float
        Standard deviation of the temperature within the runs, K.

    Returns
    -------
    TemperatureCorrection
        With its sentences.
    """
    start = prior or TemperatureSlope(0.0, max(assumptions.temperature, 1e-9))
    slope = fit_temperature_slope(log_ratios, temperatures, start, baseline_spread)
    size = math.hypot(slope.value, slope.standard_uncertainty)
    if difference is None:
        unknown = assumptions.temperature_unknown
        spread = unknown * size
        if not spread > 0:
            return NO_CORRECTION
        note = (
            "the temperature of the axis was not recorded in run or baseline: the interval allows for ± "
            f"{NORMAL_95 * unknown:.2g} K between the two"
        )
        return TemperatureCorrection(spread=spread, name="temperature (not recorded)", notes=(note,))
    shift = slope.value * difference
    corrections: tuple[str, ...] = ()
    if shift:
        corrections = (f"temperature: {-100 * shift:+.1f} % for {difference:+.1f} K",)
    return TemperatureCorrection(
        shift=shift,
        spread=math.hypot(slope.standard_uncertainty * difference, size * within),
        shared=-difference * slope.shared * baseline_spread**2,
        corrections=corrections,
        reasons=_extrapolation(difference, temperatures),
    )


def _extrapolation(difference: float, temperatures: Sequence[float]) -> tuple[str, ...]:
    """A sentence where a run is much warmer or colder than the runs of the fit."""
    low, high = min([0.0, *temperatures]), max([0.0, *temperatures])  # 0 is the first baseline
    outside = max(difference - high, low - difference)
    if not high > low or outside <= _EXTRAPOLATION * (high - low):
        return ()
    text = (
        f"the effect of the temperature was fitted between {low:+.1f} and {high:+.1f} K of the baseline's, "
        f"and the run is at {difference:+.1f} K: an extrapolation"
    )
    return (text,)


def temperature_notes(run: Run, baseline: Run | None) -> list[str]:
    """Sentences on sensors that are not where the preload is.

    Parameters
    ----------
    run, baseline : Run
        Analysed.

    Returns
    -------
    list of str
        Empty where the temperature was stated, or recorded at nut or screw.
    """
    notes = []
    for name, of in (("run", run), ("baseline", baseline)):
        course = of.temperature if of else None
        if of is None or course is None or course.is_of_axis or of.temperature_C != course.mean_C:
            continue
        place = shown(course.place) if course.place else "a place that the channel map does not state"
        notes.append(f"the temperature of the {name} was recorded at {place}, not at nut or screw")
    return notes


def warm_screw_doubts(run: FrequencyTable, baseline: FrequencyTable | None) -> list[str]:
    """A sentence where the screw was warmer or colder than its nut, other than in the baseline.

    Parameters
    ----------
    run, baseline : FrequencyTable
        With the temperature of the screw above that of the nut, where both were recorded.

    Returns
    -------
    list of str
        Empty where it is not known, or small.
    """
    if baseline is None or run.screw_excess is None:
        return []
    change = run.screw_excess - (baseline.screw_excess or 0.0)
    if abs(change) <= _WARMER:
        return []
    side, effect = ("warmer", "raises") if change > 0 else ("colder", "lowers")
    text = (
        f"the screw was {abs(change):.1f} K {side} against its nut than in the baseline, which {effect} the "
        f"preload by up to {100 * _PER_KELVIN * abs(change):.0f} % for as long as it lasts: repeat the run "
        "when both have one temperature"
    )
    return [text]
