"""The paper's method (section 3.3, Fig. 6): truncate, window, pad, transform, average, find the first peak.

Each step is a function of its own in :mod:`~ballscrew.modal.paper.window`, :mod:`~ballscrew.modal.spectra`
and :mod:`~ballscrew.modal.paper.peak`; this module combines them for one cell, with the uncertainty that the
paper leaves out and the reasons for which a cell is refused.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import xarray as xr

from ballscrew.base.arrays import Array
from ballscrew.fcft.conditions import Condition
from ballscrew.modal.cell import CellKey, CellResult
from ballscrew.modal.paper.judge import judge
from ballscrew.modal.paper.lines import Lines, magnitude
from ballscrew.modal.paper.peak import Peak, first_peak
from ballscrew.modal.paper.phase import read_phase
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.paper.uncertainty import METHOD_ERROR, repetition_term, travelled, window_term
from ballscrew.modal.paper.window import LEAST, Extent, both_blows, extent, tapered
from ballscrew.modal.reason import Reason
from ballscrew.modal.spectra import Spectra, averaged, coherence, frf

METHOD = "paper"
_CENTRE = 150.0  # Hz, for the length of the window alone, if the mode is not known
_LOWEST = 5.0  # Hz, of the table of spectra
_HIGHEST = 600.0
_USABLE = 0.4  # of the sampling rate; higher frequencies are affected by anti-alias filters
_BESIDE = 0.1  # of the band's middle: margin on both sides in which the foot of a peak is examined
_STRONG = 0.8  # coherence of related input and response


def highest_line(band: tuple[float, float] | None) -> float:
    """Highest frequency of the spectra of a cell, Hz, given the searched band."""
    return max(_HIGHEST, 1.5 * band[1] if band else 0.0)


def identify(
    cell: xr.Dataset,
    key: CellKey,
    expected: float | None,
    slope: float,
    settings: PaperSettings,
    *,
    spectra_alone: bool = False,
) -> tuple[CellResult, Spectra | None]:
    """Estimate the axial natural frequency of one cell from its averaged FRF.

    Parameters
    ----------
    cell : Dataset
        The cell's complete rows of the table *Transients*.
    key : CellKey
        Position, condition and motion of the cell.
    expected : float or None
        Frequency that the data sheet predicts, Hz; None without a data sheet.
    slope : float
        Predicted change of the frequency with the position, Hz/m; 0 without a data sheet.
    settings : PaperSettings
        All settings.
    spectra_alone : bool
        Whether only the spectra are computed, and no frequency is estimated.

    Returns
    -------
    CellResult
        Frequency with its uncertainty, or the reasons for its refusal.
    Spectra or None
        Averaged, over the whole usable range; None if no transient contains the window.
    """
    rate, condition = float(cell.attrs["sample_rate"]), Condition(key.condition)
    band, centre = _band(expected, settings)
    window = extent(cell, condition, 1 / centre, before=settings.window_before, after=settings.window_after)
    force, response = tapered(cell, condition, window)
    if len(force) == 0:
        text = "no transient contains the whole window: another phase or the record's end comes too soon"
        return _refused(key, 0, band, Reason("measurement", text)), None
    top = min(_USABLE * rate, highest_line(band))
    spectra = averaged(force, response, rate, (_LOWEST, top), settings.line_spacing)
    if spectra_alone:
        reason = Reason("measurement", "no frequency was estimated from the FRF")
        return _refused(key, spectra.count, band, reason), spectra
    if band is None:
        return _refused(key, spectra.count, None, *_without_band(spectra)), spectra
    obstacle = _obstacle(band, window, rate, centre)
    if obstacle is not None:
        return _refused(key, spectra.count, band, Reason("measurement", obstacle)), spectra
    lines = Lines.of(force, response, rate, _grid(band, settings.line_spacing, rate))
    peak = first_peak(lines.grid, magnitude(lines, settings), band)
    if peak is None:
        reason = Reason("no-mode", f"the FRF has no peak from {band[0]:.0f} to {band[1]:.0f} Hz")
        return _refused(key, spectra.count, band, reason), spectra
    terms = {
        "repetitions": repetition_term(lines, peak, settings),
        "window": window_term(cell, condition, centre, lines.grid, peak, settings),
        "moving table": abs(slope) * travelled(cell, condition, window),
        "method": METHOD_ERROR * peak.frequency,
    }
    uncertainty = root_sum_square(terms)
    peak_coherence = lines.coherence_at(peak.frequency)
    phase = read_phase(lines, spectra, peak.frequency, motor=_of_motor(cell))
    amplification = _amplification(peak, spectra)
    verdict, reasons = judge(peak, uncertainty, peak_coherence, amplification, phase, lines, settings)
    if verdict == "good" and both_blows(cell, rate / centre):
        reason = Reason("measurement", "the phase is too short to separate the blows at its two ends")
        verdict, reasons = "suspect", (reason,)
    result = CellResult(
        *key,
        len(force),
        frequency_Hz=peak.frequency,
        standard_uncertainty_Hz=uncertainty,
        damping_ratio=None,  # under a window this short the width of the peak is that of the window
        method=METHOD,
        verdict=verdict,
        reasons=(),
        coherence=peak_coherence if len(force) > 1 else None,
        band_Hz=band,
        uncertainty_terms_Hz=terms,
    )
    if verdict == "refused":
        return without_frequency(result, *reasons), spectra
    return result.with_reasons(*reasons), spectra


def _refused(
    key: CellKey, repetitions: int, band: tuple[float, float] | None, *reasons: Reason
) -> CellResult:
    """A cell without a peak."""
    return replace(CellResult.refused(key, repetitions, METHOD, reasons), band_Hz=band)


def without_frequency(cell: CellResult, *reasons: Reason) -> CellResult:
    """The cell refused for these reasons, although it has a peak."""
    refused = CellResult.refused(cell.key, cell.repetitions, METHOD, reasons)
    return replace(refused, coherence=cell.coherence, band_Hz=cell.band_Hz)


def root_sum_square(terms: Mapping[str, float]) -> float:
    """Standard uncertainty by independent terms, Hz."""
    return math.hypot(*terms.values())


def _band(expected: float | None, settings: PaperSettings) -> tuple[tuple[float, float] | None, float]:
    """The band to search, and the frequency that sets the length of the window, Hz."""
    if settings.band is not None:
        return settings.band, float(np.sqrt(settings.band[0] * settings.band[1]))
    if not expected:
        return None, _CENTRE
    half = settings.band_half_width
    return (expected * (1 - half), expected * (1 + half)), expected


def _obstacle(band: tuple[float, float], window: Extent, rate: float, centre: float) -> str | None:
    """Why the window or the sampling rate does not suffice; None if they do."""
    if window.after < LEAST * rate / centre - 0.5:  # a window of the least length ends on a sample
        cut = window.after / rate * 1e3
        return f"the ringing is cut off: another phase or the record's end comes {cut:.0f} ms later"
    if band[1] > _USABLE * rate:
        wanted = f"the band up to {band[1]:.0f} Hz, which takes {band[1] / _USABLE:.0f} Hz"
        return f"the rate of {rate:g} Hz is too low for {wanted}"
    return None


def _of_motor(cell: xr.Dataset) -> bool:
    """True if the responses are the motor's own acceleration; nut and motor are never mixed."""
    return all(":motor" in str(name) for name in cell["response"].values)


