"""Frequencies of a run as arrays, with their own and their shared errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown
from ballscrew.base.json_fields import number
from ballscrew.base.quantity import Quantity
from ballscrew.modal.cell import CellKey, CellResult
from ballscrew.modal.run import RigidBodyResult, Run

_COLDEST = -273.15  # °C
_LARGEST = 1e300
_LEAST_POSITIVE = 1e-300
_MOST_CELLS = 2000  # of a run; their covariance has 32 MB
# Terms of the uncertainty that repeat from run to run.
_REPEATING = ("model", "clock", "damping", "load", "method", "window", "weights", "drives")
_CONTAINED = ("uncertain", "nearly-unloaded", "ripple")  # kinds of reasons that a cell's uncertainty contains

_FINITE = number(-_LARGEST, _LARGEST)
_POSITIVE = number(_LEAST_POSITIVE, _LARGEST)
_NOT_NEGATIVE = number(0.0, _LARGEST)
_TEMPERATURE = number(_COLDEST, _LARGEST)


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyTable:
    """Frequencies of one run, without refused cells.

    Parameters
    ----------
    id : str
        Of the run.
    axis, measured_at : str or None
        Name of the axis, and time of the run, ISO 8601.
    temperature : float or None
        Of the axis, °C.
    load : float
        On the table, kg.
    position : ndarray, shape (n,)
        m.
    condition : tuple of str
        PA, PD, NA or ND of each cell.
    motion : tuple of int
        Number of each cell's motion in the plan.
    frequency : ndarray, shape (n,)
        Hz.
    own : ndarray, shape (n,)
        Standard uncertainty by the error of each cell that it does not share with others, Hz.
    shared : ndarray, shape (k, n)
        Effect of each of k independent standard-normal errors on each cell, signed, Hz.
    shared_names : tuple of str
        Of these errors.
    repeats : ndarray of bool, shape (k,)
        Whether each of these errors repeats in another run.
    equivalent_mass : Quantity or None
        From the rigid-body fit, kg.
    mass_over_preload : Quantity or None
        Mass accelerated by the nut over preload, from the nut's softening under load, kg/N.
    verdict : str
        good, suspect or bad.
    reasons : tuple of str
        Why it is not good.
    temperature_range : float
        Highest less lowest temperature during the run, K.
    screw_excess : float or None
        Temperature of the screw above that of the nut, K.
    name : str
        File of the run, or the beginning of its id, for messages.
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
    temperature_range: float = 0.0
    screw_excess: float | None = None
    name: str = "run"


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """Cells of a run with a frequency, checked.

    ``rows`` are their indices in the run and ``names`` their places in its JSON, for messages; the arrays of
    shape (n,) are in m and Hz.
    """

    rows: list[int]
    cells: list[CellResult]
    names: list[str]
    motion: list[int]
    position: Array
    frequency: Array
    uncertainty: Array


@dataclass(frozen=True, slots=True, eq=False)
class _SharedEffect:
    """A shared error: its name, whether it repeats, and its effect on each cell, Hz."""

    name: str
    repeats: bool
    effects: Array


