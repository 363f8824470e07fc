"""Delays of torque and accelerations against the encoder, well below the axial mode.

Below the mode the axis is one mass and a torque follows the encoder's acceleration. Near standstill friction
bends it, by an amount that depends on the servo: a delay that is fitted there is wrong by up to half a
millisecond. In full motion only dry friction, which is constant from stop to stop, and viscous friction
remain; and with the table's own acceleration beside the rotor's, the mode needs no model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, gaussian_filter1d

from ballscrew.base.arrays import Array
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.phases import MotionPhase
from ballscrew.recording.quality.signal_faults import block_means, true_spans

# Modes of feed axes lie at 60 Hz and above. At a quarter of that, what the mode adds is even in the frequency
# except for a term of its third power times the damping: it cannot pass for a delay.
_BAND = 15.0  # Hz
_ORDER = 4
_COARSE_RATE = 1000.0  # Hz, of means over blocks, the same for all signals
_BEFORE, _AFTER = 0.05, 0.10  # s around a phase
_MOVING = 0.02  # of the cruising speed
_STANDING = 0.005  # of the cruising speed: below, the sign of a speed is noise of the encoder
_FEWEST = 3  # phases, and spans from stop to stop
_SEARCH = 0.06  # s: longest delay of the search
_STEPS = 25
_GROUPS = 20  # parts of the record that the jackknife leaves out in turn
_PASSES = 8
_SETTLED = 1e-7  # s

_SMOOTHING = 5e-3  # s: a jerk of 10 ms is resolved, ripple and noise above 50 Hz are removed
_LEAST_SMOOTHING = 2.0  # samples
_FAST = 0.3  # of the cruising speed
_GUARD = 2.0  # standard deviations of the smoothing, over which standstill reaches into the motion
_LEAST_SPAN = 10  # samples


@dataclass(frozen=True, slots=True)
class LowBand:
    """All signals below 15 Hz, at about 1 kHz.

    Parameters
    ----------
    rate : float
        Sample rate, Hz.
    drive : ndarray, shape (n,)
        Torque, force or current.
    response : ndarray, shape (n_responses, n)
        Accelerations, m/s².
    speed, acceleration : ndarray, shape (n,)
        From the encoder, m/s and m/s².
    friction : ndarray, shape (3, n)
        Shapes of friction over the speed: its sign, its rise near standstill, a shift of its step.
    part : ndarray of int, shape (n,)
        Number of the phase around a sample, −1 elsewhere.
    moving : ndarray of bool, shape (n,)
        Where friction has a sign.
    place, raw_drive : ndarray, shape (n,)
        Position and drive before the filter.
    raw_response : ndarray, shape (n_responses, n)
        Accelerations before the filter.
    cruise : float
        Cruising speed of the axis, m/s.
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
        """Derivative of a signal with respect to time."""
        return np.asarray(np.gradient(x) * self.rate)


@dataclass(frozen=True, slots=True)
class LagFit:
    """Gain and delay of a signal against another.

    Parameters
    ----------
    gain : float
        Gain of the signal over the other.
    late : float
        Delay of the signal, s.
    uncertainty : float
        Standard uncertainty of ``late`` by the jackknife over parts of the record, s.
    explained : float
        Share of the signal's variance that the fit explains.
    """

    gain: float
    late: float
    uncertainty: float
    explained: float


@dataclass(frozen=True, slots=True)
class TwoMasses:
    """Torque as that of rotor and table, each with its own acceleration.

    Parameters
    ----------
    fit : LagFit
        Fit of the torque; its gain is that of both masses together.
    torque, model : ndarray, shape (n,)
        Smoothed torque, and the fitted model of it.
    spans : tuple of ndarray of int
        Samples in full motion, from each stop to the next.
    rate : float
        Sample rate of these, Hz.
    """

    fit: LagFit
    torque: Array
    model: Array
    spans: tuple[NDArray[np.intp], ...]
    rate: float


