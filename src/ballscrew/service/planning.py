"""Rows of the store as what :mod:`ballscrew.service.messages` plans from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import datetime

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from ballscrew.monitoring.epochs import moment
from ballscrew.service.messages import (
    RAISED,
    MessagePlan,
    Notice,
    Planned,
    SubjectState,
    keys_of,
    plan_deliveries,
)
from ballscrew.service.serving import Service
from ballscrew.store.alarms import alarm_over_at, state_by
from ballscrew.store.rows import batched
from ballscrew.store.service_tables import AlarmAction, Delivery, Message, Trouble
from ballscrew.store.tables import AlarmRow, Assessment, Axis, MachineRow, RunRow, StateRow


def planned_messages(session: Session, service: Service, at: datetime) -> Planned:
    """Deliveries that are due and notices that wait, by the rows of the store."""
    settings = service.settings
    plan = MessagePlan(settings.recipients, settings.messages, settings.calendar.zone)
    axes, subjects = set(), set()
    waiting = select(Message.axis_id, Message.key).where(Message.sent_at.is_(None))
    for axis, key in (*session.execute(waiting), *unclosed_alarms(session)):
        axes.add(axis)
        subjects.add(key.partition("/")[0])
    if not axes:
        return Planned((), (), {})
    every = topics_of(session, axes)
    concerned = {every[subject] for subject in subjects if subject in every}
    topics = {subject: topic for subject, topic in every.items() if topic in concerned}
    notices = _notices(session, axes, topics)
    statuses: dict[str, str] = {}
    for batch in batched(keys_of(plan, notices, at)):
        found = session.execute(select(Delivery.key, Delivery.status).where(Delivery.key.in_(batch)))
        statuses.update((key, status) for key, status in found)
    return plan_deliveries(notices, _states(session, axes, topics, at), statuses, plan, at)


def unclosed_alarms(session: Session) -> Iterator[tuple[int, str]]:
    """Axis and name of each alarm that may stand: not retracted, not closed, without a later normal run.

    Those of years have ended: only these can become urgent or need a reminder.
    """
    newest = select(func.max(AlarmAction.id)).group_by(AlarmAction.alarm_id)
    closed = select(AlarmAction.alarm_id).where(AlarmAction.id.in_(newest), AlarmAction.action == "closed")
    began = (
        select(func.min(RunRow.time))
        .where(RunRow.axis_id == AlarmRow.axis_id, RunRow.measured_at == AlarmRow.began_at)
        .scalar_subquery()
    )
    normal = select(StateRow.run_id).where(
        StateRow.axis_id == AlarmRow.axis_id,
        StateRow.epoch == AlarmRow.epoch,
        StateRow.state == "normal",
        StateRow.time > began,
    )
    found = select(AlarmRow.axis_id, AlarmRow.id).where(
        AlarmRow.retracted_at.is_(None),
        AlarmRow.id.not_in(closed.where(AlarmAction.alarm_id.is_not(None))),
        ~normal.exists(),
    )
    for axis, number in session.execute(found):
        yield axis, f"alarm-{number}"


def topics_of(session: Session, axes: Iterable[int]) -> dict[str, tuple[str, str]]:
    """Topic of each alarm and trouble of axes: the epoch of an alarm, the kind of a trouble."""
    found = {}
    alarms = select(AlarmRow.id, Axis.name, AlarmRow.epoch).join(Axis, Axis.id == AlarmRow.axis_id)
    for number, axis, epoch in session.execute(alarms.where(AlarmRow.axis_id.in_(axes))):
        found[f"alarm-{number}"] = (axis, str(epoch))
    troubles = select(Trouble.id, Axis.name, Trouble.kind).join(Axis, Axis.id == Trouble.axis_id)
    for number, axis, kind in session.execute(troubles.where(Trouble.axis_id.in_(axes))):
        found[f"trouble-{number}"] = (axis, kind)
    return found


def _notices(session: Session, axes: Iterable[int], topics: dict[str, tuple[str, str]]) -> list[Notice]:
    """Rows of the outbox that were not reported, and the last reported one of each alarm and trouble."""
    columns = (Message.id, Message.key, Message.kind, Message.at, Message.sent_at, MachineRow.name)
    rows = (
        select(*columns)
        .join(Axis, Axis.id == Message.axis_id)
        .outerjoin(MachineRow, MachineRow.id == Axis.machine_id)
        .where(Message.axis_id.in_(axes))
        .order_by(Message.id)
    )
    waiting, reported = [], {}
    for number, key, kind, at, sent_at, machine in session.execute(rows):
        subject = key.partition("/")[0]
        if subject not in topics:
            continue
        notice = Notice(
            id=number,
            key=key,
            subject=subject,
            topic=topics[subject],
            is_alarm=subject.startswith("alarm-"),
            machine=machine,
            is_raised=kind == RAISED,
            at=moment(at, "at"),
            reported_at=None if sent_at is None else moment(sent_at, "sent_at"),
        )
        if sent_at is None:
            waiting.append(notice)
        else:
            reported[subject] = notice
    return [*reported.values(), *waiting]


def _states(
    session: Session, axes: Iterable[int], topics: dict[str, tuple[str, str]], at: datetime
) -> dict[str, SubjectState]:
    """State of each alarm and trouble of axes."""
    urgent = select(Axis.id).join(Assessment, Assessment.id == Axis.assessment_id)
    urgent_axes = set(session.scalars(urgent.where(Axis.id.in_(axes), Assessment.urgency == "now")))
    found = {}
    alarms = session.scalars(select(AlarmRow).where(AlarmRow.axis_id.in_(axes))).all()
    troubles = session.scalars(select(Trouble).where(Trouble.axis_id.in_(axes))).all()
    actions = select(AlarmAction).order_by(AlarmAction.id)
    of_alarms = actions.where(AlarmAction.alarm_id.in_([row.id for row in alarms]))
    last = {action.alarm_id: action for action in session.scalars(of_alarms)}
    for alarm in alarms:
        name = f"alarm-{alarm.id}"
        if name in topics:
            ended_at = alarm.retracted_at or alarm_over_at(session, alarm)
            state = _state(last.get(alarm.id), ended_at, at)
            found[name] = SubjectState(topics[name], *state, alarm.axis_id in urgent_axes)
    of_troubles = actions.where(AlarmAction.trouble_id.in_([row.id for row in troubles]))
    last = {action.trouble_id: action for action in session.scalars(of_troubles)}
    for trouble in troubles:
        name = f"trouble-{trouble.id}"
        if name in topics:
            state = _state(last.get(trouble.id), trouble.ended_at, at)
            found[name] = SubjectState(topics[name], *state, False)
    return found


def _state(action: AlarmAction | None, ended_at: str | None, at: datetime) -> tuple[str, datetime | None]:
    """State by the end and by what somebody did last, and when that was."""
    acted_at = None if action is None else moment(action.at, "at")
    return state_by(action, None if ended_at is None else "ended", at), acted_at