def frequency_table(run: Run) -> FrequencyTable:
    """Frequencies of a run, with their own and their shared errors.

    The own variance of a cell is that of its standard uncertainty less that of the shared errors. A run
    without shared errors states only terms of the uncertainty: by method joint all cells lie on one curve,
    and each term is shared, as a level and a tilt; by another method only the term "method" is shared, and
    the rest is each cell's own.

    Parameters
    ----------
    run : Run
        Analysed.

    Returns
    -------
    FrequencyTable
        Empty where every cell was refused; ``verdict`` is bad then.

    Raises
    ------
    InputError
        If the run has no load, or an impossible number.
    """
    name = run.name
    load = _NOT_NEGATIVE(run.mass_kg, f"{name}: run.mass_kg")
    cells = _usable_cells(run, name)
    shared = _stated_errors(run, cells, name)
    if not run.shared_errors:
        shared = _errors_of_terms(cells)
    effects = np.array([error.effects for error in shared]).reshape(len(shared), len(cells.rows))
    own = np.sqrt(np.maximum(cells.uncertainty**2 - np.sum(effects**2, axis=0), 0.0))
    temperature = run.temperature_C
    if temperature is not None:
        temperature = _TEMPERATURE(temperature, f"{name}: run.temperature_C")
    verdict, reasons = run.quality.verdict, tuple(run.quality.reasons)
    doubts = common_doubts(run)
    if doubts and verdict == "good":
        verdict, reasons = "suspect", tuple(text for _, text in doubts.values())
    if not cells.rows:
        verdict, reasons = "bad", (*reasons, "every cell was refused")
    return FrequencyTable(
        id=str(run.id),
        axis=run.axis,
        measured_at=run.measured_at,
        temperature=temperature,
        load=load,
        position=cells.position,
        condition=tuple(str(cell.condition) for cell in cells.cells),
        motion=tuple(cells.motion),
        frequency=cells.frequency,
        own=own,
        shared=effects,
        shared_names=tuple(error.name for error in shared),
        repeats=np.array([error.repeats for error in shared], dtype=bool),
        equivalent_mass=_equivalent_mass(run.rigid_body),
        mass_over_preload=_mass_over_preload(run, name),
        verdict=verdict,
        reasons=reasons,
        temperature_range=run.temperature.range_K if run.temperature else 0.0,
        screw_excess=run.temperature.screw_above_nut_K if run.temperature else None,
        name=run.name,
    )


def common_doubts(run: Run) -> dict[str, tuple[str, str]]:
    """Reasons by which at least half of a run's cells are suspect.

    Reasons that the uncertainty of a cell contains do not count.

    Parameters
    ----------
    run : Run
        Analysed.

    Returns
    -------
    dict
        By kind of reason, how many cells have it, "14 of 16", and the sentence of the first of these. Kinds
        that at least half of the cells have; where there is none, but all kinds together have half of the
        cells, all kinds.
    """
    usable = [cell for cell in run.cells if cell.frequency_Hz is not None]
    found: dict[str, dict[int, str]] = {}
    doubtful = set()
    for row, cell in enumerate(usable):
        for kind, text in cell.doubts():
            if kind not in _CONTAINED:
                found.setdefault(kind, {})[row] = text
                doubtful.add(row)
    if not doubtful or len(doubtful) < len(usable) / 2:
        return {}
    common = {kind: texts for kind, texts in found.items() if len(texts) >= len(usable) / 2}
    doubts = {}
    for kind, texts in (common or found).items():
        doubts[kind] = f"{len(texts)} of {len(usable)}", next(iter(texts.values()))
    return doubts


def _usable_cells(run: Run, name: str) -> _Cells:
    """Cells of a run with a frequency, their numbers checked."""
    rows, names, motions, numbers = [], [], [], []
    for row, cell in enumerate(run.cells):
        f, u = cell.frequency_Hz, cell.standard_uncertainty_Hz
        if cell.verdict == "refused" or f is None or u is None:
            continue
        where = f"{name}: cells[{row}]"
        rows.append(row)
        names.append(where)
        motions.append(int(_NOT_NEGATIVE(cell.motion, f"{where}.motion")))
        frequency = float(_POSITIVE(f, f"{where}.frequency_Hz"))
        uncertainty = float(_POSITIVE(u, f"{where}.standard_uncertainty_Hz"))
        position = float(_FINITE(cell.position_m, f"{where}.position_m"))
        numbers.append((position, frequency, uncertainty))
    if len(rows) > _MOST_CELLS:
        raise InputError(f"{name}: has {len(rows)} cells; it must have {_MOST_CELLS} or fewer.")
    columns = np.array(numbers).reshape(-1, 3).T
    return _Cells(rows, [run.cells[row] for row in rows], names, motions, *columns)


def _stated_errors(run: Run, cells: _Cells, name: str) -> list[_SharedEffect]:
    """Shared errors that a run states, at its usable cells."""
    shared = []
    for row, error in enumerate(run.shared_errors):
        where = f"{name}: shared_errors[{row}].effects_Hz"
        if len(error.effects_Hz) != len(run.cells):
            raise InputError(
                f"{where} has {len(error.effects_Hz)} numbers; it must have one for each of the "
                f"{len(run.cells)} cells."
            )
        effects = np.zeros(len(cells.rows))
        for at, cell in enumerate(cells.rows):
            if error.effects_Hz[cell] is not None:
                effects[at] = _FINITE(error.effects_Hz[cell], where)
        shared.append(_SharedEffect(str(error.name), bool(error.repeats), effects))
    return shared


