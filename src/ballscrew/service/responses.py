"""Answers about the FRF of a cell of a run, computed from its raw files."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query
from fastapi.responses import JSONResponse
from sqlalchemy.orm import Session

from ballscrew.base.jsonfile import SCHEMA, plain
from ballscrew.base.provenance import digest
from ballscrew.base.quantity import NORMAL_95
from ballscrew.service.access import RunningService, ViewerCaller
from ballscrew.service.comparing import run_of
from ballscrew.service.on_demand import Responses, not_yet
from ballscrew.service.serving import RefusedError
from ballscrew.service.stored_runs import (
    RAW_GONE,
    RawRecording,
    StoredRun,
    locate_run,
    recordings_of,
    stated_of,
)

router = APIRouter(prefix="/api/v1/runs/{run}")

_MOST_LINES = 4000


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


@router.get("/response", response_model=None)
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
    folder = results.find(digest(task.stated)[:32], task)
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
