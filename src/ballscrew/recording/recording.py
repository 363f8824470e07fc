"""The channels of a file as one frozen object in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.provenance import FileRef


@dataclass(frozen=True)
class Recording:
    """One file's channels, in SI, each at its own rate.

    Parameters
    ----------
    channels : mapping
        Name to ``xarray.DataArray`` of dimension ``time``, with the attributes quantity, unit (SI), location,
        direction, sample_rate (Hz), derived and source.
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
