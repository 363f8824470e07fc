"""Array type used in every signature: NumPy, double precision."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError

Array = NDArray[np.float64]

_RATE_ERROR = 0.01  # of a stated rate against the times of the samples
_LONGEST_STEP = 1.5  # sample intervals; one lost sample makes two
_MOST_OFFSET = 0.5  # sample intervals between the beginnings of two signals
_TIMES = ("time", "t")  # names of an index of numbers that are times, s


def real_samples(values: Any) -> Array:
    """Samples in float64; masked ones are NaN.

    Raises
    ------
    TypeError
        If they are complex, boolean or times: their conversion would lose what they mean.
    ValueError
        If they are no numbers.
    """
    values = _data(values)
    if hasattr(values, "magnitude"):
        values = values.magnitude  # of Pint, whose unit is that of `stated_unit`
    if np.ma.isMaskedArray(values):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    samples = np.asarray(values)
    if samples.dtype.kind in "bcmM":
        raise TypeError(f"samples are {samples.dtype}")
    return samples.astype(np.float64, copy=False)


def stated_unit(values: Any) -> str:
    """Unit that samples state, by Pint or the attribute *units* or *unit* of xarray and pandas; or empty."""
    units = getattr(_data(values), "units", None)
    if units is not None:
        return str(units)
    for name, value in getattr(values, "attrs", {}).items():
        if str(name).casefold() in ("units", "unit"):
            return str(value)
    return ""


def _data(values: Any) -> Any:
    """Array in a DataArray of xarray; any other samples as they are."""
    if hasattr(values, "coords") and hasattr(values, "data"):
        return values.data
    return values


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


def check_starts(signals: Mapping[str, Any], rate: float) -> None:
    """Refuse signals that begin at different times by their own times.

    Parameters
    ----------
    signals : mapping of str to array-like
        Samples as for :func:`check_times`, by the name of the signal.
    rate : float
        Hz. Signals may begin half a sample apart.

    Raises
    ------
    InputError
        If one begins later than another.
    """
    starts: dict[str, tuple[str, Any]] = {}
    for name, values in signals.items():
        index = _index(values)
        if index is None or not index.size:
            continue
        kind = index.dtype.kind
        other, start = starts.setdefault(kind, (name, index[0]))
        later = _seconds(index[:1] - start).item()
        if abs(later) * rate > _MOST_OFFSET:
            raise InputError(
                f"the {name} begins {abs(later):g} s {'after' if later > 0 else 'before'} the {other} by "
                "their times; give both from the same time on."
            )


def _times(values: Any) -> Array | None:
    """Times of samples by their index, s from the first; None without."""
    index = _index(values)
    if index is None:
        return None
    return _seconds(index - index[:1])


def _seconds(differences: NDArray[Any]) -> Array:
    """Differences of times, s."""
    if differences.dtype.kind == "m":
        differences = differences / np.timedelta64(1, "s")
    return differences.astype(np.float64)


def _index(values: Any) -> NDArray[Any] | None:
    """Index of samples if it consists of times: dates, durations, or s; None without."""
    index, label, unit = None, "", ""
    dimensions = getattr(values, "dims", ())
    if isinstance(dimensions, tuple) and dimensions and dimensions[-1] in values.coords:
        label = dimensions[-1]
        coordinate = values.coords[label]
        index, unit = np.asarray(coordinate), str(coordinate.attrs.get("units", ""))
    elif hasattr(values, "iloc"):
        label, times = values.index.name, values.index
        if getattr(times, "tz", None) is not None:
            times = times.tz_convert(None)
        index = np.asarray(times)
    if index is not None and _are_times(index, str(label), unit):
        return index
    return None


def _are_times(index: NDArray[Any], label: str, unit: str) -> bool:
    """Whether an index has dates, durations, or numbers that are called times and are in s."""
    in_seconds = index.dtype.kind == "f" and label.casefold() in _TIMES and unit in ("", "s")
    return index.dtype.kind in "mM" or in_seconds