def low_band(aligned: Aligned, phases: Sequence[MotionPhase]) -> LowBand | None:
    """Filter a recording for comparisons below the axial mode.

    Parameters
    ----------
    aligned : Aligned
        Channels of one recording.
    phases : sequence of MotionPhase
        Phases of the same recording.

    Returns
    -------
    LowBand or None
        None where there are fewer than three phases, the rate is too low or a sample is not finite.
    """
    from scipy.signal import butter, sosfiltfilt

    step = max(1, round(aligned.rate / _COARSE_RATE))
    rate = aligned.rate / step
    settle = round(2 * rate / _BAND)
    count = len(aligned.position) // step
    if len(phases) < _FEWEST or rate < 8 * _BAND or count < 6 * settle:
        return None
    for x in (aligned.input, aligned.position, aligned.response):
        if not np.isfinite(x).all():
            return None
    band = butter(_ORDER, _BAND, fs=rate, output="sos")

    def low(x: Array) -> Array:
        return np.asarray(sosfiltfilt(band, x, axis=-1))

    place = block_means(aligned.position - aligned.position[0], step)
    raw_speed = gaussian_filter1d(np.gradient(place) * rate, 0.003 * rate)
    cruise = float(np.percentile(np.abs(raw_speed), 99))
    sign = np.where(np.abs(raw_speed) < _STANDING * cruise, 0.0, np.sign(raw_speed))
    rise = sign * np.exp(-((raw_speed / (0.1 * max(cruise, 1e-12))) ** 2))
    speed = np.gradient(low(place)) * rate
    part = np.full(count, -1, dtype=np.intp)
    for index, phase in enumerate(phases):
        first = int((phase.start / aligned.rate - _BEFORE) * rate)
        part[max(first, 0) : int((phase.stop / aligned.rate + _AFTER) * rate)] = index
    part[:settle] = part[-settle:] = -1  # start and end transients of the filter
    raw_drive, raw_response = block_means(aligned.input, step), block_means(aligned.response, step)
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


def fit_lag(
    band: LowBand, signal: Array, reference: Array, others: Sequence[Array], used: NDArray[np.bool_]
) -> LagFit | None:
    """Fit ``signal(t) = gain · reference(t − late) + others``, with the rise of the gain towards the mode.

    To first order in the delay the fit is linear: the delay is minus the coefficient of the derivative over
    the gain. The fit is repeated with the signal shifted by the delay until that settles, from the best of
    25 delays up to ±60 ms.

    Parameters
    ----------
    band : LowBand
        Rate and phases of the signals.
    signal, reference : ndarray, shape (n,)
        The signal, and the one that it follows.
    others : sequence of ndarray, shape (n,)
        Additional terms.
    used : ndarray of bool, shape (n,)
        Samples of the fit.

    Returns
    -------
    LagFit or None
        None where there is too little motion for a fit.
    """
    thin = max(1, int(band.rate / (4 * _BAND)))
    rows = np.flatnonzero(used)[::thin]
    first = band.derivative(reference)
    columns = np.stack([reference, first, band.derivative(first), *others, np.ones_like(reference)])[:, rows]
    scale = columns.std(axis=1)
    scale[-1] = 1.0
    if len(rows) < 5 * len(columns) or not np.isfinite(scale).all() or scale[0] == 0 or scale[1] == 0:
        return None
    columns /= np.where(scale > 0, scale, 1.0)[:, None]
    index = np.arange(len(signal), dtype=np.float64)

    def shifted(late: float) -> Array:
        return np.asarray(np.interp(rows + late * band.rate, index, signal))

    delays = np.linspace(-_SEARCH, _SEARCH, _STEPS)
    unexplained = _solve(columns, np.array([shifted(delay) for delay in delays]))[1]
    late = float(delays[np.argmin(unexplained)])
    for _ in range(_PASSES):
        answer, residual = _solve(columns, shifted(late))
        change = _delay(answer, scale, 1)
        if answer[0] == 0 or not np.isfinite(change):
            return None
        change = np.clip(change, -_SEARCH / 4, _SEARCH / 4)
        late = float(np.clip(late + change, -1.5 * _SEARCH, 1.5 * _SEARCH))
        if abs(change) < _SETTLED:
            break
    names, number = np.unique(band.part[rows], return_inverse=True)
    group = number * min(_GROUPS, len(names)) // len(names)
    spread = _jackknife(columns, scale, 1, shifted(late), group)
    return LagFit(float(answer[0] / scale[0]), late, spread, float(1.0 - residual))


