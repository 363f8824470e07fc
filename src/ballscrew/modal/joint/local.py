"""Where the axis is worn more or less than along a smooth course: a part of the compliance at every stop.

The parts are random: their variance is what the run itself shows beyond the scatter of its cells, so that an
axis that is worn evenly has none, and one with a dent is followed as far as its data tell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.fit import FEWER, Fit, Prior
from ballscrew.modal.joint.shape import Shape

__all__ = [
    "Scatter",
    "cells_alone",
    "kinks",
    "placed",
    "priors",
    "scatter",
    "shrinkage",
    "smooth",
    "with_local",
]

_LOCAL = "local:"
_SPREADS = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 81)])
_NOUGHT = 0.01
_CONVINCING = 4.0  # log of the likelihood that a spread must gain over none


@dataclass(frozen=True, slots=True)
class Scatter:
    """What a run shows.

    Parameters
    ----------
    spread : float
        Standard deviation of the parts from stop to stop; 0 where none is seen.
    over : float
        Variance of what cells tell over that of as much white noise.
    tied : float
        Weight by which the nut's load was held to that of a new nut.
    """

    spread: float
    over: float
    tied: float = 0.0


def placed(shapes: tuple[Shape, ...], places: tuple[float, ...]) -> tuple[Shape, ...]:
    """Shapes with a part of 0 at every place."""
    return tuple(replace(s, places=places, local=(0.0,) * len(places)) for s in shapes)


def with_local(fields: tuple[str, ...], places: tuple[float, ...]) -> tuple[str, ...]:
    """Fields, and one for each place."""
    return fields + tuple(f"{_LOCAL}{k}" for k in range(len(places)))


def smooth(places: tuple[float, ...], curved: bool) -> Array:
    """What belongs to the smooth course, orthonormal, shape (places, 2 or 3)."""
    return np.asarray(np.linalg.qr(np.vander(np.array(places), 3 if curved else 2, increasing=True))[0])


def priors(found: Scatter, places: tuple[float, ...], curved: bool) -> list[Prior]:
    """Of the places, with no smooth course among them."""
    deviation = found.spread * float(np.sqrt(FEWER / found.over))
    none = [
        Prior(tuple((f"{_LOCAL}{k}", float(v)) for k, v in enumerate(row)), 0.0, _NOUGHT * deviation)
        for row in smooth(places, curved).T
    ]
    return none + [Prior(((f"{_LOCAL}{k}", 1.0),), 0.0, deviation) for k in range(len(places))]


def shrinkage(found: Fit, seen: Scatter) -> Array:
    """Covariance of the parameters by what the prior takes off the parts, shape (keys, keys)."""
    inverse = np.linalg.pinv(found.hessian)
    at = [k for k, (f, _) in enumerate(found.keys) if f.startswith(_LOCAL)]
    if not at or seen.spread == 0:
        return np.zeros_like(inverse)
    course = smooth(found.shapes[0].places, ("curve", 0) in found.keys)
    reached = inverse[:, at] * (seen.over / seen.spread)
    return np.asarray(reached @ (np.eye(len(at)) - course @ course.T) @ reached.T)


def kinks(shape: Shape, places: Array) -> Array:
    """How far the part at each of some stops stands out of those beside it, as a part of the compliance."""
    if len(shape.local) < 3:
        return np.zeros_like(places)
    parts = np.array(shape.local)
    index = np.array([int(np.argmin(np.abs(np.array(shape.places) - x))) for x in places])
    inner = np.arange(1, len(parts) - 1)
    left = np.array(shape.places)
    share = (left[inner] - left[inner - 1]) / (left[inner + 1] - left[inner - 1])
    beside = parts[inner - 1] + share * (parts[inner + 1] - parts[inner - 1])
    out = np.abs(parts[inner] - beside)
    return np.asarray(np.concatenate([out[:1], out, out[-1:]])[index])


def cells_alone(found: Fit, key: int) -> tuple[Array, Array]:
    """What every cell alone would change of a parameter, and its weight, over all blocks."""
    pull = np.zeros(len(found.blocks[0].windows.cells))
    weight = np.zeros_like(pull)
    for i, b in enumerate(found.blocks):
        width = b.target.shape[1]
        column, residual = found.jacobian[i][:, key], found.residual[i]
        for c, (start, stop) in enumerate(b.windows.spans):
            part = slice(start * width, stop * width)
            pull[c] += float(column[part] @ residual[part])
            weight[c] += float(column[part] @ column[part])
    return pull / np.maximum(weight, 1e-300), weight


def scatter(found: Fit, curved: bool) -> Scatter:
    """Estimate it by restricted maximum likelihood, about the point where the fit has ended.

    Parameters
    ----------
    found : Fit
        With the places among its keys.
    curved : bool
        Whether the smooth course has a curve.

    Returns
    -------
    Scatter
        Of its places.
    """
    at = np.array([k for k, (f, _) in enumerate(found.keys) if f.startswith(_LOCAL)])
    rest = np.array([k for k, (f, _) in enumerate(found.keys) if not f.startswith(_LOCAL)])
    now = np.array(found.shapes[0].local)
    over = _over(found, at)
    whole = sum(j.T @ j for j in found.jacobian)
    pull = sum(j.T @ r for j, r in zip(found.jacobian, found.residual, strict=True))
    whole, pull = np.asarray(whole), np.asarray(pull)
    tied = np.linalg.pinv(whole[np.ix_(rest, rest)]) @ whole[np.ix_(rest, at)]
    own = whole[np.ix_(at, at)] - whole[np.ix_(at, rest)] @ tied
    told = pull[at] - tied.T @ pull[rest] + own @ now
    if len(at) <= (3 if curved else 2):
        return Scatter(0.0, over)  # a smooth course goes through every place
    whole_course = np.linalg.qr(smooth(found.shapes[0].places, curved), mode="complete")[0]
    bent = whole_course[:, 3 if curved else 2 :]
    own, told = bent.T @ own @ bent, bent.T @ told
    size, axes = np.linalg.eigh((own + own.T) / 2)
    good = size > 1e-6 * size[-1]
    size, along = size[good], (axes.T @ told)[good]
    best = []
    for spread in _SPREADS:
        variance = size**2 * spread**2 + over * size
        best.append(-0.5 * float(np.sum(np.log(variance) + along**2 / variance)))
    most = int(np.argmax(best))
    return Scatter(float(_SPREADS[most]) if best[most] > best[0] + _CONVINCING else 0.0, over)


def _over(found: Fit, at: Array) -> float:
    """From cell to cell of one stop, beside what a condition has in common."""
    cells = found.blocks[0].windows.cells
    places = np.array(found.shapes[0].places) + found.blocks[0].windows.middle
    nearest = np.array([int(np.argmin(np.abs(places - cell[0]))) for cell in cells])
    off, weight = np.zeros(len(cells)), np.zeros(len(cells))
    for k, key in enumerate(at.tolist()):
        value, heavy = cells_alone(found, key)
        mine = nearest == k
        off[mine], weight[mine] = value[mine], heavy[mine]
    freedom = len(cells)
    names = np.array([f"{cell[1]} {cell[2]}" for cell in cells])
    for group in (names, nearest):
        for name in np.unique(group):
            one = group == name
            off[one] -= np.sum(off[one] * weight[one]) / max(float(np.sum(weight[one])), 1e-300)
            freedom -= 1
    return max(float(np.sum(weight * off**2)) / max(freedom + 1, 1), 1.0)
