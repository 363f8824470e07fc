"""Whether torque and acceleration are in step, by time and by sign."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.phases import Phase
from ballscrew.recording.quality.finding import Finding
from ballscrew.recording.quality.inertia import TwoMasses, two_masses
from ballscrew.recording.quality.lowband import Fit, LowBand, fit_late, low_band
from ballscrew.recording.quality.parts import Change, change, lags

__all__ = ["InStep", "check_step", "compare", "derived_responses", "estimate_delay"]


# The torque that a drive reports is its command: the current loop and the hold of one sample lie between.
_LATE_SAMPLES = 1.25
_LATE = 0.11e-3  # s; below lie the current loop's and the sensors' own delays
# By what the delay of good records is off: with accelerometers, and by the encoder alone, whose torque is
# then bent by friction and servo.
_MODEL = 0.03e-3  # s
_MODEL_ALONE = 0.12e-3  # s
_SIGMAS = 3.0
_LATE_BAD = 3e-3  # s: half a period of the mode; torque and acceleration then belong to different instants
_FOLLOWS = 0.9  # share of the torque that inertia and friction explain; 0.999 in good records
_FOLLOWS_BAD = 0.5
_TRUE = 0.97  # of an acceleration that the encoder's explains; 1.0000 in good records


@dataclass(frozen=True, slots=True)
class InStep:
    """How torque and accelerations follow the encoder.

    Parameters
    ----------
    drive : Fit, optional
        Of the torque over the encoder's acceleration, beside friction; None where it cannot be told.
    responses : tuple of Fit, optional
        Of each acceleration over the encoder's; None for one that is derived from the encoder.
    masses : TwoMasses, optional
        The torque as rotor and table; None where there is no accelerometer.
    changes : tuple of Change, optional
        By which each acceleration's delay changes within the record; None where it stays.
    drive_change : Change, optional
        The same of the torque.
    """

    drive: Fit | None
    responses: tuple[Fit | None, ...]
    masses: TwoMasses | None = None
    changes: tuple[Change | None, ...] = ()
    drive_change: Change | None = None

    @property
    def delay(self) -> tuple[float, float]:
        """By how much the accelerations are later than the torque, and its standard uncertainty, s."""
        if self.drive is None:
            return math.nan, math.nan
        lates = [(fit.late, fit.uncertainty) if fit else (0.0, 0.0) for fit in self.responses]
        late, scatter = (float(value) for value in np.median(np.array(lates), axis=0))
        if self.masses is None:
            return late - self.drive.late, math.hypot(self.drive.uncertainty, scatter, _MODEL_ALONE)
        drive = self.masses.fit
        return late - drive.late, math.hypot(drive.uncertainty, scatter, _MODEL)


def estimate_delay(aligned: Aligned, phases: Sequence[Phase]) -> tuple[float, float]:
    """By how much the accelerations come later than the torque, beyond what mechanics explains.

    Accelerations are compared with the encoder's below 15 Hz, where only the axis' compliance lies between;
    what the mode's flank and a sensor's high pass add is fitted beside the delay. The torque is compared
    with the accelerations of rotor and table in full motion (:mod:`~ballscrew.recording.quality.inertia`)
    or, without an accelerometer, with the encoder below 15 Hz.

    Parameters
    ----------
    aligned : Aligned
        One recording.
    phases : sequence of Phase
        Of it.

    Returns
    -------
    delay, standard_uncertainty : float
        s; NaN where there is too little motion to tell.
    """
    band = low_band(aligned, phases)
    return (math.nan, math.nan) if band is None else compare(band, derived=derived_responses(aligned)).delay


def compare(band: LowBand, *, derived: Sequence[bool]) -> InStep:
    """Compare torque and accelerations with the encoder.

    Parameters
    ----------
    band : LowBand
        The signals below the mode.
    derived : sequence of bool
        Which responses are the encoder's own second derivative, and need no comparison.

    Returns
    -------
    InStep
        With None where there is nothing to compare.
    """
    around = band.part >= 0
    viscous = [band.speed]
    drive = fit_late(band, band.drive, band.acceleration, [*viscous, *band.friction], around & band.moving)
    responses = tuple(
        None if own else fit_late(band, x, band.acceleration, viscous, around)
        for x, own in zip(band.response, derived, strict=True)
    )
    true = [(i, fit) for i, fit in enumerate(responses) if fit is not None and fit.explained > _TRUE]
    masses = two_masses(band, true) if drive is not None and drive.explained >= _FOLLOWS else None
    names = np.arange(int(band.part.max()) + 1 if len(band.part) else 0)
    rows = [found for found in (np.flatnonzero(band.part == name) for name in names) if len(found)]
    parts = [row[: int(np.argmax(np.diff(row, append=row[-1] + 2) > 1)) + 1] for row in rows]
    changes = tuple(
        None if fit is None else _change(x, fit.gain * band.acceleration, parts, band.rate)
        for x, fit in zip(band.response, responses, strict=True)
    )
    own = None
    if masses is not None and not any(changes):  # which would bend the model of the torque
        own = _change(masses.torque, masses.model, masses.spans, masses.rate)
    return InStep(drive, responses, masses, changes, own)


def _change(signal: Array, model: Array, parts: Sequence[NDArray[np.intp]], rate: float) -> Change | None:
    return change(lags(signal, model, parts, rate), np.array([part[0] / rate for part in parts]))


def derived_responses(aligned: Aligned) -> tuple[bool, ...]:
    """Which responses are the second difference of the position, by their values."""
    own = np.diff(aligned.position, 2) * aligned.rate**2
    scale = float(np.abs(own).max()) if len(own) else 0.0
    return tuple(
        bool(np.abs(x[1:-1] - own).max() <= 1e-6 * scale) if len(own) else False for x in aligned.response
    )


def check_step(file: str, aligned: Aligned, step: InStep) -> list[Finding]:
    """Findings on delay and polarity of the torque.

    Parameters
    ----------
    file : str
        For the messages.
    aligned : Aligned
        The recording.
    step : InStep
        From :func:`compare`.

    Returns
    -------
    list of Finding
        Empty where they are in step.
    """
    fit = step.drive
    if fit is None:
        return []
    drive = aligned.quantity
    if fit.explained < _FOLLOWS:
        return [
            Finding(
                "bad" if fit.explained < _FOLLOWS_BAD else "suspect",
                "unrelated",
                f"{file}: inertia and friction explain only {100 * max(fit.explained, 0):.3g} % of the "
                f"{drive}: it is not what moved this axis, or the channels are swapped",
            )
        ]
    findings = []
    others = [other.gain < 0 for other in step.responses if other is not None]
    if others and all(others) and fit.gain < 0:
        findings.append(Finding("suspect", "polarity", f"{file}: the position's polarity is inverted"))
    elif fit.gain < 0:
        text = f"{file}: the {drive} pushes against the motion: its polarity is inverted"
        findings.append(Finding("suspect", "polarity", text))
    moved = [
        *([(drive, step.drive_change)] if step.drive_change else []),
        *((name, found) for name, found in zip(aligned.responses, step.changes, strict=False) if found),
    ]
    if moved:
        return [*findings, *(_changes(file, name, found) for name, found in moved)]
    late, scatter = step.delay
    limit = max(_LATE, _LATE_SAMPLES / aligned.rate, _SIGMAS * scatter)
    if abs(late) > limit:
        first, second = ("the acceleration", drive) if late > 0 else (f"the {drive}", "acceleration")
        findings.append(
            Finding(
                "bad" if abs(late) > max(_LATE_BAD, limit) else "suspect",
                "delay",
                f"{file}: {first} comes {1e3 * abs(late):.3g} ms ± {1e3 * scatter:.1g} ms "
                f"({abs(late) * aligned.rate:.3g} samples) after the {second}",
            )
        )
    return findings


def _changes(file: str, name: str, found: Change) -> Finding:
    how = f"{file}: {name} shifts by {1e3 * abs(found.by):.3g} ms against the position within the record"
    if math.isnan(found.time):
        how = f"{how}, evenly: the two have a clock each"
    else:
        how = f"{how}, most of it near {found.time:.3g} s: samples of one of them were lost"
    return Finding("bad" if abs(found.by) > _LATE_BAD else "suspect", "delay-changes", how)
