"""Filters that a channel map declares: of the sensor or the logger, and of the drive behind a command."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.tomlfile import Fields

TYPES = ("low pass", "high pass", "notch", "delay", "moving average")
_BY_TIME = ("delay", "moving average")
_HIGHEST_ORDER = 8
_FREQUENCIES = (1e-6, 1e9)  # Hz
_LONGEST = 1e3  # s
# A filter is inverted where it passes more than a tenth: below, the inverse would amplify noise, not signal.
_LEAST_GAIN = 0.1
_MARGIN = 1.0  # s by which a record is continued at its ends, where filters have transients

Response = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Filter:
    """One filter.

    Parameters
    ----------
    type : str
        One of :data:`TYPES`.
    frequency : float, optional
        Cut-off (−3 dB) of a pass, centre of a notch, Hz.
    order : int
        Order of a pass, Butterworth.
    bandwidth : float, optional
        Width of a notch between its −3 dB points when it is complete, Hz.
    depth : float
        Gain in the centre of a notch; 0 if it is complete.
    time : float, optional
        Of a delay or a moving average, s.
    """

    type: str
    frequency: float | None = None
    order: int = 1
    bandwidth: float | None = None
    depth: float = 0.0
    time: float | None = None

    def response(self, frequency: Array) -> Response:
        """Complex gain at frequencies in Hz."""
        if self.type == "delay":
            return np.asarray(np.exp(-2j * np.pi * frequency * (self.time or 0.0)))
        if self.type == "moving average":
            turns = frequency * (self.time or 0.0)
            return np.asarray(np.sinc(turns) * np.exp(-1j * np.pi * turns))
        s = 1j * frequency / (self.frequency or 1.0)
        if self.type == "notch":
            width = (self.bandwidth or 0.0) / (self.frequency or 1.0)
            return np.asarray((s**2 + self.depth * width * s + 1) / (s**2 + width * s + 1))
        angles = np.pi * (2 * np.arange(1, self.order + 1) + self.order - 1) / (2 * self.order)
        low = np.prod([1 / (s - pole) for pole in np.exp(1j * angles)], axis=0)
        return np.asarray(low * s**self.order if self.type == "high pass" else low)

    def to_settings(self) -> dict[str, Any]:
        """Fields that are not defaults, in the form of :func:`filters_of`."""
        defaults = asdict(Filter(self.type))
        changed = {name: value for name, value in asdict(self).items() if value != defaults[name]}
        return {"type": self.type, **changed}


def filters_of(row: Fields, field: str) -> tuple[Filter, ...]:
    """Filters that a channel declares, in the order in which a signal passes them.

    Raises
    ------
    InputError
        If a filter is not known, or one of its fields is missing, unknown or impossible.
    """
    return tuple(_filter(each) for each in row.subs(field))


def _filter(row: Fields) -> Filter:
    kind = row.text("type", choices=TYPES)
    if kind in _BY_TIME:
        row.only(("type", "time"))
        return Filter(kind, time=row.quantity("time", "s", above=0.0, most=_LONGEST))
    if kind == "notch":
        row.only(("type", "frequency", "bandwidth", "depth"))
        return Filter(
            kind,
            row.quantity("frequency", "Hz", least=_FREQUENCIES[0], most=_FREQUENCIES[1]),
            bandwidth=row.quantity("bandwidth", "Hz", least=_FREQUENCIES[0], most=_FREQUENCIES[1]),
            depth=row.quantity("depth", "", 0.0, least=0.0, most=1.0),
        )
    row.only(("type", "frequency", "order"))
    order = row.whole("order", 1, least=1)
    if order > _HIGHEST_ORDER:
        raise row.error("order", f"a whole number, 1 to {_HIGHEST_ORDER}")
    return Filter(kind, row.quantity("frequency", "Hz", least=_FREQUENCIES[0], most=_FREQUENCIES[1]), order)


def undo_and_apply(x: Array, rate: float, undone: Sequence[Filter], applied: Sequence[Filter]) -> Array:
    """Signal before the filters that it was recorded through, and behind those that follow it.

    Parameters
    ----------
    x : ndarray, shape (n,)
        As recorded.
    rate : float
        Sample rate, Hz.
    undone, applied : sequence of Filter
        Filters to invert where they pass more than a tenth, and filters to apply.

    Returns
    -------
    ndarray, shape (n,)
        In the unit of ``x``; ``x`` itself where there is no filter.
    """
    from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

    if not (undone or applied):
        return x
    n, margin = len(x), round(_MARGIN * rate)
    # A record is one period of its Fourier series: the way back from its end to its beginning is added.
    size = next_fast_len(n + 4 * margin, real=True)
    back = np.linspace(x[-1], x[0], size - n - 2 * margin)
    period = np.concatenate([x, np.full(margin, x[-1]), back, np.full(margin, x[0])])
    frequency = np.asarray(rfftfreq(size, 1 / rate), dtype=np.float64)
    gain: Response = np.ones(len(frequency), dtype=np.complex128)
    for each in undone:
        gain *= each.response(frequency)
    gain = gain.conj() / np.maximum(np.abs(gain), _LEAST_GAIN) ** 2
    for each in applied:
        gain *= each.response(frequency)
    with np.errstate(all="ignore"):  # the quality gate reports samples that are no numbers
        return np.asarray(irfft(rfft(period) * gain, size)[:n])
