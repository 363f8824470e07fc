"""One window of signals for each cell: its transients of all trips, aligned and averaged.

Force, motor and table have the same relation before and after averaging, whatever the shifts, since all
channels of a trip are shifted alike. Noise, and what the servo makes of it, have none: an average over n
trips has n times less of their power, and with it less of the bias that they cause in a closed loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.fcft.conditions import Condition
from ballscrew.modal.joint.signals import TripSignals, position_range
from ballscrew.modal.run import CellKey, TransientRow

BEFORE = 0.025  # s of a window before a phase
AFTER = 0.16  # s of a window after it, at most
_GAP = 0.005  # s between a window and the next phase
_SHIFT = 0.004  # s by which the start of a phase found in the position may be wrong
_BASELINE = 0.003  # s at the start of a window whose mean force is taken as zero
_SETTLE = 0.008  # s of a window in which the filter settles
_SLIDING = 0.02  # m/s: below it friction still falls from that of standstill to that of motion
_SLIDING_PART = 0.25  # of the highest speed, if that is less
_FREE = 0.005  # s after sliding has begun, from which a departure counts
_STANDSTILL = 2e-3  # m/s: below it the guide may hold the table by static friction
_LEAST = 0.02  # s of a window that must count
_SHORTER = 0.02  # s by which a transient may be shorter than the median of its cell
_ALIKE = 0.05  # of the peak speed: limit of a trip's root mean square deviation from the median trip
_FEW = 12  # cells of a subset, at least
_HIGHEST = 0.42  # of the sampling rate: upper limit of the band
_CONDITIONS = [str(condition) for condition in Condition]

_FORCE, _SPEED, _NUT = 0, 3, 6  # rows of the averaged channels


@dataclass(frozen=True, slots=True)
class Band:
    """Band-pass filter of the searched band, as second-order sections.

    Parameters
    ----------
    low, high : float
        Hz.
    numerator, denominator : ndarray, shape (sections, 3) and (sections, 2)
        Coefficients, without the leading 1 of the denominators.
    """

    low: float
    high: float
    numerator: Array
    denominator: Array

    @property
    def sections(self) -> Array:
        """Coefficients in the form of scipy, shape (sections, 6)."""
        return np.hstack([self.numerator, np.ones((len(self.numerator), 1)), self.denominator])


def band_filter(low: float, high: float, rate: float) -> Band:
    """Butterworth filter of second order at either end of a band (Hz)."""
    from scipy.signal import butter

    high = min(high, _HIGHEST * rate)
    sections = np.concatenate(
        [butter(2, low, "high", fs=rate, output="sos"), butter(2, high, "low", fs=rate, output="sos")]
    )
    return Band(low, high, np.ascontiguousarray(sections[:, :3]), np.ascontiguousarray(sections[:, 4:]))


class CellWindow(NamedTuple):
    """Averaged window of one cell.

    Parameters
    ----------
    cell : CellKey
        The cell.
    channels : ndarray, shape (6 + responses, n)
        Signals ``force`` to ``nut`` of :class:`Windows`.
    from_rest, in_motion : ndarray of bool, shape (n,)
        As those of :class:`Windows`.
    direction : float
        +1 or -1, the direction of motion.
    reversing : bool
        Whether the cell departs against the direction of its arrival: the guide then sticks longer.
    pieces : tuple of (trip, first sample) pairs
        Averaged pieces.
    """

    cell: CellKey
    channels: Array
    from_rest: NDArray[np.bool_]
    in_motion: NDArray[np.bool_]
    direction: float
    reversing: bool
    pieces: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Windows:
    """Averaged windows of all cells of a run, concatenated.

    Parameters
    ----------
    rate : float
        Sampling rate, Hz.
    band : Band
        Filter of the signals in the band.
    middle : float
        Middle of the axis, m.
    separate : tuple of CellWindow
        The windows one by one.
    cells, reversing, pieces : tuple
        Of each window, as in :class:`CellWindow`.
    first : ndarray, shape (cells + 1,)
        First sample of each window, and the end of the last.
    from_rest, in_motion : ndarray of bool, shape (n,)
        Samples that count, with and without those of the departure from standstill.
    direction : ndarray, shape (n,)
        +1 or -1, the direction of motion of the window.
    force : ndarray, shape (n,)
        Force over total inertia, m/s², 0 at the start of each window.
    motor, place, speed : ndarray, shape (n,)
        Acceleration (m/s²), position from ``middle`` (m) and speed (m/s) by the motor's encoder.
    force_band, motor_band : ndarray, shape (n,)
        ``force`` and ``motor`` in the band, m/s².
    nut : ndarray, shape (responses, n)
        Accelerations at the nut in the band, m/s².
    """

    rate: float
    band: Band
    middle: float
    separate: tuple[CellWindow, ...]
    cells: tuple[CellKey, ...]
    reversing: tuple[bool, ...]
    pieces: tuple[tuple[tuple[int, int], ...], ...]
    first: NDArray[np.int64]
    from_rest: NDArray[np.bool_]
    in_motion: NDArray[np.bool_]
    direction: Array
    force: Array
    motor: Array
    place: Array
    speed: Array
    force_band: Array
    motor_band: Array
    nut: Array

    @property
    def spans(self) -> list[tuple[int, int]]:
        """First sample of each window and the one after its last."""
        return list(zip(self.first[:-1].tolist(), self.first[1:].tolist(), strict=True))

    @property
    def stops(self) -> Array:
        """Nominal position of each cell from the middle, m."""
        return np.array([cell.position for cell in self.cells]) - self.middle


def average_windows(
    trips: Sequence[TripSignals], transients: Sequence[TransientRow], inertia: float, low: float, high: float
) -> Windows | None:
    """Average the transients of every cell.

    Parameters
    ----------
    trips : sequence of TripSignals
        Of one rate.
    transients : sequence of TransientRow
        Complete ones, each with the index of its trip as file.
    inertia : float
        Total inertia, in units of force per m/s².
    low, high : float
        Of the band, Hz.

    Returns
    -------
    Windows or None
        None if no cell has a window.
    """
    rate = trips[0].rate
    band = band_filter(low, high, rate)
    middle = sum(position_range(trips)) / 2
    channels = [_channels(trip, inertia, middle, band) for trip in trips]
    reversing = _reversing(transients)
    averaged = []
    for cell, starts, length in _phases(trips, transients):
        window = _average(channels, cell, starts, length, rate, reversing)
        if window is not None:
            averaged.append(window)
    if not averaged:
        return None
    return _concatenate(rate, band, middle, averaged)


def _concatenate(rate: float, band: Band, middle: float, windows: Sequence[CellWindow]) -> Windows:
    """Windows of cells, one after the other."""
    cells, channels, from_rest, in_motion, direction, reversing, pieces = zip(*windows, strict=True)
    lengths = [*map(len, from_rest)]
    joined = np.concatenate(channels, axis=1)
    signals = (*joined[:_NUT], joined[_NUT:])
    return Windows(
        rate,
        band,
        middle,
        tuple(windows),
        cells,
        reversing,
        pieces,
        np.cumsum([0, *lengths]),
        np.concatenate(from_rest),
        np.concatenate(in_motion),
        np.repeat(direction, lengths),
        *signals,
    )


def subset(w: Windows) -> Windows:
    """Every k-th window, 12 to 24 of them, for a first fit."""
    step = max(1, len(w.cells) // _FEW)
    step += step % 2 == 0  # an even step would leave conditions out
    return select_cells(w, range(0, len(w.cells), step))


def select_cells(w: Windows, selected: Sequence[int]) -> Windows:
    """Some of the windows.

    Parameters
    ----------
    w : Windows
        All.
    selected : sequence of int
        Indices of the cells.

    Returns
    -------
    Windows
        Those, in the order given.
    """
    return _concatenate(w.rate, w.band, w.middle, [w.separate[i] for i in selected])


def _channels(trip: TripSignals, inertia: float, middle: float, band: Band) -> Array:
    """Channels of a trip, in the order of ``_FORCE`` to ``_NUT``."""
    from scipy.signal import sosfilt

    x = trip.position
    speed = np.gradient(x) * trip.rate
    motor = np.zeros_like(x)
    motor[1:-1] = (x[2:] - 2 * x[1:-1] + x[:-2]) * trip.rate**2
    force = trip.force / inertia
    filtered = sosfilt(band.sections, np.vstack([force - force[0], motor, trip.response]), axis=1)
    return np.vstack([force, motor, x - middle, speed, filtered])


def _phases(
    trips: Sequence[TripSignals], transients: Sequence[TransientRow]
) -> list[tuple[CellKey, list[tuple[int, int]], int]]:
    """Trip and first sample of each window of a cell, and the cell's common length in samples."""
    rate = trips[0].rate
    margin = round(_SHIFT * rate) + 2
    out = []
    found = _own_windows(trips, transients)
    for cell in sorted(found, key=lambda c: (c.position, _CONDITIONS.index(c.condition), c.motion)):
        length = int(np.median([own_length for _, _, own_length in found[cell]]))
        complete = []
        for trip, first, own_length in found[cell]:
            inside = first >= margin and first + length + margin <= len(trips[trip].position)
            if inside and own_length >= length - _SHORTER * rate:
                complete.append((trip, first))
        if complete and length > _LEAST * rate:
            out.append((cell, complete, length))
    return out


