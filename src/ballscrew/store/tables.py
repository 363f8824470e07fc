"""Tables of the store: what was measured, estimated and decided.

Cells and recordings are verified against the RUN.json of their result. Text that people entered, and
everything that an analysis gave, stays as it was added.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    UniqueConstraint,
    and_,
)
from sqlalchemy.ext.hybrid import hybrid_property
from sqlalchemy.orm import Mapped, mapped_column

from ballscrew.store.rows import Base, Checked

SCHEMA = "0006"
"""Newest version of the schema, as Alembic has it."""

SCHEMAS = ("0001", "0002", "0003", "0004", "0005", SCHEMA)
"""All of them, by age."""


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
