"""Input of the joint estimator: channels of each recording at a low rate, and its transients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import compress

import numpy as np
import xarray as xr

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.modal.cell import TransientRow, transient_rows
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.decimate import Decimator

_TAPS = 32  # length of the decimation filter, in samples at the new rate
_PASS = 0.8  # cut-off frequency of this filter, over half the new rate


@dataclass(frozen=True, slots=True)
class TripSignals:
    """One recording, decimated; all channels through the same filter.

    Parameters
    ----------
    rate : float
        Samples per second, Hz.
    force : ndarray, shape (n,)
        Torque, force or current, in any unit: it is divided by the total inertia in the same unit.
    position : ndarray, shape (n,)
        Position of the table by the motor's encoder, m.
    response : ndarray, shape (n_responses, n)
        Accelerations along the axis at the nut, m/s²; no rows where there is no accelerometer.
    rounding : float
        Power spectral density of the rounding error of the force, in the square of its unit per hertz.
    name : str
        Name of the recording.
    motor : ndarray, shape (n,), optional
        Acceleration of the motor, referred to the table, derived from its speed, m/s²; if absent, it is
        derived from the position.
    """

    rate: float
    force: Array
    position: Array
    response: Array
    rounding: float = 0.0
    name: str = ""
    motor: Array | None = None

    @property
    def channels(self) -> list[Array]:
        """All signals: force, position, responses, and the motor's acceleration where there is one."""
        channels = [self.force, self.position, *self.response]
        if self.motor is not None:
            channels.append(self.motor)
        return channels


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
        At a rate that is the recording's divided by a whole number. The filter has no delay and is the same
        for all channels, so it does not change the relation between them.

    Raises
    ------
    InputError
        If the rate is not more than 0.
    """
    if not 0 < rate < float("inf"):
        raise InputError(f"a rate of {rate:g} Hz was given; it must be finite and more than 0.")
    trip = TripSignals(
        aligned.rate,
        aligned.input,
        aligned.position,
        aligned.response,
        _rounding(aligned.input, aligned.rate),
        motor=aligned.motor,
    )
    return decimate(trip, rate)


def _rounding(force: Array, rate: float) -> float:
    """Power spectral density of the rounding error of a force, in the square of its unit per hertz.

    The power of the error is step²/12, distributed evenly from 0 to half the rate at which the signal
    changes. ``rate`` is the sampling rate, Hz.
    """
    steps = np.diff(np.unique(force))
    changes = np.count_nonzero(np.diff(force)) / max(len(force) - 1, 1) * rate  # per second
    if not len(steps) or not changes > 0:
        return 0.0
    return float(np.median(steps)) ** 2 / 12 / (changes / 2)


def position_range(trips: Sequence[TripSignals]) -> tuple[float, float]:
    """Lowest and highest position of all trips, m."""
    positions = np.concatenate([trip.position for trip in trips])
    return float(positions.min()), float(positions.max())


def decimate(trip: TripSignals, rate: float) -> TripSignals:
    """Trip at the lowest rate, not below ``rate`` (Hz), that is its own divided by a whole number."""
    step = max(1, int(trip.rate / rate + 1e-9))  # an exact division may be rounded down
    if step == 1:
        return trip
    # Rows in the order of TripSignals.channels.
    rows = _decimator(step)(trip.channels, first=0, last=len(trip.force))
    force, position, response = rows[0], rows[1], rows[2 : 2 + len(trip.response)]
    motor = None
    if trip.motor is not None:
        motor = rows[-1]
    return TripSignals(trip.rate / step, force, position, response, trip.rounding, trip.name, motor)


def complete_transients(transients: xr.Dataset) -> tuple[TransientRow, ...]:
    """Complete rows of the table *Transients*, in its order."""
    return tuple(compress(transient_rows(transients), transients["complete"].values))


@lru_cache(maxsize=16)
def _decimator(step: int) -> Decimator:
    """Low-pass filter that returns every ``step``-th sample."""
    from scipy.signal import firwin

    taps = np.asarray(firwin(_TAPS * step + 1, _PASS / step))
    taps.setflags(write=False)  # cached
    return Decimator(step, taps)
