"""Cuts the transients out of recordings and labels them.

A recording gives segments: what lies around an acceleration phase, never past its neighbours. The segments of
all trips together become the table of transients, since only together do they show the stops.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.base.tables import TRANSIENTS, validate
from ballscrew.fcft.plan import Plan
from ballscrew.recording.aligned import SI_UNIT, Aligned
from ballscrew.recording.decimate import decimator
from ballscrew.recording.motions import assign_motions, number_trips, warm_up_trips
from ballscrew.recording.phases import Phase
from ballscrew.recording.stops import cluster, nearest

__all__ = ["Segment", "cut", "label"]

_BEFORE, _AFTER = 0.15, 0.25  # s kept around a phase, as far as its neighbours leave it


@dataclass(frozen=True, slots=True)
class Segment:
    """One acceleration phase with what lies around it.

    Parameters
    ----------
    phase : Phase
        As found in the whole recording.
    file : int
        Which recording of the run, from 0.
    rate : float
        Samples per second of the recording, Hz.
    step : int
        Every so many of them are kept.
    onset : float
        Sample of the segment at which the phase starts; between two where it is thinned. Where the blow next
        to standstill falls, there is always one.
    content : str
        Hash of the input as recorded; empty where it is constant.
    input : ndarray, shape (n,)
        Torque, force or current.
    position : ndarray, shape (n,)
        m.
    response : ndarray, shape (n_responses, n)
        Accelerations, m/s².
    """

    phase: Phase
    file: int
    rate: float
    step: int
    onset: float
    content: str
    input: NDArray[np.float64]
    position: NDArray[np.float64]
    response: NDArray[np.float64]


def cut(
    aligned: Aligned, phases: Sequence[Phase], file: int, top: float | None = None
) -> tuple[Segment, ...]:
    """Cut the segments of one recording.

    Parameters
    ----------
    aligned : Aligned
        Input, position and responses at one rate.
    phases : sequence of Phase
        In the order of time.
    file : int
        Which recording of the run, from 0.
    top : float, optional
        Highest frequency wanted, Hz: more samples than that takes are not kept. By default all are.

    Returns
    -------
    tuple of Segment
        One a phase. Copies, so that the recording itself can be let go.
    """
    size = len(aligned.position)
    thin = decimator(aligned.rate, top)
    rows = (aligned.input, aligned.position, *aligned.response)
    segments = []
    for index, phase in enumerate(phases):
        earliest = phases[index - 1].stop if index else 0
        latest = phases[index + 1].start if index + 1 < len(phases) else size
        first = min(phase.start, max(earliest, phase.start - round(_BEFORE * aligned.rate)))
        last = max(phase.stop, min(latest, phase.stop + round(_AFTER * aligned.rate)))
        at = phase.start if phase.condition.accelerating else phase.stop
        first += (at - first) % thin.step
        kept = thin(rows, first, last)
        segments.append(
            Segment(
                phase=phase,
                file=file,
                rate=aligned.rate,
                step=thin.step,
                onset=(phase.start - first) / thin.step,
                content=_content(aligned.input[first:last]),
                input=kept[0],
                position=kept[1],
                response=kept[2:],
            )
        )
    return tuple(segments)


def label(
    segments: Sequence[Segment], like: Aligned, mass: float | None, plan: Plan | None = None
) -> xr.Dataset:
    """Make the table of transients: position, condition, motion and repetition of each.

    Parameters
    ----------
    segments : sequence of Segment
        Of all recordings of a run, in the order of time.
    like : Aligned
        Any of the recordings: names the input's quantity and the responses.
    mass : float or None
        Load on the table, kg; NaN in the table where nobody said.
    plan : Plan, optional
        Gives the stops and motions; without one, stops and speeds are clustered.

    Returns
    -------
    Dataset
        The table *Transients*. A phase that the record's start or end cuts, or of a warm-up trip that was
        recorded too, has ``complete`` False and repetition 0: it is shown, and counts for nothing.
    """
    responses, quantity = like.responses, like.quantity
    places = [s.phase.stop_position for s in segments]
    stops = np.asarray(plan.positions) if plan else cluster(places)
    position = stops[nearest(places, stops)] if len(segments) else np.empty(0)
    condition = [str(s.phase.condition) for s in segments]
    trip = number_trips(
        [s.file for s in segments], position, condition, float(stops[0]) if len(stops) else 0.0
    )
    motion = assign_motions([s.phase for s in segments], trip, plan)
    counts = _counts(segments, trip, plan)
    step = segments[0].step if segments else 1
    length = max((len(s.input) for s in segments), default=0)
    shape = (len(segments), length)
    force, place = np.zeros(shape, np.float32), np.zeros(shape)
    response = np.zeros((len(responses), *shape), np.float32)
    for row, segment in enumerate(segments):
        n = len(segment.input)
        force[row, :n], place[row, :n], response[:, row, :n] = (
            segment.input,
            segment.position,
            segment.response,
        )
    per = "transient"
    dataset = xr.Dataset(
        {
            "input": ((per, "sample"), force, {"unit": SI_UNIT[quantity], "quantity": quantity}),
            "position": ((per, "sample"), place),
            "acceleration": (("response", per, "sample"), response),
            "length": (per, np.array([len(s.input) for s in segments], np.int64)),
            "onset": (per, np.array([s.onset for s in segments], np.float64)),
            "end": (
                per,
                np.array([s.onset + (s.phase.stop - s.phase.start) / s.step for s in segments], np.float64),
            ),
        },
        coords={
            "response": ("response", np.array(responses, dtype=str)),
            "file": (per, np.array([s.file for s in segments], np.int64)),
            "start_s": (per, np.array([s.phase.start / s.rate for s in segments])),
            "stop_s": (per, np.array([s.phase.stop / s.rate for s in segments])),
            "position_m": (per, position),
            "reached_m": (per, np.array(places, np.float64)),
            "condition": (per, np.array(condition, dtype="U2")),
            "motion": (per, motion),
            "repetition": (per, _repetitions(counts, position, condition, motion)),
            "mass_kg": (per, np.full(len(segments), np.nan if mass is None else float(mass))),
            "complete": (per, counts),
            "content": (per, np.array([s.content for s in segments], dtype="U64")),
        },
        attrs={"sample_rate": like.rate / step, "step": step},
    )
    return validate(dataset, TRANSIENTS)


def _content(values: NDArray[np.float64]) -> str:
    if len(values) == 0 or np.ptp(values) == 0:
        return ""
    return sha256(values.astype(np.float32).tobytes()).hexdigest()


def _counts(segments: Sequence[Segment], trip: NDArray[np.int64], plan: Plan | None) -> NDArray[np.bool_]:
    """Which phases count: whole ones, and not those of a warm-up that was recorded too."""
    whole = np.array([s.phase.complete for s in segments], bool)
    if plan is None or not plan.warm_up or not len(segments):
        return whole
    return np.asarray(whole & (trip >= warm_up_trips(int(trip.max()) + 1, plan)))


def _repetitions(
    counts: NDArray[np.bool_],
    position: NDArray[np.float64],
    condition: Sequence[str],
    motion: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Number the phases of a cell that count from 1, in the order of time."""
    reached: dict[tuple[float, str, int], int] = {}
    numbers = []
    for row, counted in enumerate(counts.tolist()):
        key = (float(position[row]), condition[row], int(motion[row]))
        reached[key] = reached.get(key, 0) + counted
        numbers.append(reached[key] if counted else 0)
    return np.array(numbers, np.int64)
