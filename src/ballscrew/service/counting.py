"""Which runs that were sent count: the most complete ones, with a time that is not doubtful."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import moment
from ballscrew.service.jobs import ANALYSE
from ballscrew.store.exclusions import SERVER, insert_exclusion
from ballscrew.store.lamps import CLOCK_TOLERANCE
from ballscrew.store.parts import count_parts, update_parts
from ballscrew.store.reading import current_rows
from ballscrew.store.same_recordings import RecordedRun, check_recordings
from ballscrew.store.service_tables import JobRow, Upload
from ballscrew.store.tables import Axis, Exclusion, RunRow

FAR = 366 * 24 * 3600.0
"""A time that differs by more from the receipt and from every other run of the axis is doubtful, s: a clock
that lost its battery begins years ago."""


def doubt_of_time(
    measured_at: str | None, received_at: str, others: Callable[[], Sequence[float]]
) -> str | None:
    """Why the time of a run is doubtful.

    Parameters
    ----------
    measured_at : str or None
        Time of the run.
    received_at : str
        Time of its receipt.
    others : callable
        Returns the times of the other runs of the axis that count, s since 1970; called if they are needed.

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
    if abs(measured - received) <= FAR:
        return None
    times = others()
    if times and min(abs(each - measured) for each in times) > FAR:
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
    times = cache(partial(_counting_times, session))
    found = []
    for row in rows:
        doubt = reasons.get(row.run or "")
        if row.run is None:
            measured_at = row.stated.get("measured_at")
            doubt = doubt_of_time(measured_at, row.received_at, partial(times, row.axis_id))
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
    others = partial(_counting_times, session, axis.id, run.run)
    doubt = doubt_of_time(run.measured_at, sent.received_at, others)
    if doubt is not None:
        insert_exclusion(session, run, doubt, SERVER)
        update_parts(session, run.run, sent.sender)
        return doubt
    count_parts(session, run.run, sent.sender)
    return doubt
