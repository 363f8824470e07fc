"""The channels of a file as one frozen object in SI units."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from datetime import datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.base.arrays import Array, check_starts, check_times, real_samples, stated_unit
from ballscrew.base.errors import InputError, shown
from ballscrew.base.provenance import FileRef, digest
from ballscrew.base.settings import timestamp
from ballscrew.base.units import parse_named
from ballscrew.recording.channels import ChannelMap, read_channels
from ballscrew.recording.convert import Converted, convert
from ballscrew.recording.header import Header, RawChannel

_NUMBER = re.compile(r"_\d+\Z")


@dataclass(frozen=True, repr=False)
class Recording:
    """One file's channels, in SI, each at its own rate.

    Parameters
    ----------
    channels : mapping
        Name to ``xarray.DataArray`` of dimension ``time``, with the attributes quantity, unit (SI), location,
        direction, sample_rate (Hz), start (of the first sample, s, or None), derived and source.
    file : FileRef
        Name and SHA-256 of the file.
    reader : str
        Name of the reader that read it.
    sample_rate : float
        Rate of the input channel (torque, force or current; else of the first channel), Hz.
    started_at : str, optional
        Start time as written in the file.
    declared_rate, file_rate : float, optional
        The same rate as stated by the channel map and by the file, Hz.
    time : ndarray of shape (samples,), optional
        The file's own sample times, s.
    notes : tuple of str
        Assumptions, in sentences.
    """

    channels: Mapping[str, xr.DataArray]
    file: FileRef
    reader: str
    sample_rate: float
    started_at: str | None = None
    declared_rate: float | None = None
    file_rate: float | None = None
    time: Array | None = field(default=None, repr=False)
    notes: tuple[str, ...] = ()

    @classmethod
    def from_arrays(
        cls,
        *,
        sample_rate: float | str,
        units: Mapping[str, str] | None = None,
        channels: str | Path | ChannelMap | None = None,
        name: str = "arrays",
        started_at: str | datetime | None = None,
        **signals: Any,
    ) -> Recording:
        """Make a recording of arrays; it is accepted wherever a file is.

        Parameters
        ----------
        sample_rate : float or str
            Of all signals, Hz, or with a unit: ``"12.8 kHz"``.
        units : mapping of str to str, optional
            Unit of each signal, ``{"position": "mm"}``; by default its attribute ``units``, as xarray has it,
            or the unit of Pint, or else SI.
        channels : path-like or ChannelMap, optional
            Meaning of the signals, if their names are those of a channel map. By default each is named as its
            quantity: torque, force, current, position, acceleration (along the screw; without one it is
            derived from the position), temperature; ``acceleration_2`` and so on for more of them.
        name : str
            For messages, different for each recording of a run.
        started_at : str or datetime, optional
            ISO 8601.
        **signals : array-like, shape (samples,)
            Samples of each channel; a pandas table is given as ``**table``.

        Returns
        -------
        Recording
            Its SHA-256 is that of names, units, rate and samples.

        Raises
        ------
        InputError
            If a signal is no row of numbers, its name or unit is not known, or its own times contradict the
            sample rate.

        Examples
        --------
        >>> import ballscrew
        >>> import numpy as np
        >>> x = np.linspace(0, 100, 1000)
        >>> trip = ballscrew.Recording.from_arrays(
        ...     torque=0.1 * x, position=x, units={"position": "mm"}, sample_rate="1 kHz"
        ... )
        >>> float(trip.array("position")[-1])
        0.1
        """
        rate = parse_named("the sample rate", sample_rate, "Hz")
        for key, values in signals.items():
            check_times(values, rate, f"signal {key!r} of {name}")
        check_starts({f"signal {key!r} of {name}": values for key, values in signals.items()}, rate)
        raw = {key: _samples(name, key, values) for key, values in signals.items()}
        stated = _units(signals, units)
        _check_names(name, raw, stated)
        if isinstance(channels, str | Path):
            channels = read_channels(channels)
        if channels is None:
            channels = ChannelMap.from_settings({"channel": _rows(raw)}, name)
        listed = tuple(RawChannel(key, values.size, stated[key] or None) for key, values in raw.items())
        converted = convert(Path(name), Header(listed, rate), channels, raw)
        content = _hash(raw, {"units": stated, "sample_rate": rate})
        return make_recording(converted, FileRef(name, content), "arrays", _start(started_at))

    def __repr__(self) -> str:
        """File, rate and channels in a few lines."""
        channels, seconds = [], 0.0
        for name, values in self.channels.items():
            channels.append(f"{name} in {values.attrs['unit']}".removesuffix(" in "))
            seconds = max(seconds, values.size / self.rate(name))
        title = f"{self.file.name}: {self.sample_rate:g} Hz, {seconds:.4g} s"
        return "\n  ".join([f"<Recording> {title}", ", ".join(channels), *self.notes])

    def __getstate__(self) -> dict[str, Any]:
        """State for pickle and copy, in which the mapping of the channels is a plain one."""
        return self.__dict__ | {"channels": dict(self.channels)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state, with channels that cannot be replaced."""
        self.__dict__.update(state, channels=MappingProxyType(state["channels"]))

    def of(self, quantity: str, *, location: str | None = None, direction: str | None = None) -> list[str]:
        """Names of the channels of a quantity, at a location or in a direction where these are given."""
        return [
            name
            for name, values in self.channels.items()
            if values.attrs["quantity"] == quantity
            and (location is None or values.attrs["location"] == location)
            and (direction is None or values.attrs["direction"] == direction)
        ]

    def array(self, name: str) -> Array:
        """Values of a channel, in SI.

        Returns
        -------
        ndarray of shape (samples,)
            In float64, whatever the file has.
        """
        values: NDArray[Any] = self.channels[name].to_numpy()
        return values.astype(np.float64, copy=False)

    def rate(self, name: str) -> float:
        """Sample rate of a channel, Hz."""
        return float(self.channels[name].attrs["sample_rate"])


