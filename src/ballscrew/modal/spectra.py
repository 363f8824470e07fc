"""Averaged auto- and cross-spectra of windowed records, and the FRF estimators made of them.

Source: J. S. Bendat and A. G. Piersol, *Random Data*, 4th ed., ch. 6 and 7, DOI 10.1002/9781118032428.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft


@dataclass(frozen=True, slots=True)
class Spectra:
    """Spectra averaged over repetitions.

    Parameters
    ----------
    frequency : ndarray, shape (n,)
        Hz.
    uu : ndarray, shape (n,)
        Auto-spectrum of the input.
    yy : ndarray, shape (responses, n)
        Auto-spectra of the responses.
    uy : ndarray of complex, shape (responses, n)
        Cross-spectra, conj(input) × response: the FRF has the phase of response against input.
    count : int
        Records averaged.
    """

    frequency: NDArray[np.float64]
    uu: NDArray[np.float64]
    yy: NDArray[np.float64]
    uy: NDArray[np.complex128]
    count: int

    def on(self, frequency: NDArray[np.float64]) -> Spectra:
        """Spectra at the lines nearest to other frequencies (Hz)."""
        upper = np.clip(np.searchsorted(self.frequency, frequency), 1, len(self.frequency) - 1)
        lower = self.frequency[upper - 1]
        at = upper - (frequency - lower < self.frequency[upper] - frequency)
        return Spectra(frequency, self.uu[at], self.yy[:, at], self.uy[:, at], self.count)


def averaged(
    force: NDArray[np.float64],
    response: NDArray[np.float64],
    rate: float,
    band: tuple[float, float],
    step: float,
) -> Spectra:
    """Average the spectra of records, then refine the average to a fine grid.

    A spectrum averaged on a grid of twice the record's length is the transform of the averaged correlations,
    whole and not wrapped; padding these with zeros gives every finer grid. So the padding is done once, not
    once a record.

    Parameters
    ----------
    force : ndarray, shape (repetitions, samples)
        Input, windowed.
    response : ndarray, shape (responses, repetitions, samples)
        Responses, windowed alike.
    rate : float
        Samples per second, Hz.
    band : tuple of float
        Lowest and highest frequency wanted, Hz.
    step : float
        Spacing wanted, Hz; the grid is never coarser.

    Returns
    -------
    Spectra
        Averages over repetitions, in units of signal² s²: input², response² and input × response.
    """
    size = force.shape[-1]
    coarse = fft.next_fast_len(2 * size, real=True)
    u = fft.rfft(force, coarse)
    y = fft.rfft(response, coarse)
    # einsum sums the products over repetitions without storing them
    count = force.shape[0]
    uu = np.einsum("kf,kf->f", u.conj(), u).real / count
    yy = np.einsum("rkf,rkf->rf", y.conj(), y).real / count
    uy = np.einsum("kf,rkf->rf", u.conj(), y) / count
    # A whole multiple of one base, so that cells of different windows share their lines.
    base = fft.next_fast_len(int(np.ceil(rate / step)), real=True)
    fine = base * -(-coarse // base)
    frequency = fft.rfftfreq(fine, 1 / rate)
    inside = (frequency >= band[0]) & (frequency <= band[1])

    def refine(spectrum: NDArray[np.complex128] | NDArray[np.float64]) -> NDArray[np.complex128]:
        lags = fft.irfft(spectrum, coarse)
        half = coarse // 2
        padded = np.zeros((*lags.shape[:-1], fine))
        padded[..., :half], padded[..., -half:] = lags[..., :half], lags[..., -half:]
        return np.asarray(fft.rfft(padded)[..., inside] / rate**2, dtype=np.complex128)

    return Spectra(frequency[inside], refine(uu).real, refine(yy).real, refine(uy), count)


def frf(spectra: Spectra, estimator: str = "H1") -> NDArray[np.complex128]:
    """Frequency response, response per input.

    Parameters
    ----------
    spectra : Spectra
        Averaged.
    estimator : {"H1", "H2", "Hv"}
        H1 = S_uy/S_uu (noise on the response), H2 = S_yy/S_yu (noise on the input), Hv their geometric mean.

    Returns
    -------
    ndarray of complex, shape (responses, n)
        NaN where the input has no power at all.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        h1 = spectra.uy / spectra.uu
        if estimator == "H1":
            return np.asarray(h1, dtype=np.complex128)
        h2 = spectra.yy / spectra.uy.conj()
        if estimator == "H2":
            return np.asarray(h2, dtype=np.complex128)
        return np.asarray(np.sqrt(np.abs(h1) * np.abs(h2)) * np.exp(1j * np.angle(h1)), dtype=np.complex128)


def coherence(spectra: Spectra) -> NDArray[np.float64]:
    """Ordinary coherence, 0 to 1, shape (responses, n).

    Of a single record it is 1 whatever the record: see :attr:`Spectra.count`.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.abs(spectra.uy) ** 2 / (spectra.uu * spectra.yy), dtype=np.float64)
