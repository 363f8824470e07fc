"""Curves of an axis as columns, for charts: runs with the forecast, frequencies, friction, lost motion."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from fastapi import APIRouter
from fastapi.responses import Response
from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, plain
from ballscrew.service.access import RunningService, ViewerCaller
from ballscrew.service.serving import RefusedError
from ballscrew.store.alarms import alarm_documents
from ballscrew.store.explaining import find_explanation
from ballscrew.store.histories import axis_events
from ballscrew.store.methods import used_results
from ballscrew.store.reading import current_rows, find_axis, trend
from ballscrew.store.rows import unpack
from ballscrew.store.tables import Axis, CellRow, EpochRow, ResultRow, RunRow, StateRow

router = APIRouter(prefix="/api/v1/axes/{axis:path}")

_BASELINE = 3  # runs, of an axis without one
_UNKNOWN = {"state": "unknown", "epoch": None, "stiffness": None, "nut": None}
_RIGID_BODY = ("coulomb_N", "viscous_N_s_per_m", "equivalent_mass_kg")


@router.get("/trend")
def show_trend(axis: str, caller: ViewerCaller, service: RunningService) -> Response:  # noqa: ARG001
    """Runs of an axis as columns in time order, with epochs, events, alarms and the forecast.

    ``runs`` has a column for each quantity: ``stiffness`` and ``nut`` consist of value and 95 % interval,
    ``ramp`` and ``odds`` are relative to their limits of alarm; ``ahead`` is that of the explanation. Runs
    that do not count or have no time are left out.
    """
    with service.store.read() as session:
        row = axis_of(session, axis)
        document = {
            "runs": _trend_columns(session, row),
            "epochs": _times(session, EpochRow, row, "number", "begins", "ends", "cause", "alarm_at"),
            "events": [event.to_json() for event in axis_events(session, row)],
            "alarms": _alarms(session, row),
            "ahead": (find_explanation(session, row) or {}).get("ahead"),
        }
    return answer_columns(axis, document)


def _alarms(session: Session, axis: Axis) -> list[dict[str, Any]]:
    """Begin of each alarm of an axis, and since when it does not stand."""
    found = [each for each in alarm_documents(session, axis) if each["kind"] == "axis"]
    return [{"began_at": each["began_at"], "ended_at": each["ended_at"]} for each in reversed(found)]


@router.get("/frequencies")
def show_frequencies(axis: str, caller: ViewerCaller, service: RunningService) -> Response:  # noqa: ARG001
    """Natural frequency of an axis by run and stop: the mean over the cells of the stop.

    ``relative`` is that over the baseline: for each cell the median of the runs from which its epoch was
    learned, or of the first three where the axis was not assessed. Neither is corrected for load or
    temperature.
    """
    with service.store.read() as session:
        row = axis_of(session, axis)
        runs = timed_runs(session, row)
        columns = (CellRow.position_m, CellRow.condition, CellRow.motion, CellRow.frequency_Hz)
        cells = used_columns(session, row, *columns, of_cells=True)
        states = _baseline_states(session, row)
    return answer_columns(axis, _frequency_columns(runs, cells, states))


@router.get("/mechanics")
def show_mechanics(axis: str, caller: ViewerCaller, service: RunningService) -> Response:  # noqa: ARG001
    """Friction, equivalent mass and lost motion of an axis by run.

    Each consists of the value and its standard uncertainty; lost motion of the median, least and greatest
    of its stops.
    """
    with service.store.read() as session:
        row = axis_of(session, axis)
        runs = timed_runs(session, row)
        found = used_columns(session, row, ResultRow.document)
    documents = {number: unpack(content) for number, content in found}
    columns: dict[str, list[Any]] = {"run": [], "time": [], "lost_motion_m": []}
    columns |= {name: [] for name in _RIGID_BODY}
    for run in runs:
        document = documents.get(run.id, {})
        columns["run"].append(run.run)
        columns["time"].append(run.time)
        columns["lost_motion_m"].append(_lost_motion(document.get("lost_motion") or []))
        for name in _RIGID_BODY:
            columns[name].append(_rigid_body(document.get("rigid_body") or {}, name))
    return answer_columns(axis, columns)


def axis_of(session: Session, name: str) -> Axis:
    """Row of an axis.

    Raises
    ------
    RefusedError
        404 if there is none.
    """
    try:
        return find_axis(session, name)
    except InputError as error:
        raise RefusedError(404, str(error)) from None


def answer_columns(axis: str, document: dict[str, Any]) -> Response:
    """Columns as JSON: FastAPI would copy each number."""
    text = json.dumps({"schema": SCHEMA, "axis": axis} | document, separators=(",", ":"), allow_nan=False)
    return Response(text, media_type="application/json", headers={"Cache-Control": "no-store"})


def timed_runs(session: Session, axis: Axis) -> list[Any]:
    """Rows of the runs of an axis that count and have a time, in its order."""
    return [row for row in current_rows(session, axis) if row.time is not None]


def used_columns(session: Session, axis: Axis, *columns: Any, of_cells: bool = False) -> list[Any]:
    """Number of the run, and columns of its result in the history of an axis, or of the cells of it."""
    used = used_results(session, axis).values()
    counting = {result.row for result in used}
    found = select(ResultRow.id, RunRow.id, *columns).select_from(RunRow)
    found = found.join(ResultRow, ResultRow.run_id == RunRow.id)
    if of_cells:
        found = found.join(CellRow, CellRow.result_id == ResultRow.id)
    methods = {result.used.method.id for result in used}
    found = found.where(RunRow.axis_id == axis.id, ResultRow.method_id.in_(methods))
    return [row[1:] for row in session.execute(found) if row[0] in counting]


def _times(session: Session, rows: Any, axis: Axis, *names: str) -> list[dict[str, Any]]:
    """Named columns of a table of an axis."""
    found = select(rows).where(rows.axis_id == axis.id).order_by(*rows.__table__.primary_key)
    return [{name: getattr(row, name) for name in names} for row in session.scalars(found)]


def _trend_columns(session: Session, axis: Axis) -> dict[str, list[Any]]:
    """Columns of the runs that count."""
    states = trend(session, axis)
    results = used_results(session, axis)
    columns = (StateRow.run_id, StateRow.ramp, StateRow.ramp_limit, StateRow.odds, StateRow.odds_limit)
    evidence = {
        number: (_over(ramp, ramp_limit), _over(odds, odds_limit))
        for number, ramp, ramp_limit, odds, odds_limit in session.execute(
            select(*columns).where(StateRow.axis_id == axis.id)
        )
    }
    names = ("run", "time", "measured_at", "temperature_C")
    found: dict[str, list[Any]] = {name: [] for name in (*names, *_UNKNOWN, "quality", "ramp", "odds")}
    for run in timed_runs(session, axis):
        values = {name: getattr(run, name) for name in names}
        values |= states.get(run.id, _UNKNOWN)
        values["ramp"], values["odds"] = evidence.get(run.id, (None, None))
        result = results.get(run.id)
        values["quality"] = result and result.verdict
        for name, column in found.items():
            column.append(values[name])
    return found


def _over(value: float | None, limit: float | None) -> float | None:
    """A statistic over its limit of alarm; None without a limit, as while learning."""
    if value is None or limit is None or limit <= 0:
        return None
    return max(value / limit, 0.0)


def _baseline_states(session: Session, axis: Axis) -> dict[int, tuple[int, bool]]:
    """Epoch of each run that was assessed, and whether its epoch was learned from it."""
    rows = select(StateRow.run_id, StateRow.epoch, StateRow.state).where(StateRow.axis_id == axis.id)
    return {number: (epoch, state == "learning") for number, epoch, state in session.execute(rows)}


def _frequency_columns(
    runs: Sequence[Any], cells: Sequence[Any], states: dict[int, tuple[int, bool]]
) -> dict[str, Any]:
    """Frequencies by run and stop."""
    keys = sorted({tuple(cell[1:4]) for cell in cells})
    frequency = _table(runs, cells, keys)
    relative = _relative(frequency, _epochs(runs, states))
    stops = np.array([key[0] for key in keys])
    positions = np.unique(stops).tolist()
    by_stop = [stops == position for position in positions]
    return {
        "run": [run.run for run in runs],
        "time": [run.time for run in runs],
        "position_m": positions,
        "frequency_Hz": _means(frequency, by_stop),
        "relative": _means(relative, by_stop),
    }


def _table(runs: Sequence[Any], cells: Sequence[Any], keys: Sequence[Any]) -> Array:
    """Frequency by run and cell; NaN where there is none."""
    rows = {run.id: place for place, run in enumerate(runs)}
    columns = {key: place for place, key in enumerate(keys)}
    found = np.full((len(runs), len(keys)), np.nan)
    for number, position, condition, motion, value in cells:
        if number in rows and value is not None:
            found[rows[number], columns[position, condition, motion]] = value
    return found


def _epochs(runs: Sequence[Any], states: dict[int, tuple[int, bool]]) -> list[tuple[int, bool]]:
    """Epoch of each run and whether it is of the baseline; of a run not yet assessed that of the run before.

    Epoch -1 has no baseline; the first runs are one where the axis was not assessed.
    """
    if not states:
        return [(0, place < _BASELINE) for place in range(len(runs))]
    found, epoch = [], -1
    for run in runs:
        epoch, learned = states.get(run.id, (epoch, False))
        found.append((epoch, learned))
    return found


def _relative(frequency: Array, epochs: Sequence[tuple[int, bool]]) -> Array:
    """Frequencies over the baseline of their epoch."""
    found = np.full_like(frequency, np.nan)
    numbers, learned = np.array(epochs, dtype=int).reshape(-1, 2).T
    for epoch in np.unique(numbers):
        members = np.flatnonzero(numbers == epoch)
        baseline = members[learned[members] > 0]
        found[members] = frequency[members] / _median(frequency[baseline])
    return found


def _median(values: Array) -> Array:
    """Median of each column without its NaN; NaN where there is no number."""
    found = np.full(values.shape[1], np.nan)
    known = ~np.isnan(values).all(axis=0)
    found[known] = np.nanmedian(values[:, known], axis=0)
    return found


def _means(values: Array, groups: Sequence[Array]) -> Any:
    """Mean of each row over each group of columns without its NaN; None where there is no number."""
    found = np.full((len(values), len(groups)), np.nan)
    for place, group in enumerate(groups):
        part = values[:, group]
        count = (~np.isnan(part)).sum(axis=1)
        known = count > 0
        found[known, place] = np.nansum(part[known], axis=1) / count[known]
    return plain(found.tolist(), 7)


def _rigid_body(values: dict[str, Any], name: str) -> list[float | None] | None:
    value = values.get(name)
    if value is None:
        return None
    return [value, (values.get("standard_uncertainty") or {}).get(name)]


def _lost_motion(rows: Sequence[dict[str, Any]]) -> list[float] | None:
    lost = [row["lost_m"] for row in rows if row.get("lost_m") is not None]
    if not lost:
        return None
    return [float(np.median(lost)), min(lost), max(lost)]
