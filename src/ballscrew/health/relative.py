"""How the compliance has changed, cell by cell, and everything that may have changed it wrongly.

At the same position and load, with the same rotor, f² ∝ 1/C, and only the nut's part of C knows the preload:

    Y = (f₀/f)² − 1 = s(x) [(P/P₀)^(−1/3) − 1],

s(x) the nut's share of the compliance in the state of f₀. It is linear in u = (P/P₀)^(−1/3), so that many
cells are fused in closed form. f₀ is a baseline run's frequency, or the model's where there is none.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.axial import AxialModel, frequency, gradient
from ballscrew.base.errors import InputError
from ballscrew.health.assumptions import Assumptions
from ballscrew.health.change import Change, Term
from ballscrew.health.observed import Observed

__all__ = [
    "by_mass",
    "change_from_model",
    "change_since",
    "paired",
    "softer_under_load",
]

Array = NDArray[np.float64]
_NORMAL_95 = 1.959963984540054
_SAME = 1e-6  # m, within which two stops are one
_LEAST_RATIO = 0.2  # below it nothing was measured


def paired(run: Observed, baseline: Observed) -> tuple[list[int], list[int]]:
    """Cells that both runs have: same stop, condition and motion.

    Parameters
    ----------
    run, baseline : Observed
        Two runs.

    Returns
    -------
    of_run, of_baseline : list of int
        Of the same length.
    """
    keys = [_keys(one) for one in (run, baseline)]
    common = sorted(keys[0].keys() & keys[1].keys())
    return [keys[0][key] for key in common], [keys[1][key] for key in common]


def change_since(
    run: Observed,
    baseline: Observed,
    model: AxialModel,
    bearing_share: float,
    level: float = 1.0,
    assumptions: Assumptions | None = None,
    load_change: float = 0.0,
    ratio: float = 1.0,
) -> Change:
    """Change of the compliance since a baseline: errors that repeat cancel as far as they do.

    Parameters
    ----------
    run, baseline : Observed
        At the same load.
    model : AxialModel
        Of the axis; only its shares enter.
    bearing_share : float
        The thrust bearing's part of the model's compliance at its centre.
    level : float
        P/P_ref of the baseline.
    assumptions : Assumptions, optional
        What no run can show.
    load_change : float
        By how much the run's load is more than the baseline's, kg: taken out of Y.
    ratio : float
        P/P₀ as it is known so far: a worn nut feels the test's own load more, see :func:`softer_under_load`.

    Returns
    -------
    Change
        Of the cells that both have.

    Raises
    ------
    InputError
        If no cell is common to both.
    """
    kept = assumptions or Assumptions()
    rows, base = paired(run, baseline)
    if not rows:
        raise InputError(
            f"run {run.id[:12]} and the baseline {baseline.id[:12]} have no good cell in common; a change "
            "takes the same stops, conditions and motions."
        )
    f, f0 = run.frequency[rows], baseline.frequency[base]
    x = run.position[rows]
    mass = by_mass(model, baseline.load + load_change, run.rotor)
    soft, doubt = softer_under_load(baseline, base, ratio, kept)
    y = (f0 / (f * (1 + soft))) ** 2 / _heavier(model, baseline.load, load_change, run.rotor) - 1
    part = 2 * (1 + y)
    now, then = _causes(run, rows, part / f), _causes(baseline, base, part / f0)
    terms = [
        Term("noise of this run", True, _stack(now.anew, np.diag(part / f * run.own[rows]))),
        Term("noise of the baseline", False, _stack(then.anew, np.diag(part / f0 * baseline.own[base]))),
        *_repeating(now.repeating, then.repeating, kept.repeats, len(rows)),
        Term("load on a worn nut", False, (part * doubt)[None]),
    ]
    return _change(run, rows, model, bearing_share, level, y, f, terms, kept, mass, shape=_tilt(x, y, kept))


def change_from_model(
    run: Observed,
    model: AxialModel,
    bearing_share: float,
    assumptions: Assumptions | None = None,
    ratio: float = 1.0,
) -> Change:
    """Change of the compliance against what the model says at its reference preload.

    Parameters
    ----------
    run : Observed
        One run.
    model : AxialModel
        Of the axis.
    bearing_share : float
        The thrust bearing's part of the model's compliance at its centre.
    assumptions : Assumptions, optional
        What no run can show.
    ratio : float
        P/P_ref as it is known so far.

    Returns
    -------
    Change
        Of all cells; what the model itself errs by is in ``model``, not in its terms.
    """
    kept = assumptions or Assumptions()
    rows = list(range(len(run.frequency)))
    f, x = run.frequency, run.position
    soft, doubt = softer_under_load(run, rows, ratio, kept)
    y = (frequency(model, x, run.load, 1.0, run.rotor) / (f * (1 + soft))) ** 2 - 1
    part = 2 * (1 + y)
    now = _causes(run, rows, part / f)
    terms = [
        Term("noise of this run", True, _stack(now.anew, np.diag(part / f * run.own))),
        Term("errors that repeat", False, _stack(np.array(list(now.repeating.values())), _none(len(rows)))),
        Term("load on a worn nut", False, (part * doubt)[None]),
    ]
    by_model = part * gradient(model, x, run.load, 1.0, run.rotor)[:, :7].T
    mass = by_mass(model, run.load, run.rotor)
    return _change(
        run, rows, model, bearing_share, 1.0, y, f, terms, kept, mass, shape=_tilt(x, y, kept), by=by_model
    )


def softer_under_load(
    one: Observed, rows: Sequence[int], ratio: float, assumptions: Assumptions
) -> tuple[Array, Array]:
    """How much lower a worn nut is read than a new one, since the test's own load softens it more.

    The estimator holds the nut's softening to that of a new nut as far as one run does not show it, and says
    by its term "load" how much that may err. What is left of it on axes of known preload grows by ln(P₀/P):
    the more the load counts, the better a run shows it.

    Parameters
    ----------
    one : Observed
        Where the nut was as the ratio counts it from; tells the term.
    rows : sequence of int
        Which of its cells.
    ratio : float
        P over the preload of that run.
    assumptions : Assumptions
        How many times the term it is, and how sure that is.

    Returns
    -------
    ndarray, shape (rows,)
        Part of f by which it is read too low.
    ndarray, shape (rows,)
        Its standard deviation.
    """
    told = zip(one.shared_names, one.shared, strict=True)
    effects = [effect for name, effect in told if _by_load(name)]
    size = np.sqrt(np.sum(np.square(effects), axis=0)) if effects else np.zeros_like(one.frequency)
    worn = -math.log(min(max(ratio, _LEAST_RATIO), 1 / _LEAST_RATIO))
    part = size[list(rows)] / one.frequency[list(rows)] * worn
    return part * assumptions.nut_load, np.abs(part) * assumptions.nut_load_spread


def _by_load(name: str) -> bool:
    """Whether a cause is the nut's load; older documents part it into a level and a tilt."""
    return name.split(":")[0] == "load"


