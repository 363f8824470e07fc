"""One window of signals for each cell: its transients of all trips, aligned and averaged.

All channels of a trip are shifted by the same time, so the relation between force, motor and table is the
same in the average as in each trip. Noise differs from trip to trip: an average over n trips contains 1/n of
its power, and 1/n of the bias that arises because the servo feeds noise back into the torque.
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
from ballscrew.modal.cell import CellKey, TransientRow
from ballscrew.modal.joint.signals import TripSignals, position_range

# Times, s.
BEFORE = 0.025  # from the start of a window to the start of its acceleration phase
AFTER = 0.16  # from the end of the phase to the end of the window, at most
_GAP = 0.005  # from the end of a window to the next phase, at least
_LARGEST_SHIFT = 0.004  # largest error of the start of a phase, which is found in the position
_ZERO_FORCE = 0.003  # at the start of a window, over which the force is averaged: this mean is subtracted
# At the start of a window, not fitted: the simulated responses begin at rest there, and the filter of the
# band has yet to settle in them.
_FILTER_SETTLES = 0.008
_AFTER_SLIP = 0.005  # from the first sample in which the table slides to the first that is fitted
_LEAST_COUNTED = 0.02  # shortest fitted part of a window
_SHORTER = 0.02  # by which the window of a transient may be shorter than the median of its cell

_FOR_DERIVATIVES = 2  # samples of a window after the last fitted one, for the second derivatives there

# Effects of the next three on the frequency: docs/explanation/identification.md, "Why the model has these
# parts".
_SLIDING = 0.02  # m/s: below it friction still falls from its static to its sliding value
_SLIDING_PART = 0.25  # over the highest speed: replaces _SLIDING in motions slower than 0.08 m/s
_STANDSTILL = 2e-3  # m/s: below it the guide may hold the table by static friction

# Largest rms deviation of the speed in a transient from the median of its cell, over the peak speed: a
# transient that deviates more is not averaged.
_LARGEST_DEVIATION = 0.05
_SUBSET_CELLS = 12  # approximate number of cells in a subset
_DRAG_PERIODS = 2.0  # length of the window that smooths the drag, over the period at the low end of the band
_HIGHEST = 0.42  # highest upper limit of a band, over the sampling rate: below half of it
_CONDITIONS = [str(condition) for condition in Condition]  # in the order in which cells are sorted

_FORCE, _SPEED, _DRAG, _NUT = 0, 3, 4, 7  # rows of the averaged channels


@dataclass(frozen=True, slots=True)
class Band:
    """Band-pass filter for the frequencies that are fitted, as second-order sections.

    Parameters
    ----------
    low, high : float
        Limits of the band, Hz.
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
    """Butterworth high-pass and low-pass of second order at the two limits of a band (Hz).

    The upper limit is lowered if the sampling rate (Hz) is too low for it.
    """
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
    channels : ndarray, shape (7 + responses, n)
        Rows: force, motor, centred_position, speed, drag, force_band, motor_band and each response, as in
        :class:`Windows`.
    from_rest, in_motion : ndarray of bool, shape (n,)
        As in :class:`Windows`.
    length : int
        Number of samples of the whole window; its end, in which nothing is fitted, is cut off.
    direction : float
        +1 or -1, the direction of motion.
    reversing : bool
        Whether the table departs against the direction in which it arrived: the guide then sticks longer.
    pieces : tuple of (trip, first sample) pairs
        The pieces of the recordings that were averaged: index of the trip, and index of the first sample in
        its channels.
    """

    cell: CellKey
    channels: Array
    from_rest: NDArray[np.bool_]
    in_motion: NDArray[np.bool_]
    length: int
    direction: float
    reversing: bool
    pieces: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Windows:
    """Averaged windows of all cells of a run, concatenated; in this package a variable ``w`` is one of these.

    Parameters
    ----------
    rate : float
        Sampling rate, Hz.
    band : Band
        Filter of the signals in the band.
    middle : float
        Position in the middle of the motion of all trips, m.
    cell_windows : tuple of CellWindow
        The same windows before concatenation.
    cells, reversing, pieces : tuple
        Those of each window, as in :class:`CellWindow`.
    starts : ndarray, shape (cells + 1,)
        Index of the first sample of each window, and the number of samples.
    from_rest : ndarray of bool, shape (n,)
        Samples that may be fitted; those of a departure from standstill on.
    in_motion : ndarray of bool, shape (n,)
        The same, but those of a departure only after the table has begun to slide.
    lengths : ndarray, shape (cells,)
        Number of samples of each whole window; its end, in which nothing is fitted, is cut off. The mean
        square of a residual, and so the weight of a block, refers to this number, so that no result depends
        on where windows are cut.
    direction : ndarray, shape (n,)
        +1 or -1, the direction of motion of the window.
    force : ndarray, shape (n,)
        Force over total inertia, m/s², less its mean at the start of each window.
    motor : ndarray, shape (n,)
        Acceleration of the motor, referred to the table, m/s².
    centred_position, speed : ndarray, shape (n,)
        Position from ``middle`` (m) and speed (m/s) of the table by the motor's encoder.
    drag : ndarray, shape (n,)
        ``force`` less ``motor``, smoothed, m/s²: friction of the whole axis over its inertia, less its mean
        at the start of each window.
    force_band, motor_band : ndarray, shape (n,)
        ``force`` and ``motor`` after the filter of the band, m/s².
    nut : ndarray, shape (responses, n)
        Accelerations at the nut after the filter of the band, m/s².
    """

    rate: float
    band: Band
    middle: float
    cell_windows: tuple[CellWindow, ...]
    cells: tuple[CellKey, ...]
    reversing: tuple[bool, ...]
    pieces: tuple[tuple[tuple[int, int], ...], ...]
    starts: NDArray[np.int64]
    from_rest: NDArray[np.bool_]
    in_motion: NDArray[np.bool_]
    lengths: NDArray[np.int64]
    direction: Array
    force: Array
    motor: Array
    centred_position: Array
    speed: Array
    drag: Array
    force_band: Array
    motor_band: Array
    nut: Array

    @property
    def spans(self) -> list[tuple[int, int]]:
        """Index of the first sample of each window, and index of the sample after its last."""
        return list(zip(self.starts[:-1].tolist(), self.starts[1:].tolist(), strict=True))

    @property
    def stops(self) -> Array:
        """Nominal position of each cell from the middle, m, shape (cells,)."""
        return np.array([cell.position for cell in self.cells]) - self.middle

    @property
    def stop_of_sample(self) -> Array:
        """Nominal position of the cell of each sample, from the mean of all cells, m, shape (n,)."""
        return np.repeat(self.stops - self.stops.mean(), np.diff(self.starts))


def average_windows(
    trips: Sequence[TripSignals], transients: Sequence[TransientRow], inertia: float, low: float, high: float
) -> Windows | None:
    """Average the transients of every cell.

    Parameters
    ----------
    trips : sequence of TripSignals
        Recordings, all at the same rate.
    transients : sequence of TransientRow
        Complete transients; the file of each is the index of its trip.
    inertia : float
        Total inertia, in units of force per m/s².
    low, high : float
        Limits of the band, Hz.

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
    for cell, starts, length in _complete_windows(trips, transients):
        window = _average(channels, cell, starts, length, rate, reversing)
        if window is not None:
            averaged.append(window)
    if not averaged:
        return None
    return _concatenate(rate, band, middle, averaged)


