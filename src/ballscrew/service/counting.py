"""Which runs that were sent count: the most complete ones, with a time that is not doubtful."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import moment
from ballscrew.service.jobs import ANALYSE
from ballscrew.store.changing import SERVER, end_exclusions, insert_exclusion, standing_exclusions
from ballscrew.store.lamps import CLOCK_TOLERANCE
from ballscrew.store.reading import current_rows, find_run, newest_version, run_versions
from ballscrew.store.same_recordings import RecordedRun, check_recordings
from ballscrew.store.tables import Axis, Exclusion, JobRow, RecordingRow, ResultRow, RunRow, Upload

FAR = 366 * 24 * 3600.0
"""A time that differs by more from the receipt and from every other run of the axis is doubtful, s: a clock
that lost its battery begins years ago."""

_PART = "its recordings are a part of those of the run "
_BAD = "is bad, and contains the recordings of the run "


def doubt_of_time(measured_at: str | None, received_at: str, others: Sequence[float]) -> str | None:
    """Why the time of a run is doubtful.

    Parameters
    ----------
    measured_at : str or None
        Time of the run.
    received_at : str
        Time of its receipt.
    others : sequence of float
        Times of the other runs of the axis that count, s since 1970.

    Returns
    -------
    str or None
        A sentence; None where the time is not doubtful.
    """
    if measured_at is None:
        return None
    measured = moment(measured_at, "measured_at").timestamp()
    received = moment(received_at, "received_at").timestamp()
    if measured > received + CLOCK_TOLERANCE:
        return f"measured_at, {measured_at}, is in the future."
    if others and min(abs(each - measured) for each in (*others, received)) > FAR:
        return f"measured_at, {measured_at}, is more than a year from every other run and from its receipt."
    return None


def _counting_times(session: Session, axis: int, run: str | None = None) -> list[float]:
    """Times of the runs of an axis that count, s since 1970, but that of one."""
    rows = current_rows(session, session.get_one(Axis, axis))
    return [row.time for row in rows if row.time is not None and row.run != run]


def check_time(measured_at: str) -> None:
    """Check that the time to which a run is corrected is not in the future.

    Raises
    ------
    InputError
        If it is, or is no time.
    """
    if moment(measured_at, "measured_at").timestamp() > time.time() + CLOCK_TOLERANCE:
        raise InputError(f"measured_at is {measured_at!r}, in the future.")


def doubted_runs() -> Any:
    """Selection of the numbers of runs that do not count because of their times."""
    standing = (Exclusion.run_id.is_not(None), Exclusion.ended_at.is_(None))
    return select(Exclusion.run_id).where(Exclusion.actor == SERVER, *standing)


def doubts_of(session: Session, rows: Sequence[Upload]) -> list[str | None]:
    """Why the time of each run that was sent is doubtful; None where it is not."""
    standing = select(RunRow.run, Exclusion.reason).join(RunRow, RunRow.id == Exclusion.run_id)
    standing = standing.where(Exclusion.actor == SERVER, Exclusion.ended_at.is_(None))
    reasons: dict[str, str] = {run: reason for run, reason in session.execute(standing)}  # noqa: C416
    found = []
    others: dict[int, list[float]] = {}
    for row in rows:
        doubt = reasons.get(row.run or "")
        if row.run is None:
            if row.axis_id not in others:
                others[row.axis_id] = _counting_times(session, row.axis_id)
            doubt = doubt_of_time(row.stated.get("measured_at"), row.received_at, others[row.axis_id])
        found.append(doubt)
    return found


def check_sent(session: Session, axis: Axis, sent: Upload, run: Run | None) -> None:
    """Check that a run that was sent has no recording of another one that counts or waits.

    Parameters
    ----------
    session : Session
        Reading.
    axis : Axis
        Its axis.
    sent : Upload
        How the run was sent.
    run : Run or None
        The run, if it was analysed at the machine.

    Raises
    ------
    SameRecordingError
        If it has.
    """
    if run is not None:
        new = RecordedRun.of(run, axis.name)
    else:
        new = _recorded(axis.name, sent.key, sent.files, sent.stated)
    check_recordings(session, new)
    columns = (Axis.name, Upload.key, Upload.files, Upload.stated)
    waiting = (
        select(*columns)
        .join(Upload, Upload.axis_id == Axis.id)
        .join(JobRow, JobRow.argument == Upload.content)
        .where(JobRow.kind == ANALYSE, JobRow.set_aside.is_(False))
        .where(Upload.run.is_(None), Upload.content != sent.content)
    )
    for row in session.execute(waiting.order_by(Upload.id)):
        new.check(_recorded(*row))


def _recorded(axis: str, key: str, files: list[Any] | None, stated: dict[str, Any]) -> RecordedRun:
    """Run that was sent and is not analysed yet, by its recordings."""
    names = {file["sha256"]: file["name"] for file in files or ()}
    channels = stated["documents"].get("channels")
    return RecordedRun(key, axis, names, stated["measured_at"], stated["mass_kg"], channels, analysed=False)


def exclude_as_needed(session: Session, axis: Axis, sent: Upload, *, is_new: bool) -> str | None:
    """Exclude a run whose time is doubtful, and parts of more complete runs.

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

    Returns
    -------
    str or None
        Why its time is doubtful; None where it is not.
    """
    if not is_new:
        return None
    run = session.scalars(select(RunRow).where(RunRow.run == sent.run)).all()[0]
    others = _counting_times(session, axis.id, run.run)
    doubt = doubt_of_time(run.measured_at, sent.received_at, others)
    if doubt is not None:
        insert_exclusion(session, run, doubt, SERVER)
        return doubt
    if _is_bad(session, run):  # which an earlier result of it was not
        _include_parts(session, axis, run, sent.sender)
    exclude_parts(session, axis, run, sent.sender)
    return doubt


def exclude_parts(session: Session, axis: Axis, run: RunRow, by: str) -> None:
    """Exclude runs whose recordings are a part of those of a more complete run of the same load.

    Of a more complete run that is bad and a part that is not, the part counts. Which of several runs counts,
    of which each contains the next, does not depend on the order of arrival.

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


