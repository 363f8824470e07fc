"""Trace of a test by the drive, without added sensors: rate, interval and duration of the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.fcft.expected import ExpectedCell

SAMPLES_PER_PERIOD = 10.0  # of the mode: with 7, 14 of 40 intervals missed, with 14 none
_INTERVALS = 62.5e-6 * 2.0 ** np.arange(10)  # s, of the traces of drives
_BESIDE = 1.0  # s, before and after a trip


@dataclass(frozen=True, slots=True)
class TraceSettings:
    """Settings of a trace by the drive, without added sensors.

    Parameters
    ----------
    frequency : float
        Highest frequency to expect, two standard uncertainties above the prediction, Hz.
    rate : float
        Lowest sample rate that suffices for it, Hz.
    interval : float or None
        Longest usual interval of a drive that suffices, s; None where none does.
    durations : tuple of float
        Of a record of one round trip, for each motion, s.
    """

    frequency: float
    rate: float
    interval: float | None
    durations: tuple[float, ...]


def trace_settings(cells: Sequence[ExpectedCell], trip_times: Sequence[float]) -> TraceSettings:
    """Settings of a trace for the cells of a test.

    Parameters
    ----------
    cells : sequence of ExpectedCell
        Of the test.
    trip_times : sequence of float
        One round trip of each motion, s.
    """
    highest = max(cell.frequency + 2 * cell.standard_uncertainty for cell in cells)
    rate = SAMPLES_PER_PERIOD * highest
    short = _INTERVALS[rate * _INTERVALS <= 1.0]
    durations = tuple(time + 2 * _BESIDE for time in trip_times)
    return TraceSettings(highest, rate, float(short[-1]) if short.size else None, durations)
