"""Verdicts and uncertainties of the resonance and the antiresonance of a fitted response."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ballscrew.base.quantity import Quantity
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.rational_fit import MOST_DAMPING, RationalFit
from ballscrew.modal.reason import Reason, large_uncertainty

_PEAK_DAMPING = 0.15  # more is no resonance
_HALF_WIDTH, _FEWEST_NEAR = 0.05, 8  # of the frequency: lines near a mode; their number, at least
COHERENT, INCOHERENT = 0.5, 0.2
"""Limits of the coherence for good and for refused."""

_SUSPECT_UNCERTAINTY = 0.003  # of the frequency, as for a cell of the joint method
_BESIDE = 0.03  # of its frequency: a zero nearer to the pole of a weak mode is that mode's own
_HALVES = 3.0  # standard deviations
_CLOSE, _STRONG = 1.4, 0.3  # ratio of frequencies and of modal constants of two modes that may be exchanged
_LINEAR = 0.05  # of the frequency: the bound of the bias holds for less
_OPPOSED = -0.5  # mean cosine of the phase of a motor's response that a passive axis cannot have
_HOLD = 0.7  # shift of a zero by a torque that is constant between samples, over (f / rate)²; 0.66 measured


@dataclass(frozen=True, slots=True)
class EstimatedMode:
    """Frequency of a resonance or an antiresonance.

    Parameters
    ----------
    frequency : Quantity or None
        Undamped, Hz; None where refused.
    damping : float or None
        Ratio.
    verdict : str
        good, suspect or refused.
    reasons : tuple of Reason
        Why it is not good.
    terms : dict
        Parts of the standard uncertainty, Hz.
    """

    frequency: Quantity | None
    damping: float | None
    verdict: str
    reasons: tuple[Reason, ...] = ()
    terms: dict[str, float] = field(default_factory=dict)

    @classmethod
    def refused(cls, *reasons: Reason) -> EstimatedMode:
        """None, with the reasons."""
        return cls(None, None, "refused", reasons)


@dataclass(frozen=True, slots=True)
class ModeOfAxis:
    """The mode of a fit that is that of the axis, and how it was measured.

    Parameters
    ----------
    fit : RationalFit
        Model of the response.
    index : int
        Which of its modes.
    rate : float
        Hz.
    driven : bool
        Whether the input is a torque or a force, no set-point of the controller.
    collocated : bool
        Whether the output is the motor's motion.
    explained : float
        Part of the output's power near the mode that follows the input, and the reference where there is one.
    doubts : tuple of Reason
        Of resonance and antiresonance.
    """

    fit: RationalFit
    index: int
    rate: float
    driven: bool
    collocated: bool
    explained: float
    doubts: tuple[Reason, ...] = ()

    @property
    def frequency(self) -> float:
        """Undamped natural frequency, Hz."""
        return float(self.fit.frequencies[self.index])

    @property
    def noise(self) -> float:
        """Standard uncertainty of the frequency by noise, Hz."""
        return self.frequency * math.sqrt(max(float(self.fit.covariance()[self.index, self.index]), 0.0))

    @property
    def damping(self) -> float:
        """Damping ratio."""
        return float(self.fit.dampings[self.index])


def axial_mode(fit: RationalFit, low: float, high: float, duration: float) -> int | Reason:
    """Index of the mode with the largest modal constant, or why there is none.

    Parameters
    ----------
    fit : RationalFit
        Model of the response.
    low, high : float
        Range of the mode, Hz.
    duration : float
        Of the longest record, s; a mode that is narrower than its lines is a periodic force.
    """
    tones = 2 * fit.dampings * fit.frequencies * duration < 1
    possible = (fit.frequencies >= low) & (fit.frequencies <= high) & (fit.dampings < _PEAK_DAMPING) & ~tones
    if possible.any():
        return int(np.argmax(np.where(possible, np.abs(fit.modal_constants()), -1.0)))
    if tones.any():
        places = " and ".join(f"{f:.1f}" for f in sorted(fit.frequencies[tones]))
        text = f"the peak at {places} Hz is narrower than 1/duration: a periodic force, not a resonance"
        return Reason("tone", text)
    return Reason("no-mode", f"no resonance shows from {low:.4g} to {high:.4g} Hz")


def explained_power(fit: RationalFit, frequency: float) -> float:
    """Part of the output's power near a frequency that follows the input, and a reference."""
    lines = fit.lines
    distance = np.abs(lines.frequency / frequency - 1)
    near = distance <= max(_HALF_WIDTH, float(np.sort(distance)[min(_FEWEST_NEAR, len(distance)) - 1]))
    power = max(float(np.sum(np.abs((lines.output - fit.transients())[near]) ** 2)), 1e-300)
    explained = 1 - float(np.sum(np.abs(fit.residual[near]) ** 2)) / power
    if lines.instrument is not None:
        following = fit.response(lines.frequency[near]) * lines.instrument[near]
        explained = min(explained, float(np.sum(np.abs(following) ** 2)) / power)
    return max(0.0, explained)


