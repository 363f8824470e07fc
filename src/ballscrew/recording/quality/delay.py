"""Synchronisation of torque and accelerations: delays, their changes within a record, polarities."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.recording.aligned import Aligned
from ballscrew.recording.kinematics import differentiate
from ballscrew.recording.quality.finding import Finding, severity
from ballscrew.recording.quality.lowband import (
    LagFit,
    LowBand,
    TwoMasses,
    chance_power,
    fit_lag,
    two_masses,
)

# The torque that a drive reports is its command: the current loop and the hold of one sample come after it.
_LATE_SAMPLES = 1.25
_LATE = 0.11e-3  # s; shorter delays are those of the current loop and of the sensors
# Error of the delay in good records: with accelerometers, and from the encoder alone, where friction and
# servo bend the torque.
_MODEL = 0.03e-3  # s
_MODEL_ALONE = 0.12e-3  # s
_SIGMAS = 3.0
_LATE_BAD = 3e-3  # s: half a period of the mode; torque and acceleration then belong to different instants
_FOLLOWS = 0.9  # share of the torque that inertia and friction explain; 0.999 in good records
_FOLLOWS_BAD = 0.5
_SMOOTHING = 5e-3  # s: ripple and noise above 50 Hz are removed
_RESTING = 0.02  # of the highest speed
_TRUE = 0.97  # share of an acceleration that the encoder's explains; 1.0000 in good records

_LONGEST_LAG = 0.1  # s
_LEAST_CORRELATION = 0.95  # of a part of the record with its model, for a lag
_LEAST_PARTS = 8
_LEAST_SIDE = 3  # parts on either side of a step, so that a single odd part is not a step
_STEP_SIGMAS = 6.0  # of the scatter of neighbours
_DIFFERENCE_SIGMAS = _SIGMAS * math.sqrt(2)  # of a lag, for the difference of two
_LEAST_STEP = 0.25e-3  # s; below 0.3 ms a delay moves the frequency by less than 0.01 %
_DRIFT_RESIDUAL = 0.5  # squares that a line leaves over those that a step leaves, for a drift


@dataclass(frozen=True, slots=True)
class DelayChange:
    """Change of a delay within a record.

    Parameters
    ----------
    by : float
        Delay at the end less delay at the beginning, s.
    time : float
        Time of the step, s; NaN for a drift.
    """

    by: float
    time: float


@dataclass(frozen=True, slots=True)
class Synchronisation:
    """Torque and accelerations against the encoder.

    Parameters
    ----------
    drive : LagFit, optional
        Torque against the encoder's acceleration, beside friction; None where it cannot be fitted.
    responses : tuple of LagFit, optional
        Each acceleration against the encoder's; None for a response that is derived from the encoder.
    masses : TwoMasses, optional
        Torque as that of rotor and table; None where there is no accelerometer.
    changes : tuple of DelayChange, optional
        Change of each acceleration's delay within the record; None where it is constant.
    drive_change : DelayChange, optional
        Change of the torque's delay.
    """

    drive: LagFit | None
    responses: tuple[LagFit | None, ...]
    masses: TwoMasses | None = None
    changes: tuple[DelayChange | None, ...] = ()
    drive_change: DelayChange | None = None

    @property
    def fits(self) -> list[LagFit]:
        """Fits of the accelerometers, without responses that are derived from the encoder."""
        return [fit for fit in self.responses if fit is not None]

    @property
    def delay(self) -> tuple[float, float]:
        """Delay of the accelerations behind the torque, and its standard uncertainty, s."""
        if self.drive is None:
            return math.nan, math.nan
        drive, model = self.drive, _MODEL_ALONE
        if self.masses is not None:
            drive, model = self.masses.fit, _MODEL
        delays = np.zeros((len(self.responses), 2))
        for row, fit in zip(delays, self.responses, strict=True):
            if fit is not None:
                row[:] = fit.late, fit.uncertainty
        late, scatter = np.median(delays, axis=0).tolist()
        return late - drive.late, math.hypot(drive.uncertainty, scatter, model)


def compare_with_encoder(
    band: LowBand, *, derived: Sequence[bool], rotor: Sequence[bool] = ()
) -> Synchronisation:
    """Compare torque and accelerations with the encoder.

    Accelerations are compared with the encoder's below 15 Hz, where they differ by the axis' compliance only;
    the flank of the mode and a sensor's high pass are fitted beside the delay. The torque is compared with
    the accelerations of rotor and table in full motion (:func:`.two_masses`) or, without an accelerometer,
    with the encoder below 15 Hz.

    Parameters
    ----------
    band : LowBand
        Signals below the mode.
    derived : sequence of bool
        True for responses that are the encoder's own second derivative; these are not compared.
    rotor : sequence of bool
        True for responses by the motor's speed, which are none of the table; none of them by default.

    Returns
    -------
    Synchronisation
        With None where there is nothing to compare.
    """
    around = band.part >= 0
    terms = [band.speed, *band.friction]
    drive = fit_lag(band, band.drive, band.acceleration, terms, around & band.moving)
    responses: list[LagFit | None] = []
    changes: list[DelayChange | None] = []
    true: list[tuple[int, LagFit]] = []
    parts = _parts(band.part)
    for index, (x, own) in enumerate(zip(band.response, derived, strict=True)):
        fit = change = None
        if not own:
            fit = fit_lag(band, x, band.acceleration, [band.speed], around)
        if fit is not None:
            change = _change(x, fit.gain * band.acceleration, parts, band.rate)
            if fit.explained > _TRUE and not any(rotor[index : index + 1]):
                true.append((index, fit))
        responses.append(fit)
        changes.append(change)
    masses = drive_change = None
    if drive is not None and drive.explained >= _FOLLOWS:
        masses = two_masses(band, true)
    if masses is not None and not any(changes):  # an acceleration that shifts would bend the torque's model
        drive_change = _change(masses.torque, masses.model, masses.spans, masses.rate)
    return Synchronisation(drive, tuple(responses), masses, tuple(changes), drive_change)


def _parts(number: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Samples around each phase, up to the first gap."""
    parts = []
    for phase in range(int(number.max(initial=-1)) + 1):
        rows = np.flatnonzero(number == phase)
        if len(rows):
            gap = int(np.argmax(np.diff(rows, append=rows[-1] + 2) > 1))
            parts.append(rows[: gap + 1])
    return parts