def by_mass(model: AxialModel, load: float, rotor: str) -> float:
    """By what part of 1 + Y a kg of load that is not declared makes it grow, 1/kg."""
    moving = model.mass + load
    if rotor == "held" or not math.isfinite(model.rotor):
        return 1 / moving
    return model.rotor / (moving * (moving + model.rotor))


def _heavier(model: AxialModel, load: float, more: float, rotor: str) -> float:
    """(f₀/f)² by a heavier load alone."""
    before, after = (model.mass + load + extra for extra in (0.0, more))
    if not after > 0:
        raise InputError(f"a load {more:+.3g} kg away from the baseline's {load:.3g} kg leaves no mass.")
    free = 0.0 if rotor == "held" or not math.isfinite(model.rotor) else 1 / model.rotor
    return (1 / before + free) / (1 / after + free)


@dataclass(frozen=True, slots=True, eq=False)
class _Causes:
    anew: Array
    repeating: dict[tuple[str, int], Array]


def _keys(one: Observed) -> dict[tuple[int, str, int], int]:
    return {
        (round(x / _SAME), condition, motion): index
        for index, (x, condition, motion) in enumerate(
            zip(one.position.tolist(), one.condition, one.motion, strict=True)
        )
    }


def _causes(one: Observed, rows: list[int], scale: Array) -> _Causes:
    """Split as :func:`ballscrew.health.observed.joint_covariance` does: by name, and which of that name.

    The nut's load is told as what does not repeat, since the estimator does not know how worn the nut is.
    Here wear is what is sought, and :func:`softer_under_load` says what it does: what is left of the load
    repeats.
    """
    seen: Counter[str] = Counter()
    repeating, anew = {}, []
    for name, again, effects in zip(one.shared_names, one.repeats, one.shared, strict=True):
        if again or _by_load(name):
            repeating[name, seen[name]] = effects[rows] * scale
            seen[name] += 1
        else:
            anew.append(effects[rows] * scale)
    return _Causes(np.array(anew).reshape(len(anew), len(rows)), repeating)


