"""Tests of the simulated plant: recordings that are analysed, and runs that imitate the analysed ones.

An imitated run has no recordings. Its frequencies are those of an analysed run of the same test, on the axis
or one of its type, times the ratio of the true frequencies of both, with errors of the size that the analysed
run states for causes that do not repeat.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.provenance import FileRef, digest
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.calibration import calibrate
from ballscrew.modal.analyze import analyze
from ballscrew.modal.cell import CellResult
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.reproduction.plant import PlantAxis, random_of, rig_of, temperature
from ballscrew.testbed.linear import true_frequency
from ballscrew.testbed.machine import constants
from ballscrew.testbed.run import simulate_run

_TRUE = 0.75
"""True errors over the stated ones, from run to run: 0.72 and 0.84 in 174 runs of 29 random axes."""

_RANDOM = ("noise", "conditions", "residual")  # terms of which each run has an error of its own
_SOFTENING_ERROR = 0.03  # of moving mass over preload
_CALIBRATION_RUNS = 3


@dataclass(frozen=True, slots=True)
class TrueState:
    """What a test depends on, as it truly is.

    Parameters
    ----------
    free, rotor_held : ndarray, shape (stops,)
        Natural frequencies, Hz.
    preload : float
        Mean over the stops, N.
    coulomb : float
        Friction of guide and nut, N.
    """

    free: Array
    rotor_held: Array
    preload: float
    coulomb: float


Template = tuple[Run, TrueState]


@dataclass(frozen=True, slots=True)
class AxisHistory:
    """Tests of an axis.

    Parameters
    ----------
    axis : PlantAxis
        The axis.
    runs : dict of int to Run
        Analysed and imitated runs, by their weeks.
    recordings : dict of int to Path
        RUN.toml of the recorded tests, by their weeks; those of the runs that are missing in ``runs`` are not
        analysed yet.
    model : CalibratedAxis or None
        Model of the axis.
    template : tuple of (Run, TrueState) or None
        Its first analysed run, which other axes may imitate.
    """

    axis: PlantAxis
    runs: dict[int, Run]
    recordings: dict[int, Path]
    model: CalibratedAxis | None
    template: Template | None


def record_tests(axis: PlantAxis, present: datetime, seed: int, folder: Path) -> dict[int, Path]:
    """Simulate the recordings of an axis.

    Parameters
    ----------
    axis : PlantAxis
        The axis.
    present : datetime
        Present time, at which the history ends.
    seed : int
        Of the plant.
    folder : Path
        Folder for the recordings.

    Returns
    -------
    dict of int to Path
        RUN.toml of each recorded test, by its week.
    """
    recordings = {}
    for week in sorted({*axis.recorded, *axis.templates}):
        recordings[week] = _record(axis, week, present, seed, folder / f"week-{week}")
    return recordings


def make_history(
    axis: PlantAxis,
    present: datetime,
    seed: int,
    recordings: dict[int, Path],
    template: Template | None = None,
) -> AxisHistory:
    """Analyse some recordings of an axis, and imitate the other tests.

    Parameters
    ----------
    axis : PlantAxis
        The axis.
    present : datetime
        Present time, at which the history ends.
    seed : int
        Of the plant.
    recordings : dict of int to Path
        As from :func:`record_tests`.
    template : tuple of (Run, TrueState), optional
        Run that the first tests imitate, by default that of the first one of the axis.

    Returns
    -------
    AxisHistory
        Runs, recordings and model.
    """
    runs: dict[int, Run] = {}
    first = None
    for week in axis.weeks:
        if week in axis.templates:
            runs[week] = replace(analyze(recordings[week]), frequency_response=None)
            template = runs[week], _true_state(axis, week, seed)
            first = first or template
        elif axis.calibrated and template is not None and week not in recordings:
            run, then = template
            imitated = imitate_run(run, then, _true_state(axis, week, seed), random_of(axis, seed, week, 2))
            runs[week] = _dated(imitated, axis, week, present, seed)
    return AxisHistory(axis, runs, recordings, _model(axis, runs), first)


def _record(axis: PlantAxis, week: int, present: datetime, seed: int, folder: Path) -> Path:
    """Simulate the recordings of a test; its RUN.toml."""
    files = simulate_run(
        rig_of(axis, week, seed),
        axis.type.plan,
        axis.type.load,
        folder,
        seed=int(random_of(axis, seed, week, 3).integers(2**31)),
        sheet=axis.sheet,
        measured_at=axis.measured_at(week, present).isoformat(),
        workers=1,
    )
    with files.run.open("a", encoding="utf-8", newline="\n") as stream:
        stream.write(f'temperature = "{temperature(axis, week, seed)} degC"\n')
    return files.run


def _model(axis: PlantAxis, runs: dict[int, Run]) -> CalibratedAxis | None:
    """Model by the first runs; None for an axis that has none."""
    if not axis.calibrated:
        return None
    return calibrate(list(runs.values())[:_CALIBRATION_RUNS], axis.sheet)


def _true_state(axis: PlantAxis, week: int, seed: int) -> TrueState:
    machine, places = rig_of(axis, week, seed).machine, axis.type.plan.positions
    c = constants(machine, axis.type.load, (places[0] + places[-1]) / 2)
    return TrueState(
        free=np.array([true_frequency(c, place) for place in places]),
        rotor_held=np.array([true_frequency(c, place, rotor_fixed=True) for place in places]),
        preload=float(machine.local_preload(places).mean()),
        coulomb=c.coulomb + c.drag,
    )


def imitate_run(template: Run, then: TrueState, state: TrueState, random: np.random.Generator) -> Run:
    """Run of the test of another run, at another time or on another axis of the type.

    Parameters
    ----------
    template : Run
        Analysed.
    then, state : TrueState
        True state at the template, and at the new run.
    random : Generator
        Errors of the new run.

    Returns
    -------
    Run
        With the id, time and temperature of the template.
    """
    stops = sorted({cell.position_m for cell in template.cells})
    free = dict(zip(stops, np.log(state.free / then.free).tolist(), strict=True))
    rotor_held = dict(zip(stops, np.log(state.rotor_held / then.rotor_held).tolist(), strict=True))
    errors = _errors(template, random)
    cells = []
    for cell, error in zip(template.cells, errors.tolist(), strict=True):
        ratio = math.exp(free[cell.position_m])
        rotor_held_ratio = math.exp(rotor_held[cell.position_m])
        shift = _TRUE * (cell.deviation_standard_uncertainty_Hz or 0.0) * random.standard_normal()
        cells.append(_moved(cell, ratio, rotor_held_ratio, error, shift, then.preload / state.preload))
    shared = []
    for term in template.shared_errors:
        effects = []
        for cell, effect in zip(template.cells, term.effects_Hz, strict=True):
            effects.append(effect * math.exp(free[cell.position_m]))
        shared.append(replace(term, effects_Hz=tuple(effects)))
    over = template.mass_over_preload_kg_per_N
    if over is not None:
        factor = then.preload / state.preload * math.exp(_SOFTENING_ERROR * random.standard_normal())
        over = Quantity(factor * over.value, factor * over.standard_uncertainty, over.unit)
    return replace(
        template,
        rigid_body=_rigid_body(template.rigid_body, state.coulomb / then.coulomb, random),
        transients=(),
        cells=tuple(cells),
        shared_errors=tuple(shared),
        mass_over_preload_kg_per_N=over,
    )


def _errors(template: Run, random: np.random.Generator) -> Array:
    """Error of each cell by causes that do not repeat, as a part of its frequency."""
    total = np.zeros(len(template.cells))
    for term in template.shared_errors:
        if term.name in _RANDOM and not term.repeats:
            total += _TRUE * random.standard_normal() * np.array(term.effects_Hz)
    frequencies = np.array([cell.frequency_Hz or 1.0 for cell in template.cells])
    return np.asarray(total / frequencies)


def _moved(
    cell: CellResult, ratio: float, rotor_held_ratio: float, error: float, shift: float, softer: float
) -> CellResult:
    """Cell at another frequency."""
    if cell.frequency_Hz is None or cell.standard_uncertainty_Hz is None:
        return cell
    rotor_held, uncertainty = cell.rotor_held_frequency_Hz, cell.rotor_held_standard_uncertainty_Hz
    deviation, load = cell.deviation_Hz, cell.nut_load_over_preload
    if rotor_held is not None and uncertainty is not None:
        rotor_held, uncertainty = rotor_held * rotor_held_ratio * (1 + error), uncertainty * rotor_held_ratio
    if deviation is not None:
        deviation = deviation * ratio + shift
    if load is not None:
        load *= softer
    terms = {name: ratio * value for name, value in cell.uncertainty_terms_Hz.items()}
    return replace(
        cell,
        frequency_Hz=cell.frequency_Hz * ratio * (1 + error),
        standard_uncertainty_Hz=cell.standard_uncertainty_Hz * ratio,
        uncertainty_terms_Hz=terms,
        rotor_held_frequency_Hz=rotor_held,
        rotor_held_standard_uncertainty_Hz=uncertainty,
        deviation_Hz=deviation,
        nut_load_over_preload=load,
    )


def _rigid_body(body: RigidBodyResult, friction: float, random: np.random.Generator) -> RigidBodyResult:
    """Masses and friction of another run, with errors by their repeatability."""
    moved = {}
    for name in ("equivalent_mass_kg", "viscous_N_s_per_m", "coulomb_N"):
        value = getattr(body, name)
        if value is not None:
            moved[name] = value + body.repeatability.get(name, 0.0) * float(random.standard_normal())
    if "coulomb_N" in moved:
        moved["coulomb_N"] *= friction
    mass, whole = body.moving_mass_kg, body.equivalent_mass_kg
    if mass is not None and whole is not None:
        moved["moving_mass_kg"] = mass + moved["equivalent_mass_kg"] - whole
    return replace(body, **moved)


def _dated(run: Run, axis: PlantAxis, week: int, present: datetime, seed: int) -> Run:
    """An imitated run with its own time, temperature and id; its recordings were not stored."""
    measured_at = axis.measured_at(week, present).isoformat()
    identity = digest([axis.name, measured_at, seed, "imitated"])
    files = []
    for number, file in enumerate(run.files):
        files.append(FileRef(file.name, digest([identity, number])))
    sheet = digest(axis.sheet.to_settings())
    made = replace(run.made, inputs=run.made.inputs | {"axis": sheet, "imitated": run.id})
    return replace(
        run,
        id=identity,
        axis=axis.name,
        measured_at=measured_at,
        temperature_C=temperature(axis, week, seed),
        files=tuple(files),
        made=made,
    )
