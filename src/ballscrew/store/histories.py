"""Runs, events and model from which the history of an axis is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew._version import __version__
from ballscrew.base.errors import InputError, shown
from ballscrew.base.jsonfile import plain
from ballscrew.base.provenance import digest
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.modelfile import model_from_json
from ballscrew.modal.run import Run
from ballscrew.monitoring.checkpoint import CHECKPOINT_SCHEMA, Checkpoint
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import Event
from ballscrew.store.methods import UsedResult, method_events, used_results
from ballscrew.store.reading import current_rows, find_axis, find_method, find_model, shared_recordings
from ballscrew.store.rows import batched, unpack
from ballscrew.store.tables import Axis, CheckpointRow, EventRow, Exclusion, Method, ResultRow

_SETTINGS = 16  # characters of a digest


@dataclass(frozen=True)
class StoredHistory:
    """What the history of an axis is made from.

    Parameters
    ----------
    axis : Axis
        Its row.
    method : Method
        Of the results; those of runs without raw files may be by a former one.
    model_digest : str
        Digest of the model.
    model : CalibratedAxis
        The model.
    runs : tuple of Run
        In time order, without excluded, corrected and untimed ones, and without those of the checkpoint.
    newest : Run
        The newest of all.
    checkpoint : Checkpoint or None
        Of the runs before these.
    rows : dict of str to int
        Number of the row of each run of the history, by id.
    prefixes : tuple of str
        Key of the first, the first two, ... runs with all that follows from these, see :func:`settings_of`.
    events : tuple of Event
        By time, without excluded ones.
    key : str
        Digest of what it is made from, see :func:`history_key`.
    missing : int
        Runs without a result by the method.
    untimed : int
        Runs without a time.
    """

    axis: Axis
    method: Method
    model_digest: str
    model: CalibratedAxis
    runs: tuple[Run, ...]
    newest: Run
    checkpoint: Checkpoint | None
    rows: dict[str, int]
    prefixes: tuple[str, ...]
    events: tuple[Event, ...]
    key: str
    missing: int
    untimed: int


def read_stored_history(
    session: Session, name: str, settings: MonitorSettings | None = None
) -> StoredHistory:
    """Read what the history of an axis is made from.

    Parameters
    ----------
    session : Session
        Reading.
    name : str
        Name of the axis.
    settings : MonitorSettings, optional
        Of the detection: runs of the newest stored checkpoint by these are not read.

    Returns
    -------
    StoredHistory
        It does not depend on the order in which its parts were added.

    Raises
    ------
    InputError
        If there is no such axis, it has no model or no run, or two of its runs share a recording.
    """
    axis = find_axis(session, name)
    model = find_model(session, axis)
    method = find_method(session, axis)
    current = current_rows(session, axis)
    timed = [row for row in current if row.time is not None]
    results = used_results(session, axis)
    usable = [row for row in timed if row.id in results]
    if method is None or not usable:
        raise InputError(f"the store has no run of the axis {shown(name)} with a time.")
    _check_recordings(session, axis, usable)
    events = _with_changes(current_events(session, axis), usable, results)
    prefixes = _prefixes(usable, results, events, model.digest, settings)
    checkpoint, start = _newest_checkpoint(session, axis, usable, prefixes)
    # The newest run is read in any case.
    first = min(start, len(usable) - 1)
    documents = result_documents(session, [results[row.id].row for row in usable[first:]])
    runs = [
        Run.from_json(unpack(documents[results[row.id].row]), f"run {row.run[:12]}") for row in usable[first:]
    ]
    return StoredHistory(
        axis=axis,
        method=method,
        model_digest=model.digest,
        model=model_from_json(unpack(model.document), f"model {model.digest[:12]}"),
        runs=tuple(runs[start - first :]),
        newest=runs[-1],
        checkpoint=checkpoint,
        rows={row.run: row.id for row in usable},
        prefixes=prefixes,
        events=events,
        key=history_key(session, axis),
        missing=len(timed) - len(usable),
        untimed=len(current) - len(timed),
    )


def _check_recordings(session: Session, axis: Axis, rows: Sequence[Any]) -> None:
    """Check that no recording counts twice."""
    shared = shared_recordings(session, axis, rows)
    if shared:
        earlier, later, recording = shared[0]
        raise InputError(
            f"the runs {earlier[:12]} and {later[:12]} of the axis {shown(axis.name)} are made of the same "
            f"recording, {shown(recording)}, which would count twice: exclude one of them ('ballscrew store "
            f"exclude'); 'ballscrew store show' lists all {len(shared)} such pairs."
        )


def _prefixes(
    rows: Sequence[Any],
    results: Mapping[int, UsedResult],
    events: Sequence[Event],
    model: str,
    settings: MonitorSettings | None,
) -> tuple[str, ...]:
    """Key of each beginning of a history: its runs and results, the events until then, model and settings."""
    if settings is None:
        return ()
    stated = digest(plain(asdict(settings), 17))
    basis = digest([model, stated, __version__, CHECKPOINT_SCHEMA])
    times = [event.when.timestamp() for event in events]
    past, count = "", 0
    keys = []
    for row in rows:  # by time, as the events
        while count < len(events) and times[count] <= row.time:
            past = digest([past, events[count].at, events[count].effect])
            count += 1
        basis = digest([basis, row.run, results[row.id].checksum])
        keys.append(f"{stated[:_SETTINGS]}-{digest([basis, past])}")
    return tuple(keys)


def settings_of(key: str) -> str:
    """Settings of the detection of a checkpoint, by its key: the beginning of their digest."""
    return key[:_SETTINGS]


def _newest_checkpoint(
    session: Session, axis: Axis, rows: Sequence[Any], prefixes: Sequence[str]
) -> tuple[Checkpoint | None, int]:
    """Newest stored checkpoint that the history still begins with, and the number of its runs."""
    stored = session.execute(
        select(CheckpointRow.key, CheckpointRow.runs)
        .where(CheckpointRow.axis_id == axis.id, CheckpointRow.runs <= len(prefixes))
        .order_by(CheckpointRow.runs.desc())
    )
    for key, count in stored.all():
        last = count == len(rows) or rows[count].time > rows[count - 1].time
        if last and prefixes[count - 1] == key:
            row = session.get_one(CheckpointRow, (axis.id, key))
            with suppress(InputError):  # a damaged one is made again
                return Checkpoint.from_bytes(row.document), count
    return None, 0


def result_documents(session: Session, results: Sequence[int]) -> dict[int, bytes]:
    """RUN.json, packed, of results by the numbers of their rows."""
    documents: dict[int, bytes] = {}
    for batch in batched(results):
        found = session.execute(select(ResultRow.id, ResultRow.document).where(ResultRow.id.in_(batch)))
        documents.update((number, document) for number, document in found)
    return documents


def history_key(session: Session, axis: Axis) -> str:
    """Digest of what the history of an axis is made from, without reading its documents."""
    results, runs = used_results(session, axis), list[tuple[str, int | None]]()
    for row in current_rows(session, axis):
        result = results.get(row.id)
        runs.append((row.run, None if result is None else result.checksum))
    events = [(event.at, event.effect, event.text) for event in axis_events(session, axis)]
    return digest({"runs": runs, "events": events, "model": find_model(session, axis).digest})


def axis_events(session: Session, axis: Axis) -> tuple[Event, ...]:
    """Events on an axis by time, without excluded ones, and changes of the method of its runs."""
    results = used_results(session, axis)
    rows = [row for row in current_rows(session, axis) if row.time is not None and row.id in results]
    return _with_changes(current_events(session, axis), rows, results)


def _with_changes(
    events: Sequence[Event], rows: Sequence[Any], results: Mapping[int, UsedResult]
) -> tuple[Event, ...]:
    """Events, and changes of the method of runs in time order, by time."""
    return tuple(sorted([*events, *method_events(rows, results)], key=lambda event: event.when))


def current_events(session: Session, axis: Axis) -> tuple[Event, ...]:
    """Events on an axis by time, without excluded ones."""
    excluded = select(Exclusion.event_id).where(Exclusion.event_id.is_not(None), Exclusion.ended_at.is_(None))
    rows = session.scalars(
        select(EventRow)
        .where(EventRow.axis_id == axis.id, EventRow.id.not_in(excluded))
        .order_by(EventRow.time, EventRow.digest)
    )
    return tuple(Event(row.at, row.kind, row.text) for row in rows)
