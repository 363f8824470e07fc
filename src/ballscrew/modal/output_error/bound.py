"""The Cramér-Rao bound of a cell: the least scatter that any unbiased estimator can have on its records.

Source: S. M. Kay, *Fundamentals of Statistical Signal Processing: Estimation Theory*, ch. 3, ISBN
0-13-345711-7: with white noise σ on the response and a known force, the covariance is at least σ² (JᵀJ)⁻¹,
J the sensitivities of all samples to all parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from ballscrew.base.arrays import Array
from ballscrew.modal.output_error.plant import ModalPlant, free_decay, padded_lines, respond

__all__ = ["Bound", "cell_bound"]


@dataclass(frozen=True, slots=True)
class Bound:
    """Least standard deviations.

    Parameters
    ----------
    frequency : ndarray, shape (modes,)
        Hz.
    damping : ndarray, shape (modes,)
        Of the damping ratios.
    """

    frequency: Array
    damping: Array


def cell_bound(
    plant: ModalPlant,
    force: Array,
    rate: float,
    noise: float,
    *,
    initial: Array | None = None,
    drift: int = 1,
    delay: bool = True,
    phases: bool = False,
    band: tuple[float, float] | None = None,
    force_noise: float = 0.0,
) -> Bound:
    """Bound of a cell whose repetitions share the plant.

    Unknown besides the frequencies and dampings: the gains and the delay, shared; and of each record alone
    the ringing that it starts with and a drift.

    Parameters
    ----------
    plant : ModalPlant
        The truth.
    force : ndarray, shape (repetitions, samples)
        Of the cell, without noise.
    rate : float
        Samples per second, Hz.
    noise : float
        Standard deviation of the response's white noise.
    initial : ndarray, shape (repetitions, modes, 2), optional
        Cosine and sine of the ringing that each record starts with: it tells of the poles too. By default
        none.
    drift : int
        Degree of each record's unknown polynomial.
    delay : bool
        Whether the delay is unknown.
    phases : bool
        Whether each mode's residue may have any phase: for a plant without classical damping. That costs
        up to √2.
    band : tuple of float, optional
        Only what these lines hold, Hz: outside it a real axis is no such plant. By default the whole records.
    force_noise : float
        Standard deviation of white noise on the measured force. Seen through the plant it is noise on the
        response, the FRF's power times as strong (asymptotically, where it is small beside the force).

    Returns
    -------
    Bound
        In the order of the plant's modes.
    """
    samples = force.shape[-1]
    shared = respond(_sensitivities(plant, padded_lines(samples, rate), delay, phases), force)
    if initial is not None:
        slopes = np.array(
            [_decay_slopes(f, z, samples, rate) for f, z in zip(plant.frequency, plant.damping, strict=True)]
        )
        of_start = np.einsum("rmc,mkcn->mkrn", initial, slopes)
        shared[: 2 * len(slopes)] += of_start.reshape(-1, *force.shape)
    time = np.linspace(-1, 1, samples)
    decays = [free_decay(f, z, samples, rate) for f, z in zip(plant.frequency, plant.damping, strict=True)]
    own = np.concatenate([np.stack([time**k for k in range(drift + 1)]), *decays])
    shared, own = (_weighted(x, plant, rate, noise, band, force_noise) for x in (shared, own))
    # What a band cannot tell apart, as a constant and nothing, is dropped.
    left, size, _ = np.linalg.svd(own.T, full_matrices=False)
    basis = left[:, size > 1e-9 * size[0]]
    shared = shared - (shared @ basis) @ basis.T
    flat = shared.reshape(len(shared), -1)
    scale = np.linalg.norm(flat, axis=1)
    information = (flat / scale[:, None]) @ (flat / scale[:, None]).T
    deviation = np.sqrt(np.diag(np.linalg.inv(information))) / scale
    modes = len(plant.frequency)
    return Bound(deviation[0 : 2 * modes : 2], deviation[1 : 2 * modes : 2])


def _sensitivities(plant: ModalPlant, omega: Array, delay: bool, phases: bool) -> NDArray[np.complex128]:
    """Derivatives of H by frequency and damping of each mode, then by gains and by what else is unknown."""
    parts = plant.parts(omega)
    columns = []
    for frequency, damping, gain, part in zip(plant.frequency, plant.damping, plant.gain, parts, strict=True):
        natural = 2 * np.pi * frequency
        below = natural**2 - omega**2 + 2j * damping * natural * omega
        columns.append(-gain * part / below * (2 * natural + 2j * damping * omega) * 2 * np.pi)
        columns.append(-gain * part / below * 2j * natural * omega)
    columns += [*parts, np.ones_like(omega) + 0j]
    if phases:
        turned = zip(parts, plant.frequency, strict=True)
        columns += [1j * omega / (2 * np.pi * frequency) * part for part, frequency in turned]
    late = np.exp(-1j * omega * plant.delay)
    if delay:
        columns.append(-1j * omega * plant.transfer(omega) / late)
    return np.asarray(np.stack(columns) * late, dtype=np.complex128)


def _weighted(
    signal: Array,
    plant: ModalPlant,
    rate: float,
    noise: float,
    band: tuple[float, float] | None,
    force_noise: float,
) -> Array:
    """Lines in units of their noise, real and imaginary parts side by side."""
    samples = signal.shape[-1]
    frequency = fft.rfftfreq(samples, 1 / rate)
    low, high = band or (0.0, np.inf)
    inside = (frequency >= low) & (frequency <= high)
    power = noise**2 + (force_noise * np.abs(plant.transfer(2 * np.pi * frequency))) ** 2
    lines = fft.rfft(signal, axis=-1) * np.sqrt(2 / samples / power)
    lines[..., 0] /= np.sqrt(2)
    if samples % 2 == 0:
        lines[..., -1] /= np.sqrt(2)
    return np.ascontiguousarray(lines[..., inside]).view(np.float64)


def _decay_slopes(frequency: float, damping: float, samples: int, rate: float) -> tuple[Array, Array]:
    """Derivatives of a free decay by frequency and by damping, each of shape (2, samples)."""
    time = np.arange(samples) / rate
    cosine, sine = free_decay(frequency, damping, samples, rate)
    natural, root = 2 * np.pi * frequency, np.sqrt(1 - damping**2)
    turn = np.stack([-sine, cosine]) * time
    fall = -np.stack([cosine, sine]) * time
    by_natural = damping * fall + root * turn
    by_damping = natural * fall - natural * damping / root * turn
    return 2 * np.pi * by_natural, by_damping
