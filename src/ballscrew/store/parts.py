"""Runs whose recordings are a part of those of another: of a split upload, the most complete one counts."""

from __future__ import annotations

from collections.abc import Collection
from itertools import pairwise

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from ballscrew.store.exclusions import end_exclusions, insert_exclusion, standing_exclusions
from ballscrew.store.methods import used_result
from ballscrew.store.reading import current_rows, find_run, newest_version, run_versions
from ballscrew.store.tables import Audit, Axis, Exclusion, RecordingRow, RunRow

_PART = "its recordings are a part of those of the run "
_BAD = "is bad, and contains the recordings of the run "
_COUNTS = ", which counts."


def exclude_parts(session: Session, axis: Axis, run: RunRow, by: str) -> None:
    """Exclude runs whose recordings are a part of those of a more complete run of the same load.

    Of a more complete run that is bad and a part that is not, the part counts. Which of several runs counts,
    of which each contains the next, does not depend on the order of arrival. A run that a person
    included again stays, beside the runs that the store had then.

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
    excluded = []
    for other in _sharing(session, axis, run):
        excluded += _excluded_of(session, run, other)
    itself = [each for each in excluded if each[0] is run]
    for row, reason in itself[:1] or excluded:
        insert_exclusion(session, row, reason, by)


def count_parts(session: Session, run: str, by: str) -> None:
    """Exclude what does not count of a run with a new result, its parts and the runs that contain it.

    Parameters
    ----------
    session : Session
        Writing.
    run : str
        Id of the run.
    by : str
        Who added the result.
    """
    row = session.scalars(select(RunRow).where(RunRow.run == run)).all()[0]
    recordings = select(RecordingRow.sha256).where(RecordingRow.run_id == row.id)
    sharing = set(session.scalars(select(RecordingRow.run_id).where(RecordingRow.sha256.in_(recordings))))
    if sharing - {row.id}:
        axis = session.get_one(Axis, row.axis_id)
        recount_parts(session, axis, by, sharing)
        exclude_parts(session, axis, row, by)


def recount_parts(session: Session, axis: Axis, by: str, runs: Collection[int] | None = None) -> None:
    """End exclusions that newer results contradict: a run is bad that was not, or no longer.

    Parameters
    ----------
    session : Session
        Writing.
    axis : Axis
        With new results of its runs.
    by : str
        Who added them.
    runs : collection of int, optional
        Numbers of the runs that may be concerned; by default all of the axis.
    """
    found = select(RunRow, Exclusion.reason).join(Exclusion, Exclusion.run_id == RunRow.id)
    found = found.where(RunRow.axis_id == axis.id, Exclusion.ended_at.is_(None)).order_by(RunRow.id)
    for excluded, reason in session.execute(found).all():
        if runs is not None and excluded.id not in runs:
            continue
        is_part = reason.startswith(_PART)
        other = reason.removesuffix(_COUNTS).removeprefix(_PART if is_part else _BAD)
        counting = session.scalar(select(RunRow).where(RunRow.run == other))
        if counting is None or not reason.startswith((_PART, _BAD)):  # excluded for another reason
            continue
        excluded, counting = _newest(session, excluded), _newest(session, counting)
        part, whole = (excluded, counting) if is_part else (counting, excluded)
        if _part_counts(session, part, whole) == is_part:
            end_exclusions(session, excluded, "newer results have other verdicts.", by)
            exclude_parts(session, axis, excluded, by)


def is_part(session: Session, run: str) -> bool:
    """Whether a run is excluded because another with its recordings counts. Not of an event."""
    if session.scalar(select(RunRow.id).where(RunRow.run == run)) is None:
        return False
    reasons = [each.reason for each in standing_exclusions(session, find_run(session, run))]
    return any(reason.startswith((_PART, _BAD)) for reason in reasons)


def update_parts(session: Session, run: str, by: str) -> None:
    """Exclude the parts of a run that counts now, or include those of one that no longer does.

    Parameters
    ----------
    session : Session
        Writing.
    run : str
        Id of the run, after it was corrected, excluded or included; for an event nothing changes.
    by : str
        Who did that.
    """
    if session.scalar(select(RunRow.id).where(RunRow.run == run)) is None:
        return
    row = _newest(session, find_run(session, run))
    axis = session.get_one(Axis, row.axis_id)
    if row.id in {each.id for each in current_rows(session, axis)}:
        exclude_parts(session, axis, row, by)
    else:
        include_parts(session, axis, row, by)


def include_parts(session: Session, axis: Axis, whole: RunRow, by: str) -> None:
    """Include runs that were excluded for one that no longer counts, unless another of their runs does."""
    reasons = []
    for name in _names(session, whole):
        reasons += [_reason(_PART, name), _reason(_BAD, name)]
    found = select(RunRow).join(Exclusion, Exclusion.run_id == RunRow.id).order_by(RunRow.id)
    found = found.where(RunRow.axis_id == axis.id, Exclusion.ended_at.is_(None))
    parts = session.scalars(found.where(Exclusion.reason.in_(reasons))).all()
    for part in parts:
        end_exclusions(session, part, f"the run {whole.run} does not count.", by)
    for part in parts:
        exclude_parts(session, axis, _newest(session, part), by)


def _newest(session: Session, row: RunRow) -> RunRow:
    return session.scalars(select(RunRow).where(RunRow.run == newest_version(session, row))).all()[0]


def _sharing(session: Session, axis: Axis, run: RunRow) -> list[RunRow]:
    """Other runs of the axis with its load and a recording of a run; none unless both count."""
    recordings = select(RecordingRow.sha256).where(RecordingRow.run_id == run.id)
    others = select(RecordingRow.run_id).where(RecordingRow.sha256.in_(recordings))
    found = select(RunRow).where(RunRow.id.in_(others), RunRow.axis_id == axis.id, RunRow.id != run.id)
    sharing = session.scalars(found.order_by(RunRow.id)).all()
    if not sharing:
        return []
    counting = {row.id for row in current_rows(session, axis)}
    if run.id not in counting:
        return []
    return [row for row in sharing if row.id in counting and row.mass_kg == run.mass_kg]


def _excluded_of(session: Session, first: RunRow, second: RunRow) -> list[tuple[RunRow, str]]:
    """The one of two runs that does not count, and why; none unless one has all recordings of the other."""
    part, whole = sorted((first, second), key=lambda row: len(_recordings(session, row)))
    if not _recordings(session, part) < _recordings(session, whole):
        return []
    row, other, kind = part, whole, _PART
    if _part_counts(session, part, whole):
        row, other, kind = whole, part, _BAD
    if _is_included(session, row, other, kind):
        return []
    return [(row, _reason(kind, other.run))]


def _reason(kind: str, other: str) -> str:
    return f"{kind}{other}{_COUNTS}"


def _is_included(session: Session, run: RunRow, other: RunRow, kind: str) -> bool:
    """Whether a person included a run, excluded for this kind of reason, after another one was added."""
    included = _last_inclusion(session, run, kind)
    if included is None:
        return False
    subjects = [f"run {name}" for name in _names(session, other)]
    added = select(func.min(Audit.id)).where(Audit.action == "add", Audit.subject.in_(subjects))
    return included > (session.scalar(added) or 0)


def _last_inclusion(session: Session, run: RunRow, kind: str) -> int | None:
    """Number in the audit of a person's last inclusion of a run that was excluded for this kind of reason."""
    of_run = Exclusion.run_id.in_(run_versions(session, run))
    excluded = select(Exclusion.id).where(of_run, Exclusion.reason.startswith(kind))
    if session.scalars(excluded).first() is None:  # the audit is long
        return None
    found = select(Audit).where(Audit.subject.in_(_names(session, run)))
    found = found.where(Audit.action.in_(("exclude", "include"))).order_by(Audit.id)
    last = None
    for former, row in pairwise(session.scalars(found)):
        was_excluded = former.action == "exclude" and former.detail["reason"].startswith(kind)
        if was_excluded and row.action == "include" and row.detail.get("decided"):
            last = row.id
    return last


def _names(session: Session, run: RunRow) -> list[str]:
    """Ids of all versions of a run."""
    return list(session.scalars(select(RunRow.run).where(RunRow.id.in_(run_versions(session, run)))))


def _recordings(session: Session, run: RunRow) -> set[str]:
    return set(session.scalars(select(RecordingRow.sha256).where(RecordingRow.run_id == run.id)))


def _part_counts(session: Session, part: RunRow, whole: RunRow) -> bool:
    """Whether the part of two runs counts, since the history has a better result of it."""
    return _rank(session, part) > _rank(session, whole)


def _rank(session: Session, run: RunRow) -> int:
    """Rank of the result of a run in the history: good and suspect ones alike, bad ones, none."""
    result = used_result(session, session.get_one(Axis, run.axis_id), run.id)
    if result is None:
        return 0
    return 1 if result.verdict == "bad" else 2
