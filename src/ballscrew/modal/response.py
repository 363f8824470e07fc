"""Frequency response of one input and one output, from arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.base.arrays import Array, check_starts, check_times, real_samples, stated_unit
from ballscrew.base.errors import InputError, shown
from ballscrew.base.result import PlottedResult
from ballscrew.base.units import parse_named
from ballscrew.base.words import plural
from ballscrew.modal.spectra import Spectra, averaged, coherence
from ballscrew.modal.spectra import frf as estimate_frf

if TYPE_CHECKING:
    import pandas as pd

_FEWEST_SAMPLES = 16
_LARGEST = 1e50  # of a value, and of one over it: their products are numbers
_ESTIMATORS = ("H1", "H2", "Hv")
_FINEST = 100  # lines per line of the longest record: zeros only interpolate

Records = Any
"""One record, shape (samples,), or several, shape (records, samples) or a sequence of records."""


@dataclass(frozen=True, slots=True, repr=False)
class FrequencyResponse(PlottedResult):
    """Frequency response of one input and one output.

    Parameters
    ----------
    frequency : ndarray, shape (n,)
        Hz.
    frf : ndarray of complex, shape (n,)
        Output per input.
    coherence : ndarray, shape (n,)
        0 to 1; NaN for a single record, whose coherence is 1 whatever it is.
    estimator : str
        H1, H2 or Hv.
    count : int
        Records averaged.
    """

    frequency: Array
    frf: NDArray[np.complex128]
    coherence: Array
    estimator: str
    count: int

    _drawing = "frf_figure:draw_response"

    def _lines(self) -> list[str]:
        last = f"{self.frequency[-1]:g} Hz in steps of {self.frequency[-1] / len(self.frequency):.3g} Hz"
        return [f"FRF up to {last}, {self.estimator}, {plural(self.count, 'record')} averaged"]

    def to_dataframe(self) -> pd.DataFrame:
        """Table of FRF and coherence, a row for each frequency."""
        import pandas as pd

        return pd.DataFrame(
            {"frequency_Hz": self.frequency, "frf": self.frf, "coherence": self.coherence}
        )  # fmt: skip

    def to_xarray(self) -> xr.Dataset:
        """FRF and coherence over frequency."""
        return xr.Dataset(
            {"frf": ("frequency", self.frf), "coherence": ("frequency", self.coherence)},
            coords={"frequency": ("frequency", self.frequency, {"units": "Hz"})},
            attrs={"estimator": self.estimator, "records": self.count},
        )


def frf(
    input: Records,  # noqa: A002
    output: Records,
    sample_rate: float | str,
    *,
    estimator: Literal["H1", "H2", "Hv"] = "H1",
    resolution: float | str | None = None,
) -> FrequencyResponse:
    """Frequency response of one input and one output, averaged over records.

    Parameters
    ----------
    input, output : array-like
        One record, shape (samples,), or several, shape (records, samples) or a sequence of records.
    sample_rate : float or str
        Hz, or with a unit: ``"12.8 kHz"``.
    estimator : {"H1", "H2", "Hv"}
        H1 suits noise in the output, H2 noise in the input, Hv both.
    resolution : float or str, optional
        Spacing of the frequencies; by default that of the longest record.

    Returns
    -------
    FrequencyResponse
        From the first line above 0 to half of the sample rate. Records are not windowed: each should begin
        and end at rest, or be multiplied by a window that the caller chooses.

    Raises
    ------
    InputError
        If input and output do not belong together, have values that are not finite, or times that
        contradict the sample rate, or estimator or resolution are none.

    References
    ----------
    J. S. Bendat and A. G. Piersol, *Random Data*, 4th ed., ch. 6 and 7, 10.1002/9781118032428.

    Examples
    --------
    >>> import ballscrew
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> force = rng.normal(size=(4, 1000))
    >>> response = ballscrew.frf(force, 2 * force, "1 kHz")
    >>> bool(np.allclose(response.frf, 2))
    True
    """
    if estimator not in _ESTIMATORS:
        raise InputError(f"the estimator is {shown(estimator)}; it must be {', '.join(_ESTIMATORS)}.")
    rate = parse_rate(sample_rate)
    inputs, outputs = check_records(input, output, rate)
    length = max(map(len, inputs))
    step = rate / length if resolution is None else _parse_resolution(resolution, rate, length)
    spectra = averaged_spectra(inputs, outputs, rate, step)
    known = spectra.count > 1
    return FrequencyResponse(
        spectra.frequency,
        estimate_frf(spectra, estimator)[0],
        coherence(spectra)[0] if known else np.full(len(spectra.frequency), math.nan),
        estimator,
        spectra.count,
    )


def _parse_resolution(resolution: float | str, rate: float, length: int) -> float:
    """Spacing of the frequencies, Hz, refused where a line has no samples or lies between all others."""
    step = parse_named("the resolution", resolution, "Hz")
    finest = rate / (_FINEST * length)
    if not finest <= step <= rate / 2:
        raise InputError(
            f"the resolution is {step:g} Hz; records of {length} samples at {rate:g} Hz suit {finest:.3g} to "
            f"{rate / 2:g} Hz."
        )
    return step


def averaged_spectra(inputs: Sequence[Array], outputs: Sequence[Array], rate: float, step: float) -> Spectra:
    """Average of records."""
    return averaged(padded(inputs), padded(outputs)[None], rate, (step / 2, rate / 2), step)


def padded(records: Sequence[Array]) -> Array:
    """Records of one length, the shorter ones continued by zeros."""
    length = max(map(len, records))
    return np.array([np.pad(x, (0, length - len(x))) for x in records])


def parse_rate(sample_rate: float | str) -> float:
    """Sample rate in Hz, refused unless finite and above 0."""
    rate = parse_named("the sample rate", sample_rate, "Hz")
    if not 0 < rate < math.inf:
        raise InputError(f"the sample rate is {rate:g} Hz; it must be finite and more than 0.")
    return rate


def check_records(
    input: Records,  # noqa: A002
    output: Records,
    rate: float,
) -> tuple[list[Array], list[Array]]:
    """Records of input and output, checked."""
    inputs, outputs = _rows("input", input, rate), _rows("output", output, rate)
    sizes, others = [*map(len, inputs)], [*map(len, outputs)]
    if sizes != others:
        raise InputError(
            f"input and output must have the same number of samples in every record; they have {sizes} and "
            f"{others}."
        )
    for row, other in zip(_separate(input), _separate(output), strict=False):
        check_starts({"input": row, "output": other}, rate)
    return inputs, outputs


def _separate(given: Records) -> Sequence[Any]:
    """Records that are separate arrays; otherwise the array of all."""
    if isinstance(given, list | tuple) and len(given) > 0 and np.ndim(given[0]) == 1:
        return given
    return [given]


def _rows(name: str, given: Records, rate: float) -> list[Array]:
    """Records of a signal, in float64."""
    separate = _separate(given)
    units = sorted({stated_unit(row) for row in separate})
    if len(units) > 1:
        raise InputError(f"records of the {name} have different units: {', '.join(map(shown, units))}.")
    for row in separate:
        check_times(row, rate, name)
    try:
        rows = [real_samples(row) for row in separate]
    except (TypeError, ValueError):
        raise InputError(f"the {name} must be numbers, of shape (samples,) or (records, samples).") from None
    if len(rows) == 1 and rows[0].ndim == 2:
        rows = list(rows[0])
    for row in rows:
        if row.ndim != 1 or row.size < _FEWEST_SAMPLES:
            raise InputError(
                f"a record of the {name} has shape {row.shape}; it must be one row of {_FEWEST_SAMPLES} "
                "samples or more."
            )
        if not np.isfinite(row).all():
            raise InputError(f"the {name} has values that are not finite.")
        if not np.ptp(row) > 0:
            raise InputError(f"a record of the {name} is constant: nothing was measured.")
        largest = float(np.abs(row).max())
        if not 1 / _LARGEST < largest < _LARGEST:
            raise InputError(f"the {name} has values up to {largest:.0e}; state it in another unit.")
    return rows
