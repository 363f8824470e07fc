"""Array type used in every signature: NumPy, double precision."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError

Array = NDArray[np.float64]

_RATE_ERROR = 0.01  # of a stated rate against the times of the samples
_LONGEST_STEP = 1.5  # sample intervals; one lost sample makes two
_TIMES = ("time", "t")  # names of an index of numbers that are times, s


def real_samples(values: Any) -> Array:
    """Samples in float64; masked ones are NaN.

    Raises
    ------
    TypeError
        If they are complex or boolean: their conversion would lose what they mean.
    ValueError
        If they are no numbers.
    """
    if np.ma.isMaskedArray(values):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    samples = np.asarray(values)
    if samples.dtype.kind in "bc":
        raise TypeError(f"samples are {samples.dtype}")
    return samples.astype(np.float64, copy=False)


def check_times(values: Any, rate: float, name: str) -> None:
    """Refuse samples whose own times contradict the sample rate.

    Parameters
    ----------
    values : array-like
        Of xarray or pandas, with an index of dates or durations, or one named *time* in s. Other samples have
        no times and are accepted.
    rate : float
        Stated, Hz.
    name : str
        Of the signal, for the message.

    Raises
    ------
    InputError
        If the times are of another rate, do not increase, or have a gap.
    """
    times = _times(values)
    if times is None or times.size < 2:
        return
    steps = np.diff(times)
    typical = float(np.median(steps))
    if not abs(typical * rate - 1) <= _RATE_ERROR:
        own = 1 / typical if typical > 0 else 0.0
        raise InputError(
            f"the times of the {name} are those of {own:g} Hz; {rate:g} Hz was stated as the sample rate."
        )
    uneven = (steps <= 0) | (steps > _LONGEST_STEP * typical)
    if uneven.any():
        first = float(times[np.argmax(uneven)])
        raise InputError(f"the times of the {name} have a gap or go back after {first:g} s.")


def _times(values: Any) -> Array | None:
    """Times of samples by their index, s from the first; None without."""
    index, label, unit = None, "", ""
    if hasattr(values, "coords") and values.dims and values.dims[-1] in values.coords:
        label = values.dims[-1]
        coordinate = values.coords[label]
        index, unit = np.asarray(coordinate), str(coordinate.attrs.get("units", ""))
    elif hasattr(values, "iloc"):
        label, index = values.index.name, np.asarray(values.index)
    if index is None:
        return None
    if index.dtype.kind in "mM":
        return np.asarray((index - index[:1]) / np.timedelta64(1, "s"), dtype=np.float64)
    if index.dtype.kind == "f" and str(label).casefold() in _TIMES and unit in ("", "s"):
        return np.asarray(index - index[:1], dtype=np.float64)
    return None
