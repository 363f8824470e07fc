"""How the compliance has changed, cell by cell, and everything that may have changed it wrongly.

At the same position and load, with the same rotor, f² ∝ 1/C, and only the nut's part of C knows the preload:

    Y = (f₀/f)² − 1 = s(x) [(P/P₀)^(−1/3) − 1],

s(x) the nut's share of the compliance in the state of f₀. It is linear in u = (P/P₀)^(−1/3), so that many
cells are fused in closed form. f₀ is a baseline run's frequency, or the model's where there is none.
"""

from __future__ import annotations

import math

import numpy as np

from ballscrew.axis.axial import PARAMETERS, AxialModel, frequency, gradient
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.quantity import NORMAL_95
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.frequency_table import FrequencyTable
from ballscrew.calibration.worn_nut import softer_under_load
from ballscrew.estimation.change import ComplianceChange, Term
from ballscrew.estimation.shared_terms import BASELINE, causes_of, repeating_terms

__all__ = [
    "WORN",
    "by_mass",
    "change_from_model",
    "change_since",
    "paired",
    "softer_under_load",
]

WORN = "load on a worn nut"
_SAME = 1e-6  # m, within which two stops are one


def paired(run: FrequencyTable, baseline: FrequencyTable) -> tuple[list[int], list[int]]:
    """Cells that both runs have: same stop, condition and motion.

    Parameters
    ----------
    run, baseline : FrequencyTable
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
    run: FrequencyTable,
    baseline: FrequencyTable,
    model: AxialModel,
    bearing_share: float,
    level: float = 1.0,
    assumptions: Assumptions | None = None,
    load_change: float = 0.0,
    ratio: float = 1.0,
    covariance: Array | None = None,
) -> ComplianceChange:
    """Change of the compliance since a baseline: errors that repeat cancel as far as they do.

    Parameters
    ----------
    run, baseline : FrequencyTable
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
        P/P₀ as it is known so far: a worn nut feels the test's own load more, see
        :func:`~ballscrew.calibration.worn_nut.softer_under_load`.
    covariance : ndarray, shape (7, 7), optional
        Of the model's working vector: what a change of the load makes of it.

    Returns
    -------
    ComplianceChange
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
    now, then = causes_of(run, rows, part / f), causes_of(baseline, base, part / f0)
    terms = [
        Term("noise of this run", True, _stack(now.anew, np.diag(part / f * run.own[rows]))),
        Term(BASELINE, False, _stack(then.anew, np.diag(part / f0 * baseline.own[base]))),
        *repeating_terms(now.repeating, then.repeating, kept.repeats, len(rows)),
        *_mass_terms(model, covariance, baseline.load, load_change, run.rotor, y),
        Term(WORN, False, (part * doubt)[None]),
    ]
    own = np.hypot(part / f * run.own[rows], part / f0 * baseline.own[base])
    return _change(
        run, rows, model, bearing_share, level, y, f, terms, kept, mass, shape=_tilt(x, y, kept),
        own=own, load=math.hypot(run.load, load_change),
    )  # fmt: skip


def change_from_model(
    run: FrequencyTable,
    model: AxialModel,
    bearing_share: float,
    assumptions: Assumptions | None = None,
    ratio: float = 1.0,
) -> ComplianceChange:
    """Change of the compliance against what the model says at its reference preload.

    Parameters
    ----------
    run : FrequencyTable
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
    ComplianceChange
        Of all cells; what the model itself errs by is in ``model``, not in its terms.
    """
    kept = assumptions or Assumptions()
    rows = list(range(len(run.frequency)))
    f, x = run.frequency, run.position
    soft, doubt = softer_under_load(run, rows, ratio, kept)
    y = (frequency(model, x, run.load, 1.0, run.rotor) / (f * (1 + soft))) ** 2 - 1
    part = 2 * (1 + y)
    now = causes_of(run, rows, part / f)
    terms = [
        Term("noise of this run", True, _stack(now.anew, np.diag(part / f * run.own))),
        Term("errors that repeat", False, _stack(np.array(list(now.repeating.values())), _none(len(rows)))),
        Term(WORN, False, (part * doubt)[None]),
    ]
    by_model = part * gradient(model, x, run.load, 1.0, run.rotor)[:, :7].T
    mass = by_mass(model, run.load, run.rotor)
    return _change(
        run, rows, model, bearing_share, 1.0, y, f, terms, kept, mass, shape=_tilt(x, y, kept),
        own=part / f * run.own, load=run.load, by=by_model,
    )  # fmt: skip


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


def _mass_terms(
    model: AxialModel, covariance: Array | None, load: float, more: float, rotor: str, y: Array
) -> list[Term]:
    """What the model's masses may err by, where the loads differ."""
    if covariance is None or more == 0:
        return []
    free = 0.0 if rotor == "held" or not math.isfinite(model.rotor) else 1 / model.rotor
    inverse = [1 / (model.mass + load + extra) for extra in (0.0, more)]
    by_mass_, by_rotor = (
        [-model.mass * i**2 / (i + free) for i in inverse],
        [-free / (i + free) for i in inverse],
    )
    slope = np.array([by_mass_[0] - by_mass_[1], by_rotor[0] - by_rotor[1]])
    at = [PARAMETERS.index(name) for name in ("mass", "rotor")]
    spread = math.sqrt(max(float(slope @ covariance[np.ix_(at, at)] @ slope), 0.0))
    return [Term("mass of the model", False, ((1 + y) * spread)[None])]


def _keys(one: FrequencyTable) -> dict[tuple[int, str, int], int]:
    return {
        (round(x / _SAME), condition, motion): index
        for index, (x, condition, motion) in enumerate(
            zip(one.position.tolist(), one.condition, one.motion, strict=True)
        )
    }


def _change(
    run: FrequencyTable,
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
    own: Array,
    load: float,
    by: Array | None = None,
) -> ComplianceChange:
    x = run.position[rows]
    away, u = x - model.centre, level ** (-1 / 3)
    whole = 1 + model.slope * away + model.curve * away**2 + model.share * (u - 1)
    bearing = bearing_share / whole
    along = (model.slope + 2 * model.curve * away) / whole
    by_load = mass * (1 + y)
    terms = [
        *terms,
        Term("declared load", False, (by_load * kept.load * load)[None]),
        Term("position", False, ((1 + y) * along * kept.position)[None]),
        Term("bearing", False, ((1 + y) * bearing * kept.bearing_drift / NORMAL_95)[None]),
        Term("shape of the model", False, np.vstack([shape, 2 * (1 + y) * _form(x, kept)])),
    ]
    return ComplianceChange(
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
        own=own,
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
