"""Unit, rate and start time in the attributes of a file, by their usual names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ballscrew.base.errors import InputError
from ballscrew.base.units import NoDefinitionsError, parse

RATES = ("sample_rate", "samplerate", "sampling_rate", "sampling_frequency", "sample_frequency", "fs", "rate")
_INTERVALS = ("dt", "wf_increment", "sample_interval")
_UNITS = ("unit", "units", "unit_string")
_STARTS = ("started_at", "start_time", "wf_start_time", "starttime", "measured_at")


def text_of(value: Any) -> str | None:
    """Read a text attribute: bytes, text, or an array of one of them; None for anything else."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, (bytes, np.bytes_)):
        value = bytes(value).decode("utf-8", "replace")
    if not isinstance(value, str):
        return None
    return str(value).strip("\0 \t\r\n") or None


def _number_of(value: Any, unit: str) -> float | None:
    text = text_of(value)
    try:
        if text is not None:
            return parse(text, unit)
        array = np.asarray(value)
        if array.size == 1 and array.dtype.kind in "iuf":
            return float(array.reshape(-1)[0])
    except NoDefinitionsError:
        raise
    except (InputError, ValueError, TypeError):
        pass
    return None


def _first(attributes: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    folded = {str(key).casefold(): key for key in attributes}
    for name in names:
        if name in folded:
            return attributes[folded[name]]
    return None


def rate_of(attributes: Mapping[str, Any]) -> float | None:
    """Find the sample rate in Hz, from a rate or from an interval; its value is not checked.

    Parameters
    ----------
    attributes : mapping
        Names and values in the file; case does not matter.

    Returns
    -------
    float or None
        The rate in Hz.
    """
    rate = _number_of(_first(attributes, RATES), "Hz")
    if rate is not None:
        return rate
    interval = _number_of(_first(attributes, _INTERVALS), "s")
    if not interval:
        return None
    return 1.0 / interval


def unit_of(attributes: Mapping[str, Any]) -> str | None:
    """Find the unit as written."""
    return text_of(_first(attributes, _UNITS))


def start_of(attributes: Mapping[str, Any]) -> str | None:
    """Find the start time as written."""
    return text_of(_first(attributes, _STARTS))
