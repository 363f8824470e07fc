"""A tolerance has an end: what lies beyond it counts little among the draws of a calibration.

The calibration is a normal distribution, and in it the tolerances of the data sheet are normal ones of the
same variance. They are rectangular (JCGM 100:2008, 4.3.7), which shows in an interval that rests on them: a
normal one of their variance is a fifth too wide. So each draw tells what the logarithms of the sheet's
numbers would be, and has the weight of that: the rectangular density over the normal one. What is measured
enters through the working vector alone, so this is exact as far as the model is linear in these logarithms.

A number that the calibration itself puts beyond its tolerance has been told wrongly; its tolerance says
nothing then, and it stays the normal number that the calibration made of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.axial import PARAMETERS
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.tolerances import tolerances
from ballscrew.base.arrays import Array
from ballscrew.base.resampling import systematic
from ballscrew.calibration.calibrated_axis import Tolerated
from ballscrew.calibration.model_forms import Form

__all__ = ["beyond", "found_within", "kept_within", "likelier", "part_of"]


_END = math.sqrt(3.0)  # of a tolerance, in its standard uncertainties
_OTHERS = 0.02  # of such numbers: normal about the sheet's, with the tolerance as standard deviation
_LEAST = 0.1  # of the draws must count; else no draw is preferred
_MATTERS = 0.05  # of the largest effect on share and preload: less is not looked at
_ROUNDING = 1e-10
_MIDDLE = 0.5  # where the first of evenly spaced places lies
_SLACK = 1e-3  # of a variance or an effect: what rounding may make


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
    free = np.isfinite(vector) & np.isfinite(form.mean)
    moved = np.where(free, vector, 0.0) - np.where(free, form.mean, 0.0)
    found = _gain(np.stack(list(form.tolerated.values()), axis=1), form.covariance) @ moved
    return tuple(
        Tolerated(name, effects, float(at))
        for (name, effects), at in zip(form.tolerated.items(), found, strict=True)
    )


def beyond(found: Sequence[Tolerated], sheet: DataSheet) -> list[str]:
    """Say which numbers of the sheet the measurements put beyond their tolerance.

    Parameters
    ----------
    found : sequence of Tolerated
        As the calibration found them.
    sheet : DataSheet
        The axis.

    Returns
    -------
    list of str
        A sentence each, without a full stop.
    """
    parts = tolerances(sheet)
    return [
        f"{one.field} fits best {100 * math.exp(one.found * parts[one.field] / _END):.0f} % of what the data "
        f"sheet says, which allows ± {100 * parts[one.field]:.3g} %: is the sheet of this axis, and are the "
        "loads and known preloads right?"
        for one in found
        if abs(one.found) > _END
    ]


def part_of(tolerated: Sequence[Tolerated], prior: Array) -> bool:
    """Whether effects can be a part of what the sheet says.

    Parameters
    ----------
    tolerated : sequence of Tolerated
        Of k numbers.
    prior : ndarray, shape (7, 7)
        Covariance of the working vector by the sheet.

    Returns
    -------
    bool
        False where they make more of some direction than the whole does.
    """
    if not tolerated:
        return True
    effects = np.stack([one.effects for one in tolerated], axis=1)
    left = np.linalg.eigvalsh(np.eye(len(tolerated)) - _gain(effects, prior) @ effects)
    outside = effects - prior @ np.linalg.pinv(prior, rcond=_ROUNDING, hermitian=True) @ effects
    return bool(left[0] >= -_SLACK and np.abs(outside).max() <= _SLACK * max(np.abs(effects).max(), 1e-9))


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
    inside = np.where(np.abs(numbers) <= _END, math.log((1 - _OTHERS) / (2 * _END)), -np.inf)
    others = math.log(_OTHERS / math.sqrt(2 * math.pi) / _END) - numbers**2 / (2 * _END**2)
    return np.asarray(np.sum(np.logaddexp(inside, others) + numbers**2 / 2, axis=1))


def kept_within(
    tolerated: Sequence[Tolerated], prior: Array, drawn: Array, beside: Array, count: int
) -> NDArray[np.intp]:
    """Choose draws of a calibration by what they make of the sheet's numbers.

    Parameters
    ----------
    tolerated : sequence of Tolerated
        Of k numbers, as the calibration found them.
    prior : ndarray, shape (7, 7)
        Covariance of the working vector by the sheet.
    drawn : ndarray, shape (n, 7)
        Deviations of the working vector from the calibration's most probable one.
    beside : ndarray, shape (n, k)
        Independent standard-normal numbers: the vector alone does not tell the sheet's numbers.
    count : int
        How many to choose, n at most.

    Returns
    -------
    ndarray of int, shape (count,)
        Which draws; evenly from all where no number is bounded.
    """
    evenly = systematic(np.full(len(drawn), 1 / len(drawn)), _MIDDLE, count)
    bounded = _bounded(tolerated)
    if not bounded.any():
        return evenly
    effects = np.stack([one.effects for one in tolerated], axis=1)
    gain = _gain(effects, prior)
    size, axes = np.linalg.eigh(np.eye(len(tolerated)) - gain @ effects)
    left = beside * np.sqrt(np.clip(size, 0.0, None)) @ axes.T
    numbers = np.array([one.found for one in tolerated]) + drawn @ gain.T + left
    log = likelier(numbers[:, bounded])
    weights = np.exp(log - log.max())
    if float(weights.sum()) ** 2 < _LEAST * len(weights) * float(weights @ weights):
        return evenly
    return systematic(weights / float(weights.sum()), _MIDDLE, count)


def _bounded(tolerated: Sequence[Tolerated]) -> NDArray[np.bool_]:
    """Which numbers matter to the preload and lie within their tolerance, shape (k,)."""
    at = [PARAMETERS.index("share"), PARAMETERS.index("preload")]
    matter = np.array([float(np.linalg.norm(one.effects[at])) for one in tolerated])
    inside = np.array([abs(one.found) <= _END for one in tolerated], dtype=bool)
    return np.asarray(inside & (matter > 0) & (matter >= _MATTERS * matter.max(initial=0.0)))


def _gain(effects: Array, prior: Array) -> Array:
    """What a working vector tells of the numbers, shape (k, 7)."""
    return np.asarray(effects.T @ np.linalg.pinv(prior, rcond=_ROUNDING, hermitian=True))
