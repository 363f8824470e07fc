"""One window a cell: its transients of all trips, aligned and averaged.

What links force, motor and table is the same before and after an average, whatever the shifts, since all
channels of a trip are shifted alike. Noise and what the servo makes of it are not: an average over n trips
has n times less of their power, and with it less of the bias that they cause in a closed loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.fcft.conditions import Condition
from ballscrew.modal.joint.band import Band, band_filter
from ballscrew.modal.joint.signals import Mark, TripSignals

__all__ = ["Cell", "Windows", "every_few", "of_cells", "windows"]

Cell = tuple[float, str, int]

BEFORE = 0.025  # s kept before a phase
AFTER = 0.16  # s kept after it, at most
_APART = 0.005  # s kept clear of the next phase
_SHIFT = 0.004  # s that a phase found in the position may be off
_SETTLE = 0.008  # s of a window in which the filter settles
_GONE = 0.02  # m/s: below it friction still falls from that of standstill to that of motion
_GONE_PART = 0.25  # of the highest speed, where that is less
_FREE = 0.005  # s after that
_STANDS = 2e-3  # m/s: below it the guide may hold the table
_LEAST = 0.02  # s of a window that must remain
_ALIKE = 0.05  # of the peak speed by which a trip may differ from the others, root mean square
_FEW = 12  # cells


@dataclass(frozen=True, slots=True)
class Windows:
    """All cells of a run, one averaged window each, one after the other.

    Parameters
    ----------
    rate : float
        Hz.
    band : Band
        Of the responses.
    first : ndarray, shape (cells + 1,)
        First sample of each.
    cells : tuple of (position, condition, motion)
        What each is.
    repetitions : ndarray, shape (cells,)
        Trips averaged.
    dropped : tuple of int
        Trips of each that moved unlike the others.
    force : ndarray, shape (n,)
        Over the whole mass, m/s², 0 at each window's start.
    motor : ndarray, shape (n,)
        Acceleration of the motor, m/s².
    place, speed : ndarray, shape (n,)
        Of the motor's encoder, m from ``middle``, and m/s.
    nut : ndarray, shape (n_responses, n)
        Accelerations in the band, m/s².
    motor_band, force_band : ndarray, shape (n,)
        ``motor`` and ``force`` in the band.
    early, late : ndarray of bool, shape (n,)
        Samples that count: with and without those of the departure from standstill.
    way : ndarray, shape (n,)
        +1 or -1, as the window moves.
    turning : tuple of bool
        Of each cell whether it departs against the way that it came: the guide then lets go late.
    middle : float
        m.
    pieces : tuple of (trip, first sample) pairs
        Of each cell, what was averaged.
    """

    rate: float
    band: Band
    first: NDArray[np.int64]
    cells: tuple[Cell, ...]
    repetitions: NDArray[np.int64]
    dropped: tuple[int, ...]
    force: Array
    motor: Array
    place: Array
    speed: Array
    nut: Array
    motor_band: Array
    force_band: Array
    early: NDArray[np.bool_]
    late: NDArray[np.bool_]
    way: Array
    turning: tuple[bool, ...]
    middle: float
    pieces: tuple[tuple[tuple[int, int], ...], ...]

    @property
    def spans(self) -> list[tuple[int, int]]:
        """First sample of each window and the one after its last."""
        return list(zip(self.first[:-1].tolist(), self.first[1:].tolist(), strict=True))


def windows(
    trips: Sequence[TripSignals], marks: Sequence[Mark], mass: float, low: float, high: float
) -> Windows | None:
    """Average the transients of every cell.

    Parameters
    ----------
    trips : sequence of TripSignals
        Of one rate.
    marks : sequence of Mark
        Where the phases lie.
    mass : float
        Whole mass, in units of force per m/s².
    low, high : float
        Of the band, Hz.

    Returns
    -------
    Windows or None
        None where no cell has a window.
    """
    rate = trips[0].rate
    band = band_filter(low, high, rate)
    places = [t.position for t in trips]
    middle = (min(float(p.min()) for p in places) + max(float(p.max()) for p in places)) / 2
    rows = [_channels(t, mass, middle, band) for t in trips]
    turned = _turning(marks)
    parts, kept, taken = [], [], []
    for cell, starts, length in _spans(trips, marks):
        good, dropped = _aligned([rows[t][3] for t, _ in starts], [s for _, s in starts], length, rate)
        if not good:
            continue
        pieces = [rows[starts[i][0]][:, s : s + length] for i, s in good]
        part = np.mean(pieces, axis=0)
        early, late = _counting(part[3], cell[1], rate)
        if late.sum() < _LEAST * rate:
            continue
        part[0] -= part[0, : max(1, round(0.003 * rate))].mean()
        parts.append((part, early, late))
        kept.append((cell, len(good), dropped))
        taken.append(tuple((starts[i][0], s) for i, s in good))
    if not parts:
        return None
    all_of = np.concatenate([p[0] for p in parts], axis=1)
    return Windows(
        rate=rate,
        band=band,
        first=np.cumsum([0, *(p[0].shape[1] for p in parts)]),
        cells=tuple(cell for cell, _, _ in kept),
        repetitions=np.array([n for _, n, _ in kept]),
        dropped=tuple(n for _, _, n in kept),
        force=all_of[0].copy(),
        motor=all_of[1].copy(),
        place=all_of[2].copy(),
        speed=all_of[3].copy(),
        force_band=all_of[4].copy(),
        motor_band=all_of[5].copy(),
        nut=all_of[6:].copy(),
        early=np.concatenate([p[1] for p in parts]),
        late=np.concatenate([p[2] for p in parts]),
        way=np.concatenate([np.full(len(p[1]), np.sign(p[0][3].sum())) for p in parts]),
        turning=tuple(cell in turned for cell, _, _ in kept),
        middle=middle,
        pieces=tuple(taken),
    )


def every_few(w: Windows) -> Windows:
    """Every so many of the windows, for a first look: a dozen or two."""
    step = max(1, len(w.cells) // _FEW)
    return of_cells(w, range(0, len(w.cells), step + (step % 2 == 0)))  # an even one leaves conditions out


def of_cells(w: Windows, picked: Sequence[int]) -> Windows:
    """Some of the windows.

    Parameters
    ----------
    w : Windows
        All.
    picked : sequence of int
        Which cells, by their number.

    Returns
    -------
    Windows
        Those, in the order named.
    """
    index = np.concatenate([np.arange(*w.spans[i]) for i in picked])
    return replace(
        w,
        first=np.cumsum([0, *(w.spans[i][1] - w.spans[i][0] for i in picked)]),
        cells=tuple(w.cells[i] for i in picked),
        repetitions=w.repetitions[list(picked)],
        dropped=tuple(w.dropped[i] for i in picked),
        force=w.force[index],
        motor=w.motor[index],
        place=w.place[index],
        speed=w.speed[index],
        nut=np.ascontiguousarray(w.nut[:, index]),
        motor_band=w.motor_band[index],
        force_band=w.force_band[index],
        early=w.early[index],
        late=w.late[index],
        way=w.way[index],
        turning=tuple(w.turning[i] for i in picked),
        pieces=tuple(w.pieces[i] for i in picked),
    )


def _channels(trip: TripSignals, mass: float, middle: float, band: Band) -> Array:
    from scipy.signal import sosfilt

    x = trip.position
    speed = np.gradient(x) * trip.rate
    motor = np.zeros_like(x)
    motor[1:-1] = (x[2:] - 2 * x[1:-1] + x[:-2]) * trip.rate**2
    force = trip.force / mass
    filtered = sosfilt(band.sections, np.vstack([force - force[0], motor, trip.response]), axis=1)
    return np.vstack([force, motor, x - middle, speed, filtered])


def _spans(
    trips: Sequence[TripSignals], marks: Sequence[Mark]
) -> list[tuple[Cell, list[tuple[int, int]], int]]:
    """Of each cell the trips and first samples of its windows, and their common length."""
    order = sorted(marks, key=lambda m: (m.trip, m.start))
    found: dict[Cell, list[tuple[int, int, int]]] = {}
    for i, mark in enumerate(order):
        trip = trips[mark.trip]
        ends = mark.stop + AFTER
        if i + 1 < len(order) and order[i + 1].trip == mark.trip:
            ends = min(ends, order[i + 1].start - _APART)
        first = round((mark.start - BEFORE) * trip.rate)
        last = min(round(ends * trip.rate), len(trip.position) - 2)
        cell = (mark.position, str(mark.condition), mark.motion)
        found.setdefault(cell, []).append((mark.trip, first, last - first))
    conditions = list(Condition)
    out = []
    for cell in sorted(found, key=lambda c: (c[0], conditions.index(Condition(c[1])), c[2])):
        rows = found[cell]
        rate = trips[rows[0][0]].rate
        length = int(np.median([n for _, _, n in rows]))
        edge = round(_SHIFT * rate) + 2
        fit = [
            (t, s)
            for t, s, n in rows
            if n >= length - 0.02 * rate and s >= edge and s + length + edge <= len(trips[t].position)
        ]
        if fit and length > _LEAST * rate:
            out.append((cell, fit, length))
    return out


def _turning(marks: Sequence[Mark]) -> set[Cell]:
    """Cells that depart against the way that the trip came by."""
    order = sorted(marks, key=lambda m: (m.trip, m.start))
    return {
        (m.position, str(m.condition), m.motion)
        for before, m in pairwise(order)
        if before.trip == m.trip
        and str(m.condition)[1] == "A"
        and str(before.condition)[0] != str(m.condition)[0]
    }


def _aligned(
    speeds: Sequence[Array], starts: Sequence[int], length: int, rate: float
) -> tuple[list[tuple[int, int]], int]:
    """Shift every trip onto the first; leave out those that move unlike the others."""
    reach = round(_SHIFT * rate)
    like = speeds[0][starts[0] : starts[0] + length]
    shifted = []
    for speed, start in zip(speeds, starts, strict=True):
        around = sliding_window_view(speed[start - reach : start + reach + length], length)
        misses = np.sum((around - like) ** 2, axis=1)
        shifted.append(start + int(np.argmin(misses)) - reach)
    pieces = np.array([v[s : s + length] for v, s in zip(speeds, shifted, strict=True)])
    usual = np.median(pieces, axis=0)
    off = np.sqrt(np.mean((pieces - usual) ** 2, axis=1)) / max(float(np.abs(usual).max()), 1e-12)
    good = [(i, s) for i, s in enumerate(shifted) if off[i] < _ALIKE]
    return good, len(shifted) - len(good)


def _counting(speed: Array, condition: str, rate: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which samples count.

    At standstill the guide holds the table by a spring of its own, and friction changes its sign: neither is
    known. So an arrival counts until the axis first stands, and a departure from when it has left, or
    whole, where its friction is too small to be seen.
    """
    count = len(speed)
    index = np.arange(count)
    early = index >= round(_SETTLE * rate)
    if condition.endswith("A"):
        swift = np.abs(speed)
        gone = int(np.argmax(swift > min(_GONE, _GONE_PART * swift.max()))) + round(_FREE * rate)
        return early, early & (index >= gone)
    ahead = speed * np.sign(speed[: max(1, count // 8)].mean())
    slow = np.flatnonzero(ahead < _STANDS)
    moving = early & (index < (slow[0] if len(slow) else count))
    return moving, moving
