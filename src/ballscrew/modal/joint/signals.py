"""Input of the joint estimator: a few channels of each recording at a low rate, and where the phases lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import xarray as xr

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.modal.run import CellKey
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.decimate import Decimator

_TAPS = 32  # of the filter, per sample of the new rate
_PASS = 0.8  # pass band, of half the new rate


@dataclass(frozen=True, slots=True)
class TripSignals:
    """One recording, decimated; all channels through the same filter.

    Parameters
    ----------
    rate : float
        Samples per second, Hz.
    force : ndarray, shape (n,)
        Torque, force or current; its unit does not matter.
    position : ndarray, shape (n,)
        Of the motor's encoder, m.
    response : ndarray, shape (n_responses, n)
        Accelerations along the axis at the nut, m/s²; no rows where there is no accelerometer.
    """

    rate: float
    force: Array
    position: Array
    response: Array


@dataclass(frozen=True, slots=True)
class Mark:
    """Where an acceleration phase lies.

    Parameters
    ----------
    trip : int
        Which of the trips, from 0.
    start, stop : float
        From the trip's first sample, s.
    position : float
        Nominal position of the stop, m.
    condition : str
        PA, PD, NA or ND.
    motion : int
        Which motion, from 0.
    """

    trip: int
    start: float
    stop: float
    position: float
    condition: str
    motion: int = 0

    @property
    def cell(self) -> CellKey:
        """Its cell."""
        return CellKey(self.position, str(self.condition), self.motion)


def trip_signals(aligned: Aligned, rate: float) -> TripSignals:
    """Decimate a recording.

    Parameters
    ----------
    aligned : Aligned
        Input, position and responses at one rate.
    rate : float
        Lower limit of the new rate, Hz.

    Returns
    -------
    TripSignals
        At the recording's rate over a whole number. The filter has no delay and is common to all channels,
        so that it cancels in their relations.

    Raises
    ------
    InputError
        If the rate is not more than 0.
    """
    if not 0 < rate < float("inf"):
        raise InputError(f"a rate of {rate:g} Hz was given; it must be finite and more than 0.")
    trip = TripSignals(aligned.rate, aligned.input, aligned.position, aligned.response)
    return decimated(trip, rate)


def position_range(trips: Sequence[TripSignals]) -> tuple[float, float]:
    """Lowest and highest position of all trips, m."""
    positions = np.concatenate([trip.position for trip in trips])
    return float(positions.min()), float(positions.max())


def decimated(trip: TripSignals, rate: float) -> TripSignals:
    """Trip at a lower rate, not below ``rate`` (Hz)."""
    step = max(1, int(trip.rate / rate + 1e-9))
    if step == 1:
        return trip
    rows = _decimator(step)((trip.force, trip.position, *trip.response), 0, len(trip.force))
    return TripSignals(trip.rate / step, rows[0], rows[1], rows[2:])


def marks_of(transients: xr.Dataset) -> tuple[Mark, ...]:
    """Marks of the complete transients.

    Parameters
    ----------
    transients : Dataset
        The table *Transients*.

    Returns
    -------
    tuple of Mark
        In the table's order.
    """
    names = ("file", "start_s", "stop_s", "position_m", "condition", "motion", "complete")
    rows = zip(*(transients[name].values.tolist() for name in names), strict=True)
    return tuple(Mark(*row[:-1]) for row in rows if row[-1])


@lru_cache(maxsize=16)
def _decimator(step: int) -> Decimator:
    from scipy.signal import firwin

    taps = np.asarray(firwin(_TAPS * step + 1, _PASS / step))
    taps.setflags(write=False)  # cached
    return Decimator(step, taps)
