"""Resonance and antiresonance of a torque and the motion that it causes, from broadband excitation.

In the response of torque to motor speed the pole is the axial mode with the rotor free, and the zero below it
the same mode with the rotor held, as Eq. (3) of the paper has it; neither moves with the controller's gains.

The controller C feeds noise of the motion back into the torque. The response G then has the expected value
(1 − e) G − e/C with e between 0 and 1. Both e and C are smooth over the frequency, so that the pole is that
of the axis, but not the zero. A reference as instrument has no such bias; without it a bound is part of the
uncertainty of the zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown
from ballscrew.base.quantity import Quantity
from ballscrew.base.result import PlottedResult, quantity_rows
from ballscrew.base.threads import single_threaded
from ballscrew.base.units import parse_named
from ballscrew.fcft.trace import SAMPLES_PER_PERIOD
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.rational_fit import FourierLines, RationalFit, fit_modes
from ballscrew.modal.reason import Reason
from ballscrew.modal.resonance_verdicts import (
    COHERENT,
    INCOHERENT,
    EstimatedMode,
    ModeOfAxis,
    axial_mode,
    estimated_antiresonance,
    estimated_resonance,
    explained_power,
    mode_doubts,
)
from ballscrew.modal.response import FrequencyResponse, Records, check_records, parse_rate
from ballscrew.modal.spectra import averaged, coherence, frf

if TYPE_CHECKING:
    import pandas as pd

ORDERS = {"torque": 0, "force": 0, "current": 0, "acceleration": 0, "speed": 1, "position": 2}
"""Integrations from a torque or an acceleration to each quantity."""

DRIVING = ("torque", "force", "current")
"""Quantities of an input that accelerates the axis; others are set-points of the controller."""

_NOT_MOTOR = "acceleration"  # of a sensor at the table

_SEGMENTS = 8  # of a single record in the averaged response
_FINEST = 1.0  # Hz, spacing of its lines
_LEAST_INPUT = 1e-4  # of the input's largest power: less excites nothing
_AROUND = 1.5  # range around the highest peak in which the mode is looked for
_BAND = (0.45, 2.0)  # of the peak: range that is fitted, with the zero
_FEWEST_LINES = 40
_POINTS = 1000  # frequencies of the fitted response
_MOST_PARAMETERS = 3  # lines per parameter, at least
_NEAR, _LEAST_PART = 0.1, 0.2  # range around a mode; power of the input in one half over that in the other


@dataclass(frozen=True, slots=True, repr=False)
class Resonances(PlottedResult):
    """Resonance and antiresonance of a response.

    Parameters
    ----------
    resonance, antiresonance : EstimatedMode
        Pole, the mode with the rotor free; zero below it, the mode with the rotor held.
    coherence : float or None
        Part of the output's power near the resonance that the model explains.
    band : tuple of float
        Range of frequencies that was fitted, Hz.
    halves : tuple of Quantity
        Resonance in the first and in the second half of the records, Hz; empty where they are too short.
    response : FrequencyResponse
        Averaged over windowed segments: for the plot, it has no effect on the result.
    model : FrequencyResponse or None
        Fitted response in the band; None where nothing was fitted.
    closed_loop : bool
        Whether the input is a set-point, so that the resonance is not that of the axis.
    """

    resonance: EstimatedMode
    antiresonance: EstimatedMode
    coherence: float | None
    band: tuple[float, float]
    halves: tuple[Quantity, ...]
    response: FrequencyResponse = field(compare=False)
    model: FrequencyResponse | None = field(compare=False)
    closed_loop: bool = False

    _drawing = "resonance_figure:draw_resonances"

    def _lines(self) -> list[str]:
        lines = []
        for name, mode in (("resonance", self.resonance), ("antiresonance", self.antiresonance)):
            lines.append(f"{name} {mode.frequency or ''}: {mode.verdict}".replace(" :", ":"))
            lines += [reason.text for reason in mode.reasons]
        return lines

    def to_dataframe(self) -> pd.DataFrame:
        """Table of both frequencies."""
        return quantity_rows(
            [("resonance", self.resonance.frequency), ("antiresonance", self.antiresonance.frequency)]
        )


@dataclass(frozen=True, slots=True)
class _Signals:
    """Records of input, output and perhaps reference."""

    records: list[tuple[Array, ...]]
    rate: float
    integrations: int

    @property
    def duration(self) -> float:
        """Of the longest record, s."""
        return max(len(record[0]) for record in self.records) / self.rate

    def halves(self) -> list[_Signals]:
        """First and second half of each record."""
        first, second = [], []
        for record in self.records:
            middle = len(record[0]) // 2
            first.append(tuple(x[:middle] for x in record))
            second.append(tuple(x[middle:] for x in record))
        return [replace(self, records=part) for part in (first, second)]


@single_threaded
def resonances(
    input: Records,  # noqa: A002
    output: Records,
    sample_rate: float | str,
    *,
    quantities: tuple[str, str] = ("torque", "speed"),
    reference: Records | None = None,
    band: tuple[float | str, float | str] | None = None,
) -> Resonances:
    """Resonance and antiresonance of an axis that is excited by noise, a chirp or sine steps.

    Parameters
    ----------
    input : array-like
        Torque of one record, shape (samples,), or of several: shape (records, samples) or a sequence.
    output : array-like
        Motion, in the same shape.
    sample_rate : float or str
        Hz, or with a unit: ``"8 kHz"``.
    quantities : tuple of str
        Of input and output: torque, force, current, acceleration, speed or position. Another input than the
        first three is a set-point of the controller: it shows the antiresonance only. An acceleration is not
        that of the motor and shows the resonance only.
    reference : array-like, optional
        Excitation that was added to a set-point of the controller, in the same shape. With it noise that the
        controller feeds back does not bias the result.
    band : tuple of (float or str), optional
        Range of frequencies that is fitted, Hz; it must contain both. By default around the most prominent
        peak from 40 to 500 Hz.

    Returns
    -------
    Resonances
        With uncertainties, verdicts and reasons.

    Raises
    ------
    InputError
        If the signals do not belong together, have values that are not finite, or are too short.

    Examples
    --------
    Two masses of 2 and 1 kg with a resonance of 122.5 and an antiresonance of 100 Hz:

    >>> import ballscrew
    >>> import numpy as np
    >>> from scipy import signal
    >>> w, rng = 2 * np.pi * 100, np.random.default_rng(1)
    >>> axis = ([1, 0.04 * w, w**2], [2, 0.12 * w, 3 * w**2, 0])
    >>> force = rng.normal(size=8000)
    >>> b, a, _ = signal.cont2discrete(axis, 1 / 8000, "foh")
    >>> found = ballscrew.resonances(force, signal.lfilter(b.ravel(), a, force), "8 kHz")
    >>> round(found.resonance.frequency.value, 1), round(found.antiresonance.frequency.value, 1)
    (122.5, 100.0)
    """
    rate = parse_rate(sample_rate)
    order = _integrations(quantities)
    inputs, outputs = check_records(input, output, rate)
    rows: list[list[Array]] = [inputs, outputs]
    if reference is not None:
        rows.append(check_records(input, reference, rate)[1])
    signals = _Signals(
        [*zip(*rows, strict=True)],
        rate,
        order,
    )
    response, power = _averaged(signals)
    low, high, fitted = _ranges(signals, response, power, band)
    lines = FourierLines.of(signals.records, rate, fitted, order)
    if len(lines.frequency) < _FEWEST_LINES:
        text = (
            f"the records last {signals.duration:.3g} s: there are {len(lines.frequency)} lines from "
            f"{fitted[0]:.0f} to {fitted[1]:.0f} Hz; {_FEWEST_LINES} are needed"
        )
        refused = EstimatedMode.refused(Reason("measurement", text))
        return Resonances(refused, refused, None, fitted, (), response, None)
    fit = fit_modes(lines, low, high)
    points = np.geomspace(*fitted, _POINTS)
    nowhere = np.full(_POINTS, math.nan)
    model = FrequencyResponse(points, fit.response(points), nowhere, "model", len(signals.records))
    index = axial_mode(fit, low, high, signals.duration)
    if isinstance(index, Reason):
        refused = EstimatedMode.refused(index)
        return Resonances(refused, refused, None, fitted, (), response, model)
    explained = explained_power(fit, float(fit.frequencies[index]))
    excited = np.interp(fit.frequencies[index], response.frequency, power) > _LEAST_INPUT * power.max()
    doubts = mode_doubts(fit, index, explained, bool(excited))
    mode = ModeOfAxis(
        fit, index, rate, quantities[0] in DRIVING, quantities[1] != _NOT_MOTOR, explained, doubts
    )
    halves = _halves(signals, fitted, fit, index)
    return Resonances(
        resonance=estimated_resonance(mode, halves),
        antiresonance=estimated_antiresonance(mode),
        coherence=explained,
        band=fitted,
        halves=halves,
        response=response,
        model=model,
        closed_loop=not mode.driven,
    )


def _integrations(quantities: tuple[str, str]) -> int:
    """Integrations from input to output."""
    if not isinstance(quantities, tuple | list) or len(quantities) != 2:
        raise InputError(f"quantities is {shown(quantities)}; it must be those of input and output.")
    for quantity in quantities:
        if quantity not in ORDERS:
            raise InputError(f"the quantity {quantity!r} is not one of {', '.join(ORDERS)}.")
    if quantities[1] in DRIVING:
        raise InputError(
            f"the output is a {quantities[1]}; it must be an acceleration, a speed or a position."
        )
    return ORDERS[quantities[1]] - ORDERS[quantities[0]]


def _averaged(signals: _Signals) -> tuple[FrequencyResponse, Array]:
    """Response averaged over windowed segments, and the power of the input at its frequencies."""
    from scipy.signal import get_window

    rate = signals.rate
    shortest = min(len(record[0]) for record in signals.records)
    size = shortest
    if len(signals.records) < _SEGMENTS:
        size = max(16, shortest * len(signals.records) // _SEGMENTS)
    size = min(size, shortest, math.ceil(rate / _FINEST))
    segments: list[list[Array]] = [[], []]
    window = get_window("hann", size)
    for record in signals.records:
        for start in range(0, len(record[0]) - size + 1, max(1, size // 2)):
            for rows, x in zip(segments, record, strict=False):
                part = x[start : start + size]
                rows.append(window * (part - part.mean()))
    u, y = np.array(segments[0]), np.array(segments[1])
    spectra = averaged(u, y[None], rate, (rate / size / 2, rate / 2), rate / size)
    coherent = np.full(len(spectra.frequency), math.nan)
    if spectra.count > 1:
        coherent = coherence(spectra)[0]
    response = FrequencyResponse(spectra.frequency, frf(spectra)[0], coherent, "H1", spectra.count)
    return response, spectra.uu


def _ranges(
    signals: _Signals, response: FrequencyResponse, power: Array, band: tuple[Any, Any] | None
) -> tuple[float, float, tuple[float, float]]:
    """Range in which the resonance is looked for, and the range that is fitted, Hz."""
    from scipy.signal import find_peaks

    highest = signals.rate / SAMPLES_PER_PERIOD
    if band is not None:
        low, high = (parse_named("the band", limit, "Hz") for limit in band)
        if not 0 < low < high:
            raise InputError(f"the band is {low:g} to {high:g} Hz; it must rise, from above 0.")
        if high > highest:
            raise InputError(
                f"the band ends at {high:g} Hz; a rate of {signals.rate:g} Hz suffices up to "
                f"{highest:.4g} Hz."
            )
        return low, high, (low, high)
    limits, f = JointSettings(), response.frequency
    shown = (f > limits.lowest) & (f < min(limits.highest, highest)) & (power > _LEAST_INPUT * power.max())
    if np.count_nonzero(shown) < _SEGMENTS:
        raise InputError(
            f"the records last {signals.duration:.3g} s at {signals.rate:g} Hz: too short, too slow or "
            f"without excitation for a mode from {limits.lowest:g} to {limits.highest:g} Hz."
        )
    weight = np.where(response.coherence > COHERENT, 1.0, INCOHERENT)
    height = np.log(np.abs(response.frf[shown]) * f[shown] ** signals.integrations * weight[shown] + 1e-300)
    peaks, found = find_peaks(height, prominence=0.0)
    peak = float(f[shown][int(np.argmax(height))])
    if len(peaks):
        peak = float(f[shown][peaks[int(np.argmax(found["prominences"]))]])
    fitted = (_BAND[0] * peak, min(_BAND[1] * peak, highest))
    return peak / _AROUND, min(peak * _AROUND, highest), fitted


def _halves(
    signals: _Signals, band: tuple[float, float], fit: RationalFit, index: int
) -> tuple[Quantity, ...]:
    """Resonance of each half of the records; nothing where a half is too short or does not excite it."""
    found, powers = [], []
    for half in signals.halves():
        lines = FourierLines.of(half.records, signals.rate, band, signals.integrations)
        if len(lines.frequency) < max(_FEWEST_LINES / 2, _MOST_PARAMETERS * len(fit.coefficients) / 2):
            return ()
        near = np.abs(lines.frequency / fit.frequencies[index] - 1) < _NEAR
        powers.append(float(np.sum(np.abs(lines.input[near]) ** 2)))
        modes = fit.modes.copy()
        modes[0] += math.log(fit.lines.scale / lines.scale)
        start = RationalFit(lines, modes, np.ones(len(lines.frequency)), np.empty(0))
        part = start.minimised().weighted()
        f = float(part.frequencies[index])
        found.append(Quantity(f, f * math.sqrt(max(part.covariance()[index, index], 0.0)), "Hz"))
    if min(powers) < _LEAST_PART * max(powers):
        return ()
    return tuple(found)
