"""Answers of the service: axes, runs, history, state, forecast, jobs, and changes."""

from __future__ import annotations

import asyncio
import csv
import io
import json
import re
from collections.abc import AsyncIterator, Iterable, Sequence
from datetime import UTC, datetime
from importlib.util import find_spec
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Header
from fastapi.responses import Response, StreamingResponse
from sqlalchemy import select
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from ballscrew.base.errors import InputError, shown
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.result import not_executed
from ballscrew.service.access import (
    AnyCaller,
    Caller,
    MaintainerCaller,
    RunningService,
    ViewerCaller,
    is_admitted,
)
from ballscrew.service.jobs import ANALYSE, ASSESS, enqueue, job_documents
from ballscrew.service.messages import TEST_MESSAGE
from ballscrew.service.runs import QUEUED, SET_ASIDE, upload_documents
from ballscrew.service.serving import RefusedError, Service, UnknownAxisError
from ballscrew.service.stored_runs import StoredRun, locate_run, result_document
from ballscrew.store.calendars import CALENDAR, calendar_of
from ballscrew.store.explaining import find_explanation
from ballscrew.store.lamps import add_lamps
from ballscrew.store.opened import record
from ballscrew.store.reading import find_axis, list_axes
from ballscrew.store.service_tables import JobRow, Setup, Upload
from ballscrew.store.showing import axis_document as stored_document
from ballscrew.store.tables import Audit, Axis, Model, RunRow

router = APIRouter(prefix="/api/v1")

_POLL = 0.5  # s between looks for changes
_QUIET = 15.0  # s after which a line shows that the connection lives
_MOST_EVENTS = 500  # sent at once
_ABOUT_PEOPLE = ("user", "token", "somebody")  # beginnings of subjects of the audit
_COLUMNS = (
    "run", "measured_at", "mass_kg", "temperature_C", "supersedes", "counts", "quality", "state", "epoch",
    "stiffness", "stiffness_low", "stiffness_high", "nut", "nut_low", "nut_high",
)  # fmt: skip
_FLEET_COLUMNS = (
    "axis", "machine", "site", "state", "state_because", "last_assessed_state", "measurement_troubles",
    "missing", "runs", "stiffness_ratio", "stiffness_ratio_low", "stiffness_ratio_high",
    "remaining_life_p05_days", "remaining_life_p50_days", "remaining_life_p95_days", "alarm_at",
    "newest_run_at", "next_run_due_at", "assessed_at",
)  # fmt: skip


@router.get("/axes", response_model=None)
def show_axes(
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    format: Literal["json", "csv"] = "json",  # noqa: A002
) -> dict[str, Any] | Response:
    """Every axis with its state, as JSON, or as CSV with a row for each."""
    document = fleet_document(service)
    if format == "csv":
        return _csv(_FLEET_COLUMNS, map(_fleet_row, document["axes"]))
    return document


def _fleet_row(axis: dict[str, Any]) -> dict[str, Any]:
    """Row of an axis: ratios, days and ISO times alone."""
    stiffness, life, lamp = axis["stiffness"] or [None] * 3, axis["rul_days"], axis["lamp"]
    troubles = "; ".join(each["kind"] for each in axis["measurement"]["troubles"])
    values = (
        axis["axis"], axis["machine"], axis["site"], lamp["state"], lamp["because"], axis["last_state"],
        troubles, "; ".join(axis["missing"]), axis["runs"], *stiffness,
        life.get("0.05"), life.get("0.5"), life.get("0.95"), axis["alarm_at"],
        axis["newest_at"], axis["due_at"], axis["assessed_at"],
    )  # fmt: skip
    return dict(zip(_FLEET_COLUMNS, values, strict=True))


