"""What was found after alarms: precision and lead time of each rule, axis and machine."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import sqrt
from statistics import median
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.monitoring.epochs import moment
from ballscrew.store.service_tables import AlarmAction
from ballscrew.store.tables import AlarmRow, Axis, MachineRow, RunRow, StateRow

CONFIRMED, OTHER, NOTHING = "preload loss", "another cause", "nothing found"
"""What is found by an inspection; another cause is stored as ``another cause: CAUSE``."""

_INSPECTED = (CONFIRMED, OTHER, NOTHING)
_RULES = ("ramp", "odds")
_Z = 1.959963984540054  # of a 95 % interval
_DAY = 86400.0


def stored_finding(finding: str, cause: str) -> str:
    """Finding as it is stored.

    Parameters
    ----------
    finding : str
        One of these.
    cause : str
        Which other cause; needed with another cause alone.

    Raises
    ------
    InputError
        If the cause is missing, or stated with another finding.
    """
    if (finding == OTHER) != bool(cause.strip()):
        raise InputError("cause is which other cause was found: give it with that finding, and no other.")
    return f"{finding}: {cause.strip()}" if finding == OTHER else finding


def split_finding(stored: str | None) -> tuple[str | None, str | None]:
    """Finding and other cause of what is stored; None where nothing is stated."""
    if stored is None:
        return None, None
    finding, _, cause = stored.partition(": ")
    return finding, cause or None


def precision(confirmed: int, inspected: int) -> list[float] | None:
    """Fraction of the inspected alarms that were confirmed, with its 95 % interval by Wilson's method.

    Parameters
    ----------
    confirmed, inspected : int
        Numbers of alarms.

    Returns
    -------
    list of float or None
        Value and both ends; None where no alarm was inspected, which is too few for any statement.
    """
    if inspected == 0:
        return None
    part, square = confirmed / inspected, _Z**2 / inspected
    middle = (part + square / 2) / (1 + square)
    half = sqrt(square * (part * (1 - part) + square / 4)) / (1 + square)
    return [part, max(0.0, middle - half), min(1.0, middle + half)]


def summarise(alarms: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Counts of alarms, precision, and lead time in days as median, least and greatest.

    Parameters
    ----------
    alarms : sequence of mapping
        Each with ``closed_at``, ``finding`` and ``lead_days``.

    Returns
    -------
    dict
        ``precision`` and ``lead_days`` are None where no alarm was inspected or confirmed.
    """
    closed = [alarm for alarm in alarms if alarm["closed_at"] is not None]
    stated = [alarm["finding"] for alarm in closed]
    inspected = sum(map(stated.count, _INSPECTED))
    confirmed = stated.count(CONFIRMED)
    leads = [alarm["lead_days"] for alarm in closed if alarm["lead_days"] is not None]
    lead_days = None
    if leads:
        lead_days = [median(leads), min(leads), max(leads)]
    return {
        "alarms": len(alarms),
        "closed": len(closed),
        "inspected": inspected,
        "confirmed": confirmed,
        "another_cause": stated.count(OTHER),
        "nothing_found": stated.count(NOTHING),
        "not_inspected": len(closed) - inspected,
        "precision": precision(confirmed, inspected),
        "lead_days": lead_days,
    }


def findings_document(session: Session) -> dict[str, Any]:
    """Findings after the alarms of all axes, and what they say about each rule, machine and axis.

    Troubles with measurements do not count. An alarm that was reopened has no finding.

    Parameters
    ----------
    session : Session
        Reading.

    Returns
    -------
    dict
        As ``GET /api/v1/findings`` answers.
    """
    alarms = _alarms(session)
    return {
        "schema": SCHEMA,
        "all": summarise(alarms),
        "rules": _groups(alarms, "rule"),
        "machines": _groups(alarms, "machine"),
        "axes": _groups(alarms, "axis"),
        "alarms": alarms,
    }


def _groups(alarms: Iterable[Mapping[str, Any]], field: str) -> list[dict[str, Any]]:
    """Summary of the alarms of each value of a field, by its name; an unknown one last."""
    found: dict[str | None, list[Mapping[str, Any]]] = {}
    for alarm in alarms:
        found.setdefault(alarm[field], []).append(alarm)
    names = sorted(found, key=lambda name: (name is None, name or ""))
    return [{field: name, **summarise(found[name])} for name in names]


def _alarms(session: Session) -> list[dict[str, Any]]:
    """Every alarm with its rule and its finding, the newest first."""
    closings: dict[int, AlarmAction] = {}
    taken = select(AlarmAction).where(AlarmAction.alarm_id.is_not(None)).order_by(AlarmAction.id)
    for action in session.scalars(taken):
        assert action.alarm_id is not None  # noqa: S101
        closings.pop(action.alarm_id, None)
        if action.action == "closed":
            closings[action.alarm_id] = action
    rules = _rules(session)
    rows = session.execute(
        select(AlarmRow, Axis, MachineRow)
        .join(Axis, Axis.id == AlarmRow.axis_id)
        .outerjoin(MachineRow, MachineRow.id == Axis.machine_id)
        .order_by(AlarmRow.raised_at.desc(), AlarmRow.id.desc())
    )
    found = []
    for alarm, axis, machine in rows:
        closing = closings.get(alarm.id)
        finding, cause = split_finding(None if closing is None else closing.finding)
        document: dict[str, Any] = {
            "id": f"alarm-{alarm.id}",
            "axis": axis.name,
            "machine": _machine_name(machine),
            "rule": rules.get(alarm.id),
            "began_at": alarm.began_at,
            "raised_at": alarm.raised_at,
            "retracted_at": alarm.retracted_at,
            "closed_at": None if closing is None else closing.at,
            "finding": finding,
            "cause": cause,
            "lead_days": None,
        }
        if closing is not None and finding == CONFIRMED:
            waited = moment(closing.at, "at") - moment(alarm.raised_at, "raised_at")
            document["lead_days"] = waited.total_seconds() / _DAY
        found.append(document)
    return found


def _machine_name(machine: MachineRow | None) -> str | None:
    if machine is None:
        return None
    return f"{machine.site}: {machine.name}" if machine.site else machine.name


def _rules(session: Session) -> dict[int, str]:
    """Statistic that exceeded its limit where each alarm began, ``ramp``, ``odds`` or ``ramp and odds``.

    An alarm that was retracted may have none any more.
    """
    begun = (RunRow.axis_id == AlarmRow.axis_id) & (RunRow.measured_at == AlarmRow.began_at)
    rows = session.execute(
        select(AlarmRow.id, StateRow).join(RunRow, begun).join(StateRow, StateRow.run_id == RunRow.id)
    )
    found = {}
    for alarm, state in rows:
        exceeded = []
        for name in _RULES:
            value, limit = getattr(state, name), getattr(state, f"{name}_limit")
            if value is not None and limit is not None and value > limit:
                exceeded.append(name)
        if exceeded:
            found[alarm] = " and ".join(exceeded)
    return found
