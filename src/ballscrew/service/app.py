"""The application: all routes, health, metrics, and a page for this computer."""

from __future__ import annotations

import base64
import hashlib
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, Depends, FastAPI, Request
from fastapi.responses import HTMLResponse, JSONResponse, PlainTextResponse
from jinja2 import Environment, PackageLoader
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from ballscrew._version import __version__
from ballscrew.base.errors import BallscrewError
from ballscrew.monitoring.epochs import moment
from ballscrew.report.canvas import STATE_COLOURS, STATE_SIGNS
from ballscrew.service import alarms, axes, reading, runs, tokens, uploads
from ballscrew.service.access import AdminCaller, Guard, RunningService
from ballscrew.service.alarms import alarm_documents
from ballscrew.service.jobs import job_documents
from ballscrew.service.reading import fleet_document
from ballscrew.service.serving import Service, answer_errors
from ballscrew.service.working import Worker
from ballscrew.store.tables import Axis, JobRow, ResultRow, Upload

router = APIRouter()
pages = APIRouter()

_templates = Environment(loader=PackageLoader("ballscrew.service"), autoescape=True, trim_blocks=True)
STYLE = _templates.get_template("status.css").render()
_URGENT = {"alarm": 0, "unloaded": 0, "watch": 1, "suspect": 2, "not assessed": 3, "unknown": 3}
_NEWEST = 10


_STYLE_HASH = base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode()
_PAGE_HEADERS = {
    "Content-Security-Policy": f"default-src 'none'; style-src 'sha256-{_STYLE_HASH}'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'",
    "Cache-Control": "no-store",
}


def create_app(service: Service, workers: Sequence[Worker] = ()) -> FastAPI:
    """Application of a service.

    Parameters
    ----------
    service : Service
        The service.
    workers : sequence of Worker
        Its workers.

    Returns
    -------
    FastAPI
        For uvicorn.
    """
    app = FastAPI(
        title="ballscrew",
        version=__version__,
        summary="Early detection of preload loss in ball screws",
        docs_url=None,
        redoc_url=None,
    )
    app.state.service = service
    app.state.workers = workers
    app.state.receiving = set()
    for resource in (uploads, runs, axes, reading, alarms, tokens):
        app.include_router(resource.router)
    app.include_router(router)
    if service.settings.on_loopback:
        app.include_router(pages)
    answer_errors(app)
    app.add_middleware(Guard, service=service)
    return app


def workers_of(request: Request) -> Sequence[Worker]:
    """Workers of the service of a request."""
    found: Sequence[Worker] = request.app.state.workers
    return found


Workers = Annotated[Sequence[Worker], Depends(workers_of)]


@router.get("/livez")
def is_alive() -> PlainTextResponse:
    """The process answers."""
    return PlainTextResponse("alive\n")


@router.get("/readyz")
def is_ready(service: RunningService, workers: Workers) -> JSONResponse:
    """Whether runs are received and analysed; 503 with the reason if not."""
    reason = unready(service, workers)
    document = {"ready": reason is None, "reason": reason, "simulated": service.store.folder.is_simulated()}
    return JSONResponse(document, 200 if reason is None else 503)


def unready(service: Service, workers: Sequence[Worker]) -> str | None:
    """Why runs are not received or analysed; None if they are."""
    if service.stopping.is_set():
        return "the server stops."
    try:
        service.store.check_writable()
        with service.store.read() as session:
            session.scalar(select(Axis.id).limit(1))
    except BallscrewError as error:
        return str(error)
    if service.free_bytes() < service.settings.min_free_bytes:
        return "the disk is full."
    if not _ready(workers):
        return "no worker is ready yet."
    return None


@router.get("/metrics")
def show_metrics(
    caller: AdminCaller,  # noqa: ARG001
    service: RunningService,
    workers: Workers,
) -> PlainTextResponse:
    """Metrics in the text format of Prometheus."""
    with service.store.read() as session:
        lines = _metrics(session, service, _ready(workers))
    return PlainTextResponse("".join(lines), media_type="text/plain; version=0.0.4; charset=utf-8")