def _csv(columns: Sequence[str], rows: Iterable[dict[str, Any]]) -> Response:
    """Rows as CSV, without texts that a spreadsheet would execute."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, columns, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: not_executed(value) for name, value in row.items()})
    return Response(stream.getvalue(), media_type="text/csv")


def fleet_document(service: Service) -> dict[str, Any]:
    """Every axis with its state; one that cannot be assessed with the reason. ``simulated`` in a demo."""
    document = list_axes(service.store) | {"simulated": service.store.folder.is_simulated()}
    with service.store.read() as session:
        missing, refusals = _all_missing(session), _refusals(session)
        for axis in document["axes"]:
            _add_missing(axis, missing.get(axis["axis"], []), refusals.get(axis["axis"]))
        add_lamps(session, document["axes"], datetime.now(UTC), service.settings.calendar)
    return document


def _add_missing(document: dict[str, Any], missing: list[str], refusal: str | None) -> None:
    """What an axis lacks, and why its assessment was refused."""
    document["missing"], document["refusal"] = missing, refusal
    if refusal is not None:
        document["reasons"] = [refusal]


def _refusals(session: Session) -> dict[str, str | None]:
    """Why the assessment of an axis was set aside, by the name of the axis."""
    aside = session.scalars(select(JobRow).where(JobRow.kind == ASSESS, JobRow.set_aside))
    return {row.argument: row.error for row in aside}


def missing_of(service: Service, axis: str) -> list[str]:
    """What an axis lacks to be assessed."""
    with service.store.read() as session:
        return _all_missing(session).get(axis, [])


def _all_missing(session: Session) -> dict[str, list[str]]:
    """What each axis lacks to be assessed, where it lacks something."""
    setups = {row.axis_id: row for row in session.scalars(select(Setup))}
    with_model = set(session.scalars(select(Model.axis_id)))
    timed = set(session.scalars(select(RunRow.axis_id).where(RunRow.time.is_not(None)).distinct()))
    found = {}
    for axis in session.scalars(select(Axis)):
        missing, setup = [], setups.get(axis.id)
        for kind, name in (("sheet", "data sheet"), ("plan", "plan"), ("channels", "channel map")):
            if setup is None or getattr(setup, kind) is None:
                missing.append(name)
        if axis.id not in with_model:
            missing.append("model")
        if axis.id not in timed:
            missing.append("run with a time")
        found[axis.name] = missing
    return found


@router.get("/axes/{axis}")
def show_whole_axis(axis: str, caller: ViewerCaller, service: RunningService) -> dict[str, Any]:  # noqa: ARG001
    """An axis: its set-up, its state and forecast, its runs, alarms, events and exclusions."""
    return axis_document(service, axis)


def axis_document(service: Service, axis: str) -> dict[str, Any]:
    """An axis, as ``store show --json`` prints it, with its explanation and what is missing.

    Raises
    ------
    UnknownAxisError
        If there is no such axis.
    """
    with service.store.read() as session:
        try:
            row = find_axis(session, axis)
        except InputError as error:
            raise UnknownAxisError(axis, str(error)) from None
        document = stored_document(session, row)
        missing, refusals = _all_missing(session), _refusals(session)
        document["explanation"] = find_explanation(session, row)
        _add_missing(document, missing.get(axis, []), refusals.get(axis))
        server, setup = service.settings.calendar, session.get(Setup, row.id)
        add_lamps(session, [document], datetime.now(UTC), server)
        document["schedule"] = _schedule(setup)
        document["calendar"] = calendar_of(setup, server).to_settings()
    return document


def _schedule(setup: Setup | None) -> dict[str, Any] | None:
    """Schedule of an axis as it was set up, None for each value that is the server's; None without one."""
    if setup is None or setup.period_s is None:
        return None
    calendar = dict.fromkeys(CALENDAR) | (setup.calendar or {})
    return {"period_s": setup.period_s, "grace_s": setup.grace_s} | calendar