def _own_windows(
    trips: Sequence[TripSignals], transients: Sequence[TransientRow]
) -> dict[CellKey, list[tuple[int, int, int]]]:
    """Trip, first sample and length in samples of the window of every transient, by cell."""
    found: dict[CellKey, list[tuple[int, int, int]]] = {}
    following = None
    for transient in sorted(transients, key=lambda t: (t.file, t.start_s), reverse=True):
        rate, count = trips[transient.file].rate, len(trips[transient.file].position)
        end = transient.stop_s + AFTER
        if following is not None and following.file == transient.file:
            end = min(end, following.start_s - _GAP)
        first = round((transient.start_s - BEFORE) * rate)
        last = min(round(end * rate), count - 2)
        found.setdefault(transient.key, []).insert(0, (transient.file, first, last - first))
        following = transient
    return found


def _average(
    channels: Sequence[Array],
    cell: CellKey,
    starts: Sequence[tuple[int, int]],
    length: int,
    rate: float,
    reversing: set[CellKey],
) -> CellWindow | None:
    """Averaged window of a cell; None if too little of it counts."""
    speeds = [channels[trip][_SPEED] for trip, _ in starts]
    shifted, alike = _align(speeds, [first for _, first in starts], length, rate)
    pieces = tuple((starts[i][0], shifted[i]) for i in np.flatnonzero(alike).tolist())
    if not pieces:
        return None
    mean = np.mean([channels[trip][:, first : first + length] for trip, first in pieces], axis=0)
    from_rest, in_motion = _counted_samples(mean[_SPEED], cell.condition, rate)
    if in_motion.sum() < _LEAST * rate:
        return None
    mean[_FORCE] -= mean[_FORCE, : max(1, round(_BASELINE * rate))].mean()
    direction = float(np.sign(mean[_SPEED].sum()))
    return CellWindow(cell, mean, from_rest, in_motion, direction, cell in reversing, pieces)


