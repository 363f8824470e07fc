"""The switch of an axis to the results of another method, and the difference that it makes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from sqlalchemy import select
from sqlalchemy.orm import Session, aliased

from ballscrew.base.errors import InputError, shown
from ballscrew.base.jsonfile import plain
from ballscrew.base.provenance import digest
from ballscrew.calibration.modelfile import model_from_json
from ballscrew.modal.analyze import AnalysisOptions
from ballscrew.modal.run import Run
from ballscrew.monitoring.method_step import LEAST_RUNS, MethodStep, method_step
from ballscrew.store import adding
from ballscrew.store.folder import actor, now
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.parts import recount_parts
from ballscrew.store.reading import current_rows, find_axis, find_method, find_model, run_versions
from ballscrew.store.rows import batched, unpack
from ballscrew.store.tables import (
    Axis,
    CellRow,
    Correction,
    Method,
    MethodChange,
    RawFile,
    RecordingRow,
    ResultRow,
    RunRow,
    Source,
)

_MOST_PAIRS = 100  # runs from which a step is estimated


def find_target(session: Session, options: AnalysisOptions) -> Method | None:
    """Row of the method, settings and revision of the new results."""
    return session.scalar(
        select(Method).where(
            Method.name == options.method,
            Method.settings_digest == digest(plain(options.to_settings())),
            Method.revision == adding.METHOD_REVISION,
        )
    )


def stored_files(
    session: Session, run: RunRow, hashes: Sequence[str]
) -> tuple[tuple[str, str, str], ...] | None:
    """Name, hash and compression of each recording; None if one is not in the store."""
    names = {}
    for row in session.scalars(select(RecordingRow).where(RecordingRow.run_id == run.id)):
        names[row.sha256] = row.name
    files = []
    for sha256 in hashes:
        file = session.get(RawFile, sha256)
        if file is None or not file.is_stored:
            return None
        files.append((names[sha256], sha256, file.compression))
    return tuple(files)


def compare_results(session: Session, axis: Axis, options: AnalysisOptions) -> dict[str, Any]:
    """Difference between the new results of an axis and those of its history."""
    old, new = find_method(session, axis), find_target(session, options)
    document: dict[str, Any] = {"axis": axis.name, "switched": False, "runs": 0, "missing": 0}
    document |= {"cells": 0, "median_change": None, "largest_change": None, "verdict_changes": 0}
    document |= {"without_files": 0, "step": None}
    if old is None or new is None:
        return document
    document["switched"] = old.id == new.id
    document["old"] = {"method": old.name, "revision": old.revision}
    document["new"] = {"method": new.name, "revision": new.revision}
    missing = _missing(session, axis, new)
    document["missing"] = len(missing)
    if document["switched"]:
        return document
    document["without_files"] = len(_without_files(session, axis, missing))
    if document["without_files"]:
        step = _step(session, axis, old, new)
        document["step"] = None if step is None else asdict(step)
    before, after = aliased(ResultRow), aliased(ResultRow)
    pairs = (
        select(before, after)
        .join(after, after.run_id == before.run_id)
        .join(RunRow, RunRow.id == before.run_id)
        .where(RunRow.axis_id == axis.id, before.method_id == old.id, after.method_id == new.id)
    )
    changes: list[float] = []
    for former, current in session.execute(pairs):
        document["runs"] += 1
        document["verdict_changes"] += former.verdict != current.verdict
        changes += _relative_changes(_cells(session, former), _cells(session, current))
    document["cells"] = len(changes)
    if changes:
        document["median_change"] = float(np.median(np.abs(changes)))
        document["largest_change"] = float(np.max(np.abs(changes)))
    return document


def _cells(session: Session, result: ResultRow) -> dict[tuple[float, str, int], float]:
    """Frequencies of the cells that have one."""
    cells = {}
    for cell in session.scalars(select(CellRow).where(CellRow.result_id == result.id)):
        if cell.frequency_Hz is not None:
            cells[cell.position_m, cell.condition, cell.motion] = cell.frequency_Hz
    return cells


def _relative_changes(before: dict[Any, float], after: dict[Any, float]) -> list[float]:
    return [after[key] / before[key] - 1 for key in before.keys() & after.keys()]


def _missing(session: Session, axis: Axis, target: Method) -> list[Any]:
    """Runs of the history without a result by a method."""
    known = set(session.scalars(select(ResultRow.run_id).where(ResultRow.method_id == target.id)))
    return [row for row in current_rows(session, axis) if row.id not in known]


def _without_files(session: Session, axis: Axis, rows: Sequence[Any]) -> list[Any]:
    """Those of the runs of an axis whose raw files are not all in the store."""
    all_rows = {row.id: row for row in session.scalars(select(RunRow).where(RunRow.axis_id == axis.id))}
    with_files = set()
    sources = select(Source).join(RunRow, RunRow.id == Source.run_id).where(RunRow.axis_id == axis.id)
    for source in session.scalars(sources):
        if stored_files(session, all_rows[source.run_id], source.stated["files"]) is not None:
            with_files.add(source.run_id)
    return [row for row in rows if not with_files & {*run_versions(session, all_rows[row.id])}]


def _step(session: Session, axis: Axis, old: Method, new: Method) -> MethodStep | None:
    """Step from the results of one method to those of another, by the newest good runs that have both."""
    if old.name != new.name:  # which a history cannot compare
        return None
    try:
        model = find_model(session, axis)
    except InputError:
        return None
    pairs = _results_by_both(session, axis, old, new)
    return method_step(pairs, model_from_json(unpack(model.document), f"model {model.digest[:12]}"))


def _results_by_both(session: Session, axis: Axis, old: Method, new: Method) -> list[tuple[Run, Run]]:
    """Good results of the newest runs of a history by each of two methods."""
    numbers = [row.id for row in current_rows(session, axis)]
    before, after = (_good_results(session, method, numbers) for method in (old, new))
    pairs = []
    for number in [number for number in numbers if number in before and number in after][-_MOST_PAIRS:]:
        rows = [session.get_one(ResultRow, results[number]) for results in (before, after)]
        former, current = (Run.from_json(unpack(row.document)) for row in rows)
        pairs.append((former, current))
    return pairs


def _good_results(session: Session, method: Method, runs: Sequence[int]) -> dict[int, int]:
    """Number of the result of each run that a method calls good."""
    results: dict[int, int] = {}
    for batch in batched(runs):
        found = select(ResultRow.run_id, ResultRow.id).where(
            ResultRow.run_id.in_(batch), ResultRow.method_id == method.id, ResultRow.verdict == "good"
        )
        results.update((run, row) for run, row in session.execute(found))
    return results


def switch_axis(store: OpenStore, name: str, options: AnalysisOptions) -> None:
    """Make the new results of an axis its history, all of them or none.

    Runs whose raw files are gone keep their former results, and the step between the two is estimated.

    Raises
    ------
    InputError
        If a run of the history has raw files and no new result, or the step cannot be estimated.
    """
    with store.write("reprocess") as session:
        axis = find_axis(session, name)
        target, old = find_target(session, options), find_method(session, axis)
        if target is None or old is None:
            raise _not_switched(name, "its runs have no new result")
        if axis.method_id == target.id:
            return
        step = _step_over_missing(session, axis, old, target)
        session.add(
            Correction(
                subject=f"axis {name}",
                field="method",
                old=f"{old.name}, revision {old.revision}",
                new=f"{target.name}, revision {target.revision}",
                reason="reprocess --switch",
                actor=actor(),
                at=now(),
            )
        )
        detail: dict[str, Any] = {"axis": name, "method": target.name, "revision": target.revision}
        detail["changed"] = {"method": [old.name, target.name], "revision": [old.revision, target.revision]}
        if step is not None:
            detail["step"] = asdict(step)
            if not _add_change(session, axis, old, target, step):
                detail["replaced"] = True  # the step of an earlier switch
        axis.method_id, axis.changed_at = target.id, now()
        record(session, "switch", f"axis {name}", **detail)
        session.flush()
        recount_parts(session, axis, actor())


def _step_over_missing(session: Session, axis: Axis, old: Method, new: Method) -> MethodStep | None:
    """Step that runs without a new result need; None where all have one."""
    missing = _missing(session, axis, new)
    if not missing:
        return None
    number = f"{len(missing)} runs have no new result"
    if len(_without_files(session, axis, missing)) < len(missing):
        raise _not_switched(axis.name, number)
    step = _step(session, axis, old, new)
    if step is None:
        raise _not_switched(
            axis.name,
            f"{number} and no raw files, and the step to the new results cannot be estimated, which takes a "
            f"model and {LEAST_RUNS} good runs with both results",
        )
    return step


def _add_change(session: Session, axis: Axis, old: Method, new: Method, step: MethodStep) -> bool:
    """Add the step of an axis to a method; False where it replaces that of an earlier switch of the same."""
    changes = select(MethodChange).where(
        MethodChange.axis_id == axis.id, MethodChange.new_method_id == new.id
    )
    change = session.scalar(changes)
    is_new = change is None
    if change is None:
        change = MethodChange(axis_id=axis.id, old_method_id=old.id, new_method_id=new.id)
        session.add(change)
    elif change.old_method_id != old.id:
        former = session.get_one(Method, change.old_method_id)
        raise _not_switched(
            axis.name,
            f"runs without raw files have no result of revision {new.revision}, to which it was switched "
            f"before, from revision {former.revision} and not {old.revision}",
        )
    change.step, change.step_uncertainty, change.runs = step.value, step.standard_uncertainty, step.runs
    change.changed_at = now()
    return is_new


def _not_switched(name: str, why: str) -> InputError:
    return InputError(
        f"the axis {shown(name)} is not switched: {why}; 'store exclude' them first, or leave the axis as "
        "it is."
    )
