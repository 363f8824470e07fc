"""Results that are the history of an axis: those of its method, and former ones of runs without raw files.

Where an axis was switched to another method and the raw files of runs were gone, these keep their former
results. Wherever the method changes from one run to the next, there is an event with the estimated step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.monitoring.epochs import METHOD_CHANGED, Event
from ballscrew.store.reading import find_method
from ballscrew.store.tables import Axis, Method, MethodChange, ResultRow, RunRow


@dataclass(frozen=True, slots=True)
class UsedMethod:
    """A method whose results are in a history.

    Parameters
    ----------
    method : Method
        Its row.
    step, variance : float
        Of the relative change of the nut's compliance, from its results to those of the newest.
    runs : int
        By which the newest of these steps was estimated; 0 for the newest method.
    """

    method: Method
    step: float = 0.0
    variance: float = 0.0
    runs: int = 0


@dataclass(frozen=True, slots=True)
class UsedResult:
    """The result of a run that counts in a history.

    Parameters
    ----------
    row : int
        Number of its row.
    verdict : str
        Of the measurement.
    checksum : int
        Of its row.
    used : UsedMethod
        Its method.
    """

    row: int
    verdict: str
    checksum: int
    used: UsedMethod


def used_methods(session: Session, axis: Axis) -> list[UsedMethod]:
    """Methods of a history, the newest first; none for an axis without a result."""
    method = find_method(session, axis)
    if method is None:
        return []
    methods = [UsedMethod(method)]
    changes = select(MethodChange).where(MethodChange.axis_id == axis.id)
    former = {change.new_method_id: change for change in session.scalars(changes)}
    while (change := former.pop(methods[-1].method.id, None)) is not None:
        later = methods[-1]
        methods.append(
            UsedMethod(
                session.get_one(Method, change.old_method_id),
                later.step + change.step,
                later.variance + change.step_uncertainty**2,
                change.runs,
            )
        )
    return methods


def used_results(session: Session, axis: Axis) -> dict[int, UsedResult]:
    """Result of each run of an axis that counts, by the number of the run's row."""
    results: dict[int, UsedResult] = {}
    columns = (ResultRow.run_id, ResultRow.id, ResultRow.verdict, ResultRow.checksum)
    for used in used_methods(session, axis):
        found = (
            select(*columns)
            .join(RunRow, RunRow.id == ResultRow.run_id)
            .where(RunRow.axis_id == axis.id, ResultRow.method_id == used.method.id)
        )
        for run, row, verdict, checksum in session.execute(found):
            results.setdefault(run, UsedResult(row, verdict, checksum, used))
    return results


def used_result(session: Session, axis: Axis, run: int) -> ResultRow | None:
    """Result of a run that counts in the history of its axis; None where none does."""
    for used in used_methods(session, axis):
        found = select(ResultRow).where(ResultRow.run_id == run, ResultRow.method_id == used.method.id)
        result = session.scalar(found)
        if result is not None:
            return result
    return None


def method_events(rows: Sequence[Any], results: Mapping[int, UsedResult]) -> list[Event]:
    """Events at the runs from which on the results are those of another method.

    Parameters
    ----------
    rows : sequence of Row
        Of the runs of a history, in time order.
    results : mapping of int to UsedResult
        Result of each.

    Returns
    -------
    list of Event
        By time; empty where all are by one method.
    """
    events = []
    for before, row in pairwise(rows):
        old, new = results[before.id].used, results[row.id].used
        if old.method.id != new.method.id:
            events.append(_change_event(str(row.measured_at), old, new))
    return events


def _change_event(at: str, old: UsedMethod, new: UsedMethod) -> Event:
    step, uncertainty = old.step - new.step, math.sqrt(abs(old.variance - new.variance))
    name, revisions = new.method.name, f"revision {new.method.revision} after {old.method.revision}"
    effect = describe_step(step, uncertainty)
    return Event(at, METHOD_CHANGED, f"{name}, {revisions}: {effect}", step, uncertainty)


def describe_step(step: float, uncertainty: float) -> str:
    """Step of the nut's compliance as the change of a whole preload that looks the same, P ~ compliance⁻³."""
    return f"as {-300 * step:+.2f} % ± {300 * uncertainty:.2f} % of the preload"
