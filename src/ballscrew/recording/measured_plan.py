"""What a position channel shows of the plan that was run: stops, speed, acceleration, dwell."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import BallscrewError
from ballscrew.recording.kinematics import kinematics
from ballscrew.recording.phases import Phase, find_phases
from ballscrew.recording.stops import cluster

__all__ = ["MeasuredPlan", "measure_plan"]

_UNEVEN = 0.02  # of a step: what an axis, unlike a plan, may be off


@dataclass(frozen=True, slots=True)
class MeasuredPlan:
    """A plan as far as it can be seen.

    Parameters
    ----------
    stops : tuple of float
        Ascending, m.
    step : float, optional
        Distance of the stops where they are evenly spaced, m.
    repetitions : int
        How often the most visited stop was left forwards.
    speed, acceleration, dwell : float
        In m/s, m/s² and s; dwell is NaN where the axis never stood.
    """

    stops: tuple[float, ...]
    step: float | None
    repetitions: int
    speed: float
    acceleration: float
    dwell: float


def measure_plan(position: NDArray[np.float64], rate: float) -> MeasuredPlan | None:
    """Read the plan off a position channel.

    Parameters
    ----------
    position : ndarray of shape (samples,)
        Position, m.
    rate : float
        Sample rate, Hz.

    Returns
    -------
    MeasuredPlan or None
        None where the motion is not clear enough to say.
    """
    if not np.all(np.isfinite(position)) or np.ptp(position) <= 0:
        return None
    try:
        motion = kinematics(position, rate)
        phases = find_phases(motion)
    except (BallscrewError, ValueError, IndexError):
        return None  # a proposal is not worth an error: the user fills it in
    if not _is_clear(phases, rate, len(position)):
        return None
    found = cluster([phase.stop_position for phase in phases])
    stops = tuple(round(float(stop), 5) for stop in found)
    if len(stops) < 2 or len(set(stops)) < len(stops):
        return None
    steps = np.diff(stops)
    even = bool(np.all(np.abs(steps - np.median(steps)) < _UNEVEN * np.median(steps)))
    step = round(float(stops[-1] - stops[0]) / (len(stops) - 1), 5) if even else None
    return MeasuredPlan(
        stops=stops,
        step=step,
        repetitions=_repetitions(phases, found),
        speed=_rounded(float(np.median([phase.speed for phase in phases])), 2),
        acceleration=_rounded(float(np.median([phase.acceleration for phase in phases])), 2),
        dwell=_dwell(phases, rate),
    )


def _is_clear(phases: tuple[Phase, ...], rate: float, samples: int) -> bool:
    """Whether there are some phases, each long enough to be seen and much shorter than the record."""
    if len(phases) < 4:
        return False
    taken = np.array(
        [phase.speed / phase.acceleration if phase.acceleration > 0 else np.inf for phase in phases]
    )
    return bool(np.median(taken) * rate > 5 and np.median(taken) * rate < samples / len(phases))


def _repetitions(phases: tuple[Phase, ...], stops: NDArray[np.float64]) -> int:
    left = Counter(
        int(np.argmin(np.abs(stops - phase.stop_position)))
        for phase in phases
        if phase.condition.name == "PA"
    )
    return max(left.values(), default=1)


def _dwell(phases: tuple[Phase, ...], rate: float) -> float:
    pauses = [
        (later.start - earlier.stop) / rate
        for earlier, later in pairwise(phases)
        if earlier.condition.name.endswith("D") and later.condition.name.endswith("A")
    ]
    return round(float(np.median(pauses)), 2) if pauses else float("nan")


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
