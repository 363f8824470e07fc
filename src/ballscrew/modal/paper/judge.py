"""Verdict on a peak as an axial natural frequency: good, suspect or refused, with the reasons in words."""

from __future__ import annotations

from ballscrew.modal.paper.lines import Lines
from ballscrew.modal.paper.peak import Peak
from ballscrew.modal.paper.phase import Phase
from ballscrew.modal.paper.settings import PaperSettings
from ballscrew.modal.reason import Reason, large_uncertainty

_CHANCE = 0.01  # of unrelated records that reach the least coherence
_ASKEW = 35.0  # degrees; what damping, delay and window leave of a right angle on known modes is 26 at most
_LEAST_FALL = 60.0  # degrees; a mode with 7 % damping falls by 103
CERTAIN = 0.015  # of the frequency: a larger uncertainty makes a cell suspect


def least_coherence(count: int, settings: PaperSettings) -> float:
    """Coherence below which input and response may be unrelated.

    Of ``count`` unrelated records the coherence exceeds g with the chance (1 − g)^(count − 1) (Bendat and
    Piersol, *Random Data*, DOI 10.1002/9781118032428, section 9.2.3).

    Parameters
    ----------
    count : int
        Records averaged.
    settings : PaperSettings
        Contains the configured lower limit.

    Returns
    -------
    float
        0 for a single record, whose coherence says nothing.
    """
    if count < 2:
        return 0.0
    return float(max(settings.least_coherence, 1 - _CHANCE ** (1 / (count - 1))))


def judge(
    peak: Peak,
    uncertainty: float,
    reading: float,
    amplification: float,
    phase: Phase,
    lines: Lines,
    settings: PaperSettings,
) -> tuple[str, tuple[Reason, ...]]:
    """Assess whether a peak is an axial natural frequency.

    Parameters
    ----------
    peak : Peak
        Found in the band.
    uncertainty : float
        Its standard uncertainty, Hz.
    reading : float
        Coherence at the peak.
    amplification : float
        Height of the peak over the FRF far below it; NaN where the FRF does not reach that low.
    phase : Phase
        Of the FRF at the peak and across it.
    lines : Lines
        Of the cell.
    settings : PaperSettings
        Contain the limits.

    Returns
    -------
    verdict : str
        ``"good"``, ``"suspect"``, or ``"refused"`` if any criterion of a natural frequency is violated.
    reasons : tuple of Reason
        None if it is good.
    """
    count = len(lines.input)
    needed = least_coherence(count, settings)
    power = lines.excitation_at(peak.frequency)
    refusals = []
    if reading < needed:
        refusals.append(
            f"the coherence at the peak ({peak.frequency:.1f} Hz) is {reading:.3f}; with {count} repetitions "
            f"it must be {needed:.3f} or more"
        )
    if not amplification >= settings.least_amplification:
        refusals.append(
            f"the peak at {peak.frequency:.1f} Hz is {amplification:.1f} times as high as the FRF of one "
            f"mass; a mode is {settings.least_amplification:g} times or more"
        )
    if not abs(phase.at_peak + 90) <= _ASKEW:
        refusals.append(
            f"the phase at {peak.frequency:.1f} Hz is {phase.at_peak:.0f}° against that of the axis as one "
            "mass; on a mode it is −90°"
        )
    elif not _LEAST_FALL <= phase.fall <= 360 - _LEAST_FALL:
        refusals.append(
            f"the phase does not fall through the peak at {peak.frequency:.1f} Hz, as a mode's does"
        )
    if power < settings.least_excitation:
        refusals.append(
            f"the torque hardly excites {peak.frequency:.1f} Hz: {power:.1%} of the band's median power"
        )
    if uncertainty > settings.most_uncertainty * peak.frequency:
        refusals.append(f"repetitions and windows disagree about the peak by ± {uncertainty:.1f} Hz")
    if peak.at_edge:
        refusals.append(
            f"the FRF is higher at the edge of the band than at its peak of {peak.frequency:.1f} Hz"
        )
    if refusals:
        return "refused", tuple(Reason("no-mode", text) for text in refusals)
    doubts = []
    if count < 2:
        once = "one repetition: neither coherence nor scatter can be assessed"
        doubts.append(Reason("few-repetitions", once))
    if uncertainty > CERTAIN * peak.frequency:
        doubts.append(large_uncertainty(uncertainty, CERTAIN))
    return "suspect" if doubts else "good", tuple(doubts)