def _repeating(
    now: dict[tuple[str, int], Array], then: dict[tuple[str, int], Array], correlation: float, count: int
) -> list[Term]:
    """What is common to both runs acts by its difference; the rest of each is new."""
    common, fresh, old = [], [], []
    for key in sorted(now.keys() | then.keys()):
        mine, theirs = now.get(key), then.get(key)
        if mine is not None and theirs is not None:
            common.append(math.sqrt(correlation) * (mine - theirs))
            fresh.append(math.sqrt(1 - correlation) * mine)
            old.append(math.sqrt(1 - correlation) * theirs)
        elif mine is not None:
            fresh.append(mine)
        elif theirs is not None:
            old.append(theirs)
    words = ("errors that repeat", False), ("this run's part of them", True), ("the baseline's part", False)
    return [
        Term(name, random, np.array(rows).reshape(len(rows), count))
        for (name, random), rows in zip(words, (common, fresh, old), strict=True)
    ]


def _change(
    run: Observed,
    rows: list[int],
    model: AxialModel,
    bearing_share: float,
    level: float,
    y: Array,
    f: Array,
    terms: list[Term],
    kept: Assumptions,
    mass: float,
    *,
    shape: Array,
    by: Array | None = None,
) -> Change:
    x = run.position[rows]
    away, u = x - model.centre, level ** (-1 / 3)
    whole = 1 + model.slope * away + model.curve * away**2 + model.share * (u - 1)
    bearing = bearing_share / whole
    along = (model.slope + 2 * model.curve * away) / whole
    by_load = mass * (1 + y)
    terms = [
        *terms,
        Term("declared load", False, (by_load * kept.load * run.load)[None]),
        Term("position", False, ((1 + y) * along * kept.position)[None]),
        Term("bearing", False, ((1 + y) * bearing * kept.bearing_drift / _NORMAL_95)[None]),
        Term("shape of the model", False, np.vstack([shape, 2 * (1 + y) * _form(x, kept)])),
    ]
    return Change(
        position=x,
        condition=tuple(run.condition[i] for i in rows),
        motion=tuple(run.motion[i] for i in rows),
        y=y,
        nut=model.share * u / whole,
        bearing=bearing,
        along=along,
        mass=by_load,
        frequency=f,
        terms=tuple(terms),
        floor=2 * math.sqrt(2) * kept.floor * (1 + y),
        model=by,
    )


def _tilt(x: Array, y: Array, kept: Assumptions) -> Array:
    """The change errs by a part of itself, with opposite signs at the two ends."""
    half = float(np.ptp(x)) / 2
    return np.asarray(kept.tilt * y * (x - (x.min() + half)) / half if half > 0 else np.zeros_like(x))


def _form(x: Array, kept: Assumptions) -> Array:
    """A bow and a wave along the stops, shape (2, n): what is left where the model fits best."""
    half = float(np.ptp(x)) / 2
    part = (x - (x.min() + half)) / half if half > 0 else np.zeros_like(x)
    return np.asarray(kept.form * np.stack([1.5 * part**2 - 0.5, 2.5 * part**3 - 1.5 * part]))


def _stack(first: Array, second: Array) -> Array:
    return np.vstack([first.reshape(-1, second.shape[1]), second])


def _none(count: int) -> Array:
    return np.zeros((0, count))
