"""The lines of a band: all that an estimator needs of a cell's records.

A record is transformed as it is, without a window. What a window would hide, that the record starts ringing
and ends somewhere else, is then a smooth function of the frequency, which the model holds
(:mod:`~ballscrew.modal.output_error.model`). So nothing is thrown away, and the band alone is a tenth of the
samples.

Source: R. Pintelon and J. Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed., ch. 6,
DOI 10.1002/9781118287422.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from ballscrew.base.errors import InputError

__all__ = ["CellLines", "cell_lines"]

_FEWEST = 8  # lines
_USABLE = 0.45  # of the rate


@dataclass(frozen=True, slots=True)
class CellLines:
    """Transforms of a cell's records on the lines of a band.

    Parameters
    ----------
    omega : ndarray, shape (n,)
        Angular frequencies, rad/s.
    force : ndarray of complex, shape (repetitions, n)
        Scaled so that white noise of standard deviation σ has σ in the real and in the imaginary part.
    response : ndarray of complex, shape (responses, repetitions, n)
        Likewise.
    """

    omega: NDArray[np.float64]
    force: NDArray[np.complex128]
    response: NDArray[np.complex128]

    def only(self, repetitions: NDArray[np.intp]) -> CellLines:
        """The same of some repetitions."""
        return CellLines(self.omega, self.force[repetitions], self.response[:, repetitions])


def cell_lines(
    force: NDArray[np.floating], response: NDArray[np.floating], rate: float, band: tuple[float, float]
) -> CellLines:
    """Transform the records of a cell.

    Parameters
    ----------
    force : ndarray, shape (repetitions, samples)
        Input, as recorded.
    response : ndarray, shape (responses, repetitions, samples) or (repetitions, samples)
        Accelerations, as recorded.
    rate : float
        Samples per second, Hz.
    band : tuple of float
        Lowest and highest frequency to be modelled, Hz.

    Returns
    -------
    CellLines
        Cut to a length whose transform is fast, at most a percent or two shorter.

    Raises
    ------
    InputError
        If shapes do not belong together, values are not finite, or the record is too short for the band.
    """
    force, response = np.asarray(force), np.asarray(response)
    response = response[None] if response.ndim == 2 else response
    if force.ndim != 2 or response.ndim != 3 or response.shape[1:] != force.shape or force.size == 0:
        raise InputError(
            f"the force has the shape {force.shape} and the response {response.shape}; they must be "
            "(repetitions, samples) and (responses, repetitions, samples)."
        )
    if not 0 < rate < np.inf or not 0 < band[0] < band[1] < np.inf:
        raise InputError(
            f"the band is {band[0]:g} to {band[1]:g} Hz at a rate of {rate:g} Hz; it must rise from above 0."
        )
    if band[1] > _USABLE * rate:
        raise InputError(
            f"the band reaches {band[1]:g} Hz; at a rate of {rate:g} Hz it must end at {_USABLE * rate:g} Hz."
        )
    samples = _fast(force.shape[-1])
    first = max(1, int(np.ceil(band[0] * samples / rate)))
    last = int(band[1] * samples / rate)
    if last - first + 1 < _FEWEST:
        need = _FEWEST / (band[1] - band[0])
        raise InputError(
            f"the records last {samples / rate:.3g} s, which gives {max(0, last - first + 1)} lines from "
            f"{band[0]:g} to {band[1]:g} Hz; at least {_FEWEST} are needed, which takes {need:.3g} s."
        )
    kept = slice(first, last + 1)
    scale = np.sqrt(2 / samples)
    u, y = (fft.rfft(_centred(x[..., :samples]), axis=-1)[..., kept] * scale for x in (force, response))
    if not (np.isfinite(u).all() and np.isfinite(y).all()):
        raise InputError("the records hold values that are not finite numbers.")
    omega = 2 * np.pi * rate / samples * np.arange(first, last + 1, dtype=np.float64)
    return CellLines(omega, u, y)


def _centred(records: NDArray[np.floating]) -> NDArray[np.float64]:
    """Free of their means: a large offset would cost digits."""
    wide = np.asarray(records, dtype=np.float64)
    return np.asarray(wide - wide.mean(axis=-1, keepdims=True), dtype=np.float64)


def _fast(samples: int) -> int:
    """The longest length up to this whose transform is fast."""
    for size in range(samples, max(samples - samples // 50, 1), -1):
        if fft.next_fast_len(size, real=True) == size:
            return size
    return samples
