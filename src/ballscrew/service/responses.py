"""Answers about the FRF of a cell, of one run or of all runs of an axis, computed from the raw files."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query
from fastapi.responses import JSONResponse, Response
from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA, plain
from ballscrew.base.provenance import digest
from ballscrew.base.quantity import NORMAL_95
from ballscrew.service.access import RunningService, ViewerCaller
from ballscrew.service.comparing import run_of
from ballscrew.service.curves import answer_columns, axis_of, timed_runs, used_columns
from ballscrew.service.on_demand import OnDemand, Responses, not_yet
from ballscrew.service.serving import RefusedError
from ballscrew.service.stored_runs import (
    RAW_GONE,
    RawRecording,
    StoredRun,
    locate_run,
    recordings_of,
    stated_of,
)
from ballscrew.store.tables import Axis, CellRow, RawFile, RecordingRow, RunRow

router = APIRouter(prefix="/api/v1")

_MOST_LINES = 4000
_MOST_RUNS = 200  # of a map, the newest
_MAP_LINES = 200
_KEY = ("position_m", "condition", "motion")
_COLUMNS = ("run", "time", "magnitude_dB", "natural_frequency_Hz", "standard_uncertainty_Hz")
_SPAN = (0.5, 1.6)  # ends of a map, relative to the median of the natural frequency


@dataclass(frozen=True, slots=True)
class ResponseTask:
    """FRF of all cells of a run, as plain data for a process.

    Parameters
    ----------
    store_folder : str
        Folder of raw files.
    files : tuple of (name, sha256, compression)
        Its recordings in the order of RUN.toml.
    documents : dict of str to str
        Text of each document by its kind.
    stated : dict
        Content of RUN.toml.
    """

    store_folder: str
    files: tuple[tuple[str, str, str], ...]
    documents: dict[str, str]
    stated: dict[str, Any]

    @property
    def key(self) -> str:
        """Name of the result."""
        return digest(self.stated)[:32]

    def write(self, folder: Path) -> None:
        """Write the FRF of each cell as JSON, under the name of :func:`_cell_file`, and ``about.json``."""
        from ballscrew.report.measured import response_of
        from ballscrew.store.analysing import analyse_files

        # Its spectra are those of the joint method.
        run, _ = analyse_files(
            Path(self.store_folder), self.files, self.documents, self.stated, method="paper"
        )
        for cell in run.cells:
            response = response_of(run, *cell.key)
            if response is None:
                continue
            step = math.ceil(len(response.frequency) / _MOST_LINES)
            lines = slice(None, None, step)
            document = {
                "frequency_Hz": response.frequency[lines],
                "magnitude": response.magnitude[lines],
                "phase_deg": np.degrees(np.angle(response.each[:, lines])),
                "coherence": response.coherence[:, lines],
                "responses": response.names, "input_unit": response.unit,
                "estimator": response.estimator, "repetitions": cell.repetitions,
            }  # fmt: skip
            (folder / _cell_file(*cell.key)).write_text(json.dumps(plain(document, 6)))
        (folder / "about.json").write_text(json.dumps({"cells": len(run.cells)}))


def _cell_file(position: float, condition: str, motion: int) -> str:
    return f"{position * 1e6:.0f}-{condition}-{motion}.json"


@router.get("/runs/{run}/response", response_model=None)
def show_response(
    run: str,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    results: Responses,
    cell: Annotated[int, Query(ge=0, le=100_000)] = 0,
) -> dict[str, Any] | JSONResponse:
    """FRF of a cell of a run by its number, with coherence, and the transients that it is averaged over.

    Computed from the raw files; 202 while it is being computed. ``relative_half_width`` is half of the 95 %
    interval of the magnitude, relative to it, by coherence and number of repetitions.
    """
    with service.store.read() as session:
        found = locate_run(session, run)
        if found.row is None:
            raise RefusedError(404, "the run has no result.")
        result = run_of(session, found)
        if cell >= len(result.cells):
            raise RefusedError(404, f"the run has {len(result.cells)} cells, and none of the number {cell}.")
        task = _response_task(session, found, str(service.store.folder.files.resolve()))
    folder = results.find(task.key, task)
    chosen = result.cells[cell]
    document = _read_cell(folder, _cell_file(*chosen.key))
    if document is None:
        return not_yet("the FRF is being computed from the raw files.")
    if not document:
        reasons = (*chosen.reasons, *result.quality.reasons, "nothing was measured")
        raise RefusedError(404, f"the cell has no FRF: {reasons[0]}")
    coherence = np.clip(np.array(document["coherence"], dtype=np.float64).mean(axis=0), 1e-6, 1.0)
    spread = np.sqrt((1 - coherence) / (2 * max(chosen.repetitions, 1) * coherence))
    own = {
        "schema": SCHEMA, "run": found.id, "cell": cell, "position_m": chosen.position_m,
        "condition": chosen.condition, "motion": chosen.motion, "natural_frequency_Hz": chosen.frequency_Hz,
        "standard_uncertainty_Hz": chosen.standard_uncertainty_Hz, "band_Hz": chosen.band_Hz,
        "verdict": chosen.verdict, "reasons": chosen.reasons, "relative_half_width": NORMAL_95 * spread,
    }  # fmt: skip
    answer: dict[str, Any] = document | plain(own, 6)
    return answer


def _read_cell(folder: Path | None, name: str) -> dict[str, Any] | None:
    """FRF of a cell, empty where it has none; None where there is no result, or it was just removed."""
    if folder is None:
        return None
    try:
        document: dict[str, Any] = json.loads((folder / name).read_text())
    except FileNotFoundError:
        return {} if folder.is_dir() else None
    return document


def _response_task(session: Session, found: StoredRun, folder: str) -> ResponseTask:
    stated = stated_of(session, found)
    if stated is None:
        raise RefusedError(404, f"{RAW_GONE}: no FRF can be computed.")
    files = _in_order(recordings_of(session, found), stated[0]["files"])
    return ResponseTask(folder, files, stated[1], stated[0])


def _in_order(recordings: Sequence[RawRecording], hashes: Sequence[str]) -> tuple[tuple[str, str, str], ...]:
    """Files in the order of RUN.toml."""
    by_hash = {recording.sha256: recording for recording in recordings}
    files = []
    for sha256 in hashes:
        recording = by_hash.get(sha256)
        if recording is None or recording.compression is None:
            raise RefusedError(404, f"{RAW_GONE}: no FRF can be computed.")
        files.append((recording.name, sha256, recording.compression))
    return tuple(files)


@dataclass(frozen=True, slots=True)
class CellCourse:
    """Natural frequency of a cell in the runs of an axis, and how the FRF of each is computed.

    Parameters
    ----------
    cells : list of (position, condition, motion)
        All cells of the axis.
    runs : list
        Rows of its runs that count and have a time.
    frequency : dict of int to (float or None, float or None)
        Of the cell, with its standard uncertainty, by the number of the run's row.
    tasks : dict of int to ResponseTask
        Of the newest runs whose raw files are stored, by the number of the run's row.
    stored : int
        How many runs have raw files that can be analysed.
    """

    cells: list[tuple[float, str, int]]
    runs: list[Any]
    frequency: dict[int, tuple[float | None, float | None]]
    tasks: dict[int, ResponseTask]
    stored: int


@router.get("/axes/{axis:path}/responses", response_model=None)
def show_responses(
    axis: str,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    results: Responses,
    cell: Annotated[int, Query(ge=0, le=100_000)] = 0,
) -> Response:
    """Magnitude of the FRF of a cell by run and frequency, in dB, for a map, with its natural frequency.

    ``cells`` lists the cells of the axis, by whose number one is chosen. Only runs whose raw files are stored
    have a magnitude, of these the newest 200. Each request computes one of those that are ``waiting``: ask
    again until there is none, or for each of them alone. ``refused`` have no FRF.
    """
    with service.store.read() as session:
        course = _course(session, axis_of(session, axis), cell, str(service.store.folder.files.resolve()))
    found, waiting = _read_cells(results, course.tasks, _cell_file(*course.cells[cell]))
    documents = {number: document for number, document in found.items() if document}
    lines = _lines(list(documents.values()), course.frequency.values())
    columns: dict[str, list[Any]] = {name: [] for name in _COLUMNS}
    for run in course.runs:
        magnitude = _decibels(documents.get(run.id), lines)
        values = (run.run, run.time, magnitude, *course.frequency.get(run.id, (None, None)))
        for column, value in zip(columns.values(), values, strict=True):
            column.append(value)
    names = {run.id: run.run for run in course.runs}
    counts = {
        "stored": course.stored,
        "waiting": [names[number] for number in waiting],
        "refused": len(found) - len(documents),
    }
    cells = [dict(zip(_KEY, each, strict=True)) for each in course.cells]
    return answer_columns(
        axis, {"cells": cells, "cell": cell, "frequency_Hz": plain(lines, 6), **columns, **counts}
    )


@router.get("/runs/{run}/magnitude", response_model=None)
def show_magnitude(
    run: str,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    results: Responses,
    low: Annotated[float, Query(gt=0, lt=1e6)],
    high: Annotated[float, Query(gt=0, lt=1e6)],
    position_m: Annotated[float, Query(gt=-1e3, lt=1e3)],
    condition: Annotated[str, Query(pattern=r"^[\w -]{1,40}$")],
    motion: Annotated[int, Query(ge=0, le=100_000)],
) -> dict[str, Any] | JSONResponse:
    """Magnitude of the FRF of a cell of a run, in dB, at 200 frequencies from ``low`` to ``high``, for a map.

    202 while it is being computed.
    """
    with service.store.read() as session:
        found = locate_run(session, run)
        task = _response_task(session, found, str(service.store.folder.files.resolve()))
    document = _read_cell(results.find(task.key, task), _cell_file(position_m, condition, motion))
    if document is None:
        return not_yet("the FRF is being computed from the raw files.")
    magnitude = _decibels(document, np.linspace(low, high, _MAP_LINES))
    return {"schema": SCHEMA, "run": found.id, "magnitude_dB": magnitude}


def _course(session: Session, axis: Axis, cell: int, folder: str) -> CellCourse:
    """Runs of an axis with the frequency of a cell, by its number among all cells of the axis."""
    columns = (CellRow.position_m, CellRow.condition, CellRow.motion)
    values = (CellRow.frequency_Hz, CellRow.standard_uncertainty_Hz)
    rows = used_columns(session, axis, *columns, *values, of_cells=True)
    cells = sorted({tuple(row[1:4]) for row in rows})
    if cell >= len(cells):
        raise RefusedError(404, f"the axis has {len(cells)} cells, and none of the number {cell}.")
    frequency = {row[0]: tuple(row[4:]) for row in rows if tuple(row[1:4]) == cells[cell]}
    runs = timed_runs(session, axis)
    whole = _runs_with_files(session, axis)
    stored = [run for run in runs if run.id in whole]
    newest = stored[-_MOST_RUNS:]
    tasks = {}
    for run in newest:
        with suppress(RefusedError):  # its RUN.toml is not known
            row = session.get_one(RunRow, run.id)
            tasks[run.id] = _response_task(session, StoredRun(axis, row, ()), folder)
    return CellCourse(cells, runs, frequency, tasks, len(stored) - len(newest) + len(tasks))


def _runs_with_files(session: Session, axis: Axis) -> set[int]:
    """Numbers of the runs of an axis all of whose recordings the store can read."""
    rows = select(RecordingRow.run_id, RawFile.sha256)
    rows = rows.join(RunRow, RunRow.id == RecordingRow.run_id).where(RunRow.axis_id == axis.id)
    is_stored = (RawFile.sha256 == RecordingRow.sha256) & RawFile.archived_to.is_(None)
    found: dict[int, bool] = {}
    for number, sha256 in session.execute(rows.outerjoin(RawFile, is_stored)):
        found[number] = found.get(number, True) and sha256 is not None
    return {number for number, is_whole in found.items() if is_whole}


def _read_cells(
    results: OnDemand, tasks: dict[int, ResponseTask], name: str
) -> tuple[dict[int, dict[str, Any]], list[int]]:
    """FRF of a cell of the runs for which it is there, empty where it has none; which are not there yet.

    One of those is computed, the newest first.
    """
    found: dict[int, dict[str, Any]] = {}
    waiting: list[int] = []
    for number, task in reversed(tasks.items()):
        try:
            folder = results.look(task.key) if waiting else results.find(task.key, task)
            document = _read_cell(folder, name)
        except RefusedError:  # for a while
            document = None
        except InputError:
            document = {}
        if document is None:
            waiting.append(number)
        else:
            found[number] = document
    return found, waiting


def _lines(
    documents: Sequence[dict[str, Any]], frequencies: Iterable[tuple[float | None, float | None]]
) -> Array:
    """Frequencies of a map: about the natural frequency, as far as the FRFs reach."""
    if not documents:
        return np.zeros(0)
    low = max(document["frequency_Hz"][0] for document in documents)
    high = min(document["frequency_Hz"][-1] for document in documents)
    known = [value for value, _ in frequencies if value is not None]
    if known:
        middle = float(np.median(known))
        low, high = max(low, _SPAN[0] * middle), min(high, _SPAN[1] * middle)
    return np.linspace(low, high, _MAP_LINES)


def _decibels(document: dict[str, Any] | None, lines: Array) -> Any:
    """Magnitude of an FRF at some frequencies, dB; None without one."""
    if not document:
        return None
    magnitude = np.array(document["magnitude"], dtype=np.float64)
    values = np.interp(lines, document["frequency_Hz"], magnitude, left=np.nan, right=np.nan)
    with np.errstate(divide="ignore"):
        return plain(20 * np.log10(values), 4)
