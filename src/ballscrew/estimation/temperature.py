"""Effect of the axis's temperature on its preload: fitted to baselines, or assumed, and corrected.

ln P of a run against the first baseline changes in proportion to the difference of their temperatures; the
factor is called the slope. All further baselines are compared with the first one, so its error is common to
them: the slope is fitted by generalised least squares with this common error (Aitken, 1936). The run that is
corrected is compared with the same baseline, so its error and that of the slope are correlated; the
covariance is returned too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.base.quantity import NORMAL_95
from ballscrew.calibration.assumptions import Assumptions

_LEAST_SPREAD = 1e-6  # standard uncertainty of ln P: keeps the covariance regular
# Temperature difference of a run outside the baselines' range, over the range: more is reported.
_EXTRAPOLATION = 1.0


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


def fit_temperature_slope(
    log_ratios: Sequence[tuple[float, float]],
    temperatures: Sequence[float],
    assumptions: Assumptions,
    baseline_spread: float = 0.0,
) -> TemperatureSlope:
    """Change of ln P per kelvin, fitted to runs without wear between them.

    Parameters
    ----------
    log_ratios : sequence of (float, float)
        ln P of each run against the first, with its own standard uncertainty.
    temperatures : sequence of float
        Of each run less the first's, K.
    assumptions : Assumptions
        Prior of the slope: 0 ± ``temperature``.
    baseline_spread : float
        Standard uncertainty of ln P by the first run's error, common to all ratios.

    Returns
    -------
    TemperatureSlope
        With the part of its error that is the first run's.
    """
    prior = max(assumptions.temperature, 1e-9)
    if not log_ratios:
        return TemperatureSlope(0.0, prior)
    values, spreads = np.array(log_ratios, dtype=np.float64).T
    differences = np.array(temperatures, dtype=np.float64)
    covariance = np.diag(np.maximum(spreads, _LEAST_SPREAD) ** 2) + baseline_spread**2
    weights = np.linalg.solve(covariance, differences)
    variance = 1 / (1 / prior**2 + float(differences @ weights))
    slope = variance * float(weights @ values)
    # The first run's error adds to every ratio alike.
    return TemperatureSlope(slope, math.sqrt(variance), shared=variance * float(weights.sum()))


def temperature_correction(
    difference: float | None,
    log_ratios: Sequence[tuple[float, float]],
    temperatures: Sequence[float],
    assumptions: Assumptions,
    baseline_spread: float = 0.0,
) -> TemperatureCorrection:
    """Correction of a run that is compared with a baseline.

    Parameters
    ----------
    difference : float or None
        The run's temperature less the first baseline's, K; None where either was not recorded.
    log_ratios, temperatures, assumptions, baseline_spread
        As for :func:`fit_temperature_slope`.

    Returns
    -------
    TemperatureCorrection
        With its sentences.
    """
    slope = fit_temperature_slope(log_ratios, temperatures, assumptions, baseline_spread)
    if difference is None:
        unknown = assumptions.temperature_unknown
        spread = unknown * math.hypot(slope.value, slope.standard_uncertainty)
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
        spread=slope.standard_uncertainty * abs(difference),
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
