"""The axial mode along the axis: its compliance and damping, with a worn nut and local wear."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array

_MOST_DAMPING = 0.9  # damping ratio: the mode stays oscillatory
INITIAL_DAMPING = 0.03  # damping ratio at the start of a search


@dataclass(frozen=True, slots=True)
class AxialMode:
    """The axial mode along the axis, 1/w² = compliance (1 + slope x + curve x² + local(x)).

    w is the angular natural frequency, x the position from the middle of the axis, m.

    Parameters
    ----------
    compliance : float
        1/w² in the middle, s².
    slope, curve : float
        1/m and 1/m².
    damping : float
        Damping ratio in the middle.
    load : float
        Load on the nut over its preload, per m/s² of the table.
    nut : float
        Compliance of the nut in the middle over that of all other parts, at a load of 1 per m/s²: with less
        preload it grows with the cube root of the load.
    friction : float
        Friction on the table, as an acceleration, m/s².
    pitch, pitch_damping : float
        Frequency (Hz) and damping ratio of the pitching mode of the table.
    places, local : tuple of float
        Positions of the stops from the middle, m, ascending, and the compliance there beyond its smooth
        profile, as a part of that in the middle; linear in between. Empty for an axis that is worn evenly.
    power : float
        Power of the frequency to which the damping ratio is proportional along the axis: 1 if the springs
        damp, -1 if the guide does, 0 for hysteresis.
    """

    compliance: float
    slope: float
    curve: float
    damping: float
    load: float
    nut: float
    friction: float
    pitch: float
    pitch_damping: float
    places: tuple[float, ...] = ()
    local: tuple[float, ...] = ()
    power: float = 0.0

    @property
    def nut_share(self) -> float:
        """Part of the compliance in the middle that is the nut's."""
        ratio = self.nut * math.pow(self.load, 1 / 3)
        return ratio / (1 + ratio)

    @property
    def centre(self) -> float:
        """Undamped natural frequency in the middle, Hz."""
        return float(mode_frequency(self, np.zeros(1))[0])


def compliance_of(frequency: float) -> float:
    """1/w² (s²) of a frequency in Hz."""
    return 1 / (2 * math.pi * frequency) ** 2


def mode_frequency(mode: AxialMode, place: Array) -> Array:
    """Undamped natural frequency, Hz, at positions from the middle, m."""
    square = mode.compliance * relative_compliance(mode, place)
    return np.asarray(1 / (2 * math.pi * np.sqrt(np.maximum(square, 1e-12))))


def relative_compliance(mode: AxialMode, place: Array) -> Array:
    """Compliance at positions from the middle (m), as a part of that in the middle."""
    smooth = 1 + mode.slope * place + mode.curve * place**2
    return np.asarray(smooth + local_compliance(mode, place))


def damping_ratio(mode: AxialMode, frequency: Array) -> Array:
    """Damping ratio at positions with this undamped natural frequency, Hz."""
    middle = 1 / (2 * math.pi * math.sqrt(mode.compliance))
    return np.asarray(np.minimum(mode.damping * (frequency / middle) ** mode.power, _MOST_DAMPING))


def local_compliance(mode: AxialMode, place: Array) -> Array:
    """Compliance beyond the smooth profile at positions from the middle, as a part of that in the middle."""
    if not mode.local:
        return np.zeros_like(place)
    return np.asarray(np.interp(place, mode.places, mode.local))
