"""A linear plant of a few modes: its response to a force, in the time domain and at full rate.

It is what the Cramér-Rao bound is made of, and what benchmarks and tests ring; the estimator does not use it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from ballscrew.base.arrays import Array

__all__ = ["ModalPlant", "free_decay", "padded_lines", "respond"]

_PADDING = 4  # times the record's length, over which a response has died


@dataclass(frozen=True, slots=True)
class ModalPlant:
    """Acceleration per force of a structure with classical damping.

    H(ω) = e^(−iωτ) [rigid + Σ gain · (−ω²) / (ω_m² − ω² + 2iζω_mω)].

    Parameters
    ----------
    frequency : tuple of float
        Undamped natural frequencies, Hz.
    damping : tuple of float
        Damping ratios.
    gain : tuple of float
        Acceleration per force of each mode far above its frequency, 1/kg.
    rigid : float
        Acceleration per force of the whole, 1/kg.
    delay : float
        Of the response behind the force, s.
    """

    frequency: tuple[float, ...]
    damping: tuple[float, ...]
    gain: tuple[float, ...]
    rigid: float = 1.0
    delay: float = 0.0

    def parts(self, omega: Array) -> NDArray[np.complex128]:
        """Each mode's −ω²/(ω_m² − ω² + 2iζω_mω), shape (modes, n)."""
        natural = 2 * np.pi * np.asarray(self.frequency)[:, None]
        below = natural**2 - omega**2 + 2j * np.asarray(self.damping)[:, None] * natural * omega
        return np.asarray(-(omega**2) / below, dtype=np.complex128)

    def transfer(self, omega: Array) -> NDArray[np.complex128]:
        """H at angular frequencies, rad/s."""
        whole = self.rigid + np.asarray(self.gain) @ self.parts(omega)
        return np.asarray(np.exp(-1j * omega * self.delay) * whole, dtype=np.complex128)


def respond(transfer: NDArray[np.complex128], force: Array) -> Array:
    """Responses, from rest, to forces.

    Parameters
    ----------
    transfer : ndarray of complex, shape (..., lines)
        Transfer functions on the lines of :func:`padded_lines`.
    force : ndarray, shape (repetitions, samples)
        Nothing before and nothing after the record.

    Returns
    -------
    ndarray, shape (..., repetitions, samples)
        Of the record's length.
    """
    samples = force.shape[-1]
    size = _padded(samples)
    spectrum = fft.rfft(force, size)
    response = fft.irfft(transfer[..., None, :] * spectrum, size)
    return np.asarray(response[..., :samples], dtype=np.float64)


def padded_lines(samples: int, rate: float) -> Array:
    """Angular frequencies on which :func:`respond` wants its transfer functions, rad/s."""
    size = _padded(samples)
    return np.asarray(2 * np.pi * rate / size * np.arange(size // 2 + 1), dtype=np.float64)


def free_decay(frequency: float, damping: float, samples: int, rate: float) -> Array:
    """Cosine and sine of a mode that rings free, shape (2, samples)."""
    time = np.arange(samples) / rate
    natural = 2 * np.pi * frequency
    damped = natural * np.sqrt(1 - damping**2)
    fall = np.exp(-damping * natural * time)
    return np.stack([fall * np.cos(damped * time), fall * np.sin(damped * time)])


def _padded(samples: int) -> int:
    return fft.next_fast_len(_PADDING * samples, real=True)
