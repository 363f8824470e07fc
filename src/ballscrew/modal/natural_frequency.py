"""Natural frequency of one mode between one input and one output, from arrays.

The joint estimator fits all cells of a test with a model of the axis. Here is what remains without axis and
test: transients of one input and one output, and one mode,

    output = (b₀ + b₁ s + b₂ s²) / (s² + 2 ζ ω s + ω²) · input + free vibration of each transient.

Both signals pass the same band-pass filter. For each ω and ζ the weights and the free vibrations follow from
linear least squares, so only ω and ζ are iterated (variable projection, Golub and Pereyra 1973,
10.1137/0710036), on residuals that an autoregressive filter whitens.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, MeasurementError, shown
from ballscrew.base.quantity import Quantity
from ballscrew.base.result import PlottedResult, quantity_rows
from ballscrew.base.threads import single_threaded
from ballscrew.base.units import parse_named
from ballscrew.base.words import percent, plural
from ballscrew.modal.joint.blocks import orthonormaliser
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.joint.whitening import whitening_filter
from ballscrew.modal.joint.windows import band_filter
from ballscrew.modal.response import (
    FrequencyResponse,
    Records,
    averaged_spectra,
    check_records,
    padded,
    parse_rate,
)
from ballscrew.modal.response import frf as frequency_response
from ballscrew.modal.spectra import frf

if TYPE_CHECKING:
    import pandas as pd

_LEAST_PERIODS = 4.0  # of the mode in a transient
_LEAST_RATE = 16.0  # samples per period: ramps between samples then attenuate the mode by 1.3 %
_RATE = 32.0  # samples per period to which signals are decimated
_AROUND = 1.5  # range around the highest peak of the FRF
_STEP = 1e-4  # of ln f and ln ζ, for difference quotients
_SETTLING = 0.4  # of a period of the band's lower limit: not fitted, since the filter settles
_DAMPINGS = (0.01, 0.05)  # ratios tried
_GRID = 0.03  # step of ln ω in the search
_LIMITS = (1e-4, 0.5)  # of the damping ratio
_ROUNDS = 2  # of whitening
_RANK_TOLERANCE = 1e-10
_LEAST_INPUT = 1e-6  # of the input's largest power: the response is not looked at where there is less
# Part of the output's power: a two-mass axis in motion left 0.2 to 0.9 %, one whose guide sticks after the
# stop, which moves the frequency by 1 %, 8 %.
_MOST_UNEXPLAINED = 0.03
_MOST_DAMPING = 0.25  # ratio, as in joint/verdicts.py
_FEWEST = 3  # transients whose scatter shows errors of the model


@dataclass(frozen=True, slots=True, repr=False)
class NaturalFrequency(PlottedResult):
    """Undamped natural frequency of one mode.

    Parameters
    ----------
    frequency : Quantity
        Hz.
    damping : Quantity
        Ratio.
    unexplained : float
        Part of the output's power in the band that the model leaves.
    transients : int
        How many were fitted.
    verdict : {"good", "suspect"}
        Good means that the interval can be relied on.
    reasons : tuple of str
        Why it is suspect.
    response : FrequencyResponse or None
        FRF of the transients, without a window: for the plot, it has no effect on the result.
    """

    frequency: Quantity
    damping: Quantity
    unexplained: float
    transients: int
    verdict: Literal["good", "suspect"]
    reasons: tuple[str, ...] = ()
    response: FrequencyResponse | None = field(default=None, compare=False)

    _drawing = "frf_figure:draw_mode"

    def _lines(self) -> list[str]:
        return [
            f"{self.frequency}: {self.verdict}",
            f"damping ratio {self.damping}",
            f"{percent(self.unexplained)} of the power in the band is not explained",
            *self.reasons,
        ]

    def to_dataframe(self) -> pd.DataFrame:
        """Table of frequency and damping ratio."""
        return quantity_rows([("natural frequency", self.frequency), ("damping ratio", self.damping)])


@single_threaded
def natural_frequency(
    input: Records,  # noqa: A002
    output: Records,
    sample_rate: float | str,
    *,
    band: tuple[float | str, float | str] | None = None,
) -> NaturalFrequency:
    """Undamped natural frequency of the mode between one input and one output.

    Parameters
    ----------
    input : array-like
        Force or torque of one transient, shape (samples,), or of several: shape (transients, samples) or a
        sequence of transients. Each may begin in motion, and must end before the axis stops: a guide that
        sticks stiffens the axis. The frequency is that of the position in the middle of the transient.
    output : array-like
        Acceleration, speed or position, in the same shape.
    sample_rate : float or str
        Hz, or with a unit: ``"12.8 kHz"``.
    band : tuple of (float or str), optional
        Range of frequencies in which the mode is looked for, Hz. By default around the highest peak of the
        FRF, where the input excites it.

    Returns
    -------
    NaturalFrequency
        With its uncertainty by the scatter of transients and of periods.

    Raises
    ------
    InputError
        If input and output do not belong together, have values that are not finite, or too few samples.
    MeasurementError
        If no mode explains half of the output's power.

    Examples
    --------
    Three transients of a mode of 100 Hz with 3 % of damping:

    >>> import ballscrew
    >>> import numpy as np
    >>> from scipy import signal
    >>> rng, w = np.random.default_rng(1), 2 * np.pi * 100
    >>> force = rng.normal(size=(3, 2000))
    >>> mode = signal.cont2discrete(([w**2], [1, 0.06 * w, w**2]), 1 / 4000, "foh")
    >>> acceleration = signal.lfilter(np.ravel(mode[0]), mode[1], force)
    >>> found = ballscrew.natural_frequency(force, acceleration, "4 kHz")
    >>> round(found.frequency.value, 1)
    100.0
    """
    rate = parse_rate(sample_rate)
    inputs, outputs = check_records(input, output, rate)
    low, high = _search_range(inputs, outputs, rate, band)
    response = frequency_response(inputs, outputs, rate)
    step = max(1, math.floor(rate / (_RATE * high)))
    inputs, outputs = _decimated(inputs, step), _decimated(outputs, step)
    start = _OneMode.of(inputs, outputs, rate / step, low, high).searched(low, high)
    frequency = math.exp(start[0])
    problem = _OneMode.of(inputs, outputs, rate / step, frequency, frequency)
    mode = problem.minimised(start)
    for _ in range(_ROUNDS):
        problem = problem.whitening(mode)
        mode = problem.minimised(mode)
    if not low <= math.exp(mode[0]) <= high:
        raise MeasurementError(
            f"no mode was found from {low:.4g} to {high:.4g} Hz; state the band in which it is expected."
        )
    return replace(_result(problem, mode), response=response)


@dataclass(frozen=True, slots=True)
class _OneMode:
    """Transients in the band around a mode, with the filter that whitens their residuals.

    Parameters
    ----------
    rate : float
        Hz.
    input, output : ndarray, shape (transients, samples)
        In the band; continued by zeros where a transient is shorter.
    counted : ndarray of bool, shape (transients, samples)
        Samples that are fitted.
    taps : ndarray
        Of the whitening filter.
    """

    rate: float
    input: Array
    output: Array
    counted: NDArray[np.bool_]
    taps: Array

    @classmethod
    def of(
        cls, inputs: Sequence[Array], outputs: Sequence[Array], rate: float, low: float, high: float
    ) -> _OneMode:
        """Transients through the filter of the band around modes from ``low`` to ``high`` (Hz)."""
        from scipy.signal import sosfilt

        limits = JointSettings()
        band = band_filter(limits.band_low * low, limits.band_high * high, rate)
        settled = round(_SETTLING / band.low * rate)
        least = settled + round(_LEAST_PERIODS / low * rate)
        sizes = np.array([*map(len, inputs)])
        if sizes.min() < least:
            raise InputError(
                f"a transient lasts {1e3 * sizes.min() / rate:.0f} ms; a mode of {low:.4g} Hz needs "
                f"{1e3 * least / rate:.0f} ms or more."
            )
        index = np.arange(sizes.max())
        counted = (index >= settled) & (index < sizes[:, None])

        def filtered(records: Sequence[Array]) -> Array:
            return np.asarray(sosfilt(band.sections, padded([x - x[0] for x in records]), axis=1))

        return cls(rate, filtered(inputs), filtered(outputs), counted, np.ones(1))

    def residual(self, mode: Array) -> Array:
        """Whitened residual at (ln f, ln ζ) with the linear part solved, shape (transients, samples)."""
        target, columns = self._without_free_vibration(mode)
        flat = columns.reshape(-1, columns.shape[-1])
        basis = flat @ orthonormaliser(flat.T @ flat, _RANK_TOLERANCE)
        return target - (basis @ (basis.T @ target.ravel())).reshape(target.shape)

    def unexplained(self, mode: Array) -> float:
        """Power of the whitened residual over that of the whitened output."""
        power = float(np.sum(self._whitened(self.output) ** 2))
        return float(np.sum(self.residual(mode) ** 2)) / max(power, 1e-300)

    def searched(self, low: float, high: float) -> Array:
        """(ln f, ln ζ) of the grid that explain most of the output."""
        frequencies = np.arange(math.log(low), math.log(high) + _GRID, _GRID)
        trials = [np.array([f, math.log(damping)]) for f in frequencies for damping in _DAMPINGS]
        return min(trials, key=self.unexplained)

    def minimised(self, mode: Array) -> Array:
        """(ln f, ln ζ) of least squares."""
        from scipy.optimize import least_squares

        low, high = (-math.inf, math.log(_LIMITS[0])), (math.inf, math.log(_LIMITS[1]))

        def residual(at: Array) -> Array:
            return self.residual(at).ravel()

        found = least_squares(
            residual,
            np.clip(mode, low, high),
            bounds=(low, high),
            diff_step=(_STEP, _STEP),
            x_scale=(0.01, 0.3),
        )
        return np.asarray(found.x)

    def whitening(self, mode: Array) -> _OneMode:
        """The problem with a filter that whitens the residual at a mode."""
        residual = replace(self, taps=np.ones(1)).residual(mode)
        return replace(self, taps=whitening_filter(list(residual), JointSettings().floor))

    def jacobian(self, mode: Array) -> Array:
        """Derivatives of the residual by (ln f, ln ζ), shape (transients, samples, 2)."""
        steps = _STEP * np.eye(2)
        return np.stack(
            [(self.residual(mode + h) - self.residual(mode - h)) / (2 * _STEP) for h in steps], -1
        )

    def _without_free_vibration(self, mode: Array) -> tuple[Array, Array]:
        """Whitened output and columns, orthogonal to the free vibration of each transient.

        Shapes (transients, samples) and (transients, samples, 3).
        """
        from scipy.signal import lfilter

        w, damping = 2 * math.pi * math.exp(mode[0]), math.exp(mode[1])
        signals = [self.output, self.input]
        for numerator in ([w**2], [w, 0.0]):
            b, a = _discrete(numerator, [1.0, 2 * damping * w, w**2], 1 / self.rate)
            signals.append(lfilter(b, a, self.input, axis=1))
        time = np.arange(self.input.shape[1]) / self.rate
        wave = np.exp(-damping * w * time) * np.exp(1j * w * math.sqrt(1 - damping**2) * time)
        waves = np.broadcast_to(np.array([wave.real, wave.imag])[:, None], (2, *self.input.shape))
        free = np.linalg.qr(np.moveaxis(self._whitened(waves), 0, -1))[0]
        rows = np.moveaxis(self._whitened(np.array(signals)), 0, -1)
        rows = rows - free @ (np.swapaxes(free, 1, 2) @ rows)
        return rows[..., 0], rows[..., 1:]

    def _whitened(self, x: Array) -> Array:
        """Signals of all transients through the whitening filter, 0 where they are not fitted."""
        from scipy.signal import lfilter

        return np.asarray(lfilter(self.taps, np.ones(1), x) * self.counted)


def _discrete(numerator: Sequence[float], denominator: Sequence[float], step: float) -> tuple[Array, Array]:
    """Coefficients of a continuous system whose input is a ramp from sample to sample."""
    from scipy.signal import cont2discrete

    system: Any = (numerator, denominator)  # the stubs know no transfer functions of lists
    b, a, _ = cont2discrete(system, step, method="foh")
    return np.ravel(b), np.asarray(a)


def _result(problem: _OneMode, mode: Array) -> NaturalFrequency:
    """Mode with its uncertainty, by the scatter of periods and of transients."""
    f, damping = np.exp(mode).tolist()
    residual, jacobian = problem.residual(mode), problem.jacobian(mode)
    cuts = np.arange(0, residual.shape[1], round(problem.rate / f))[1:]
    by_period: list[tuple[Array, Array]] = []
    for own, part in zip(jacobian, residual, strict=True):
        by_period += zip(np.split(own, cuts), np.split(part, cuts), strict=True)
    settings, variance, count = JointSettings(), _variance(by_period), len(residual)
    if count >= _FEWEST:
        variance = np.maximum(variance, _variance([*zip(jacobian, residual, strict=True)]))
    u_f = math.hypot(math.sqrt(variance[0]), settings.model_floor)
    u_damping = math.sqrt(variance[1])
    unexplained = replace(problem, taps=np.ones(1)).unexplained(mode)
    reasons = []
    if unexplained > settings.most_unexplained:
        raise MeasurementError(
            f"no mode explains the output: at {f:.4g} Hz {percent(unexplained)} of its power is left."
        )
    if count < _FEWEST:
        reasons.append(
            f"{plural(count, 'transient')} cannot show errors that differ from one to the next; {_FEWEST} can"
        )
    if unexplained > _MOST_UNEXPLAINED:
        reasons.append(
            f"{percent(unexplained)} of the output's power is not explained: noise, a second mode, or a "
            "guide that sticks; cut the transients so that the axis moves throughout"
        )
    if damping > _MOST_DAMPING:
        reasons.append(
            f"the damping ratio is {damping:.2f}: too high for a resonance; are input and output exchanged?"
        )
    if u_f > settings.most_uncertainty:
        reasons.append(f"the standard uncertainty is above {100 * settings.most_uncertainty:g} %")
    return NaturalFrequency(
        frequency=Quantity(f, f * u_f, "Hz"),
        damping=Quantity(damping, damping * u_damping),
        unexplained=unexplained,
        transients=count,
        verdict="suspect" if reasons else "good",
        reasons=tuple(reasons),
    )


def _variance(clusters: Sequence[tuple[Array, Array]]) -> Array:
    """Variances of (ln f, ln ζ) by the scatter of independent clusters of samples.

    A sandwich estimator. The scores are those that the fit without the cluster would leave (CR3; Bell and
    McCaffrey 2002, Survey Methodology 28, 169), so that few clusters do not make the variance too small.
    """
    parts = [own.T @ own for own, _ in clusters]
    inverse = np.linalg.pinv(np.asarray(sum(parts)))
    total = np.zeros((2, 2))
    for (own, residual), part in zip(clusters, parts, strict=True):
        score = np.linalg.pinv(np.eye(2) - part @ inverse) @ (own.T @ residual)
        total += np.outer(score, score)
    return np.asarray(np.diag(inverse @ total @ inverse))


def _search_range(
    inputs: Sequence[Array], outputs: Sequence[Array], rate: float, band: tuple[Any, Any] | None
) -> tuple[float, float]:
    """Range in which the mode is looked for, Hz."""
    highest = rate / _LEAST_RATE
    if band is not None:
        try:
            low, high = (parse_named("the band", limit, "Hz") for limit in band)
        except (TypeError, ValueError):
            raise InputError(f"the band is {shown(band)}; it must be two frequencies.") from None
        if not 0 < low < high:
            raise InputError(f"the band is {low:g} to {high:g} Hz; it must rise, from above 0.")
        if high > highest:
            raise InputError(
                f"the band ends at {high:g} Hz; a rate of {rate:g} Hz suffices up to {highest:.4g} Hz."
            )
        return low, high
    shortest = min(map(len, inputs)) / rate
    spectra = averaged_spectra(inputs, outputs, rate, rate / max(map(len, inputs)))
    looked_at = (spectra.frequency > _LEAST_PERIODS / shortest) & (spectra.frequency < highest)
    looked_at &= spectra.uu > _LEAST_INPUT * spectra.uu.max()
    if not looked_at.any():
        raise InputError("the transients are too short or too slowly sampled for any mode.")
    magnitude = np.where(looked_at, np.abs(frf(spectra)[0]), 0.0)
    peak = float(spectra.frequency[int(np.argmax(magnitude))])
    return peak / _AROUND, min(peak * _AROUND, highest)


def _decimated(records: Sequence[Array], step: int) -> list[Array]:
    """Every ``step``-th sample, after a filter against aliases."""
    from scipy.signal import resample_poly

    if step == 1:
        return list(records)
    return [np.asarray(resample_poly(x, 1, step, padtype="line")) for x in records]
