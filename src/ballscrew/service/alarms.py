"""Alarms as rows: raised and retracted by assessments, acknowledged, shelved and closed by people."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import Any, Literal

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.monitoring.epochs import Event, moment
from ballscrew.service.access import MaintainerCaller, RunningService, ViewerCaller
from ballscrew.service.counting import doubted_runs, doubts_of
from ballscrew.service.jobs import request_assessment
from ballscrew.service.serving import RefusedError, Service
from ballscrew.store.adding import insert_events
from ballscrew.store.alarms import alarm_document, alarm_documents, alarm_over_at
from ballscrew.store.calendars import RunCalendar, calendar_of
from ballscrew.store.findings import stored_finding
from ballscrew.store.folder import now
from ballscrew.store.opened import record
from ballscrew.store.service_tables import AlarmAction, Message, Setup, Trouble, Upload
from ballscrew.store.tables import AlarmRow, Axis, ResultRow, RunRow

router = APIRouter(prefix="/api/v1/alarms")

SILENCE, MEASUREMENT, ASSESSMENT = "silence", "measurement", "assessment"
_MOST_DOUBTED = 100  # newest uploads among which one without doubt is looked for
_ARRIVED = ("queued", "done", "set aside")  # states of what was sent that is no run of another content
_LONGEST_TEXT = 4000  # characters of the text of a trouble
_ACTIONS = {"acknowledge": "acknowledged", "shelve": "shelved", "close": "closed", "reopen": "raised"}


class Maintenance(BaseModel):
    """What was done to an axis: an event, which may begin a new epoch."""

    model_config = ConfigDict(extra="forbid")
    at: str = Field(max_length=64, description="ISO 8601.")
    kind: str = Field(max_length=64, description="Kind of an event.")
    text: str = Field("", max_length=10_000)


class Action(BaseModel):
    """What a person does about an alarm."""

    model_config = ConfigDict(extra="forbid")
    action: Literal["acknowledge", "shelve", "close", "reopen"]
    until: str | None = Field(None, max_length=64, description="With shelve: its end, ISO 8601.")
    text: str = Field("", max_length=10_000, description="Finding; close needs one.")
    finding: Literal["preload loss", "another cause", "nothing found", "not inspected"] | None = Field(
        None, description="With close, of an alarm of an axis: what was found."
    )
    cause: str = Field("", max_length=1000, description="Which other cause.")
    maintenance: Maintenance | None = Field(None, description="With close: what was done.")


@router.get("")
def list_alarms(caller: ViewerCaller, service: RunningService) -> dict[str, Any]:  # noqa: ARG001
    """Alarms of all axes, and troubles with their measurements, the newest first."""
    with service.store.read() as session:
        return {"schema": SCHEMA, "alarms": alarm_documents(session)}


@router.post("/{alarm}")
def act(alarm: str, action: Action, caller: MaintainerCaller, service: RunningService) -> dict[str, Any]:
    """Acknowledge, shelve, close with a finding, or reopen an alarm; the same again changes nothing."""
    _check(action)
    with service.store.write("alarm") as session:
        kind, row = _find_alarm(session, alarm)
        if action.finding is not None and kind != "alarm":
            raise InputError("a finding is that of an alarm of an axis; a trouble is closed with a text.")
        before = alarm_document(session, row)
        if _is_repeated(before, action, caller.name):
            return {"schema": SCHEMA, **before}
        if before["state"] == "closed" and action.action in ("acknowledge", "shelve"):
            raise RefusedError(409, f"{alarm} was closed already; reopen it first.")
        taken = AlarmAction(
            action=_ACTIONS[action.action], until=action.until, text=action.text, actor=caller.name, at=now()
        )
        if action.finding is not None:
            taken.finding = stored_finding(action.finding, action.cause)
        if action.maintenance is not None:
            taken.event = _add_maintenance(session, row.axis_id, action.maintenance)
        setattr(taken, f"{kind}_id", row.id)
        session.add(taken)
        session.flush()
        document = alarm_document(session, row)
        record(
            session,
            action.action,
            alarm,
            axis=before["axis"],
            by=caller.name,
            text=action.text,
            until=action.until,
            finding=taken.finding,
            event=taken.event,
            changed={"state": [before["state"], document["state"]]},
        )
    service.announce()
    return {"schema": SCHEMA, **document}


def _is_repeated(document: dict[str, Any], action: Action, by: str) -> bool:
    """Whether an alarm is in the state after an action, by the same action of the same person."""
    done, newest = _ACTIONS[action.action], document["actions"][-1:]
    same = {"action": done, "by": by, "until": action.until, "text": action.text}
    same |= {"finding": action.finding, "cause": action.cause.strip() or None}
    return document["state"] == done and all(same.items() <= each.items() for each in newest)


def _add_maintenance(session: Session, axis: int, done: Maintenance) -> str:
    """Add the event of a maintenance, and the job that assesses its axis; its digest."""
    row = session.get_one(Axis, axis)
    (key,), _ = insert_events(session, row, (Event(done.at, done.kind, done.text),))
    request_assessment(session, row)
    return key


def _check(action: Action) -> None:
    """Check that an action has what it needs."""
    if action.action != "close" and (action.finding, action.cause, action.maintenance) != (None, "", None):
        raise InputError("finding, cause and maintenance belong to close.")
    if action.finding is None and action.cause:
        raise InputError("cause needs a finding.")
    if action.action == "close" and not action.text.strip():
        raise InputError("an alarm is closed with a finding (text).")
    if (action.action == "shelve") != (action.until is not None):
        raise InputError("until is the end of a shelving: give it with shelve, and with no other action.")
    if action.until is not None and moment(action.until, "until") <= datetime.now(UTC):
        raise InputError("the end of a shelving must be in the future.")


def _find_alarm(session: Session, name: str) -> tuple[str, AlarmRow | Trouble]:
    """Kind and row of an alarm, ``alarm-1`` or ``trouble-1``."""
    kind, _, number = name.partition("-")
    row: AlarmRow | Trouble | None = None
    if re.fullmatch("[0-9]{1,9}", number):
        if kind == "alarm":
            row = session.get(AlarmRow, int(number))
        elif kind == "trouble":
            row = session.get(Trouble, int(number))
    if row is None:
        raise RefusedError(404, "there is no such alarm; GET /api/v1/alarms lists them.")
    return kind, row


def write_messages(session: Session, axis: Axis) -> None:
    """Add a message for each alarm of an axis that was raised, retracted or over since its last message.

    One of the past that was over when it was raised needs none.

    Parameters
    ----------
    session : Session
        Writing; the messages are there with what they report, or not at all.
    axis : Axis
        Its axis.
    """
    session.flush()
    for alarm in session.scalars(select(AlarmRow).where(AlarmRow.axis_id == axis.id).order_by(AlarmRow.id)):
        kind = "raised"
        if alarm.retracted_at is not None:
            kind = "retracted"
        elif alarm_over_at(session, alarm) is not None:
            kind = "ended"
        _add_message(session, axis, f"alarm-{alarm.id}", kind, {"began_at": alarm.began_at})


def _add_message(session: Session, axis: Axis, subject: str, kind: str, detail: dict[str, Any]) -> None:
    """Add a message, unless the last one about its subject was of the same kind."""
    about = Message.key.startswith(f"{subject}/")
    last = session.scalar(select(Message).where(about).order_by(Message.id.desc()).limit(1))
    if kind == (last.kind if last is not None else "ended"):
        return
    number = int(session.scalar(select(func.count()).where(about)) or 0) + 1
    document = {"subject": subject, "axis": axis.name, **detail}
    session.add(
        Message(
            key=f"{subject}/{number}", axis_id=axis.id, kind=kind, detail=document, at=now(), sent_at=None
        )
    )
    session.flush()


def report_bad_measurement(
    session: Session, axis: Axis, at: str, reasons: Sequence[str], *, is_dated: bool = True
) -> None:
    """Raise a trouble with the measurement, or end it after a run without reasons.

    A run that was measured before the trouble began, and one before another that is not bad, change nothing.
    Recordings whose time is not known were measured before their receipt: their trouble ends with the newest
    run of the axis, if that comes later and is not bad.

    Parameters
    ----------
    session : Session
        Writing.
    axis : Axis
        Its axis.
    at : str
        Time of the run.
    reasons : sequence of str
        Why it is bad; empty for one that is not.
    is_dated : bool
        Whether its time is known; else ``at`` is that of its receipt.
    """
    standing = _standing(session, axis, MEASUREMENT)
    if standing is not None and moment(at, "measured_at") < moment(standing.began_at, "began_at"):
        received = (Upload.axis_id == axis.id, Upload.received_at == standing.began_at)
        began_at_receipt = session.scalar(select(Upload.id).where(*received).limit(1)) is not None
        if reasons or not began_at_receipt or not _is_good_after(session, axis, standing.began_at, False):
            return
    if standing is None and reasons and _is_good_after(session, axis, at, is_dated):
        return
    _change_trouble(session, axis, standing, MEASUREMENT, at if reasons else None, _joined(reasons))


def _joined(reasons: Sequence[str]) -> str:
    """Reasons as one text, the first ones of very many."""
    text = "; ".join(reasons)
    if len(text) <= _LONGEST_TEXT:
        return text
    start = text[:_LONGEST_TEXT]
    return f"{start.rpartition('; ')[0] or start}; …"


def _is_good_after(session: Session, axis: Axis, at: str, is_dated: bool) -> bool:
    """Whether the newest run that is not bad was measured after a time, or else came after it."""
    runs = select(RunRow).join(ResultRow, ResultRow.run_id == RunRow.id)
    runs = runs.where(RunRow.axis_id == axis.id, RunRow.time.is_not(None), ResultRow.verdict != "bad")
    runs = runs.where(RunRow.id.not_in(doubted_runs())).order_by(RunRow.time.desc(), RunRow.id.desc())
    newest = session.scalars(runs.limit(1)).first()
    if newest is None:
        return False
    time = str(newest.measured_at if is_dated else newest.received_at)
    return moment(time, "a run") > moment(at, "a run")


def report_refused_assessment(session: Session, axis: Axis, reason: str | None) -> None:
    """Raise a trouble because an axis cannot be assessed, or end it.

    Parameters
    ----------
    session : Session
        Writing.
    axis : Axis
        The axis.
    reason : str or None
        Why; None after an assessment.
    """
    text = "" if reason is None else f"the axis cannot be assessed: {reason}"
    _set_trouble(session, axis, ASSESSMENT, None if reason is None else now(), text)


def _set_trouble(session: Session, axis: Axis, kind: str, began_at: str | None, text: str = "") -> bool:
    """Raise a trouble, or end it where ``began_at`` is None; whether something changed."""
    return _change_trouble(session, axis, _standing(session, axis, kind), kind, began_at, text)


def _change_trouble(
    session: Session, axis: Axis, standing: Trouble | None, kind: str, began_at: str | None, text: str
) -> bool:
    """As :func:`_set_trouble`, given the trouble that stands."""
    if standing is not None and began_at is not None:
        if not _is_another(session, standing, began_at, text):
            standing.text = text
            return False
        standing.ended_at, standing = now(), None
    if standing is None and began_at is None:
        return False
    if standing is None:
        same = (Trouble.axis_id == axis.id, Trouble.kind == kind, Trouble.began_at == began_at)
        standing = session.scalar(select(Trouble).where(*same))
        if standing is None:
            standing = Trouble(axis_id=axis.id, kind=kind, began_at=began_at, text=text, raised_at=now())
            session.add(standing)
        standing.ended_at = None
        session.flush()
        action = "raised"
    else:
        standing.ended_at = now()
        action = "ended"
    _add_message(session, axis, f"trouble-{standing.id}", action, {"kind": kind, "text": standing.text})
    record(session, action, f"{kind} of {axis.name}", text=standing.text)
    return True


def _is_another(session: Session, closed: Trouble, began_at: str, text: str) -> bool:
    """Whether a trouble is another one than that of the same kind which a person has closed."""
    if alarm_document(session, closed)["state"] != "closed" or began_at == closed.began_at:
        return False
    return closed.kind == MEASUREMENT or text != closed.text


def _standing(session: Session, axis: Axis, kind: str) -> Trouble | None:
    """Trouble of an axis that has not ended."""
    of_kind = (Trouble.axis_id == axis.id, Trouble.kind == kind, Trouble.ended_at.is_(None))
    return session.scalar(select(Trouble).where(*of_kind))


def watch_for_silence(service: Service, at: datetime | None = None) -> None:
    """Raise a trouble for each axis whose run is overdue by its schedule, and end those that are not.

    Parameters
    ----------
    service : Service
        The service.
    at : datetime, optional
        The present time.
    """
    at, server = at or datetime.now(UTC), service.settings.calendar
    with service.store.read() as session:
        late: dict[int, tuple[str, str] | None] = {}
        for setup in session.scalars(select(Setup).where(Setup.period_s.is_not(None))):
            late[setup.axis_id] = _silent_since(session, server, setup, at)
        standing = select(Trouble.axis_id).where(Trouble.kind == SILENCE, Trouble.ended_at.is_(None))
        raised = set(session.scalars(standing))
    late |= dict.fromkeys(raised - late.keys())  # of a schedule that was removed
    changed = False
    for axis, silence in late.items():
        if (axis in raised) != (silence is not None):
            since, began_at = silence or ("", None)
            with service.store.write("silence") as session:
                row = session.get_one(Axis, axis)
                changed |= _set_trouble(session, row, SILENCE, began_at, f"no run since {since}: overdue.")
    if changed:
        service.announce()


def _silent_since(
    session: Session, server: RunCalendar, setup: Setup, at: datetime
) -> tuple[str, str] | None:
    """Receipt of the newest run of an axis, or its set-up, and when the next was overdue; None if it is not.

    What was sent counts from its receipt, also where its analysis came later. A run whose time is doubtful
    does not count.
    """
    of_axis = (RunRow.axis_id == setup.axis_id, RunRow.id.not_in(doubted_runs()))
    is_sent = select(Upload.id).where(Upload.run == RunRow.run).exists()
    added = session.scalar(select(func.max(RunRow.received_at)).where(*of_axis, ~is_sent))
    newest = max(added or setup.set_up_at, setup.set_up_at)
    later = select(Upload).where(Upload.axis_id == setup.axis_id, Upload.received_at > newest)
    later = later.where(Upload.status.in_(_ARRIVED)).order_by(Upload.received_at.desc())
    for upload in session.scalars(later.limit(_MOST_DOUBTED)).all():
        if doubts_of(session, [upload]) == [None]:
            newest = upload.received_at
            break
    patience = timedelta(seconds=(setup.period_s or 0.0) + (setup.grace_s or 0.0))
    overdue_at = calendar_of(setup, server).after(moment(newest, "received_at"), patience)
    return None if at <= overdue_at else (newest, overdue_at.isoformat())
