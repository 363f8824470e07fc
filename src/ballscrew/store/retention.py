"""Which raw files may be moved or deleted, and their deletion by a policy."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.monitoring.epochs import moment
from ballscrew.store.folder import now
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.raw_files import path_of
from ballscrew.store.service_tables import Upload
from ballscrew.store.tables import AlarmRow, Axis, EpochRow, RawFile, RecordingRow, RunRow, StateRow

_MOST_DAYS = 36_500.0
_FINISHED = ("done", "conflict")  # uploads whose files wait for no analysis


@dataclass(frozen=True, slots=True)
class RetentionPolicy:
    """Which raw files stay, besides those of baselines and of runs at which an alarm began.

    Parameters
    ----------
    days : float
        Those of runs that were received in as many days.
    newest : int
        Those of as many newest runs of each axis.

    Raises
    ------
    InputError
        If a number is negative, or ``days`` above 36500.
    """

    days: float
    newest: int = 30

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (0 <= self.days <= _MOST_DAYS and self.newest >= 0):
            raise InputError(
                f"days is {self.days} and newest is {self.newest}; both must be 0 or more, and days at most "
                f"{_MOST_DAYS:.0f}."
            )


def retain(store: OpenStore, policy: RetentionPolicy, *, dry_run: bool = False) -> dict[str, Any]:
    """Delete the raw files that a policy does not keep; results stay, and are no longer reprocessed.

    An axis that was not assessed, or was changed since, keeps all of them: its baseline is not known. A file
    of several runs stays while one of them needs it. Rows are committed before files are removed; what a
    kill leaves behind, ``gc`` removes.

    Parameters
    ----------
    store : OpenStore
        The store.
    policy : RetentionPolicy
        What stays.
    dry_run : bool
        Whether nothing is deleted.

    Returns
    -------
    dict
        Document of ``store retain --json``.

    Raises
    ------
    InputError
        If the store is damaged or in use.
    """
    before = moment(now(), "now") - timedelta(days=policy.days)
    if dry_run:
        with store.read() as session:
            chosen = {axis.name: _deletable(session, axis, policy, before) for axis in _axes(session)}
            return _document(chosen, policy, dry_run=True)
    with store.write("store retain") as session:
        chosen = {axis.name: _deletable(session, axis, policy, before) for axis in _axes(session)}
        document = _document(chosen, policy, dry_run=False)
        paths = {}
        for name, rows in chosen.items():
            for row in rows:
                row.deleted_at = now()
                paths[row.sha256] = path_of(store.folder.files, row.sha256, row.compression)
            if rows:
                files = [row.sha256 for row in rows]
                record(
                    session, "delete", f"raw files of {name}", axis=name, files=files, policy=asdict(policy)
                )
    with store.write("store retain") as session:
        for sha256, path in paths.items():
            if not session.get_one(RawFile, sha256).is_stored:  # else it was added again
                path.unlink(missing_ok=True)
    return document


def _axes(session: Session) -> list[Axis]:
    return list(session.scalars(select(Axis).order_by(Axis.name)))


def _document(chosen: dict[str, list[RawFile]], policy: RetentionPolicy, *, dry_run: bool) -> dict[str, Any]:
    axes: list[dict[str, Any]] = []
    for name, rows in chosen.items():
        if rows:
            size = sum(row.stored_size for row in rows)
            axes.append({"axis": name, "files": [row.sha256 for row in rows], "bytes": size})
    total = sum(each["bytes"] for each in axes)
    return {"schema": SCHEMA, "dry_run": dry_run, "policy": asdict(policy), "axes": axes, "bytes": total}


def _deletable(session: Session, axis: Axis, policy: RetentionPolicy, before: datetime) -> list[RawFile]:
    """Raw files of an axis that a policy does not keep."""
    if axis.assessment_id is None or axis.changed_at is not None:
        return []
    return dispensable_files(session, axis, policy.newest, before)


def dispensable_files(
    session: Session, axis: Axis, newest: int, before: datetime | None = None
) -> list[RawFile]:
    """Raw files of an axis that are of no run whose raw files stay.

    Those stay of the newest runs, of runs that a baseline was learned from, of references, of runs at which
    an alarm began, and of uploads that wait for their analysis, of any axis.

    Parameters
    ----------
    session : Session
        Reading.
    axis : Axis
        The axis.
    newest : int
        Number of newest runs whose raw files stay.
    before : datetime, optional
        Raw files stay of runs that were received later.

    Returns
    -------
    list of RawFile
        Their rows.
    """
    rows = list(session.scalars(select(RunRow).where(RunRow.axis_id == axis.id)))
    rows.sort(key=_time)
    begun = set(session.scalars(select(AlarmRow.began_at).where(AlarmRow.axis_id == axis.id)))
    references = set(session.scalars(select(EpochRow.reference).where(EpochRow.axis_id == axis.id)))
    learned = select(StateRow.run_id).where(StateRow.axis_id == axis.id, StateRow.state == "learning")
    stay = set(session.scalars(learned))
    for place, row in enumerate(rows):
        is_young = before is not None and moment(row.received_at, "received_at") >= before
        if place >= len(rows) - newest or row.measured_at in begun or row.run in references or is_young:
            stay.add(row.id)
    needed = select(RecordingRow.sha256).join(RunRow, RunRow.id == RecordingRow.run_id)
    needed = needed.where((RunRow.axis_id != axis.id) | RunRow.id.in_(stay))
    own = select(RecordingRow.sha256).join(RunRow, RunRow.id == RecordingRow.run_id)
    files = select(RawFile).where(
        RawFile.is_stored,
        RawFile.sha256.in_(own.where(RunRow.axis_id == axis.id)),
        RawFile.sha256.not_in(needed),
    )
    waiting = _waiting_files(session)
    return [row for row in session.scalars(files.order_by(RawFile.sha256)) if row.sha256 not in waiting]


def _waiting_files(session: Session) -> set[str]:
    """Hashes of the files of all uploads that wait for their analysis."""
    found = set()
    for files in session.scalars(select(Upload.files).where(Upload.status.not_in(_FINISHED))):
        found |= {file["sha256"] for file in files or ()}
    return found


def _time(row: RunRow) -> tuple[float, str]:
    """Time of a run, or of its receipt where it has none, for its order."""
    received = moment(row.received_at, "received_at").timestamp()
    return (received if row.time is None else row.time, row.run)
