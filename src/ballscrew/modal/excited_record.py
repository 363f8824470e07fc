"""Channels of a recording with broadband excitation, by a channel map or as the file has them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.provenance import FileRef, hash_file
from ballscrew.modal.resonances import ORDERS
from ballscrew.recording.channels import ChannelMap
from ballscrew.recording.convert import rate_from_time
from ballscrew.recording.guess import ChannelGuess, guess_channels
from ballscrew.recording.header import Header
from ballscrew.recording.load import read_recording
from ballscrew.recording.quantities import to_si
from ballscrew.recording.readers.process import opened
from ballscrew.recording.recording import Recording

_MOST_TRAVEL = 0.02  # m during one recording: the frequency of the bench changes by 1 Hz
_RATES = 1e-4  # relative difference of equal rates
_MOST_LISTED = 30
_KINDS = {"relative torque": "torque"}


@dataclass(frozen=True, slots=True)
class Signals:
    """Names of the channels, and their quantities.

    Parameters
    ----------
    input, output : str
        Names in the file, or in the channel map.
    reference : str or None
        Excitation that was added to a set-point.
    quantities : tuple of (str or None)
        Of input and output; None for that of the channel map, or the one that the name states.
    """

    input: str
    output: str
    reference: str | None = None
    quantities: tuple[str | None, str | None] = (None, None)

    @property
    def names(self) -> list[str]:
        """All channels, in the order of the records."""
        return [name for name in (self.input, self.output, self.reference) if name is not None]


@dataclass(frozen=True, slots=True)
class ExcitedRecord:
    """Samples of the channels of one file.

    Parameters
    ----------
    file : FileRef
        Name and SHA-256.
    started_at : str or None
        As the file states it.
    arrays : list of ndarray
        Input, output and perhaps reference.
    rate : float
        Hz.
    quantities : tuple of str
        Of input and output.
    position : float or None
        Of the table, m, where it is mapped.
    """

    file: FileRef
    started_at: str | None
    arrays: list[Array]
    rate: float
    quantities: tuple[str, str]
    position: float | None


def read_record(file: Path | Recording, signals: Signals, channels: ChannelMap | None) -> ExcitedRecord:
    """Named channels of a file, in SI by a channel map, otherwise as the file has them."""
    if isinstance(file, Recording):
        recording = file
    elif channels is None:
        return _read_raw(file, signals)
    else:
        recording = read_recording(file, channels)
    name = recording.file.name
    keys = [_key(recording, each) for each in signals.names]
    rates = [recording.rate(key) for key in keys]
    check_rates(name, signals.names, rates)
    attributes = [recording.channels[key].attrs["quantity"] for key in keys[:2]]
    kinds = _kinds(name, signals, attributes)
    place = None
    for key in recording.of("position")[:1]:
        place = _place(name, recording.array(key))
    arrays = [recording.array(key) for key in keys]
    return ExcitedRecord(recording.file, recording.started_at, arrays, rates[0], kinds, place)


def _key(recording: Recording, name: str) -> str:
    """Name in the recording of a channel that is named as there or as in the file."""
    if name in recording.channels:
        return name
    for key, values in recording.channels.items():
        if values.attrs["source"] == name and not values.attrs["derived"]:
            return key
    sources = sorted({str(values.attrs["source"]) for values in recording.channels.values()})
    raise InputError(
        f"{recording.file.name}: no channel {name!r} is mapped; mapped are {', '.join(sources)}."
    )


def _read_raw(path: Path, signals: Signals) -> ExcitedRecord:
    """Named channels of a file without a channel map: their scale has no effect."""
    with opened(path) as source:
        file, header = FileRef(path.name, hash_file(path)), source.header
        listed = {channel.name: channel for channel in header.channels}
        _check_names(path, signals.names, listed)
        guesses = {guess.channel: guess for guess in guess_channels(header) if not guess.derive}
        time = _time_channel(guesses.values())
        raw = source.read([name for name in listed if name in (*signals.names, time)])
    from_time = None
    if time:
        slope = to_si(listed[time].unit or "", "time")[0]
        from_time = rate_from_time(slope * raw[time].astype(np.float64))
    rate = _common_rate(path, signals.names, header, from_time)
    kinds = _kinds(path.name, signals, [guesses[name].quantity for name in signals.names[:2]])
    arrays = [raw[name].astype(np.float64) for name in signals.names]
    return ExcitedRecord(file, header.started_at, arrays, rate, kinds, None)


def _time_channel(guesses: Iterable[ChannelGuess]) -> str:
    """Name of the channel of the time; empty without one."""
    for guess in guesses:
        if guess.used and guess.quantity == "time":
            return guess.channel
    return ""


def _common_rate(path: Path, names: Sequence[str], header: Header, from_time: float | None) -> float:
    """Rate of several channels of a file, Hz."""
    own = {channel.name: channel.sample_rate for channel in header.channels}
    rates = []
    for name in names:
        rate = own[name] or header.sample_rate or from_time
        if rate is None or not 0 < rate < np.inf:
            raise InputError(f"{path}: states no sample rate; give a channel map with it (--channels).")
        rates.append(float(rate))
    check_rates(path.name, names, rates)
    return rates[0]


def _check_names(path: Path, names: Sequence[str], listed: Iterable[str]) -> None:
    """Refuse names that a file does not have."""
    known = [*listed]
    for name in names:
        if name not in known:
            texts = ", ".join(map(repr, known[:_MOST_LISTED])) or "no series of numbers in one dimension"
            raise InputError(f"{path}: has no channel {name!r}; it has {texts}.")


def check_rates(file: str, names: Sequence[str], rates: Sequence[float]) -> None:
    """Refuse channels or files of different rates, Hz."""
    if max(rates) / min(rates) - 1 > _RATES:
        texts = ", ".join(f"{name!r} {rate:g} Hz" for name, rate in zip(names, rates, strict=True))
        raise InputError(f"{file}: the channels must have the same rate; they have {texts}.")


def _kinds(file: str, signals: Signals, known: Sequence[str]) -> tuple[str, str]:
    """Quantities of input and output."""
    kinds = []
    for name, given, other in zip(signals.names, signals.quantities, known, strict=False):
        kind = given or _KINDS.get(other, other)
        if kind not in ORDERS:
            raise InputError(
                f"{file}: the quantity of {name!r} is not known; state those of input and output, such as "
                "--quantities torque speed."
            )
        kinds.append(kind)
    return kinds[0], kinds[1]


def _place(file: str, position: Array) -> float:
    """Mean position of a recording, which must not travel far."""
    travel = float(np.ptp(position))
    if not travel <= _MOST_TRAVEL:
        raise InputError(
            f"{file}: the table moves by {1e3 * travel:.0f} mm; the position of a cell must be known to "
            f"{1e3 * _MOST_TRAVEL:g} mm."
        )
    return float(position.mean())