def mode_doubts(fit: RationalFit, index: int, explained: float, excited: bool) -> tuple[Reason, ...]:
    """Doubts of both frequencies.

    Parameters
    ----------
    fit : RationalFit
        Model of the response.
    index : int
        Mode of the axis.
    explained : float
        Part of the output's power near it that follows the input.
    excited : bool
        Whether the input has power there.
    """
    reasons, f = [], float(fit.frequencies[index])
    if explained < COHERENT:
        text = (
            f"the input explains {100 * explained:.0f} % of the motion at the mode: noise, or another force"
        )
        reasons.append(Reason("unmeasured-force", text))
    if not excited:
        reasons.append(Reason("unexcited", f"the input hardly excites the mode at {f:.1f} Hz"))
    size = np.abs(fit.modal_constants())
    for other, frequency in enumerate(fit.frequencies):
        ratio = max(frequency / f, f / frequency)
        strong = size[other] > _STRONG * size[index] and fit.dampings[other] < _PEAK_DAMPING
        if other != index and strong and ratio < _CLOSE:
            text = (
                f"a second mode lies near, at {frequency:.1f} Hz: which of the two is the axis is uncertain"
            )
            reasons.append(Reason("frame", text))
    return tuple(reasons)


def estimated_resonance(mode: ModeOfAxis, halves: Sequence[Quantity]) -> EstimatedMode:
    """Pole with its uncertainty and verdict.

    Parameters
    ----------
    mode : ModeOfAxis
        Mode of the axis.
    halves : sequence of Quantity
        Its frequency in the first and in the second half of the records, or nothing.
    """
    settings, reasons, f = JointSettings(), list(mode.doubts), mode.frequency
    if not mode.driven:
        text = "the input is a set-point: this resonance is that of the closed loop; record the torque"
        reasons.append(Reason("measurement", text))
    terms = {"noise": mode.noise, "model": f * settings.model_floor, "clock": f * settings.clock}
    if len(halves) == 2:
        first, second = halves
        spread = math.hypot(first.standard_uncertainty, second.standard_uncertainty, terms["model"])
        if abs(first.value - second.value) > _HALVES * spread:
            reasons.append(Reason("trips-differ", f"the halves of the record differ: {first} and {second}"))
    return _with_verdict(mode, f, mode.damping, terms, reasons)


def estimated_antiresonance(mode: ModeOfAxis) -> EstimatedMode:
    """Zero below the pole with its uncertainty and verdict."""
    fit, settings = mode.fit, JointSettings()
    if not mode.collocated:
        text = "the output is an acceleration: only the motor's own motion has the antiresonance"
        return EstimatedMode.refused(Reason("other", text))
    if mode.driven and _follows_controller(fit, mode.index):
        text = "the torque follows the noise of the motion: no antiresonance without a reference"
        return EstimatedMode.refused(Reason("unmeasured-force", text))
    zero = _zero_below(mode)
    if zero is None:
        low = float(fit.lines.frequency.min())
        text = f"no antiresonance shows from {low:.4g} Hz to the resonance"
        return EstimatedMode.refused(Reason("no-mode", text))
    f, noise, damping = zero
    terms = {
        "noise": noise,
        "model": f * (settings.model_floor + _HOLD * (f / mode.rate) ** 2),
        "clock": f * settings.clock,
    }
    if mode.driven and fit.lines.instrument is None:
        terms["loop"], bound = _loop_terms(mode, f, damping)
        if bound > _LINEAR * f:
            text = "the controller may shift the antiresonance by more than 5 %: record its reference"
            return EstimatedMode.refused(*mode.doubts, Reason("unmeasured-force", text))
    return _with_verdict(mode, f, damping, terms, mode.doubts)