def _grid(band: tuple[float, float], step: float, rate: float) -> Array:
    """Lines of the band and a little beyond it."""
    margin = _BESIDE * (band[0] + band[1]) / 2
    low, high = max(step, band[0] - margin), min(0.5 * rate, band[1] + margin)
    return np.arange(low, high + step, step)


def _amplification(peak: Peak, spectra: Spectra) -> float:
    """Height of a peak over the FRF at 0.1 to 0.3 of its frequency, where the axis moves as one mass."""
    low = (spectra.frequency >= 0.1 * peak.frequency) & (spectra.frequency <= 0.3 * peak.frequency)
    if not low.any():
        return float("nan")
    level = float(np.median(np.sqrt((np.abs(frf(spectra)[:, low]) ** 2).mean(axis=0))))
    return peak.height / level if level > 0 else float("nan")


def _without_band(spectra: Spectra) -> tuple[Reason, ...]:
    """Reasons if there is no band to search, with the frequency up to which the coherence is high."""
    reason = Reason("measurement", "neither a data sheet (--axis) nor --band gives a search band")
    mean = coherence(spectra).mean(axis=0)
    low = np.flatnonzero(np.convolve(mean, np.ones(9) / 9, mode="same")[4:-4] < _STRONG)
    if spectra.count < 2 or len(low) == 0:
        return (reason,)
    first = spectra.frequency[low[0] + 4]
    return reason, Reason("measurement", f"the coherence is below {_STRONG:g} from {first:.0f} Hz on")
