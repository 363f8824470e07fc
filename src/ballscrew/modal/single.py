"""Frequency response and natural frequency of one input and one output, from arrays.

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
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import xarray as xr

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, MeasurementError
from ballscrew.base.quantity import Quantity
from ballscrew.base.threads import single_threaded
from ballscrew.base.units import parse
from ballscrew.base.words import percent
from ballscrew.modal.joint.blocks import orthonormaliser
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.joint.windows import band_filter
from ballscrew.modal.spectra import Spectra, averaged, coherence
from ballscrew.modal.spectra import frf as estimate_frf

_LEAST_PERIODS = 4.0  # of the mode in a transient
_LEAST_RATE = 16.0  # samples per period: with fewer, ramps between samples attenuate the mode by 1.3 % or more
_RATE = 32.0  # samples per period to which signals are decimated
_AROUND = 1.5  # range around the highest peak of the FRF
_STEP = 1e-4  # of ln f and ln ζ, for difference quotients
_SETTLING = 0.4  # of a period of the band's lower limit: not fitted, since the filter settles
_DAMPINGS = (0.005, 0.02, 0.06)  # ratios tried
_GRID = 0.02  # step of ln ω in the search
_LIMITS = (1e-4, 0.5)  # of the damping ratio
_WHITENING_ORDER = 8
_ROUNDS = 2  # of whitening
_RANK_TOLERANCE = 1e-10
_LEAST_INPUT = 1e-6  # of the input's largest power: the response is not looked at where there is less
_FEWEST_SAMPLES = 16
_FEWEST = 3  # transients whose scatter shows errors of the model

Records = Any


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """Frequency response of one input and one output.

    Parameters
    ----------
    frequency : ndarray, shape (n,)
        Hz.
    frf : ndarray of complex, shape (n,)
        Output per input.
    coherence : ndarray, shape (n,)
        0 to 1; NaN for a single record, whose coherence is 1 whatever it is.
    estimator : str
        H1, H2 or Hv.
    count : int
        Records averaged.
    """

    frequency: Array
    frf: np.ndarray[Any, np.dtype[np.complex128]]
    coherence: Array
    estimator: str
    count: int

    def to_xarray(self) -> xr.Dataset:
        """FRF and coherence over frequency."""
        return xr.Dataset(
            {"frf": ("frequency", self.frf), "coherence": ("frequency", self.coherence)},
            coords={"frequency": ("frequency", self.frequency, {"units": "Hz"})},
            attrs={"estimator": self.estimator, "records": self.count},
        )


@dataclass(frozen=True, slots=True)
class NaturalFrequency:
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
    """

    frequency: Quantity
    damping: Quantity
    unexplained: float
    transients: int
    verdict: Literal["good", "suspect"]
    reasons: tuple[str, ...] = ()


