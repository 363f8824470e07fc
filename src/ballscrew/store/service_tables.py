"""Tables of the service: what was sent, jobs, people and tokens, alarms that people handle, messages."""

from __future__ import annotations

from typing import Any

from sqlalchemy import (
    JSON,
    ForeignKey,
    UniqueConstraint,
)
from sqlalchemy.orm import Mapped, mapped_column

from ballscrew.store import tables  # noqa: F401  to which these refer
from ballscrew.store.rows import Base, Checked


class Setup(Checked, Base):
    """Documents of an axis for the recordings that are sent to the service, and when runs are expected.

    ``sheet``, ``plan`` and ``channels`` are digests of documents; a run is expected every ``period_s`` by
    ``calendar``, which has the values that are not those of the server.
    """

    __tablename__ = "setups"
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"), primary_key=True)
    sheet: Mapped[str | None] = mapped_column(ForeignKey("documents.digest"))
    plan: Mapped[str | None] = mapped_column(ForeignKey("documents.digest"))
    channels: Mapped[str | None] = mapped_column(ForeignKey("documents.digest"))
    period_s: Mapped[float | None]
    grace_s: Mapped[float | None]
    calendar: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))
    set_up_at: Mapped[str]


class Upload(Checked, Base):
    """A run that was sent to the service, and what became of it.

    ``key`` is the sender's, ``sent`` the digest of what was sent, ``content`` that of what is analysed, as in
    ``sources``. The status is queued, done, refused, set aside or conflict.
    """

    __tablename__ = "uploads"
    __table_args__ = (UniqueConstraint("axis_id", "key", "sent"),)
    id: Mapped[int] = mapped_column(primary_key=True)
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"))
    key: Mapped[str]
    sent: Mapped[str]
    content: Mapped[str] = mapped_column(index=True)
    status: Mapped[str]
    stated: Mapped[dict[str, Any]]
    files: Mapped[list[Any] | None]
    run: Mapped[str | None] = mapped_column(index=True)
    verdict: Mapped[str | None]
    error: Mapped[str | None]
    sender: Mapped[str]
    received_at: Mapped[str]
    finished_at: Mapped[str | None]


class JobRow(Checked, Base):
    """Work of the service: not before a time, and leased to a worker until another; seconds since 1970."""

    __tablename__ = "jobs"
    __table_args__ = (UniqueConstraint("kind", "argument"),)
    id: Mapped[int] = mapped_column(primary_key=True)
    kind: Mapped[str]
    argument: Mapped[str]
    priority: Mapped[int]
    not_before: Mapped[float]
    lease_until: Mapped[float | None]
    lease: Mapped[str | None]
    attempts: Mapped[int]
    set_aside: Mapped[bool]
    error: Mapped[str | None]
    created_at: Mapped[str]


class Token(Checked, Base):
    """A token of the service, by its hash: of one machine, or with a role (viewer, maintainer, admin)."""

    __tablename__ = "tokens"
    id: Mapped[int] = mapped_column(primary_key=True)
    digest: Mapped[str] = mapped_column(unique=True)
    machine_id: Mapped[int | None] = mapped_column(ForeignKey("machines.id"))
    created_at: Mapped[str]
    revoked_at: Mapped[str | None]
    role: Mapped[str | None]
    name: Mapped[str | None]


class User(Checked, Base):
    """A person who signs in; ``password`` is its argon2id hash, None until it has been chosen."""

    __tablename__ = "users"
    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)
    role: Mapped[str]
    password: Mapped[str | None]
    created_at: Mapped[str]
    disabled_at: Mapped[str | None]


class UserSession(Checked, Base):
    """A session of a user, by the hash of its cookie; seconds since 1970."""

    __tablename__ = "user_sessions"
    id: Mapped[int] = mapped_column(primary_key=True)
    digest: Mapped[str] = mapped_column(unique=True)
    user_id: Mapped[int] = mapped_column(ForeignKey("users.id"), index=True)
    begun: Mapped[float]
    used: Mapped[float]
    origin: Mapped[str]
    revoked_at: Mapped[str | None]


class Invitation(Checked, Base):
    """A link by which a user chooses a password, once, until ``expires``, seconds since 1970."""

    __tablename__ = "invitations"
    id: Mapped[int] = mapped_column(primary_key=True)
    digest: Mapped[str] = mapped_column(unique=True)
    user_id: Mapped[int] = mapped_column(ForeignKey("users.id"), index=True)
    expires: Mapped[float]
    used_at: Mapped[str | None]


class Trouble(Checked, Base):
    """Trouble with the measurement of an axis, not with the axis: silence, a bad one, or no assessment."""

    __tablename__ = "troubles"
    __table_args__ = (UniqueConstraint("axis_id", "kind", "began_at"),)
    id: Mapped[int] = mapped_column(primary_key=True)
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"))
    kind: Mapped[str]
    began_at: Mapped[str]
    text: Mapped[str]
    raised_at: Mapped[str]
    ended_at: Mapped[str | None]


class AlarmAction(Checked, Base):
    """What a person did about an alarm or a trouble: acknowledged, shelved until a time, or closed.

    ``finding`` is what was found when it was closed, ``event`` the digest of the maintenance that followed.
    """

    __tablename__ = "alarm_actions"
    id: Mapped[int] = mapped_column(primary_key=True)
    alarm_id: Mapped[int | None] = mapped_column(ForeignKey("alarms.id"), index=True)
    trouble_id: Mapped[int | None] = mapped_column(ForeignKey("troubles.id"), index=True)
    action: Mapped[str]
    until: Mapped[str | None]
    text: Mapped[str]
    actor: Mapped[str]
    at: Mapped[str]
    finding: Mapped[str | None]
    event: Mapped[str | None]


class Message(Checked, Base):
    """A message to be sent, once for each ``key``."""

    __tablename__ = "outbox"
    id: Mapped[int] = mapped_column(primary_key=True)
    key: Mapped[str] = mapped_column(unique=True)
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"))
    kind: Mapped[str]
    detail: Mapped[dict[str, Any]]
    at: Mapped[str]
    sent_at: Mapped[str | None]


class Delivery(Checked, Base):
    """One message on its way to one recipient: the outbox rows that it reports, and its attempts.

    ``key`` is its Message-ID or idempotency key, the same with each attempt; ``not_before`` is in seconds
    since 1970. The status is queued, sent, failed (given up) or dropped (no longer true when due).
    """

    __tablename__ = "deliveries"
    id: Mapped[int] = mapped_column(primary_key=True)
    key: Mapped[str] = mapped_column(unique=True)
    recipient: Mapped[str]
    kind: Mapped[str]
    messages: Mapped[list[Any] | None]
    status: Mapped[str]
    attempts: Mapped[int]
    not_before: Mapped[float]
    error: Mapped[str | None]
    created_at: Mapped[str]
    sent_at: Mapped[str | None]


def all_tables() -> list[Any]:
    """Tables of the schema, each after those that its rows refer to."""
    return list(Base.metadata.sorted_tables)


def all_rows() -> list[type[Checked]]:
    """Classes of the rows with a checksum, of all tables."""
    return [mapper.class_ for mapper in Base.registry.mappers if issubclass(mapper.class_, Checked)]
