"""How well a fit knows its poles: the Jacobian, and what the repetitions say of it.

Source: H. White, Econometrica 50 (1982) 1, DOI 10.2307/1912526: where a model is not quite right, the scatter
of the repetitions' gradients, not the residual's size, says how far the estimate strays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballscrew.modal.output_error.fit import Fit

__all__ = ["pole_covariance"]

_ENOUGH = 6  # repetitions, from which on their scatter says more than it hides


def pole_covariance(fit: Fit) -> NDArray[np.float64]:
    """Covariance of :attr:`~ballscrew.modal.output_error.model.Poles.vector`.

    Parameters
    ----------
    fit : Fit
        Weighted with the residual's colour.

    Returns
    -------
    ndarray, shape (parameters, parameters)
        The Jacobian's, made wider where the repetitions scatter more.
    """
    inverse = np.linalg.pinv(fit.information, hermitian=True)
    plain = inverse * fit.squares / max(fit.free, 1)
    count = len(fit.scores)
    if count < _ENOUGH:
        return np.asarray(plain)
    centred = fit.scores - fit.scores.mean(axis=0)
    scattered = inverse @ (centred.T @ centred) @ inverse * count / (count - 1)
    wider = np.sqrt(np.maximum(np.diag(scattered) / np.maximum(np.diag(plain), 1e-300), 1.0))
    return np.asarray(plain * np.outer(wider, wider))
