"""Two lamps of each axis: one of the machine, one of its measurement. No data is *unknown*."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, time, timedelta, tzinfo
from typing import Any

from sqlalchemy import and_, func, select
from sqlalchemy.orm import Session

from ballscrew.monitoring.epochs import BEGINS, moment
from ballscrew.store.alarms import standing_alarms
from ballscrew.store.tables import Axis, EventRow, Exclusion, Explanation, Setup, StateRow

URGENCY = {
    "alarm": 0, "unloaded": 0, "watch": 1, "suspect": 2, "unknown": 3, "not assessed": 4, "learning": 5,
    "normal": 6,
}  # fmt: skip
"""Order of states, the most urgent first."""

CLOCK_TOLERANCE = 300.0
"""Time by which a run may be measured after its receipt, s: clocks differ."""

_REMAINING = ("alarm", "unloaded", "watch", "suspect", "not assessed", "unknown")
_STALE = timedelta(days=31)  # age of the newest run beyond which an axis without a schedule is unknown


@dataclass(frozen=True)
class RunCalendar:
    """Days on which runs are expected.

    Parameters
    ----------
    weekdays : tuple of int
        Of these, Monday is 0; at least one.
    holidays : tuple of date
        Days on which none are expected besides.
    zone : tzinfo
        Time zone of these days.
    """

    weekdays: tuple[int, ...] = tuple(range(7))
    holidays: tuple[date, ...] = ()
    zone: tzinfo = UTC

    def after(self, begin: datetime, wait: timedelta) -> datetime:
        """Time at which a time after ``begin`` has passed, counted on these days alone, UTC."""
        if len(self.weekdays) == 7 and not self.holidays:
            return begin.astimezone(UTC) + wait
        begin, day = begin.astimezone(UTC), begin.astimezone(self.zone).date()
        while True:
            midnight = datetime.combine(day + timedelta(days=1), time(), self.zone).astimezone(UTC)
            if day.weekday() in self.weekdays and day not in self.holidays:
                if begin + wait < midnight:
                    return begin + wait
                wait -= midnight - begin
            begin, day = midnight, day + timedelta(days=1)


EVERY_DAY = RunCalendar()
"""Runs are expected on all days."""


def add_lamps(
    session: Session, documents: Sequence[dict[str, Any]], at: datetime, calendar: RunCalendar = EVERY_DAY
) -> None:
    """Add ``lamp``, ``measurement`` and ``due_at`` to documents of axes.

    ``measurement`` has the troubles that stand, whether the newest run is ``recent``, and ``because``: why it
    is not, or ``"bad"`` where it gives no number, also after its trouble was closed.

    Parameters
    ----------
    session : Session
        Reading.
    documents : sequence of dict
        Of axes, with their names, states and ``newest_at``.
    at : datetime
        The present time.
    calendar : RunCalendar
        Days on which runs are expected by a schedule.
    """
    numbers, unassessed = _axes(session)
    setups = {row.axis_id: row for row in session.scalars(select(Setup))}
    troubles: dict[str, list[dict[str, Any]]] = {}
    for each in reversed(standing_alarms(session)):
        if each["kind"] != "axis":
            trouble = {name: each[name] for name in ("id", "kind", "text", "began_at")}
            troubles.setdefault(each["axis"], []).append(trouble)
    refused = _refused(session)
    resets = _newest_resets(session)
    for document in documents:
        number = numbers[document["axis"]]
        setup = setups.get(number)
        is_future = _is_future(document["newest_at"], at)
        document["due_at"] = None if is_future else due_at(setup, document["newest_at"], calendar)
        because = "future" if is_future else _why_not_recent(document, setup, at, calendar)
        document["measurement"] = {
            "troubles": troubles.get(document["axis"], []),
            "recent": because is None,
            "because": because,
        }
        if because is None and number in refused:
            document["measurement"]["because"] = "bad"
        if because is None and number in unassessed:
            because = "set aside"
        if _is_reset(document["newest_at"], resets.get(number), at):
            because = "reset"
        document["lamp"] = _lamp(document["state"], because)


def _axes(session: Session) -> tuple[dict[str, int], set[int]]:
    """Number of each axis by its name, and the axes whose newest runs were set aside."""
    numbers, unassessed = {}, set()
    newest = and_(Explanation.axis_id == Axis.id, Explanation.assessment_id == Axis.assessment_id)
    found = select(Axis.name, Axis.id, Explanation.lamp).outerjoin(Explanation, newest)
    for name, number, state in session.execute(found):
        numbers[name] = number
        if state == "suspect":
            unassessed.add(number)
    return numbers, unassessed


def _refused(session: Session) -> set[int]:
    """Numbers of the axes whose newest run gives no number."""
    of_axis = select(StateRow.verdict).where(StateRow.axis_id == Axis.id)
    newest = of_axis.order_by(StateRow.time.desc(), StateRow.run_id.desc()).limit(1).scalar_subquery()
    return set(session.scalars(select(Axis.id).where(newest == "refused")))


def _newest_resets(session: Session) -> dict[int, float]:
    """Time of the newest event of each axis that begins a new baseline, s since 1970."""
    excluded = select(Exclusion.event_id).where(Exclusion.event_id.is_not(None), Exclusion.ended_at.is_(None))
    found = session.execute(
        select(EventRow.axis_id, func.max(EventRow.time))
        .where(EventRow.kind.in_(BEGINS), EventRow.id.not_in(excluded))
        .group_by(EventRow.axis_id)
    )
    return {number: time for number, time in found}  # noqa: C416  rows are no pairs to mypy


def _is_reset(newest: str | None, reset: float | None, at: datetime) -> bool:
    """Whether a new baseline has begun since the newest run."""
    if newest is None or reset is None:
        return False
    return moment(newest, "newest_at").timestamp() < reset <= at.timestamp()


def due_at(setup: Setup | None, newest: str | None, calendar: RunCalendar = EVERY_DAY) -> str | None:
    """Time at which the next run of an axis is due by its schedule; None without one."""
    if setup is None or setup.period_s is None:
        return None
    last = max(moment(each, "a run") for each in (newest, setup.set_up_at) if each is not None)
    return calendar.after(last, timedelta(seconds=setup.period_s)).isoformat()


def _is_future(newest: str | None, at: datetime) -> bool:
    """Whether the newest run is later than the present: its time shows neither its age nor the next run."""
    return newest is not None and moment(newest, "newest_at") > at + timedelta(seconds=CLOCK_TOLERANCE)


def _why_not_recent(
    document: dict[str, Any], setup: Setup | None, at: datetime, calendar: RunCalendar
) -> str | None:
    """Why the newest run of an axis does not show its present state; None where it does."""
    if document["newest_at"] is None:
        return "no run"
    if document["due_at"] is not None:
        grace = timedelta(seconds=(setup.grace_s or 0.0) if setup is not None else 0.0)
        limit, because = calendar.after(moment(document["due_at"], "due_at"), grace), "overdue"
    else:
        limit, because = moment(document["newest_at"], "newest_at") + _STALE, "old"
    return because if at > limit else None


def _lamp(state: str, because: str | None) -> dict[str, Any]:
    """State of the machine now: that of its newest assessment, or unknown without a recent one."""
    if because is None or (state in _REMAINING and because != "reset"):
        return {"state": state, "because": None}
    return {"state": "unknown", "because": because}
