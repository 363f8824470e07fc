"""What the store contains: axes, runs, models and methods by their names, the fleet, and trends."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from sqlalchemy import and_, func, select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError, shown
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.quantity import NORMAL_95
from ballscrew.store.opened import OpenStore
from ballscrew.store.tables import (
    Assessment,
    Axis,
    EpochRow,
    Exclusion,
    MachineRow,
    Method,
    Model,
    RecordingRow,
    ResultRow,
    RunRow,
    StateRow,
)

_NAMES = 5  # axes that a message lists


def find_axis(session: Session, name: str) -> Axis:
    """Row of an axis.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    row = session.scalar(select(Axis).where(Axis.name == name))
    if row is None:
        names = session.scalars(select(Axis.name).order_by(Axis.name).limit(_NAMES)).all()
        known = f"it has {', '.join(map(shown, names))}" if names else "it has none"
        raise InputError(f"the store has no axis {shown(name)}; {known}.")
    return row


def find_run(session: Session, beginning: str) -> RunRow:
    """Row of the run whose id begins with a text.

    Raises
    ------
    InputError
        If there is none, or more than one.
    """
    exact = session.scalar(select(RunRow).where(RunRow.run == beginning))
    if exact is not None:
        return exact
    matches = RunRow.run.startswith(beginning, autoescape=True)
    rows = session.scalars(select(RunRow).where(matches).limit(2)).all()
    if not beginning or not rows:
        raise InputError(f"the store has no run {shown(beginning)}; 'ballscrew store show AXIS' lists them.")
    if len(rows) > 1:
        raise InputError(
            f"the store has several runs whose id begins with {shown(beginning)}; give more of it."
        )
    return rows[0]


def find_method(session: Session, axis: Axis) -> Method | None:
    """Method of the results that are an axis' history.

    The one chosen; else the method and settings of the most runs, by its oldest revision: a new revision
    becomes the history only as a whole, by ``reprocess``.
    """
    if axis.method_id is not None:
        return session.get(Method, axis.method_id)
    found = session.execute(
        select(Method, func.count())
        .join(ResultRow, ResultRow.method_id == Method.id)
        .join(RunRow, RunRow.id == ResultRow.run_id)
        .where(RunRow.axis_id == axis.id)
        .group_by(Method.id)
        .order_by(Method.name, Method.settings_digest, Method.revision)
    ).all()
    totals: Counter[tuple[str, str]] = Counter()
    oldest: dict[tuple[str, str], Method] = {}
    for method, number in found:
        key = (method.name, method.settings_digest)
        totals[key] += number
        oldest.setdefault(key, method)
    if not totals:
        return None
    return oldest[max(oldest, key=totals.__getitem__)]


def find_model(session: Session, axis: Axis) -> Model:
    """Model of an axis: the one chosen, or the only one.

    Raises
    ------
    InputError
        If there is none, or several and none was chosen.
    """
    if axis.model_digest is not None:
        return session.get_one(Model, axis.model_digest)
    rows = session.scalars(select(Model).where(Model.axis_id == axis.id).order_by(Model.digest)).all()
    if not rows:
        raise InputError(
            f"the store has no model of the axis {shown(axis.name)}: 'ballscrew store add MODEL.json'."
        )
    if len(rows) > 1:
        digests = ", ".join(row.digest[:12] for row in rows)
        raise InputError(
            f"the store has {len(rows)} models of the axis {shown(axis.name)} ({digests}): choose one with "
            "'ballscrew store correct AXIS --model'."
        )
    return rows[0]


def run_rows(session: Session, axis: int) -> Sequence[Any]:
    """Rows of the runs of an axis, by its number, in time order."""
    columns = (
        RunRow.id, RunRow.run, RunRow.measured_at, RunRow.time, RunRow.mass_kg, RunRow.temperature_C,
        RunRow.supersedes,
    )  # fmt: skip
    found = select(*columns).where(RunRow.axis_id == axis).order_by(RunRow.time, RunRow.run)
    return session.execute(found).all()


def current_rows(session: Session, axis: Axis, rows: Sequence[Any] | None = None) -> list[Any]:
    """Rows of the runs of an axis in time order, without those that were corrected or excluded."""
    if rows is None:
        rows = run_rows(session, axis.id)
    excluded = session.scalars(
        select(RunRow.run)
        .join(Exclusion, Exclusion.run_id == RunRow.id)
        .where(RunRow.axis_id == axis.id, Exclusion.ended_at.is_(None))
    )
    former = {row.run: row.supersedes for row in rows}
    newest = _newest_versions(rows, former)
    for run in excluded:  # an exclusion of any version of a run is one of the run
        newest.pop(_first_version(run, former), None)
    counting = {row.id for row in newest.values()}
    return [row for row in rows if row.id in counting]