def _ready(workers: Sequence[Worker]) -> int:
    return sum(worker.is_ready for worker in workers)


def _metrics(session: Session, service: Service, ready: int) -> list[str]:
    waiting = (JobRow.set_aside.is_(False),)
    length = session.scalar(select(func.count()).where(*waiting)) or 0
    aside = session.scalar(select(func.count()).where(JobRow.set_aside)) or 0
    oldest = session.scalar(select(func.min(JobRow.created_at)).where(*waiting))
    log = service.store.folder.sqlite.with_name("store.sqlite-wal")
    lines = [
        _metric("queue_jobs", "gauge", "Jobs that wait or run.", {"": length}),
        _metric("queue_age_seconds", "gauge", "Age of the oldest of them.", {"": _age(oldest)}),
        _metric("jobs_set_aside", "gauge", "Jobs that were set aside.", {"": aside}),
        _metric("workers_ready", "gauge", "Workers that are ready.", {"": ready}),
        _metric("free_disk_bytes", "gauge", "Free space for raw files.", {"": service.free_bytes()}),
        _metric("wal_bytes", "gauge", "Size of the write-ahead log.", {"": _size(log)}),
    ]
    verdicts = select(ResultRow.verdict, func.count()).group_by(ResultRow.verdict)
    lines.append(_metric("runs", "gauge", "Results by verdict.", _counts(session, verdicts, "verdict")))
    uploads = select(Upload.status, func.count()).group_by(Upload.status)
    lines.append(_metric("sent_runs", "gauge", "Runs that were sent.", _counts(session, uploads, "status")))
    refusals = {f'{{status="{status}"}}': count for status, count in sorted(service.refusals.items())}
    lines.append(_metric("refusals_total", "counter", "Requests that were refused.", refusals))
    return lines


def _metric(name: str, kind: str, text: str, values: Mapping[str, float]) -> str:
    full = f"ballscrew_{name}"
    lines = [f"# HELP {full} {text}\n# TYPE {full} {kind}\n"]
    lines += [f"{full}{labels} {value}\n" for labels, value in values.items()]
    return "".join(lines)


def _counts(session: Session, query: Any, label: str) -> dict[str, float]:
    return {f'{{{label}="{name}"}}': count for name, count in session.execute(query)}


def _age(text: str | None) -> float:
    if text is None:
        return 0.0
    return max(0.0, round(time.time() - moment(text, "created_at").timestamp(), 3))


def _size(path: Any) -> int:
    return path.stat().st_size if path.exists() else 0


@pages.get("/", response_class=HTMLResponse, include_in_schema=False)
def show_page(
    caller: AdminCaller,  # noqa: ARG001
    service: RunningService,
    workers: Workers,
) -> HTMLResponse:
    """Status page: axes with their states, alarms, queue, and the health of store and workers."""
    fleet = fleet_document(service)["axes"]
    fleet.sort(key=lambda axis: (_URGENT.get(axis["state"], 4), axis["axis"]))
    with service.store.read() as session:
        sent = session.execute(
            select(Upload, Axis.name)
            .join(Axis, Axis.id == Upload.axis_id)
            .order_by(Upload.id.desc())
            .limit(_NEWEST)
        ).all()
        newest = [(axis, row.key, row.received_at, row.status, row.verdict, row.error) for row, axis in sent]
        standing = [
            each for each in alarm_documents(session) if each["state"] not in ("ended", "retracted", "closed")
        ]
        jobs = job_documents(session)
    page = _templates.get_template("status.html").render(
        style=STYLE,
        version=__version__,
        at=datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S UTC"),
        axes=fleet,
        alarms=standing,
        sent=newest,
        jobs=jobs,
        reason=unready(service, workers),
        store=str(service.store.path),
        free=f"{service.free_bytes() / 1e9:.0f} GB",
        workers=f"{_ready(workers)} of {service.settings.workers}",
        signs=STATE_SIGNS,
        colours=list(STATE_COLOURS),
    )
    return HTMLResponse(page, headers=_PAGE_HEADERS)
