"""Pages of what was found after alarms, and of the audit."""

from __future__ import annotations

from typing import Any
from urllib.parse import urlencode

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse
from sqlalchemy import select

from ballscrew.service.access import AdminCaller, RunningService, ViewerCaller
from ballscrew.service.pages.rendering import render
from ballscrew.service.records import FilterText, RowNumber, show_findings
from ballscrew.store.audit import AuditFilter, audit_rows
from ballscrew.store.tables import Audit, Axis

router = APIRouter(include_in_schema=False)

_SHOWN = 100  # rows of the audit on a page
_LISTED = 200  # alarms on a page


@router.get("/findings")
def show_findings_page(request: Request, caller: ViewerCaller, service: RunningService) -> HTMLResponse:
    """What was found after alarms: precision and lead time, and each alarm."""
    document = show_findings(caller, service)
    groups: list[tuple[str, list[dict[str, Any]]]] = []
    for field, name in (("rule", "rules"), ("machine", "machines"), ("axis", "axes")):
        groups.append((field, document[name]))
    return render(
        request,
        "findings.html",
        whole=document["all"],
        groups=groups,
        alarms=document["alarms"][:_LISTED],
        number=len(document["alarms"]),
    )


@router.get("/audit")
def show_audit_page(
    request: Request,
    caller: AdminCaller,  # noqa: ARG001
    service: RunningService,
    axis: FilterText = "",
    by: FilterText = "",
    action: FilterText = "",
    before: RowNumber = None,
) -> HTMLResponse:
    """What was done to the store, the newest first; selected by axis, person and action."""
    with service.store.read() as session:
        rows = list(audit_rows(session, AuditFilter(axis, by, action, before), _SHOWN))
        axes = session.scalars(select(Axis.name).order_by(Axis.name)).all()
        actions = session.scalars(select(Audit.action).distinct().order_by(Audit.action)).all()
    chosen = {"axis": axis, "by": by, "action": action}
    query = urlencode({name: value for name, value in chosen.items() if value})
    return render(
        request,
        "audit.html",
        rows=rows,
        axes=axes,
        actions=actions,
        chosen=chosen,
        selection=query,
        next=rows[-1]["id"] if len(rows) == _SHOWN else None,
    )
