"""Accelerometers against the encoder, and against each other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.phases import Phase
from ballscrew.recording.quality.delay import InStep
from ballscrew.recording.quality.finding import Finding
from ballscrew.recording.quality.pitching import is_pitching

__all__ = ["check_agreement", "check_gains", "gain_ratio"]


# A calibrated accelerometer is right to 2 or 3 %; 6 % is also what a rate wrong by 3 % looks like.
_GAIN = 0.06
_FOLLOWS = 0.97  # share of an acceleration that the encoder's explains; 1.0000 in good records
_FOLLOWS_BAD = 0.5
_CROSSWISE = 1 / 3  # of the expected gain; what tilting and cross-talk show of the screw's direction is less
_STANDARD_GRAVITY = 9.80665

_BANDS = (5.0, 20.0, 40.0, 60.0, 80.0, 100.0, 125.0, 160.0, 200.0)  # Hz; the first is the reference
_APART = 0.2  # two sensors on one nut agree within 1 %; a pitching nut parts them by more, near its mode
_COHERENT = 0.9  # below, noise decides the ratio
_WINDOW = 0.16  # s from just before a phase


def gain_ratio(step: InStep) -> float | None:
    """Median gain of the accelerometers over the encoder, without sign; None without accelerometers."""
    gains = [abs(fit.gain) for fit in step.responses if fit is not None and fit.explained > _FOLLOWS_BAD]
    return float(np.median(gains)) if gains else None


def check_gains(file: str, aligned: Aligned, step: InStep, *, rate_known: bool) -> list[Finding]:
    """Polarity and scale of each accelerometer, judged by the encoder.

    Parameters
    ----------
    file : str
        For the messages.
    aligned : Aligned
        The recording.
    step : InStep
        From :func:`ballscrew.recording.quality.delay.compare`.
    rate_known : bool
        Whether the plan's times have confirmed the sample rate: else a wrong rate looks like a wrong scale.

    Returns
    -------
    list of Finding
        Empty where all are right within 6 %.
    """
    findings = []
    fits = [fit for fit in step.responses if fit is not None]
    position = bool(fits) and step.drive is not None and step.drive.gain < 0 and all(f.gain < 0 for f in fits)
    changes = step.changes or (None,) * len(step.responses)
    for name, fit, change in zip(aligned.responses, step.responses, changes, strict=True):
        if fit is None or (change is not None and fit.explained < _FOLLOWS):  # which explains it
            continue
        if fit.explained < _FOLLOWS:
            text = (
                f"{file}: only {100 * max(fit.explained, 0):.3g} % of {name} follow the position's "
                "acceleration: it is loose, dead, of another direction or swapped"
            )
            findings.append(Finding("bad" if fit.explained < _FOLLOWS_BAD else "suspect", "unrelated", text))
            continue
        if abs(fit.gain) < _CROSSWISE and _unit(abs(fit.gain)) is None:
            text = (
                f"{file}: {name} has only {abs(fit.gain):.3g} times the position's acceleration: "
                "it is of another direction, or swapped, or its scale is wrong"
            )
            findings.append(Finding("bad", "unrelated", text))
            continue
        if fit.gain < 0 and not position:
            findings.append(Finding("suspect", "polarity", f"{file}: the polarity of {name} is inverted"))
        if abs(abs(fit.gain) - 1) > _GAIN:
            findings.append(Finding("suspect", "scale", f"{file}: {_scale(name, abs(fit.gain), rate_known)}"))
    return findings


def _scale(name: str, gain: float, rate_known: bool) -> str:
    measured = f"{name} has {gain:.3g} times the position's acceleration"
    if rate_known:
        unit = _unit(gain)
        guess = f", as if its unit were {unit}" if unit else ""
        return f"{measured}: its scale is wrong{guess}, which does not move the frequency"
    off = 100 * abs(gain**-0.5 - 1)
    return f"{measured}: its scale is wrong, or the sample rate by {off:.3g} %, and with it every frequency"


def _unit(gain: float) -> str | None:
    """The unit that an accelerometer would have, where its gain is one."""
    units = (("g", 1 / _STANDARD_GRAVITY), ("mm/s²", 1e3), ("cm/s²", 1e2))
    return next((unit for unit, factor in units if abs(gain / factor - 1) < _GAIN), None)


def check_agreement(file: str, aligned: Aligned, phases: Sequence[Phase], step: InStep) -> list[Finding]:
    """Compare accelerometers on one nut with each other, up to above the axial mode.

    Parameters
    ----------
    file : str
        For the messages.
    aligned : Aligned
        The recording.
    phases : sequence of Phase
        Of it.
    step : InStep
        Sensors that do not even follow the encoder are left out.

    Returns
    -------
    list of Finding
        One for each that differs from the first by more than 20 % in a band, relative to low frequencies,
        unless a pitching table explains it.
    """
    usable = [
        index
        for index, fit in enumerate(step.responses)
        if fit is not None and fit.explained >= _FOLLOWS and abs(fit.gain) > 0
    ]
    if len(usable) < 2:
        return []
    spectra = _spectra(aligned, phases)
    if spectra is None:
        return []
    frequency, lines = spectra
    findings = []
    for index in usable[1:]:
        worst = _worst(frequency, lines[usable[0]], lines[index])
        if worst is not None and not is_pitching(frequency, lines[usable[0]], lines[index]):
            low, high, ratio = worst
            findings.append(
                Finding(
                    "suspect",
                    "sensors-disagree",
                    f"{file}: {aligned.responses[index]} has {ratio:.3g} times the motion of "
                    f"{aligned.responses[usable[0]]} from {low:.0f} to {high:.0f} Hz, though they agree "
                    "below 20 Hz: one of them is loose or was remounted",
                )
            )
    return findings


def _spectra(aligned: Aligned, phases: Sequence[Phase]) -> tuple[Array, NDArray[np.complex128]] | None:
    size = round(_WINDOW * aligned.rate)
    starts = [max(0, phase.start - size // 8) for phase in phases if phase.complete]
    starts = [start for start in starts if start + size <= aligned.response.shape[1]]
    if len(starts) < 3 or size < 32:
        return None
    pieces = np.stack([aligned.response[:, start : start + size] for start in starts], axis=1)
    pieces = (pieces - pieces.mean(axis=-1, keepdims=True)) * np.hanning(size)
    frequency = np.asarray(np.fft.rfftfreq(size, 1 / aligned.rate), dtype=np.float64)
    return frequency, np.fft.rfft(pieces, axis=-1)


def _worst(
    frequency: Array, one: NDArray[np.complex128], other: NDArray[np.complex128]
) -> tuple[float, float, float] | None:
    """The band in which two sensors differ most, and their ratio there; None where they agree."""
    ratios = []
    for low, high in pairwise(_BANDS):
        if high > 0.4 * 2 * frequency[-1]:
            break
        inside = (frequency >= low) & (frequency < high)
        own, its = one[:, inside], other[:, inside]
        powers = float(np.sum(np.abs(own) ** 2)), float(np.sum(np.abs(its) ** 2))
        cross = abs(complex(np.sum(own.conj() * its)))
        if min(powers) > 0 and cross**2 > _COHERENT * powers[0] * powers[1]:
            ratios.append((low, high, (powers[1] / powers[0]) ** 0.5))
    if not ratios or ratios[0][0] != _BANDS[0]:
        return None
    relative = [(low, high, ratio / ratios[0][2]) for low, high, ratio in ratios]
    worst = max(relative, key=lambda band: abs(np.log(band[2])))
    return worst if abs(np.log(worst[2])) > np.log1p(_APART) else None