@router.get("/axes/{axis}/state")
def show_state(axis: str, caller: ViewerCaller, service: RunningService) -> dict[str, Any]:  # noqa: ARG001
    """State of an axis by its newest assessment; *not assessed* with what is missing."""
    return _named(
        axis_document(service, axis),
        "axis", "state", "urgency", "last_state", "changed_at", "assessed_at", "newest_at", "assessed_until",
        "alarm_at", "lamp", "waiting", "stiffness", "missing", "refusal", "reasons",
    )  # fmt: skip


@router.get("/axes/{axis}/forecast")
def show_forecast(axis: str, caller: ViewerCaller, service: RunningService) -> dict[str, Any]:  # noqa: ARG001
    """Remaining useful life of an axis by its newest assessment."""
    document = axis_document(service, axis)
    document["rul_days"] = {"quantiles": document["rul_days"]}
    return _named(document, "axis", "state", "assessed_at", "newest_at", "rul_days", "missing")


def _named(document: dict[str, Any], *names: str) -> dict[str, Any]:
    return {"schema": SCHEMA} | {name: document[name] for name in names}


@router.get("/axes/{axis}/runs")
def show_runs(axis: str, caller: ViewerCaller, service: RunningService) -> dict[str, Any]:  # noqa: ARG001
    """Runs of an axis in time order, and what became of those that were sent, also of conflicts."""
    runs = axis_document(service, axis)["runs"]
    with service.store.read() as session:
        found = select(Upload).join(Axis, Axis.id == Upload.axis_id).where(Axis.name == axis)
        sent = upload_documents(session, session.scalars(found.order_by(Upload.id)).all())
    return {"schema": SCHEMA, "axis": axis, "runs": runs, "sent": sent}


@router.get("/axes/{axis}/history")
def show_history(
    axis: str,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    format: Literal["json", "csv", "parquet"] = "json",  # noqa: A002
) -> Response:
    """History of an axis, a row for each run, as JSON, CSV or Parquet."""
    rows = [_history_row(run) for run in axis_document(service, axis)["runs"]]
    if format == "json":
        text = json.dumps({"schema": SCHEMA, "axis": axis, "history": rows})
        return Response(text, media_type="application/json")
    if format == "csv":
        return _csv(_COLUMNS, rows)
    if find_spec("pyarrow") is None:
        raise InputError('Parquet needs pyarrow on the server: python -m pip install "ballscrew[parquet]".')
    import pandas as pd

    content = io.BytesIO()
    pd.DataFrame(rows, columns=list(_COLUMNS)).to_parquet(content, index=False)
    return Response(content.getvalue(), media_type="application/vnd.apache.parquet")


def _history_row(run: dict[str, Any]) -> dict[str, Any]:
    row = {name: run.get(name) for name in _COLUMNS}
    for name in ("stiffness", "nut"):
        row[name], row[f"{name}_low"], row[f"{name}_high"] = run[name] or (None, None, None)
    return row


@router.get("/runs/{run}")
def show_run(run: str, caller: AnyCaller, service: RunningService) -> dict[str, Any]:
    """A run by its content id or by the id of its result: what became of it, and its RUN.json.

    The token of a machine shows the runs of this machine.
    """
    with service.store.read() as session:
        found = _locate_run(session, run, caller)
        document = {"schema": SCHEMA, "axis": found.axis.name, "sent": upload_documents(session, found.sent)}
        document["run"] = None if found.row is None else result_document(session, found.axis, found.row)
        return document


@router.get("/runs/{run}/document")
def show_document(run: str, caller: AnyCaller, service: RunningService) -> dict[str, Any]:
    """RUN.json of a run, as ``analyze --json`` prints it."""
    with service.store.read() as session:
        found = _locate_run(session, run, caller)
        if found.row is None:
            raise RefusedError(404, f"the run {shown(run)} has no result.")
        document: dict[str, Any] = result_document(session, found.axis, found.row)
        return document