def _reversing(transients: Sequence[TransientRow]) -> set[CellKey]:
    """Cells that depart against the direction of the previous arrival."""
    out = set()
    for previous, transient in pairwise(sorted(transients, key=lambda t: (t.file, t.start_s))):
        departing = transient.condition[1] == "A"
        other_direction = previous.condition[0] != transient.condition[0]
        if previous.file == transient.file and departing and other_direction:
            out.add(transient.key)
    return out


def _align(
    speeds: Sequence[Array], starts: Sequence[int], length: int, rate: float
) -> tuple[list[int], NDArray[np.bool_]]:
    """First sample of every trip aligned with the first trip, and whether it moves like the median trip."""
    reach = round(_SHIFT * rate)
    reference = speeds[0][starts[0] : starts[0] + length]
    shifted = []
    for speed, start in zip(speeds, starts, strict=True):
        around = sliding_window_view(speed[start - reach : start + reach + length], length)
        misses = np.sum((around - reference) ** 2, axis=1)
        shifted.append(start + int(np.argmin(misses)) - reach)
    pieces = np.array([v[s : s + length] for v, s in zip(speeds, shifted, strict=True)])
    usual = np.median(pieces, axis=0)
    peak = max(float(np.abs(usual).max()), 1e-12)
    off = np.sqrt(np.mean((pieces - usual) ** 2, axis=1)) / peak
    return shifted, off < _ALIKE


def _counted_samples(
    speed: Array, condition: str, rate: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Samples that count, with and without those of the departure from standstill.

    At standstill the guide holds the table by a spring of its own, and friction changes its sign: neither is
    known. So an arrival counts until the axis first stands, and a departure once it slides, or from the start
    if its friction is too small to matter.
    """
    count = len(speed)
    index = np.arange(count)
    settled = index >= round(_SETTLE * rate)
    if condition.endswith("A"):
        size = np.abs(speed)
        sliding = int(np.argmax(size > min(_SLIDING, _SLIDING_PART * size.max()))) + round(_FREE * rate)
        return settled, settled & (index >= sliding)
    ahead = speed * np.sign(speed[: max(1, count // 8)].mean())
    standing = np.flatnonzero(ahead < _STANDSTILL)
    if len(standing):
        settled &= index < standing[0]
    return settled, settled
