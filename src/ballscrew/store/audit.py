"""The audit: what was done to the store, by whom, from where, with values before and after."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Select, and_, or_, select
from sqlalchemy.orm import Session

from ballscrew.base.result import not_executed
from ballscrew.store.tables import Audit, Axis, EventRow, RunRow

COLUMNS = ("id", "at", "by", "from", "action", "subject", "changed", "detail")
"""Of the exports."""

_BATCH = 500  # rows in memory
_OWN = ("by", "from", "changed", "after")  # fields of a row that are columns, and the checksum before it


@dataclass(frozen=True, slots=True)
class AuditFilter:
    """Which rows of the audit are meant; an empty text stands for all.

    Parameters
    ----------
    axis : str
        Name of an axis.
    by : str
        Who did it.
    action : str
        What was done.
    before : int or None
        Only rows with lower numbers.
    """

    axis: str = ""
    by: str = ""
    action: str = ""
    before: int | None = None


def audit_rows(session: Session, chosen: AuditFilter, most: int | None = None) -> Iterator[dict[str, Any]]:
    """Rows of the audit, the newest first.

    Parameters
    ----------
    session : Session
        Reading.
    chosen : AuditFilter
        Which.
    most : int, optional
        How many at most.

    Yields
    ------
    dict
        A row, with ``changed`` as pairs of the value before and after.
    """
    found = select(Audit).order_by(Audit.id.desc())
    if most is not None:
        found = found.limit(most)
    for row in session.scalars(_filtered(found, chosen).execution_options(yield_per=_BATCH)):
        yield {
            "id": row.id,
            "at": row.at,
            "by": row.detail.get("by", row.actor),
            "from": row.detail.get("from"),
            "action": row.action,
            "subject": row.subject,
            "changed": row.detail.get("changed") or {},
            "detail": {name: value for name, value in row.detail.items() if name not in _OWN},
        }
        session.expunge(row)


def _filtered(found: Select[Any], chosen: AuditFilter) -> Select[Any]:
    if chosen.before is not None:
        found = found.where(Audit.id < chosen.before)
    if chosen.action:
        found = found.where(Audit.action == chosen.action)
    if chosen.by:
        stated = Audit.detail["by"].as_string()
        found = found.where(or_(stated == chosen.by, and_(stated.is_(None), Audit.actor == chosen.by)))
    if chosen.axis:
        found = found.where(_of_axis(chosen.axis))
    return found


def _of_axis(axis: str) -> Any:
    """Condition that a row is about an axis; those of earlier versions name it in the subject alone."""
    of_axis = select(Axis.id).where(Axis.name == axis).scalar_subquery()
    runs = select(RunRow.run).where(RunRow.axis_id == of_axis)
    named = select("run " + RunRow.run).where(RunRow.axis_id == of_axis)
    events = select(EventRow.digest).where(EventRow.axis_id == of_axis)
    return or_(
        Audit.detail["axis"].as_string() == axis,
        Audit.subject.in_((f"axis {axis}", f"assess {axis}")),
        Audit.subject.endswith(f" of {axis}", autoescape=True),
        Audit.subject.in_(runs),
        Audit.subject.in_(named),
        Audit.subject.in_(events),
    )


def audit_csv(rows: Iterator[dict[str, Any]]) -> Iterator[str]:
    """Rows as CSV; a cell that a spreadsheet would execute begins with an apostrophe."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        cells = []
        for name in COLUMNS:
            value = row[name]
            if isinstance(value, dict):
                value = json.dumps(value, ensure_ascii=False, sort_keys=True)
            cells.append(not_executed(value))
        writer.writerow(cells)
        yield stream.getvalue()
        stream.seek(0)
        stream.truncate()
    yield stream.getvalue()


def audit_lines(rows: Iterator[dict[str, Any]]) -> Iterator[str]:
    """Rows as JSON, one on each line."""
    for row in rows:
        yield json.dumps(row) + "\n"
