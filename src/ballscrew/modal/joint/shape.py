"""The axial mode along the axis: its compliance and damping, worn nut and local wear among it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array

__all__ = ["FIRST_DAMPING", "Shape", "compliance", "damping", "frequency", "local"]

_MOST_DAMPING = 0.9
FIRST_DAMPING = 0.03
"""Ratio with which a mode is sought."""


@dataclass(frozen=True, slots=True)
class Shape:
    """The axial mode along the axis, 1/w² = compliance (1 + slope x + curve x²), and what else rings.

    Parameters
    ----------
    compliance : float
        1/w² in the middle, s².
    slope, curve : float
        1/m and 1/m².
    damping : float
        Ratio in the middle.
    load : float
        Load on the nut over its preload, per m/s² of the table.
    nut : float
        The nut's compliance in the middle over that of all else, at a load of 1 per m/s²: with less preload
        it grows as the load's cube root.
    rubbing : float
        Friction on the table, as an acceleration, m/s².
    pitch, pitch_damping : float
        Of the pitching mode, Hz and ratio.
    places, local : tuple of float
        Stops from the middle, m, ascending, and what the compliance has there beyond its smooth course, as a
        part of that in the middle; linear between them. None for an axis that is worn evenly.
    power : float
        Of the frequency, with which the damping ratio grows along the axis: 1 where the springs damp, -1
        where the guide does, 0 where a hysteresis does.
    """

    compliance: float
    slope: float
    curve: float
    damping: float
    load: float
    nut: float
    rubbing: float
    pitch: float
    pitch_damping: float
    places: tuple[float, ...] = ()
    local: tuple[float, ...] = ()
    power: float = 0.0

    @property
    def share(self) -> float:
        """The nut's, of the compliance in the middle."""
        ratio = self.nut * math.pow(self.load, 1 / 3)
        return ratio / (1 + ratio)


def compliance(frequency: float) -> float:
    """1/w² of a frequency, s² of Hz."""
    return 1 / (2 * math.pi * frequency) ** 2


def frequency(shape: Shape, place: Array) -> Array:
    """Undamped natural frequency, Hz, at places from the middle, m."""
    square = shape.compliance * (1 + shape.slope * place + shape.curve * place**2 + local(shape, place))
    return np.asarray(1 / (2 * math.pi * np.sqrt(np.maximum(square, 1e-12))))


def damping(shape: Shape, frequencies: Array) -> Array:
    """Damping ratio where the undamped natural frequency is so many Hz."""
    middle = 1 / (2 * math.pi * math.sqrt(shape.compliance))
    return np.asarray(np.minimum(shape.damping * (frequencies / middle) ** shape.power, _MOST_DAMPING))


def local(shape: Shape, place: Array) -> Array:
    """What the compliance has at places beyond its smooth course, as a part of that in the middle."""
    if not shape.local:
        return np.zeros_like(place)
    return np.asarray(np.interp(place, shape.places, shape.local))
