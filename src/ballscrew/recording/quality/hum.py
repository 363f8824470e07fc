"""Mains hum: narrow lines at 50 or 60 Hz and their harmonics while the axis stands or cruises."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft

from ballscrew.base.arrays import Array

__all__ = ["Hum", "coarse", "find_hum", "steady"]


_MAINS = (50.0, 60.0)  # Hz
_HARMONICS = (1, 2, 3, 4, 5)
_DRIFT = 0.003  # of the frequency: how far a grid strays from its nominal one
_AWAY = (3.0, 9.0)  # Hz beside the line, where its neighbourhood is judged
_NARROW = 5.0  # times the median beside it: noise gets there once in 2**25
_HIGHEST = 1.25  # times the highest beside it: else it is the foot of another line
_SHARE = 0.01  # of the signal's root mean square; a good record of a real drive has half of that
_COHERENT = 0.7  # of the sum of amplitudes in all spans: the mains keep their phase, each transient its own
_LASTING = 0.8  # of the amplitude in a span's first half, that its second half must have: ringing decays
_FINER = 4  # zero padding, so that no line falls between two
_COARSE_RATE = 1500.0  # Hz, of the averaged signals that are searched
_RINGING = 0.08  # s after a phase, in which the axis still rings
_LEAST = 0.5  # s of steady signal
_LEAST_SPAN = 0.06  # s: three periods of the mains


@dataclass(frozen=True, slots=True)
class Hum:
    """A mains line in a signal.

    Parameters
    ----------
    frequency : float
        Hz.
    amplitude : float
        In the signal's unit.
    share : float
        Of the signal's root mean square.
    """

    frequency: float
    amplitude: float
    share: float


def coarse(x: Array, rate: float) -> tuple[Array, float]:
    """Means over blocks of samples, at about 1.5 kHz, and their rate."""
    step = max(1, int(rate / _COARSE_RATE))
    size = len(x) // step * step
    return x[:size].reshape(-1, step).mean(axis=1), rate / step


def steady(position: Array, rate: float) -> tuple[list[slice], NDArray[np.bool_]]:
    """Spans in which the axis stands or, where it hardly ever does, keeps its speed.

    Parameters
    ----------
    position : ndarray, shape (n,)
        m.
    rate : float
        Hz.

    Returns
    -------
    spans : list of slice
        Without the first 80 ms after a change, in which it rings.
    moving : ndarray of bool, shape (n,)
        Where it does not stand.
    """
    step = max(1, round(rate / 100))
    size = len(position) // step * step
    blocks = position[:size].reshape(-1, step).mean(axis=1)
    if len(blocks) < 4:
        return [], np.ones(len(position), dtype=bool)
    speed = np.gradient(blocks)
    fastest = float(np.percentile(np.abs(speed), 99))
    stands = np.abs(speed) < 0.02 * fastest
    moving = np.ones(len(position), dtype=bool)
    moving[:size] = np.repeat(~stands, step)
    spans = _spans(stands, step, rate)
    if sum(span.stop - span.start for span in spans) < _LEAST * rate:
        change = np.abs(np.gradient(speed))
        spans = _spans(change < 0.1 * float(np.percentile(change, 98)), step, rate)
    return spans, moving


def _spans(quiet: NDArray[np.bool_], step: int, rate: float) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(np.int8), [0]])))
    skip, least = round(_RINGING * rate), _LEAST_SPAN * rate
    spans = [slice(int(a) * step + skip, int(b) * step) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return [span for span in spans if span.stop - span.start > least]


def find_hum(x: Array, rate: float, spans: list[slice]) -> Hum | None:
    """The strongest mains line of a signal.

    The amplitude is that of one sine through all spans: what only looks like a line in one of them averages
    out, and what the transients repeat is not in them.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Signal.
    rate : float
        Hz.
    spans : list of slice
        Where it is steady, from :func:`steady`.

    Returns
    -------
    Hum or None
        None where no line stands out of its neighbourhood and matters beside the signal.
    """
    thin, thin_rate = coarse(x, rate)
    step = round(rate / thin_rate)
    parts = [slice(span.start // step + 1, span.stop // step) for span in spans]
    parts = [part for part in parts if part.stop - part.start > _LEAST_SPAN * thin_rate]
    count = sum(part.stop - part.start for part in parts)
    if count < _LEAST * thin_rate:
        return None
    # What lies between the spans is zero, and adds to no line. A length with a large prime would take long.
    quiet = np.zeros(next_fast_len(_FINER * len(thin), real=True))
    for part in parts:
        quiet[part] = _levelled(thin[part])
    amplitude = 2 * np.abs(rfft(quiet)) / count
    frequency = np.arange(len(amplitude)) * thin_rate / len(quiet)
    level = float(np.std(x))
    lines = [
        _line(frequency, amplitude, mains * order, level)
        for mains in _MAINS
        for order in _HARMONICS
        if mains * order + _AWAY[1] < 0.45 * thin_rate
    ]
    real = [line for line in lines if line is not None and _persists(line, quiet, thin_rate, parts)]
    return max(real, key=lambda line: line.amplitude, default=None)


def _persists(line: Hum, quiet: Array, rate: float, parts: list[slice]) -> bool:
    """Whether a line goes on through all spans, unlike the ringing of an axis that has its mode there."""
    turn = -2j * np.pi * line.frequency / rate

    def sums(early: bool) -> NDArray[np.complex128]:
        halves = []
        for part in parts:
            middle = (part.start + part.stop) // 2
            half = np.arange(part.start, middle) if early else np.arange(middle, part.stop)
            halves.append(np.sum(quiet[half] * np.exp(turn * half)))
        return np.array(halves)

    first, second = sums(early=True), sums(early=False)
    whole = first + second
    together = abs(np.sum(whole)) > _COHERENT * np.sum(np.abs(whole))
    lasting = abs(np.sum(second)) > _LASTING * abs(np.sum(first))
    return bool(together and lasting)


def _line(frequency: Array, amplitude: Array, nominal: float, level: float) -> Hum | None:
    away = np.abs(frequency - nominal)
    near = np.flatnonzero(away <= _DRIFT * nominal)
    if len(near) == 0:
        return None
    best = int(near[np.argmax(amplitude[near])])
    size = float(amplitude[best])
    beside = amplitude[(away > _AWAY[0]) & (away < _AWAY[1])]
    if size < _SHARE * level or size < _NARROW * np.median(beside) or size < _HIGHEST * beside.max():
        return None
    return Hum(float(frequency[best]), size, size / level)


def _levelled(x: Array) -> Array:
    index = np.linspace(-1.0, 1.0, len(x))
    return np.asarray(x - x.mean() - index * (x @ index) / (index @ index))