def _concatenate(rate: float, band: Band, middle: float, windows: Sequence[CellWindow]) -> Windows:
    """Concatenate the windows of cells."""
    cells, channels, from_rest, in_motion, lengths, direction, reversing, pieces = zip(*windows, strict=True)
    samples = [len(window) for window in from_rest]
    joined = np.concatenate(channels, axis=1)
    signals = (*joined[:_NUT], joined[_NUT:])  # in the order of the last fields of Windows
    return Windows(
        rate,
        band,
        middle,
        tuple(windows),
        cells,
        reversing,
        pieces,
        np.cumsum([0, *samples]),
        np.concatenate(from_rest),
        np.concatenate(in_motion),
        np.array(lengths),
        np.repeat(direction, samples),
        *signals,
    )


def subset(w: Windows) -> Windows:
    """Every k-th window, for the first fits: at most 23 windows, and at least 8 if there are so many."""
    step = max(1, len(w.cells) // _SUBSET_CELLS)
    step += step % 2 == 0  # a stop has four conditions: an even step would omit some of them
    return select_cells(w, range(0, len(w.cells), step))


def select_cells(w: Windows, selected: Sequence[int]) -> Windows:
    """Select some of the windows.

    Parameters
    ----------
    w : Windows
        Windows of all cells.
    selected : sequence of int
        Indices of the selected cells.

    Returns
    -------
    Windows
        Windows of the selected cells, in the order given.
    """
    return _concatenate(w.rate, w.band, w.middle, [w.cell_windows[i] for i in selected])


def _channels(trip: TripSignals, inertia: float, middle: float, band: Band) -> Array:
    """Signals of a whole trip, in the rows of :attr:`CellWindow.channels`."""
    from scipy.signal import sosfilt

    x = trip.position
    speed = np.gradient(x) * trip.rate
    motor = trip.motor
    if motor is None:
        motor = np.zeros_like(x)
        motor[1:-1] = (x[2:] - 2 * x[1:-1] + x[:-2]) * trip.rate**2
    force = trip.force / inertia
    filtered = sosfilt(band.sections, np.vstack([force - force[0], motor, trip.response]), axis=1)
    taps = np.hanning(min(round(_DRAG_PERIODS / band.low * trip.rate), len(x)) + 2)[1:-1]
    before = len(taps) // 2
    padded = np.pad(force - motor, (before, len(taps) - 1 - before), "edge")
    drag = np.convolve(padded, taps / taps.sum(), "valid")
    return np.vstack([force, motor, x - middle, speed, drag, filtered])


def _complete_windows(
    trips: Sequence[TripSignals], transients: Sequence[TransientRow]
) -> list[tuple[CellKey, list[tuple[int, int]], int]]:
    """For each cell the (trip, first sample) of its complete windows, and their common length in samples.

    A window is complete if the samples for a shift are recorded too, and if it is hardly shorter than the
    median of its cell: it then does not end early, before another phase.
    """
    rate = trips[0].rate
    margin = round(_LARGEST_SHIFT * rate) + 2  # samples; 2 since the derivatives lack samples at both ends
    out = []
    found = _windows_by_cell(trips, transients)
    for cell in sorted(found, key=lambda c: (c.position, _CONDITIONS.index(c.condition), c.motion)):
        length = int(np.median([window_length for _, _, window_length in found[cell]]))
        complete = []
        for trip, first, window_length in found[cell]:
            inside = first >= margin and first + length + margin <= len(trips[trip].position)
            if inside and window_length >= length - _SHORTER * rate:
                complete.append((trip, first))
        if complete and length > _LEAST_COUNTED * rate:
            out.append((cell, complete, length))
    return out


def _windows_by_cell(
    trips: Sequence[TripSignals], transients: Sequence[TransientRow]
) -> dict[CellKey, list[tuple[int, int, int]]]:
    """The (trip, first sample, length in samples) of the window of every transient, by cell.

    A window ends before the next phase of its trip.
    """
    found: dict[CellKey, list[tuple[int, int, int]]] = {}
    following = None  # the next transient: they are visited from the last to the first
    for transient in sorted(transients, key=lambda t: (t.file, t.start_s), reverse=True):
        rate, count = trips[transient.file].rate, len(trips[transient.file].position)
        end = transient.stop_s + AFTER
        if following is not None and following.file == transient.file:
            end = min(end, following.start_s - _GAP)
        first = round((transient.start_s - BEFORE) * rate)
        last = min(round(end * rate), count - 2)  # derivatives lack samples at the end of the recording
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
    """Averaged window of a cell from its (trip, first sample) pairs; None if too little of it can be fitted.

    ``reversing`` are the cells that depart against the direction of their arrival.
    """
    speeds = [channels[trip][_SPEED] for trip, _ in starts]
    shifted, alike = _align(speeds, [first for _, first in starts], length, rate)
    pieces = tuple((starts[i][0], shifted[i]) for i in np.flatnonzero(alike).tolist())
    if not pieces:
        return None
    mean = np.mean([channels[trip][:, first : first + length] for trip, first in pieces], axis=0)
    from_rest, in_motion = _counted_samples(mean[_SPEED], cell.condition, rate)
    if in_motion.sum() < _LEAST_COUNTED * rate:
        return None
    at_start = slice(max(1, round(_ZERO_FORCE * rate)))
    for channel in (_FORCE, _DRAG):
        mean[channel] -= mean[channel, at_start].mean()
    direction = float(np.sign(mean[_SPEED].sum()))
    used = slice(_used_length(from_rest))  # without the end, in which nothing is fitted
    return CellWindow(
        cell,
        mean[:, used],
        from_rest[used],
        in_motion[used],
        length,
        direction,
        cell in reversing,
        pieces,
    )


def _used_length(from_rest: NDArray[np.bool_]) -> int:
    """Number of samples of a window up to the last that may be fitted, and those for its derivatives."""
    return int(np.flatnonzero(from_rest)[-1]) + 1 + _FOR_DERIVATIVES


def _reversing(transients: Sequence[TransientRow]) -> set[CellKey]:
    """Cells that depart against the direction of the previous arrival."""
    out = set()
    for previous, transient in pairwise(sorted(transients, key=lambda t: (t.file, t.start_s))):
        before, condition = Condition(previous.condition), Condition(transient.condition)
        reverses = condition.accelerating and condition.direction != before.direction
        if previous.file == transient.file and reverses:
            out.add(transient.key)
    return out


def _align(
    speeds: Sequence[Array], starts: Sequence[int], length: int, rate: float
) -> tuple[list[int], NDArray[np.bool_]]:
    """First sample of every piece after alignment with the first piece, and whether it moves like the median.

    ``speeds`` are those of the whole trip of each piece, m/s, and ``starts`` the first samples in them. The
    shift with the least squared difference of the speeds is chosen.
    """
    reach = round(_LARGEST_SHIFT * rate)  # samples
    reference = speeds[0][starts[0] : starts[0] + length]
    shifted = []
    for speed, start in zip(speeds, starts, strict=True):
        around = sliding_window_view(speed[start - reach : start + reach + length], length)
        differences = np.sum((around - reference) ** 2, axis=1)
        shifted.append(start + int(np.argmin(differences)) - reach)
    pieces = np.array([v[s : s + length] for v, s in zip(speeds, shifted, strict=True)])
    median_speed = np.median(pieces, axis=0)
    peak = max(float(np.abs(median_speed).max()), 1e-12)
    deviation = np.sqrt(np.mean((pieces - median_speed) ** 2, axis=1)) / peak
    return shifted, deviation < _LARGEST_DEVIATION


def _counted_samples(
    speed: Array, condition: str, rate: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Samples ``from_rest`` and ``in_motion`` of a window, see :class:`Windows`.

    At standstill the guide holds the table by static friction, which acts as a spring of unknown stiffness,
    and friction changes its sign. An arrival is therefore fitted until the axis first stands still. A
    departure is fitted from the start of sliding; from standstill on only if friction is negligible.
    """
    count = len(speed)
    index = np.arange(count)
    settled = (index >= round(_FILTER_SETTLES * rate)) & (index < count - _FOR_DERIVATIVES)
    if Condition(condition).accelerating:
        magnitude = np.abs(speed)
        sliding = magnitude > min(_SLIDING, _SLIDING_PART * magnitude.max())
        first_sliding = int(np.argmax(sliding))
        return settled, settled & (index >= first_sliding + round(_AFTER_SLIP * rate))
    # The window of an arrival begins in motion.
    direction = np.sign(speed[: max(1, count // 8)].mean())
    standing = np.flatnonzero(speed * direction < _STANDSTILL)
    if len(standing):
        settled &= index < standing[0]
    return settled, settled
