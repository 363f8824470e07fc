"""Lost motion: difference of the table's position at a stop between arrivals from both sides.

It is measured by a displacement probe or a linear scale beside the table and is often called backlash. But a
sound axis has lost motion too: the remaining friction F of the guide at rest deflects all parts from motor to
table, by at most 2 F / k, and by less where the table swings as it stops. A nut that has lost preload is
deflected more. Backlash B adds to that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr

from ballscrew.base.arrays import Array
from ballscrew.recording.phases import MotionPhase
from ballscrew.recording.recording import Recording

_SETTLED = 0.5  # of a standstill, after which the table no longer swings
_EDGE = 0.02  # s before the next move that are not used


@dataclass(frozen=True, slots=True)
class LostMotion:
    """Lost motion at one stop.

    Parameters
    ----------
    position_m : float
        Position of the stop, m.
    lost_m : float
        Table less motor after arrival from above, less the same after arrival from below, m.
    standard_uncertainty_m : float
        From the scatter over the repetitions, m; NaN for a single repetition.
    repetitions : int
        Pairs of arrivals.
    """

    position_m: float
    lost_m: float
    standard_uncertainty_m: float
    repetitions: int


def table_offsets(recording: Recording, phases: Sequence[MotionPhase], rate: float) -> Array:
    """Position of the table relative to the motor after each arrival.

    Parameters
    ----------
    recording : Recording
        With the motor's position and that of ``location = "table"``, where there are both.
    phases : sequence of MotionPhase
        Phases of the recording, in the order of time.
    rate : float
        Sample rate of the phases, Hz.

    Returns
    -------
    ndarray, shape (len(phases),)
        Table less motor, m, mean over the later part of the standstill that follows; NaN after a departure,
        where the standstill is too short, and where there are no two positions.
    """
    offsets = np.full(len(phases), np.nan)
    names = recording.of("position")
    table = recording.of("position", location="table")
    if not table or len(table) == len(names):
        return offsets
    motor = next(name for name in names if name not in table)
    for index, (phase, following) in enumerate(pairwise(phases)):
        if not phase.condition.accelerating:
            begin, end = phase.stop / rate, following.start / rate
            span = (begin + _SETTLED * (end - begin), end - _EDGE)
            offsets[index] = _mean(recording, table[0], span) - _mean(recording, motor, span)
    return offsets


def lost_motion(transients: xr.Dataset, offsets: Array) -> tuple[LostMotion, ...]:
    """Lost motion at every stop that is reached from both sides.

    Parameters
    ----------
    transients : Dataset
        The table *Transients*.
    offsets : ndarray, shape (transients,)
        From :func:`table_offsets`, of all recordings.

    Returns
    -------
    tuple of LostMotion
        Ascending; without the first and last stop of a trip, which are reached from one side only.
    """
    used = (transients["repetition"].values > 0) & np.isfinite(offsets)
    places, conditions = transients["position_m"].values, transients["condition"].values
    found = []
    for stop in np.unique(places[used]).tolist():
        here = used & (places == stop)
        below, above = offsets[here & (conditions == "PD")], offsets[here & (conditions == "ND")]
        count = min(len(below), len(above))
        if count == 0:
            continue
        lost = float(above.mean() - below.mean())
        uncertainty = math.nan
        if count > 1:
            uncertainty = math.sqrt(np.var(below, ddof=1) / len(below) + np.var(above, ddof=1) / len(above))
        found.append(LostMotion(stop, lost, uncertainty, count))
    return tuple(found)


def _mean(recording: Recording, name: str, span: tuple[float, float]) -> float:
    rate = recording.rate(name)
    part = recording.array(name)[round(span[0] * rate) : round(span[1] * rate)]
    return float(part.mean()) if part.size else math.nan
