"""The model of a cell: resonators, residual terms, a delay, and what a record starts and ends with.

On the lines of a record that was not windowed, Y = H U + T. H, shared by the repetitions, is a sum of
functions with real factors:

* classical: e^(−iωτ) [b₀ + b₂ ω² + Σ g_m ω²/D_m], D_m = ω_m² − ω² + 2iζ_m ω_m ω: one real factor a mode, as
  a structure with classical damping has in its accelerations, and a delay τ;
* prompt: the same with a delay that is known;
* general: b₀ + b₁ iω + b₂ ω² + Σ (g_m + h_m iω)/D_m: any phase of a residue; a delay hides in the phases.

T, each record's own, is (α_m + β_m iω)/D_m for the ringing it starts with and ends in, and a few powers of iω
for drift and for what happens outside the band: for a linear plant that is exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "DELAY_UNIT",
    "STRUCTURES",
    "Poles",
    "Structure",
    "forced",
    "forced_slopes",
    "transient",
    "transient_slopes",
]

Structure = Literal["prompt", "classical", "general"]
STRUCTURES: tuple[Structure, ...] = ("prompt", "classical", "general")
Complex = NDArray[np.complex128]
Real = NDArray[np.float64]
DELAY_UNIT = 1e-3  # s: in it a delay moves about as far as the logarithms do


@dataclass(frozen=True, slots=True)
class Poles:
    """What the model is not linear in.

    Parameters
    ----------
    frequency : ndarray, shape (modes,)
        Undamped natural frequencies, Hz.
    damping : ndarray, shape (modes,)
        Damping ratios.
    delay : float
        Of the response behind the force, s; 0 in the general structure.
    structure : {"prompt", "classical", "general"}
        Of H.
    """

    frequency: Real
    damping: Real
    delay: float = 0.0
    structure: Structure = "classical"

    @property
    def vector(self) -> Real:
        """Logarithms of all f, then of all ζ, and, in the classical structure, the delay in ms."""
        logs = np.log(np.concatenate([self.frequency, self.damping]))
        return np.append(logs, self.delay / DELAY_UNIT) if self.structure == "classical" else logs

    def moved(self, step: Real) -> Poles:
        """The same after a step of the vector."""
        count = len(self.frequency)
        late = self.delay + float(step[-1]) * DELAY_UNIT if self.structure == "classical" else self.delay
        return replace(
            self,
            frequency=self.frequency * np.exp(step[:count]),
            damping=self.damping * np.exp(step[count : 2 * count]),
            delay=late,
        )


def below(poles: Poles, omega: Real) -> Complex:
    """D_m, scaled to 1 at ω = 0, shape (modes, n)."""
    r = omega / (2 * np.pi * poles.frequency[:, None])
    return np.asarray(1 - r**2 + 2j * poles.damping[:, None] * r, dtype=np.complex128)


def forced(poles: Poles, omega: Real) -> Complex:
    """Functions that H is a sum of, shape (functions, n), of the size of one."""
    d = below(poles, omega)
    x = omega / omega[-1]
    if poles.structure == "general":
        return np.concatenate([np.stack([np.ones_like(x) + 0j, 1j * x, x**2 + 0j]), 1 / d, 1j * x / d])
    late = np.exp(-1j * omega * poles.delay)
    r = x * omega[-1] / (2 * np.pi * poles.frequency[:, None])
    return np.asarray(np.concatenate([np.stack([np.ones_like(x), x**2]), r**2 / d]) * late)


def forced_slopes(poles: Poles, omega: Real, factor: Real) -> Complex:
    """Derivatives of H, at given factors, by :attr:`Poles.vector`: shape (parameters, n)."""
    d = below(poles, omega)
    count = len(poles.frequency)
    x = omega / omega[-1]
    r = omega / (2 * np.pi * poles.frequency[:, None])
    z = poles.damping[:, None]
    # dD/d ln f = −r dD/dr, and r² itself moves with f.
    d_frequency, d_damping = 2 * r**2 - 2j * z * r, 2j * z * r
    if poles.structure == "general":
        top = factor[3 : 3 + count, None] + 1j * x * factor[3 + count :, None]
        return np.asarray(np.concatenate([-top / d**2 * d_frequency, -top / d**2 * d_damping]))
    late = np.exp(-1j * omega * poles.delay)
    top = factor[2:, None] * r**2
    whole = factor @ forced(poles, omega)
    slopes = np.concatenate([-top / d**2 * d_frequency - 2 * top / d, -top / d**2 * d_damping]) * late
    if poles.structure == "prompt":
        return np.asarray(slopes)
    return np.concatenate([slopes, (-1j * omega * whole * DELAY_UNIT)[None]])


def transient(poles: Poles, omega: Real) -> Complex:
    """Functions that T is a sum of, shape (functions, n)."""
    d = below(poles, omega)
    x = omega / omega[-1]
    smooth = np.stack([-(x**-2) + 0j, -1j / x, np.ones_like(x) + 0j, 1j * x])  # powers −2 … 1 of iω
    return np.concatenate([smooth, 1 / d, 1j * x / d])


def transient_slopes(poles: Poles, omega: Real) -> Complex:
    """Derivatives of the functions of T's modes by ln f and ln ζ: shape (2 modes, 2, n).

    The second axis is that of α and β.
    """
    d = below(poles, omega)
    x = omega / omega[-1]
    r = omega / (2 * np.pi * poles.frequency[:, None])
    z = poles.damping[:, None]
    moved = np.concatenate([2 * r**2 - 2j * z * r, 2j * z * r])
    one = -moved / np.concatenate([d, d]) ** 2
    return np.stack([one, one * 1j * x], axis=1)
