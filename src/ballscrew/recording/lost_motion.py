"""Lost motion: by how much the table stands elsewhere when it comes to a stop from the other side.

It is what a displacement probe or a linear scale beside the table shows, and what is often called backlash.
But a sound axis has it too: what is left of the guide's friction F when the table has come to rest winds up
all that lies between motor and table, at most by 2 F / k, less where the table swings on as it stops. A nut
that has lost preload gives way more. Backlash B comes on top of that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.recording.phases import Phase
from ballscrew.recording.recording import Recording

__all__ = ["LostMotion", "lost_motion", "table_offsets"]

_SETTLED = 0.5  # of a standstill, after which the table no longer swings
_EDGE = 0.02  # s before the next move that are left out


@dataclass(frozen=True, slots=True)
class LostMotion:
    """What one stop shows.

    Parameters
    ----------
    position_m : float
        The stop, m.
    lost_m : float
        Table less motor after coming from above, less the same after coming from below, m.
    standard_uncertainty_m : float
        From the scatter over the repetitions, m; NaN where there is one only.
    repetitions : int
        Pairs of arrivals.
    """

    position_m: float
    lost_m: float
    standard_uncertainty_m: float
    repetitions: int


def table_offsets(recording: Recording, phases: Sequence[Phase], rate: float) -> NDArray[np.float64]:
    """Where the table stands beside the motor after each arrival.

    Parameters
    ----------
    recording : Recording
        With two positions or not: the motor's, and one with ``location = "table"``.
    phases : sequence of Phase
        Of the recording, in the order of time.
    rate : float
        Samples per second that the phases count in, Hz.

    Returns
    -------
    ndarray, shape (len(phases),)
        Table less motor, m, mean over the later part of the standstill that follows; NaN after a departure,
        where the standstill is too short, and where there are no two positions.
    """
    offsets = np.full(len(phases), np.nan)
    table = recording.of("position", location="table")
    motor = [name for name in recording.of("position") if name not in table]
    if not table or not motor:
        return offsets
    for index, (phase, following) in enumerate(pairwise(phases)):
        if not phase.condition.accelerating:
            begin, end = phase.stop / rate, following.start / rate
            span = (begin + _SETTLED * (end - begin), end - _EDGE)
            offsets[index] = _mean(recording, table[0], span) - _mean(recording, motor[0], span)
    return offsets


def lost_motion(transients: xr.Dataset, offsets: NDArray[np.float64]) -> tuple[LostMotion, ...]:
    """Tell the lost motion at every stop that is reached from both sides.

    Parameters
    ----------
    transients : Dataset
        The table *Transients*.
    offsets : ndarray, shape (transients,)
        As :func:`table_offsets` makes them, of all recordings.

    Returns
    -------
    tuple of LostMotion
        Ascending; the first and the last stop of a trip are reached from one side only and are not in it.
    """
    counts = (transients["repetition"].values > 0) & np.isfinite(offsets)
    places, conditions = transients["position_m"].values, transients["condition"].values
    found = []
    for stop in np.unique(places[counts]).tolist():
        here = counts & (places == stop)
        below, above = (offsets[here & (conditions == condition)] for condition in ("PD", "ND"))
        found.append(_pair(stop, below, above))
    return tuple(each for each in found if each is not None)


def _mean(recording: Recording, name: str, span: tuple[float, float]) -> float:
    rate = recording.rate(name)
    part = recording.array(name)[round(span[0] * rate) : round(span[1] * rate)]
    return float(part.mean()) if part.size else math.nan


def _pair(stop: float, below: NDArray[np.float64], above: NDArray[np.float64]) -> LostMotion | None:
    count = min(len(below), len(above))
    if count == 0:
        return None
    scatter = [np.var(part, ddof=1) / len(part) if len(part) > 1 else math.nan for part in (below, above)]
    return LostMotion(
        position_m=stop,
        lost_m=float(above.mean() - below.mean()),
        standard_uncertainty_m=math.sqrt(sum(scatter)),
        repetitions=count,
    )