def _newest_versions(rows: Sequence[Any], former: Mapping[str, str | None]) -> dict[str, Any]:
    """Row of each run by the id of its first version: of several corrections the one that was added last."""
    superseded = set(former.values())
    newest: dict[str, Any] = {}
    for row in rows:
        first = _first_version(row.run, former)
        if row.run not in superseded and (first not in newest or row.id > newest[first].id):
            newest[first] = row
    return newest


def _first_version(run: str, former: Mapping[str, str | None]) -> str:
    """Id of the run that a run is a correction of, or its own."""
    return list(_versions(run, former))[-1]


def _versions(run: str, former: Mapping[str, str | None]) -> Iterable[str]:
    """Ids of a run before and after its corrections."""
    found: dict[str, None] = {}
    version: str | None = run
    while version is not None and version not in found:
        found[version] = None
        version = former.get(version)
    return found


def run_versions(session: Session, row: RunRow) -> list[int]:
    """Numbers of a run and of all its corrections, earlier and later."""
    rows = run_rows(session, row.axis_id)
    former = {each.run: each.supersedes for each in rows}
    first = _first_version(row.run, former)
    return [each.id for each in rows if first in _versions(each.run, former)]


def newest_version(session: Session, row: RunRow) -> str:
    """Id of the correction of a run that was added last and is not corrected itself; else its own."""
    numbers = run_versions(session, row)
    versions = session.scalars(select(RunRow).where(RunRow.id.in_(numbers)).order_by(RunRow.id)).all()
    superseded = {each.supersedes for each in versions}
    found = row.run
    for each in versions:
        if each.run not in superseded:
            found = each.run
    return found


def shared_recordings(session: Session, axis: Axis, rows: Sequence[Any]) -> list[tuple[str, str, str]]:
    """Pairs of runs that are made of the same recording, which would count twice.

    Parameters
    ----------
    session : Session
        Reading.
    axis : Axis
        Row of the axis.
    rows : sequence of Row
        Rows of the runs that count.

    Returns
    -------
    list of (run, run, name)
        Ids of both, by time, and name of the first recording that they share.
    """
    of_axis = select(RecordingRow.sha256).join(RunRow, RunRow.id == RecordingRow.run_id)
    of_axis = of_axis.where(RunRow.axis_id == axis.id)
    repeated = of_axis.group_by(RecordingRow.sha256).having(func.count() > 1)
    columns = (RecordingRow.run_id, RecordingRow.sha256, RecordingRow.name)
    recordings = select(*columns).join(RunRow, RunRow.id == RecordingRow.run_id)
    recordings = recordings.where(RunRow.axis_id == axis.id, RecordingRow.sha256.in_(repeated))
    files: dict[int, list[tuple[str, str]]] = {}
    for number, sha256, name in session.execute(recordings.order_by(RecordingRow.place)):
        files.setdefault(number, []).append((sha256, name))
    owner: dict[str, str] = {}
    pairs: dict[tuple[str, str], str] = {}
    for row in rows:
        for sha256, name in files.get(row.id, []):
            other = owner.setdefault(sha256, row.run)
            if other != row.run:
                pairs.setdefault((other, row.run), name)
    return [(first, second, name) for (first, second), name in pairs.items()]


def list_axes(store: OpenStore) -> dict[str, Any]:
    """The fleet: each axis with its place, its number of runs, and its state by the newest assessment.

    Parameters
    ----------
    store : OpenStore
        The store.

    Returns
    -------
    dict
        Document of ``store list --json``.
    """
    with store.read() as session:
        newest = newest_runs(session)
        found = session.execute(
            select(Axis, MachineRow.site, MachineRow.name, Assessment)
            .outerjoin(MachineRow, MachineRow.id == Axis.machine_id)
            .outerjoin(Assessment, Assessment.id == Axis.assessment_id)
            .order_by(MachineRow.site, MachineRow.name, Axis.name)
        ).all()
    axes = []
    for axis, site, machine, assessment in found:
        row = {"axis": axis.name, "site": site or None, "machine": machine, "runs": axis.runs}
        axes.append(row | assessment_document(assessment, axis.changed_at, newest.get(axis.id)))
    return {"schema": SCHEMA, "axes": axes}


def newest_runs(session: Session, axis: Axis | None = None) -> dict[int, tuple[str, str]]:
    """Id and time of the newest run that counts of each axis, or of one, by the number of the axis."""
    of_axis = () if axis is None else (RunRow.axis_id == axis.id,)
    last = select(RunRow.axis_id, func.max(RunRow.time).label("time")).where(*of_axis)
    newest = last.group_by(RunRow.axis_id).subquery()
    is_newest = and_(RunRow.axis_id == newest.c.axis_id, RunRow.time == newest.c.time)
    runs = select(RunRow.axis_id, RunRow.run, RunRow.measured_at).join(newest, is_newest).order_by(RunRow.run)
    found = {number: (run, str(time)) for number, run, time in session.execute(runs)}
    excluded = select(RunRow.axis_id).join(Exclusion, Exclusion.run_id == RunRow.id)
    excluded = excluded.where(Exclusion.ended_at.is_(None), *of_axis)
    corrected = select(RunRow.axis_id).where(RunRow.supersedes.is_not(None), *of_axis)
    for number in set(session.scalars(excluded.union(corrected))):
        timed = [row for row in current_rows(session, session.get_one(Axis, number)) if row.time is not None]
        found.pop(number, None)
        if timed:
            found[number] = (timed[-1].run, timed[-1].measured_at)
    return found


