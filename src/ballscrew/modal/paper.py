"""The paper's method (section 3.3, Fig. 6): truncate, window, pad, transform, average, pick the first peak.

Each step is a function of its own in :mod:`~ballscrew.modal.window`, :mod:`~ballscrew.modal.spectra` and
:mod:`~ballscrew.modal.peak`; here they are put together for one cell, with the uncertainty that the paper
leaves out and the reasons for which a cell is refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ballscrew.fcft.conditions import Condition
from ballscrew.modal.judge import Judgement, judge
from ballscrew.modal.lines import Lines, magnitude
from ballscrew.modal.peak import Peak, first_peak
from ballscrew.modal.phase import read_phase
from ballscrew.modal.settings import PaperSettings
from ballscrew.modal.spectra import Spectra, averaged, coherence, frf
from ballscrew.modal.uncertainty import method_term, repetition_term, travelled, window_term
from ballscrew.modal.window import LEAST, both_blows, extent, tapered

__all__ = ["METHOD", "CellMode", "highest_line", "identify"]

METHOD = "paper"
_CENTRE = 150.0  # Hz, for the window's length alone, where nobody knows the mode
_LOWEST = 5.0  # Hz, of the table of spectra
_HIGHEST = 600.0
_USABLE = 0.4  # of the sampling rate, above which anti-alias filters bite
_BESIDE = 0.1  # of the band's middle: how far beyond the band a peak's foot is looked at
_STRONG = 0.8  # coherence of input and response that belong together


@dataclass(frozen=True, slots=True)
class CellMode:
    """What the method says of one cell.

    Parameters
    ----------
    frequency, uncertainty : float or None
        Hz; None where refused.
    verdict : str
        ``"good"``, ``"suspect"`` or ``"refused"``.
    reasons : tuple of str
        In words; at least one where the verdict is not good.
    repetitions : int
        Transients averaged.
    coherence : float or None
        At the peak, mean over the responses; None where there is no peak, or one repetition only, whose
        coherence is 1 whatever it holds.
    band : tuple of float or None
        Where it looked, Hz.
    spectra : Spectra or None
        Averaged, over the whole usable range.
    terms : tuple of (str, float)
        Parts of the uncertainty, Hz.
    """

    frequency: float | None
    uncertainty: float | None
    verdict: str
    reasons: tuple[str, ...]
    repetitions: int
    coherence: float | None
    band: tuple[float, float] | None
    spectra: Spectra | None
    terms: tuple[tuple[str, float], ...] = ()

    @property
    def random(self) -> float:
        """Part of the uncertainty that differs from cell to cell: repetitions and window, Hz."""
        terms = dict(self.terms)
        return math.hypot(terms.get("repetitions", 0.0), terms.get("window", 0.0))

    def refuse(self, reason: str) -> CellMode:
        """The same without its frequency, for a reason that the cell alone could not know."""
        return replace(self, frequency=None, uncertainty=None, verdict="refused", reasons=(reason,), terms=())

    def plus(self, name: str, value: float) -> CellMode:
        """The same with one more part of the uncertainty; what is refused stays as it is."""
        if self.uncertainty is None:
            return self
        return replace(
            self, uncertainty=math.hypot(self.uncertainty, value), terms=(*self.terms, (name, value))
        )


def highest_line(band: tuple[float, float] | None) -> float:
    """Up to where the spectra of a cell are told, Hz, given where its mode is sought."""
    return max(_HIGHEST, 1.5 * band[1] if band else 0.0)


def identify(
    cell: xr.Dataset,
    condition: Condition,
    expected: float | None,
    slope: float,
    settings: PaperSettings,
    *,
    spectra_alone: bool = False,
) -> CellMode:
    """Read the axial natural frequency of one cell off its averaged FRF.

    Parameters
    ----------
    cell : Dataset
        The cell's complete rows of the table *Transients*.
    condition : Condition
        Of the cell.
    expected : float or None
        Frequency that the data sheet predicts, Hz; None without a data sheet.
    slope : float
        Predicted change of the frequency with the position, Hz/m; 0 without a data sheet.
    settings : PaperSettings
        All settings.
    spectra_alone : bool
        Whether nothing is to be read off the FRF.

    Returns
    -------
    CellMode
        Frequency with its uncertainty, or the reasons against one.
    """
    rate = float(cell.attrs["sample_rate"])
    band = settings.band or (_around(expected, settings.band_half_width) if expected else None)
    centre = float(np.sqrt(band[0] * band[1])) if settings.band and band else (expected or _CENTRE)
    window = extent(cell, condition, 1 / centre, before=settings.window_before, after=settings.window_after)
    force, response = tapered(cell, condition, window)
    count = len(force)
    if count == 0:
        return _refused(
            "no transient holds the whole window: another phase or the record's end comes too soon", band
        )
    top = min(_USABLE * rate, highest_line(band))
    spectra = averaged(force, response, rate, (_LOWEST, top), settings.line_spacing)
    if spectra_alone:
        return _refused("nothing was read off the FRF", band, spectra)
    if band is None:
        return _refused(
            "neither a data sheet (--axis) nor --band says where to look", band, spectra, *_blind(spectra)
        )
    if window.after < LEAST * rate / centre:
        cut = window.after / rate * 1e3
        return _refused(
            f"the ringing is cut off: another phase or the record's end comes {cut:.0f} ms later",
            band,
            spectra,
        )
    if band[1] > _USABLE * rate:
        wanted = f"the band up to {band[1]:.0f} Hz, which takes {band[1] / _USABLE:.0f} Hz"
        return _refused(f"the rate of {rate:g} Hz is too low for {wanted}", band, spectra)
    lines = Lines.of(force, response, rate, _grid(band, settings.line_spacing, rate))
    peak = first_peak(lines.grid, magnitude(lines, settings), band)
    if peak is None:
        return _refused(f"the FRF has no peak from {band[0]:.0f} to {band[1]:.0f} Hz", band, spectra)
    terms = (
        ("repetitions", repetition_term(lines, peak, settings)),
        ("window", window_term(cell, condition, centre, lines.grid, peak, settings)),
        ("moving table", abs(slope) * travelled(cell, condition, window)),
        ("method", method_term(peak)),
    )
    uncertainty = float(np.sqrt(sum(value**2 for _, value in terms)))
    reading = lines.coherence_at(peak.frequency)
    phase = read_phase(lines, spectra, peak.frequency, motor=_of_motor(cell))
    judgement = judge(peak, uncertainty, reading, _amplification(peak, spectra), phase, lines, settings)
    if judgement.verdict == "good" and both_blows(cell, rate / centre):
        judgement = Judgement("suspect", ("the phase is too short to part its two blows",))
    refused = judgement.verdict == "refused"
    return CellMode(
        frequency=None if refused else peak.frequency,
        uncertainty=None if refused else uncertainty,
        verdict=judgement.verdict,
        reasons=judgement.reasons,
        repetitions=count,
        coherence=reading if count > 1 else None,
        band=band,
        spectra=spectra,
        terms=() if refused else terms,
    )


def _of_motor(cell: xr.Dataset) -> bool:
    """Whether the responses are the motor's own acceleration; nut and motor are never taken together."""
    return all(":motor" in str(name) for name in cell["response"].values)


