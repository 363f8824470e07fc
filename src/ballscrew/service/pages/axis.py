"""Page of an axis: what to do and why, its curves, and tables of its runs, alarms, events and epochs."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

from fastapi import APIRouter, Request
from fastapi.responses import Response
from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import shown
from ballscrew.base.provenance import digest
from ballscrew.service.access import RunningService, ViewerCaller
from ballscrew.service.pages.rendering import render
from ballscrew.service.reading import axis_document
from ballscrew.service.serving import Service, UnknownAxisError
from ballscrew.store.alarms import alarm_documents
from ballscrew.store.reading import find_axis
from ballscrew.store.reporting import report
from ballscrew.store.tables import Assessment, Axis, EpochRow, MachineRow, Method

router = APIRouter(include_in_schema=False)

_ROWS = 100  # runs in the table, unless all are asked for
_TYPES = {"html": "text/html; charset=utf-8", "pdf": "application/pdf"}


@router.get("/axes/{axis:path}/report.{kind}")
def send_report(
    axis: str,
    kind: Literal["html", "pdf"],
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
) -> Response:
    """Report of an axis as a file; 503 while another request computes: no thread waits for its turn."""
    with service.store.read() as session:
        if session.scalar(select(Axis.id).where(Axis.name == axis)) is None:
            raise UnknownAxisError(axis, f"there is no axis {shown(axis)}.")
    with service.computing("a report"), tempfile.TemporaryDirectory(prefix="ballscrew-") as folder:
        path = Path(folder) / f"report.{kind}"
        report(service.store, axis, out=path, calendar=service.settings.calendar)
        content = path.read_bytes()
    name = quote(f"{axis}.{kind}", safe="")
    headers = {"Content-Disposition": f"attachment; filename*=UTF-8''{name}", "Cache-Control": "no-store"}
    return Response(content, media_type=_TYPES[kind], headers=headers)


@router.get("/axes/{axis:path}")
def show_axis_page(
    axis: str,
    request: Request,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
) -> Response:
    """An axis with its curves and tables; ``?part=live`` gives what changes, or 204 if nothing has."""
    context = _context(service, axis)
    stamp = digest(context)
    template = "axis.html"
    if request.query_params.get("part") == "live":
        if request.query_params.get("known") == stamp:
            return Response(status_code=204, headers={"Cache-Control": "no-store"})
        template = "axis_live.html"
    runs = context["runs"]
    if request.query_params.get("runs") != "all":
        runs = runs[:_ROWS]
    return render(request, template, stamp=stamp, shown=runs, **context)


def _context(service: Service, name: str) -> dict[str, Any]:
    """What the page shows."""
    document = axis_document(service, name)
    document["runs"].reverse()
    explanation = document.pop("explanation") or {}
    excluded = _standing(document.pop("exclusions"))
    timed = [run for run in document["runs"] if run["counts"] and run["measured_at"] is not None]
    with service.store.read() as session:
        axis = find_axis(session, name)
        alarms = alarm_documents(session, axis)
        found = _place(session, axis) | _made(session, axis)
    return {
        "axis": document,
        "runs": document.pop("runs"),
        "timed": len(timed),
        "nut": next((run["nut"] for run in timed if run["stiffness"] is not None), None),
        "explanation": explanation,
        "judged": explanation.get("state") or {},
        "excluded": excluded,
        "alarms": alarms,
        **found,
    }


def _standing(exclusions: Sequence[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Exclusions that have not ended, by their run or event."""
    found = {}
    for each in exclusions:
        if each["ended_at"] is None:
            found[each["run"] or each["event"]] = each
    return found


def _place(session: Session, axis: Axis) -> dict[str, Any]:
    """Machine and site of an axis."""
    machine = None
    if axis.machine_id is not None:
        machine = session.get(MachineRow, axis.machine_id)
    return {"machine": getattr(machine, "name", None), "site": getattr(machine, "site", None)}


def _made(session: Session, axis: Axis) -> dict[str, Any]:
    """Epochs of an axis, and how the numbers of its newest assessment were made."""
    made = None
    if axis.assessment_id is not None:
        assessment = session.get_one(Assessment, axis.assessment_id)
        method = session.get_one(Method, assessment.method_id)
        made = {
            "at": assessment.made_at,
            "version": assessment.version,
            "model": assessment.model_digest,
            "method": method.name,
            "revision": method.revision,
            "settings": method.settings | assessment.settings,
            "runs": assessment.runs,
        }
    names = ("number", "begins", "ends", "cause", "alarm_at")
    rows = session.scalars(select(EpochRow).where(EpochRow.axis_id == axis.id).order_by(EpochRow.number))
    epochs = [{name: getattr(row, name) for name in names} for row in rows]
    return {"made": made, "epochs": epochs}
