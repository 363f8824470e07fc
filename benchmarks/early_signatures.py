"""Features that are commonly monitored, as simple functions of preload and temperature, for comparison.

A feature is 1 + gain · (effect of wear) + warmth · ΔT + scatter. Gains differ from axis to axis. Sizes were
assumed before the tables were made, and fitted to nothing. On three lives of an independent bench with few
disturbances vibration alarmed at 5 to 12 % of the preload lost, friction at 7 to 24 %, the picked peak of the
FRF at 7 to 21 %.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.base.arrays import Array
from benchmarks.early_axes import Curve

__all__ = ["SIGNATURES", "Signature", "signature", "three_sigma"]


@dataclass(frozen=True, slots=True)
class Signature:
    """One feature.

    Parameters
    ----------
    of_loss : callable
        Relative change by the loss of preload, for an axis of gain 1.
    gain : tuple of float
        Between, over axes.
    scatter : float
        From run to run, relative.
    wander : float
        Slow change by a day, relative: oil, mounting, surroundings.
    warmth : float
        By a kelvin, standard deviation over axes.
    sign : int
        1 where wear makes it grow.
    """

    of_loss: Callable[[Array, Curve], Array]
    gain: tuple[float, float]
    scatter: float
    wander: float
    warmth: float
    sign: int


def _frequency(lost: Array, of: Curve) -> Array:
    level = np.maximum(1 - lost, 1e-2) ** (-1 / 3) - 1
    return np.asarray((1 + of.share * level) ** -0.5 - 1)


SIGNATURES: Mapping[str, Signature] = {
    "vibration RMS": Signature(lambda lost, _: lost, (0.5, 1.5), 0.02, 0.001, 0.003, 1),
    "kurtosis of vibration": Signature(lambda lost, _: lost**2, (0.3, 1.0), 0.04, 0.0, 0.0, 1),
    "friction torque": Signature(lambda lost, of: -of.drag * lost, (1.0, 1.0), 0.01, 0.002, 0.01, -1),
    "torque RMS": Signature(lambda lost, of: -0.3 * of.drag * lost, (1.0, 1.0), 0.005, 0.0006, 0.003, -1),
    "peak of the response alone": Signature(_frequency, (1.0, 1.0), 0.003, 0.0, 0.0004, -1),
    "picked peak of the FRF": Signature(_frequency, (1.0, 1.0), 0.0015, 0.0, 0.0004, -1),
}


def signature(
    feature: Signature, of: Curve, ratio: Array, temperature: Array, random: np.random.Generator
) -> Array:
    """Sample of a feature over a history."""
    gain = random.uniform(*feature.gain)
    warm = feature.warmth * random.standard_normal()
    noise = feature.scatter * random.standard_normal(len(ratio))
    slow = feature.wander * np.cumsum(random.standard_normal(len(ratio)))
    return np.asarray(1 + gain * feature.of_loss(1 - ratio, of) + warm * temperature + noise + slow)


def three_sigma(values: ArrayLike, baseline: int, sign: int = 1, times: int = 2) -> int | None:
    """Run that alarms by the common limit: mean and three standard deviations of the first runs.

    Parameters
    ----------
    values : array_like, shape (n,)
        Of a feature, in time order; nan where it is missing.
    baseline : int
        Number of first runs that determine the limit; 2 or more.
    sign : int
        1 where wear increases the feature, -1 where it decreases it.
    times : int
        Number of runs in a row beyond the limit.

    Returns
    -------
    int or None
        None where no run alarms.
    """
    signed = sign * np.asarray(values, dtype=float)
    limit = np.nanmean(signed[:baseline]) + 3 * np.nanstd(signed[:baseline], ddof=1)
    count = 0
    for k in range(baseline, len(signed)):
        count = count + 1 if signed[k] > limit else 0
        if count == times:
            return k
    return None
