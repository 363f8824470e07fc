"""What others watch, as simple signatures of preload and temperature: for comparison, not for truth.

A feature is 1 + gain · (what wear does) + warmth · ΔT + scatter. Gains differ from axis to axis. Sizes were
assumed before the tables were made, and fitted to nothing. On three lives of an independent bench with few
disturbances vibration alarmed at 5 to 12 % of the preload lost, friction at 7 to 24 %, the picked peak of the
FRF at 7 to 21 %.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array
from benchmarks.early_axes import Curve

__all__ = ["SIGNATURES", "Signature", "signature"]


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
    one: Signature, of: Curve, ratio: Array, temperature: Array, random: np.random.Generator
) -> Array:
    """Draw a feature over a history."""
    gain = random.uniform(*one.gain)
    warm = one.warmth * random.standard_normal()
    noise = one.scatter * random.standard_normal(len(ratio))
    slow = one.wander * np.cumsum(random.standard_normal(len(ratio)))
    return np.asarray(1 + gain * one.of_loss(1 - ratio, of) + warm * temperature + noise + slow)
