"""Transients: cut from recordings, and labelled in a table.

A recording gives a segment around each acceleration phase, up to the neighbouring phases. The segments of all
trips together become the table of transients, since the stops show in all trips together only.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.tables import TRANSIENTS, validate
from ballscrew.fcft.plan import Plan
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.decimate import decimator
from ballscrew.recording.motions import assign_motions, cluster, nearest, number_trips, warm_up_trips
from ballscrew.recording.phases import MotionPhase
from ballscrew.recording.quantities import SI_UNITS

_BEFORE, _AFTER = 0.15, 0.25  # s around a phase, up to its neighbours
_ROW = np.dtype(
    [
        ("file", np.int64),
        ("start_s", np.float64),
        ("stop_s", np.float64),
        ("reached_m", np.float64),
        ("condition", "U2"),
        ("complete", np.bool_),
        ("content", "U64"),
        ("length", np.int64),
        ("onset", np.float64),
        ("end", np.float64),
    ]
)


@dataclass(frozen=True, slots=True)
class TransientSegment:
    """Signals around an acceleration phase.

    Parameters
    ----------
    phase : MotionPhase
        Phase in samples of the whole recording.
    file : int
        Index of the recording in the run, from 0.
    rate : float
        Samples per second of the recording, Hz.
    step : int
        Decimation of the segment.
    onset : float
        Sample of the segment at which the phase starts; not whole where the segment is decimated. The blow
        next to standstill always falls on a sample.
    content : str
        Hash of the recorded input; empty where it is constant.
    input : ndarray, shape (n,)
        Torque, force or current.
    position : ndarray, shape (n,)
        m.
    response : ndarray, shape (n_responses, n)
        Accelerations, m/s².
    """

    phase: MotionPhase
    file: int
    rate: float
    step: int
    onset: float
    content: str
    input: Array
    position: Array
    response: Array


def cut(
    aligned: Aligned, phases: Sequence[MotionPhase], file: int, top: float | None = None
) -> tuple[TransientSegment, ...]:
    """Cut the segments of one recording.

    Parameters
    ----------
    aligned : Aligned
        Input, position and responses of the recording at one rate.
    phases : sequence of MotionPhase
        In the order of time.
    file : int
        Index of the recording in the run, from 0.
    top : float, optional
        Highest frequency needed, Hz, to which the segments are decimated. By default they are not.

    Returns
    -------
    tuple of TransientSegment
        A segment for each phase: copies, so that the recording itself can be released.
    """
    thin = decimator(aligned.rate, top)
    before, after = round(_BEFORE * aligned.rate), round(_AFTER * aligned.rate)
    rows = (aligned.input, aligned.position, *aligned.response)
    begins = [0, *(phase.stop for phase in phases)]
    ends = [*(phase.start for phase in phases[1:]), len(aligned.position)]
    segments = []
    for phase, begin, end in zip(phases, begins, ends, strict=False):
        first = min(phase.start, max(begin, phase.start - before))
        last = max(phase.stop, min(end, phase.stop + after))
        blow = phase.start if phase.condition.accelerating else phase.stop
        first += (blow - first) % thin.step
        samples = thin(rows, first, last)
        segments.append(
            TransientSegment(
                phase=phase,
                file=file,
                rate=aligned.rate,
                step=thin.step,
                onset=(phase.start - first) / thin.step,
                content=_hash(aligned.input[first:last]),
                input=samples[0],
                position=samples[1],
                response=samples[2:],
            )
        )
    return tuple(segments)


def label(
    segments: Sequence[TransientSegment], like: Aligned, mass: float | None, plan: Plan | None = None
) -> xr.Dataset:
    """Make the table of transients: position, condition, motion and repetition of each.

    Parameters
    ----------
    segments : sequence of TransientSegment
        Segments of all recordings of a run, in the order of time.
    like : Aligned
        Any of the recordings: names the input's quantity and the responses.
    mass : float or None
        Load on the table, kg; NaN in the table where it is None.
    plan : Plan, optional
        Gives the stops and motions; without it, stops and speeds are clustered.

    Returns
    -------
    Dataset
        The table *Transients*. A phase that is cut by the record's start or end, or that belongs to a
        recorded warm-up trip, has ``complete`` False and repetition 0: it is displayed, and not evaluated.
    """
    rows = np.array([_row(segment) for segment in segments], dtype=_ROW)
    stops = cluster(rows["reached_m"]) if plan is None else np.asarray(plan.positions)
    position, home = np.empty(0), 0.0
    if len(rows):
        position, home = stops[nearest(rows["reached_m"], stops)], float(stops[0])
    trip = number_trips(rows["file"], position, rows["condition"], home)
    motion = assign_motions([segment.phase for segment in segments], trip, plan)
    complete = rows["complete"]
    if plan is not None and plan.warm_up and len(rows):
        complete = complete & (trip >= warm_up_trips(int(trip.max()) + 1, plan))
    per = "transient"
    load = math.nan if mass is None else float(mass)
    step = segments[0].step if segments else 1
    variables = _signals(segments, like)
    for name in ("length", "onset", "end"):
        variables[name] = (per, rows[name])
    coordinates: dict[str, tuple[str, Any]] = {
        "response": ("response", np.array(like.responses, dtype=str)),
        "position_m": (per, position),
        "motion": (per, motion),
        "repetition": (per, _repetitions(complete, position, rows["condition"], motion)),
        "mass_kg": (per, np.full(len(rows), load)),
        "complete": (per, complete),
    }
    for name in ("file", "start_s", "stop_s", "reached_m", "condition", "content"):
        coordinates[name] = (per, rows[name])
    attributes = {"sample_rate": like.rate / step, "step": step}
    return validate(xr.Dataset(variables, coordinates, attributes), TRANSIENTS)


def _row(segment: TransientSegment) -> tuple[Any, ...]:
    phase = segment.phase
    return (
        segment.file,
        phase.start / segment.rate,
        phase.stop / segment.rate,
        phase.stop_position,
        str(phase.condition),
        phase.complete,
        segment.content,
        len(segment.input),
        segment.onset,
        segment.onset + (phase.stop - phase.start) / segment.step,
    )


def _signals(segments: Sequence[TransientSegment], like: Aligned) -> dict[str, tuple[Any, ...]]:
    """Signals of all segments as variables of the table, padded with zeros to one length."""
    length = max((len(segment.input) for segment in segments), default=0)
    shape = (len(segments), length)
    force, place = np.zeros(shape, np.float32), np.zeros(shape)
    response = np.zeros((len(like.responses), *shape), np.float32)
    for row, segment in enumerate(segments):
        n = len(segment.input)
        force[row, :n] = segment.input
        place[row, :n] = segment.position
        response[:, row, :n] = segment.response
    attributes = {"unit": SI_UNITS[like.quantity], "quantity": like.quantity}
    return {
        "input": (("transient", "sample"), force, attributes),
        "position": (("transient", "sample"), place),
        "acceleration": (("response", "transient", "sample"), response),
    }


def _hash(values: Array) -> str:
    if len(values) == 0 or np.ptp(values) == 0:
        return ""
    return sha256(values.astype(np.float32).tobytes()).hexdigest()


def _repetitions(
    complete: NDArray[np.bool_],
    position: Array,
    condition: NDArray[np.str_],
    motion: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Number the complete phases of each cell from 1, in the order of time; 0 for the others."""
    reached: Counter[tuple[float, str, int]] = Counter()
    numbers = np.zeros(len(complete), np.int64)
    for row in np.flatnonzero(complete):
        cell = (float(position[row]), str(condition[row]), int(motion[row]))
        reached[cell] += 1
        numbers[row] = reached[cell]
    return numbers
