"""Faults of sensors and drives that leave a record which looks whole."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import bilinear, filtfilt, lfilter, lfiltic

from benchmarks.fault_injection.fault import Array, Channels, RecordedTrips, needed

__all__ = [
    "bursts",
    "coarse",
    "dead_band",
    "drifting_offset",
    "each",
    "held_samples",
    "high_pass",
    "interpolation_error",
    "jitter",
    "low_pass",
    "noise",
    "nonlinear",
    "resampled",
    "unnotched",
]

Change = Callable[[Array, float], Array]
_NOTCH_WIDTH, _NOTCH_DEPTH = 0.5, 0.1  # damping ratio of the poles; gain in the middle


def each(run: RecordedTrips, names: tuple[str, ...], change: Change) -> RecordedTrips:
    """Change channels of every trip by a function of the channel and the rate."""
    trips = []
    for trip in run.trips:
        needed(trip, *names)
        trips.append({**trip, **{name: change(trip[name], run.rate) for name in names}})
    return RecordedTrips(tuple(trips), run.rate)


def resampled(run: RecordedTrips, rate: float) -> RecordedTrips:
    """Read all channels at another rate, without a filter against aliasing."""
    trips: list[Channels] = []
    for trip in run.trips:
        count = len(next(iter(trip.values())))
        index = np.arange(0.0, count - 1, run.rate / rate)
        trips.append({name: CubicSpline(np.arange(count), x)(index) for name, x in trip.items()})
    return RecordedTrips(tuple(trips), rate)


def jitter(run: RecordedTrips, strength: float, random: np.random.Generator) -> RecordedTrips:
    """Read the samples of all channels at times that scatter by this part of the interval."""
    trips: list[Channels] = []
    for trip in run.trips:
        whole = np.arange(len(next(iter(trip.values()))))
        index = whole + strength * random.standard_normal(len(whole))
        trips.append({name: np.interp(index, whole, x) for name, x in trip.items()})
    return RecordedTrips(tuple(trips), run.rate)


def interpolation_error(x: Array, amplitude: float, period: float) -> Array:
    """Position of an encoder whose sine and cosine are uneven: an error of this amplitude and period, m."""
    return np.asarray(x + amplitude * np.sin(2 * math.pi * x / period))


def coarse(x: Array, step: float) -> Array:
    """Round to whole steps."""
    return np.asarray(np.round(x / step) * step)


def dead_band(x: Array, width: float) -> Array:
    """Follow the signal only where it leaves a band of this width around the last value."""
    out = np.empty_like(x)
    last = x[0]
    for index, value in enumerate(x.tolist()):
        last = min(max(last, value - width / 2), value + width / 2)
        out[index] = last
    return out


def high_pass(x: Array, rate: float, corner: float) -> Array:
    """AC coupling: a high pass of the first order, settled on the first value."""
    b, a = bilinear([1.0, 0.0], [1.0, 2 * math.pi * corner], rate)
    return np.asarray(lfilter(b, a, x, zi=lfiltic(b, a, [0.0], [x[0]]))[0])


def low_pass(x: Array, rate: float, corner: float) -> Array:
    """A filter of the first order, with its delay."""
    b, a = bilinear([2 * math.pi * corner], [1.0, 2 * math.pi * corner], rate)
    return np.asarray(lfilter(b, a, x, zi=lfiltic(b, a, [x[0]], [x[0]]))[0])


def unnotched(x: Array, rate: float, frequency: float) -> Array:
    """A torque as commanded before the notch filter of a servo, from the torque behind it."""
    w = 2 * rate * math.tan(math.pi * frequency / rate)
    poles = [1.0, 2 * _NOTCH_WIDTH * w, w * w]
    zeros = [1.0, 2 * _NOTCH_WIDTH * _NOTCH_DEPTH * w, w * w]
    b, a = bilinear(poles, zeros, rate)
    return np.asarray(lfilter(b, a, x, zi=lfiltic(b, a, [x[0]] * 2, [x[0]] * 2))[0])


def held_samples(x: Array, rate: float, own: float) -> Array:
    """Hold each sample of a slower clock of this rate until its next."""
    index = np.arange(len(x))
    return np.asarray(x[(np.floor(index * own / rate) * rate / own).astype(int)])


def noise(x: Array, part: float, random: np.random.Generator) -> Array:
    """Add white noise of this part of the signal's standard deviation."""
    return np.asarray(x + part * np.std(x) * random.standard_normal(len(x)))


def nonlinear(x: Array, part: float) -> Array:
    """A sensitivity that changes by this part up to the largest value."""
    return np.asarray(x * (1 + part * x / np.max(np.abs(x))))


def drifting_offset(x: Array, amount: float) -> Array:
    """An offset that grows from 0 to this over the record, with a wave of a third of it."""
    t = np.linspace(0.0, 1.0, len(x))
    return np.asarray(x + amount * (t + np.sin(6 * math.pi * t) / 3))


def bursts(x: Array, rate: float, count: int, random: np.random.Generator) -> Array:
    """So many bursts of interference of 5 ms, a tenth of the signal's largest value, band below 3 kHz."""
    out = x.copy()
    size = round(5e-3 * rate)
    for start in random.integers(0, len(x) - size, count):
        burst = filtfilt([0.5, 0.5], [1.0], random.standard_normal(size))
        out[start : start + size] += 0.1 * np.max(np.abs(x)) * burst * np.hanning(size)
    return out
