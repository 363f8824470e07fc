"""High pass of an accelerometer, by AC coupling or by the sensor itself.

A high pass makes A = a s² / (s² + c s + d) of an acceleration a. So a = A + c ∫A + d ∬A, which is linear in c
and d; below the axial mode the encoder shows a.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.phases import MotionPhase
from ballscrew.recording.quality.finding import Finding
from ballscrew.recording.quality.lowband import LowBand, low_band

# Corner frequencies, Hz. Without a high pass the fit finds up to 0.0003 Hz on the bench and on eight axes of
# the testbed. Sensors with built-in electronics have 0.05 to 0.5 Hz: undone, that changes nothing.
_LEAST_CORNER, _USUAL_CORNER = 0.02, 0.6
_REMAINING_CORNER = 0.05  # of the undone signal, so that its noise does not drift
_SECOND_ORDER = 0.2  # of c / 2π, above which √d / 2π shows a second order
_UNEXPLAINED_LOW = 1e-3  # of the encoder's acceleration below 15 Hz; 5e-6 in good records


def undo_high_pass(
    aligned: Aligned, phases: Sequence[MotionPhase], derived: Sequence[bool]
) -> tuple[Aligned, tuple[float, ...]]:
    """Accelerations as they were before a high pass of the sensor or its coupling.

    Parameters
    ----------
    aligned : Aligned
        Channels of one recording.
    phases : sequence of MotionPhase
        Phases of the same recording.
    derived : sequence of bool
        True for responses that come from the encoder.

    Returns
    -------
    aligned : Aligned
        With a corner of 0.05 Hz in the place of each that was found.
    corners : tuple of float
        Corner frequency of each response, Hz; 0 where there is none, or where the response does not follow
        the encoder.
    """
    from scipy.signal import bilinear, lfilter

    with np.errstate(all="ignore"):
        band = low_band(aligned, phases)
    corners = [0.0] * len(aligned.responses)
    if band is None or all(derived):
        return aligned, tuple(corners)
    responses = aligned.response.copy()
    for index, x in enumerate(band.response):
        c, d = (0.0, 0.0) if derived[index] else _fit_high_pass(band, x)
        corner = max(c, math.sqrt(max(d, 0.0))) / (2 * math.pi)
        if corner < _LEAST_CORNER:
            continue
        second = math.sqrt(max(d, 0.0)) > _SECOND_ORDER * c
        corners[index] = math.sqrt(d) / (2 * math.pi) if second else corner
        remaining = 2 * math.pi * _REMAINING_CORNER
        zeros = [1.0, c, d if second else 0.0]
        poles = [1.0, math.sqrt(2) * remaining, remaining**2]
        responses[index] = lfilter(*bilinear(zeros, poles, aligned.rate), responses[index])
    return replace(aligned, response=responses), tuple(corners)


def _fit_high_pass(band: LowBand, x: Array) -> tuple[float, float]:
    """Coefficients c and d of the high pass, 1/s and 1/s²; 0 where none explains the encoder."""
    x = x - x.mean()
    once = np.cumsum(x) / band.rate
    twice = np.cumsum(once - once.mean()) / band.rate
    first = band.derivative(x)
    time = np.linspace(-1.0, 1.0, len(x))
    drift = [np.ones_like(x), time, time**2, time**3]  # of the integrated noise
    rows = np.flatnonzero(band.part >= 0)[::4]
    columns = np.stack([x, once, twice, first, band.derivative(first), *drift])[:, rows]
    scale = np.abs(columns).max(axis=1, initial=0.0)
    wanted = band.acceleration[rows]
    if len(rows) < 5 * len(columns) or not scale.min() > 0:
        return 0.0, 0.0
    answer = np.linalg.lstsq((columns / scale[:, None]).T, wanted, rcond=1e-12)[0] / scale
    residual = wanted - answer @ columns
    if answer[0] == 0 or np.var(residual) > _UNEXPLAINED_LOW * np.var(wanted):
        return 0.0, 0.0
    return float(answer[1] / answer[0]), float(answer[2] / answer[0])


def check_high_pass(file: str, names: Sequence[str], corners: Sequence[float]) -> list[Finding]:
    """Findings on accelerometers that are AC coupled, or filtered.

    Parameters
    ----------
    file : str
        Name of the file, for the messages.
    names : sequence of str
        Of the responses.
    corners : sequence of float
        From :func:`undo_high_pass`, Hz.

    Returns
    -------
    list of Finding
        For each corner above those of sensors with built-in electronics.
    """
    findings = []
    for name, corner in zip(names, corners, strict=True):
        if corner >= _USUAL_CORNER:
            text = (
                f"{file}: {name} lacks what is below {corner:.2g} Hz: it is AC coupled, or a high-pass "
                "filter is set; its effect was undone, but DC coupling is better"
            )
            findings.append(Finding("suspect", "high-pass", text))
    return findings