def two_masses(band: LowBand, responses: Sequence[tuple[int, LagFit]]) -> TwoMasses | None:
    """Fit a torque with the accelerations of rotor and table, viscous friction and the delay.

    Parameters
    ----------
    band : LowBand
        Signals of one recording.
    responses : sequence of (int, LagFit)
        Index and fit of each accelerometer that follows the encoder.

    Returns
    -------
    TwoMasses or None
        None where there is no accelerometer or too little full motion.
    """
    sigma = max(_SMOOTHING * band.rate, _LEAST_SMOOTHING)
    time = np.arange(len(band.place), dtype=np.float64)

    def smooth(x: Array) -> Array:
        return np.asarray(gaussian_filter1d(x, sigma))

    speed = band.derivative(smooth(band.place))
    spans = _spans_in_motion(speed, _FAST * band.cruise, sigma)
    if not responses or len(spans) < _FEWEST:
        return None
    rotor = band.derivative(speed)
    tables = []
    for index, fit in responses:
        tables.append(np.interp(time + fit.late * band.rate, time, band.raw_response[index]) / fit.gain)
    table = smooth(np.mean(tables, axis=0))
    torque = smooth(band.raw_drive)
    whole = np.stack([rotor, table - rotor, band.derivative(rotor), speed])
    rows = np.concatenate(spans)
    number = np.repeat(np.arange(len(spans)), list(map(len, spans)))
    columns = _without_means(whole[:, rows], number)
    scale = columns.std(axis=1)
    if len(rows) < 5 * len(columns) or not np.isfinite(scale).all() or scale.min() <= 0:
        return None
    columns /= scale[:, None]
    late = 0.0
    for _ in range(_PASSES):
        wanted = _without_means(np.interp(rows + late * band.rate, time, torque)[None], number)[0]
        answer, residual = _solve(columns, wanted)
        if answer[0] == 0:
            return None
        change = _delay(answer, scale, 2)
        late = float(np.clip(late + change, -_SEARCH, _SEARCH))
        if not abs(change) > _SETTLED:
            break
    spread = _jackknife(columns, scale, 2, wanted, number * min(_GROUPS, len(spans)) // len(spans))
    by_spectrum = _coefficient_deviation(columns, 2, wanted - answer @ columns, number)
    spread = max(spread, abs(_delay(np.array([answer[0], 0.0, by_spectrum]), scale, 2)))
    if not np.isfinite([late, spread]).all():
        return None
    model = (answer / scale)[[0, 1, 3]] @ whole[[0, 1, 3]]
    fit = LagFit(float(answer[0] / scale[0]), late, spread, float(1.0 - residual))
    return TwoMasses(fit, torque, model, tuple(spans), band.rate)


def _solve(columns: Array, wanted: Array) -> tuple[Array, Array]:
    """Least-squares coefficients, and the unexplained share of the variance.

    ``wanted`` has the shape (n,), or (k, n) for k signals; those of the results begin with k then.
    """
    answer = np.asarray(np.linalg.lstsq(columns.T, wanted.T, rcond=1e-10)[0], dtype=np.float64).T
    variance = np.maximum(np.var(wanted, axis=-1), 1e-300)
    return answer, np.asarray(np.var(wanted - answer @ columns, axis=-1) / variance)


def _delay(answer: Array, scale: Array, row: int) -> float:
    """Delay from the coefficient of a derivative over the gain, s; 0 without a gain."""
    if answer[0] == 0:
        return 0.0
    return -float(answer[row] / answer[0] * scale[0] / scale[row])


def _jackknife(columns: Array, scale: Array, row: int, wanted: Array, group: NDArray[np.intp]) -> float:
    """Standard uncertainty of the delay, from leaving out each group of samples in turn, s."""
    count = int(group.max()) + 1
    delays = np.empty(count)
    for index in range(count):
        used = group != index
        delays[index] = _delay(_solve(columns[:, used], wanted[used])[0], scale, row)
    return float(np.sqrt((count - 1) * np.var(delays)))


def _coefficient_deviation(columns: Array, row: int, residual: Array, number: NDArray[np.intp]) -> float:
    """Standard deviation of a coefficient by a residual of this spectrum at any time in each span.

    A force that repeats with every turn of the screw is alike in all spans: the jackknife does not show it.
    """
    others = np.delete(columns, row, axis=0)
    direction = columns[row] - _solve(others, columns[row])[0] @ others
    spans = [number == k for k in range(int(number[-1]) + 1)]
    power = sum(chance_power(residual[span], direction[span]) for span in spans)
    return math.sqrt(power) / float(direction @ direction)


def chance_power(residual: Array, direction: Array) -> float:
    """Mean square of the product of two signals, the first at a random time (Bartlett's formula).

    Parameters
    ----------
    residual, direction : ndarray, shape (n,)
        Signals at one rate.
    """
    powers = [np.abs(np.fft.fft(x, 2 * len(x))) ** 2 for x in (residual, direction)]
    return float(np.mean(powers[0] * powers[1])) / len(residual)


def _spans_in_motion(speed: Array, least: float, sigma: float) -> list[NDArray[np.intp]]:
    fast = binary_erosion(np.abs(speed) > least, iterations=max(1, round(_GUARD * sigma)))
    edge = round(4 * sigma)
    fast[:edge] = fast[-edge:] = False
    starts, stops = true_spans(fast)
    long = stops - starts >= _LEAST_SPAN
    return [np.arange(*span) for span in zip(starts[long], stops[long], strict=True)]


def _without_means(x: Array, number: NDArray[np.intp]) -> Array:
    """Signals without their mean over each span, which removes dry friction."""
    means = np.empty((len(x), int(number[-1]) + 1))
    count = np.bincount(number)
    for row, mean in zip(x, means, strict=True):
        mean[:] = np.bincount(number, row) / count
    return np.asarray(x - means[:, number])