def assessment_document(
    row: Assessment | None, changed_at: str | None, newest: tuple[str, str] | None
) -> dict[str, Any]:
    """State and forecast of an axis; unknown where it was not assessed since its history has changed.

    ``newest_at`` is the time of its newest run that counts, ``assessed_until`` that of its newest assessed
    one.
    """
    document: dict[str, Any] = {"state": "unknown", "urgency": "unknown", "changed_at": changed_at}
    document["newest_run"], document["newest_at"] = newest or (None, None)
    if row is None:
        unknown = dict.fromkeys(("last_state", "assessed_at", "assessed_until", "alarm_at", "stiffness"))
        state = {"state": "not assessed", "urgency": "not assessed"}
        return document | unknown | state | {"rul_days": {}, "reasons": []}
    if changed_at is None:
        document |= {"state": row.state, "urgency": row.urgency}
    return document | {
        "last_state": row.state,
        "assessed_at": row.made_at,
        "assessed_until": row.newest_at,
        "alarm_at": row.alarm_at,
        "stiffness": row.stiffness,
        "rul_days": row.rul_days,
        "reasons": row.reasons or [],
    }


def trend(session: Session, axis: Axis) -> dict[int, dict[str, Any]]:
    """State of each run of an axis, with P/P₀ relative to the baseline of its epoch.

    Parameters
    ----------
    session : Session
        Reading.
    axis : Axis
        Row of the axis.

    Returns
    -------
    dict of int to dict
        By the number of the run's row: state and, as value and 95 % interval, stiffness and nut.
    """
    epochs = {}
    for epoch in session.scalars(select(EpochRow).where(EpochRow.axis_id == axis.id)):
        epochs[epoch.number] = epoch
    columns = (
        StateRow.run_id, StateRow.epoch, StateRow.state, StateRow.nut, StateRow.nut_low, StateRow.nut_high,
        StateRow.level, StateRow.random, StateRow.systematic, StateRow.unknown_temperature, StateRow.design,
    )  # fmt: skip
    found = session.execute(
        select(*columns).where(StateRow.axis_id == axis.id).order_by(StateRow.time, StateRow.run_id)
    ).all()
    states: dict[int, dict[str, Any]] = {}
    charted: dict[int, list[Any]] = {number: [] for number in epochs}
    for row in found:
        number, epoch_of_run, state, nut, low, high, *_, design = row
        interval = None if nut is None else [nut, low, high]
        states[number] = {"state": state, "epoch": epoch_of_run, "stiffness": None, "nut": interval}
        if design is not None:
            charted[epoch_of_run].append(row)
    for number, rows in charted.items():
        if rows:
            for row, stiffness in zip(rows, relative_stiffness(rows, epochs[number]), strict=True):
                states[row[0]]["stiffness"] = stiffness
    return states


def relative_stiffness(rows: Sequence[Any], epoch: EpochRow) -> list[list[float] | None]:
    """P/P₀ of charted runs by the baseline of their epoch: value and both ends of the 95 % interval.

    As :func:`ballscrew.monitoring.health.health_state` computes it, from rows.
    """
    *_, level, random, systematic, unknown, designs = zip(*rows, strict=True)
    design = np.frombuffer(b"".join(designs), "<f8").reshape(len(rows), -1)
    level, random, systematic, unknown = np.array([level, random, systematic, unknown], dtype=np.float64)
    coefficients, covariance = np.array(epoch.coefficients), np.array(epoch.covariance)
    u = 1 + level
    # Not by BLAS: for products this small its threads take longer than the sums.
    steps = np.einsum("ni,i->n", design[:, 1:], coefficients[1:])
    root = (1 / u + steps) / (1 - coefficients[0])
    by_baseline = np.einsum("ni,ij,nj->n", design, covariance, design)
    scale = 0.0 if epoch.scale is None else epoch.scale
    variance = (scale * random) ** 2 + unknown**2 + by_baseline
    variance += (epoch.share_uncertainty * root * np.abs(1 - root)) ** 2 + (systematic / u**2) ** 2
    half = NORMAL_95 * np.sqrt(variance)
    found: list[list[float] | None] = []
    for middle, width, compliance in zip(root.tolist(), half.tolist(), u.tolist(), strict=True):
        if not (middle > 0 and compliance > 0 and math.isfinite(width)):
            found.append(None)
        else:
            found.append([middle**3, max(middle - width, 0.0) ** 3, (middle + width) ** 3])
    return found
