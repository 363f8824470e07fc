"""Parameters that the data determine, and parameters that rest on the data sheet."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.axial import PARAMETERS
from ballscrew.base.arrays import Array
from ballscrew.base.words import percent, plural
from ballscrew.calibration.calibrated_axis import Doubt
from ballscrew.calibration.fit import SIZE, Fit

_WORDS = {
    "compliance": "compliance in the middle",
    "slope": "its slope along the axis",
    "curve": "its curve along the axis",
    "mass": "mass that moves with the table",
    "rotor": "rotor and bed",
    "share": "the nut's share of the compliance",
    "preload": "preload in newtons",
}
_BY_DATA = 10.0  # information of the data, times the prior's, from which the data determine a parameter
_BY_SHEET = 0.3  # below which only the sheet does
_MOST_PARTS = 3  # of a direction that are named
_LEAST_PART = 0.3  # prior standard deviations below which a part is not named
_NO_INFORMATION = 1e-12  # of the largest: a thousand times its rounding


def posterior_covariance(fit: Fit, rows: NDArray[np.intp]) -> Array:
    """Posterior covariance of the unknowns by some of the rows only."""
    slopes = fit.problem.jacobian(fit.unknown)[rows]
    return settled_covariance(fit.directions, slopes, fit.problem.covariance[np.ix_(rows, rows)])


def settled_covariance(prior_directions: Array, slopes: Array, covariance: Array) -> Array:
    """Posterior covariance of the unknowns.

    Parameters
    ----------
    prior_directions : ndarray, shape (unknowns, k)
        Root of the prior covariance.
    slopes : ndarray, shape (n, unknowns)
        Derivative of the rows.
    covariance : ndarray, shape (n, n)
        Of the rows.

    Returns
    -------
    ndarray, shape (unknowns, unknowns)
        By Gauss's law of errors.
    """
    white = np.linalg.solve(np.linalg.cholesky(covariance), slopes @ prior_directions)
    inverse = np.linalg.inv(white.T @ white + np.eye(prior_directions.shape[1]))
    return np.asarray(prior_directions @ inverse @ prior_directions.T)


def quantities(fit: Fit) -> tuple[dict[str, object], ...]:
    """Standard uncertainty of each unknown before and after the calibration, relative to its value.

    Parameters
    ----------
    fit : Fit
        The calibration.

    Returns
    -------
    tuple of dict
        ``kind``, ``name``, ``sheet`` and ``data`` (before and after) and ``sentence``. With the nut's own
        compliance, the product of share and compliance.
    """
    model, problem = fit.model, fit.problem
    relative = {
        "slope": 1 / max(abs(model.slope), 1e-12),
        "curve": 1 / max(abs(model.curve), 1e-12),
        "share": 1 - model.share,
    }
    rows = {}
    for index, name in enumerate(PARAMETERS):
        rows[_WORDS[name]] = np.eye(len(fit.unknown))[index] * relative.get(name, 1.0)
    rows["the nut's own compliance"] = rows[_WORDS["compliance"]] + rows[_WORDS["share"]]
    without_anchors = posterior_covariance(fit, np.arange(len(problem.position)))
    found: list[dict[str, object]] = []
    for name, row in rows.items():
        before, after = _spread(row, problem.prior), _spread(row, fit.covariance)
        if before <= 0:
            continue
        source = _source(before, after)
        by_cells = _source(before, _spread(row, without_anchors))
        if by_cells == "only the sheet" and source != by_cells:
            source = "the anchors"
        sentence = f"{name}: {source}, ±{percent(after)} (by the sheet ±{percent(before)})"
        found.append({"kind": "quantity", "name": name, "sheet": before, "data": after, "sentence": sentence})
    return tuple(found)


def rank_doubts(fit: Fit) -> list[Doubt]:
    """One if the data determine fewer combinations of the parameters than their stops and loads should.

    At one preload the compliance is one, its slope a second from two stops on, and the mass a third from two
    loads on: three of the four numbers of θ, which is no doubt. Each further preload adds its ratio.

    Parameters
    ----------
    fit : Fit
        The calibration.

    Returns
    -------
    list of Doubt
        None or one.
    """
    problem = fit.problem
    stops, loads = len(np.unique(problem.position)), len(np.unique(problem.load))
    groups = len(fit.unknown) - SIZE
    expected = 1 + (stops > 1) + (loads > 1) + groups
    rank = int(np.sum(np.linalg.eigvalsh(fit.information) > _BY_SHEET))
    if rank >= expected:
        return []
    text = (
        f"{plural(stops, 'stop')} and {plural(loads, 'load')} should determine {expected} combinations of "
        f"the parameters, the frequencies determine {rank}: use stops and loads further apart, or more trips"
    )
    return [Doubt("rank", text)]


def directions(fit: Fit) -> tuple[dict[str, object], ...]:
    """Independent combinations of the unknowns, those best determined by the data first.

    Eigenvectors of the data's information in units of the prior's. Those without information have one
    eigenvalue, 0, and so no directions of their own: they are one row, with the part of each unknown's prior
    standard deviation that lies in the space that they span.

    Parameters
    ----------
    fit : Fit
        The calibration.

    Returns
    -------
    tuple of dict
        ``kind``, ``information`` (of the data, in units of the prior's: 1 is as much as the sheet's),
        ``parts`` (change of each unknown per prior standard deviation of the direction, in its own prior
        standard deviations, by its name) and ``sentence``.
    """
    values, vectors = np.linalg.eigh(fit.information)
    spread = np.sqrt(np.diag(fit.problem.prior))
    spread[spread == 0] = np.inf
    changes = fit.directions @ vectors / spread[:, None]
    names = [*PARAMETERS, *(f"preload of group {k + 1}" for k in range(len(fit.unknown) - SIZE))]
    without = np.flatnonzero(values <= _NO_INFORMATION * max(float(values[-1]), 1.0)).tolist()
    if len(without) == 1:
        values[without], without = 0.0, []
    found = []
    for k in range(len(values) - 1, len(without) - 1, -1):
        change = changes[:, k]
        order = np.argsort(-np.abs(change))
        order = order[np.abs(change[order]) > _LEAST_PART][:_MOST_PARTS]
        if len(order):
            change = change * np.sign(change[order[0]])
        parts = {names[i]: float(change[i]) for i in order}
        found.append(_direction(float(values[k]), parts, _combination(parts)))
    if without:
        sizes = np.linalg.norm(changes[:, without], axis=1)
        parts = {names[i]: float(sizes[i]) for i in np.flatnonzero(sizes > _LEAST_PART)}
        words = ", ".join(_WORDS.get(name, name) for name in parts)
        found.append(_direction(0.0, parts, f"{len(without)} combinations of {words}"))
    return tuple(found)


def _combination(parts: Mapping[str, float]) -> str:
    """Sum of unknowns in words."""
    words = []
    for name, size in parts.items():
        if size < 0:
            words.append("−")
        elif words:
            words.append("+")
        words.append(_WORDS.get(name, name))
    return " ".join(words)


def _direction(information: float, parts: Mapping[str, float], words: str) -> dict[str, object]:
    """Row of ``knowledge`` in MODEL.json."""
    source = "data and sheet about equally"
    if information > _BY_DATA:
        source = f"the data, {np.sqrt(information):.0f} times as precise as the sheet"
    elif information < _BY_SHEET:
        source = "only the sheet"
    sentence = f"{words}: {source}"
    return {"kind": "direction", "information": information, "parts": parts, "sentence": sentence}


def _spread(row: Array, covariance: Array) -> float:
    return float(np.sqrt(row @ covariance @ row))


def _source(before: float, after: float) -> str:
    """Source of a quantity: data, sheet, or both."""
    remaining = (after / before) ** 2
    if remaining < 1 / _BY_DATA:
        return "the data"
    if remaining > 1 / (1 + _BY_SHEET):
        return "only the sheet"
    return "data and sheet together"
