"""A tolerance has an end: what lies beyond it counts little among the draws of a calibration.

The calibration is a normal distribution, and in it the tolerances of the data sheet are normal ones of the
same variance. They are rectangular (JCGM 100:2008, 4.3.7), which shows in an interval that rests on them: a
normal one of their variance is a fifth too wide. So each draw tells what the numbers of the sheet would be,
and has the weight of that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballscrew.health.calibrated import Tolerated
from ballscrew.health.candidates import Form

__all__ = ["found_within", "kept_within", "likelier"]

Array = NDArray[np.float64]

_END = math.sqrt(3.0)  # of a tolerance, in its standard uncertainties
_WITHIN = 0.98  # of such numbers; the others lie anywhere about it, as far as to twice the tolerance
_LEAST = 0.2  # of the draws must count; where data and sheet disagree by more, the sheet's limits count less
_ROUNDING = 1e-10


def found_within(form: Form, vector: Array) -> tuple[Tolerated, ...]:
    """Tell where a calibration puts each number of the sheet.

    Parameters
    ----------
    form : Form
        What the sheet says.
    vector : ndarray, shape (7,)
        Working vector of the calibration.

    Returns
    -------
    tuple of Tolerated
        One for each number that has a tolerance.
    """
    if not form.tolerated:
        return ()
    with np.errstate(invalid="ignore"):
        moved = np.nan_to_num(vector - form.mean, nan=0.0)
    effects = _columns(list(form.tolerated.values()))
    found = _gain(effects, form.covariance) @ moved
    return tuple(
        Tolerated(name, effect, float(at))
        for (name, effect), at in zip(form.tolerated.items(), found, strict=True)
    )


def likelier(numbers: Array) -> Array:
    """Logarithm of how much likelier numbers of a sheet are than the normal distribution has them.

    Parameters
    ----------
    numbers : ndarray, shape (n, k)
        In standard uncertainties, off the sheet's own.

    Returns
    -------
    ndarray, shape (n,)
        Without a constant.
    """
    inside = np.where(np.abs(numbers) <= _END, _WITHIN / (2 * _END), 0.0)
    beyond = (1 - _WITHIN) / math.sqrt(2 * math.pi) / _END * np.exp(-(numbers**2) / (2 * _END**2))
    return np.asarray(np.sum(np.log(inside + beyond) + numbers**2 / 2, axis=1))


def kept_within(
    tolerated: Sequence[Tolerated], prior: Array, drawn: Array, beside: Array
) -> NDArray[np.intp]:
    """Choose draws by what they make of the sheet's numbers.

    Parameters
    ----------
    tolerated : sequence of Tolerated
        Of k numbers.
    prior : ndarray, shape (7, 7)
        Covariance of the working vector by the sheet.
    drawn : ndarray, shape (n, 7)
        Deviations of the working vector from the calibration's.
    beside : ndarray, shape (n, k)
        Independent standard-normal numbers: the vector alone does not tell the sheet's numbers.

    Returns
    -------
    ndarray of int, shape (n,)
        Which draw to take; likely ones more than once.
    """
    every = np.arange(len(drawn))
    if not tolerated:
        return every
    effects = _columns([one.effects for one in tolerated])
    gain = _gain(effects, prior)
    size, axes = np.linalg.eigh(np.eye(len(tolerated)) - gain @ effects)
    left = beside * np.sqrt(np.clip(size, 0.0, None)) @ axes.T
    log = likelier(np.array([one.found for one in tolerated]) + drawn @ gain.T + left)
    weight = np.exp(log - log.max())
    while float(weight.sum()) ** 2 < _LEAST * len(weight) * float(weight @ weight):
        weight = np.sqrt(weight)
    steps = np.cumsum(weight) / float(weight.sum())
    return np.asarray(np.minimum(np.searchsorted(steps, (every + 0.5) / len(every)), len(every) - 1))


def _columns(effects: Sequence[Array]) -> Array:
    return np.stack(effects, axis=1)


def _gain(effects: Array, prior: Array) -> Array:
    """What a working vector tells of the numbers, shape (k, 7)."""
    return np.asarray(effects.T @ np.linalg.pinv(prior, rcond=_ROUNDING, hermitian=True))
