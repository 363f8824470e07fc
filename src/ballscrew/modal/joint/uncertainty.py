"""How far the curve along the axis may be off, and each cell from it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.fit import Fit
from ballscrew.modal.joint.shape import Shape, frequency, local

__all__ = ["condition_covariance", "covariance", "deviations", "gradient"]

_MEDIAN = 1.4826  # standard deviation of a normal number over the median of its size


def covariance(found: Fit) -> Array:
    """Covariance of the parameters, from what each cell pulls.

    Cells are independent, samples of one are not, nor are its blocks: noise of any colour and what the
    model misses from cell to cell are in it (a sandwich with cells as clusters).

    Parameters
    ----------
    found : Fit
        The fit.

    Returns
    -------
    ndarray, shape (keys, keys)
        Of the parameters as they were fitted, some of them logarithms.
    """
    pulls = sum(_pulls(found, i) for i in range(len(found.blocks)))
    count, keys = np.asarray(pulls).shape
    inverse = np.linalg.pinv(found.hessian)
    whole = np.asarray(pulls).T @ np.asarray(pulls) * (count / max(count - keys, 1))
    return np.asarray(inverse @ whole @ inverse)


def condition_covariance(found: Fit) -> Array:
    """Covariance of the parameters by what the conditions alone would make of them.

    Window, motion and friction are shared by all cells of a condition, so cells as clusters do not show
    them. One step of the fit with each condition's cells alone; the scatter over the number of conditions.

    Parameters
    ----------
    found : Fit
        The fit.

    Returns
    -------
    ndarray, shape (keys, keys)
        Zero where there is one condition only.
    """
    cells = found.blocks[0].windows.cells
    moves = []
    for name in sorted({cell[1] for cell in cells}):
        hessian = np.zeros_like(found.hessian)
        pull = np.zeros(len(hessian))
        for i, b in enumerate(found.blocks):
            width = b.target.shape[1]
            for (start, stop), cell in zip(b.windows.spans, b.windows.cells, strict=True):
                if cell[1] == name:
                    part = slice(start * width, stop * width)
                    hessian += found.jacobian[i][part].T @ found.jacobian[i][part]
                    pull += found.jacobian[i][part].T @ found.residual[i][part]
        # What one condition cannot tell keeps to the whole fit.
        moves.append(np.linalg.pinv(hessian + 0.05 * found.hessian) @ pull)
    if len(moves) < 2:
        return np.zeros_like(found.hessian)
    return np.asarray(np.cov(moves, rowvar=False) / len(moves))


def overdone(found: Fit, key: int) -> float:
    """Variance of a parameter by the scatter of cells or conditions, over that by as much white noise."""
    found = replace(found, hessian=np.asarray(sum(j.T @ j for j in found.jacobian)))
    white = float(np.linalg.pinv(found.hessian)[key, key])
    seen = max(float(covariance(found)[key, key]), float(condition_covariance(found)[key, key]))
    return max(seen / max(white, 1e-300), 1.0)


def nut_loads(found: Fit) -> tuple[Array, Array]:
    """Of every cell the highest load on the nut over the preload there, and the nut's share, at its stop."""
    w, shape = found.blocks[0].windows, found.shapes[0]
    loads, shares = np.zeros(len(w.cells)), np.zeros(len(w.cells))
    if not shape.load > 0:
        return loads, shares
    for i, ((start, stop), cell) in enumerate(zip(w.spans, w.cells, strict=True)):
        at = np.array([cell[0] - w.middle])
        nut = max(shape.share + float(local(shape, at)[0]), 0.3 * shape.share)
        square = 1 + shape.slope * at[0] + shape.curve * at[0] ** 2 + float(local(shape, at)[0])
        peak = float(np.abs(w.force[start:stop][w.early[start:stop]]).max()) + shape.rubbing
        loads[i] = shape.load * (nut / shape.share) ** 3 * peak
        shares[i] = min(nut / max(square, 0.1), 0.95)
    return loads, shares


def gradient(found: Fit, block: int, place: Array) -> Array:
    """Slope of a block's frequency over the parameters, shape (places, keys), Hz."""
    shape = found.shapes[block]
    f = frequency(shape, place)
    square = 1 + shape.slope * place + shape.curve * place**2 + local(shape, place)
    by_field = {"compliance": -f / 2, "slope": -f / 2 * place / square, "curve": -f / 2 * place**2 / square}
    out = np.zeros((len(place), len(found.keys)))
    for k, (field, own) in enumerate(found.keys):
        if own == block and field in by_field:
            out[:, k] = by_field[field]
        elif field.startswith("local:"):
            hat = np.zeros(len(shape.places))
            hat[int(field.split(":")[1])] = 1.0
            out[:, k] = -f / 2 * np.interp(place, shape.places, hat) / square
    return out


def deviations(found: Fit, block: int) -> tuple[Array, Array]:
    """What each cell alone would add to the curve, and its standard deviation, Hz.

    One step of a fit in which only this cell's frequency is free.
    """
    key = found.keys.index(("compliance", block))
    jacobian, residual = found.jacobian[block][:, key], found.residual[block]
    b = found.blocks[block]
    width = b.target.shape[1]
    value, spread = [], []
    for start, stop in b.windows.spans:
        part = slice(start * width, stop * width)
        weight = float(jacobian[part] @ jacobian[part])
        f = _middle(found.shapes[block], b.windows.place[start:stop])
        # Of one sample in five: a residual in a band is no white noise.
        noise = float(np.mean(residual[part] ** 2)) * 5.0
        value.append(-f / 2 * float(jacobian[part] @ residual[part]) / max(weight, 1e-300))
        spread.append(f / 2 * np.sqrt(noise / max(weight, 1e-300)))
    off, sd = np.array(value), np.array(spread)
    # What a cell misses is not noise alone: the scatter of the cells says by how much more.
    more = float(np.median(np.abs(off) / np.maximum(sd, 1e-300))) * _MEDIAN
    return off, sd * max(1.0, more)


def _pulls(found: Fit, block: int) -> Array:
    b = found.blocks[block]
    width = b.target.shape[1]
    jacobian, residual = found.jacobian[block], found.residual[block]
    return np.array(
        [jacobian[s * width : e * width].T @ residual[s * width : e * width] for s, e in b.windows.spans]
    )


def _middle(shape: Shape, place: Array) -> float:
    return float(np.mean(frequency(shape, place)))
