"""Alarms of axes and troubles with their measurements as rows."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import ColumnElement, false, or_, select, true
from sqlalchemy.orm import Session

from ballscrew.base.reasons import coded_reason
from ballscrew.monitoring.epochs import moment
from ballscrew.store.findings import split_finding
from ballscrew.store.service_tables import AlarmAction, Trouble
from ballscrew.store.tables import AlarmRow, Axis, RunRow, StateRow

ENDED = ("ended", "retracted", "closed")
"""States of an alarm or a trouble that does not stand."""


def alarm_documents(session: Session, axis: Axis | None = None) -> list[dict[str, Any]]:
    """Alarms and troubles with their states, the newest first.

    Parameters
    ----------
    session : Session
        Reading.
    axis : Axis, optional
        Of this axis; by default of all.

    Returns
    -------
    list of dict
        As ``GET /api/v1/alarms`` answers.
    """
    if axis is None:
        return _documents(session, true(), true())
    return _documents(session, AlarmRow.axis_id == axis.id, Trouble.axis_id == axis.id)


def standing_alarms(session: Session) -> list[dict[str, Any]]:
    """Alarms and troubles that have not ended and were not closed, the newest first."""
    found = _documents(session, AlarmRow.retracted_at.is_(None), Trouble.ended_at.is_(None))
    return [each for each in found if each["state"] not in ENDED]


def alarm_document(session: Session, row: AlarmRow | Trouble) -> dict[str, Any]:
    """An alarm or a trouble with its state, as :func:`alarm_documents` has it."""
    if isinstance(row, AlarmRow):
        return _documents(session, AlarmRow.id == row.id, false())[0]
    return _documents(session, false(), Trouble.id == row.id)[0]


def alarm_over_at(session: Session, alarm: AlarmRow) -> str | None:
    """Time of the run by which an alarm is over: the first later one of its epoch that is normal.

    The state of a run after an alarm is normal only after several calm runs; a worn nut has none.
    """
    begun = moment(alarm.began_at, "began_at").timestamp()
    later = select(RunRow.measured_at).join(StateRow, StateRow.run_id == RunRow.id)
    later = later.where(StateRow.axis_id == alarm.axis_id, StateRow.epoch == alarm.epoch)
    later = later.where(StateRow.time > begun, StateRow.state == "normal").order_by(StateRow.time)
    return session.scalar(later.limit(1))


def state_by(action: AlarmAction | None, end: str | None, at: datetime) -> str:
    """State of an alarm or a trouble.

    Parameters
    ----------
    action : AlarmAction or None
        What somebody did last.
    end : str or None
        State by itself, if it does not stand: ended or retracted.
    at : datetime
        The present time.

    Returns
    -------
    str
        raised, acknowledged, shelved, closed, ended or retracted: what was closed stays closed.
    """
    state = "raised" if action is None else action.action
    if state == "closed":
        return state
    if end is not None:
        return end
    if action is not None and state == "shelved" and moment(action.until, "until") <= at:
        return "raised"
    return state


def to_close(standing: Sequence[dict[str, Any]], state: str) -> list[str]:
    """Sentence on each alarm that stands on an axis whose state asks for nothing.

    It is of an epoch before: whether the repair was right is what a person has to state.

    Parameters
    ----------
    standing : sequence of dict
        Alarms and troubles of the axis that stand.
    state : str
        State of the axis now.
    """
    if state not in ("normal", "learning", "suspect"):
        return []
    return [
        f"Close the alarm of {alarm['began_at'][:10]} with what was found: it still stands."
        for alarm in standing
        if alarm["kind"] == "axis"
    ]


def _documents(
    session: Session, of_alarms: ColumnElement[bool], of_troubles: ColumnElement[bool]
) -> list[dict[str, Any]]:
    """Alarms and troubles that fulfil conditions, and no others: a store has thousands that have ended."""
    alarms = select(AlarmRow, Axis.name).join(Axis, Axis.id == AlarmRow.axis_id).where(of_alarms)
    troubles = select(Trouble, Axis.name).join(Axis, Axis.id == Trouble.axis_id).where(of_troubles)
    taken = or_(
        AlarmAction.alarm_id.in_(select(AlarmRow.id).where(of_alarms)),
        AlarmAction.trouble_id.in_(select(Trouble.id).where(of_troubles)),
    )
    actions: dict[str, list[AlarmAction]] = {}
    for action in session.scalars(select(AlarmAction).where(taken).order_by(AlarmAction.id)):
        subject = f"alarm-{action.alarm_id}" if action.alarm_id else f"trouble-{action.trouble_id}"
        actions.setdefault(subject, []).append(action)
    found = []
    for alarm, name in session.execute(alarms):
        document = _text_document(f"alarm-{alarm.id}", name, "axis", "Loss of stiffness.")
        acts = actions.get(document["id"], [])
        ended_at, end = alarm.retracted_at, "retracted"
        if ended_at is None:
            ended_at, end = alarm_over_at(session, alarm), "ended"
        found.append(document | _state_document(alarm, ended_at, end, acts))
    for trouble, name in session.execute(troubles):
        document = _text_document(f"trouble-{trouble.id}", name, trouble.kind, trouble.text)
        acts = actions.get(document["id"], [])
        found.append(document | _state_document(trouble, trouble.ended_at, "ended", acts))
    return sorted(found, key=lambda each: str(each["raised_at"]), reverse=True)


def _text_document(name: str, axis: str, kind: str, text: str) -> dict[str, Any]:
    """What an alarm is about, with the code of its sentence where it has one."""
    reason = coded_reason(text)
    return {"id": name, "axis": axis, "kind": kind, "text": text, "code": reason and reason.code}


def _state_document(
    row: AlarmRow | Trouble, ended_at: str | None, end: str, taken: Sequence[AlarmAction]
) -> dict[str, Any]:
    """State of an alarm by its end and by what people did."""
    last = taken[-1] if taken else None
    return {
        "state": state_by(last, None if ended_at is None else end, datetime.now(UTC)),
        "began_at": row.began_at,
        "raised_at": row.raised_at,
        "ended_at": ended_at,
        "actions": [_action_document(each) for each in taken],
    }


def _action_document(row: AlarmAction) -> dict[str, Any]:
    finding, cause = split_finding(row.finding)
    return {
        "action": row.action,
        "at": row.at,
        "by": row.actor,
        "until": row.until,
        "text": row.text,
        "finding": finding,
        "cause": cause,
        "event": row.event,
    }
