"""Tables of the store.

A row with a ``checksum`` is verified against it; cells and recordings are verified against the RUN.json of
their result. Text that people entered, and everything that an analysis gave, stays as it was added.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any, ClassVar

import zstandard
from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    ColumnElement,
    Float,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    Text,
    UniqueConstraint,
    and_,
    event,
    inspect,
)
from sqlalchemy.ext.hybrid import hybrid_property
from sqlalchemy.orm import DeclarativeBase, Mapped, Mapper, mapped_column

from ballscrew.base.errors import InputError

SCHEMA = "0005"
"""Newest version of the schema, as Alembic has it."""

SCHEMAS = ("0001", "0002", "0003", "0004", SCHEMA)
"""All of them, by age."""

_LEVEL = 10  # of zstd


class Base(DeclarativeBase):
    """A table; JSON, integers and numbers have one type on every database."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(column_0_N_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    """Names of constraints."""
    type_annotation_map: ClassVar[dict[Any, Any]] = {
        str: Text,
        float: Float(53),
        int: Integer,
        bool: Boolean,
        bytes: LargeBinary,
        dict[str, Any]: JSON,
        list[Any]: JSON(none_as_null=True),
    }


class Checked:
    """A row whose values have a checksum, so that a changed byte in the database is found."""

    checksum: Mapped[int] = mapped_column(BigInteger, default=0)


def checksum_of(row: Checked) -> int:
    """Checksum of a row by its values.

    Parameters
    ----------
    row : Checked
        Its number, which the database assigns, has no effect.

    Returns
    -------
    int
        Of 64 bits, with sign.
    """
    names = [column.key for column in inspect(type(row)).columns]
    return checksum_of_values({name: getattr(row, name) for name in names if name not in ("id", "checksum")})


def checksum_of_values(row: Mapping[str, Any]) -> int:
    """Checksum of a row that is a mapping of its columns, without ``id`` and ``checksum``."""
    values = dict(row)
    for name, value in row.items():
        if isinstance(value, bytes):
            values[name] = value.hex()
    text = json.dumps(values, sort_keys=True)
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "big", signed=True)


@event.listens_for(Checked, "before_insert", propagate=True)
@event.listens_for(Checked, "before_update", propagate=True)
def _set_checksum(mapper: Mapper[Any], connection: Any, row: Any) -> None:  # noqa: ARG001  as SQLAlchemy calls it
    row.checksum = checksum_of(row)


class MachineRow(Checked, Base):
    """A machine, at a site."""

    __tablename__ = "machines"
    __table_args__ = (UniqueConstraint("site", "name"),)
    id: Mapped[int] = mapped_column(primary_key=True)
    site: Mapped[str]
    name: Mapped[str]


class Axis(Checked, Base):
    """An axis by its name: what was chosen for its history, its newest assessment, its number of runs.

    ``changed_at`` is the time of a change of the history that the assessment does not contain yet.
    """

    __tablename__ = "axes"
    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)
    machine_id: Mapped[int | None] = mapped_column(ForeignKey("machines.id"))
    model_digest: Mapped[str | None] = mapped_column()
    method_id: Mapped[int | None] = mapped_column(ForeignKey("methods.id"))
    assessment_id: Mapped[int | None] = mapped_column()
    changed_at: Mapped[str | None]
    runs: Mapped[int] = mapped_column(default=0)


class Document(Checked, Base):
    """A data sheet, plan or channel map, by the digest that RUN.json states."""

    __tablename__ = "documents"
    digest: Mapped[str] = mapped_column(primary_key=True)
    kind: Mapped[str]
    axis_id: Mapped[int | None] = mapped_column(ForeignKey("axes.id"))
    text: Mapped[str]
    added_at: Mapped[str]


class Model(Checked, Base):
    """A calibrated model of an axis: MODEL.json."""

    __tablename__ = "models"
    digest: Mapped[str] = mapped_column(primary_key=True)
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"), index=True)
    document: Mapped[bytes]
    added_at: Mapped[str]


class Method(Checked, Base):
    """A method of analysis with its settings; the revision is raised only when numbers change."""

    __tablename__ = "methods"
    __table_args__ = (UniqueConstraint("name", "settings_digest", "revision"),)
    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str]
    settings_digest: Mapped[str]
    revision: Mapped[int]
    settings: Mapped[dict[str, Any]]


class MethodChange(Checked, Base):
    """A switch of an axis to another method where runs have no raw files: these keep their old results.

    ``step`` is that of the relative change of the nut's compliance from the old results to the new ones, by
    ``runs`` runs with both.
    """

    __tablename__ = "method_changes"
    __table_args__ = (UniqueConstraint("axis_id", "new_method_id"),)
    id: Mapped[int] = mapped_column(primary_key=True)
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"))
    old_method_id: Mapped[int] = mapped_column(ForeignKey("methods.id"))
    new_method_id: Mapped[int] = mapped_column(ForeignKey("methods.id"))
    step: Mapped[float]
    step_uncertainty: Mapped[float]
    runs: Mapped[int]
    changed_at: Mapped[str]


class RunRow(Checked, Base):
    """A run: one execution of a plan on an axis. ``time`` is ``measured_at`` in seconds since 1970."""

    __tablename__ = "runs"
    __table_args__ = (Index("ix_runs_axis_time", "axis_id", "time"),)
    id: Mapped[int] = mapped_column(primary_key=True)
    run: Mapped[str] = mapped_column(unique=True)
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"))
    measured_at: Mapped[str | None]
    time: Mapped[float | None]
    mass_kg: Mapped[float | None]
    temperature_C: Mapped[float | None]  # noqa: N815  as in RUN.json
    supersedes: Mapped[str | None] = mapped_column(index=True)
    received_at: Mapped[str]


class Source(Checked, Base):
    """RUN.toml of a run whose raw files are stored: what it states, and its documents."""

    __tablename__ = "sources"
    digest: Mapped[str] = mapped_column(primary_key=True)
    run_id: Mapped[int] = mapped_column(ForeignKey("runs.id"), index=True)
    stated: Mapped[dict[str, Any]]


class RawFile(Checked, Base):
    """A raw file in the store, by its hash; where it was archived, the folder it was moved to.

    ``deleted_at`` is the time at which its content was deleted by the retention policy.
    """

    __tablename__ = "files"
    sha256: Mapped[str] = mapped_column(primary_key=True)
    size: Mapped[int] = mapped_column(BigInteger)
    stored_size: Mapped[int] = mapped_column(BigInteger)
    compression: Mapped[str]
    archived_to: Mapped[str | None]
    added_at: Mapped[str]
    deleted_at: Mapped[str | None]

    @hybrid_property
    def is_stored(self) -> bool:
        """Whether the store has its content."""
        return self.archived_to is None and self.deleted_at is None

    @is_stored.inplace.expression
    @classmethod
    def _is_stored_in_rows(cls) -> ColumnElement[bool]:
        return and_(cls.archived_to.is_(None), cls.deleted_at.is_(None))


class RecordingRow(Base):
    """A recording of a run; there is a raw file of this hash only where it is stored."""

    __tablename__ = "recordings"
    run_id: Mapped[int] = mapped_column(ForeignKey("runs.id"), primary_key=True)
    place: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str]
    sha256: Mapped[str] = mapped_column(index=True)


class ResultRow(Checked, Base):
    """One analysis of a run: RUN.json, compressed, its verdict and version."""

    __tablename__ = "results"
    __table_args__ = (
        UniqueConstraint("run_id", "method_id"),
        Index("ix_results_verdict", "method_id", "run_id", "verdict"),
    )
    id: Mapped[int] = mapped_column(primary_key=True)
    run_id: Mapped[int] = mapped_column(ForeignKey("runs.id"))
    method_id: Mapped[int] = mapped_column(ForeignKey("methods.id"))
    version: Mapped[str]
    verdict: Mapped[str]
    reasons: Mapped[list[Any] | None]
    document: Mapped[bytes]
    added_at: Mapped[str]


class CellRow(Base):
    """A cell of a result; each reason is its kind and its sentence."""

    __tablename__ = "cells"
    __table_args__ = ({"sqlite_with_rowid": False},)
    result_id: Mapped[int] = mapped_column(ForeignKey("results.id"), primary_key=True)
    place: Mapped[int] = mapped_column(primary_key=True)
    position_m: Mapped[float]
    condition: Mapped[str]
    motion: Mapped[int]
    frequency_Hz: Mapped[float | None]  # noqa: N815
    standard_uncertainty_Hz: Mapped[float | None]  # noqa: N815
    verdict: Mapped[str]
    reasons: Mapped[list[Any] | None]


class Conflict(Checked, Base):
    """A result that was refused because another of the same run, method and settings was there."""

    __tablename__ = "conflicts"
    digest: Mapped[str] = mapped_column(primary_key=True)
    run: Mapped[str]
    document: Mapped[bytes]
    received_at: Mapped[str]


class EventRow(Checked, Base):
    """An event on an axis; ``time`` is ``at`` in seconds since 1970."""

    __tablename__ = "events"
    id: Mapped[int] = mapped_column(primary_key=True)
    digest: Mapped[str] = mapped_column(unique=True)
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"), index=True)
    at: Mapped[str]
    time: Mapped[float]
    kind: Mapped[str]
    text: Mapped[str]
    added_at: Mapped[str]


class Exclusion(Checked, Base):
    """A run or an event that does not count, from when until when, and why."""

    __tablename__ = "exclusions"
    id: Mapped[int] = mapped_column(primary_key=True)
    run_id: Mapped[int | None] = mapped_column(ForeignKey("runs.id"), index=True)
    event_id: Mapped[int | None] = mapped_column(ForeignKey("events.id"), index=True)
    reason: Mapped[str]
    actor: Mapped[str]
    begun_at: Mapped[str]
    ended_at: Mapped[str | None]


class Correction(Checked, Base):
    """A value that was corrected, with the old one."""

    __tablename__ = "corrections"
    id: Mapped[int] = mapped_column(primary_key=True)
    subject: Mapped[str]
    field: Mapped[str]
    old: Mapped[str | None]
    new: Mapped[str | None]
    reason: Mapped[str]
    actor: Mapped[str]
    at: Mapped[str]


class EpochRow(Checked, Base):
    """An epoch by the newest assessment, with the coefficients of its chart."""

    __tablename__ = "epochs"
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True)
    begins: Mapped[str | None]
    ends: Mapped[str | None]
    cause: Mapped[str]
    reference: Mapped[str | None]
    alarm_at: Mapped[str | None]
    coefficients: Mapped[list[Any] | None]
    covariance: Mapped[list[Any] | None]
    scale: Mapped[float | None]
    share_uncertainty: Mapped[float]


class StateRow(Checked, Base):
    """A run in its history: level and design as measured, statistics and state.

    What is relative to the baseline is computed when it is read, from these and the row of the epoch.
    ``design`` consists of numbers of 64 bits, least significant byte first.
    """

    __tablename__ = "states"
    __table_args__ = (
        ForeignKeyConstraint(["axis_id", "epoch"], ["epochs.axis_id", "epochs.number"]),
        Index("ix_states_axis_time", "axis_id", "time"),
    )
    run_id: Mapped[int] = mapped_column(ForeignKey("runs.id"), primary_key=True)
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"))
    time: Mapped[float]
    epoch: Mapped[int]
    state: Mapped[str]
    verdict: Mapped[str]
    level: Mapped[float | None]
    random: Mapped[float | None]
    systematic: Mapped[float | None]
    unknown_temperature: Mapped[float | None]
    design: Mapped[bytes | None]
    ramp: Mapped[float | None]
    ramp_limit: Mapped[float | None]
    odds: Mapped[float | None]
    odds_limit: Mapped[float | None]
    nut: Mapped[float | None]
    nut_low: Mapped[float | None]
    nut_high: Mapped[float | None]
    reasons: Mapped[list[Any] | None]


class CheckpointRow(Checked, Base):
    """Checkpoint of the first ``runs`` runs of an axis; the key is that of all that it follows from."""

    __tablename__ = "checkpoints"
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"), primary_key=True)
    key: Mapped[str] = mapped_column(primary_key=True)
    runs: Mapped[int]
    document: Mapped[bytes]


class AlarmRow(Checked, Base):
    """An alarm that was raised; one that no longer follows from the runs is retracted, never deleted."""

    __tablename__ = "alarms"
    __table_args__ = (UniqueConstraint("axis_id", "epoch", "began_at"),)
    id: Mapped[int] = mapped_column(primary_key=True)
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"))
    epoch: Mapped[int]
    began_at: Mapped[str]
    raised_at: Mapped[str]
    retracted_at: Mapped[str | None]


class Assessment(Checked, Base):
    """State of an axis and forecast of its remaining life, by stated runs, model, events and settings."""

    __tablename__ = "assessments"
    __table_args__ = (UniqueConstraint("axis_id", "inputs"),)
    id: Mapped[int] = mapped_column(primary_key=True)
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"))
    inputs: Mapped[str]
    made_at: Mapped[str]
    version: Mapped[str]
    method_id: Mapped[int] = mapped_column(ForeignKey("methods.id"))
    model_digest: Mapped[str] = mapped_column(ForeignKey("models.digest"))
    settings: Mapped[dict[str, Any]]
    runs: Mapped[int]
    newest_at: Mapped[str]
    state: Mapped[str]
    urgency: Mapped[str]
    verdict: Mapped[str]
    alarm_at: Mapped[str | None]
    stiffness: Mapped[list[Any] | None]
    rul_days: Mapped[dict[str, Any]]
    reasons: Mapped[list[Any] | None]


class Explanation(Checked, Base):
    """Explanation of the newest assessment of an axis, see :mod:`ballscrew.store.explaining`."""

    __tablename__ = "explanations"
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"), primary_key=True)
    assessment_id: Mapped[int] = mapped_column(ForeignKey("assessments.id"))
    lamp: Mapped[str]
    document: Mapped[bytes]


class Setup(Checked, Base):
    """Documents of an axis for the recordings that are sent to the service, and when runs are expected.

    ``sheet``, ``plan`` and ``channels`` are digests of documents; a run is expected every ``period_s``.
    """

    __tablename__ = "setups"
    axis_id: Mapped[int] = mapped_column(ForeignKey("axes.id"), primary_key=True)
    sheet: Mapped[str | None] = mapped_column(ForeignKey("documents.digest"))
    plan: Mapped[str | None] = mapped_column(ForeignKey("documents.digest"))
    channels: Mapped[str | None] = mapped_column(ForeignKey("documents.digest"))
    period_s: Mapped[float | None]
    grace_s: Mapped[float | None]
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


class Audit(Checked, Base):
    """What was done to the store, when, by whom.

    ``detail["after"]`` is the checksum of the row before.
    """

    __tablename__ = "audit"
    id: Mapped[int] = mapped_column(primary_key=True)
    at: Mapped[str]
    actor: Mapped[str]
    action: Mapped[str]
    subject: Mapped[str]
    detail: Mapped[dict[str, Any]]


def pack(document: Any) -> bytes:
    """A document as canonical JSON, compressed."""
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return zstandard.ZstdCompressor(level=_LEVEL).compress(text.encode())


def unpack(content: bytes) -> Any:
    """Document of :func:`pack`."""
    try:
        return json.loads(zstandard.ZstdDecompressor().decompress(content))
    except (zstandard.ZstdError, ValueError):
        raise InputError("a document in the store cannot be read: the database is damaged.") from None
