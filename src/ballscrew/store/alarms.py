"""Alarms of axes and troubles with their measurements as rows."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.reasons import coded_reason
from ballscrew.monitoring.epochs import moment
from ballscrew.store.tables import AlarmAction, AlarmRow, Axis, Trouble

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
    actions: dict[str, list[AlarmAction]] = {}
    for action in session.scalars(select(AlarmAction).order_by(AlarmAction.id)):
        subject = f"alarm-{action.alarm_id}" if action.alarm_id else f"trouble-{action.trouble_id}"
        actions.setdefault(subject, []).append(action)
    found = []
    alarms = select(AlarmRow, Axis.name).join(Axis, Axis.id == AlarmRow.axis_id)
    troubles = select(Trouble, Axis.name).join(Axis, Axis.id == Trouble.axis_id)
    if axis is not None:
        alarms, troubles = alarms.where(Axis.id == axis.id), troubles.where(Axis.id == axis.id)
    for alarm, name in session.execute(alarms):
        common = _text_document(f"alarm-{alarm.id}", name, "axis", "Loss of preload.")
        found.append(common | _state_document(alarm, alarm.retracted_at, "retracted", actions))
    for trouble, name in session.execute(troubles):
        common = _text_document(f"trouble-{trouble.id}", name, trouble.kind, trouble.text)
        found.append(common | _state_document(trouble, trouble.ended_at, "ended", actions, common["id"]))
    return sorted(found, key=lambda each: str(each["raised_at"]), reverse=True)


def standing_alarms(session: Session) -> list[dict[str, Any]]:
    """Alarms and troubles that have not ended and were not closed, the newest first."""
    return [each for each in alarm_documents(session) if each["state"] not in ENDED]


def _text_document(name: str, axis: str, kind: str, text: str) -> dict[str, Any]:
    """What an alarm is about, with the code of its sentence where it has one."""
    reason = coded_reason(text)
    return {"id": name, "axis": axis, "kind": kind, "text": text, "code": reason and reason.code}


def _state_document(
    row: AlarmRow | Trouble,
    ended_at: str | None,
    end: str,
    actions: dict[str, list[AlarmAction]],
    name: str | None = None,
) -> dict[str, Any]:
    """State of an alarm by its end and by what people did."""
    taken = actions.get(name or f"alarm-{row.id}", [])
    state = taken[-1].action if taken else "raised"
    if state == "shelved" and moment(taken[-1].until, "until") <= datetime.now(UTC):
        state = "raised"
    if ended_at is not None:
        state = end
    return {
        "state": state,
        "began_at": row.began_at,
        "raised_at": row.raised_at,
        "ended_at": ended_at,
        "actions": [
            {"action": each.action, "at": each.at, "by": each.actor, "until": each.until, "text": each.text}
            for each in taken
        ],
    }