def make_recording(converted: Converted, file: FileRef, reader: str, started_at: str | None) -> Recording:
    """Recording of converted channels, with where they are from; a start that is no time is left out."""
    values = {each.name: getattr(converted, each.name) for each in fields(converted)}
    if started_at is not None:
        try:
            timestamp(started_at, "started_at")
        except InputError:
            note = f"the start {shown(started_at)} is no time in ISO 8601, and is ignored."
            values["notes"] = (*values["notes"], note)
            started_at = None
    return Recording(file=file, reader=reader, started_at=started_at, **values)


def _start(given: str | datetime | None) -> str | None:
    """Start of a recording in ISO 8601, checked."""
    if given is None:
        return None
    checked = timestamp(given, "started_at")
    return given if isinstance(given, str) else checked


def _units(signals: Mapping[str, Any], units: Mapping[str, str] | None) -> dict[str, str]:
    """Unit of each signal: as given, or as its samples state it."""
    if not isinstance(units, Mapping | None):
        raise InputError(f"units is {shown(units)}; it must be a mapping of signals to their units.")
    stated = {key: stated_unit(values) for key, values in signals.items()}
    return stated | {key: str(unit) for key, unit in (units or {}).items()}


def _samples(name: str, signal: str, values: Any) -> Array:
    """One signal in float64, refused unless it is one row of numbers."""
    try:
        samples = real_samples(values)
    except (TypeError, ValueError):
        raise InputError(f"{name}: {signal} must be numbers, of shape (samples,).") from None
    if samples.ndim != 1:
        raise InputError(f"{name}: {signal} has shape {samples.shape}; it must be one row of samples.")
    return samples


def _check_names(name: str, raw: Mapping[str, Array], stated: Mapping[str, str]) -> None:
    """Refuse a recording without signals, and units of what is none of them."""
    if not raw:
        raise InputError(f"{name}: no signal is given; give torque=, position= and others as arrays.")
    for key in stated:
        if key not in raw:
            raise InputError(f"{name}: units names {key!r}, which is none of its signals {', '.join(raw)}.")


def _rows(signals: Iterable[str]) -> list[dict[str, str]]:
    """Rows of a channel map for signals that are named as their quantities, ``"acceleration_2"``.

    Accelerations are along the screw; without one it is that of the motor, from the position.
    """
    rows = []
    for signal in signals:
        row = {"source": signal, "quantity": _NUMBER.sub("", signal).replace("_", " ")}
        if row["quantity"] == "acceleration":
            row["axis"] = "x"
        rows.append(row)
    quantities = [row["quantity"] for row in rows]
    if "position" in quantities and "acceleration" not in quantities:
        source = rows[quantities.index("position")]["source"]
        derived = {
            "quantity": "acceleration",
            "derive": "second-derivative",
            "location": "motor",
            "axis": "x",
        }
        rows.append({"source": source, **derived})
    return rows


def _hash(raw: Mapping[str, Array], stated: Mapping[str, Any]) -> str:
    """SHA-256 of samples and what is stated about them; the order of the signals does not matter."""
    content = hashlib.sha256(digest({**stated, "signals": sorted(raw)}).encode())
    for name in sorted(raw):
        content.update(np.ascontiguousarray(raw[name], dtype="<f8").tobytes())
    return content.hexdigest()