def frf(
    input: Records,  # noqa: A002
    output: Records,
    sample_rate: float | str,
    *,
    estimator: Literal["H1", "H2", "Hv"] = "H1",
    resolution: float | str | None = None,
) -> FrequencyResponse:
    """Frequency response of one input and one output, averaged over records.

    Parameters
    ----------
    input, output : array-like
        One record, shape (samples,), or several, shape (records, samples) or a sequence of records.
    sample_rate : float or str
        Hz, or with a unit: ``"12.8 kHz"``.
    estimator : {"H1", "H2", "Hv"}
        H1 suits noise in the output, H2 noise in the input, Hv both.
    resolution : float or str, optional
        Spacing of the frequencies; by default that of the longest record.

    Returns
    -------
    FrequencyResponse
        From the first line above 0 to half of the sample rate. Records are not windowed: each should begin
        and end at rest, or be multiplied by a window that the caller chooses.

    Raises
    ------
    InputError
        If input and output do not belong together, or have values that are not finite.

    References
    ----------
    J. S. Bendat and A. G. Piersol, *Random Data*, 4th ed., ch. 6 and 7, 10.1002/9781118032428.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> force = rng.normal(size=(4, 1000))
    >>> response = ballscrew.frf(force, 2 * force, "1 kHz")
    >>> bool(np.allclose(response.frf, 2))
    True
    """
    rate = _rate(sample_rate)
    inputs, outputs = _records(input, output)
    length = max(map(len, inputs))
    step = rate / length if resolution is None else parse(resolution, "Hz")
    spectra = _spectra(inputs, outputs, rate, step)
    known = spectra.count > 1
    return FrequencyResponse(
        spectra.frequency,
        estimate_frf(spectra, estimator)[0],
        coherence(spectra)[0] if known else np.full(len(spectra.frequency), math.nan),
        estimator,
        spectra.count,
    )


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
        sequence of transients. Each may begin in motion; the guide must not stick in it.
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
    rate = _rate(sample_rate)
    inputs, outputs = _records(input, output)
    low, high = _search_range(inputs, outputs, rate, band)
    step = max(1, math.floor(rate / (_RATE * high)))
    inputs, outputs = _decimated(inputs, step), _decimated(outputs, step)
    f, damping = _Problem.of(inputs, outputs, rate / step, low, high).searched(low, high)
    problem = _Problem.of(inputs, outputs, rate / step, f, f)
    mode = np.log([f, damping])
    for _ in range(_ROUNDS):
        mode = problem.minimised(mode)
        problem = problem.whitening(mode)
    mode = problem.minimised(mode)
    if not low <= math.exp(mode[0]) <= high:
        raise MeasurementError(
            f"no mode was found from {low:.4g} to {high:.4g} Hz; state the band in which it is expected."
        )
    return _result(problem, mode)


