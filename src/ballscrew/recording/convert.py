"""Samples of any source, by a channel map, as labelled arrays in SI."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.words import plural
from ballscrew.recording.channels import DERIVED_FROM, RATES, Channel, ChannelMap
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.quantities import INPUTS, SI_UNITS, to_si
from ballscrew.recording.updates import in_words, update_interval

LEAST_SAMPLES = 16
_MOST_LISTED = 30
_UPDATED = (*INPUTS, "position", "speed")  # by a drive, whose loops have cycles of their own
_RATE_DIGITS = 6  # of a rate by sample times: 5 ppm or less, a tenth of the error of an ordinary quartz


@dataclass(frozen=True)
class Converted:
    """Channels of a source, in SI.

    Parameters
    ----------
    channels : mapping
        As of :class:`~ballscrew.recording.recording.Recording`.
    sample_rate : float
        Of the input channel, else of the first one, Hz.
    declared_rate, file_rate : float or None
        The same rate by the channel map and by the source, Hz.
    time : ndarray of shape (samples,) or None
        Sample times of the source, s.
    notes : tuple of str
        Assumptions, in sentences.
    """

    channels: Mapping[str, xr.DataArray]
    sample_rate: float
    declared_rate: float | None
    file_rate: float | None
    time: Array | None
    notes: tuple[str, ...]


def convert(path: Path, header: Header, channels: ChannelMap, raw: Mapping[str, NDArray[Any]]) -> Converted:
    """Convert the mapped channels of a source to SI.

    Parameters
    ----------
    path : Path
        Of the source, for messages.
    header : Header
        What the source states about itself.
    channels : ChannelMap
        Meaning of its channels.
    raw : mapping of str to ndarray
        Samples by the names that the map has for them.

    Returns
    -------
    Converted
        All channels.

    Raises
    ------
    InputError
        If a channel has too few samples or another length than those of the same rate, its unit is wrong, or
        no rate can be found.
    """
    check_sources(path, header, channels)
    for channel in channels.channels:
        _check_values(path, channel.source, raw.get(channel.source))
    file = _File(path, header, channels, {channel.name: channel for channel in header.channels})
    time, measured, origins = _converted(file, raw)
    if not measured:
        raise InputError(f"{channels.source}: maps nothing but the time; it must map what was measured.")
    arrays: dict[str, xr.DataArray] = {}
    notes = _unit_notes(file)
    for channel, values in measured:
        source = channel, values
        if channel.derive:
            source = origins[channel.source, DERIVED_FROM[channel.derive]]
        arrays[channel.name] = _labelled(file, channel, source, time, notes)
    main = min((channel for channel, _ in measured), key=_preference)
    about = arrays[main.name].attrs
    _check_lengths(path, arrays, time, about["sample_rate"] * max(1, about["updated_every"]))
    return Converted(
        channels=MappingProxyType(arrays),
        sample_rate=float(about["sample_rate"]),
        declared_rate=main.sample_rate or channels.sample_rate,
        file_rate=file.rate_of(main.source),
        time=time,
        notes=tuple(dict.fromkeys(notes)),
    )


@dataclass(frozen=True)
class _File:
    """A file with its header and the channel map."""

    path: Path
    header: Header
    map: ChannelMap
    listed: Mapping[str, RawChannel]

    def rate_of(self, source: str) -> float | None:
        """Rate that the file states for a channel, Hz."""
        rate = self.listed[source].sample_rate
        return self.header.sample_rate if rate is None else rate


_Measured = tuple[Channel, NDArray[Any]]


def _converted(
    file: _File, raw: Mapping[str, NDArray[Any]]
) -> tuple[Array | None, list[_Measured], dict[tuple[str, str], _Measured]]:
    """Sample times, all other channels in SI, and positions and speeds among them by source and quantity.

    Channels that are derived have no values yet.
    """
    time = None
    measured: list[_Measured] = []
    origins: dict[tuple[str, str], _Measured] = {}
    for channel in file.map.channels:
        if channel.derive:
            measured.append((channel, np.empty(0)))
            continue
        values = _in_si(file.path, raw[channel.source], channel, file.listed[channel.source])
        if channel.quantity == "time":
            time = values.astype(np.float64)
            continue
        measured.append((channel, values))
        if channel.quantity in DERIVED_FROM.values():
            origins[channel.source, channel.quantity] = channel, values.astype(np.float64, copy=False)
    return time, measured, origins


def second_derivative(x: Array, rate: float) -> Array:
    """Second central difference, (x[i+1] - 2 x[i] + x[i-1]) rate², ends repeated.

    Not smoothed: acceleration and torque must be smoothed alike, which the caller does.

    Parameters
    ----------
    x : ndarray of shape (samples,)
        Position, m; three samples or more.
    rate : float
        Sample rate, Hz.

    Returns
    -------
    ndarray of shape (samples,)
        Acceleration, m/s².
    """
    inner = (x[2:] - 2.0 * x[1:-1] + x[:-2]) * (rate * rate)
    return np.concatenate([inner[:1], inner, inner[-1:]])


def derivative(x: Array, rate: float) -> Array:
    """Central difference, (x[i+1] - x[i-1]) rate / 2, one-sided at the ends.

    Parameters
    ----------
    x : ndarray of shape (samples,)
        Speed, m/s; two samples or more.
    rate : float
        Sample rate, Hz.

    Returns
    -------
    ndarray of shape (samples,)
        Acceleration, m/s².
    """
    return np.asarray(np.gradient(x) * rate, dtype=np.float64)


def _preference(channel: Channel) -> int:
    """Rank of a channel as the input of an analysis."""
    if channel.quantity in INPUTS:
        return INPUTS.index(channel.quantity)
    return len(INPUTS)


def rate_from_time(time: Array) -> float:
    """Sample rate from sample times, robust to coarse digits and to a few lost samples.

    Parameters
    ----------
    time : ndarray of shape (samples,)
        Sample times, s.

    Returns
    -------
    float
        The rate, Hz; NaN where the times do not increase.
    """
    # Over many samples, since a logger's milliseconds are coarse; trimmed, since some contain a gap.
    step = max(1, time.size // 16)
    with np.errstate(invalid="ignore"):  # of times that are not finite
        spans = time[step:] - time[:-step]
    spans = np.sort(spans[np.isfinite(spans)])
    cut = spans.size // 10
    if not spans.size:
        return math.nan
    span = float(np.mean(spans[cut : spans.size - cut]))
    return step / span if span > 0 else math.nan


def check_sources(path: Path, header: Header, channels: ChannelMap) -> None:
    """Refuse a channel map that names a channel which the source does not have."""
    names = [channel.name for channel in header.channels]
    for index, channel in enumerate(channels.channels):
        if channel.source in names:
            continue
        folded = {name.casefold(): name for name in names}
        close = difflib.get_close_matches(channel.source.casefold(), list(folded)[:5000], n=1)
        hint = ";"
        if close:
            hint = f", did you mean {folded[close[0]]!r}?"
        listing = ", ".join(names[:_MOST_LISTED]) or "no series of numbers in one dimension"
        if len(names) > _MOST_LISTED:
            listing += f" and {len(names) - _MOST_LISTED} more"
        raise InputError(
            f"{path}: has no channel {channel.source!r} ({channels.source}: channel[{index}].source){hint}"
            f" it has {listing}."
        )


def _differ(unit: str, other: str, quantity: str) -> bool:
    """Whether two units of a quantity are different ones; an unknown one is not compared."""
    try:
        return to_si(unit, quantity) != to_si(other, quantity)
    except InputError:
        return False


def _check_values(path: Path, source: str, values: Any) -> None:
    if not isinstance(values, np.ndarray) or values.ndim != 1 or values.dtype.kind != "f":
        raise InputError(f"{path}: the reader gave no row of numbers for the channel {source!r}.")
    if values.size < LEAST_SAMPLES:
        raise InputError(
            f"{path}: {source!r} has {plural(values.size, 'sample')}; a channel must have {LEAST_SAMPLES} "
            "or more."
        )


def _in_si(path: Path, raw: NDArray[Any], channel: Channel, listed: RawChannel) -> NDArray[Any]:
    unit = channel.unit or listed.unit or ""
    if not listed.scaled and (channel.scale is None or not channel.unit):
        raise InputError(
            f"{path}: gives no scale and no unit of {channel.source!r}; give both in the channel map."
        )
    try:
        slope, zero = to_si(unit, channel.quantity)
    except InputError as error:
        raise InputError(
            f"{path}: gives {channel.source!r} the unit {unit!r}; give its unit in the channel map, one of"
            f" {channel.quantity} ({error})."
        ) from None
    zero += slope * channel.offset
    if channel.scale is not None:
        slope *= channel.scale
    if (slope, zero) == (1.0, 0.0):
        return raw
    with np.errstate(over="ignore", invalid="ignore"):  # the quality gate reports it
        return raw.astype(np.float64) * slope + zero


def _rate(file: _File, channel: Channel, time: Array | None, size: int) -> float:
    path, channels = file.path, file.map
    rate = channel.sample_rate or channels.sample_rate or file.rate_of(channel.source)
    if rate is None and time is not None and time.size == size:
        rate = float(f"{rate_from_time(time):.{_RATE_DIGITS}g}")
        if not math.isfinite(rate):
            raise InputError(
                f"{path}: its time channel does not increase; declare sample_rate in {channels.source}."
            )
    if rate is None:
        raise InputError(
            f"{path}: no sample rate of {channel.source!r} was found; declare sample_rate in "
            f"{channels.source}, or map a channel of the quantity time."
        )
    if not RATES[0] <= rate <= RATES[1]:
        raise InputError(
            f"{path}: sample rate of {channel.source!r} is {rate:g} Hz; it must be from {RATES[0]:g} to "
            f"{RATES[1]:g} Hz."
        )
    return float(rate)


def _labelled(
    file: _File, channel: Channel, source: _Measured, time: Array | None, notes: list[str]
) -> xr.DataArray:
    """Values of a channel, or of the one that it is derived from, at the rate of their updates."""
    origin, values = source
    rate = _rate(file, origin, time, values.size)
    start = file.listed[channel.source].start
    interval, first = 1, 0
    if origin.quantity in _UPDATED:
        interval, first = update_interval(values)
    if interval > 1:
        notes.append(f"{channel.source}: {in_words(interval, rate)}.")
        values, start, rate = values[first::interval], (start or 0.0) + first / rate, rate / interval
    if channel.derive == "second-derivative":
        values = second_derivative(values, rate)
    elif channel.derive:
        values = derivative(values, rate)
    attributes = {
        "quantity": channel.quantity,
        "unit": SI_UNITS[channel.quantity],
        "location": channel.location,
        "direction": channel.direction,
        "sample_rate": rate,
        "start": start,
        "derived": channel.derive is not None,
        "derive": channel.derive,
        "source": channel.source,
        "phase": channel.phase,
        "filtered_by": origin.filtered_by,
        "followed_by": channel.followed_by,
        "updated_every": interval,
    }
    return xr.DataArray(values, dims="time", name=channel.name, attrs=attributes)


def _check_lengths(
    path: Path, arrays: Mapping[str, xr.DataArray], time: Array | None, input_rate: float
) -> None:
    alike = [values for values in arrays.values() if values.attrs["start"] is None]
    rows = [(values.attrs["source"], values.size, values.attrs["sample_rate"]) for values in alike]
    if time is not None:
        rows.append(("time", time.size, input_rate))
    first: dict[float, tuple[str, int]] = {}
    for source, size, rate in rows:
        other, length = first.setdefault(rate, (source, size))
        if size != length:
            raise InputError(
                f"{path}: {other!r} has {length} samples and {source!r} has {size};"
                f" channels of one rate ({rate:g} Hz) must have the same number,"
                " so declare the sample_rate of one that has another."
            )


def _unit_notes(file: _File) -> list[str]:
    notes = []
    for channel in file.map.channels:
        stated = channel.unit or channel.derive or file.listed[channel.source].unit
        in_file = file.listed[channel.source].unit
        if channel.unit and in_file and _differ(channel.unit, in_file, channel.quantity):
            notes.append(
                f"{channel.source}: the channel map has the unit {channel.unit}, the file {in_file}; that of "
                "the map is used."
            )
        if not stated and channel.quantity != "time":
            notes.append(f"{channel.source}: no unit is given, so {SI_UNITS[channel.quantity]} is assumed.")
    return notes
