"""Deliveries: planned from the outbox, composed, and sent by one thread, at least once each.

An attempt is counted before it is made, and a delivery is marked as sent only after its recipient has
accepted it: after a crash in between it is sent again, with the same key.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import Any
from urllib.parse import quote

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import BallscrewError, printable
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.reasons import coded
from ballscrew.monitoring.epochs import moment
from ballscrew.report.what_to_do import action_on
from ballscrew.service.mail import send_mail
from ballscrew.service.messages import (
    DIGEST,
    DROPPED,
    ENDED,
    FAILED,
    QUEUED,
    RAISED,
    RETRACTED,
    SENT,
    TEST,
    Planned,
    delivery_key,
)
from ballscrew.service.pages.rendering import environment_of
from ballscrew.service.planning import planned_messages, topics_of
from ballscrew.service.recipients import EmailRecipient, Recipient, WebhookRecipient
from ballscrew.service.serving import Service
from ballscrew.service.webhooks import post_webhook
from ballscrew.store.explaining import find_explanation
from ballscrew.store.lamps import add_lamps
from ballscrew.store.reading import assessment_document, newest_runs
from ballscrew.store.rows import batched
from ballscrew.store.service_tables import Delivery, Message
from ballscrew.store.tables import Assessment, Axis, MachineRow, StateRow

_log = logging.getLogger("ballscrew.service")

_PERIOD = 30.0  # s between plans without a change
_LONGEST_PAUSE = 3600.0  # s between attempts
_LONGEST_NAME = 60  # characters of an axis in the subject of a message


@dataclass(frozen=True, slots=True)
class Content:
    """What a message says.

    Parameters
    ----------
    subject, text : str
        In the language of the recipient.
    items : tuple of dict
        What it reports, as a webhook receives it.
    """

    subject: str
    text: str
    items: tuple[dict[str, Any], ...]


@dataclass(frozen=True, slots=True)
class _Reserved:
    """A delivery of which an attempt is made."""

    key: str
    kind: str
    messages: tuple[int, ...]
    recipient: Recipient
    created_at: datetime


def plan_messages(service: Service, at: datetime) -> Planned:
    """Add the deliveries that are due to the store.

    Parameters
    ----------
    service : Service
        The service.
    at : datetime
        The present time.

    Returns
    -------
    Planned
        What was planned, and why the rest waits.
    """
    if not service.settings.recipients:
        return Planned((), (), {})
    with service.store.read() as session:
        planned = planned_messages(session, service, at)
    if not planned.deliveries and not planned.reported:
        return planned
    text = at.astimezone(UTC).isoformat(timespec="milliseconds")
    with service.store.write("messages") as session:
        planned = planned_messages(session, service, at)
        for each in planned.deliveries:
            session.add(
                Delivery(
                    key=each.key, recipient=each.recipient, kind=each.kind, messages=list(each.notices),
                    status=QUEUED, attempts=0, not_before=at.timestamp(), created_at=text,
                )
            )  # fmt: skip
        for batch in batched(planned.reported):
            for row in session.scalars(select(Message).where(Message.id.in_(batch))):
                row.sent_at = text
    return planned


def compose(
    session: Session, service: Service, kind: str, numbers: Sequence[int], language: str, at: datetime
) -> Content:
    """Content of a message by the present state of its axes.

    Parameters
    ----------
    session : Session
        Reading.
    service : Service
        Its settings state the address of the pages.
    kind : str
        Of the delivery.
    numbers : sequence of int
        Rows of the outbox that it reports.
    language : str
        ``en`` or ``de``.
    at : datetime
        The present time.

    Returns
    -------
    Content
        Names of axes and machines without control characters.
    """
    rows = session.scalars(select(Message).where(Message.id.in_(numbers)).order_by(Message.id)).all()
    topics = topics_of(session, {row.axis_id for row in rows})
    gathered: dict[tuple[str, str], list[Message]] = {}
    for row in rows:
        gathered.setdefault(topics[str(row.detail["subject"])], []).append(row)
    items = [_item(session, kind, each) for each in gathered.values()]
    add_lamps(session, items, at, service.settings.calendar)
    for item in items:
        if item["kind"] != "axis":
            item["to_do"] = [coded(action_on(item["kind"]))]
        _name(item, service)
    text = environment_of(language).get_template("message.txt")
    link, simulated = _address(service), service.store.folder.is_simulated()
    subject, _, body = (
        text.render(kind=kind, items=items, link=link, simulated=simulated).strip().partition("\n")
    )
    return Content(subject, body.strip() + "\n", tuple(items))


def _item(session: Session, kind: str, rows: Sequence[Message]) -> dict[str, Any]:
    """What a message reports of a topic, with the newest assessment of its axis and what to do."""
    newest = rows[-1]
    has_ended = kind in (RETRACTED, ENDED) or (kind == DIGEST and newest.kind != RAISED)
    repeats = sum(row.kind == RAISED for row in rows)
    axis = session.get_one(Axis, newest.axis_id)
    machine = session.scalar(select(MachineRow).where(MachineRow.id == axis.machine_id))
    assessment = session.scalar(select(Assessment).where(Assessment.id == axis.assessment_id))
    explanation = find_explanation(session, axis) or {}
    return {
        "axis": axis.name,
        "machine": getattr(machine, "name", ""),
        "site": getattr(machine, "site", ""),
        "alarm": newest.detail["subject"],
        "kind": newest.detail.get("kind", "axis"),
        "text": printable(str(newest.detail.get("text", ""))),
        "ended": has_ended,
        "retracted": newest.kind == RETRACTED,
        "repeats": repeats if has_ended else max(0, repeats - 1),
        "began_at": newest.detail.get("began_at"),
        "at": newest.at,
        "nut": _nut(session, axis),
        "preload_below": (explanation.get("state") or {}).get("preload_below"),
        **assessment_document(assessment, axis.changed_at, newest_runs(session, axis).get(axis.id)),
    }


def _name(item: dict[str, Any], service: Service) -> None:
    """Add the link of an item, and replace what would end a line in its names."""
    item["link"] = f"{_address(service)}/axes/{quote(item['axis'], safe='')}"
    for name in ("axis", "machine", "site"):
        item[name] = printable(item[name])
    item["short"] = item["axis"][:_LONGEST_NAME]


def _address(service: Service) -> str:
    return (service.settings.public_url or "").rstrip("/")


def _nut(session: Session, axis: Axis) -> list[float] | None:
    """P/P₀ of the nut by the newest run that was assessed, with its interval."""
    of_axis = select(StateRow).where(StateRow.axis_id == axis.id, StateRow.level.is_not(None))
    row = session.scalar(of_axis.order_by(StateRow.time.desc(), StateRow.run_id.desc()).limit(1))
    if row is None or row.nut is None or row.nut_low is None or row.nut_high is None:
        return None
    return [row.nut, row.nut_low, row.nut_high]


def send_messages(service: Service, clock: Callable[[], datetime]) -> int:
    """Send the deliveries that are due: to each recipient its oldest, until none is due.

    Parameters
    ----------
    service : Service
        The service.
    clock : callable
        The present time: an attempt may take long.

    Returns
    -------
    int
        Number of attempts.
    """
    attempts, at = 0, clock()
    while not service.stopping.is_set():
        with service.store.read() as session:
            due = _due(session, at)
        if not due:
            break
        for number in due:
            attempt(service, number, clock())
        attempts += len(due)
    return attempts


def _due(session: Session, at: datetime) -> list[int]:
    """The oldest delivery of each recipient that is due and follows no earlier one about the same axis."""
    rows = session.scalars(select(Delivery).where(Delivery.status == QUEUED).order_by(Delivery.id)).all()
    axes = _axes(session, rows)
    due: dict[str, int] = {}
    waiting: set[tuple[str, int]] = set()
    for row in rows:
        concerned = {(row.recipient, axis) for axis in axes[row.id]}
        pause = row.not_before - at.timestamp()
        has_paused = pause <= 0 or pause > _LONGEST_PAUSE  # longer: the clock was set back
        if has_paused and concerned.isdisjoint(waiting):
            due.setdefault(row.recipient, row.id)
        waiting |= concerned
    return list(due.values())


def _axes(session: Session, rows: Sequence[Delivery]) -> dict[int, set[int]]:
    """Axes that each delivery is about."""
    numbers = {number for row in rows for number in row.messages or ()}
    found = session.execute(select(Message.id, Message.axis_id).where(Message.id.in_(numbers)))
    by_message = {number: axis for number, axis in found}  # noqa: C416  rows are no pairs to mypy
    return {row.id: {by_message[number] for number in row.messages or ()} for row in rows}


def attempt(service: Service, number: int, at: datetime) -> None:
    """Try once to send a delivery.

    Parameters
    ----------
    service : Service
        The service.
    number : int
        Of its row.
    at : datetime
        The present time.
    """
    reserved = _reserve(service, number, at)
    if reserved is None:
        return
    reason = ""
    try:
        with service.store.read() as session:
            content = compose(
                session, service, reserved.kind, reserved.messages, reserved.recipient.language, at
            )
        _send(service, reserved, content, at)
    except BallscrewError as error:
        reason = str(error)
    except Exception as error:  # noqa: BLE001  of whatever kind, the others are not stopped
        _log.exception("message to %s", reserved.recipient.label)
        reason = f"unexpected error ({type(error).__name__})."
    _finish(service, number, reason, at)


def _reserve(service: Service, number: int, at: datetime) -> _Reserved | None:
    """Count an attempt before it is made; None if there is none to make."""
    rules = service.settings.messages
    labels = {recipient.label: recipient for recipient in service.settings.recipients}
    with service.store.write("messages") as session:
        row = session.get_one(Delivery, number)
        recipient = labels.get(row.recipient)
        if recipient is None:
            row.status, row.error = DROPPED, "it is no longer a recipient."
            return None
        if row.attempts >= rules.attempts:
            row.status, row.error = FAILED, row.error or "the server ended during the last attempt."
            return None
        row.attempts += 1
        pause = min(_LONGEST_PAUSE, rules.back_off_s * 2.0 ** min(row.attempts - 1, 20))
        row.not_before = at.timestamp() + pause
        created_at = moment(row.created_at, "created_at")
        return _Reserved(row.key, row.kind, tuple(row.messages or ()), recipient, created_at)


def _send(service: Service, reserved: _Reserved, content: Content, at: datetime) -> None:
    """Send a message; it was accepted when this returns."""
    settings, limit, recipient = service.settings, service.settings.messages.timeout_s, reserved.recipient
    if isinstance(recipient, EmailRecipient):
        assert settings.smtp is not None  # noqa: S101  problems() reports it
        mail = (content.subject, content.text, reserved.key, reserved.created_at, limit)
        send_mail(settings.smtp, recipient.to, *mail)
    elif isinstance(recipient, WebhookRecipient):
        document = {
            "schema": SCHEMA,
            "key": reserved.key,
            "kind": reserved.kind,
            "at": reserved.created_at.isoformat(),
            "subject": content.subject,
            "text": content.text,
            "items": content.items,
        }
        post_webhook(recipient, json.dumps(document, allow_nan=False).encode(), reserved.key, at, limit)


def _finish(service: Service, number: int, reason: str, at: datetime) -> None:
    """Mark a delivery as sent, or as failed after its last attempt; others to the recipient wait a little."""
    rules = service.settings.messages
    with service.store.write("messages") as session:
        row = session.get_one(Delivery, number)
        if not reason:
            row.status, row.error = SENT, None
            row.sent_at = at.astimezone(UTC).isoformat(timespec="milliseconds")
            return
        row.error = reason
        _log.warning("message to %s, attempt %d: %s", row.recipient, row.attempts, reason)
        if row.attempts >= rules.attempts or row.kind == TEST:
            row.status = FAILED
        others = select(Delivery).where(Delivery.status == QUEUED, Delivery.recipient == row.recipient)
        for other in session.scalars(others):
            other.not_before = max(other.not_before, at.timestamp() + min(_LONGEST_PAUSE, rules.back_off_s))


def send_test(service: Service, recipient: Recipient, at: datetime) -> Delivery:
    """Send a test message at once; its row says what happened.

    Parameters
    ----------
    service : Service
        The service.
    recipient : Recipient
        Who receives it.
    at : datetime
        The present time.

    Returns
    -------
    Delivery
        Sent or failed.
    """
    text = at.astimezone(UTC).isoformat(timespec="milliseconds")
    with service.store.write("messages") as session:
        row = Delivery(
            key=delivery_key(recipient.label, TEST, text), recipient=recipient.label, kind=TEST, messages=[],
            status=QUEUED, attempts=0, not_before=at.timestamp() + _LONGEST_PAUSE,
            created_at=text,
        )  # fmt: skip
        session.add(row)
        session.flush()
        number = row.id
    attempt(service, number, at)
    with service.store.read() as session:
        found = session.get_one(Delivery, number)
        session.expunge(found)
    return found


def run_messages(service: Service) -> None:
    """Plan and send until the service stops: after each change, and regularly."""
    while not service.stopping.is_set():
        with service.work:
            known = service.changes
        try:
            plan_messages(service, datetime.now(UTC))
            send_messages(service, partial(datetime.now, UTC))
        except Exception:  # noqa: BLE001  it goes on, whatever it is
            _log.exception("messages")
        with service.work:
            if service.changes == known and not service.stopping.is_set():
                service.work.wait(_PERIOD)