def _change(
    signal: Array, model: Array, parts: Sequence[NDArray[np.intp]], rate: float
) -> DelayChange | None:
    times = np.array([part[0] / rate for part in parts])
    return delay_change(*part_lags(signal, model, parts, rate), times)


def part_lags(
    signal: Array, model: Array, parts: Sequence[NDArray[np.intp]], rate: float
) -> tuple[Array, Array]:
    """Lag of a signal behind its model in each part of a record, and its standard uncertainty.

    Parameters
    ----------
    signal, model : ndarray, shape (n,)
        Signals at one rate.
    parts : sequence of ndarray of int
        Consecutive samples of each part.
    rate : float
        Sample rate, Hz.

    Returns
    -------
    lags, uncertainties : ndarray, shape (n_parts,)
        s, from the peak of the correlation; NaN where the correlation is below 0.95.
    """
    reach = round(_LONGEST_LAG * rate)
    lags, uncertainties = np.full((2, len(parts)), np.nan)
    for index, part in enumerate(parts):
        first, last = int(part[0]), int(part[-1]) + 1
        # Near the ends of the record, filters have transients.
        if first < 2 * reach or last + 2 * reach > len(signal) or last - first < 3:
            continue
        around = signal[first - reach : last + reach]
        around = around - around.mean()
        own = model[first:last] - model[first:last].mean()
        size = _moving_deviation(around, last - first) * np.sqrt(np.sum(own**2) * (last - first))
        correlation = np.correlate(around, own) / np.where(size > 0, size, np.inf)
        best = int(np.argmax(correlation))
        if correlation[best] < _LEAST_CORRELATION or not 0 < best < len(correlation) - 1:
            continue
        before, here, after = correlation[best - 1 : best + 2]
        bend = before - 2 * here + after
        vertex = best - reach
        if bend < 0:
            vertex += 0.5 * (before - after) / bend
        lags[index] = vertex / rate
        shifted = np.interp(reach + vertex + np.arange(last - first), np.arange(len(around)), around)
        uncertainties[index] = _lag_uncertainty(shifted - shifted.mean(), own, rate)
    return lags, uncertainties


def _lag_uncertainty(signal: Array, model: Array, rate: float) -> float:
    """Standard uncertainty of a lag, s: its error by a residual of this spectrum at any time.

    It contains forces that repeat with every turn of the screw. They move the lags alike on the way out, and
    alike on the way back, which the scatter of neighbours does not show.
    """
    gain = float(model @ signal) / float(model @ model)
    slope = gain * np.gradient(model) * rate
    return math.sqrt(chance_power(signal - gain * model, slope)) / float(slope @ slope)


def _moving_deviation(x: Array, size: int) -> Array:
    """Standard deviation of every span of ``size`` samples."""
    sums = np.concatenate([[0.0], np.cumsum(x)])
    squares = np.concatenate([[0.0], np.cumsum(x**2)])
    mean = (sums[size:] - sums[:-size]) / size
    return np.asarray(np.sqrt(np.maximum((squares[size:] - squares[:-size]) / size - mean**2, 0.0)))


