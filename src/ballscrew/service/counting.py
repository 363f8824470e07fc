"""Which runs that were sent count: of those with common recordings the most complete one."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.store.changing import insert_exclusion
from ballscrew.store.reading import current_rows
from ballscrew.store.tables import Axis, RecordingRow, ResultRow, RunRow, Upload


def exclude_as_needed(session: Session, axis: Axis, sent: Upload, *, is_new: bool) -> None:
    """Exclude parts of more complete runs.

    Parameters
    ----------
    session : Session
        Writing.
    axis : Axis
        Its axis.
    sent : Upload
        How the run was sent, with the id of its result.
    is_new : bool
        Whether the result is new; else nothing changes, since a person may have included it.
    """
    if is_new:
        run = session.scalars(select(RunRow).where(RunRow.run == sent.run)).all()[0]
        exclude_parts(session, axis, run, sent.sender)


def exclude_parts(session: Session, axis: Axis, run: RunRow, by: str) -> None:
    """Exclude runs whose recordings are a part of those of a more complete run of the same load.

    Of a more complete run that is bad and a part that is not, the part counts. The result does not depend on
    the order of arrival.

    Parameters
    ----------
    session : Session
        Writing.
    axis : Axis
        Its axis.
    run : RunRow
        A run that was added: part of another, or more complete than others.
    by : str
        Who sent it.
    """
    counting = {row.id for row in current_rows(session, axis)}
    if run.id not in counting:
        return
    excluded = []
    for other in _sharing(session, run):
        if other.id in counting and other.mass_kg == run.mass_kg:
            excluded += _excluded_of(session, run, other)
    itself = [each for each in excluded if each[0] is run]
    for row, reason in itself[:1] or excluded:
        insert_exclusion(session, row, reason, by)


def _sharing(session: Session, run: RunRow) -> list[RunRow]:
    """Other runs of the axis with a recording of a run."""
    recordings = select(RecordingRow.sha256).where(RecordingRow.run_id == run.id)
    others = select(RecordingRow.run_id).where(RecordingRow.sha256.in_(recordings))
    found = select(RunRow).where(RunRow.id.in_(others), RunRow.axis_id == run.axis_id, RunRow.id != run.id)
    return list(session.scalars(found.order_by(RunRow.id)))


def _excluded_of(session: Session, first: RunRow, second: RunRow) -> list[tuple[RunRow, str]]:
    """The one of two runs that does not count, and why; none unless one has all recordings of the other."""
    part, whole = sorted((first, second), key=lambda row: len(_recordings(session, row)))
    if not _recordings(session, part) < _recordings(session, whole):
        return []
    if _is_bad(session, whole) and not _is_bad(session, part):
        return [(whole, f"is bad, and contains the recordings of the run {part.run}, which counts.")]
    return [(part, f"its recordings are a part of those of the run {whole.run}, which counts.")]


def _recordings(session: Session, run: RunRow) -> set[str]:
    return set(session.scalars(select(RecordingRow.sha256).where(RecordingRow.run_id == run.id)))


def _is_bad(session: Session, run: RunRow) -> bool:
    """Whether the newest result of a run is bad."""
    newest = select(ResultRow.verdict).where(ResultRow.run_id == run.id).order_by(ResultRow.id.desc())
    return session.scalars(newest.limit(1)).first() == "bad"
