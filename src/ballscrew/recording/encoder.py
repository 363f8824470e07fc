"""Interpolation error of an encoder: an error of the position that repeats with every period of its scale.

Sine and cosine of a scale that differ in amplitude, offset or phase make an error of one or two waves a
period, 4 to 200 µm of travel. Near standstill it passes through the frequencies of the axis and looks like an
acceleration of the motor; at full speed it lies far above them and can be measured.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.ndimage import gaussian_filter1d

from ballscrew.base.arrays import Array

_SMOOTHING = 0.5e-3  # s: what is slower than about 300 Hz is motion
_FEWEST_SAMPLES = 1.5  # of the smoothing
_LEAST_SPEED = 0.3  # of the highest speed, of the samples that show the error
_FASTER = 2.5  # the error's frequency at the highest speed, over that of the smoothing
_SHORTEST = 3e-6  # m, period
_PER_PERIOD = 4  # points of the grid for the shortest period
_STEPS = 4.0  # of the encoder: shorter periods look like its steps
_WAVES = 4  # at most
_CLEAR = 8.0  # median amplitudes of all periods, above which one is an error of the encoder
_LEAST_AMPLITUDE = 2e-8  # m: less moves no frequency
_ROUNDING = 0.75  # of the encoder's step: rounding alone makes waves of up to half of it
_PASSES = 3  # the error shifts its own phase; three passes settle it


def interpolation_error(position: Array, rate: float) -> Array:
    """Estimate the interpolation error of an encoder.

    Parameters
    ----------
    position : ndarray, shape (n,)
        m.
    rate : float
        Samples per second, Hz.

    Returns
    -------
    ndarray, shape (n,)
        Error, m, to be subtracted; 0 where none shows, or the axis hardly moves.
    """
    error = np.zeros_like(position)
    sigma = max(_SMOOTHING * rate, _FEWEST_SAMPLES)
    speed = np.abs(np.gradient(gaussian_filter1d(position - position[0], sigma))) * rate
    fastest = float(np.percentile(speed, 99))
    longest = fastest * 2 * math.pi * sigma / rate / _FASTER
    step = resolution(position)
    shortest = max(_SHORTEST, _STEPS * step)
    least = max(_LEAST_AMPLITUDE, _ROUNDING * step)
    rows = np.flatnonzero(speed > _LEAST_SPEED * fastest)
    if not longest > 2 * shortest or len(rows) < rate / 10:
        return error
    remainder = _fast_part(position - position[0], sigma)
    numbers: list[float] = []
    for _ in range(_WAVES):
        number, amplitude = _strongest_wave(position[rows], remainder[rows], 1 / longest, 1 / shortest)
        if amplitude < least:
            break
        numbers.append(number)
        found = _fitted(position, numbers, sigma, rows)
        remainder = _fast_part(position - position[0] - found, sigma)
        error = found
    return error


def resolution(position: Array) -> float:
    """Smallest step of a position (m) or a speed (m/s); infinite where it never changes."""
    steps = np.abs(np.diff(position))
    return float(np.min(steps[steps > 1e-12], initial=math.inf)) if np.any(steps > 1e-12) else 0.0


def _fast_part(x: Array, sigma: float) -> Array:
    return np.asarray(x - gaussian_filter1d(x, sigma))


def _strongest_wave(place: Array, x: Array, low: float, high: float) -> tuple[float, float]:
    """Wave number (1/m) and amplitude (m) of the strongest wave along the travel; 0 where none is clear."""
    grid = 1 / (high * _PER_PERIOD)
    index = ((place - place.min()) / grid).astype(int)
    size = next_fast_len(2 * (int(index.max()) + 1))
    spectrum = np.abs(np.fft.rfft(np.bincount(index, x, minlength=size))) * 2 / len(x)
    numbers = np.fft.rfftfreq(size, grid)
    inside = (numbers >= low) & (numbers <= high)
    amplitudes = spectrum[inside]
    best = int(np.argmax(amplitudes))
    if amplitudes[best] < _CLEAR * float(np.median(amplitudes)):
        return 0.0, 0.0
    return float(numbers[inside][best]), float(amplitudes[best])


def _fitted(position: Array, numbers: list[float], sigma: float, rows: NDArray[np.intp]) -> Array:
    """Waves of these numbers, fitted together; the last number is refined by its phase along the travel."""
    error = np.zeros_like(position)
    wanted = _fast_part(position - position[0], sigma)[rows]
    middle = float(position[rows].mean())
    for _ in range(_PASSES):
        place = position - error - middle
        angles = 2 * math.pi * np.outer(numbers, place)
        waves = np.concatenate([np.cos(angles), np.sin(angles)])
        slopes = np.concatenate([-np.sin(angles) * place, np.cos(angles) * place])
        fast = np.array([_fast_part(wave, sigma)[rows] for wave in waves])
        weights = np.linalg.lstsq(fast.T, wanted, rcond=None)[0]
        count = len(numbers)
        for k in range(count):
            own = slopes[[k, count + k]].T @ weights[[k, count + k]]
            slope = _fast_part(own, sigma)[rows]
            change = float(slope @ (wanted - weights @ fast)) / max(float(slope @ slope), 1e-300)
            reach = float(np.ptp(place))
            numbers[k] += float(np.clip(change / (2 * math.pi), -0.5 / reach, 0.5 / reach))
        error = weights @ waves
    return np.asarray(error)
