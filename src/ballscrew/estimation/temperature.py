"""What the axis's temperature does to its preload: learned from baselines, or believed, and taken out.

ln P of a run against the first baseline grows by a slope times the difference of their temperatures. All
baselines share the first one's own error, and so does the run that is corrected: the slope is a generalised
least-squares fit with that one error common to all (Aitken, 1936), and what it takes of it is told.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.calibration.assumptions import Assumptions

__all__ = ["NO_WARMTH", "Slope", "Warmth", "warmed", "warmth"]

_LEAST = 1e-6  # ln P: an error that nobody has
_FAR = 1.0  # of the temperatures that taught the slope, by which a run may lie beyond them


@dataclass(frozen=True, slots=True)
class Slope:
    """ln P by a kelvin.

    Parameters
    ----------
    value, standard_uncertainty : float
        1/K.
    shared : float
        How much of the first baseline's own error in ln P the slope takes up, 1/K.
    """

    value: float
    standard_uncertainty: float
    shared: float = 0.0


@dataclass(frozen=True, slots=True)
class Warmth:
    """What the temperature makes of one run's ln P.

    Parameters
    ----------
    shift, spread : float
        What is taken out of ln P, and its standard uncertainty.
    shared : float
        Covariance of its error with the first baseline's own in ln P.
    name : str
        Of the term.
    corrections, reasons, notes : tuple of str
        What is said of it.
    """

    shift: float = 0.0
    spread: float = 0.0
    shared: float = 0.0
    name: str = "temperature"
    corrections: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


NO_WARMTH = Warmth()


def warmth(
    levels: Sequence[tuple[float, float]],
    temperatures: Sequence[float],
    assumptions: Assumptions,
    baseline: float = 0.0,
) -> Slope:
    """What a kelvin does to ln P, learned from runs between which nothing wore.

    Parameters
    ----------
    levels : sequence of (float, float)
        ln P of each against the first, with the standard uncertainty that is its own.
    temperatures : sequence of float
        Of each less the first's, K.
    assumptions : Assumptions
        Says what is believed before: 0 ± so much.
    baseline : float
        Standard uncertainty of ln P by the first one's own error, which all levels share.

    Returns
    -------
    Slope
        With what it takes of the first one's error.
    """
    believed = max(assumptions.temperature, 1e-9)
    if not levels:
        return Slope(0.0, believed)
    told = np.array([level for level, _ in levels])
    own = np.maximum([spread for _, spread in levels], _LEAST)
    warmer = np.array(temperatures, dtype=np.float64)
    covariance = np.diag(own**2) + baseline**2
    pulled = np.linalg.solve(covariance, warmer)
    variance = 1 / (1 / believed**2 + float(warmer @ pulled))
    return Slope(variance * float(pulled @ told), math.sqrt(variance), variance * float(pulled.sum()))


def warmed(
    warmer: float | None,
    levels: Sequence[tuple[float, float]],
    temperatures: Sequence[float],
    assumptions: Assumptions,
    baseline: float = 0.0,
) -> Warmth:
    """What the temperature makes of a run that is compared with a baseline.

    Parameters
    ----------
    warmer : float or None
        The run's temperature less the first baseline's, K; None where either is not told.
    levels, temperatures, assumptions, baseline
        As :func:`warmth`.

    Returns
    -------
    Warmth
        With what is to be said.
    """
    slope = warmth(levels, temperatures, assumptions, baseline)
    if warmer is None:
        unknown = assumptions.temperature_unknown
        spread = unknown * math.hypot(slope.value, slope.standard_uncertainty)
        if not spread > 0:
            return NO_WARMTH
        note = (
            "run or baseline tells no temperature of the axis: the interval allows for ± "
            f"{1.96 * unknown:.2g} K between the two"
        )
        return Warmth(spread=spread, name="temperature (not recorded)", notes=(note,))
    shift, spread = slope.value * warmer, slope.standard_uncertainty * abs(warmer)
    corrections = (f"temperature: {-100 * shift:+.1f} % for {warmer:+.1f} K",) if shift else ()
    shared = -warmer * slope.shared * baseline**2
    return Warmth(shift, spread, shared, "temperature", corrections, _beyond(warmer, temperatures))


def _beyond(warmer: float, temperatures: Sequence[float]) -> tuple[str, ...]:
    """Say so where a run is much warmer or colder than what taught the slope."""
    low, high = min(0.0, *temperatures, 0.0), max(0.0, *temperatures, 0.0)
    if not high > low or max(warmer - high, low - warmer) <= _FAR * (high - low):
        return ()
    text = (
        f"the temperature's effect was learned between {low:+.1f} and {high:+.1f} K of the baseline's, and "
        f"the run is at {warmer:+.1f} K: it is carried far beyond what taught it"
    )
    return (text,)
