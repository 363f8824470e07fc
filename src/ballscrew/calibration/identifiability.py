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
_BY_DATA = 10.0  # information of the data over the prior's, from which the data determine a parameter
_BY_SHEET = 0.3  # the same ratio, below which only the sheet determines it
_MOST_PARTS = 3  # most parameters that are named as parts of a direction
_LEAST_PART = 0.3  # change of a parameter, in prior standard deviations, below which it is not named
_NO_INFORMATION = 1e-12  # of the largest information: a thousand times its rounding


def posterior_covariance(fit: Fit, rows: NDArray[np.intp]) -> Array:
    """Posterior covariance of the unknowns by the prior and some of the rows only, (unknowns, unknowns)."""
    slopes = fit.problem.jacobian(fit.unknown)[rows]
    return covariance_by_rows(fit.directions, slopes, fit.problem.covariance[np.ix_(rows, rows)])


def covariance_by_rows(prior_directions: Array, slopes: Array, covariance: Array) -> Array:
    """Posterior covariance of the unknowns by a prior and linear rows of data.

    Parameters
    ----------
    prior_directions : ndarray, shape (unknowns, k)
        Root H of the prior covariance H Hᵀ.
    slopes : ndarray, shape (n, unknowns)
        Derivatives of the rows with respect to the unknowns.
    covariance : ndarray, shape (n, n)
        Of the rows.

    Returns
    -------
    ndarray, shape (unknowns, unknowns)
        H (Hᵀ Jᵀ C⁻¹ J H + 1)⁻¹ Hᵀ with the slopes J and the covariance C of the rows.
    """
    white = np.linalg.solve(np.linalg.cholesky(covariance), slopes @ prior_directions)
    inverse = np.linalg.inv(white.T @ white + np.eye(prior_directions.shape[1]))
    return np.asarray(prior_directions @ inverse @ prior_directions.T)


def describe_quantities(fit: Fit) -> tuple[dict[str, object], ...]:
    """Standard uncertainty of each unknown before and after the calibration, relative to its value.

    Parameters
    ----------
    fit : Fit
        The calibration.

    Returns
    -------
    tuple of dict
        ``kind``, ``name``, ``sheet`` and ``data`` (relative standard uncertainty before and after) and
        ``sentence``. The last is of the nut's own compliance, the product of share and compliance.
    """
    model, problem = fit.model, fit.problem
    # Relative change of a parameter by a unit of its element of the working vector; 1 for a logarithm.
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
    """Doubt of data that determine fewer combinations of the parameters than their stops and loads should.

    At one preload the compliance is the first combination, its slope the second from two stops on, and the
    mass the third from two loads on; the fourth number of θ is never determined, which is no doubt. Each
    further preload adds its ratio.

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


def describe_directions(fit: Fit) -> tuple[dict[str, object], ...]:
    """Independent combinations of the unknowns, those best determined by the data first.

    They are the eigenvectors of the data's information in units of the prior's. Those without information
    have the same eigenvalue, 0, so that only the space that they span is determined: they are one row, with
    the part of each unknown's prior standard deviation that lies in this space.

    Parameters
    ----------
    fit : Fit
        The calibration.

    Returns
    -------
    tuple of dict
        ``kind``, ``information`` (of the data, in units of the prior's: 1 is as much as the sheet's),
        ``parts`` (by the name of an unknown, its change by one prior standard deviation along the direction,
        in its own prior standard deviations) and ``sentence``.
    """
    values, vectors = np.linalg.eigh(fit.information)
    spread = np.sqrt(np.diag(fit.problem.prior))
    spread[spread == 0] = np.inf  # a fixed unknown does not change
    changes = fit.directions @ vectors / spread[:, None]  # shape (unknowns, directions)
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
    """Standard deviation of the linear combination ``row`` of the unknowns."""
    return float(np.sqrt(row @ covariance @ row))


def _source(before: float, after: float) -> str:
    """Source of a quantity, data, sheet or both, by its uncertainty before and after the data."""
    remaining = (after / before) ** 2  # part of the variance: 1/(1 + information)
    if remaining < 1 / _BY_DATA:
        return "the data"
    if remaining > 1 / (1 + _BY_SHEET):
        return "only the sheet"
    return "data and sheet together"
