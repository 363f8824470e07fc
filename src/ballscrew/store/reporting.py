"""Report of an axis or of all axes of a store, as one HTML file or as PDF."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError, shown
from ballscrew.base.files import Progress, check_folder, ignore_progress, write_text
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.prognosis.monitor import Monitored
from ballscrew.report.blocks import short_name
from ballscrew.report.canvas import check_target
from ballscrew.report.fleet_blocks import report_blocks, urgency_of
from ballscrew.report.page import html_report
from ballscrew.report.pdf_pages import write_pdf
from ballscrew.report.stored_axis import StoredAxis, state_words
from ballscrew.store.alarms import ENDED, alarm_documents, to_close
from ballscrew.store.assessing import newest_assessment
from ballscrew.store.calendars import EVERY_DAY, RunCalendar
from ballscrew.store.explaining import explanation, find_explanation
from ballscrew.store.folder import check_outside_stores
from ballscrew.store.lamps import add_lamps, coded_actions
from ballscrew.store.opened import OpenStore
from ballscrew.store.reading import find_axis
from ballscrew.store.rows import named_columns
from ballscrew.store.showing import axis_document
from ballscrew.store.tables import Assessment, Axis, EpochRow, MachineRow

_HTML, _PDF = (".html", ".htm"), ".pdf"
_ASSESS = (
    "Assess it by its present history and this version, which also draws its picture and states its causes: "
    "'ballscrew monitor AXIS --store DIR'."
)
_EPOCH = "SOURCE_DATE_EPOCH"
_MADE = ("inputs", "made_at", "version", "model_digest", "settings", "runs")
_EPOCH_COLUMNS = ("number", "begins", "ends", "cause", "reference", "alarm_at")


def report(
    store: OpenStore,
    axis: str | None = None,
    *,
    out: str | Path,
    at: datetime | None = None,
    calendar: RunCalendar = EVERY_DAY,
    progress: Progress = ignore_progress,
) -> dict[str, Any]:
    """Write a report of an axis, or of all axes with the worst first.

    The store is only read, also while it is served.

    Parameters
    ----------
    store : OpenStore
        The store.
    axis : str, optional
        Name of the axis; by default all.
    out : path-like
        File to write, whole or not at all: HTML that loads no other file, or PDF. A PDF of all axes has an
        overview, and pages of the axes that need attention.
    at : datetime, optional
        Time by which a run is overdue; by default now, or that of the environment's SOURCE_DATE_EPOCH. The
        same store and time give the same file.
    calendar : RunCalendar
        That of an axis whose schedule states no other.
    progress : callable
        Called after each axis.

    Returns
    -------
    dict
        Document of ``report --json``.

    Raises
    ------
    InputError
        If there is no such axis, the file cannot be written, its name does not end with .html, .htm or .pdf,
        or matplotlib is not installed, for PDF.
    """
    path = Path(out)
    _check(path)
    at = at or _now()
    with store.read() as session:
        names = [find_axis(session, axis).name] if axis is not None else _names(session)
    axes = []
    for number, name in enumerate(names):
        axes.append(_read(store, name, at, calendar))
        progress(number + 1, len(names), short_name(name))
    axes.sort(key=urgency_of)
    is_pdf, is_fleet = path.suffix.lower() == _PDF, axis is None
    blocks = report_blocks(axes, at, fleet=is_fleet, brief=is_fleet and is_pdf)
    title = "State of the axes" if axis is None else short_name(axis)
    pages = None
    if is_pdf:
        pages = write_pdf(path, f"{title}, {at:%Y-%m-%d %H:%M} UTC", blocks, progress)
    else:
        write_text(path, html_report(title, blocks))
    states = []
    for each in axes:
        words = state_words(each).words
        states.append({"axis": each.name, "state": each.document["state"], "shown": words})
    return {"schema": SCHEMA, "report": str(path), "at": at.isoformat(), "pages": pages, "axes": states}


def _check(path: Path) -> None:
    """Check that a report can be written, before the work."""
    suffix = path.suffix.lower()
    if suffix not in (*_HTML, _PDF):
        raise InputError(f"{path}: the name of a report must end in {', '.join((*_HTML, _PDF))}.")
    check_folder(path)
    check_outside_stores(path.parent)
    if suffix == _PDF:
        check_target(path)


def _now() -> datetime:
    """The present, to the minute."""
    stated = os.environ.get(_EPOCH)
    try:
        now = datetime.now(UTC) if stated is None else datetime.fromtimestamp(float(stated), UTC)
    except (ValueError, OverflowError, OSError):
        raise InputError(f"{_EPOCH} is {shown(stated)}; it must be seconds since 1970.") from None
    return now.replace(second=0, microsecond=0)


def _names(session: Session) -> list[str]:
    return list(session.scalars(select(Axis.name).order_by(Axis.name)))


def _read(store: OpenStore, name: str, at: datetime, calendar: RunCalendar) -> StoredAxis:
    """What a store has about an axis, of one moment."""
    with store.read() as session:
        row = find_axis(session, name)
        document = axis_document(session, row)
        place: tuple[str, ...] = ()
        if row.machine_id is not None:
            machine = session.get_one(MachineRow, row.machine_id)
            place = tuple(filter(None, (machine.name, machine.site)))
        made: dict[str, Any] = {}
        if row.assessment_id is not None:
            assessment = session.get_one(Assessment, row.assessment_id)
            made = named_columns(assessment, *_MADE)
        add_lamps(session, [document], at, calendar)
        explained = find_explanation(session, row)
        alarms = alarm_documents(session, row)
        epochs = session.scalars(select(EpochRow).where(EpochRow.axis_id == row.id).order_by(EpochRow.number))
        found = tuple(named_columns(epoch, *_EPOCH_COLUMNS) for epoch in epochs)
    alarms.sort(key=lambda each: (each["state"] in ENDED, each["kind"] != "axis"))
    standing = sum(each["state"] not in ENDED for each in alarms)
    monitored, why = _assess(store, document, made)
    if explained is None and monitored is not None:  # of an assessment by an earlier version
        explained = explanation(monitored)
        closing = to_close(alarms[:standing], document["last_state"] or document["state"])
        document["to_do"] = coded_actions(document, [*closing, *explained["actions"]], at)
    return StoredAxis(
        document=document,
        place=place,
        alarms=tuple(alarms),
        standing=standing,
        epochs=found,
        made=made,
        explained=explained or {},
        monitored=monitored,
        why=why,
    )


def _assess(store: OpenStore, document: dict[str, Any], made: dict[str, Any]) -> tuple[Monitored | None, str]:
    """The newest assessment, made again with the same result; or None, and a sentence why."""
    inputs, stated = made.get("inputs", ""), made.get("settings", {})
    if document["changed_at"] is not None:
        inputs = ""  # of no history
    try:
        monitored = newest_assessment(store, document["axis"], inputs, stated)
    except InputError as error:
        return None, f"It cannot be assessed: {error}"
    return monitored, _ASSESS if monitored is None else ""