@dataclass(frozen=True, slots=True)
class _Problem:
    """Transients in the band around a mode, with the filter that whitens their residuals.

    Parameters
    ----------
    rate : float
        Hz.
    inputs, outputs : tuple of ndarray
        Of each transient, in the band.
    settled : int
        First sample that is fitted.
    taps : ndarray
        Of the whitening filter.
    """

    rate: float
    inputs: tuple[Array, ...]
    outputs: tuple[Array, ...]
    settled: int
    taps: Array

    @classmethod
    def of(
        cls, inputs: Sequence[Array], outputs: Sequence[Array], rate: float, low: float, high: float
    ) -> _Problem:
        """Transients through the filter of the band around modes from ``low`` to ``high`` (Hz)."""
        from scipy.signal import sosfilt

        limits = JointSettings()
        band = band_filter(limits.band_low * low, limits.band_high * high, rate)

        def filtered(records: Sequence[Array]) -> tuple[Array, ...]:
            return tuple(np.asarray(sosfilt(band.sections, x - x[0])) for x in records)

        settled = round(_SETTLING / band.low * rate)
        least = settled + round(_LEAST_PERIODS / low * rate)
        shortest = min(map(len, inputs))
        if shortest < least:
            raise InputError(
                f"a transient lasts {1e3 * shortest / rate:.0f} ms; a mode of {low:.4g} Hz needs "
                f"{1e3 * least / rate:.0f} ms or more."
            )
        return cls(rate, filtered(inputs), filtered(outputs), settled, np.ones(1))

    def residuals(self, mode: Array) -> list[Array]:
        """Whitened residual of each transient at (ln f, ln ζ), with the linear part solved."""
        pairs = [
            self._without_free_vibration(mode, u, y) for u, y in zip(self.inputs, self.outputs, strict=True)
        ]
        columns = np.concatenate([own for _, own in pairs])
        basis = columns @ orthonormaliser(columns.T @ columns, _RANK_TOLERANCE)
        weights = basis.T @ np.concatenate([target for target, _ in pairs])
        parts = np.split(basis @ weights, np.cumsum([len(target) for target, _ in pairs])[:-1])
        return [target - part for (target, _), part in zip(pairs, parts, strict=True)]

    def unexplained(self, mode: Array) -> float:
        """Power of the whitened residuals over that of the whitened outputs."""
        power = sum(float(np.sum(self._whitened(y) ** 2)) for y in self.outputs)
        return sum(float(r @ r) for r in self.residuals(mode)) / max(power, 1e-300)

    def searched(self, low: float, high: float) -> tuple[float, float]:
        """Frequency (Hz) and damping ratio of the grid that explain most of the outputs."""
        frequencies = np.exp(np.arange(math.log(low), math.log(high) + _GRID, _GRID))
        trials = [(float(f), damping) for f in frequencies for damping in _DAMPINGS]
        return min(trials, key=lambda trial: self.unexplained(np.log(trial)))

    def minimised(self, mode: Array) -> Array:
        """(ln f, ln ζ) of least squares."""
        from scipy.optimize import least_squares

        limits = np.log(_LIMITS)
        found = least_squares(
            lambda at: np.concatenate(self.residuals(at)),
            np.clip(mode, (-math.inf, limits[0]), (math.inf, limits[1])),
            bounds=((-math.inf, limits[0]), (math.inf, limits[1])),
            diff_step=_STEP,
            x_scale=(0.01, 0.3),
        )
        return np.asarray(found.x)

    def whitening(self, mode: Array) -> _Problem:
        """The problem with a filter that whitens the residual at a mode."""
        from scipy.linalg import solve_toeplitz

        residuals = replace(self, taps=np.ones(1)).residuals(mode)
        lags = range(_WHITENING_ORDER + 1)
        covariance = np.array([sum(float(r[k:] @ r[: len(r) - k]) for r in residuals) for k in lags])
        if not covariance[0] > 0:
            return self
        covariance[0] *= 1 + JointSettings().floor
        taps = np.concatenate([[1.0], -solve_toeplitz(covariance[:-1], covariance[1:])])
        return replace(self, taps=taps)

    def jacobian(self, mode: Array) -> list[Array]:
        """Derivatives of the residuals by (ln f, ln ζ), shape (samples, 2) each."""
        sides = []
        for k in range(2):
            step = np.zeros(2)
            step[k] = _STEP
            above, below = self.residuals(mode + step), self.residuals(mode - step)
            sides.append([(a - b) / (2 * _STEP) for a, b in zip(above, below, strict=True)])
        return [np.column_stack(pair) for pair in zip(*sides, strict=True)]

    def _without_free_vibration(self, mode: Array, u: Array, y: Array) -> tuple[Array, Array]:
        """Whitened output and columns of a transient, both orthogonal to its free vibration."""
        from scipy.signal import lfilter

        w, damping = 2 * math.pi * math.exp(mode[0]), math.exp(mode[1])
        rows = [u]
        for numerator in ([w**2], [w, 0.0]):
            b, a = _discrete(numerator, [1.0, 2 * damping * w, w**2], 1 / self.rate)
            rows.append(lfilter(b, a, u))
        time = np.arange(len(u)) / self.rate
        decay = np.exp(-damping * w * time)
        damped = w * math.sqrt(1 - damping**2) * time
        free = np.column_stack([self._whitened(decay * wave(damped)) for wave in (np.cos, np.sin)])
        free = np.linalg.qr(free)[0]
        target, columns = self._whitened(y), np.column_stack([self._whitened(row) for row in rows])
        return target - free @ (free.T @ target), columns - free @ (free.T @ columns)

    def _whitened(self, x: Array) -> Array:
        """Signal of a transient through the whitening filter, from the first sample that is fitted."""
        from scipy.signal import lfilter

        return np.asarray(lfilter(self.taps, 1.0, x)[self.settled :])


def _discrete(numerator: Sequence[float], denominator: Sequence[float], step: float) -> tuple[Array, Array]:
    """Coefficients of a continuous system whose input is a ramp from sample to sample."""
    from scipy.signal import cont2discrete

    b, a, _ = cont2discrete((numerator, denominator), step, method="foh")
    return np.ravel(b), np.asarray(a)