def delay_change(lag: Array, uncertainty: Array, time: Array) -> DelayChange | None:
    """Find a step or a drift in the lags of a record's parts.

    Parameters
    ----------
    lag, uncertainty, time : ndarray, shape (n,)
        s; lags may be NaN.

    Returns
    -------
    DelayChange or None
        None where the lags scatter about one value, or too few are known.
    """
    known = np.isfinite(lag)
    if np.count_nonzero(known) < max(_LEAST_PARTS, len(lag) / 2):
        return None
    lag, time = lag[known], time[known]
    # Neighbours differ little by a drift, and all but one pair of them not at all by a step: that is scatter.
    scatter = 1.05 * float(np.median(np.abs(np.diff(lag))))
    splits = range(_LEAST_SIDE, len(lag) - _LEAST_SIDE + 1)
    residuals = [at * np.var(lag[:at]) + (len(lag) - at) * np.var(lag[at:]) for at in splits]
    at = splits[int(np.argmin(residuals))]
    step = float(np.median(lag[at:]) - np.median(lag[:at]))
    systematic = _DIFFERENCE_SIGMAS * float(np.median(uncertainty[known]))
    if abs(step) <= max(_LEAST_STEP, _STEP_SIGMAS * scatter, systematic):
        return None
    line = np.polynomial.Polynomial.fit(time, lag, 1)
    if np.sum((lag - line(time)) ** 2) < _DRIFT_RESIDUAL * min(residuals):
        return DelayChange(float(line(time[-1]) - line(time[0])), math.nan)
    return DelayChange(step, float(0.5 * (time[at - 1] + time[at])))


def derived_responses(aligned: Aligned) -> tuple[bool, ...]:
    """True for each response whose values are the second difference of the position."""
    own = np.diff(aligned.position, 2) * aligned.rate**2
    if not len(own):
        return (False,) * len(aligned.response)
    deviation = np.abs(aligned.response[:, 1:-1] - own).max(axis=1)
    return tuple((deviation <= 1e-6 * np.abs(own).max()).tolist())


def check_synchronisation(file: str, aligned: Aligned, found: Synchronisation) -> list[Finding]:
    """Findings on delay and polarity of the torque.

    Parameters
    ----------
    file : str
        Name of the file, for the messages.
    aligned : Aligned
        Channels of the recording.
    found : Synchronisation
        From :func:`compare_with_encoder`.

    Returns
    -------
    list of Finding
        Empty where torque and accelerations are synchronous.
    """
    fit = found.drive
    if fit is None:
        return []
    drive = aligned.quantity
    if fit.explained < _FOLLOWS:
        text = (
            f"{file}: inertia and friction explain only {100 * max(fit.explained, 0):.3g} % of the "
            f"{drive}: it is not what moved this axis, or the channels are swapped"
        )
        if _are_exchanged(aligned):
            text = f"{file}: {drive} and position are exchanged: exchange their sources in the channel map"
            return [Finding("bad", "exchanged", text)]
        return [Finding(severity(bad=fit.explained < _FOLLOWS_BAD), "unrelated", text)]
    findings = []
    if fit.gain < 0:
        text = f"{file}: the {drive} pushes against the motion: its polarity is inverted"
        if found.fits and max(other.gain for other in found.fits) < 0:
            text = f"{file}: the position's polarity is inverted"
        findings.append(Finding("suspect", "polarity", text))
    return findings + (_changing(file, aligned, found) or _late(file, aligned, found))


def _are_exchanged(aligned: Aligned) -> bool:
    """Whether inertia and friction explain the position by the input, taken for a position."""
    if not np.ptp(aligned.input) > 0:
        return False
    path = aligned.input / np.ptp(aligned.input)
    v, a = (differentiate(path, aligned.rate, _SMOOTHING, order) for order in (1, 2))
    y = differentiate(aligned.position, aligned.rate, _SMOOTHING, 0)
    direction = np.sign(v) * (np.abs(v) > _RESTING * np.abs(v).max())
    columns = np.stack([a, v, direction, np.ones_like(v)], axis=1)
    rest = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
    return bool(np.var(rest) < (1 - _FOLLOWS_BAD) * np.var(y))


def _changing(file: str, aligned: Aligned, found: Synchronisation) -> list[Finding]:
    names, changes = (aligned.quantity, *aligned.responses), (found.drive_change, *found.changes)
    findings = []
    for name, change in zip(names, changes, strict=False):
        if change is not None:
            findings.append(_change_finding(file, name, change))
    return findings


def _late(file: str, aligned: Aligned, found: Synchronisation) -> list[Finding]:
    drive = aligned.quantity
    late, scatter = found.delay
    limit = max(_LATE, _LATE_SAMPLES / aligned.rate, _SIGMAS * scatter)
    if not abs(late) > limit:
        return []
    first, second = f"the {drive}", "acceleration"
    if late > 0:
        first, second = "the acceleration", drive
    text = (
        f"{file}: {first} comes {1e3 * abs(late):.3g} ms ± {1e3 * scatter:.1g} ms "
        f"({abs(late) * aligned.rate:.3g} samples) after the {second}: use one clock and filter, or declare "
        "the filter (filtered_by)"
    )
    return [Finding(severity(bad=abs(late) > max(_LATE_BAD, limit)), "delay", text)]


def _change_finding(file: str, name: str, change: DelayChange) -> Finding:
    text = f"{file}: {name} shifts by {1e3 * abs(change.by):.3g} ms against the position within the record"
    if math.isnan(change.time):
        text += ", evenly: they run on separate clocks"
    else:
        text += f", most of it near {change.time:.3g} s: samples of one of them were lost"
    return Finding(severity(bad=abs(change.by) > _LATE_BAD), "delay-changes", text)
