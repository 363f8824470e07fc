"""Analysis of stored raw files by the current method: new results beside the old, switched as a whole."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session, aliased

from ballscrew.base.files import Progress, ignore_progress
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.modal.analyze import AnalysisOptions
from ballscrew.modal.run import Run
from ballscrew.store import adding
from ballscrew.store.analysing import Task, analysed, check_workers
from ballscrew.store.changing import amend_result
from ballscrew.store.folder import actor
from ballscrew.store.inserting import insert_run
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.parts import recount_parts
from ballscrew.store.reading import find_axis, find_method
from ballscrew.store.rows import unpack
from ballscrew.store.switching import compare_results, find_target, stored_files, switch_axis
from ballscrew.store.tables import Axis, Document, Method, ResultRow, RunRow, Source


def reprocess(
    store: OpenStore,
    axes: Sequence[str] = (),
    *,
    method: str = "joint",
    workers: int = 1,
    scheduler: str | None = None,
    switch: bool = False,
    progress: Progress = ignore_progress,
) -> dict[str, Any]:
    """Analyse the stored raw files of axes by the current method, and compare the results with the old ones.

    A run that has such a result is not analysed again, so that an interrupted call goes on.

    Parameters
    ----------
    store : OpenStore
        The store.
    axes : sequence of str
        Names of the axes; by default all.
    method : {"joint", "paper"}
        Method of the analysis.
    workers : int
        Processes of this computer that analyse.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers analyse instead: on this computer, or ``tls://host:port``.
        The workers need this version, and the store's folder of raw files under the same path.
    switch : bool
        Whether the histories consist of the new results from now on.
    progress : callable
        Called after each run.

    Returns
    -------
    dict
        Document of ``reprocess --json``.

    Raises
    ------
    InputError
        If there is no such axis, an axis cannot be switched since runs have no new result, or the scheduler
        cannot be used.
    """
    check_workers(workers, scheduler)
    options = AnalysisOptions(method=method)
    with store.write("reprocess") as session:
        names = list(dict.fromkeys(axes)) or list(session.scalars(select(Axis.name).order_by(Axis.name)))
        for name in names:  # the history stays, however many new results there are
            _choose_method(session, find_axis(session, name))
        tasks, archived = _tasks(session, store, names, options)
    failures = []
    for done, (task, result) in enumerate(analysed(tasks, workers, scheduler), 1):
        if isinstance(result, str):
            failures.append(f"run {task.run[:12]}: {result}")
        else:
            _insert(store, unpack(result))
        progress(done, len(tasks), task.run[:12])
    with store.write("reprocess") as session:
        _amend_corrected(session, names, options)
        for name in names:
            recount_parts(session, find_axis(session, name), actor())
    with store.read() as session:
        compared = [compare_results(session, find_axis(session, name), options) for name in names]
    if switch:
        for document in compared:
            switch_axis(store, document["axis"], options)
            document["switched"] = True
    analyzed = len(tasks) - len(failures)
    for document in compared:
        if not document["switched"]:  # after a switch their former results count
            runs = archived[document["axis"]]
            failures += [f"run {run[:12]}: its raw files are archived or deleted" for run in runs]
    return {"schema": SCHEMA, "analyzed": analyzed, "failures": failures, "axes": compared}


def _choose_method(session: Session, axis: Axis) -> None:
    """Choose the method of the history of an axis, where none was chosen."""
    method = find_method(session, axis)
    if method is not None and axis.method_id is None:
        axis.method_id = method.id
        chosen = {"method": method.name, "revision": method.revision}
        record(session, "choose", f"axis {axis.name}", axis=axis.name, **chosen)


def _tasks(
    session: Session, store: OpenStore, names: Iterable[str], options: AnalysisOptions
) -> tuple[list[Task], dict[str, list[str]]]:
    """Runs without a result by the method: those with raw files, and of each axis those without."""
    target = find_target(session, options)
    done = set()
    if target is not None:
        done = set(session.scalars(select(ResultRow.run_id).where(ResultRow.method_id == target.id)))
    tasks: list[Task] = []
    archived: dict[str, list[str]] = {}
    for name in names:
        axis = find_axis(session, name)
        archived[name] = []
        found = session.execute(
            select(Source, RunRow)
            .join(RunRow, RunRow.id == Source.run_id)
            .where(RunRow.axis_id == axis.id)
            .order_by(RunRow.time, RunRow.run, Source.digest)
        ).all()
        for source, run in found:
            if run.id in done:
                continue
            done.add(run.id)
            files = stored_files(session, run, source.stated["files"])
            if files is None:
                archived[name].append(run.run)
            else:
                texts = {}
                for kind, key in source.stated["documents"].items():
                    texts[kind] = session.get_one(Document, key).text
                folder = str(store.folder.files.resolve())
                tasks.append(Task(run.run, folder, files, texts, source.stated, options.method))
    return tasks, archived


def _insert(store: OpenStore, document: dict[str, Any]) -> None:
    run = Run.from_json(document)
    with store.write("reprocess") as session:
        insert_run(session, run, adding.METHOD_REVISION)


def _amend_corrected(session: Session, names: Iterable[str], options: AnalysisOptions) -> None:
    """New results of corrected runs, by those of the runs as they were."""
    target = find_target(session, options)
    if target is None:
        return
    known = set(session.scalars(select(ResultRow.run_id).where(ResultRow.method_id == target.id)))
    former = aliased(RunRow)
    for name in names:
        pairs = (
            select(former, RunRow)
            .join(RunRow, RunRow.supersedes == former.run)
            .where(RunRow.axis_id == find_axis(session, name).id)
            .order_by(RunRow.id)  # a correction comes after what it corrects
        )
        for old, new in session.execute(pairs).all():
            if old.id in known and new.id not in known:
                _amend_like(session, old, new, target)
                known.add(new.id)


def _amend_like(session: Session, old: RunRow, new: RunRow, method: Method) -> None:
    """Result of a corrected run, by the same correction as before."""
    mass = None if new.mass_kg == old.mass_kg else new.mass_kg
    measured_at = new.measured_at
    if mass is not None and measured_at == old.measured_at:
        measured_at = None
    corrected = amend_result(session, old, method, measured_at=measured_at, mass=mass)
    insert_run(session, corrected, method.revision)
