"""Exclusions of runs and events from the history: they stay in the store, with reason, time and author."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.store.folder import now
from ballscrew.store.opened import record
from ballscrew.store.reading import run_versions
from ballscrew.store.tables import Axis, EventRow, Exclusion, RunRow

SERVER = "server"
"""Actor of the exclusion of a run whose time is doubtful; a correction of the time ends it."""


def insert_exclusion(session: Session, row: RunRow | EventRow, reason: str, by: str) -> None:
    """Exclude a run or an event, unless it is excluded.

    Parameters
    ----------
    session : Session
        Writing.
    row : RunRow or EventRow
        Its row.
    reason : str
        Why.
    by : str
        Who wants it.
    """
    if standing_exclusions(session, row):
        return
    exclusion = Exclusion(reason=reason, actor=by, begun_at=now())
    if isinstance(row, EventRow):
        exclusion.event_id = row.id
    else:
        exclusion.run_id = row.id
    session.add(exclusion)
    _record_counting(session, "exclude", row, reason, by)


def standing_exclusions(session: Session, row: RunRow | EventRow) -> Sequence[Exclusion]:
    """Exclusions of an event, or of any version of a run, that have not ended."""
    of_subject = Exclusion.event_id == row.id
    if isinstance(row, RunRow):
        of_subject = Exclusion.run_id.in_(run_versions(session, row))
    return session.scalars(select(Exclusion).where(of_subject, Exclusion.ended_at.is_(None))).all()


def end_exclusions(
    session: Session,
    row: RunRow | EventRow,
    reason: str,
    by: str,
    actors: Sequence[str] = (),
    *,
    decided: bool = False,
) -> None:
    """End the exclusions of a run or an event, or only those by some actors.

    Parameters
    ----------
    session : Session
        Writing.
    row : RunRow or EventRow
        Its row.
    reason : str
        Why.
    by : str
        Who wants it.
    actors : sequence of str
        Whose exclusions end; by default everyone's.
    decided : bool
        Whether a person decided that it counts; the audit has it.
    """
    found = []
    for exclusion in standing_exclusions(session, row):
        if not actors or exclusion.actor in actors:
            exclusion.ended_at = now()
            found.append(exclusion)
    if found:
        _record_counting(session, "include", row, reason, by, decided=decided)


def _record_counting(
    session: Session, action: str, row: RunRow | EventRow, reason: str, by: str, **detail: bool
) -> None:
    """Mark the axis of a run or an event as changed, and record whether it counts now."""
    axis, counts = session.get_one(Axis, row.axis_id), action == "include"
    axis.changed_at = now()
    changed = {"counts": [not counts, counts]}
    record(session, action, id_of(row), axis=axis.name, reason=reason, by=by, changed=changed, **detail)


def id_of(row: RunRow | EventRow) -> str:
    """Id of a run or an event."""
    return row.digest if isinstance(row, EventRow) else row.run
