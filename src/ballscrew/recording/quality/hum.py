"""Mains hum: narrow lines at 50 or 60 Hz and harmonics while the axis stands or moves at constant speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft

from ballscrew.base.arrays import Array
from ballscrew.recording.quality.signal_faults import block_means, true_spans

_MAINS = (50.0, 60.0)  # Hz
_HARMONICS = (1, 2, 3, 4, 5)
_DRIFT = 0.003  # of the frequency: how far a grid strays from its nominal one
_AWAY = (3.0, 9.0)  # Hz beside the line, where the level of its neighbourhood is measured
_NARROW = 5.0  # times the median beside it: noise exceeds that once in 2**25
_HIGHEST = 1.25  # times the highest beside it: else it is the foot of another line
_LEAST_SHARE = 0.01  # of the signal's root mean square; a good record of a real drive has half of that
_COHERENT = 0.7  # of the sum of the spans' amplitudes: the mains have one phase, each transient its own
_LASTING = 0.8  # second half of a span over its first half, at least: ringing decays
_FINER = 4  # zero padding, so that no line falls between two
_COARSE_RATE = 1500.0  # Hz, of the averaged signals that are searched
_RINGING = 0.08  # s after a phase, in which the axis still rings
_LEAST = 0.5  # s of steady signal
_LEAST_SPAN = 0.06  # s: three periods of the mains


@dataclass(frozen=True, slots=True)
class Hum:
    """Mains line in a signal.

    Parameters
    ----------
    frequency : float
        Frequency, Hz.
    amplitude : float
        Amplitude, in the signal's unit.
    share : float
        Amplitude over the signal's root mean square.
    """

    frequency: float
    amplitude: float
    share: float


def steady(position: Array, rate: float) -> tuple[list[slice], NDArray[np.bool_]]:
    """Spans in which the axis stands or, where it hardly ever does, moves at constant speed.

    Parameters
    ----------
    position : ndarray, shape (n,)
        m.
    rate : float
        Hz.

    Returns
    -------
    spans : list of slice
        Without the first 80 ms after a change, in which the axis rings.
    moving : ndarray of bool, shape (n,)
        Where the axis does not stand.
    """
    step = max(1, round(rate / 100))
    blocks = block_means(position, step)
    size = len(blocks) * step
    if len(blocks) < 4:
        return [], np.ones(len(position), dtype=bool)
    speed = np.gradient(blocks)
    fastest = float(np.percentile(np.abs(speed), 99))
    stands = np.abs(speed) < 0.02 * fastest
    moving = np.ones(len(position), dtype=bool)
    moving[:size] = np.repeat(~stands, step)
    spans = _spans(stands, step, rate)
    if _samples(spans) < _LEAST * rate:
        change = np.abs(np.gradient(speed))
        spans = _spans(change < 0.1 * float(np.percentile(change, 98)), step, rate)
    return spans, moving


def _spans(quiet: NDArray[np.bool_], step: int, rate: float) -> list[slice]:
    starts, stops = true_spans(quiet)
    starts, stops = starts * step + round(_RINGING * rate), stops * step
    long = stops - starts > _LEAST_SPAN * rate
    return [slice(*span) for span in zip(starts[long].tolist(), stops[long].tolist(), strict=True)]


def _samples(spans: list[slice]) -> int:
    return sum(span.stop - span.start for span in spans)


def find_hum(x: Array, rate: float, spans: list[slice]) -> Hum | None:
    """Find the strongest mains line of a signal.

    The amplitude is that of one sine through all spans, so that lines of single spans average out. Transients
    are not part of the spans.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Signal.
    rate : float
        Hz.
    spans : list of slice
        Steady spans, from :func:`steady`.

    Returns
    -------
    Hum or None
        None where no line exceeds its neighbourhood and 1 % of the signal.
    """
    step = max(1, int(rate / _COARSE_RATE))
    thin, thin_rate = block_means(x, step), rate / step
    parts = [slice(span.start // step + 1, span.stop // step) for span in spans]
    parts = [part for part in parts if part.stop - part.start > _LEAST_SPAN * thin_rate]
    count = _samples(parts)
    if count < _LEAST * thin_rate:
        return None
    # Zero outside the spans, which adds to no line. A length with a large prime factor would take long.
    quiet = np.zeros(next_fast_len(_FINER * len(thin), real=True))
    for part in parts:
        quiet[part] = _detrended(thin[part])
    amplitude = 2 * np.abs(rfft(quiet)) / count
    frequency = np.arange(len(amplitude)) * thin_rate / len(quiet)
    level = float(np.std(x))
    lines = []
    for nominal in np.outer(_MAINS, _HARMONICS).ravel().tolist():
        if nominal + _AWAY[1] < 0.45 * thin_rate:
            lines += _line(frequency, amplitude, nominal, level)
    lines = [line for line in lines if _persists(line, quiet, thin_rate, parts)]
    return max(lines, key=lambda line: line.amplitude, default=None)


def _persists(line: Hum, quiet: Array, rate: float, parts: list[slice]) -> bool:
    """True if a line continues through all spans, unlike the ringing of a mode at its frequency."""
    turn = -2j * np.pi * line.frequency / rate

    def coefficient(start: int, stop: int) -> complex:
        return complex(np.sum(quiet[start:stop] * np.exp(turn * np.arange(start, stop))))

    first, second = np.empty((2, len(parts)), complex)
    for index, part in enumerate(parts):
        middle = (part.start + part.stop) // 2
        first[index], second[index] = coefficient(part.start, middle), coefficient(middle, part.stop)
    whole = first + second
    together = abs(np.sum(whole)) > _COHERENT * np.sum(np.abs(whole))
    lasting = abs(np.sum(second)) > _LASTING * abs(np.sum(first))
    return bool(together and lasting)


def _line(frequency: Array, amplitude: Array, nominal: float, level: float) -> list[Hum]:
    """Line near a nominal frequency; empty where it does not exceed its neighbourhood."""
    away = np.abs(frequency - nominal)
    near = np.flatnonzero(away <= _DRIFT * nominal)
    if len(near) == 0:
        return []
    best = int(near[np.argmax(amplitude[near])])
    size = float(amplitude[best])
    beside = amplitude[(away > _AWAY[0]) & (away < _AWAY[1])]
    if size < _LEAST_SHARE * level or size < _NARROW * np.median(beside) or size < _HIGHEST * beside.max():
        return []
    return [Hum(float(frequency[best]), size, size / level)]


def _detrended(x: Array) -> Array:
    """Signal without its mean and its linear trend."""
    index = np.linspace(-1.0, 1.0, len(x))
    return np.asarray(x - x.mean() - index * (x @ index) / (index @ index))
