"""Page of the fleet: a lamp for each axis, the worst first, and a year of its states."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from itertools import groupby
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse
from sqlalchemy import BigInteger, cast, select
from sqlalchemy.orm import Session

from ballscrew.service.access import RunningService, ViewerCaller
from ballscrew.service.pages.rendering import render
from ballscrew.service.reading import fleet_document
from ballscrew.store.alarms import standing_alarms
from ballscrew.store.lamps import URGENCY
from ballscrew.store.tables import Axis, StateRow

router = APIRouter(include_in_schema=False)

_WEEK, _WEEKS = 7 * 86400, 52
_WORST = {"alarm": 0, "unloaded": 0, "watch": 1, "suspect": 2, "learning": 3, "normal": 4}


@router.get("/")
def show_fleet(
    request: Request,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
) -> HTMLResponse:
    """Every axis with its lamps, the worst first; ``?part=rows`` gives the table alone."""
    axes = fleet_document(service)["axes"]
    begin = datetime.now(UTC) - timedelta(weeks=_WEEKS)
    with service.store.read() as session:
        strips = _strips(session, begin.timestamp())
        alarms = standing_alarms(session)
    for axis in axes:
        axis["strip"] = strips.get(axis["axis"], ())
    axes.sort(key=_by_urgency)
    template = "fleet.html"
    if request.query_params.get("part") == "rows":
        template = "fleet_rows.html"
    counts: dict[str, int] = {}
    for axis in axes:
        state = axis["lamp"]["state"]
        counts[state] = counts.get(state, 0) + 1
    ordered = sorted(counts.items(), key=lambda item: URGENCY[item[0]])
    return render(
        request, template, axes=axes, alarms=alarms, counts=ordered, weeks=_WEEKS, begin=begin.isoformat()
    )


def _by_urgency(axis: dict[str, Any]) -> tuple[Any, ...]:
    """Order of the page: by lamp, then measurement in trouble, then stiffness, then name."""
    stiffness = axis["stiffness"][0] if axis["stiffness"] else 1.0
    return URGENCY[axis["lamp"]["state"]], not axis["measurement"]["troubles"], stiffness, axis["axis"]


def _strips(session: Session, begin: float) -> dict[str, list[tuple[int, int, str]]]:
    """States of each axis by week: first week, number of weeks, worst state; by the name of the axis."""
    # Of whole seconds, since a cast of weeks rounds up in PostgreSQL, which also groups by a label alone.
    week = (cast(StateRow.time - begin, BigInteger) // _WEEK).label("week")
    found = session.execute(
        select(Axis.name, week, StateRow.state)
        .join(Axis, Axis.id == StateRow.axis_id)
        .where(StateRow.time >= begin)
        .group_by(Axis.name, "week", StateRow.state)
        .order_by(Axis.name, "week")
    )
    strips = {}
    for name, rows in groupby(found, key=lambda row: row[0]):
        strips[name] = _runs_of_weeks([(number, state) for _, number, state in rows])
    return strips


def _runs_of_weeks(rows: Sequence[tuple[int, str]]) -> list[tuple[int, int, str]]:
    """Successive weeks of the same worst state as one."""
    worst: dict[int, str] = {}
    for number, state in rows:
        if number not in worst or _WORST.get(state, 5) < _WORST.get(worst[number], 5):
            worst[number] = state
    found: list[tuple[int, int, str]] = []
    for number, state in sorted(worst.items()):
        if found and found[-1][2] == state and sum(found[-1][:2]) == number:
            found[-1] = found[-1][0], found[-1][1] + 1, state
        else:
            found.append((number, 1, state))
    return found