def is_part(session: Session, run: str) -> bool:
    """Whether a run is excluded because another with its recordings counts."""
    reasons = [each.reason for each in standing_exclusions(session, find_run(session, run))]
    return any(reason.startswith((_PART, _BAD)) for reason in reasons)


def update_parts(session: Session, run: str, by: str) -> None:
    """Exclude the parts of a run that counts now, or include those of one that no longer does.

    Parameters
    ----------
    session : Session
        Writing.
    run : str
        Id of the run, after it was corrected, excluded or included.
    by : str
        Who did that.
    """
    row = _newest(session, find_run(session, run))
    axis = session.get_one(Axis, row.axis_id)
    if row.id in {each.id for each in current_rows(session, axis)}:
        exclude_parts(session, axis, row, by)
    else:
        _include_parts(session, axis, row, by)


def _include_parts(session: Session, axis: Axis, whole: RunRow, by: str) -> None:
    """Include the parts of a run that no longer counts, unless they are those of another run that does."""
    versions = select(RunRow.run).where(RunRow.id.in_(run_versions(session, whole)))
    reasons = [_part_reason(each) for each in session.scalars(versions)]
    found = select(RunRow).join(Exclusion, Exclusion.run_id == RunRow.id).order_by(RunRow.id)
    found = found.where(RunRow.axis_id == axis.id, Exclusion.ended_at.is_(None))
    parts = session.scalars(found.where(Exclusion.reason.in_(reasons))).all()
    for part in parts:
        end_exclusions(session, part, f"the run {whole.run} does not count.", by)
    for part in parts:
        exclude_parts(session, axis, _newest(session, part), by)


def _newest(session: Session, row: RunRow) -> RunRow:
    return find_run(session, newest_version(session, row))


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
        return [(whole, f"{_BAD}{part.run}, which counts.")]
    return [(part, _part_reason(whole.run))]


def _part_reason(whole: str) -> str:
    return f"{_PART}{whole}, which counts."


def _recordings(session: Session, run: RunRow) -> set[str]:
    return set(session.scalars(select(RecordingRow.sha256).where(RecordingRow.run_id == run.id)))


def _is_bad(session: Session, run: RunRow) -> bool:
    """Whether the newest result of a run is bad."""
    newest = select(ResultRow.verdict).where(ResultRow.run_id == run.id).order_by(ResultRow.id.desc())
    return session.scalars(newest.limit(1)).first() == "bad"
