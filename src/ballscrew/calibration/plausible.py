"""What a calibrated model can be: ranges that no machine leaves, and covariances that are some."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ballscrew.axis.axial import PARAMETERS, AxialModel
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError

__all__ = ["LOGARITHM", "RANGES", "semidefinite", "varies"]


RANGES = {
    "centre": (-1e3, 1e3), "compliance": (1e-12, 1e-4), "slope": (-1e3, 1e3), "curve": (-1e5, 1e5),
    "mass": (1e-3, 1e7), "rotor": (1e-3, 1e9), "share": (1e-3, 0.999), "preload": (0.1, 1e8),
}  # fmt: skip
"""Within which each parameter of any machine lies, with room to spare: beyond, the file is wrong."""

_SPREAD = {"slope": 1e3, "curve": 1e5}  # standard uncertainty at most
LOGARITHM = 10.0
"""Of any logarithm of a ratio or its standard uncertainty, at most."""

_HUGE = 1e100
_LEAST = 1e-6  # standard uncertainty, as a part
_MUST_VARY = ("compliance", "mass", "share", "preload")  # nobody knows them for certain


def semidefinite(matrix: Array, source: str, key: str) -> None:
    """Check a covariance of the working vector, and of log ratios after it.

    Parameters
    ----------
    matrix : ndarray, shape (n, n)
        Of finite numbers.
    source, key : str
        File and field, for the message.

    Raises
    ------
    InputError
        If a variance is negative or larger than anything can be uncertain, or the whole is no covariance.
    """
    variance = np.diag(matrix)
    spreads = [_SPREAD.get(name, LOGARITHM) for name in PARAMETERS]
    most = np.array(spreads + [LOGARITHM] * (len(matrix) - len(spreads))) ** 2
    for value, limit in zip(variance, most, strict=True):
        if not 0 <= value <= limit:
            raise InputError(f"{source}: {key} has a variance of {value:g}; it must be 0 to {limit:g}.")
    safe = np.sqrt(np.where(variance > 0, variance, 1.0))
    # No product that overflows; rounded to nine digits a correlation may be a little more than 1.
    scaled = np.clip(matrix, -_HUGE, _HUGE) / safe[:, None] / safe
    good = np.all(np.abs(scaled) <= 1 + 1e-6) and np.allclose(scaled, scaled.T, atol=1e-6)
    if not (good and np.linalg.eigvalsh(scaled).min() >= -1e-6):
        raise InputError(f"{source}: {key} is no covariance: it must be symmetric and not negative.")


def varies(model: AxialModel, covariance: Array, free: Sequence[str], source: str) -> None:
    """Check that what nobody can know for certain has a variance, and a rotor that is not there none.

    Parameters
    ----------
    model : AxialModel
        As read.
    covariance : ndarray, shape (7, 7)
        Of its working vector.
    free : sequence of str
        What was fitted.
    source : str
        File, for the message.

    Raises
    ------
    InputError
        If it is otherwise.
    """
    for name in _MUST_VARY:
        at = PARAMETERS.index(name)
        if not covariance[at, at] > _LEAST**2:
            raise InputError(
                f"{source}: covariance of {name} is {covariance[at, at]:g}; it must be more than "
                f"{_LEAST**2:g}: nobody knows it better."
            )
    at = PARAMETERS.index("rotor")
    if not math.isfinite(model.rotor) and ("rotor" in free or covariance[at].any()):
        raise InputError(
            f"{source}: parameters.rotor is null; it must then not be free, nor have a variance."
        )
