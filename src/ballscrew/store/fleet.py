"""Synthetic rows of a fleet, to measure how a store behaves at size; nothing is analysed."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import zstandard
from sqlalchemy import insert
from sqlalchemy.orm import Session

from ballscrew._version import __version__
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.files import Progress, ignore_progress
from ballscrew.base.provenance import Made, digest
from ballscrew.modal.cell import CellResult
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.recording.quality.finding import Quality
from ballscrew.store.folder import now
from ballscrew.store.inserting import axis_row, method_row
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.rows import pack
from ballscrew.store.tables import (
    Assessment,
    CellRow,
    EpochRow,
    MachineRow,
    Model,
    RecordingRow,
    ResultRow,
    RunRow,
    StateRow,
)

_BEGIN = datetime(2021, 1, 4, 6, tzinfo=UTC)
_AXES_OF_A_SITE = 30
_FREQUENCY, _SPREAD = 150.0, 0.15  # Hz, of a cell
_MARK = 111.0  # Hz, in place of a cell's frequency in the text of RUN.json
_DESIGN = np.array([1.0, 0.1]).tobytes()
_BATCH = 20_000  # rows in memory
_CONDITIONS = ("PA", "PD", "NA", "ND")


def simulate_fleet(
    store: OpenStore,
    *,
    axes: int = 300,
    years: float = 5.0,
    runs_per_week: float = 1.0,
    cells: int = 40,
    seed: int = 0,
    progress: Progress = ignore_progress,
) -> dict[str, Any]:
    """Add the rows of axes that wear, with their runs, results, cells, states and assessments.

    Parameters
    ----------
    store : OpenStore
        The store.
    axes : int
        Number of axes.
    years : float
        Length of their histories.
    runs_per_week : float
        Of each axis.
    cells : int
        Of each run.
    seed : int
        Random seed.
    progress : callable
        Called after each axis.

    Returns
    -------
    dict
        Document of ``store simulate-fleet --json``: numbers of axes, runs and cells.

    Raises
    ------
    InputError
        If a number is out of range.
    """
    if axes < 1 or cells < 1 or not 0 < years <= 50 or not 0 < runs_per_week <= 100:
        raise InputError(
            "a fleet has 1 or more axes and cells, 50 years at most and 100 runs a week at most."
        )
    number = max(int(years * 365.25 / 7 * runs_per_week), 1)
    days = np.arange(number) * 7 / runs_per_week
    for index in range(axes):
        random = np.random.default_rng([seed, index])
        with store.write("store simulate-fleet") as session:
            _add_axis(session, f"simulated {seed}-{index:05d}", index, days, cells, random)
        progress(index + 1, axes, f"axis {index}")
    return {"axes": axes, "runs": axes * number, "cells": axes * number * cells}


def _add_axis(
    session: Session, name: str, index: int, days: Array, cells: int, random: np.random.Generator
) -> None:
    """Rows of one axis, in one transaction."""
    axis = axis_row(session, name)
    if axis.machine_id is not None:
        raise InputError(f"the store has the axis {name!r} already; give another seed.")
    machine = MachineRow(site=f"site {index // _AXES_OF_A_SITE}", name=f"machine of {name}")
    model = Model(digest=digest(name), axis_id=axis.id, document=pack({"axis": name}), added_at=now())
    session.add_all([machine, model])
    template = _template(name, cells)
    method = method_row(session, template, 1)
    session.flush()
    axis.machine_id, axis.method_id, axis.runs = machine.id, method.id, len(days)
    level = np.where(days > 0.8 * days[-1], (days - 0.8 * days[-1]) * 2e-5, 0.0)
    level = level + 1e-4 * random.standard_normal(len(days))
    frequency = _FREQUENCY * (1 - 0.1 * level[:, None]) + _SPREAD * random.standard_normal((len(days), cells))
    runs = [row.id for row in _insert(session, RunRow, _run_rows(name, axis.id, days))]
    results = _insert(session, ResultRow, _result_rows(runs, method.id, template, days, frequency))
    recordings = [
        {"run_id": run, "place": 0, "name": "trip.h5", "sha256": _id(name, day)}
        for run, day in zip(runs, days.tolist(), strict=True)
    ]
    session.execute(insert(RecordingRow), recordings)
    keys = [cell.key for cell in template.cells]
    rows = []
    for result, row in zip(results, frequency, strict=True):
        rows += _cell_rows(result.id, keys, row)
        if len(rows) > _BATCH:
            session.execute(insert(CellRow), rows)
            rows = []
    if rows:
        session.execute(insert(CellRow), rows)
    session.add(_epoch(axis.id))
    session.flush()
    _insert(session, StateRow, _state_rows(axis.id, runs, days, level))
    assessment = _assessment(axis.id, method.id, model.digest, days, level)
    session.add(assessment)
    session.flush()
    axis.assessment_id = assessment.id
    record(session, "simulate", f"axis {name}", runs=len(days))


def _insert(session: Session, kind: type[Any], rows: Iterator[dict[str, Any]]) -> list[Any]:
    """Insert rows; their objects, in order."""
    objects = [kind(**row) for row in rows]
    session.add_all(objects)
    session.flush()
    return objects


def _time(day: float) -> datetime:
    return _BEGIN + timedelta(days=day)


def _id(name: str, day: float) -> str:
    return digest([name, day])


def _template(name: str, cells: int) -> Run:
    """A run whose cells have a frequency that is replaced."""
    rows = []
    for place in range(cells):
        stop, condition = divmod(place, len(_CONDITIONS))
        rows.append(
            CellResult(
                round(0.045 * stop, 3), _CONDITIONS[condition], 0, 10, _MARK, 0.2, 0.03, "joint", "good", (),
                uncertainty_terms_Hz={"noise": 0.15, "load": 0.1, "local": 0.08}, deviation_Hz=0.05,
                rotor_held_frequency_Hz=120.0, rotor_held_standard_uncertainty_Hz=0.3,
                deviation_standard_uncertainty_Hz=0.1,
            )
        )  # fmt: skip
    return Run(
        id="ID", axis=name, mass_kg=100.0, measured_at="TIME", temperature_C=23.0, files=(),
        quality=Quality("good"), rigid_body=RigidBodyResult(equivalent_mass_kg=289.0), transients=(),
        cells=tuple(rows), made=Made({"method": "joint"}),
    )  # fmt: skip


def _run_rows(name: str, axis: int, days: Array) -> Iterator[dict[str, Any]]:
    for day in days.tolist():
        yield {
            "run": _id(name, day), "axis_id": axis, "measured_at": _time(day).isoformat(),
            "time": _time(day).timestamp(), "mass_kg": 100.0, "temperature_C": 23.0, "supersedes": None,
            "received_at": now(),
        }  # fmt: skip


def _result_rows(
    runs: list[int], method: int, template: Run, days: Array, frequency: Array
) -> Iterator[dict[str, Any]]:
    """Rows with RUN.json, made from a text: each from its object would take hours."""
    document = template.to_json()
    document["run"]["files"] = [{"name": "trip.h5", "sha256": "ID"}]
    text = json.dumps(document, sort_keys=True, separators=(",", ":"))
    parts = text.split(str(_MARK))
    compressor = zstandard.ZstdCompressor(level=3)
    for run, day, row in zip(runs, days.tolist(), frequency.tolist(), strict=True):
        pieces = [parts[0]]
        for value, part in zip(row, parts[1:], strict=True):
            pieces += [f"{value:.9g}", part]
        filled = "".join(pieces).replace('"ID"', f'"{_id(str(template.axis), day)}"')
        filled = filled.replace('"TIME"', f'"{_time(day).isoformat()}"')
        yield {
            "run_id": run, "method_id": method, "version": __version__, "verdict": "good", "reasons": None,
            "document": compressor.compress(filled.encode()), "added_at": now(),
        }  # fmt: skip


def _cell_rows(result: int, keys: list[Any], frequency: Array) -> list[dict[str, Any]]:
    rows = []
    for place, (key, value) in enumerate(zip(keys, frequency.tolist(), strict=True)):
        rows.append(
            {
                "result_id": result, "place": place, "position_m": key.position, "condition": key.condition,
                "motion": key.motion, "frequency_Hz": float(f"{value:.9g}"), "standard_uncertainty_Hz": 0.2,
                "verdict": "good", "reasons": None,
            }
        )  # fmt: skip
    return rows


def _epoch(axis: int) -> EpochRow:
    return EpochRow(
        axis_id=axis, number=0, begins=None, ends=None, cause="", reference=None, alarm_at=None,
        coefficients=[0.0, 0.0], covariance=[[1e-9, 0.0], [0.0, 1e-9]], scale=1.0, share_uncertainty=0.1,
    )  # fmt: skip


def _state_rows(axis: int, runs: list[int], days: Array, level: Array) -> Iterator[dict[str, Any]]:
    for place, (run, day, value) in enumerate(zip(runs, days.tolist(), level.tolist(), strict=True)):
        yield {
            "run_id": run, "axis_id": axis, "time": _time(day).timestamp(), "epoch": 0,
            "state": "learning" if place < 3 else "normal", "verdict": "good", "level": value,
            "random": 1e-4, "systematic": 1e-5, "unknown_temperature": 0.0, "design": _DESIGN,
            "ramp": 0.5, "ramp_limit": 4.0, "odds": 1.5, "odds_limit": 900.0, "nut": 1.0, "nut_low": 0.9,
            "nut_high": 1.1, "reasons": None,
        }  # fmt: skip


def _assessment(axis: int, method: int, model: str, days: Array, level: Array) -> Assessment:
    ratio = float((1 + level[-1]) ** -3)
    return Assessment(
        axis_id=axis,
        inputs=digest([axis, "simulated"]),
        made_at=now(),
        version=__version__,
        method_id=method,
        model_digest=model,
        settings={},
        runs=len(days),
        newest_at=_time(float(days[-1])).isoformat(),
        state="normal",
        urgency="none",
        verdict="good",
        alarm_at=None,
        stiffness=[ratio, ratio - 0.01, ratio + 0.01],
        rul_days={"0.05": 300, "0.5": 900, "0.95": None},
        reasons=None,
    )
