"""Log of the messages: what was sent, what waits and why, what failed; and a test message."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import func, or_, select
from sqlalchemy.orm import Session

from ballscrew.base.errors import shown
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.service.access import AdminCaller, RunningService
from ballscrew.service.delivering import send_test
from ballscrew.service.messages import FAILED, QUEUED, SENT, TEST, TEST_MESSAGE
from ballscrew.service.planning import planned_messages
from ballscrew.service.recipients import EmailRecipient
from ballscrew.service.serving import RefusedError, Service
from ballscrew.store.opened import record
from ballscrew.store.service_tables import Delivery, Message
from ballscrew.store.tables import Axis

router = APIRouter(prefix="/api/v1/messages")

_NEWEST = 200  # deliveries that are listed


class NewTestMessage(BaseModel):
    """Who is to receive a test message."""

    model_config = ConfigDict(extra="forbid")
    recipient: str = Field(max_length=320, description="Address, or name of a webhook.")


@router.get("")
def show_messages(caller: AdminCaller, service: RunningService) -> dict[str, Any]:  # noqa: ARG001
    """Recipients, the newest messages with their attempts, and what waits to be reported."""
    return {"schema": SCHEMA, **log_document(service)}


@router.post("/test")
def test_message(new: NewTestMessage, caller: AdminCaller, service: RunningService) -> dict[str, Any]:
    """Send a test message to a recipient; the answer says what happened."""
    for recipient in service.settings.recipients:
        if recipient.label == new.recipient:
            break
    else:
        message = f"there is no recipient {shown(new.recipient)}; GET /api/v1/messages lists them."
        raise RefusedError(404, message)
    with service.computing("a test message"):
        row = send_test(service, recipient, datetime.now(UTC))
    with service.store.write("test message") as session:
        record(session, TEST_MESSAGE, recipient.label, by=caller.name, status=row.status, error=row.error)
    return {"schema": SCHEMA, "recipient": row.recipient, "status": row.status, "error": row.error}


def log_document(service: Service) -> dict[str, Any]:
    """What ``GET /api/v1/messages`` answers, without its schema."""
    recipients = []
    for each in service.settings.recipients:
        kind = "email" if isinstance(each, EmailRecipient) else "webhook"
        rules = each.model_dump(mode="json", include={"level", "machines", "language", "escalation"})
        recipients.append({"recipient": each.label, "by": kind, **rules})
    with service.store.read() as session:
        waiting = _waiting(session, service)
        rows = session.scalars(select(Delivery).order_by(Delivery.id.desc()).limit(_NEWEST)).all()
        about = _about(session, rows)
        messages = [_document(row, about) for row in rows]
        counts = dict.fromkeys((QUEUED, SENT, FAILED), 0) | count_messages(session)
    return {"recipients": recipients, "counts": counts, "waiting": waiting, "messages": messages}


def count_messages(session: Session) -> dict[str, int]:
    """Number of deliveries by their status."""
    found = session.execute(select(Delivery.status, func.count()).group_by(Delivery.status))
    return {status: count for status, count in found}  # noqa: C416  rows are no pairs to mypy


def failing_recipients(session: Session, service: Service) -> dict[str, int]:
    """Recipients that accepted nothing since a message to them was given up, with the number of those."""
    accepted = (
        select(Delivery.recipient, func.max(Delivery.id).label("newest"))
        .where(Delivery.status == SENT)
        .group_by(Delivery.recipient)
        .subquery()
    )
    failed = (
        select(Delivery.recipient, func.count())
        .outerjoin(accepted, accepted.c.recipient == Delivery.recipient)
        .where(Delivery.status == FAILED, Delivery.kind != TEST)
        .where(or_(accepted.c.newest.is_(None), Delivery.id > accepted.c.newest))
        .group_by(Delivery.recipient)
    )
    labels = {recipient.label for recipient in service.settings.recipients}
    return {recipient: count for recipient, count in session.execute(failed) if recipient in labels}


def _waiting(session: Session, service: Service) -> list[dict[str, Any]]:
    """Rows of the outbox that are not reported yet, with the reason."""
    if not service.settings.recipients:
        return []
    reasons = planned_messages(session, service, datetime.now(UTC)).waiting
    rows = session.execute(
        select(Message, Axis.name)
        .join(Axis, Axis.id == Message.axis_id)
        .where(Message.id.in_(reasons))
        .order_by(Message.id.desc())
    )
    found = []
    for row, axis in rows:
        subject = row.detail["subject"]
        waits = {"axis": axis, "alarm": subject, "kind": row.kind, "at": row.at, "reason": reasons[row.id]}
        found.append(waits)
    return found


def _about(session: Session, rows: Any) -> dict[int, str]:
    """Name of the axis of each row of the outbox that deliveries report."""
    numbers = {number for row in rows for number in row.messages or ()}
    found = session.execute(
        select(Message.id, Axis.name).join(Axis, Axis.id == Message.axis_id).where(Message.id.in_(numbers))
    )
    return {number: axis for number, axis in found}  # noqa: C416


def _document(row: Delivery, about: dict[int, str]) -> dict[str, Any]:
    axes = sorted({about[number] for number in row.messages or () if number in about})
    next_at = None
    if row.status == QUEUED:
        next_at = datetime.fromtimestamp(row.not_before, UTC).isoformat(timespec="seconds")
    return {
        "key": row.key,
        "recipient": row.recipient,
        "kind": row.kind,
        "axes": axes,
        "status": row.status,
        "attempts": row.attempts,
        "next_at": next_at,
        "error": row.error,
        "created_at": row.created_at,
        "sent_at": row.sent_at,
    }
