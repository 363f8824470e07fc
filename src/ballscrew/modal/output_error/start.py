"""Starting values without a click: resonators are added one by one where they explain most of the FRF.

All of it works on spectra averaged over the repetitions, so its cost does not grow with them. A grid of
frequencies and dampings is searched for the next resonator; then all found so far are fitted to the FRF,
weighted with the input's power.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.modal.output_error.lines import CellLines
from ballscrew.modal.output_error.model import Poles, forced, forced_slopes

__all__ = ["Averages", "averages", "with_one_more"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
_DAMPINGS = (0.015, 0.05)
_SPACING = 0.02  # of the frequency, on the grid
_EDGE = 0.9  # of the band's ends, between which a resonator is looked for
_ROUNDS = 8


@dataclass(frozen=True, slots=True)
class Averages:
    """Spectra of Hann-windowed records, averaged over the repetitions of a cell.

    Parameters
    ----------
    omega : ndarray, shape (n,)
        rad/s.
    uu : ndarray, shape (n,)
        Input power.
    uy : ndarray of complex, shape (responses, n)
        Cross-spectra.
    """

    omega: Real
    uu: Real
    uy: Complex


def averages(lines: CellLines) -> Averages:
    """Average; a Hann window is a convolution with three lines."""

    def hann(x: Complex) -> Complex:
        return np.asarray(0.5 * x[..., 1:-1] - 0.25 * (x[..., :-2] + x[..., 2:]))

    u, y = hann(lines.force), hann(lines.response)
    return Averages(lines.omega[1:-1], (np.abs(u) ** 2).sum(axis=0), (u.conj() * y).sum(axis=1))


def with_one_more(spectra: Averages, poles: Poles | None, band: tuple[float, float]) -> Poles:
    """The poles found so far and the next one, fitted together to the averaged spectra.

    Parameters
    ----------
    spectra : Averages
        Of the cell.
    poles : Poles or None
        Found so far, of the general structure.
    band : tuple of float
        Where a resonator is looked for, Hz.

    Returns
    -------
    Poles
        One more than before.
    """
    low, high = band
    grid = np.exp(np.arange(np.log(low), np.log(high), _SPACING))
    frequency, damping = (part.ravel() for part in np.meshgrid(grid, _DAMPINGS, indexing="ij"))
    found = poles if poles is not None else Poles(np.empty(0), np.empty(0), structure="general")
    root = np.sqrt(spectra.uu)
    kept = _real(forced(found, spectra.omega) * root)
    target = _real(spectra.uy / np.maximum(root, 1e-12 * root.max()))
    basis = np.linalg.qr(kept.T)[0]
    target = target - (target @ basis) @ basis.T
    each = forced(Poles(frequency, damping, structure="general"), spectra.omega)[3:]
    pairs = _real(each * root).reshape(2, len(frequency), -1)
    pairs = pairs - (pairs @ basis) @ basis.T
    aa, bb = (pairs**2).sum(axis=-1)
    ab = (pairs[0] * pairs[1]).sum(axis=-1)
    ay, by = pairs @ target.T  # each (candidates, responses)
    determinant = np.maximum(aa * bb - ab**2, 1e-9 * aa * bb)[:, None]
    gain = (bb[:, None] * ay**2 - 2 * ab[:, None] * ay * by + aa[:, None] * by**2) / determinant
    best = int(np.argmax(gain.sum(axis=1)))
    grown = Poles(
        np.append(found.frequency, frequency[best]), np.append(found.damping, damping[best]), 0.0, "general"
    )
    return _refined(spectra, grown)


def _refined(spectra: Averages, start: Poles) -> Poles:
    """Levenberg-Marquardt on the averaged spectra, which are all that the sums of squares need."""
    poles, cost, normal, gradient = start, *_normal(spectra, start)
    damping = 1e-2
    for _ in range(_ROUNDS):
        diagonal = np.diag(np.maximum(np.diag(normal), 1e-300))
        step: Real = np.asarray(np.linalg.solve(normal + damping * diagonal, gradient), dtype=np.float64)
        step *= min(1.0, 0.1 / max(float(np.abs(step).max()), 1e-300) * 3)
        trial = poles.moved(step)
        if trial.damping.max() < 0.4 and trial.damping.min() > 2e-3:
            other, other_normal, other_gradient = _normal(spectra, trial)
            if other < cost:
                small = cost - other < 1e-3 * other
                poles, cost, normal, gradient = trial, other, other_normal, other_gradient
                damping /= 10
                if small or float(np.abs(step).max()) < 1e-3:
                    break
                continue
        damping = max(10 * damping, 1e-3)
        if damping > 1e4:
            break
    return poles


def _normal(spectra: Averages, poles: Poles) -> tuple[float, Real, Real]:
    """Cost, less what does not move, with its normal matrix and gradient."""
    functions = forced(poles, spectra.omega)
    root = np.sqrt(spectra.uu)
    known = _real(functions * root)
    count = 2 * len(poles.frequency)
    cost, normal, gradient = 0.0, np.zeros((count, count)), np.zeros(count)
    basis, triangle = np.linalg.qr(known.T)
    for uy in spectra.uy:
        target = _real(uy / np.maximum(root, 1e-12 * root.max()))
        along = target @ basis
        slopes = _real(forced_slopes(poles, spectra.omega, np.linalg.solve(triangle, along)) * root)
        slopes -= (slopes @ basis) @ basis.T
        residual = target - along @ basis.T
        cost += float(residual @ residual)
        normal += slopes @ slopes.T
        gradient += slopes @ residual
    return cost, normal, gradient


def _real(array: Complex) -> Real:
    return np.ascontiguousarray(array).view(np.float64)
