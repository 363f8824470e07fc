"""Two lamps of each axis, of the machine and of its measurement, and what to do. No data is *unknown*."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import and_, func, select
from sqlalchemy.orm import Session

from ballscrew.base.reasons import coded
from ballscrew.monitoring.epochs import BEGINS, moment
from ballscrew.report.what_to_do import what_to_do
from ballscrew.store.alarms import standing_alarms, to_close
from ballscrew.store.calendars import EVERY_DAY, RunCalendar, calendar_of
from ballscrew.store.explaining import stored_advice
from ballscrew.store.rows import batched
from ballscrew.store.service_tables import JobRow, Setup, Upload
from ballscrew.store.tables import Axis, EventRow, Exclusion, Explanation, ResultRow, RunRow, StateRow

URGENCY = {
    "alarm": 0, "unloaded": 0, "watch": 1, "suspect": 2, "unknown": 3, "not assessed": 4, "learning": 5,
    "normal": 6,
}  # fmt: skip
"""Order of states, the most urgent first."""

CLOCK_TOLERANCE = 300.0
"""Time by which a run may be measured after its receipt, s: clocks differ."""

_REMAINING = ("alarm", "unloaded", "watch", "suspect", "not assessed", "unknown")
_STALE = timedelta(days=31)  # age of the newest run beyond which an axis without a schedule is unknown


def add_lamps(
    session: Session, documents: Sequence[dict[str, Any]], at: datetime, calendar: RunCalendar = EVERY_DAY
) -> None:
    """Add ``lamp``, ``measurement``, ``due_at``, ``waiting`` and ``to_do`` to documents of axes.

    ``lamp`` is the state by the assessed runs, also while further ones wait. ``measurement`` has the troubles
    that stand, whether the newest run is ``recent``, and ``because``: why it is not, or ``"bad"`` where it
    gives no number, also after its trouble was closed. ``waiting`` is the number of runs that wait for their
    analysis or assessment, None where nothing waits. ``to_do`` is a list of sentences with their codes and
    parameters, see :func:`~ballscrew.report.what_to_do.what_to_do`.

    Parameters
    ----------
    session : Session
        Reading.
    documents : sequence of dict
        Of axes, as :func:`ballscrew.store.reading.assessment_document` has them, with their names.
    at : datetime
        The present time.
    calendar : RunCalendar
        That of an axis whose schedule states no other.
    """
    numbers, unassessed = _axes(session)
    setups = {row.axis_id: row for row in session.scalars(select(Setup))}
    standing = _standing(session)
    bad = _bad_runs(session, [document["newest_run"] for document in documents])
    resets, waiting = _newest_resets(session), _waiting(session, documents)
    advice = stored_advice(session, [document["axis"] for document in documents])
    for document in documents:
        name = document["axis"]
        number, alarms = numbers[name], standing.get(name, [])
        setup = setups.get(number)
        document["waiting"] = waiting.get(name)
        because, document["due_at"] = _why_not_recent(document["newest_at"], setup, at, calendar)
        _add_measurement(document, alarms, because, is_bad=document["newest_run"] in bad)
        if document["assessed_until"] != document["newest_at"]:
            because, _ = _why_not_recent(document["assessed_until"], setup, at, calendar)
        if because is None and number in unassessed:
            because = "set aside"
        if _is_reset(document["assessed_until"], resets.get(number), at):
            because = "reset"
        document["lamp"] = _lamp(_known_state(document), because)
        closing = to_close(alarms, _known_state(document))
        document["to_do"] = coded_actions(document, [*closing, *advice.get(name, ())], at)


def _add_measurement(
    document: dict[str, Any], alarms: Sequence[dict[str, Any]], because: str | None, *, is_bad: bool
) -> None:
    """Add ``measurement`` to the document of an axis."""
    recent = because is None
    if recent and is_bad:
        because = "bad"
    document["measurement"] = {"troubles": _troubles(alarms), "recent": recent, "because": because}


def coded_actions(document: dict[str, Any], advice: Sequence[str], at: datetime) -> list[dict[str, Any]]:
    """What to do on an axis with lamps, as sentences with their codes and parameters."""
    return [coded(sentence) for sentence in what_to_do(document, advice, at)]


def _known_state(document: dict[str, Any]) -> str:
    """State of an axis; while the assessment of its changed history waits, that before."""
    state = document["state"]
    if document["waiting"] is not None and document["changed_at"] is not None:
        state = document["last_state"] or state
    return str(state)


def _standing(session: Session) -> dict[str, list[dict[str, Any]]]:
    """Alarms and troubles that stand, the oldest first, by the name of the axis."""
    found: dict[str, list[dict[str, Any]]] = {}
    for each in reversed(standing_alarms(session)):
        found.setdefault(each["axis"], []).append(each)
    return found


def _troubles(standing: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    of_measurement = (each for each in standing if each["kind"] != "axis")
    return [{name: each[name] for name in ("id", "kind", "text", "began_at")} for each in of_measurement]


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


def _bad_runs(session: Session, runs: Sequence[str | None]) -> set[str]:
    """Those runs that give no number: by the newest result, or by the assessment."""
    found: set[str] = set()
    known = [run for run in runs if run is not None]
    for names in batched(known):
        batch = RunRow.run.in_(names)
        results = select(RunRow.run, ResultRow.verdict).join(ResultRow, ResultRow.run_id == RunRow.id)
        for run, verdict in session.execute(results.where(batch).order_by(ResultRow.id)):
            found.discard(run)  # by an earlier result
            if verdict == "bad":
                found.add(run)
        refused = select(RunRow.run).join(StateRow, StateRow.run_id == RunRow.id)
        found.update(session.scalars(refused.where(batch, StateRow.verdict == "refused")))
    return found


def _waiting(session: Session, documents: Sequence[dict[str, Any]]) -> dict[str, int]:
    """Number of runs that wait for their analysis or assessment, by the name of an axis with jobs."""
    jobs = select(JobRow.kind, JobRow.argument).where(JobRow.set_aside.is_(False))
    assess = {argument for kind, argument in session.execute(jobs) if kind == "assess"}
    found = dict.fromkeys(assess, 0)
    for document in documents:
        if document["axis"] in assess:
            since = (Axis.name == document["axis"], RunRow.received_at > (document["assessed_at"] or ""))
            runs = select(func.count()).select_from(RunRow).join(Axis, Axis.id == RunRow.axis_id)
            found[document["axis"]] = int(session.scalar(runs.where(*since)) or 0)
    sent = select(Axis.name, func.count(Upload.content.distinct())).join(Upload, Upload.axis_id == Axis.id)
    sent = sent.join(JobRow, JobRow.argument == Upload.content).group_by(Axis.name)
    sent = sent.where(JobRow.kind == "analyse", JobRow.set_aside.is_(False), Upload.status == "queued")
    for name, number in session.execute(sent):
        found[name] = found.get(name, 0) + number
    return found


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


def _is_future(newest: str | None, at: datetime) -> bool:
    """Whether the newest run is later than the present: its time shows neither its age nor the next run."""
    return newest is not None and moment(newest, "newest_at") > at + timedelta(seconds=CLOCK_TOLERANCE)


def _why_not_recent(
    newest: str | None, setup: Setup | None, at: datetime, server: RunCalendar
) -> tuple[str | None, str | None]:
    """Why the newest run of an axis does not show its present state, or None; when the next one is due."""
    if _is_future(newest, at):
        return "future", None
    expected = _expected(setup, newest, server)
    due = None if expected is None else expected[0].isoformat()
    if newest is None:
        return "no run", due
    limit, because = moment(newest, "newest_at") + _STALE, "old"
    if expected is not None:
        limit, because = expected[1], "overdue"
    return because if at > limit else None, due


def _expected(
    setup: Setup | None, newest: str | None, server: RunCalendar
) -> tuple[datetime, datetime] | None:
    """When the next run of an axis is due by its schedule, and from when it is overdue; None without one."""
    if setup is None or setup.period_s is None:
        return None
    calendar = calendar_of(setup, server)
    last = max(moment(each, "a run") for each in (newest, setup.set_up_at) if each is not None)
    due = calendar.after(last, timedelta(seconds=setup.period_s))
    return due, calendar.after(due, timedelta(seconds=setup.grace_s or 0.0))


def _lamp(state: str, because: str | None) -> dict[str, Any]:
    """State of the machine now: that of its newest assessment, or unknown without a recent one."""
    if because is None or (state in _REMAINING and because != "reset"):
        return {"state": state, "because": None}
    return {"state": "unknown", "because": because}