def _errors_of_terms(cells: _Cells) -> list[_SharedEffect]:
    """Shared errors of a run that states terms of the uncertainty only."""
    terms: list[dict[str, float]] = []
    for cell, where in zip(cells.cells, cells.names, strict=True):
        row = {}
        for key, value in cell.uncertainty_terms_Hz.items():
            row[str(key)] = float(_NOT_NEGATIVE(value, f"{where}.uncertainty_terms_Hz.{shown(key)}"))
        terms.append(row)
    joint = bool(cells.cells) and all(cell.method == "joint" for cell in cells.cells)
    shared: list[_SharedEffect] = []
    if joint:
        for key in sorted(set().union(*terms)):
            shared += _level_and_tilt(key, _sizes(terms, key), cells.position)
    elif np.any(_sizes(terms, "method") > 0):
        shared.append(_SharedEffect("method", True, _sizes(terms, "method")))
    # Some terms exclude each other and only the larger counts, so that their sum can exceed the whole
    # uncertainty: they are then reduced to it.
    total = np.sqrt(sum((error.effects**2 for error in shared), np.zeros_like(cells.uncertainty)))
    part = cells.uncertainty / np.maximum(total, cells.uncertainty)
    return [_SharedEffect(error.name, error.repeats, error.effects * part) for error in shared]


def _sizes(terms: Sequence[dict[str, float]], key: str) -> Array:
    """Size of one term in each cell, Hz; 0 where a cell does not state it."""
    return np.array([row.get(key, 0.0) for row in terms])


def _level_and_tilt(key: str, size: Array, position: Array) -> list[_SharedEffect]:
    """A term as a level and a tilt, by which the two ends of the travel are uncorrelated.

    The sum of their squares in each cell is the square of the term.
    """
    if not np.any(size > 0):
        return []
    repeats = key in _REPEATING
    half_travel = float(np.ptp(position)) / 2
    if not half_travel > 0:
        return [_SharedEffect(f"{key}: level", repeats, size)]
    angle = math.pi / 4 * (position - position.mean()) / half_travel
    return [
        _SharedEffect(f"{key}: level", repeats, size * np.cos(angle)),
        _SharedEffect(f"{key}: tilt", repeats, size * np.sin(angle)),
    ]


def _equivalent_mass(body: RigidBodyResult) -> Quantity | None:
    """Equivalent mass of the rigid-body fit, checked; None without an uncertainty."""
    key = "equivalent_mass_kg"
    spread: Any = body.standard_uncertainty.get(key)
    if body.equivalent_mass_kg is None:
        return None
    value = _FINITE(body.equivalent_mass_kg, f"rigid_body.{key}")
    if spread is None:
        return None
    return Quantity(value, _NOT_NEGATIVE(spread, f"uncertainty of {key}"), "kg")


def _mass_over_preload(run: Run, name: str) -> Quantity | None:
    """Mass over preload by the softening of the nut under load, kg/N, checked."""
    softening = run.mass_over_preload_kg_per_N
    if softening is None:
        return None
    where = f"{name}: mass_over_preload_kg_per_N"
    spread = _NOT_NEGATIVE(softening.standard_uncertainty, where)
    return Quantity(_POSITIVE(softening.value, where), spread, "kg/N")


def paired_cells(run: FrequencyTable, baseline: FrequencyTable) -> tuple[list[int], list[int]]:
    """Rows of the cells that two runs have in common: same stop, condition and motion.

    Parameters
    ----------
    run, baseline : FrequencyTable
        Two runs.

    Returns
    -------
    of_run, of_baseline : list of int
        Rows of the same cell in each table, in the same order.
    """
    rows, baseline_rows = _rows_by_cell(run), _rows_by_cell(baseline)
    common = sorted(rows.keys() & baseline_rows.keys())
    return [rows[cell] for cell in common], [baseline_rows[cell] for cell in common]


def _rows_by_cell(run: FrequencyTable) -> dict[CellKey, int]:
    """Row of each cell, by its rounded key."""
    rows = {}
    positions = run.position.tolist()
    for row, (x, condition, motion) in enumerate(zip(positions, run.condition, run.motion, strict=True)):
        rows[CellKey(x, condition, motion).rounded] = row
    return rows
