"""One more stop of a run: where it can lie, and what a run with it would tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.calibration.frequency_table import FrequencyTable

__all__ = ["further", "with_stop"]


_PART = 0.25  # of the way between the outer stops: how much further a stop is offered
_ENOUGH = 0.2  # of that: nearer it is none of its own


def further(position: Array, sheet: DataSheet) -> float | None:
    """Where one more stop lies furthest outside of those that there are.

    Parameters
    ----------
    position : ndarray, shape (n,)
        Of the cells, m.
    sheet : DataSheet
        Says where the screw ends, and where the machine may go.

    Returns
    -------
    float or None
        m, between the soft limits, or the distance of two stops from the screw's ends where the sheet states
        none; None where the stops fill the travel.
    """
    stops = np.unique(np.round(position, 6))
    if len(stops) < 2:
        return None
    reach, room = _PART * float(np.ptp(stops)), float(np.diff(stops).min())
    low, high = sheet.limits.lowest_position, sheet.limits.highest_position
    least = -sheet.screw.bearing_to_zero + room if low is None else low
    most = sheet.travel_limit - room if high is None else high
    before = min(stops[0] - least, reach)
    beyond = min(most - stops[-1], reach)
    if max(before, beyond) < _ENOUGH * reach:
        return None
    return float(stops[-1] + beyond if beyond >= before else stops[0] - before)


def with_stop(run: FrequencyTable, place: float) -> FrequencyTable:
    """Add a stop to a run, its cells as those of the nearest stop.

    What cells share goes on as a straight line of their position: the curve of a run has a level and a tilt.

    Parameters
    ----------
    run : FrequencyTable
        At two stops or more.
    place : float
        m.

    Returns
    -------
    FrequencyTable
        With more cells, and no id.
    """
    near = np.flatnonzero(run.position == run.position[np.argmin(np.abs(run.position - place))])
    count = len(near)
    relative = run.shared / run.frequency
    basis = np.stack([np.ones_like(run.position), run.position - place], axis=1)
    course = np.linalg.lstsq(basis, relative.T, rcond=None)[0]
    there = course[0][:, None] * run.frequency[near]
    return replace(
        run,
        id="",
        position=np.append(run.position, np.full(count, place)),
        condition=(*run.condition, *(run.condition[i] for i in near)),
        motion=(*run.motion, *(run.motion[i] for i in near)),
        frequency=np.append(run.frequency, run.frequency[near]),
        own=np.append(run.own, run.own[near]),
        shared=np.concatenate([run.shared, there], axis=1),
    )