def _locate_run(session: Session, run: str, caller: Caller) -> StoredRun:
    """A run that a caller may read."""
    try:
        return locate_run(session, run, machine=caller.machine)
    except RefusedError as error:
        if caller.machine is None or error.status != 404:
            raise
        raise RefusedError(403, "the token of a machine shows the runs of this machine.") from None


@router.get("/jobs")
def show_jobs(caller: ViewerCaller, service: RunningService) -> dict[str, Any]:  # noqa: ARG001
    """Jobs that wait, run, or were set aside with their reasons."""
    with service.store.read() as session:
        return {"schema": SCHEMA, "jobs": job_documents(session)}


@router.post("/jobs/{job}/retry")
def retry_job(job: int, caller: MaintainerCaller, service: RunningService) -> dict[str, Any]:
    """Try a job again that was set aside."""
    with service.store.write("retry") as session:
        row = session.get(JobRow, job) if 0 < job < 1 << 31 else None
        if row is None or not row.set_aside:
            raise RefusedError(404, "there is no such job that was set aside; GET /api/v1/jobs lists them.")
        if row.kind == ANALYSE:
            waiting = (Upload.content == row.argument, Upload.status == SET_ASIDE)
            for upload in session.scalars(select(Upload).where(*waiting)):
                upload.status, upload.error, upload.finished_at = QUEUED, None, None
        enqueue(session, row.kind, row.argument)
        record(session, "retry", f"{row.kind} {row.argument}", by=caller.name)
    service.announce()
    return {"schema": SCHEMA, "id": job, "status": QUEUED}


@router.get("/events")
def stream_events(
    caller: ViewerCaller,
    service: RunningService,
    last_event_id: Annotated[str | None, Header()] = None,
) -> StreamingResponse:
    """Changes as server-sent events, continued after ``Last-Event-ID`` without a gap.

    Those of users and tokens are for administrators.
    """
    after = None
    if last_event_id is not None and re.fullmatch("[0-9]{1,18}", last_event_id):
        after = min(int(last_event_id), 1 << 31)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(_events(service, after, caller), media_type="text/event-stream", headers=headers)


async def _events(service: Service, after: int | None, caller: Caller) -> AsyncIterator[str]:
    """Rows of the audit as they are written, as long as the caller is admitted."""
    if after is None:
        after = await run_in_threadpool(_newest, service)
    yield ": connected\n\n"
    changes, quiet = -1, 0.0
    while True:
        if changes != service.changes:
            changes, quiet = service.changes, 0.0
            if not await run_in_threadpool(is_admitted, service, caller):
                return
            rows = await run_in_threadpool(_rows_after, service, after, caller)
            for number, text in rows:
                after = number
                yield text
            if len(rows) == _MOST_EVENTS:  # there may be more
                changes = -1
                continue
        if service.stopping.is_set():
            return
        await asyncio.sleep(_POLL)
        quiet += _POLL
        if quiet >= _QUIET:
            changes, quiet = -1, 0.0
            yield ": nothing new\n\n"


def _newest(service: Service) -> int:
    with service.store.read() as session:
        return session.scalar(select(Audit.id).order_by(Audit.id.desc()).limit(1)) or 0


def _rows_after(service: Service, after: int, caller: Caller) -> list[tuple[int, str]]:
    query = select(Audit).where(Audit.id > after).order_by(Audit.id).limit(_MOST_EVENTS)
    if not caller.may("admin"):
        for about in _ABOUT_PEOPLE:
            query = query.where(Audit.subject.not_like(f"{about} %"))
        query = query.where(Audit.action != TEST_MESSAGE)  # has the address of its recipient
    with service.store.read() as session:
        rows = session.scalars(query).all()
    found = []
    for row in rows:
        detail = {name: value for name, value in row.detail.items() if name != "from"}
        document = {"at": row.at, "action": row.action, "subject": row.subject, **detail}
        found.append((row.id, f"id: {row.id}\nevent: change\ndata: {json.dumps(document)}\n\n"))
    return found
