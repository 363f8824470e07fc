"""Rational model of Fourier coefficients, with modes, zeros and the transient of each record.

At the lines of the discrete Fourier transform of each record, with r integrations from input to output,

    Y = (B(s) U + T(s)) / (sʳ A(s)) + noise,

where A contains the modes in the band, B has two orders more than them (other modes, a delay), and the
polynomial T of each record is the effect of its beginning and end, so that no window is needed (Pintelon and
Schoukens, System Identification, 2nd ed., ch. 6, 10.1002/9781118287422). All are fitted by least squares with
weights by the residual, or with a reference as instrument (Gilson and Van den Hof 2005,
10.1016/j.automatica.2004.09.016).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from ballscrew.base.arrays import Array

Complex = NDArray[np.complex128]

LEAST_DAMPING, MOST_DAMPING = 1e-4, 0.3
"""Limits of the damping ratio."""

_EXTRA = 2  # orders of B and T beyond those of the modes
_MOST_MODES = 3
_DAMPINGS = (0.015, 0.05)  # tried in the search
_GRID = 0.03  # step of ln f in the search
_ROUNDS = 3  # of weighting
_ITERATIONS = 40
_CONVERGED = 1e-6  # step of ln f, ten times below the least standard uncertainty
_STEPS = np.array([[0.05], [0.5]])  # longest, of ln f and ln ζ
_SMOOTHED = 16  # parts of the band in which the power of the noise is constant
_RATIO_LINES = 100  # part of the lines over which the ratio of input and reference is smoothed
_FEWEST_SMOOTHED = 9
_LEVERAGE = 0.1  # least of one minus the leverage
_RANK = 1e-12


@dataclass(frozen=True, slots=True)
class FourierLines:
    """Fourier coefficients of all records in a band.

    Parameters
    ----------
    frequency : ndarray, shape (n,)
        Hz.
    record : ndarray of int, shape (n,)
        Record of each line, from 0.
    input, output : ndarray of complex, shape (n,)
        Amplitudes.
    instrument : ndarray of complex, shape (n,) or None
        The input as far as it follows a reference; None without a reference.
    integrations : int
        From input to output.
    """

    frequency: Array
    record: NDArray[np.intp]
    input: Complex
    output: Complex
    instrument: Complex | None
    integrations: int

    @classmethod
    def of(
        cls,
        signals: Sequence[tuple[Array, ...]],
        rate: float,
        band: tuple[float, float],
        integrations: int,
    ) -> FourierLines:
        """FourierLines of records from the first to the second frequency of a band, Hz.

        Parameters
        ----------
        signals : sequence of (input, output) or (input, output, reference)
            Samples of each record.
        rate : float
            Hz.
        band : tuple of float
            Hz.
        integrations : int
            From input to output.
        """
        frequencies, records, spectra = [], [], []
        for index, record in enumerate(signals):
            frequency = fft.rfftfreq(len(record[0]), 1 / rate)
            inside = (frequency >= band[0]) & (frequency <= band[1])
            frequencies.append(frequency[inside])
            records.append(np.full(np.count_nonzero(inside), index))
            spectra.append([fft.rfft(x - x.mean())[inside] / len(x) for x in record])
        line, rows = np.concatenate(frequencies), np.concatenate(spectra, axis=1)
        instrument = None
        if len(rows) > 2:
            instrument = _following(rows[0], rows[2], line)
        return cls(line, np.concatenate(records), rows[0], rows[1], instrument, integrations)

    @property
    def scale(self) -> float:
        """Frequency in which s has the size 1, Hz."""
        return float(np.sqrt(self.frequency.min() * self.frequency.max()))


def _following(input: Complex, reference: Complex, frequency: Array) -> Complex:  # noqa: A002
    """Part of the input that follows the reference, by a response that is smooth over the frequency."""
    order = np.argsort(frequency, kind="stable")
    size = max(_FEWEST_SMOOTHED, len(order) // _RATIO_LINES)
    cross = (input * reference.conj())[order]
    power = ndimage.uniform_filter1d((np.abs(reference) ** 2)[order], size)
    smooth = ndimage.uniform_filter1d(cross.real, size) + 1j * ndimage.uniform_filter1d(cross.imag, size)
    response = np.empty_like(reference)
    response[order] = smooth / np.maximum(power, 1e-300)
    return np.asarray(response * reference)


@dataclass(frozen=True, slots=True)
class RationalFit:
    """Rational model of lines.

    Parameters
    ----------
    lines : FourierLines
        What was fitted.
    modes : ndarray, shape (2, modes)
        ln of the frequency over the lines' scale, ln of the damping ratio.
    weights : ndarray, shape (n,)
        One over the standard deviation of the noise at each line.
    coefficients : ndarray
        Of B, then of T of each record, by rising powers of s.
    """

    lines: FourierLines
    modes: Array
    weights: Array
    coefficients: Array

    @property
    def orders(self) -> int:
        """Coefficients of B."""
        return 2 * int(self.modes.shape[1]) + 1 + _EXTRA

    @property
    def frequencies(self) -> Array:
        """Undamped natural frequencies of the modes, Hz."""
        return np.asarray(np.exp(self.modes[0]) * self.lines.scale)

    @property
    def dampings(self) -> Array:
        """Damping ratios of the modes."""
        return np.asarray(np.exp(self.modes[1]))

    @property
    def residual(self) -> Complex:
        """Output less prediction, shape (n,)."""
        return np.asarray(self.lines.output - self._columns(self.lines.input) @ self.coefficients)

    @property
    def cost(self) -> float:
        """Weighted power of the residual."""
        return float(np.sum(np.abs(self.weights * self.residual) ** 2))

    def response(self, frequency: Array) -> Complex:
        """Frequency response of the model.

        Parameters
        ----------
        frequency : ndarray, shape (n,)
            Hz.
        """
        s = 1j * frequency / self.lines.scale
        numerator = np.polyval(self.coefficients[: self.orders][::-1], s)
        return np.asarray(numerator / (s**self.lines.integrations * np.prod(self._quadratics(s), axis=0)))

    def transients(self) -> Complex:
        """Effect of the beginning and end of the records on the output, shape (n,)."""
        columns = self._columns(self.lines.input)[:, self.orders :]
        return np.asarray(columns @ self.coefficients[self.orders :])

    def modal_constants(self) -> Complex:
        """Modal constant of each mode in the response of the acceleration, up to a common factor.

        Real and positive for a force and a motion at the same place: one over the mass of the mode.
        """
        w, damping = np.exp(self.modes)
        poles = w * (-damping + 1j * np.sqrt(1 - damping**2))
        constants = np.empty(len(w), dtype=np.complex128)
        for index, pole in enumerate(poles):
            others = np.delete(self._quadratics(pole[None])[:, 0], index)
            numerator = np.polyval(self.coefficients[: self.orders][::-1], pole)
            residue = numerator / (2j * pole.imag * np.prod(others))
            constants[index] = residue * 2j * pole.imag / pole**2
        return constants

    def zeros(self) -> list[tuple[float, float, float]]:
        """Zeros of B in the upper half of the plane: frequency, its standard uncertainty (Hz), damping."""
        b = self.coefficients[: self.orders]
        modes = self.modes.size
        covariance = self.covariance()[modes : modes + self.orders, modes : modes + self.orders]
        powers, found = np.arange(self.orders), []
        for zero in np.roots(b[::-1]):
            if not zero.imag > 0:
                continue
            slope = np.polyval((b[1:] * powers[1:])[::-1], zero)
            moved = np.real(zero.conj() / abs(zero) * -(zero**powers) / slope)
            spread = math.sqrt(max(float(moved @ covariance @ moved), 0.0))
            scale = self.lines.scale
            found.append((float(abs(zero)) * scale, spread * scale, float(-zero.real / abs(zero))))
        return sorted(found)

    def covariance(self) -> Array:
        """Covariance of ln f and ln ζ of all modes and of the coefficients.

        By the residual of each line over one minus its leverage (HC3; MacKinnon and White 1985,
        10.1016/0304-4076(85)90158-7).
        """
        jacobian, instruments, residual = self._stacked()
        scale = _lengths(jacobian)
        jacobian, instruments = jacobian / scale, instruments / scale
        bread = np.linalg.pinv(instruments.T @ jacobian)
        leverage = np.einsum("ij,jk,ik->i", jacobian, bread, instruments)
        scores = instruments * (residual / np.clip(1 - leverage, _LEVERAGE, 1.0))[:, None]
        half = bread @ scores.T
        return np.asarray(half @ half.T / np.outer(scale, scale))

    def solved(self) -> RationalFit:
        """The fit with the coefficients that belong to its modes."""
        columns = _real(self._columns(self.lines.input), self.weights)
        instruments = columns
        if self.lines.instrument is not None:
            instruments = _real(self._columns(self.lines.instrument), self.weights)
        output = _real(self.lines.output[:, None], self.weights)[:, 0]
        return replace(self, coefficients=_solve(instruments, columns, output))

    def minimised(self) -> RationalFit:
        """The fit after iterations by Gauss and Newton, or with the instrument."""
        fit = self.solved()
        for _ in range(_ITERATIONS):
            jacobian, instruments, residual = fit._stacked()
            step = _solve(instruments, jacobian, residual)[: fit.modes.size].reshape(fit.modes.shape)
            step = np.clip(step, -_STEPS, _STEPS)
            trial = fit._moved(step)
            if fit.lines.instrument is None:
                while trial.cost > fit.cost and np.abs(step).max() > _CONVERGED:
                    step = step / 3
                    trial = fit._moved(step)
            fit = trial
            if np.abs(step[0]).max() < _CONVERGED:
                break
        return fit

    def weighted(self) -> RationalFit:
        """The fit of least squares with weights by the power of its residual, smooth over the frequency."""
        fit = self
        for _ in range(_ROUNDS):
            order = np.argsort(fit.lines.frequency, kind="stable")
            power = np.abs(fit.residual[order]) ** 2
            size = min(max(2 * len(fit.coefficients), len(power) // _SMOOTHED), len(power))
            smooth = np.empty_like(power)
            smooth[order] = ndimage.uniform_filter1d(power, size)
            floor = _RANK * float(np.mean(np.abs(fit.lines.output) ** 2)) + 1e-300
            fit = replace(fit, weights=1 / np.sqrt(smooth + floor)).minimised()
        return fit

    def _moved(self, step: Array) -> RationalFit:
        """The fit with other modes."""
        modes = self.modes + step
        modes[1] = np.clip(modes[1], math.log(LEAST_DAMPING), math.log(MOST_DAMPING))
        return replace(self, modes=modes).solved()

    def _quadratics(self, s: NDArray[Any]) -> Complex:
        """s² + 2ζωs + ω² of each mode, shape (modes, n)."""
        w, damping = np.exp(self.modes)[:, :, None]
        return np.asarray(s**2 + 2 * damping * w * s + w**2)

    def _columns(self, input: Complex) -> Complex:  # noqa: A002
        """Columns of the linear part, shape (n, coefficients)."""
        s = 1j * self.lines.frequency / self.lines.scale
        common = 1 / (s**self.lines.integrations * np.prod(self._quadratics(s), axis=0))
        parts = [np.vander(s, self.orders, increasing=True) * (common * input)[:, None]]
        powers = np.vander(s, self.orders - 1 + self.lines.integrations, increasing=True)
        records = range(int(self.lines.record.max()) + 1)
        parts += [powers * (common * (self.lines.record == record))[:, None] for record in records]
        return np.concatenate(parts, axis=1)

    def _jacobian(self, input: Complex) -> Complex:  # noqa: A002
        """Derivatives of the prediction with respect to ln f and ln ζ of all modes and the coefficients."""
        s = 1j * self.lines.frequency / self.lines.scale
        w, damping = np.exp(self.modes)[:, :, None]
        by_damping = 2 * damping * w * s / self._quadratics(s)
        by_frequency = by_damping + 2 * w**2 / self._quadratics(s)
        columns = self._columns(input)
        of_modes = -np.concatenate([by_frequency, by_damping]) * (columns @ self.coefficients)
        return np.concatenate([of_modes.T, columns], axis=1)

    def _stacked(self) -> tuple[Array, Array, Array]:
        """Jacobian, its instruments and the residual, weighted, real above imaginary parts."""
        jacobian = _real(self._jacobian(self.lines.input), self.weights)
        instruments = jacobian
        if self.lines.instrument is not None:
            instruments = _real(self._jacobian(self.lines.instrument), self.weights)
        return jacobian, instruments, _real(self.residual[:, None], self.weights)[:, 0]


def fit_modes(lines: FourierLines, low: float, high: float) -> RationalFit:
    """Fit the mode from ``low`` to ``high`` (Hz), and others beside it as far as the data show them.

    Another mode is added where it improves the information criterion of Schwarz (1978).
    """
    free = replace(lines, instrument=None)
    start = RationalFit(free, np.empty((2, 0)), np.ones(len(lines.frequency)), np.empty(0))
    fit = _added(start, low, high).minimised().weighted()
    count = 2 * len(lines.frequency)
    while fit.modes.shape[1] < _MOST_MODES:
        more = _added(fit, float(lines.frequency.min()), float(lines.frequency.max())).minimised()
        added = len(more.coefficients) - len(fit.coefficients) + 2
        if not count * math.log(fit.cost / max(more.cost, 1e-300)) > added * math.log(count):
            break
        fit = more.weighted()
    if lines.instrument is not None:
        fit = replace(fit, lines=lines).minimised().weighted()
    return fit


def _added(fit: RationalFit, low: float, high: float) -> RationalFit:
    """The fit with another mode, the best of a grid."""
    offset = math.log(fit.lines.scale)
    best, least = fit, math.inf
    for frequency in np.arange(math.log(low), math.log(high) + _GRID, _GRID) - offset:
        for damping in _DAMPINGS:
            mode = np.array([[frequency], [math.log(damping)]])
            trial = replace(fit, modes=np.concatenate([fit.modes, mode], axis=1)).solved()
            cost = trial.cost
            if cost < least:
                best, least = trial, cost
    return best


def _real(columns: Complex, weights: Array) -> Array:
    """Real above imaginary parts of weighted columns, shape (2 n, columns)."""
    weighted = columns * weights[:, None]
    return np.concatenate([weighted.real, weighted.imag])


def _lengths(columns: Array) -> Array:
    """Length of each column; 1 of a column of zeros, whose coefficient is then 0."""
    lengths = np.linalg.norm(columns, axis=0)
    return np.where(lengths > 0, lengths, 1.0)


def _solve(instruments: Array, columns: Array, target: Array) -> Array:
    """Solution b of Zᵀ X b = Zᵀ y: that of least squares where Z is X."""
    basis = np.linalg.qr(instruments / _lengths(instruments))[0]
    scale = _lengths(columns)
    return np.asarray(np.linalg.lstsq(basis.T @ (columns / scale), basis.T @ target, rcond=_RANK)[0] / scale)