def _zero_below(mode: ModeOfAxis) -> tuple[float, float, float] | None:
    """Zero in the band next below the pole: frequency and its standard uncertainty (Hz), damping.

    Zeros beside the pole of another mode belong to that.
    """
    fit = mode.fit
    others = np.delete(fit.frequencies, mode.index) * np.exp(
        1j * np.arccos(-np.delete(fit.dampings, mode.index))
    )
    low = float(fit.lines.frequency.min())
    below = None
    for f, spread, damping in fit.zeros():
        if low < f < mode.frequency and abs(damping) < MOST_DAMPING:
            zero = f * np.exp(1j * math.acos(-damping))
            if not np.any(np.abs(others - zero) < _BESIDE * f):
                below = f, spread, damping
    return below


def _with_verdict(
    mode: ModeOfAxis, frequency: float, damping: float, terms: dict[str, float], doubts: Sequence[Reason]
) -> EstimatedMode:
    """Frequency with its verdict, by its uncertainty and doubts."""
    u, most = math.hypot(*terms.values()), JointSettings().most_uncertainty
    if not u <= most * frequency:
        return EstimatedMode.refused(*doubts, large_uncertainty(u, most))
    if mode.explained < INCOHERENT:
        return EstimatedMode.refused(*doubts)
    reasons = list(doubts)
    if u > _SUSPECT_UNCERTAINTY * frequency:
        reasons.append(large_uncertainty(u, _SUSPECT_UNCERTAINTY))
    verdict = "suspect" if reasons else "good"
    return EstimatedMode(Quantity(frequency, u, "Hz"), damping, verdict, tuple(reasons), terms)


def _follows_controller(fit: RationalFit, index: int) -> bool:
    """Whether the response is minus one over the controller, as that of noise in a closed loop.

    A passive axis has a mobility with a positive real part; the sign of the channels is that of the mode.
    """
    f = fit.lines.frequency
    sign = math.copysign(1.0, float(fit.modal_constants()[index].real))
    mobility = sign * fit.response(f) * (1j * f) ** (fit.lines.integrations - 1)
    return bool(np.median(mobility.real / np.maximum(np.abs(mobility), 1e-300)) < _OPPOSED)


def _loop_terms(mode: ModeOfAxis, zero: float, damping: float) -> tuple[float, float]:
    """Standard uncertainty of a zero by feedback of noise, and the bound of its shift, Hz.

    The bias of the response is a constant of the size |G| (1 - coherence) / coherence or less, as long as the
    controller's gain is below 1/|G|. It shifts the zero in the complex plane: along by the phase of the
    controller, assumed below 45°, and towards negative damping, which without it would be that of the pole
    times the ratio of frequencies. The smaller bound counts, as a uniform distribution.
    """
    fit = mode.fit
    response = fit.response(fit.lines.frequency)
    power = float(np.median(np.abs(response * fit.lines.input) ** 2))
    noise_ratio = float(np.median(np.abs(fit.residual) ** 2)) / max(power, 1e-300)
    step = 1e-3 * zero
    below, above = fit.response(np.array([zero - step, zero + step]))
    slope = max(abs(complex(above - below)) / (2 * step), 1e-300)
    bound = noise_ratio * float(np.median(np.abs(response))) / slope
    expected = mode.damping * zero / mode.frequency
    return min(bound, abs(damping - expected) * zero) / math.sqrt(3), bound
