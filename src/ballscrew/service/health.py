"""Health of the service: whether it receives and analyses runs, and metrics."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request
from fastapi.responses import JSONResponse, PlainTextResponse
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from ballscrew.base.errors import BallscrewError
from ballscrew.monitoring.epochs import moment
from ballscrew.service.access import RunningService, ViewerCaller
from ballscrew.service.serving import Service
from ballscrew.service.working import Worker
from ballscrew.store.service_tables import Delivery, JobRow, Upload
from ballscrew.store.tables import Axis, ResultRow

router = APIRouter()

_log = logging.getLogger("ballscrew.service")

_SENT, _FAILED = "sent", "failed"  # of calls of heartbeat_url
_FIRST_BEAT = 60.0  # s after the start, so that workers are ready
_PATIENCE = 10.0  # s for a call


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
    if not ready_workers(workers):
        return "no worker is ready yet."
    return None


@router.get("/metrics")
def show_metrics(
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    workers: Workers,
) -> PlainTextResponse:
    """Metrics in the text format of Prometheus."""
    with service.store.read() as session:
        lines = _metrics(session, service, ready_workers(workers))
    return PlainTextResponse("".join(lines), media_type="text/plain; version=0.0.4; charset=utf-8")


def ready_workers(workers: Sequence[Worker]) -> int:
    """Number of workers that are ready."""
    return sum(worker.is_ready for worker in workers)


def _metrics(session: Session, service: Service, ready: int) -> list[str]:
    waiting = (JobRow.set_aside.is_(False),)
    length = session.scalar(select(func.count()).where(*waiting)) or 0
    aside = session.scalar(select(func.count()).where(JobRow.set_aside)) or 0
    oldest = session.scalar(select(func.min(JobRow.created_at)).where(*waiting))
    lines = [
        _metric("queue_jobs", "gauge", "Jobs that wait or run.", {"": length}),
        _metric("queue_age_seconds", "gauge", "Age of the oldest of them.", {"": age_s(oldest)}),
        _metric("jobs_set_aside", "gauge", "Jobs that were set aside.", {"": aside}),
        _metric("workers_ready", "gauge", "Workers that are ready.", {"": ready}),
        _metric("free_disk_bytes", "gauge", "Free space for raw files.", {"": service.free_bytes()}),
        _metric("wal_bytes", "gauge", "Size of the write-ahead log.", {"": wal_bytes(service)}),
    ]
    verdicts = select(ResultRow.verdict, func.count()).group_by(ResultRow.verdict)
    lines.append(_metric("runs", "gauge", "Results by verdict.", _counts(session, verdicts, "verdict")))
    uploads = select(Upload.status, func.count()).group_by(Upload.status)
    lines.append(_metric("sent_runs", "gauge", "Runs that were sent.", _counts(session, uploads, "status")))
    messages = select(Delivery.status, func.count()).group_by(Delivery.status)
    lines.append(_metric("messages", "gauge", "Messages by status.", _counts(session, messages, "status")))
    attempts = session.scalar(select(func.sum(Delivery.attempts))) or 0
    lines.append(_metric("message_attempts_total", "counter", "Attempts to send them.", {"": attempts}))
    refusals = {f'{{status="{status}"}}': count for status, count in sorted(service.refusals.items())}
    lines.append(_metric("refusals_total", "counter", "Requests that were refused.", refusals))
    beats = {f'{{result="{result}"}}': service.heartbeats[result] for result in (_SENT, _FAILED)}
    lines.append(_metric("heartbeats_total", "counter", "Calls of heartbeat_url.", beats))
    return lines


def _metric(name: str, kind: str, text: str, values: Mapping[str, float]) -> str:
    full = f"ballscrew_{name}"
    lines = [f"# HELP {full} {text}\n# TYPE {full} {kind}\n"]
    lines += [f"{full}{labels} {value}\n" for labels, value in values.items()]
    return "".join(lines)


def _counts(session: Session, query: Any, label: str) -> dict[str, float]:
    return {f'{{{label}="{name}"}}': count for name, count in session.execute(query)}


def beat_regularly(service: Service, workers: Sequence[Worker]) -> None:
    """Call the address of the settings in each period, until the service stops.

    Parameters
    ----------
    service : Service
        The service.
    workers : sequence of Worker
        Its workers.
    """
    if service.settings.heartbeat_url is None:
        return
    while not service.stopping.wait(_FIRST_BEAT if not service.heartbeats else service.settings.heartbeat_s):
        beat(service, workers)


def beat(service: Service, workers: Sequence[Worker]) -> None:
    """Call the address of the settings, unless runs are not received or analysed: silence is the message.

    Parameters
    ----------
    service : Service
        The service.
    workers : sequence of Worker
        Its workers.
    """
    import httpx

    url = service.settings.heartbeat_url
    if url is None:
        return
    try:
        reason = unready(service, workers)
        if reason is None:
            httpx.get(url.get_secret_value(), timeout=_PATIENCE).raise_for_status()
    except Exception as error:  # noqa: BLE001  the next one is called, whatever it is
        reason = type(error).__name__  # its text contains the address, which may be a secret
    service.heartbeats[_SENT if reason is None else _FAILED] += 1
    if reason is not None:
        _log.warning("no heartbeat: %s", reason)


def age_s(text: str | None) -> float:
    """Seconds since a time; 0 for None."""
    if text is None:
        return 0.0
    return max(0.0, round(time.time() - moment(text, "created_at").timestamp(), 3))


def wal_bytes(service: Service) -> int:
    """Size of the write-ahead log of SQLite; 0 where there is none."""
    path = service.store.folder.sqlite.with_name("store.sqlite-wal")
    return path.stat().st_size if path.exists() else 0
