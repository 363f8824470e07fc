"""Torque, motion and accelerations of one recording well below the axial mode, where the axis is one mass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, sosfiltfilt

from ballscrew.base.arrays import Array
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.phases import Phase

__all__ = ["Fit", "LowBand", "fit_late", "low_band"]


# Modes of feed axes lie at 60 Hz and above. At a quarter of that, what the mode adds is even in the frequency
# but for a term of its third power times the damping: it cannot pass for a delay.
_BAND = 15.0  # Hz
_ORDER = 4
_COARSE_RATE = 1000.0  # Hz; a mean over blocks, the same for all signals
_BEFORE, _AFTER = 0.05, 0.10  # s around a phase
_MOVING = 0.02  # of the cruising speed
_STANDING = 0.005  # of it: the sign of a speed below that is the encoder's noise
_FEWEST = 3  # phases
_SEARCH = 0.06  # s: the longest delay that is looked for
_STEPS = 25
_GROUPS = 20  # parts left out in turn to see the scatter


@dataclass(frozen=True, slots=True)
class LowBand:
    """All signals below 15 Hz, at about 1 kHz.

    Parameters
    ----------
    rate : float
        Hz.
    drive : ndarray, shape (n,)
        Torque, force or current.
    response : ndarray, shape (n_responses, n)
        Accelerations, m/s².
    speed, acceleration : ndarray, shape (n,)
        From the encoder, m/s and m/s².
    friction : ndarray, shape (3, n)
        Shapes of friction over the speed: its sign, its rise near standstill, a shift of its step.
    part : ndarray of int, shape (n,)
        Number of the phase that a sample lies around, −1 elsewhere.
    moving : ndarray of bool, shape (n,)
        Where friction has a sign.
    place, raw_drive : ndarray, shape (n,)
        Position and drive before the filter.
    raw_response : ndarray, shape (n_responses, n)
        Accelerations before it.
    cruise : float
        Speed that the axis reaches, m/s.
    """

    rate: float
    drive: Array
    response: Array
    speed: Array
    acceleration: Array
    friction: Array
    part: NDArray[np.intp]
    moving: NDArray[np.bool_]
    place: Array
    raw_drive: Array
    raw_response: Array
    cruise: float

    def derivative(self, x: Array) -> Array:
        """Of a signal by the time."""
        return np.asarray(np.gradient(x) * self.rate)


@dataclass(frozen=True, slots=True)
class Fit:
    """How a signal follows another one.

    Parameters
    ----------
    gain : float
        Of the signal over the other.
    late : float
        By how much the signal is late, s.
    uncertainty : float
        Standard uncertainty of ``late``, from leaving out parts of the record, s.
    explained : float
        Share of the signal's variance that the fit explains.
    """

    gain: float
    late: float
    uncertainty: float
    explained: float


def low_band(aligned: Aligned, phases: Sequence[Phase]) -> LowBand | None:
    """Filter a recording for comparisons below the axial mode.

    Parameters
    ----------
    aligned : Aligned
        One recording.
    phases : sequence of Phase
        Of it.

    Returns
    -------
    LowBand or None
        None where there are fewer than three phases or the rate is too low.
    """
    step = max(1, round(aligned.rate / _COARSE_RATE))
    rate = aligned.rate / step
    size = len(aligned.position) // step * step
    settle = round(2 * rate / _BAND)
    count = size // step
    if len(phases) < _FEWEST or rate < 8 * _BAND or count < 6 * settle:
        return None
    if not all(np.isfinite(x).all() for x in (aligned.input, aligned.position, aligned.response)):
        return None
    band = butter(_ORDER, _BAND, fs=rate, output="sos")

    def coarse(x: Array) -> Array:
        return np.asarray(x[..., :size].reshape(*x.shape[:-1], -1, step).mean(axis=-1))

    def low(x: Array) -> Array:
        return np.asarray(sosfiltfilt(band, x, axis=-1))

    place = coarse(aligned.position - aligned.position[0])
    raw_speed = gaussian_filter1d(np.gradient(place) * rate, 0.003 * rate)
    cruise = float(np.percentile(np.abs(raw_speed), 99))
    sign = np.where(np.abs(raw_speed) < _STANDING * cruise, 0.0, np.sign(raw_speed))
    rise = sign * np.exp(-((raw_speed / (0.1 * max(cruise, 1e-12))) ** 2))
    speed = np.gradient(low(place)) * rate
    part = np.full(count, -1, dtype=np.intp)
    for index, phase in enumerate(phases):
        first = int((phase.start / aligned.rate - _BEFORE) * rate)
        part[max(first, 0) : int((phase.stop / aligned.rate + _AFTER) * rate)] = index
    part[:settle] = part[-settle:] = -1  # the filter's own start and end are no measurement
    raw_drive, raw_response = coarse(aligned.input), coarse(aligned.response)
    return LowBand(
        rate=rate,
        drive=low(raw_drive),
        response=low(raw_response),
        speed=speed,
        acceleration=np.gradient(speed) * rate,
        friction=low(np.stack([sign, rise, np.gradient(sign) * rate])),
        part=part,
        moving=np.abs(raw_speed) > _MOVING * cruise,
        place=place,
        raw_drive=raw_drive,
        raw_response=raw_response,
        cruise=cruise,
    )


def fit_late(
    band: LowBand, signal: Array, follows: Array, others: Sequence[Array], used: NDArray[np.bool_]
) -> Fit | None:
    """Fit ``signal(t) = gain · follows(t − late) + others``, with the rise of the gain towards the mode.

    To first order in the delay the fit is linear: the delay is minus the coefficient of the derivative over
    the gain. It is repeated with the signal shifted by what was found until nothing is left, from the best of
    25 delays up to ±60 ms.

    Parameters
    ----------
    band : LowBand
        Where the signals are from.
    signal, follows : ndarray, shape (n,)
        The signal, and the one that it follows.
    others : sequence of ndarray, shape (n,)
        What adds to it.
    used : ndarray of bool, shape (n,)
        Samples of the fit.

    Returns
    -------
    Fit or None
        None where there is too little motion to tell.
    """
    thin = max(1, int(band.rate / (4 * _BAND)))
    rows = np.flatnonzero(used)[::thin]
    first = band.derivative(follows)
    columns = np.stack([follows, first, band.derivative(first), *others, np.ones_like(follows)])[:, rows]
    scale = columns.std(axis=1)
    scale[-1] = 1.0
    if len(rows) < 5 * len(columns) or not np.isfinite(scale).all() or scale[0] == 0 or scale[1] == 0:
        return None
    columns /= np.where(scale > 0, scale, 1.0)[:, None]
    at = rows.astype(np.float64)
    index = np.arange(len(signal), dtype=np.float64)

    def shifted(late: float) -> Array:
        return np.asarray(np.interp(at + late * band.rate, index, signal))

    def solved(late: float) -> tuple[Array, float]:
        wanted = shifted(late)
        answer = np.asarray(np.linalg.lstsq(columns.T, wanted, rcond=1e-10)[0], dtype=np.float64)
        return answer, float(np.var(wanted - answer @ columns) / max(float(np.var(wanted)), 1e-300))

    late = min(np.linspace(-_SEARCH, _SEARCH, _STEPS), key=lambda trial: solved(float(trial))[1])
    for _ in range(8):
        answer, left = solved(float(late))
        if answer[0] == 0:
            return None
        change = -float(answer[1] / answer[0] * scale[0] / scale[1])
        if not np.isfinite(change):
            return None
        late = float(
            np.clip(late + np.clip(change, -_SEARCH / 4, _SEARCH / 4), -1.5 * _SEARCH, 1.5 * _SEARCH)
        )
        if abs(change) < 1e-7:
            break
    wanted = shifted(float(late))
    parts = band.part[rows]
    names = np.unique(parts)
    group = np.searchsorted(names, parts) * min(_GROUPS, len(names)) // len(names)
    ratio = float(scale[0] / scale[1])
    apart = [late + _left(columns, wanted, group != g, ratio) for g in range(int(group.max()) + 1)]
    count = len(apart)
    spread = np.sqrt((count - 1) / count * np.sum((np.array(apart) - np.mean(apart)) ** 2))
    return Fit(
        gain=float(answer[0] / scale[0]),
        late=float(late),
        uncertainty=float(spread),
        explained=1.0 - left,
    )


def _left(columns: Array, wanted: Array, used: NDArray[np.bool_], ratio: float) -> float:
    """Delay that is left in some of the samples, s."""
    answer = np.linalg.lstsq(columns[:, used].T, wanted[used], rcond=1e-10)[0]
    return -float(answer[1] / answer[0]) * ratio if answer[0] != 0 else 0.0
