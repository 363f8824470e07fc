"""Lost motion: by how much the table stands elsewhere when it comes to a stop from the other side.

It is what a displacement probe or a linear scale beside the table shows, and what is often called backlash.
But a sound axis has it too: what is left of the guide's friction F when the table has come to rest winds up
all that lies between motor and table, at most by 2 F / k, less where the table swings on as it stops. A nut
that has lost preload gives way more. Backlash B comes on top of that.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ballscrew.base.errors import InputError
from ballscrew.modal.run import Run, TransientRow
from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.load import read_recording
from ballscrew.recording.recording import Recording

__all__ = ["LostMotion", "lost_motion"]

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


def lost_motion(run: Run, files: Sequence[str | Path], channels: ChannelMap) -> tuple[LostMotion, ...]:
    """Read the lost motion at every stop that is reached from both sides.

    Parameters
    ----------
    run : Run
        Says when the table came to which stop.
    files : sequence of path-like
        The run's recordings, in its order.
    channels : ChannelMap
        Names two positions: the motor's, and the table's with ``location = "table"``.

    Returns
    -------
    tuple of LostMotion
        Ascending; the first and the last stop of a trip are reached from one side only and are not in it.

    Raises
    ------
    InputError
        If there are not as many files as the run has, or no position of the table.
    """
    if len(files) != len(run.files):
        raise InputError(f"the run has {len(run.files)} recordings, {len(files)} were given.")
    offsets: dict[tuple[float, str], list[float]] = defaultdict(list)
    for index, file in enumerate(files):
        rows = sorted((row for row in run.transients if row.file == index), key=lambda row: row.start_s)
        recording = read_recording(file, channels)
        for row, following in pairwise(rows):
            if row.condition in ("PD", "ND") and row.repetition and following.start_s > row.stop_s:
                offset = _offset(recording, row, following)
                if offset is not None:
                    offsets[row.position_m, row.condition].append(offset)
    stops = sorted({position for position, _ in offsets})
    found = (_pair(stop, offsets[stop, "PD"], offsets[stop, "ND"]) for stop in stops)
    return tuple(each for each in found if each is not None)


def _offset(recording: Recording, arrival: TransientRow, following: TransientRow) -> float | None:
    """Table less motor, m, mean over the later part of a standstill; None where it is too short."""
    motor, table = _positions(recording)
    begin = arrival.stop_s + _SETTLED * (following.start_s - arrival.stop_s)
    means = []
    for name in (motor, table):
        rate = recording.rate(name)
        part = recording.array(name)[round(begin * rate) : round((following.start_s - _EDGE) * rate)]
        if part.size == 0:
            return None
        means.append(float(part.mean()))
    return means[1] - means[0]


def _positions(recording: Recording) -> tuple[str, str]:
    table = recording.of("position", location="table")
    motor = [name for name in recording.of("position") if name not in table]
    if not table or not motor:
        raise InputError(
            f"{recording.file.name}: lost motion takes two positions, the motor's and one with "
            'location = "table"; the channel map must name both.'
        )
    return motor[0], table[0]


def _pair(stop: float, below: Sequence[float], above: Sequence[float]) -> LostMotion | None:
    count = min(len(below), len(above))
    if count == 0:
        return None
    scatter = [np.var(part, ddof=1) / len(part) if len(part) > 1 else np.nan for part in (below, above)]
    return LostMotion(
        position_m=stop,
        lost_m=float(np.mean(above) - np.mean(below)),
        standard_uncertainty_m=float(np.sqrt(sum(scatter))),
        repetitions=count,
    )
