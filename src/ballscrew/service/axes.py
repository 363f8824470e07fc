"""Set-up of an axis over HTTP: machine, documents, schedule, model, events and exclusions."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter
from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from sqlalchemy import select

from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import InputError, shown
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.provenance import digest
from ballscrew.calibration.modelfile import KIND, model_from_json
from ballscrew.fcft.plan import read_plan
from ballscrew.monitoring.epochs import Event, moment
from ballscrew.prognosis.monitor import monitor
from ballscrew.recording.channels import read_channels
from ballscrew.service.access import AdminCaller, Caller, MaintainerCaller, RunningService, find_sent_axis
from ballscrew.service.counting import check_time
from ballscrew.service.jobs import request_assessment
from ballscrew.service.reading import missing_of
from ballscrew.service.serving import RefusedError, Service
from ballscrew.service.settings import Day, Shifts
from ballscrew.service.stored_runs import locate_run
from ballscrew.store.adding import add_events, add_model, add_sheet, insert_document
from ballscrew.store.calendars import CALENDAR, LONGEST_WAIT, RunCalendar, Weekday, known_zone
from ballscrew.store.changing import choose_model, correct_run, exclude
from ballscrew.store.folder import now
from ballscrew.store.histories import read_stored_history
from ballscrew.store.opened import record
from ballscrew.store.raw_files import text_files
from ballscrew.store.reading import find_axis
from ballscrew.store.service_tables import Setup
from ballscrew.store.tables import EventRow

router = APIRouter(prefix="/api/v1/axes/{axis}")

READERS: dict[str, Callable[[Path], Any]] = {"axis": read_axis, "plan": read_plan, "channels": read_channels}
"""Reader of each kind of document."""

_LONGEST = 1 << 20  # characters of a document

Kind = Literal["runs", "events"]


def _checked_zone(name: str) -> str:
    if known_zone(name) is None:
        raise ValueError(f"{shown(name)} is no known time zone; give one such as Europe/Berlin")
    return name


TimeZone = Annotated[str, Field(max_length=64), AfterValidator(_checked_zone)]


class Schedule(BaseModel):
    """When runs of an axis are expected; without a value of its calendar, that of the server."""

    model_config = ConfigDict(extra="forbid")
    period_s: float = Field(gt=0, le=1e9, description="Time from one run to the next, within shifts.")
    grace_s: float = Field(0.0, ge=0, le=1e9, description="Time beyond it until an alarm is raised.")
    working_days: tuple[Weekday, ...] | None = Field(
        default=None, min_length=1, max_length=7, description="Days of the week on which runs are expected."
    )
    holidays: tuple[Day, ...] | None = Field(
        default=None, max_length=1000, description="Days on which none are expected besides."
    )
    time_zone: TimeZone | None = Field(default=None, description="Of these days, such as Europe/Berlin.")
    shifts: Shifts | None = Field(
        default=None, description="Times of these days, such as 06:00-14:00; an empty list is the whole day."
    )

    @property
    def calendar(self) -> dict[str, Any]:
        """Values of the calendar that are stated."""
        return self.model_dump(mode="json", include=set(CALENDAR), exclude_none=True)


class AxisSetup(BaseModel):
    """An axis as it is set up, whole."""

    model_config = ConfigDict(extra="forbid")
    machine: str = Field(min_length=1, max_length=200)
    site: str = Field("", max_length=200)
    sheet: str = Field(max_length=_LONGEST, description="Text of the data sheet, axis.toml.")
    plan: str | None = Field(None, max_length=_LONGEST, description="Text of plan.toml.")
    channels: str | None = Field(None, max_length=_LONGEST, description="Text of channels.toml.")
    schedule: Schedule | None = None


class NewEvent(BaseModel):
    """An event on an axis."""

    model_config = ConfigDict(extra="forbid")
    at: str = Field(max_length=64, description="ISO 8601.")
    kind: str = Field(max_length=64)
    text: str = Field("", max_length=10_000)


class NewExclusion(BaseModel):
    """Why a run is excluded."""

    model_config = ConfigDict(extra="forbid")
    reason: str = Field(min_length=1, max_length=10_000)


class NewCorrection(BaseModel):
    """What is corrected in a run, and why."""

    model_config = ConfigDict(extra="forbid")
    measured_at: str | None = Field(None, max_length=64, description="ISO 8601.")
    mass_kg: float | None = Field(None, description="Load on the table.")
    reason: str = Field("", max_length=10_000)


@router.put("")
def set_up_axis(axis: str, setup: AxisSetup, caller: AdminCaller, service: RunningService) -> dict[str, Any]:
    """Set up an axis: machine, data sheet, plan, channel map and schedule."""
    _check_schedule(setup.schedule, service.settings.calendar)
    digests: dict[str, str] = {}
    texts = {"axis": setup.sheet, "plan": setup.plan, "channels": setup.channels}
    with text_files(texts) as paths:
        name = read_axis(paths["axis"]).name
        if name != axis:
            raise InputError(f"the data sheet is that of the axis {shown(name)}, not of {shown(axis)}.")
        for kind, path in paths.items():
            digests[kind] = digest(READERS[kind](path).to_settings())
        added = add_sheet(service.store, paths["axis"], machine=setup.machine, site=setup.site)
    with service.store.write("set up") as session:
        row = find_axis(session, axis)
        for kind in ("plan", "channels"):
            if kind in digests:
                insert_document(session, kind, digests[kind], str(texts[kind]), None)
        found = session.get(Setup, row.id)
        before = _setup_document(found)
        if found is None:
            found = Setup(axis_id=row.id, set_up_at=now())
            session.add(found)
        found.sheet, found.plan, found.channels = (digests.get(kind) for kind in texts)
        _set_schedule(found, setup.schedule)
        changed = {}
        for name, value in _setup_document(found).items():
            if before[name] != value:
                changed[name] = [before[name], value]
        record(session, "set up", f"axis {axis}", axis=axis, by=caller.name, changed=changed)
    service.announce()
    document = {"schema": SCHEMA, "axis": axis, "new": added.is_new, "documents": digests}
    return document | {"missing": missing_of(service, axis)}


def _check_schedule(schedule: Schedule | None, server: RunCalendar) -> None:
    """Refuse a schedule by which a run is never due."""
    if schedule is None:
        return
    calendar, begin = server.changed(schedule.calendar), datetime.now(UTC)
    problem = calendar.problem()
    if problem is not None:
        raise InputError(f"schedule: {problem}")
    wait = timedelta(seconds=schedule.period_s + schedule.grace_s)
    if calendar.after(begin, wait) >= begin + LONGEST_WAIT:
        raise InputError("schedule: period_s and grace_s are more than the shifts of 100 years.")


def _set_schedule(row: Setup, schedule: Schedule | None) -> None:
    row.period_s = row.grace_s = row.calendar = None
    if schedule is not None:
        row.period_s, row.grace_s, row.calendar = (
            schedule.period_s,
            schedule.grace_s,
            schedule.calendar or None,
        )


def _setup_document(row: Setup | None) -> dict[str, Any]:
    """What is set up for an axis, for the audit."""
    found = {name: getattr(row, name, None) for name in ("sheet", "plan", "channels", "period_s", "grace_s")}
    calendar = getattr(row, "calendar", None) or {}
    return found | {name: calendar.get(name) for name in CALENDAR}


@router.put("/model")
def add_axis_model(
    axis: str, document: dict[str, Any], caller: AdminCaller, service: RunningService, *, use: bool = False
) -> dict[str, Any]:
    """Add the model of an axis, MODEL.json; with ``use``, it is used in place of the one before."""
    with service.store.read() as session:
        find_sent_axis(session, axis, caller)
    if document.get("kind") != KIND:
        raise InputError("the body is no MODEL.json, which 'ballscrew calibrate' writes.")
    model = model_from_json(document, "MODEL.json")
    if model.axis != axis:
        raise InputError(f"the model is that of the axis {shown(model.axis)}, not of {shown(axis)}.")
    added = add_model(service.store, model)
    if use:
        choose_model(service.store, axis, added.subject, reason="chosen when it was added")
    _assess_soon(service, axis)
    return {"schema": SCHEMA, "axis": axis, "new": added.is_new, "digest": added.subject}


@router.post("/events")
def add_axis_events(
    axis: str,
    events: list[NewEvent],
    caller: MaintainerCaller,
    service: RunningService,
    *,
    preview: bool = False,
) -> dict[str, Any]:
    """Add events on an axis; with ``preview``, only show how the state would change."""
    with service.store.read() as session:
        find_sent_axis(session, axis, caller)
    found = tuple(Event(event.at, event.kind, event.text) for event in events)
    if preview:
        return {"schema": SCHEMA, "axis": axis, "stored": False, **_preview(service, axis, found)}
    added = add_events(service.store, found, axis)
    _assess_soon(service, axis)
    return {"schema": SCHEMA, "axis": axis, "stored": True, "new": added.is_new}


@router.post("/{kind}/{subject}/exclusion")
def exclude_subject(
    axis: str, kind: Kind, subject: str, body: NewExclusion, caller: MaintainerCaller, service: RunningService
) -> dict[str, Any]:
    """Exclude a run, or an event by its digest, from the history with a reason; it stays in the store."""
    return _exclude(service, axis, kind, subject, caller, body.reason)


@router.delete("/{kind}/{subject}/exclusion")
def include_subject(
    axis: str, kind: Kind, subject: str, caller: MaintainerCaller, service: RunningService
) -> dict[str, Any]:
    """Include a run or an event that was excluded again."""
    return _exclude(service, axis, kind, subject, caller, None)


def _exclude(
    service: Service, axis: str, kind: Kind, subject: str, caller: Caller, reason: str | None
) -> dict[str, Any]:
    """Exclude a run or an event, or include it where there is no reason, and assess its axis."""
    subject = _find(service, axis, kind, subject, caller)
    exclude(service.store, subject, reason=reason or "", undo=reason is None, by=caller.name)
    _assess_soon(service, axis)
    return {"schema": SCHEMA, "axis": axis, "id": subject, "excluded": reason is not None}


@router.post("/runs/{run}/correct")
def correct_stored_run(
    axis: str, run: str, body: NewCorrection, caller: MaintainerCaller, service: RunningService
) -> dict[str, Any]:
    """Correct the time or the load of a run; the run as it was stays in the store, and no longer counts."""
    run = _find(service, axis, "runs", run, caller)
    if body.measured_at is not None:
        check_time(body.measured_at)
    new = correct_run(
        service.store,
        run,
        measured_at=body.measured_at,
        mass=body.mass_kg,
        reason=body.reason,
        by=caller.name,
    )
    _assess_soon(service, axis)
    return {"schema": SCHEMA, "axis": axis, "id": new, "supersedes": run}


def _find(service: Service, axis: str, kind: Kind, subject: str, caller: Caller) -> str:
    """Whole id of a run or an event of an axis."""
    with service.store.read() as session:
        row = find_sent_axis(session, axis, caller)
        if kind == "runs":
            return locate_run(session, subject, axis=row).id
        of_axis = (EventRow.axis_id == row.id, EventRow.digest == subject)
        found = session.scalar(select(EventRow.digest).where(*of_axis))
    if found is None:
        raise RefusedError(404, f"there is no event {shown(subject)} of the axis {shown(axis)}.")
    return found


def _preview(service: Service, axis: str, events: tuple[Event, ...]) -> dict[str, Any]:
    """State of an axis without and with further events, and whether one counts from the next run on."""
    with service.store.read() as session:
        history = read_stored_history(session, axis)
    newest = max(moment(str(run.measured_at), "a run: measured_at") for run in history.runs)
    found: dict[str, Any] = {"from_next_run": any(event.when > newest for event in events)}
    with service.computing("a preview"):
        for name, more in (("before", ()), ("after", events)):
            state = monitor(history.runs, history.model, events=(*history.events, *more)).state
            found[name] = {
                "state": state.state,
                "urgency": state.urgency,
                "alarm_at": state.alarm_at,
                "epochs": [[epoch.begins, epoch.cause] for epoch in state.epochs],
            }
    return found


def _assess_soon(service: Service, axis: str) -> None:
    """Assess an axis after a change."""
    with service.store.write("assess") as session:
        request_assessment(session, find_axis(session, axis))
    service.announce()
