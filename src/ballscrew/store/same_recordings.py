"""Runs that are made of the same recordings: a recording is part of one run that counts, of one axis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError, shown
from ballscrew.modal.amend import SUPERSEDES
from ballscrew.modal.run import Run
from ballscrew.monitoring.epochs import moment
from ballscrew.store.reading import current_rows, run_versions
from ballscrew.store.rows import batched, unpack
from ballscrew.store.tables import Axis, RecordingRow, ResultRow, RunRow

_BELONGS = " belongs to the run "


class SameRecordingError(InputError):
    """A run has a recording of another run, which counts."""


@dataclass(frozen=True, slots=True)
class RecordedRun:
    """A run by its recordings.

    Parameters
    ----------
    name : str
        Its id, or its key before its analysis.
    axis : str
        Name of its axis.
    files : mapping of str to str
        Name of each recording by its hash.
    measured_at : str or None
        Its time, ISO 8601; None where it is not known.
    mass_kg : float or None
        Load on the table.
    channels : str or None
        Digest of its channel map; None where it is not known.
    analysed : bool
        Whether ``name`` is its id.
    supersedes : str or None
        Id of the run that it corrects.
    """

    name: str
    axis: str
    files: Mapping[str, str]
    measured_at: str | None
    mass_kg: float | None
    channels: str | None
    analysed: bool = True
    supersedes: str | None = None

    @classmethod
    def of(cls, run: Run, axis: str) -> RecordedRun:
        """The analysed run of an axis."""
        inputs = run.made.inputs
        files = {file.sha256: file.name for file in run.files}
        return cls(
            run.id, axis, files, run.measured_at, run.mass_kg, inputs.get("channels"),
            supersedes=inputs.get(SUPERSEDES),
        )  # fmt: skip

    def check(self, other: RecordedRun) -> None:
        """Check that this run may count beside another.

        It may if one has all recordings of the other and more, of the same load: the more complete one then
        counts. Two axes may be recorded in the same file by different channels. Before its analysis, a run
        may be the other one.

        Raises
        ------
        SameRecordingError
            If it may not.
        """
        shared = self.files.keys() & other.files.keys()
        if not shared or self._may_stand_beside(other):
            return
        name = next(name for sha256, name in self.files.items() if sha256 in shared)
        raise SameRecordingError(f"the recording {shown(name)}{_BELONGS}{other._sentence(self.axis)}")

    def _may_stand_beside(self, other: RecordedRun) -> bool:
        """Whether this run and another one may both be in the store."""
        if self.axis != other.axis:
            channels = (self.channels, other.channels)
            return None not in channels and self.channels != other.channels
        if not self._has_load_of(other):
            return False
        mine, others = set(self.files), set(other.files)
        if mine < others or others < mine:
            return True
        return not (self.analysed and other.analysed) and self._may_have_time_of(other)

    def _has_load_of(self, other: RecordedRun) -> bool:
        if self.mass_kg is None or other.mass_kg is None:
            return self.mass_kg == other.mass_kg
        return math.isclose(self.mass_kg, other.mass_kg, rel_tol=1e-8)

    def _may_have_time_of(self, other: RecordedRun) -> bool:
        """Whether two times are equal or not known."""
        if self.measured_at is None or other.measured_at is None:
            return True
        return moment(self.measured_at, "measured_at") == moment(other.measured_at, "measured_at")

    def _sentence(self, axis: str) -> str:
        """Name of this run, to which a recording belongs, and what to do before it is part of another one."""
        name = shown(self.name[:12] if self.analysed else self.name)
        time = "without a time" if self.measured_at is None else f"of {self.measured_at}"
        if axis != self.axis:
            return (
                f"{name} {time} of the axis {shown(self.axis)} already: send the recordings of "
                f"the axis {shown(axis)}, or first exclude that run if its axis is wrong ('ballscrew store "
                "exclude')."
            )
        return (
            f"{name} {time} already: if its time or load is wrong, correct that run ('ballscrew store "
            "correct'); if this one is to take its place, exclude that run first ('ballscrew store "
            "exclude', or the page of the axis)."
        )


def check_recordings(session: Session, new: RecordedRun) -> None:
    """Check that a new run may count beside those of the store that count.

    Parameters
    ----------
    session : Session
        Reading.
    new : RecordedRun
        A run that the store does not have.

    Raises
    ------
    SameRecordingError
        If it may not.
    """
    for other in _sharing(session, new):
        new.check(other)


def is_same_recording(error: str | None) -> bool:
    """Whether a sentence is that of a :class:`SameRecordingError`."""
    return error is not None and _BELONGS in error


def _sharing(session: Session, new: RecordedRun) -> Iterator[RecordedRun]:
    """Runs that count and have a recording of a new one, which neither corrects them nor is corrected."""
    found = select(RunRow, Axis).join(Axis, Axis.id == RunRow.axis_id).order_by(RunRow.id)
    rows: dict[int, tuple[RunRow, Axis]] = {}
    for files in batched(list(new.files)):
        of_files = select(RecordingRow.run_id).where(RecordingRow.sha256.in_(files))
        for row, axis in session.execute(found.where(RunRow.id.in_(of_files))):
            rows[row.id] = row, axis
    if not rows:
        return
    versions = _versions(session, new)
    for row, axis in rows.values():
        counting = {each.id for each in current_rows(session, axis)}
        if row.id in counting - versions:
            newest = select(ResultRow).where(ResultRow.run_id == row.id).order_by(ResultRow.id.desc())
            result = session.scalars(newest.limit(1)).all()[0]
            yield RecordedRun.of(Run.from_json(unpack(result.document), "a run of the store"), axis.name)


def _versions(session: Session, new: RecordedRun) -> set[int]:
    """Numbers of the runs that a new one corrects, or that correct it."""
    if not new.analysed:
        return set()
    names = [new.name, *filter(None, [new.supersedes])]
    versions: set[int] = set()
    for row in session.scalars(
        select(RunRow).where(or_(RunRow.run.in_(names), RunRow.supersedes.in_(names)))
    ):
        versions.update(run_versions(session, row))
    return versions
