"""What the data know, what only the sheet does, and what one more measurement would add."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.axial import PARAMETERS, from_vector, gradient
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.base.percent import percent
from ballscrew.calibration.anchors import KNOWN, LEVELS
from ballscrew.calibration.between import Between, apart, loads_repeat, worn_slopes
from ballscrew.calibration.fit import FULL, Fit, Problem
from ballscrew.calibration.frequency_table import FrequencyTable
from ballscrew.calibration.onestop import further, with_stop
from ballscrew.calibration.rows import FLOOR, relative_covariance

__all__ = ["Direction", "directions", "knowledge", "offers", "posterior", "quantities"]


_WORDS = {
    "compliance": "compliance in the middle",
    "slope": "its slope along the axis",
    "curve": "its curve along the axis",
    "mass": "mass that moves with the table",
    "rotor": "rotor and bed",
    "share": "the nut's share of the compliance",
    "preload": "preload in newtons",
}
_KNOWN_BY_DATA = 10.0  # times what the prior knew
_KNOWN_BY_SHEET = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """One independent combination of the unknowns.

    Parameters
    ----------
    information : float
        Of the data, in units of the prior's: 1 is as much as the sheet knew.
    parts : tuple of (str, float)
        What it is made of, the largest first: how far a prior standard deviation moves each, in prior
        standard deviations of that one.
    sentence : str
        In words.
    """

    information: float
    parts: tuple[tuple[str, float], ...]
    sentence: str


def posterior(problem: Problem, fit: Fit, rows: NDArray[np.intp]) -> Array:
    """Covariance of the unknowns if only these rows had been measured."""
    slopes = problem.jacobian(fit.unknown)[rows]
    return _settled(fit.directions, slopes, problem.covariance[np.ix_(rows, rows)])


def quantities(problem: Problem, fit: Fit) -> tuple[dict[str, object], ...]:
    """Of each unknown its standard uncertainty before and after, as a part of its value.

    Parameters
    ----------
    problem, fit
        What was fitted.

    Returns
    -------
    tuple of dict
        ``name``, ``sheet``, ``data`` (both relative; ``share`` as a part of the share, ``slope`` and
        ``curve`` of themselves) and ``sentence``. With them the nut's rigidity, which share and compliance
        make.
    """
    model = from_vector(fit.unknown[:FULL], problem.centre)
    scale = np.ones(len(fit.unknown))
    scale[PARAMETERS.index("slope")] = 1 / max(abs(model.slope), 1e-12)
    scale[PARAMETERS.index("curve")] = 1 / max(abs(model.curve), 1e-12)
    scale[PARAMETERS.index("share")] = 1 - model.share
    rows = [(_WORDS[name], np.eye(len(scale))[k] * scale[k]) for k, name in enumerate(PARAMETERS)]
    nut = np.zeros(len(scale))
    nut[PARAMETERS.index("compliance")], nut[PARAMETERS.index("share")] = 1.0, 1 - model.share
    rows.append(("the nut's own compliance", nut))
    alone = posterior(problem, fit, np.arange(len(problem.position)))
    found = []
    for words, row in rows:
        before = float(np.sqrt(row @ problem.prior @ row))
        after = float(np.sqrt(row @ fit.covariance @ row))
        if before <= 0:
            continue
        who = _who(before, after)
        if who != "only the sheet" and _who(before, float(np.sqrt(row @ alone @ row))) == "only the sheet":
            who = "the anchors"
        found.append(
            {
                "name": words,
                "sheet": before,
                "data": after,
                "sentence": f"{words}: {who}, ±{percent(after)} (by the sheet ±{percent(before)})",
            }
        )
    return tuple(found)


def directions(problem: Problem, fit: Fit) -> tuple[Direction, ...]:
    """Independent combinations of the unknowns, those that the data know best first.

    Eigenvectors of the data's information in units of the prior's: along each, data and sheet do not mix.

    Parameters
    ----------
    problem, fit
        What was fitted.

    Returns
    -------
    tuple of Direction
        As many as the prior leaves free.
    """
    values, vectors = np.linalg.eigh(fit.information)
    spread = np.sqrt(np.diag(problem.prior))
    spread[spread == 0] = np.inf
    names = [*PARAMETERS, *(f"preload of group {k + 1}" for k in range(len(fit.unknown) - FULL))]
    found = []
    for k in np.argsort(values)[::-1]:
        moved = fit.directions @ vectors[:, k] / spread
        order = [int(i) for i in np.argsort(-np.abs(moved)) if abs(moved[i]) > 0.3][:3]
        moved = moved * (np.sign(moved[order[0]]) if order else 1.0)
        parts = tuple((names[i], float(moved[i])) for i in order)
        told = max(float(values[k]), 0.0)
        words = " ".join(
            f"{'−' if size < 0 else '+' if i else ''} {_WORDS.get(name, name)}".strip()
            for i, (name, size) in enumerate(parts)
        )
        if told > _KNOWN_BY_DATA:
            who = f"the data, {np.sqrt(told):.0f} times as sharp as the sheet"
        elif told < _KNOWN_BY_SHEET:
            who = "only the sheet"
        else:
            who = "data and sheet about alike"
        found.append(Direction(told, parts, f"{words}: {who}"))
    return tuple(found)


def offers(
    runs: Sequence[FrequencyTable],
    problem: Problem,
    fit: Fit,
    correlation: float,
    between: Between,
    *,
    sheet: DataSheet | None = None,
    scale: float = 1.0,
) -> tuple[dict[str, object], ...]:
    """What one more measurement would leave of the uncertainty of share and preload.

    Parameters
    ----------
    runs
        As they were fitted; one more run is taken to be as good as the heaviest of them.
    problem, fit
        What was fitted.
    correlation : float
        Of errors that repeat.
    between : Between
        What is taken for granted between experiments.
    sheet : DataSheet, optional
        Says how far the axis travels; without it no other stop is offered.
    scale : float
        By which the variances of the frequencies were widened; those to come are taken as no better.

    Returns
    -------
    tuple of dict
        ``what``, ``share``, ``log_preload``, ``mass``: relative standard uncertainties to be expected. The
        first is as it is now.
    """
    heaviest = max(runs, key=lambda run: run.load)
    index = runs.index(heaviest)
    group = int(problem.group[problem.run == index][0])
    model = from_vector(fit.unknown[:FULL], problem.centre)
    again = _Again(runs, problem, fit, group, correlation, between, scale)
    heavier = max(2 * heaviest.load, heaviest.load + 0.5 * model.mass)
    table: list[tuple[str, Callable[[], Array]]] = [
        ("as it is", lambda: fit.covariance),
        (
            f"one more load, {heavier:.3g} kg, where the machine may carry it",
            lambda: _with_run(again, replace(heaviest, id="", load=heavier)),
        ),
        (
            "the known preload of these runs, ±2 %",
            lambda: _with_anchor(fit, KNOWN),
        ),
        (
            "the known preload of these runs and a run at a known half of it, ±2 % each",
            lambda: _with_worn(problem, fit, heaviest, correlation, between),
        ),
        (
            f"two acceleration levels, which tell the preload to ±{100 * LEVELS:.0f} %",
            lambda: _with_anchor(fit, LEVELS),
        ),
    ]
    far = None if sheet is None else further(heaviest.position, sheet)
    if far is not None:
        table.append(
            (
                f"one more run with {heaviest.load:g} kg and another stop, at {1e3 * far:.0f} mm",
                lambda: _with_run(again, with_stop(heaviest, far)),
            )
        )
    at = PARAMETERS.index
    found = []
    for what, make in table:
        spread = np.sqrt(np.diag(make()))
        found.append(
            {
                "what": what,
                "share": float(spread[at("share")] * (1 - model.share)),
                "log_preload": float(spread[at("preload")]),
                "mass": float(spread[at("mass")]),
            }
        )
    return tuple(found)


def knowledge(
    runs: Sequence[FrequencyTable],
    problem: Problem,
    fit: Fit,
    correlation: float,
    between: Between,
    *,
    sheet: DataSheet | None = None,
    scale: float = 1.0,
) -> tuple[dict[str, object], ...]:
    """Put quantities, directions and offers together, as MODEL.json holds them.

    Parameters
    ----------
    runs, problem, fit, correlation, between, sheet, scale
        As :func:`offers`.

    Returns
    -------
    tuple of dict
        Each with a ``kind``: ``quantity``, ``direction`` or ``offer``.
    """
    return (
        *({"kind": "quantity", **one} for one in quantities(problem, fit)),
        *(
            {
                "kind": "direction",
                "information": one.information,
                "parts": dict(one.parts),
                "sentence": one.sentence,
            }
            for one in directions(problem, fit)
        ),
        *(
            {"kind": "offer", **one}
            for one in offers(runs, problem, fit, correlation, between, sheet=sheet, scale=scale)
        ),
    )


def _who(before: float, after: float) -> str:
    left = (after / before) ** 2
    if left < 1 / _KNOWN_BY_DATA:
        return "the data"
    return "only the sheet" if left > 1 / (1 + _KNOWN_BY_SHEET) else "data and sheet together"


def _settled(directions: Array, slopes: Array, covariance: Array) -> Array:
    white = np.linalg.solve(np.linalg.cholesky(covariance), slopes @ directions)
    inverse = np.linalg.inv(white.T @ white + np.eye(directions.shape[1]))
    return np.asarray(directions @ inverse @ directions.T)


def _with_anchor(fit: Fit, spread: float) -> Array:
    """With a known preload of the reference group."""
    row = np.zeros(len(fit.unknown))
    row[PARAMETERS.index("preload")] = 1.0
    return _updated(fit.covariance, row[None, :], np.array([[spread**2]]))


@dataclass(frozen=True, slots=True, eq=False)
class _Again:
    """What one more run is added to."""

    runs: Sequence[FrequencyTable]
    problem: Problem
    fit: Fit
    group: int
    correlation: float
    between: Between
    scale: float


def _with_run(on: _Again, more: FrequencyTable) -> Array:
    problem, fit, group, runs = on.problem, on.fit, on.group, on.runs
    n, k = len(problem.position), len(more.frequency)
    model = from_vector(fit.unknown[:FULL], problem.centre)
    groups = [int(problem.group[problem.run == i][0]) for i in range(len(runs))]
    every_run, every_group = [*runs, more], [*groups, group]
    cells = on.scale * relative_covariance(every_run, every_group, model, on.correlation, on.between)
    ratio = float(np.exp(np.concatenate([[0.0], fit.unknown[FULL:]])[group]))
    slopes = np.zeros((k, len(fit.unknown)))
    told = gradient(model, more.position, more.load, ratio)
    slopes[:, :FULL] = told[:, :FULL]
    if group:
        slopes[:, FULL + group - 1] = told[:, FULL] + worn_slopes([more], on.between.kept)
    every = problem.jacobian(fit.unknown)
    whole = np.zeros((len(every) + k, len(every) + k))
    whole[: len(every), : len(every)] = problem.covariance
    new = slice(len(every), None)
    whole[new, new] = cells[n:, n:]
    whole[:n, new], whole[new, :n] = cells[:n, n:], cells[n:, :n]
    values, vectors = np.linalg.eigh(whole)  # rows that lost weight make the joint matrix a patchwork
    whole = vectors * np.maximum(values, 1e-12 * values.max()) @ vectors.T
    return _settled(fit.directions, np.vstack([every, slopes]), whole)


def _with_worn(
    problem: Problem, fit: Fit, like: FrequencyTable, correlation: float, between: Between
) -> Array:
    """A run at half the preload, both known: rows of the change between two runs, and of the two preloads."""
    model = from_vector(fit.unknown[:FULL], problem.centre)
    half = gradient(model, like.position, like.load, 0.5)[:, :FULL]
    now = gradient(model, like.position, like.load, 1.0)[:, :FULL]
    repeats = loads_repeat(like).repeats.astype(float)[:, None]
    alone = like.shared * np.sqrt(2 * (1 - correlation * repeats))
    change = (alone.T @ alone + 2 * np.diag(like.own**2)) / np.outer(like.frequency, like.frequency)
    for effect in apart(like, model, between, math.log(0.5)):  # of another day
        change += np.outer(effect, effect)
    change += FLOOR**2 * np.eye(len(change))
    by_ratio = gradient(model, like.position, like.load, 0.5)[:, FULL] + worn_slopes([like], between.kept)
    change += 2 * KNOWN**2 * np.outer(by_ratio, by_ratio)  # what the ratio of the two statements may err
    slopes = np.zeros((len(half), len(fit.unknown)))
    slopes[:, :FULL] = half - now
    return _updated(_with_anchor(fit, KNOWN), slopes, change)


def _updated(covariance: Array, slopes: Array, noise: Array) -> Array:
    gain = covariance @ slopes.T
    inner = slopes @ gain + noise
    return np.asarray(covariance - gain @ np.linalg.solve(inner, gain.T))
