"""What colour the residual has, and how much of it is noise on the force.

Noise on the force reaches the residual through the plant, so it has the plant's peak: the residual's power is
a sum of smooth shapes and of the FRF's power times the force's noise, with factors that cannot be negative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from ballscrew.modal.output_error.fit import Fit
from ballscrew.modal.output_error.lines import CellLines
from ballscrew.modal.output_error.model import forced

__all__ = ["Colour", "colour"]

Real = NDArray[np.float64]
_ROUNDS = 60
_START = 0.05  # of the mean power: no factor starts lower, and by this none is believed
_DEEPEST = 1e-4  # of the mean power, that a line's noise may be modelled to have
_SHOWN = 4.0  # standard deviations that noise on the force must have to be believed


@dataclass(frozen=True, slots=True)
class Colour:
    """Colour of a cell's residual.

    Parameters
    ----------
    weight : ndarray, shape (responses, n)
        One over its standard deviation.
    input_noise : float
        Variance of the noise on the real, and on the imaginary, part of the force's lines; 0 where not shown.
    """

    weight: Real
    input_noise: float


def colour(lines: CellLines, fit: Fit) -> Colour:
    """Estimate the colour from a fit's residual.

    Parameters
    ----------
    lines : CellLines
        Of the cell.
    fit : Fit
        With as many modes as may be.

    Returns
    -------
    Colour
        With shapes ω⁻², 1, ω² and, where it is shown, the FRF's power.
    """
    x = lines.omega / np.sqrt(lines.omega[0] * lines.omega[-1])
    repetitions = len(lines.force)
    share = 2 * lines.response.size / max(fit.free, 1)
    smooth = np.stack([np.ones_like(x), x**-2, x**2])
    response = np.abs(fit.factor @ forced(fit.poles, lines.omega)) ** 2
    weights, found, trust = [], [], []
    for power, h in zip(np.sum(np.abs(fit.residual) ** 2, axis=1), response, strict=True):
        mean = power / (2 * repetitions) * share
        shapes = np.concatenate([smooth, (h / h.mean())[None]])
        level = _factors(shapes, mean)
        modelled = np.maximum(level @ shapes, _DEEPEST * mean.mean())
        information = repetitions * (shapes / modelled) @ (shapes / modelled).T
        deviation = float(np.sqrt(np.linalg.pinv(information)[3, 3]))
        if level[3] < _SHOWN * deviation:
            modelled = np.maximum(_factors(smooth, mean) @ smooth, _DEEPEST * mean.mean())
            found.append(0.0)
            trust.append(0.0)
        else:
            found.append(level[3] / h.mean())
            trust.append((level[3] / deviation) ** 2)
        weights.append(1 / np.sqrt(modelled))
    total = float(np.sum(trust))
    # The force's noise is one for all responses: those that show it best say how much.
    noise = float(np.dot(found, trust) / total) if total > 0 else 0.0
    return Colour(np.stack(weights), noise)


def _factors(shapes: Real, power: Real) -> Real:
    """Non-negative factors of the greatest likelihood of powers whose scatter is their own size.

    Multiplied upon, a factor never changes its sign (C. Févotte, N. Bertin and J.-L. Durrieu, Neural
    Comput. 21 (2009) 793, DOI 10.1162/neco.2008.04-08-771); but it leaves zero and comes there slowly, so
    least squares say where to start.
    """
    mean = max(float(power.mean()), np.finfo(float).tiny)
    factors = np.maximum(nnls(shapes.T, power)[0], _START * mean)
    power = np.maximum(power, _DEEPEST * mean)
    for _ in range(_ROUNDS):
        modelled = factors @ shapes
        factors = factors * (shapes @ (power / modelled**2)) / (shapes @ (1 / modelled))
    return np.asarray(factors, dtype=np.float64)