def _result(problem: _Problem, mode: Array) -> NaturalFrequency:
    """Mode with its uncertainty, by the scatter of periods and of transients (a sandwich estimator)."""
    f, damping = np.exp(mode)
    residuals, jacobian = problem.residuals(mode), problem.jacobian(mode)
    by_transient = list(zip(jacobian, residuals, strict=True))
    by_period = []
    for own, residual in by_transient:
        cuts = np.arange(0, len(residual), round(problem.rate / f))[1:]
        by_period += zip(np.split(own, cuts), np.split(residual, cuts), strict=True)
    variance = _variance(by_period)
    count = len(residuals)
    if count >= _FEWEST:
        variance = np.maximum(variance, _variance(by_transient))
    u_f, u_damping = np.sqrt(variance + (JointSettings().model_floor**2, 0.0))
    unexplained = replace(problem, taps=np.ones(1)).unexplained(mode)
    settings, reasons = JointSettings(), []
    if unexplained > settings.most_unexplained:
        raise MeasurementError(
            f"no mode explains the output: at {f:.4g} Hz {percent(unexplained)} of its power is left."
        )
    if count < _FEWEST:
        reasons.append(
            f"{count} transients do not show errors that differ from one to the next; {_FEWEST} or more do"
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
        low, high = (parse(limit, "Hz") for limit in band)
        if not 0 < low < high:
            raise InputError(f"the band is {low:g} to {high:g} Hz; it must rise, from above 0.")
        if high > highest:
            raise InputError(
                f"the band ends at {high:g} Hz; a rate of {rate:g} Hz suffices for modes up to {highest:.4g} Hz."
            )
        return low, high
    shortest = min(map(len, inputs)) / rate
    spectra = _spectra(inputs, outputs, rate, rate / max(map(len, inputs)))
    looked_at = (spectra.frequency > _LEAST_PERIODS / shortest) & (spectra.frequency < highest)
    looked_at &= spectra.uu > _LEAST_INPUT * spectra.uu.max()
    if not looked_at.any():
        raise InputError("the transients are too short or too slowly sampled for any mode.")
    magnitude = np.where(looked_at, np.abs(estimate_frf(spectra)[0]), 0.0)
    peak = float(spectra.frequency[int(np.argmax(magnitude))])
    return peak / _AROUND, min(peak * _AROUND, highest)


def _spectra(inputs: Sequence[Array], outputs: Sequence[Array], rate: float, step: float) -> Spectra:
    """Average of records, the shorter ones continued by zeros."""
    length = max(map(len, inputs))

    def padded(records: Sequence[Array]) -> Array:
        return np.array([np.pad(x, (0, length - len(x))) for x in records])

    return averaged(padded(inputs), padded(outputs)[None], rate, (step / 2, rate / 2), step)


def _decimated(records: Sequence[Array], step: int) -> list[Array]:
    """Every ``step``-th sample, after a filter against aliases."""
    from scipy.signal import resample_poly

    if step == 1:
        return list(records)
    return [np.asarray(resample_poly(x, 1, step, padtype="line")) for x in records]


def _rate(sample_rate: float | str) -> float:
    rate = parse(sample_rate, "Hz")
    if not 0 < rate < math.inf:
        raise InputError(f"the sample rate is {rate:g} Hz; it must be finite and more than 0.")
    return rate


def _records(input: Records, output: Records) -> tuple[list[Array], list[Array]]:  # noqa: A002
    """Records of input and output, checked."""
    inputs, outputs = _rows("input", input), _rows("output", output)
    sizes, others = [*map(len, inputs)], [*map(len, outputs)]
    if sizes != others:
        raise InputError(
            f"input and output must have the same number of samples in every record; they have {sizes} and "
            f"{others}."
        )
    return inputs, outputs


def _rows(name: str, given: Records) -> list[Array]:
    """Records of a signal, in float64."""
    several = isinstance(given, list | tuple) and len(given) > 0 and np.ndim(given[0]) == 1
    try:
        rows = [np.asarray(row, dtype=np.float64) for row in (given if several else [given])]
    except (TypeError, ValueError):
        raise InputError(f"the {name} must be numbers, of shape (samples,) or (records, samples).") from None
    if not several and rows[0].ndim == 2:
        rows = list(rows[0])
    for row in rows:
        if row.ndim != 1 or row.size < _FEWEST_SAMPLES:
            raise InputError(
                f"a record of the {name} has shape {row.shape}; it must be one row of {_FEWEST_SAMPLES} "
                "samples or more."
            )
        if not np.isfinite(row).all():
            raise InputError(f"the {name} has values that are not finite.")
    return rows
