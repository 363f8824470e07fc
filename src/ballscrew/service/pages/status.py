"""Pages of the server: health of store and workers, queue and newest sent runs; its settings."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse
from sqlalchemy import func, select

from ballscrew.service.access import AdminCaller, RunningService, ViewerCaller
from ballscrew.service.health import Workers, age_s, ready_workers, unready, wal_bytes
from ballscrew.service.jobs import job_documents
from ballscrew.service.message_log import count_messages, failing_recipients
from ballscrew.service.pages.rendering import render
from ballscrew.service.runs import SET_ASIDE
from ballscrew.service.serving import Service
from ballscrew.service.settings import plain_setting
from ballscrew.service.tokens import list_tokens
from ballscrew.store.alarms import standing_alarms
from ballscrew.store.service_tables import Upload
from ballscrew.store.tables import Axis, RawFile

router = APIRouter(include_in_schema=False)

_NEWEST = 10
_MOST_JOBS = 20


@router.get("/status")
def show_status(
    request: Request,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    workers: Workers,
) -> HTMLResponse:
    """Health of the server; ``?part=health`` gives what changes alone."""
    with service.store.read() as session:
        axes = session.scalar(select(func.count()).select_from(Axis))
        alarms = standing_alarms(session)
        jobs = job_documents(session)
        failing = failing_recipients(session, service)
        messages = count_messages(session)
        sent = session.execute(
            select(Upload, Axis.name)
            .join(Axis, Axis.id == Upload.axis_id)
            .order_by(Upload.id.desc())
            .limit(_NEWEST)
        ).all()
        newest = [(axis, row.key, row.received_at, row.status, row.verdict, row.error) for row, axis in sent]
    template = "status.html"
    if request.query_params.get("part") == "health":
        template = "status_health.html"
    waiting = [job for job in jobs if job["status"] != SET_ASIDE]
    return render(
        request,
        template,
        reason=unready(service, workers),
        axes=axes,
        alarms=len(alarms),
        waiting=len(waiting),
        oldest_s=max((age_s(job["created_at"]) for job in waiting), default=0.0),
        aside=len(jobs) - len(waiting),
        jobs=jobs[:_MOST_JOBS],
        failing=failing,
        messages=messages,
        sent=newest,
        ready=ready_workers(workers),
        workers=service.settings.workers,
        free_bytes=service.free_bytes(),
        tokens=_count_tokens(service),
        store=_store(service),
        heartbeats=service.heartbeats,
        has_heartbeat=service.settings.heartbeat_url is not None,
    )


@router.get("/settings")
def show_settings(
    request: Request,
    caller: AdminCaller,  # noqa: ARG001
    service: RunningService,
) -> HTMLResponse:
    """Each setting, its value and where it comes from; of a secret, that it is set."""
    return render(request, "settings.html", settings=_settings(service))


def _count_tokens(service: Service) -> dict[str, int]:
    """Number of valid tokens with roles and of machines, and of those that were revoked."""
    found = {"role": 0, "machine": 0, "revoked": 0}
    for token in list_tokens(service.store):
        kind = "machine"
        if token["revoked_at"] is not None:
            kind = "revoked"
        elif token["role"] is not None:
            kind = "role"
        found[kind] += 1
    return found


def _store(service: Service) -> dict[str, Any]:
    """Folder, kind of database, and sizes in bytes; without the URL, which may contain a password."""
    folder, bytes_of_sqlite = service.store.folder, None
    if folder.database_url() is None:
        bytes_of_sqlite = folder.sqlite.stat().st_size
    with service.store.read() as session:
        stored = select(func.count(), func.coalesce(func.sum(RawFile.stored_size), 0)).where(
            RawFile.is_stored
        )
        files, bytes_of_files = session.execute(stored).all()[0]
    checks = folder.checks()
    return {
        "path": str(service.store.path),
        "bytes": bytes_of_sqlite,
        "wal_bytes": wal_bytes(service),
        "files": files,
        "bytes_of_files": int(bytes_of_files),
        "verification": checks.get("verification"),
        "backup": checks.get("backup"),
    }


def _in_words(value: Any) -> Any:
    """A setting that is a list or a table as one text."""
    if isinstance(value, dict):
        parts = [f"{name} {_in_words(each)}" for name, each in value.items() if each not in (None, [])]
        return ", ".join(parts)
    if isinstance(value, list):
        return "; ".join(map(str, map(_in_words, value)))
    return value


def _settings(service: Service) -> list[tuple[str, Any, str, str]]:
    """Name, value, meaning and origin of each setting."""
    found = []
    for name, field in type(service.settings).model_fields.items():
        value = _in_words(plain_setting(getattr(service.settings, name)))
        origin = service.origins.get(name, "default")
        found.append((name, value, field.description or "", origin))
    return found
