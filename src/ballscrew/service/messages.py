"""Which messages are due: a function of the outbox, the states of the alarms, the rules and the time.

The outbox has a row for each change of an alarm. Rows of one *topic*, the alarm of an axis in an epoch or a
kind of trouble of an axis, are reported together: what counts is whether the recipients know that it stands,
and whether it does. Rows that change neither wait, and are counted in the next message of the topic.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, tzinfo

from ballscrew.base.provenance import digest
from ballscrew.service.recipients import MessageRules, Recipient

RAISED, URGENT, ESCALATION = "raised", "urgent", "escalation"
RETRACTED, ENDED, DIGEST, TEST = "retracted", "ended", "digest", "test"
QUEUED, SENT, FAILED, DROPPED = "queued", "sent", "failed", "dropped"
TEST_MESSAGE = "test message"  # action of the audit, whose subject is a recipient

_STANDING = (RAISED, URGENT, ESCALATION)  # kinds of messages that an alarm stands
_KEY = 40  # characters
_REPEATED, _SHELVED, _QUIET, _HOLD, _LATER = (
    "it came back: noted in the next message", "shelved", "quiet hours", "hold time", "the next digest",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Notice:
    """A row of the outbox: an alarm or a trouble was raised, or is gone.

    Parameters
    ----------
    id, key : int, str
        Number and key of the row.
    subject : str
        The alarm, ``alarm-1`` or ``trouble-1``.
    topic : tuple of (str, str)
        Axis, and the epoch of its alarm or the kind of its trouble.
    is_alarm : bool
        Whether it is an alarm.
    machine : str or None
        Machine of the axis.
    is_raised : bool
        Whether it was raised.
    at : datetime
        When.
    reported_at : datetime or None
        When deliveries of it were made, or it was found that none is needed.
    """

    id: int
    key: str
    subject: str
    topic: tuple[str, str]
    is_alarm: bool
    machine: str | None
    is_raised: bool
    at: datetime
    reported_at: datetime | None = None


@dataclass(frozen=True, slots=True)
class SubjectState:
    """State of an alarm or a trouble.

    Parameters
    ----------
    topic : tuple of (str, str)
        As of its notices.
    state : str
        raised, acknowledged, shelved, closed or ended.
    acted_at : datetime or None
        When somebody acted on it last.
    is_urgent : bool
        Whether it asks for action at once.
    """

    topic: tuple[str, str]
    state: str
    acted_at: datetime | None = None
    is_urgent: bool = False


@dataclass(frozen=True, slots=True)
class NewDelivery:
    """A message to one recipient.

    Parameters
    ----------
    key : str
        Follows from recipient, kind and notices: what is planned twice is one delivery.
    recipient : str
        Label of the recipient.
    kind : str
        raised, urgent, escalation, retracted, ended or digest.
    notices : tuple of int
        Rows that it reports.
    """

    key: str
    recipient: str
    kind: str
    notices: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Planned:
    """Result of :func:`plan_deliveries`.

    Parameters
    ----------
    deliveries : tuple of NewDelivery
        To be sent.
    reported : tuple of int
        Notices that are reported by them, or of which nobody needs to know.
    waiting : dict of int to str
        Why the others wait.
    """

    deliveries: tuple[NewDelivery, ...]
    reported: tuple[int, ...]
    waiting: dict[int, str]


@dataclass(frozen=True, slots=True)
class MessagePlan:
    """Recipients and rules.

    Parameters
    ----------
    recipients : sequence of Recipient
        Everyone.
    rules : MessageRules
        When messages are due.
    zone : tzinfo
        Time zone of quiet hours and digest.
    """

    recipients: Sequence[Recipient]
    rules: MessageRules
    zone: tzinfo


@dataclass(frozen=True, slots=True)
class _Topic:
    """Notices of a topic that wait, the last reported one of each of its alarms, and their states."""

    waiting: tuple[Notice, ...]
    reports: tuple[Notice, ...]
    states: Mapping[str, SubjectState]

    @property
    def reported(self) -> Notice | None:
        """The last notice that was reported."""
        return (None, *self.reports)[-1]

    @property
    def newest(self) -> Notice:
        """The last notice, whether or not it was reported."""
        return (*self.reports, *self.waiting)[-1]

    @property
    def standing(self) -> list[SubjectState]:
        return [each for each in self.states.values() if each.state not in ("closed", "ended")]

    @property
    def is_known(self) -> bool:
        """Whether recipients know that it stands; what was closed by somebody begins anew."""
        raised = [notice for notice in (*self.reports, *self.waiting) if notice.is_raised]
        if raised and self._is_closed_since(raised[-1]):
            return False
        for notice in self.reports:
            state = self.states.get(notice.subject)
            if notice.is_raised and (state is None or state.state != "closed"):
                return True
        return False

    def _is_closed_since(self, notice: Notice) -> bool:
        """Whether somebody closed an alarm, and nothing was reported of it since."""
        state = self.states.get(notice.subject)
        if state is None or state.state != "closed":
            return False
        return notice.reported_at is None or state.acted_at is None or notice.reported_at < state.acted_at

    @property
    def is_shelved(self) -> bool:
        return all(each.state == "shelved" for each in self.standing)

    @property
    def is_urgent(self) -> bool:
        return any(each.is_urgent for each in self.standing)

    @property
    def ids(self) -> tuple[int, ...]:
        return tuple(notice.id for notice in self.waiting)


def delivery_key(recipient: str, kind: str, about: str) -> str:
    """Key of the delivery to a recipient about something."""
    return digest([recipient, kind, about])[:_KEY]


def keys_of(plan: MessagePlan, notices: Sequence[Notice], at: datetime) -> list[str]:
    """Keys of the deliveries on whose statuses :func:`plan_deliveries` depends."""
    found = []
    reported = [topic.reported for topic in _topics(notices, {}) if topic.reported is not None]
    for recipient in plan.recipients:
        found.append(_digest_key(plan, recipient, at))
        for notice in reported:
            found += [delivery_key(recipient.label, kind, _about(notice)) for kind in _STANDING]
    return found


def plan_deliveries(
    notices: Sequence[Notice],
    states: Mapping[str, SubjectState],
    statuses: Mapping[str, str],
    plan: MessagePlan,
    at: datetime,
) -> Planned:
    """Deliveries that are due.

    Parameters
    ----------
    notices : sequence of Notice
        Those that were not reported, and the last reported one of each alarm and trouble.
    states : mapping of str to SubjectState
        By subject: those of the notices, and all that stand of their topics.
    statuses : mapping of str to str
        Status of each delivery there is, of those that :func:`keys_of` lists.
    plan : MessagePlan
        Recipients and rules.
    at : datetime
        The present time.

    Returns
    -------
    Planned
        Deliveries, and what becomes of the notices.
    """
    deliveries: list[NewDelivery] = []
    reported: list[int] = []
    waiting: dict[int, str] = {}
    gathered: list[_Topic] = []
    for topic in _topics(notices, states):
        deliveries += _reminders(topic, statuses, plan, at)
        if not topic.waiting:
            continue
        reason = _why_waiting(topic, statuses, plan, at)
        if reason is not None:
            waiting |= dict.fromkeys(topic.ids, reason)
            continue
        reported += topic.ids
        if topic.is_known == bool(topic.standing):
            continue  # it came and went: nobody needs to know
        if not topic.newest.is_alarm and plan.rules.digest_hour >= 0:
            gathered.append(topic)
        else:
            deliveries += _reports(topic, statuses, plan)
    deliveries += _digests(gathered, plan, at)
    return Planned(tuple(deliveries), tuple(reported), waiting)


def _topics(notices: Sequence[Notice], states: Mapping[str, SubjectState]) -> list[_Topic]:
    found: dict[tuple[str, str], list[Notice]] = {}
    for notice in sorted(notices, key=lambda each: each.id):
        found.setdefault(notice.topic, []).append(notice)
    own: dict[tuple[str, str], dict[str, SubjectState]] = {}
    for subject, state in states.items():
        own.setdefault(state.topic, {})[subject] = state
    topics = []
    for name, rows in found.items():
        reports = tuple(row for row in rows if row.reported_at is not None)
        waiting = tuple(row for row in rows if row.reported_at is None)
        topics.append(_Topic(waiting, reports, own.get(name, {})))
    return topics


def _why_waiting(topic: _Topic, statuses: Mapping[str, str], plan: MessagePlan, at: datetime) -> str | None:
    """Why the notices of a topic are not reported now; None if they are, or need not be."""
    stands, rules = bool(topic.standing), plan.rules
    if topic.is_known == stands:
        return _REPEATED if stands else None
    if stands and topic.is_shelved:
        return _SHELVED
    if not stands and at < topic.newest.at + timedelta(hours=rules.hold_h):
        return _HOLD
    if _is_quiet(topic, plan, at):
        return _QUIET
    return _LATER if _is_too_early(topic, statuses, plan, at) else None


def _is_too_early(topic: _Topic, statuses: Mapping[str, str], plan: MessagePlan, at: datetime) -> bool:
    """Whether a trouble waits for the next digest: it is newer than the last one, or that was sent."""
    last = plan.rules.last_digest(at, plan.zone)
    if last is None or topic.newest.is_alarm:
        return False
    due = topic.waiting[0].at
    if not topic.standing:
        due = topic.newest.at + timedelta(hours=plan.rules.hold_h)
    is_done = any(_digest_key(plan, recipient, at) in statuses for recipient in plan.recipients)
    return is_done or due >= last


def _reports(topic: _Topic, statuses: Mapping[str, str], plan: MessagePlan) -> list[NewDelivery]:
    """Deliveries that a topic stands, or to those who know of it that it is gone."""
    newest = topic.newest
    if not topic.standing:
        kind = RETRACTED if newest.is_alarm else ENDED
        informed = _informed(topic, statuses, plan)
        return [_delivery(each, kind, newest, topic.ids) for each in informed]
    kind = URGENT if topic.is_urgent else RAISED
    return [_delivery(each, kind, newest, topic.ids) for each in _addressed(topic, plan)]


def _informed(topic: _Topic, statuses: Mapping[str, str], plan: MessagePlan) -> list[Recipient]:
    """Recipients to whom a topic was reported, or is being reported."""
    if not topic.newest.is_alarm:
        return _addressed(topic, plan)
    assert topic.reported is not None  # noqa: S101  it is known
    found = []
    for recipient in plan.recipients:
        for kind in _STANDING:
            status = statuses.get(delivery_key(recipient.label, kind, _about(topic.reported)))
            if status in (QUEUED, SENT) and recipient not in found:
                found.append(recipient)
    return found


def _reminders(
    topic: _Topic, statuses: Mapping[str, str], plan: MessagePlan, at: datetime
) -> list[NewDelivery]:
    """Deliveries about an alarm that became urgent, or that nobody acknowledged, after its report."""
    reported = topic.reported
    if reported is None or not _may_remind(topic) or _is_quiet(topic, plan, at):
        return []
    found = []
    if topic.is_urgent:
        found += [(each, URGENT) for each in _addressed(topic, plan)]
    if _is_unacknowledged(topic, plan, at):
        found += [(each, ESCALATION) for each in _addressed(topic, plan, escalation=True)]
    deliveries = []
    for recipient, kind in found:
        delivery = _delivery(recipient, kind, reported, (reported.id, *topic.ids))
        if delivery.key not in statuses:
            deliveries.append(delivery)
    return deliveries


def _may_remind(topic: _Topic) -> bool:
    """Whether it is an alarm that recipients know of, and that is not shelved as a whole."""
    return topic.newest.is_alarm and topic.is_known and not topic.is_shelved


def _is_quiet(topic: _Topic, plan: MessagePlan, at: datetime) -> bool:
    return plan.rules.is_quiet(at, plan.zone) and not topic.is_urgent


def _is_unacknowledged(topic: _Topic, plan: MessagePlan, at: datetime) -> bool:
    """Whether nobody has acted on an alarm for so long after its report that it is escalated."""
    assert topic.reported is not None  # noqa: S101
    since = topic.reported.reported_at or topic.reported.at
    for each in topic.standing:
        if each.state != "raised":
            return False
        since = max(since, each.acted_at or since)
    return at >= since + timedelta(hours=plan.rules.escalation_h)


def _digests(topics: Sequence[_Topic], plan: MessagePlan, at: datetime) -> list[NewDelivery]:
    """One delivery to each recipient about all troubles that concern it."""
    found = []
    for recipient in plan.recipients:
        ids: list[int] = []
        for topic in topics:
            if recipient in _addressed(topic, plan):
                ids += topic.ids
        if ids:
            key = _digest_key(plan, recipient, at)
            found.append(NewDelivery(key, recipient.label, DIGEST, tuple(ids)))
    return found


def _addressed(topic: _Topic, plan: MessagePlan, *, escalation: bool = False) -> list[Recipient]:
    """Recipients of a topic by its machine and their level."""
    found = []
    newest = topic.newest
    for recipient in plan.recipients:
        is_meant = not recipient.machines or newest.machine in recipient.machines
        is_meant = is_meant and (newest.is_alarm or recipient.level == "trouble")
        if is_meant and recipient.escalation == escalation:
            found.append(recipient)
    return found


def _delivery(recipient: Recipient, kind: str, notice: Notice, ids: tuple[int, ...]) -> NewDelivery:
    return NewDelivery(delivery_key(recipient.label, kind, _about(notice)), recipient.label, kind, ids)


def _about(notice: Notice) -> str:
    """A notice, also among those of other stores."""
    return f"{notice.topic[0]} {notice.key} {notice.at.isoformat()}"


def _digest_key(plan: MessagePlan, recipient: Recipient, at: datetime) -> str:
    last = plan.rules.last_digest(at, plan.zone)
    return delivery_key(recipient.label, DIGEST, "" if last is None else last.isoformat())
