"""Page of a run: its verdict, its cells, their FRFs, its raw signals, and how each number was made."""

from __future__ import annotations

import os
import shlex
import subprocess
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse
from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.service.access import RunningService, ViewerCaller
from ballscrew.service.comparing import cells_document
from ballscrew.service.pages.rendering import render
from ballscrew.service.serving import RefusedError
from ballscrew.service.stored_runs import (
    StoredRun,
    has_raw_files,
    locate_run,
    neighbours,
    recordings_of,
    result_document,
    source_of,
    stated_of,
)
from ballscrew.store.copying import file_name
from ballscrew.store.reading import current_rows, run_versions, trend
from ballscrew.store.service_tables import Upload
from ballscrew.store.showing import run_document
from ballscrew.store.tables import Correction, Exclusion, RunRow

router = APIRouter(include_in_schema=False)

_BEFORE, _AFTER = 0.15, 0.25  # s around a transient, as it is cut out

Cell = Annotated[int | None, Query(ge=0)]


@router.get("/runs/{run}")
def show_run_page(
    request: Request,
    run: str,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    against: str = "baseline",
    cell: Cell = None,
    part: str = "",
) -> HTMLResponse:
    """A run with its cells; ``?part=frf`` gives the FRF of a cell alone."""
    with service.store.read() as session:
        try:
            found = locate_run(session, run)
            if found.row is None:
                return render(request, "run_sent.html", **_sent_context(session, found))
            cells = cells_document(session, found, against)
        except RefusedError as error:
            return refuse(request, error)
        context = _context(session, found, cells) | {"chosen": _chosen(cells, cell)}
        context["repetitions"] = _repetitions(context["result"], cells["cells"], context["chosen"])
        commands = _commands(session, found, str(service.store.path), context)
    template = "run_frf.html" if part == "frf" else "run.html"
    return render(request, template, against=against, commands=commands, **context)


@router.get("/runs/{run}/signals")
def show_signals_page(
    request: Request,
    run: str,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    file: Annotated[int, Query(ge=0)] = 0,
    cell: Cell = None,
) -> HTMLResponse:
    """Raw signals of a run with its transients; with ``cell``, those of the first one of this cell."""
    with service.store.read() as session:
        try:
            found = locate_run(session, run)
        except RefusedError as error:
            return refuse(request, error)
        recordings = recordings_of(session, found)
        marks: list[dict[str, Any]] = []
        if found.row is not None:
            result = result_document(session, found.axis, found.row)
            marks = [_mark(each, result["cells"]) for each in result["transients"]]
        is_known = stated_of(session, found) is not None
    span, shown = None, None
    if cell is not None:
        of_cell = [mark for mark in marks if mark["cell"] == cell]
        of_cell.sort(key=lambda mark: (mark["repetition"] == 0, mark["file"], mark["start_s"]))
        if of_cell:
            shown = of_cell[0]
            file, span = shown["file"], (shown["start_s"] - _BEFORE, shown["stop_s"] + _AFTER)
    return render(
        request, "run_signals.html", found=found, recordings=recordings, file=file, cell=cell, span=span,
        marks=[mark for mark in marks if mark["file"] == file], is_known=is_known,
        shown=shown,
    )  # fmt: skip


def refuse(request: Request, error: RefusedError) -> HTMLResponse:
    """Page that says that there is no such run, or which ones there are."""
    runs = error.document.get("runs", ())
    return render(request, "run_missing.html", error.status, sentence=str(error), runs=runs)


def _context(session: Session, found: StoredRun, cells: dict[str, Any]) -> dict[str, Any]:
    assert found.row is not None  # noqa: S101
    row, axis = found.row, found.axis
    versions = run_versions(session, row)
    names = select(RunRow.run).where(RunRow.id.in_(versions))
    exclusions = select(Exclusion).where(Exclusion.run_id.in_(versions)).order_by(Exclusion.id)
    corrections = select(Correction).where(Correction.subject.in_(names)).order_by(Correction.id)
    provenance = run_document(session, row, axis)
    return {
        "found": found,
        "result": result_document(session, axis, row),
        "cells": cells,
        "near": neighbours(session, found),
        "provenance": provenance,
        "history": trend(session, axis).get(row.id),
        "counts": any(each.id == row.id for each in current_rows(session, axis)),
        "exclusions": session.scalars(exclusions).all(),
        "corrections": session.scalars(corrections).all(),
        "has_raw": has_raw_files(session, found),
        "has_all_raw": has_raw_files(session, found, whole=True),
    }


def _sent_context(session: Session, found: StoredRun) -> dict[str, Any]:
    sent: list[Upload] = list(found.sent)
    recordings = recordings_of(session, found)
    return {
        "found": found,
        "sent": sent,
        "recordings": recordings,
        "is_known": stated_of(session, found) is not None,
    }


def _chosen(cells: dict[str, Any], cell: int | None) -> int | None:
    """Number of the cell whose FRF is shown: the one asked for, or the one that moved most, or the first."""
    count = len(cells["cells"])
    if cell is not None and cell < count:
        return cell
    if cells["moved_most"] is not None:
        return int(cells["moved_most"])
    return 0 if count else None


def _mark(transient: dict[str, Any], cells: list[dict[str, Any]]) -> dict[str, Any]:
    """Transient with the number of its cell."""
    number = None
    for place, cell in enumerate(cells):
        if all(cell[name] == transient[name] for name in ("position_m", "condition", "motion")):
            number = place
    return transient | {"cell": number}


def _repetitions(
    result: dict[str, Any], cells: list[dict[str, Any]], chosen: int | None
) -> list[dict[str, Any]]:
    """Transients of a cell, each with the part of the signals around it."""
    found = []
    for transient in result["transients"]:
        mark = _mark(transient, cells)
        if chosen is not None and mark["cell"] == chosen:
            found.append(mark | {"begin": mark["start_s"] - _BEFORE, "end": mark["stop_s"] + _AFTER})
    return found


def _commands(session: Session, found: StoredRun, store: str, context: dict[str, Any]) -> list[str]:
    """Commands that compute the result of a run again, or that show what it is made of."""
    method = str(context["result"]["made"]["settings"].get("method", "joint"))
    source = None
    if context["has_all_raw"] and found.row is not None:
        source = source_of(session, found.row)
    if source is None:
        return [_command("store", "show", found.id, "--store", store, "--json")]
    folder = f"exported/recordings/{file_name(session.get_one(RunRow, source.run_id))}"
    return [
        _command("store", "export", found.axis.name, "--to", "exported", "--raw", "--store", store),
        _command("analyze", f"{folder}/run.toml", "--method", method, "--json"),
    ]


def _command(*words: str) -> str:
    """Command line, quoted for the shell of this computer."""
    if os.name == "nt":
        return subprocess.list2cmdline(["ballscrew", *words])
    return shlex.join(["ballscrew", *words])
