"""The phase of an FRF at its peak: what a null of the input cannot imitate.

Through a mode the phase of the response falls by nearly 180°, and half-way, on the pole, it stands at right
angles to what it is far below (−90° at the nut, +90° at the motor, whose zero comes first). A peak that only
stands beside a null of the torque, or beside a cut in the ringing, has a phase of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballscrew.modal.paper.lines import Lines
from ballscrew.modal.spectra import Spectra, frf

_ASIDE = 0.1  # of the frequency: how far to both sides the fall is read


@dataclass(frozen=True, slots=True)
class Phase:
    """Phase of a peak.

    Parameters
    ----------
    at_peak : float
        Against the FRF far below the peak, degrees, −180 to 180, −90 on a mode: a sensor's polarity does not
        matter.
    fall : float
        From 10 % below the peak to 10 % above it, degrees, 0 to 360.
    """

    at_peak: float
    fall: float


def read_phase(lines: Lines, spectra: Spectra, frequency: float, *, motor: bool) -> Phase:
    """Read the phase of the H1 estimate at a peak.

    Parameters
    ----------
    lines : Lines
        Of the cell, a little beyond the band.
    spectra : Spectra
        Of the cell, down to a tenth of the peak's frequency.
    frequency : float
        Of the peak, Hz.
    motor : bool
        Whether the responses are the motor's own, whose phase is turned round by the zero below the pole.

    Returns
    -------
    Phase
        NaN where the FRF does not reach far enough.
    """
    low = (spectra.frequency >= 0.1 * frequency) & (spectra.frequency <= 0.3 * frequency)
    if not low.any():
        return Phase(np.nan, np.nan)
    below = frf(spectra)[:, low].mean(axis=1)
    response = frf(lines.averages())

    def at(wanted: float) -> np.ndarray:
        return np.asarray(response[:, int(np.argmin(np.abs(lines.grid - wanted)))])

    lower, upper = at((1 - _ASIDE) * frequency), at((1 + _ASIDE) * frequency)
    turned = -1.0 if motor else 1.0
    at_peak = float(np.degrees(np.angle(turned * (at(frequency) * below.conj()).sum())))
    return Phase(at_peak, float(-np.degrees(np.angle((upper * lower.conj()).sum()))) % 360)
