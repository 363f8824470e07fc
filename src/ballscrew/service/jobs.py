"""Jobs: leased to one worker at a time, repeated after a failure, set aside after the last attempt."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Select, func, or_, select
from sqlalchemy.orm import Session

from ballscrew.service.serving import Service
from ballscrew.store.folder import now
from ballscrew.store.opened import record
from ballscrew.store.service_tables import JobRow
from ballscrew.store.tables import Axis, Model, RunRow

ANALYSE, ASSESS = "analyse", "assess"
PRIORITIES = {ASSESS: 0, ANALYSE: 10}
"""Lower first: an assessment is short, and a verdict waits for it."""

Clock = Callable[[], float]

_LONGEST_PAUSE = 3600.0  # s between attempts


@dataclass(frozen=True, slots=True)
class Lease:
    """A job that is leased.

    Parameters
    ----------
    job : int
        Its number.
    token : str
        Of this lease; a result that arrives after the lease was lost is dropped.
    kind, argument : str
        What is to be done.
    """

    job: int
    token: str
    kind: str
    argument: str


def enqueue(session: Session, kind: str, argument: str) -> None:
    """Add a job, unless it waits already.

    Parameters
    ----------
    session : Session
        Writing.
    kind, argument : str
        What is to be done; one job of each at a time.
    """
    row = _find_job(session, kind, argument)
    if row is None:
        row = JobRow(kind=kind, argument=argument, priority=PRIORITIES[kind], created_at=now())
        session.add(row)
    elif not row.set_aside:
        return
    row.not_before, row.attempts, row.set_aside, row.error = 0.0, 0, False, None
    row.lease = row.lease_until = None
    session.flush()


def _find_job(session: Session, kind: str, argument: str) -> JobRow | None:
    return session.scalar(select(JobRow).where(JobRow.kind == kind, JobRow.argument == argument))


def request_assessment(session: Session, axis: Axis) -> None:
    """Add the job that assesses an axis, once it has a model and a run with a time."""
    row = _find_job(session, ASSESS, axis.name)
    if row is not None and not row.set_aside:  # it waits
        return
    model = select(Model.digest).where(Model.axis_id == axis.id).limit(1)
    run = select(RunRow.id).where(RunRow.axis_id == axis.id, RunRow.time.is_not(None)).limit(1)
    if session.scalar(model) is not None and session.scalar(run) is not None:
        enqueue(session, ASSESS, axis.name)


def lease_job(service: Service, clock: Clock = time.time) -> Lease | None:
    """Lease the next job: a lower priority first, then the older one.

    A lease or a pause that ends later than it can was made before the clock was set back, and is void.

    Parameters
    ----------
    service : Service
        The service.
    clock : callable
        Seconds since 1970.

    Returns
    -------
    Lease or None
        None if no job is due.
    """
    lease_s = service.settings.lease_s
    with service.store.read() as session:
        if session.scalar(_next_job(clock(), lease_s)) is None:
            return None
    with service.store.write("lease") as session:
        # Not the time of before: a lease made meanwhile would end later than it can.
        at = clock()
        row = session.scalar(_next_job(at, lease_s))
        if row is None:
            return None
        row.lease, row.lease_until = secrets.token_hex(8), at + lease_s
        return Lease(row.id, row.lease, row.kind, row.argument)


def _next_job(at: float, lease_s: float) -> Select[JobRow]:
    """Query of the job that is leased next at a time (s since 1970)."""
    has_paused = or_(JobRow.not_before <= at, JobRow.not_before > at + _LONGEST_PAUSE)
    lease_has_ended = or_(JobRow.lease_until <= at, JobRow.lease_until > at + lease_s)
    due = (JobRow.set_aside.is_(False), has_paused, or_(JobRow.lease_until.is_(None), lease_has_ended))
    return select(JobRow).where(*due).order_by(JobRow.priority, JobRow.id).limit(1)


def is_current(session: Session, lease: Lease) -> JobRow | None:
    """Row of a leased job; None if the lease was lost."""
    row = session.get(JobRow, lease.job)
    if row is None or row.lease != lease.token:
        return None
    return row


def fail_job(service: Service, lease: Lease, reason: str, clock: Clock = time.time) -> bool:
    """Try a job again after a pause, or set it aside after the last attempt.

    Parameters
    ----------
    service : Service
        The service.
    lease : Lease
        Of the job; nothing happens if it was lost.
    reason : str
        A sentence.
    clock : callable
        Seconds since 1970.

    Returns
    -------
    bool
        Whether it was set aside.
    """
    settings = service.settings
    with service.store.write("fail") as session:
        row = is_current(session, lease)
        if row is None:
            return False
        row.attempts += 1
        row.error = reason
        row.lease = row.lease_until = None
        row.not_before = clock() + min(_LONGEST_PAUSE, settings.back_off_s * 2.0 ** min(row.attempts - 1, 20))
        row.set_aside = row.attempts >= settings.attempts
        if row.set_aside:
            record(session, "set aside", f"{row.kind} {row.argument}", reason=reason)
        return row.set_aside


def release_jobs(session: Session, lease: Lease | None = None) -> None:
    """Release one lease, or all those of a server that has ended, without counting an attempt."""
    leased = select(JobRow).where(JobRow.lease.is_not(None))
    if lease is not None:
        leased = leased.where(JobRow.id == lease.job, JobRow.lease == lease.token)
    for row in session.scalars(leased):
        row.lease = row.lease_until = None


def waiting_runs(session: Session) -> int:
    """Number of runs that wait for their analysis."""
    waiting = select(func.count()).where(JobRow.kind == ANALYSE, JobRow.set_aside.is_(False))
    return int(session.scalar(waiting) or 0)


def job_documents(session: Session) -> list[dict[str, Any]]:
    """All jobs, those that were set aside last."""
    rows = session.scalars(select(JobRow).order_by(JobRow.set_aside, JobRow.priority, JobRow.id))
    found = []
    for row in rows:
        status = "queued"
        if row.set_aside:
            status = "set aside"
        elif row.lease is not None:
            status = "running"
        found.append(
            {
                "id": row.id,
                "kind": row.kind,
                "argument": row.argument,
                "status": status,
                "attempts": row.attempts,
                "error": row.error,
                "created_at": row.created_at,
            }
        )
    return found
