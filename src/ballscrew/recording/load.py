"""From a file and a channel map to a recording."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.base.provenance import FileRef, hash_file
from ballscrew.recording.channels import Channel, ChannelMap
from ballscrew.recording.header import Header, RawChannel
from ballscrew.recording.quantities import INPUTS, SI_UNITS, to_si
from ballscrew.recording.readers import reader_for
from ballscrew.recording.readers.guard import refusing
from ballscrew.recording.recording import Recording, second_derivative

__all__ = ["rate_from_time", "read_recording"]

LEAST_SAMPLES = 16
_MOST_LISTED = 30


def read_recording(path: str | Path, channels: ChannelMap) -> Recording:
    """Read the mapped channels of a file, and no others, into SI.

    Parameters
    ----------
    path : path-like
        The file, of any format that a reader knows.
    channels : ChannelMap
        What is what.

    Returns
    -------
    Recording
        With the file's SHA-256.

    Raises
    ------
    InputError
        If no reader can read the file, a channel is not in it, has too few samples or another length than
        those of the same rate, or no rate can be found.
    """
    path = Path(path)
    digest = hash_file(path)
    reader = reader_for(path)
    with refusing(path, reader.name):
        header = reader.read_header(path)
        _check_sources(path, header, channels)
        sources = list(dict.fromkeys(channel.source for channel in channels.channels))
        raw = reader.read(path, sources)
    listed = {channel.name: channel for channel in header.channels}
    for source in sources:
        _check_values(path, source, raw.get(source))
    si = {c.name: _in_si(path, raw[c.source], c, listed[c.source]) for c in channels.channels if not c.derive}
    time = next((si.pop(c.name) for c in channels.channels if c.quantity == "time"), None)
    time = None if time is None else time.astype(np.float64)
    measured = [c for c in channels.channels if c.quantity != "time"]
    if not measured:
        raise InputError(f"{channels.source}: maps nothing but the time; it must map what was measured.")
    first = min(measured, key=lambda c: INPUTS.index(c.quantity) if c.quantity in INPUTS else len(INPUTS))
    by_source = {c.source: c for c in measured if c.quantity == "position" and not c.derive}
    arrays: dict[str, xr.DataArray] = {}
    rates: dict[str, float] = {}
    for channel in measured:
        origin = by_source[channel.source] if channel.derive else channel
        rate = _rate(path, origin, channels, header, listed[origin.source], time, si[origin.name].size)
        values = (
            second_derivative(si[origin.name].astype(np.float64), rate)
            if channel.derive
            else si[channel.name]
        )
        rates[channel.name] = rate
        arrays[channel.name] = _labelled(values, channel, rate)
    _check_lengths(path, arrays, time, rates[first.name])
    return Recording(
        channels=MappingProxyType(arrays),
        file=FileRef(path.name, digest),
        reader=header.reader or reader.name,
        sample_rate=rates[first.name],
        started_at=header.started_at,
        declared_rate=first.sample_rate or channels.sample_rate,
        file_rate=_file_rate(header, listed[first.source]),
        time=time,
        notes=tuple(_unit_notes(measured, listed)),
    )


def rate_from_time(time: NDArray[np.float64]) -> float:
    """Sample rate from sample times, unharmed by coarse digits and by a few lost samples.

    Parameters
    ----------
    time : ndarray of shape (samples,)
        Sample times, s.

    Returns
    -------
    float
        The rate, Hz; NaN where the times do not increase.
    """
    # Over many samples, since a logger's milliseconds hide single ones; trimmed, since a gap spoils some.
    step = max(1, time.size // 16)
    spans = time[step:] - time[:-step]
    spans = np.sort(spans[np.isfinite(spans)])
    cut = spans.size // 10
    span = float(np.mean(spans[cut : spans.size - cut])) if spans.size else math.nan
    return step / span if span > 0 else math.nan


def _check_sources(path: Path, header: Header, channels: ChannelMap) -> None:
    has = [channel.name for channel in header.channels]
    known = set(has)
    for i, channel in enumerate(channels.channels):
        if channel.source not in known:
            folded = {name.casefold(): name for name in has}
            close = difflib.get_close_matches(channel.source.casefold(), list(folded)[:5000], n=1)
            hint = f", did you mean {folded[close[0]]!r}?" if close else ";"
            more = f" and {len(has) - _MOST_LISTED} more" if len(has) > _MOST_LISTED else ""
            listing = ", ".join(has[:_MOST_LISTED]) or "no channel at all"
            raise InputError(
                f"{path}: has no channel {channel.source!r} ({channels.source}: channel[{i}].source){hint}"
                f" it has {listing}{more}."
            )


def _check_values(path: Path, source: str, values: Any) -> None:
    if not isinstance(values, np.ndarray) or values.ndim != 1 or values.dtype.kind != "f":
        raise InputError(f"{path}: the reader gave no row of numbers for the channel {source!r}.")
    if values.size < LEAST_SAMPLES:
        raise InputError(
            f"{path}: {source!r} has {values.size} samples; a channel must have {LEAST_SAMPLES} or more."
        )


def _in_si(path: Path, raw: NDArray[Any], channel: Channel, listed: RawChannel) -> NDArray[Any]:
    unit = channel.unit or listed.unit or ""
    try:
        slope, zero = to_si(unit, channel.quantity)
    except InputError as error:
        raise InputError(
            f"{path}: gives {channel.source!r} the unit {unit!r}; give its unit in the channel map, one of"
            f" {channel.quantity} ({error})."
        ) from None
    slope, zero = slope * channel.scale, slope * channel.offset + zero
    if (slope, zero) == (1.0, 0.0):
        return raw
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is the quality gate's to tell
        return raw.astype(np.float64) * slope + zero


def _file_rate(header: Header, listed: RawChannel) -> float | None:
    return listed.sample_rate if listed.sample_rate is not None else header.sample_rate


def _rate(
    path: Path,
    channel: Channel,
    channels: ChannelMap,
    header: Header,
    listed: RawChannel,
    time: NDArray[np.float64] | None,
    size: int,
) -> float:
    rate = channel.sample_rate or channels.sample_rate or _file_rate(header, listed)
    if rate is None and time is not None and time.size == size:
        rate = rate_from_time(time)
        if not math.isfinite(rate):
            raise InputError(
                f"{path}: its time channel does not increase; declare sample_rate in {channels.source}."
            )
    if rate is None:
        raise InputError(
            f"{path}: says no sample rate for {channel.source!r}; declare sample_rate in {channels.source},"
            " or map a channel of the quantity time."
        )
    if not (math.isfinite(rate) and rate > 0):
        raise InputError(
            f"{path}: sample rate of {channel.source!r} is {rate:g} Hz; it must be finite and more than 0."
        )
    return float(rate)


def _labelled(values: NDArray[Any], channel: Channel, rate: float) -> xr.DataArray:
    attributes = {
        "quantity": channel.quantity,
        "unit": SI_UNITS[channel.quantity],
        "location": channel.location,
        "direction": channel.direction,
        "sample_rate": rate,
        "derived": channel.derive is not None,
        "source": channel.source,
    }
    return xr.DataArray(values, dims="time", name=channel.name, attrs=attributes)


def _check_lengths(
    path: Path, arrays: Mapping[str, xr.DataArray], time: NDArray[np.float64] | None, input_rate: float
) -> None:
    first: dict[float, tuple[str, int]] = {}
    rows = [(values.attrs["source"], values.size, values.attrs["sample_rate"]) for values in arrays.values()]
    if time is not None:
        rows.append(("time", time.size, input_rate))
    for source, size, rate in rows:
        other, length = first.setdefault(rate, (source, size))
        if size != length:
            raise InputError(
                f"{path}: {other!r} has {length} samples and {source!r} has {size};"
                f" channels of one rate ({rate:g} Hz) must have the same number,"
                " so declare the sample_rate of one that has another."
            )


def _unit_notes(measured: list[Channel], listed: Mapping[str, RawChannel]) -> list[str]:
    return [
        f"{c.source}: no unit is given, so {SI_UNITS[c.quantity]} is assumed."
        for c in measured
        if not c.unit and not c.derive and not listed[c.source].unit
    ]