def _grid(band: tuple[float, float], step: float, rate: float) -> NDArray[np.float64]:
    """Lines of the band and a little beyond it."""
    margin = _BESIDE * (band[0] + band[1]) / 2
    low, high = max(step, band[0] - margin), min(0.5 * rate, band[1] + margin)
    return np.arange(low, high + step, step)


def _amplification(peak: Peak, spectra: Spectra) -> float:
    """Height of a peak over the FRF at 0.1 to 0.3 of its frequency, where the axis is one mass."""
    low = (spectra.frequency >= 0.1 * peak.frequency) & (spectra.frequency <= 0.3 * peak.frequency)
    level = np.sqrt((np.abs(frf(spectra)[:, low]) ** 2).mean(axis=0))
    return float(peak.height / np.median(level)) if low.any() and np.median(level) > 0 else float("nan")


def _around(expected: float, half: float) -> tuple[float, float]:
    return (expected * (1 - half), expected * (1 + half))


def _refused(
    reason: str, band: tuple[float, float] | None, spectra: Spectra | None = None, *more: str
) -> CellMode:
    count = spectra.count if spectra else 0
    return CellMode(None, None, "refused", (reason, *more), count, None, band, spectra)


def _blind(spectra: Spectra) -> tuple[str, ...]:
    """What a record without a band shows: up to where input and response belong together."""
    curve = coherence(spectra).mean(axis=0)
    low = np.flatnonzero(np.convolve(curve, np.ones(9) / 9, mode="same")[4:-4] < _STRONG)
    if spectra.count < 2 or len(low) == 0:
        return ()
    return (f"the coherence is below {_STRONG:g} from {spectra.frequency[low[0] + 4]:.0f} Hz on",)
