"""Findings after alarms, and the audit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query
from fastapi.responses import JSONResponse, Response, StreamingResponse

from ballscrew.base.jsonfile import SCHEMA
from ballscrew.service.access import AdminCaller, RunningService, ViewerCaller
from ballscrew.service.serving import Service
from ballscrew.store.audit import AuditFilter, audit_csv, audit_lines, audit_rows
from ballscrew.store.findings import findings_document

router = APIRouter(prefix="/api/v1")

MOST_ROWS = 1000
"""Of one answer as JSON; ``before`` gives those that follow."""

_LONGEST = 1000  # characters of a filter
_PART = 500  # rows that are read at once

FilterText = Annotated[str, Query(max_length=_LONGEST)]
RowNumber = Annotated[int | None, Query(ge=1, le=1 << 31)]


@router.get("/findings")
def show_findings(caller: ViewerCaller, service: RunningService) -> dict[str, Any]:  # noqa: ARG001
    """Precision and lead time of the alarms of each rule, machine and axis, with the counts behind them."""
    with service.store.read() as session:
        return findings_document(session)


@router.get("/audit")
def show_audit(
    caller: AdminCaller,  # noqa: ARG001
    service: RunningService,
    axis: FilterText = "",
    by: FilterText = "",
    action: FilterText = "",
    before: RowNumber = None,
    format: Literal["json", "csv", "jsonl"] = "json",  # noqa: A002
) -> Response:
    """What was done to the store, the newest first, by axis, person and action; CSV and JSON lines whole."""
    chosen = AuditFilter(axis, by, action, before)
    if format == "json":
        with service.store.read() as session:
            rows = list(audit_rows(session, chosen, MOST_ROWS))
        more = rows[-1]["id"] if len(rows) == MOST_ROWS else None
        return JSONResponse({"schema": SCHEMA, "audit": rows, "before": more})
    texts, kind = audit_csv, "text/csv"
    if format == "jsonl":
        texts, kind = audit_lines, "application/jsonl"
    headers = {"Content-Disposition": f'attachment; filename="audit.{format}"'}
    return StreamingResponse(texts(_rows(service, chosen)), media_type=kind, headers=headers)


def _rows(service: Service, chosen: AuditFilter) -> Iterator[dict[str, Any]]:
    """All rows in parts, so that no reader stays open while a client is slow."""
    rows: list[dict[str, Any]] = [{}] * _PART
    while len(rows) == _PART:
        with service.store.read() as session:
            rows = list(audit_rows(session, chosen, _PART))
        yield from rows
        if rows:
            chosen = replace(chosen, before=rows[-1]["id"])
