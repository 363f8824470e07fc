"""Accelerometers against the encoder, and against each other.

Two accelerometers on one nut differ if a mount gave way, or if the table pitches. Each measures
a = (1 + p X) a₀, where X = ω² / (ω₀² − ω² + jβω) is the response of a mode of its carrier and p its share of
it. A pitching table gives its two ends shares of some hundredths to some tenths; a loose sensor *is* the
mass of its mode, p = 1. So for two of them

    A₂ (1 + jbω − cω²) = A₁ (g + jdω − geω²),  c = (1 − p₁) / ω₀²,  e = (1 − p₂) / ω₀²,

which is linear in its five unknowns. c over e is near one for a pitching table, and zero or infinite for a
loose sensor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.phases import MotionPhase
from ballscrew.recording.quality.delay import Synchronisation
from ballscrew.recording.quality.finding import Finding, severity
from ballscrew.recording.quality.lowband import LagFit, fit_lag, low_band

Spectra = NDArray[np.complex128]

# A calibrated accelerometer is right to 2 or 3 %; a sample rate wrong by 3 % looks like 6 %.
_GAIN = 0.06
_FOLLOWS = 0.97  # share of an acceleration that the encoder's explains; 1.0000 in good records
_FOLLOWS_BAD = 0.5
# Cross-axis sensitivity and a mount by eye are 5° each: 5° in the bench.
_TILT = math.radians(15.0)
_WHOLE = 1.25  # ratio of the three axes' gain together to 1, beyond which a direction does not explain it
_CROSSWISE = 1 / 3  # of the expected gain; tilting and cross-talk show less of the screw's direction
_STANDARD_GRAVITY = 9.80665
_UNITS = {"g": 1 / _STANDARD_GRAVITY, "mm/s²": 1e3, "cm/s²": 1e2}

_BANDS = (5.0, 20.0, 40.0, 60.0, 80.0, 100.0, 125.0, 160.0, 200.0)  # Hz; the first is the reference
_DIFFERENCE = 0.2  # two sensors on one nut agree within 1 %; more on a pitching nut, near its mode
_COHERENT = 0.9  # below, noise determines the ratio
_WINDOW = 0.16  # s from just before a phase

_PITCHING_BAND = (10.0, 300.0)  # Hz; a pitching mode lies at up to 2.2 times the axial mode
_PITCHING_UNIT = 2 * np.pi * 100.0  # rad/s, in which all unknowns are near one
_SHARES = 2.0  # c over e, or e over c: 1.2 / 0.8 with shares of ±0.2, and 1.4 / 0.6 with ±0.4
_UNEXPLAINED = 0.2  # of the motion, at most, for pitching to be the explanation


def gain_ratio(found: Synchronisation) -> float | None:
    """Median gain of the accelerometers over the encoder, without sign; None without accelerometers."""
    gains = [abs(fit.gain) for fit in found.fits if fit.explained > _FOLLOWS_BAD]
    return float(np.median(gains)) if gains else None


def crosswise_gains(aligned: Aligned, phases: Sequence[MotionPhase]) -> dict[str, float]:
    """Gain of the accelerations across the screw over the encoder's.

    Parameters
    ----------
    aligned : Aligned
        Channels of the recording.
    phases : sequence of MotionPhase
        Phases of the recording.

    Returns
    -------
    dict of str to float
        By the name of the channel; 0 where it does not follow the encoder, empty without such channels.
    """
    if not aligned.across:
        return {}
    band = low_band(replace(aligned, response=np.stack(list(aligned.across.values()))), phases)
    if band is None:
        return {}
    gains = {}
    for name, values in zip(aligned.across, band.response, strict=True):
        fit = fit_lag(band, values, band.acceleration, [band.speed], band.part >= 0)
        follows = fit is not None and fit.explained >= _FOLLOWS_BAD
        gains[name] = fit.gain if fit is not None and follows else 0.0
    return gains


def check_gains(
    file: str,
    aligned: Aligned,
    found: Synchronisation,
    *,
    rate_known: bool,
    across: Mapping[str, float] | None = None,
) -> list[Finding]:
    """Check polarity and scale of each accelerometer against the encoder.

    Parameters
    ----------
    file : str
        Name of the file, for the messages.
    aligned : Aligned
        Channels of the recording.
    found : Synchronisation
        From :func:`ballscrew.recording.quality.delay.compare_with_encoder`.
    rate_known : bool
        Whether the plan's times have confirmed the sample rate: else a wrong rate looks like a wrong scale.
    across : mapping of str to float, optional
        From :func:`crosswise_gains`.

    Returns
    -------
    list of Finding
        Empty where all are right within 6 %, and along the screw within 15° where the other axes are known.
    """
    findings: list[Finding] = []
    inverted = _position_is_inverted(found)
    changes = found.changes or (None,) * len(found.responses)
    for name, fit, change in zip(aligned.responses, found.responses, changes, strict=True):
        if fit is None:
            continue
        turned = _check_direction(file, name, fit, across or {})
        if turned is not None:
            findings.append(turned)
            continue
        if fit.explained >= _FOLLOWS:
            findings += _check_gain(f"{file}: ", name, fit, position_inverted=inverted, rate_known=rate_known)
        elif change is None:  # else the changing delay explains it
            findings.append(_unrelated(file, name, fit))
    return findings


def _check_direction(file: str, name: str, fit: LagFit, across: Mapping[str, float]) -> Finding | None:
    """Finding on an accelerometer whose other two axes show that its x is not along the screw."""
    place = name.rpartition(":")[0]
    others = {other: gain for other, gain in across.items() if other.rpartition(":")[0] == place}
    crosswise, along = math.hypot(*others.values()), abs(fit.gain)
    total = math.hypot(crosswise, along)
    if crosswise <= math.tan(_TILT) * along or not 1 / _WHOLE < total < _WHOLE:
        return None
    main = max(others, key=lambda other: abs(others[other]))
    if along < _CROSSWISE * total:
        text = (
            f"{file}: {main} measures along the screw, with {abs(others[main]):.2g} times the position's "
            f"acceleration, and {name} {along:.2g}: the sensor is turned, or its axes are swapped"
        )
        return Finding("bad", "direction", text)
    angle = math.degrees(math.atan2(crosswise, along))
    text = f"{file}: {name} is mounted {angle:.0f}° off the screw, towards {main}"
    if fit.gain < 0:
        text += ", and its polarity is inverted"
    return Finding("suspect", "direction", text)


def _position_is_inverted(found: Synchronisation) -> bool:
    """True if torque and all accelerometers are opposite to the position."""
    if found.drive is None or not found.fits:
        return False
    return max(found.drive.gain, *(fit.gain for fit in found.fits)) < 0


def _check_gain(
    prefix: str, name: str, fit: LagFit, *, position_inverted: bool, rate_known: bool
) -> list[Finding]:
    gain = abs(fit.gain)
    if gain < _CROSSWISE and _unit(gain) is None:
        text = (
            f"{prefix}{name} has only {gain:.3g} times the position's acceleration: "
            "it is of another direction, or swapped, or its scale is wrong"
        )
        return [Finding("bad", "unrelated", text)]
    findings = []
    if fit.gain < 0 and not position_inverted:
        findings.append(Finding("suspect", "polarity", f"{prefix}the polarity of {name} is inverted"))
    if abs(gain - 1) > _GAIN:
        findings.append(Finding("suspect", "scale", prefix + _scale(name, gain, rate_known)))
    return findings


def _unrelated(file: str, name: str, fit: LagFit) -> Finding:
    text = (
        f"{file}: only {100 * max(fit.explained, 0):.3g} % of {name} follow the position's "
        "acceleration: it is loose, dead, of another direction or swapped"
    )
    return Finding(severity(bad=fit.explained < _FOLLOWS_BAD), "unrelated", text)


def _scale(name: str, gain: float, rate_known: bool) -> str:
    measured = f"{name} has {gain:.3g} times the position's acceleration: its scale is wrong"
    if not rate_known:
        off = 100 * abs(gain**-0.5 - 1)
        return f"{measured}, or the sample rate by {off:.3g} %, and with it every frequency"
    unit = _unit(gain)
    if unit is not None:
        measured += f", as if its unit were {unit}"
    return f"{measured}, which does not move the frequency"


def _unit(gain: float) -> str | None:
    """Unit of an accelerometer with this gain, None where it is no usual unit."""
    for unit, factor in _UNITS.items():
        if abs(gain / factor - 1) < _GAIN:
            return unit
    return None


def check_agreement(
    file: str, aligned: Aligned, phases: Sequence[MotionPhase], found: Synchronisation
) -> list[Finding]:
    """Compare accelerometers on one nut with each other, up to above the axial mode.

    Parameters
    ----------
    file : str
        Name of the file, for the messages.
    aligned : Aligned
        Channels of the recording.
    phases : sequence of MotionPhase
        Phases of the recording.
    found : Synchronisation
        From :func:`ballscrew.recording.quality.delay.compare_with_encoder`; sensors that do not follow the
        encoder are not compared.

    Returns
    -------
    list of Finding
        A finding for each that differs from the first by more than 20 % in a band, relative to low
        frequencies, unless a pitching table explains it.
    """
    usable = []
    for index, fit in enumerate(found.responses):
        if fit is not None and fit.explained >= _FOLLOWS and fit.gain != 0:
            usable.append(index)
    if len(usable) < 2:
        return []
    spectra = phase_spectra(aligned.response, aligned.rate, phases)
    if spectra is None:
        return []
    frequency, lines = spectra
    first = usable[0]
    findings = []
    for index in usable[1:]:
        worst = _worst_band(frequency, lines[first], lines[index])
        if worst is None or is_pitching(frequency, lines[first], lines[index]):
            continue
        low, high, ratio = worst
        text = (
            f"{file}: {aligned.responses[index]} has {ratio:.3g} times the motion of "
            f"{aligned.responses[first]} from {low:.0f} to {high:.0f} Hz, though they agree "
            "below 20 Hz: one of them is loose or was remounted"
        )
        findings.append(Finding("suspect", "sensors-disagree", text))
    return findings


def phase_spectra(values: Array, rate: float, phases: Sequence[MotionPhase]) -> tuple[Array, Spectra] | None:
    """Spectra of signals over 0.16 s from just before each complete phase.

    Parameters
    ----------
    values : ndarray, shape (n_signals, n)
        Signals.
    rate : float
        Sample rate, Hz.
    phases : sequence of MotionPhase
        Phases of the recording.

    Returns
    -------
    tuple of (n_frequencies,) and (n_signals, n_phases, n_frequencies) ndarray, or None
        Frequencies, Hz, and spectra; None where there are fewer than three phases.
    """
    size = round(_WINDOW * rate)
    pieces = []
    for phase in phases:
        start = max(0, phase.start - size // 8)
        if phase.complete and start + size <= values.shape[1]:
            pieces.append(values[:, start : start + size])
    if len(pieces) < 3 or size < 32:
        return None
    x = np.stack(pieces, axis=1)
    x = (x - x.mean(axis=-1, keepdims=True)) * np.hanning(size)
    return np.fft.rfftfreq(size, 1 / rate).astype(np.float64), np.fft.rfft(x, axis=-1)


def _worst_band(frequency: Array, first: Spectra, second: Spectra) -> tuple[float, float, float] | None:
    """Band in which two sensors differ most, and their ratio there; None where they agree."""
    ratios = []
    for low, high in pairwise(_BANDS):
        if high > 0.4 * 2 * frequency[-1]:
            break
        inside = (frequency >= low) & (frequency < high)
        a, b = first[:, inside], second[:, inside]
        power_a, power_b = float(np.sum(np.abs(a) ** 2)), float(np.sum(np.abs(b) ** 2))
        cross = abs(complex(np.sum(a.conj() * b)))
        if min(power_a, power_b) > 0 and cross**2 > _COHERENT * power_a * power_b:
            ratios.append((low, high, (power_b / power_a) ** 0.5))
    if not ratios or ratios[0][0] != _BANDS[0]:
        return None
    reference = ratios[0][2]
    low, high, ratio = max(ratios, key=lambda band: abs(np.log(band[2] / reference)))
    ratio /= reference
    return (low, high, ratio) if abs(np.log(ratio)) > np.log1p(_DIFFERENCE) else None


def is_pitching(frequency: Array, first: Spectra, second: Spectra) -> bool:
    """True if two accelerometers differ as both ends of a pitching table do.

    Parameters
    ----------
    frequency : ndarray, shape (n_frequencies,)
        Hz.
    first, second : ndarray, shape (n_pieces, n_frequencies)
        Spectra of the two, over the same pieces of the record.

    Returns
    -------
    bool
        False where the relation of one mode does not explain them, or explains them by a loose sensor.
    """
    inside = (frequency >= _PITCHING_BAND[0]) & (frequency <= _PITCHING_BAND[1])
    a, b = first[:, inside].ravel(), second[:, inside].ravel()
    x = np.broadcast_to(2 * np.pi * frequency[inside] / _PITCHING_UNIT, first[:, inside].shape).ravel()
    weight = 1 / (1 + x**2)  # else the highest frequencies dominate, where there is little motion
    columns = np.stack([1j * x * b, -(x**2) * b, -a, -1j * x * a, x**2 * a]) * weight
    wanted = -b * weight
    matrix = np.concatenate([columns.real, columns.imag], axis=1)
    target = np.concatenate([wanted.real, wanted.imag])
    size = float(np.linalg.norm(target))
    if matrix.shape[1] < 4 * len(matrix) or size == 0 or not np.isfinite(matrix).all():
        return False
    answer = np.linalg.lstsq(matrix.T, target, rcond=1e-12)[0]
    residual = float(np.linalg.norm(target - answer @ matrix)) / size
    c, g, ge = float(answer[1]), float(answer[2]), float(answer[4])
    if g == 0 or residual > _UNEXPLAINED:
        return False
    e = ge / g
    return bool(min(c, e) > 0 and max(c, e) < _SHARES * min(c, e))
