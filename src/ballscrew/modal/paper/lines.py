"""Spectra of a cell's single records inside the band, so that repetitions can be left out one by one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.spectra import Spectra, coherence, frf

_PEAK = 0.03  # of the frequency


@dataclass(frozen=True, slots=True)
class Lines:
    """Spectra of single records on the lines of a band.

    Parameters
    ----------
    grid : ndarray, shape (n,)
        Evenly spaced, Hz.
    input : ndarray of complex, shape (repetitions, n)
        Input × s.
    response : ndarray of complex, shape (responses, repetitions, n)
        m/s.
    """

    grid: NDArray[np.float64]
    input: NDArray[np.complex128]
    response: NDArray[np.complex128]

    @classmethod
    def of(
        cls, force: NDArray[np.float64], response: NDArray[np.float64], rate: float, grid: NDArray[np.float64]
    ) -> Lines:
        """Transform windowed records, by the chirp z-transform, on the lines of the band alone."""
        from scipy.signal import ZoomFFT

        span = [float(grid[0]), float(grid[-1])]
        zoom = ZoomFFT(force.shape[-1], span, len(grid), fs=rate, endpoint=True)
        u, y = (np.asarray(zoom(records) / rate, dtype=np.complex128) for records in (force, response))
        return cls(grid, u, y)

    def without(self, repetition: int) -> Lines:
        """The same with one repetition left out."""
        remaining = np.arange(len(self.input)) != repetition
        return Lines(self.grid, self.input[remaining], self.response[:, remaining])

    def averages(self) -> Spectra:
        """Auto- and cross-spectra, averaged over repetitions."""
        return Spectra(
            self.grid,
            (np.abs(self.input) ** 2).mean(axis=0),
            (np.abs(self.response) ** 2).mean(axis=1),
            (self.input.conj() * self.response).mean(axis=1),
            len(self.input),
        )

    def coherence_at(self, frequency: float) -> float:
        """Mean of the coherence over the responses and the lines of a peak, its frequency ± 3 %.

        A drive sees a free mode as an absorber, so the torque's spectrum has a notch on the very line of the
        mode.
        """
        near = np.abs(self.grid - frequency) <= _PEAK * frequency
        return float(np.nan_to_num(coherence(self.averages())[:, near]).mean())

    def excitation_at(self, frequency: float) -> float:
        """Input power at the line nearest to a frequency, as a part of the band's median."""
        power = (np.abs(self.input) ** 2).mean(axis=0)
        usual = float(np.median(power))
        return float(power[int(np.argmin(np.abs(self.grid - frequency)))]) / usual if usual > 0 else 0.0


def magnitude(lines: Lines, settings: PaperSettings) -> NDArray[np.float64]:
    """Magnitude of the FRF, root mean square over the responses: a sensor's polarity does not matter.

    Parameters
    ----------
    lines : Lines
        Of one cell.
    settings : PaperSettings
        ``average="spectra"`` averages auto- and cross-spectra. ``"ratios"`` is the paper's other reading of
        "the FRFs are averaged", the mean of each record's own ratio; it blows up in the nulls of the input.

    Returns
    -------
    ndarray, shape (n,)
        m/s² per unit of the input; not finite where the input has no power.
    """
    if settings.average == "ratios":
        with np.errstate(divide="ignore", invalid="ignore"):
            response = (lines.response / lines.input).mean(axis=1)
    else:
        response = frf(lines.averages(), settings.estimator)
    return np.asarray(np.sqrt((np.abs(response) ** 2).mean(axis=0)), dtype=np.float64)
