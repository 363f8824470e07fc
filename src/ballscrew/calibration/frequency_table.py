"""What a run says of its frequencies: numbers, and how their errors hang together."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.frequency import Rotor
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.checked import mass_of, number, quantity_of
from ballscrew.modal.run import CellResult, Run

__all__ = ["REPEATS", "FrequencyTable", "covariance", "frequency_table", "joint_covariance"]


REPEATS = 0.9
"""Correlation from run to run of an error that repeats: between two runs a tenth of its variance is new."""

_COLDEST = -273.15  # °C
_MOST_CELLS = 2000  # as many make a covariance of 32 MB
_NO_NOISE = ("model", "load", "method", "window", "weights", "drives")  # terms that repeat, of older files


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyTable:
    """The mode table of one run as numbers, its refused cells left out.

    Parameters
    ----------
    id : str
        Of the run.
    axis, measured_at : str or None
        Name of the axis; ISO 8601.
    temperature : float or None
        °C.
    load : float
        On the table, kg.
    position : ndarray, shape (n,)
        m.
    condition : tuple of str
        PA, PD, NA or ND of each cell.
    motion : tuple of int
        Of each cell.
    frequency : ndarray, shape (n,)
        Hz.
    own : ndarray, shape (n,)
        Standard uncertainty that is the cell's own, Hz.
    shared : ndarray, shape (k, n)
        Effect of each of k independent standard-normal causes on each cell, signed, Hz.
    shared_names : tuple of str
        Of the causes.
    repeats : ndarray of bool, shape (k,)
        Whether a cause acts alike in another run.
    equivalent_mass : Quantity or None
        From the rigid-body fit, kg.
    mass_over_preload : Quantity or None
        Mass that the nut accelerates over preload, as the nut's softening under load tells it, kg/N.
    verdict : str
        good, suspect or bad.
    reasons : tuple of str
        Why it is not good.
    rotor : {"free", "held"}
        Of which mode the frequencies are.
    """

    id: str
    axis: str | None
    measured_at: str | None
    temperature: float | None
    load: float
    position: Array
    condition: tuple[str, ...]
    motion: tuple[int, ...]
    frequency: Array
    own: Array
    shared: Array
    shared_names: tuple[str, ...]
    repeats: NDArray[np.bool_]
    equivalent_mass: Quantity | None
    mass_over_preload: Quantity | None
    verdict: str
    reasons: tuple[str, ...]
    rotor: Rotor = "free"


def frequency_table(run: Run, *, rotor: Rotor = "free") -> FrequencyTable:
    """Take the frequencies of a run, with their own and their shared errors.

    A cell's variance is that of its standard uncertainty; what the run's shared errors do not make of it is
    the cell's own. A document without shared errors tells parts of the uncertainty only: of the joint method
    all cells lie on one curve, so every part counts as shared, its level and its tilt alike; of another
    method the parts that repeat are shared and the rest is each cell's own.

    Parameters
    ----------
    run : Run
        As ``analyze`` made it.
    rotor : {"free", "held"}
        Which of the two frequencies.

    Returns
    -------
    FrequencyTable
        Empty where every cell was refused; ``verdict`` then says so.

    Raises
    ------
    InputError
        If the run tells no load, or a number that cannot be.
    """
    name = f"run {shown(run.id)[1:13]}"
    load = number(run.mass_kg, f"{name}: run.mass_kg", 0.0)
    kept = [i for i, cell in enumerate(run.cells) if _told(cell, rotor) is not None]
    if len(kept) > _MOST_CELLS:
        raise InputError(f"{name}: has {len(kept)} cells; it must have {_MOST_CELLS} or fewer.")
    cells = [run.cells[i] for i in kept]
    told = [_told(cell, rotor) or (0.0, 0.0) for cell in cells]
    where = [f"{name}: cells[{i}]" for i in kept]
    f = np.array([number(t[0], f"{w}.frequency_Hz", 0.0, True) for t, w in zip(told, where, strict=True)])
    u = np.array(
        [number(t[1], f"{w}.standard_uncertainty_Hz", 0.0, True) for t, w in zip(told, where, strict=True)]
    )
    place = np.array([number(c.position_m, f"{w}.position_m") for c, w in zip(cells, where, strict=True)])
    scale = np.array([_scale(c, frequency) for c, frequency in zip(cells, f, strict=True)])
    causes = _causes(run, kept, cells, place, scale, u, name)
    shared = np.array([cause[2] for cause in causes]).reshape(len(causes), len(cells))
    left = np.sqrt(np.maximum(u**2 - np.sum(shared**2, axis=0), 0.0))
    names, repeats = [cause[0] for cause in causes], [cause[1] for cause in causes]
    if rotor == "held" and causes:  # the causes are of the free mode: what they leave hangs together too
        shared = np.vstack([shared, left])
        names, repeats, left = [*names, "held"], [*repeats, True], np.zeros_like(left)
    rigid, warm = run.rigid_body, run.temperature_C
    return FrequencyTable(
        id=str(run.id),
        axis=run.axis,
        measured_at=run.measured_at,
        temperature=None if warm is None else number(warm, f"{name}: run.temperature_C", _COLDEST),
        load=load,
        position=place,
        condition=tuple(str(cell.condition) for cell in cells),
        motion=tuple(int(number(c.motion, f"{w}.motion", 0.0)) for c, w in zip(cells, where, strict=True)),
        frequency=f,
        own=left,
        shared=shared,
        shared_names=tuple(names),
        repeats=np.array(repeats, dtype=bool),
        equivalent_mass=mass_of(rigid.equivalent_mass_kg, rigid.standard_uncertainty, "equivalent_mass_kg"),
        mass_over_preload=quantity_of(getattr(run, "mass_over_preload_kg_per_N", None), name),
        verdict=run.quality.verdict if cells else "bad",
        reasons=tuple(run.quality.reasons) if cells else (*run.quality.reasons, "every cell was refused"),
        rotor=rotor,
    )


def covariance(one: FrequencyTable) -> Array:
    """Covariance of a run's frequencies, Hz².

    Parameters
    ----------
    one : FrequencyTable
        Of n cells.

    Returns
    -------
    ndarray, shape (n, n)
        Shared causes and the cells' own.
    """
    return np.asarray(one.shared.T @ one.shared + np.diag(one.own**2))


def joint_covariance(runs: Sequence[FrequencyTable], correlation: float = REPEATS) -> Array:
    """Covariance of the frequencies of several runs, one after the other, Hz².

    A cause that repeats has the stated correlation with the cause of its name in every other run; where a
    run has several of one name, the first with the first. All others are drawn anew.

    Parameters
    ----------
    runs : sequence of FrequencyTable
        Of n cells together.
    correlation : float
        Between 0 and 1.

    Returns
    -------
    ndarray, shape (n, n)
        Positive semi-definite.

    Raises
    ------
    InputError
        If the correlation is none.
    """
    if not 0 <= correlation <= 1:
        raise InputError(f"a correlation of {correlation:g} was given; it must lie between 0 and 1.")
    edges = np.concatenate([[0], np.cumsum([len(run.frequency) for run in runs])]).astype(int)
    spans = [slice(int(start), int(stop)) for start, stop in pairwise(edges)]
    whole = np.zeros((edges[-1], edges[-1]))
    keyed = [_keyed(run) for run in runs]
    for i, run in enumerate(runs):
        whole[spans[i], spans[i]] = covariance(run)
        for j in range(i):
            for key in keyed[i].keys() & keyed[j].keys():
                block = correlation * np.outer(keyed[i][key], keyed[j][key])
                whole[spans[i], spans[j]] += block
                whole[spans[j], spans[i]] += block.T
    return whole


def _keyed(run: FrequencyTable) -> dict[tuple[str, int], Array]:
    """Repeating causes by name and by which of that name they are."""
    seen: Counter[str] = Counter()
    found = {}
    for name, repeats, effects in zip(run.shared_names, run.repeats, run.shared, strict=True):
        if repeats:
            found[name, seen[name]] = effects
            seen[name] += 1
    return found


def _told(cell: CellResult, rotor: Rotor) -> tuple[Any, Any] | None:
    if rotor not in ("free", "held"):
        raise InputError(f"the rotor is {rotor!r}; it must be 'free' or 'held'")
    if cell.verdict == "refused":
        return None
    told = (
        (cell.frequency_Hz, cell.standard_uncertainty_Hz)
        if rotor == "free"
        else (cell.rotor_held_frequency_Hz, cell.rotor_held_standard_uncertainty_Hz)
    )
    return None if told[0] is None or told[1] is None else told


def _scale(cell: CellResult, frequency: float) -> float:
    """From Hz of the free mode to Hz of the mode that is used."""
    free = cell.frequency_Hz
    usable = isinstance(free, (int, float)) and math.isfinite(free) and free > 0
    return frequency / float(free or 1.0) if usable else 1.0


def _causes(
    run: Run,
    kept: Sequence[int],
    cells: Sequence[CellResult],
    place: Array,
    scale: Array,
    u: Array,
    name: str,
) -> list[tuple[str, bool, Array]]:
    told = getattr(run, "shared_errors", ()) or ()
    if not told:
        older = _older(cells, place, scale, name)
        # Parts of which the larger counts, not both, add up to more than the whole.
        fits = u / np.maximum(np.sqrt(sum((part[2] ** 2 for part in older), np.zeros_like(u))), u)
        return [(key, repeats, effects * fits) for key, repeats, effects in older]
    causes = []
    for row, cause in enumerate(told):
        where = f"{name}: shared_errors[{row}].effects_Hz"
        if len(cause.effects_Hz) != len(run.cells):
            raise InputError(
                f"{where} has {len(cause.effects_Hz)} numbers; it must have one for each of the "
                f"{len(run.cells)} cells."
            )
        effects = [cause.effects_Hz[i] for i in kept]
        numbers = np.array([0.0 if e is None else number(e, where) for e in effects])
        causes.append((str(cause.name), bool(cause.repeats), numbers * scale))
    return causes


def _older(
    cells: Sequence[CellResult], place: Array, scale: Array, name: str
) -> list[tuple[str, bool, Array]]:
    terms = [
        {
            str(k): number(v, f"{name}: uncertainty_terms_Hz.{shown(k)}", 0.0)
            for k, v in cell.uncertainty_terms_Hz.items()
        }
        for cell in cells
    ]
    joint = bool(cells) and all(cell.method == "joint" for cell in cells)
    names = sorted({key for row in terms for key in row}) if joint else ["method"]
    half = float(np.ptp(place)) / 2 if len(place) else 0.0
    turn = math.pi / 4 * (place - place.mean()) / half if half > 0 else np.zeros_like(place)
    causes = []
    for key in names:
        size = np.array([row.get(key, 0.0) for row in terms]) * scale
        if not np.any(size > 0):
            continue
        if not joint:
            causes.append((key, True, size))
            continue
        # Level and tilt: their squares add up to the term, and the two ends of the travel do not correlate.
        causes.append((f"{key}: level", key in _NO_NOISE, size * np.cos(turn)))
        if half > 0:
            causes.append((f"{key}: tilt", key in _NO_NOISE, size * np.sin(turn)))
    return causes
