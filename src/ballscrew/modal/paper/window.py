"""The window: which part of a transient is transformed.

A jerk-limited acceleration is two blows, one at each end of the phase, T_a apart. With both under one window
the torque's spectrum has nulls at every k/T_a, and the highest point of the FRF lies beside the mode. So the
window holds one blow: the one next to standstill, where the table's place is known and torque ripple is
least. It starts seven periods of the expected mode before that blow and ends twelve after it, and never goes
past the other one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.fcft.concerns import QUIET, RINGING, SHORTEST
from ballscrew.fcft.conditions import Condition

BEFORE, AFTER = QUIET, RINGING  # periods of the expected mode
# The same window longer and shorter: what the choice of the window decides is part of the uncertainty.
VARIANTS = ((0.85, 1.0), (1.15, 1.0), (1.0, 0.85), (1.0, 1.15))  # of before, of after
_SLACK = 0.05  # of the window, by which a record may be too short at either end: the window is then shifted
LEAST = SHORTEST  # periods


@dataclass(frozen=True, slots=True)
class Extent:
    """A window, in samples around the blow next to standstill.

    Parameters
    ----------
    before, after : float
        Samples before the blow, and from it on; the record may have fewer.
    """

    before: float
    after: float

    @property
    def samples(self) -> NDArray[np.int64]:
        """Indices of the samples inside, counted from the blow."""
        return np.arange(-math.floor(self.before), math.ceil(self.after))

    @property
    def phase(self) -> NDArray[np.float64]:
        """Position of the samples in the window, 0 to 1."""
        return np.asarray((self.samples + self.before) / (self.before + self.after), dtype=np.float64)

    @property
    def hann(self) -> NDArray[np.float64]:
        """Hann window at these samples."""
        return np.asarray(0.5 - 0.5 * np.cos(2 * np.pi * self.phase), dtype=np.float64)


def extent(
    cell: xr.Dataset, condition: Condition, period: float, *, before: float = BEFORE, after: float = AFTER
) -> Extent:
    """The window of a cell, one for all its repetitions.

    Parameters
    ----------
    cell : Dataset
        The cell's rows of the table *Transients*.
    condition : Condition
        PA and NA start at the blow next to standstill; PD and ND end there.
    period : float
        Of the expected mode, s.
    before, after : float
        In periods.

    Returns
    -------
    Extent
        Cut where the other blow, the next phase or the record's end comes first.
    """
    rate = float(cell.attrs["sample_rate"])
    at = blow(cell, condition)
    lead, tail = before * period * rate, after * period * rate
    phase = float(np.median(cell["end"].values - cell["onset"].values))
    shortest = LEAST * period * rate
    if condition.accelerating:
        tail = min(tail, max(phase, shortest))
    else:
        lead = min(lead, max(phase, shortest))
    available_before, available_after = np.median(at), np.median(cell["length"].values - at)
    step = int(cell.attrs.get("step", 1))
    lead, tail = min(lead, available_before), min(tail, available_after)
    return Extent(round(step * lead) / step, round(step * tail) / step)


def both_blows(cell: xr.Dataset, period: float) -> bool:
    """True if phases are so short that the window holds both blows; the mode's period is in samples."""
    return bool(np.median(cell["end"].values - cell["onset"].values) < LEAST * period)


def tapered(
    cell: xr.Dataset, condition: Condition, window: Extent
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cut, free of their means and Hann-windowed: input and responses of a cell.

    Parameters
    ----------
    cell : Dataset
        The cell's rows of the table *Transients*.
    condition : Condition
        Of the cell.
    window : Extent
        As :func:`extent` gives it.

    Returns
    -------
    input : ndarray, shape (repetitions, samples)
        In the input's unit; only the repetitions that contain the whole window.
    response : ndarray, shape (responses, repetitions, samples)
        m/s².
    """
    samples, hann = window.samples, window.hann
    size = len(samples)
    first = blow(cell, condition) + samples[0]
    spare = cell["length"].values - size
    slack = _SLACK * size  # a neighbour a little too near moves the window a little; more, and it is left out
    fits = (first >= -slack) & (first <= spare + slack) & (spare >= 0)
    index = np.clip(first, 0, spare)[fits][:, None] + np.arange(size)
    forces, responses = cell["input"].values[fits], cell["acceleration"].values[:, fits]
    force = np.take_along_axis(forces.astype(np.float64), index, axis=1)
    response = np.take_along_axis(responses.astype(np.float64), index[None], axis=2)
    return (
        (force - force.mean(axis=-1, keepdims=True)) * hann,
        (response - response.mean(axis=-1, keepdims=True)) * hann,
    )


def blow(cell: xr.Dataset, condition: Condition) -> NDArray[np.int64]:
    """Sample of each segment at which the blow next to standstill falls."""
    at = cell["onset" if condition.accelerating else "end"].values
    return np.asarray(np.rint(at), dtype=np.int64)
