"""Pages of the set-up of an axis: machine, documents and schedule; check of the plan, and its G-code."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response
from sqlalchemy import select

from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.sheet_file import read_axis
from ballscrew.base.errors import BallscrewError, InputError, shown
from ballscrew.fcft.dialect import DIALECTS, find_dialect, plain_ascii
from ballscrew.fcft.gcode import gcode
from ballscrew.fcft.plan import Plan, read_plan
from ballscrew.fcft.planned import PlannedTest, plan
from ballscrew.service.access import AdminCaller, Caller, RunningService, ViewerCaller
from ballscrew.service.axes import AxisSetup, Schedule, set_up_axis
from ballscrew.service.pages.forms import Outcome, PostedForm, entered, go_to, refusal
from ballscrew.service.pages.rendering import address_of, render
from ballscrew.service.reading import axis_document
from ballscrew.service.runs import setup_texts
from ballscrew.service.serving import UNPROCESSABLE, RefusedError, Service, service_of
from ballscrew.store.calendars import CALENDAR, DAYS
from ballscrew.store.raw_files import text_files
from ballscrew.store.reading import find_axis
from ballscrew.store.service_tables import Setup
from ballscrew.store.tables import Axis, MachineRow

router = APIRouter(include_in_schema=False)

_DAY = 86400.0  # s
_MOST_DAYS = 3650.0
_MOST_CHECKED = 2000  # combinations of stop, load, preload and motion: about 6 s
_LABELS = {
    "machine": "The machine",
    "site": "The site",
    "sheet": "The data sheet",
    "plan": "The plan",
    "channels": "The channel map",
    "working_days": "Working days",
    "holidays": "Holidays",
    "time_zone": "Time zone",
    "shifts": "Shifts",
}
_NONE = "none"  # of an empty list


@router.get("/setup")
def show_new_axis(request: Request, caller: AdminCaller) -> HTMLResponse:  # noqa: ARG001
    """Form of an axis that is not set up yet."""
    return _page(request, None, Outcome(), {})


@router.post("/setup")
def post_new_axis(
    request: Request, form: PostedForm, caller: AdminCaller, service: RunningService
) -> Response:
    """Set up a new axis, whose name is in its data sheet."""
    try:
        if form.get("do") == "check":
            return _page(request, None, _checked(service, form), {})
        name = _sheet(form.get("sheet", "")).name
        with service.store.read() as session:
            known = session.scalar(select(Axis.id).where(Axis.name == name))
        if known is not None:
            raise InputError(f"there is an axis {shown(name)} already; its own page changes its set-up.")
        return _save(name, form, caller, service)
    except BallscrewError as error:
        return _page(request, None, refusal("setup", error, form), {})


@router.get("/axes/{axis}/setup")
def show_setup(
    request: Request,
    axis: str,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
) -> HTMLResponse:
    """Set-up of an axis, with what is missing."""
    return _page(request, axis_document(service, axis), Outcome(), _stored(service, axis))


@router.post("/axes/{axis}/setup")
def post_setup(
    request: Request, axis: str, form: PostedForm, caller: AdminCaller, service: RunningService
) -> Response:
    """Save the set-up of an axis, or check the plan that the form contains."""
    document = axis_document(service, axis)
    try:
        if form.get("do") != "check":
            return _save(axis, form, caller, service)
        outcome = _checked(service, form)
    except BallscrewError as error:
        outcome = refusal("setup", error, form)
    return _page(request, document, outcome, _stored(service, axis))


@router.get("/axes/{axis}/gcode")
def download_gcode(
    axis: str,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
    dialect: str = "iso",
    word: str = "X",
    part: str = "test",
) -> Response:
    """The stored plan as a program for a controller, or its dry run."""
    axis_document(service, axis)
    stored = _stored(service, axis)
    if not stored["sheet"] or not stored["plan"]:
        raise RefusedError(404, f"the axis {shown(axis)} has no data sheet, or no plan.")
    find_dialect(dialect).axis_word(word)
    test, sheet = _plan_of(stored)
    is_dry = part == "dry-run"
    with service.computing("the program of a plan"):
        lines = gcode(test, sheet, dialect=dialect, axis_word=word, dry_run=is_dry)  # type: ignore[arg-type]  # checked
        text = "\n".join(lines) + "\n"
    name = plain_ascii(axis).replace(" ", "_").replace("/", "_").replace("*", "_").replace(":", "_")
    suffix = "-dry-run" if is_dry else ""
    headers = {"Content-Disposition": f'attachment; filename="{name[:60]}{suffix}.nc"'}
    return Response(text, media_type="text/plain; charset=us-ascii", headers=headers)


def _save(axis: str, form: Mapping[str, Any], caller: Caller, service: Service) -> Response:
    """Set up an axis as the form states."""
    setup = entered(
        AxisSetup,
        _LABELS,
        machine=form.get("machine", "").strip(),
        site=form.get("site", "").strip(),
        sheet=form.get("sheet", ""),
        plan=_text(form, "plan"),
        channels=_text(form, "channels"),
        schedule=_schedule(form),
    )
    if not setup.sheet.strip():
        raise InputError("The data sheet must not be empty.")
    set_up_axis(axis, setup, caller, service)
    stored = _stored(service, axis)
    entered_texts = [setup.sheet, setup.plan or "", setup.channels or ""]
    is_same = entered_texts == [stored[name] for name in ("sheet", "plan", "channels")]
    return go_to(address_of(axis, "setup"), "setup" if is_same else "comments")


def _schedule(form: Mapping[str, Any]) -> Schedule | None:
    """Schedule that a form states; None without a period."""
    calendar: dict[str, Any] = {}
    for name in CALENDAR:
        text = form.get(name, "").strip()
        if text:
            calendar[name] = _stated(name, text)
    if not form.get("period", "").strip():
        if calendar:
            raise InputError("Working days and shifts need a period.")
        return None
    period = _seconds("The period", form["period"])
    grace = _seconds("The grace time", form.get("grace", "").strip() or "0")
    if period == 0:
        raise InputError("The period must be greater than 0 days.")
    return entered(Schedule, _LABELS, period_s=period, grace_s=grace, **calendar)


def _stated(name: str, text: str) -> str | list[str]:
    """Value of a calendar: words with commas or spaces, no word where it is ``none``."""
    if name == "time_zone":
        return text
    words = [] if text.lower() == _NONE else text.replace(",", " ").split()
    if name == "working_days" and not set(words) <= set(DAYS):
        raise InputError(f"Working days are {shown(text)}; they must be of {', '.join(DAYS)}.")
    return words


def _text(form: Mapping[str, Any], name: str) -> str | None:
    """Text of a document; None if it is empty."""
    text = str(form.get(name, ""))
    return text if text.strip() else None


def _seconds(label: str, days: str) -> float:
    """Time in s by a number of days."""
    try:
        value = float(days.replace(",", "."))
    except ValueError:
        value = math.nan
    if not 0 <= value <= _MOST_DAYS:
        raise InputError(f"{label} is {shown(days)}; it must be a number of days from 0 to {_MOST_DAYS:g}.")
    return value * _DAY


def _checked(service: Service, form: Mapping[str, Any]) -> Outcome:
    """Check of the plan that a form contains."""
    if not form.get("sheet", "").strip() or not form.get("plan", "").strip():
        raise RefusedError(UNPROCESSABLE, "a check needs a data sheet and a plan.")
    test, sheet = _plan_of(form)
    count = len(test.positions) * len(test.masses) * len(test.motions) * max(1, len(test.preloads))
    if count > _MOST_CHECKED:
        raise InputError(
            f"the plan has {count} combinations of stop, load, preload and motion; this page checks "
            f"{_MOST_CHECKED} or fewer, 'ballscrew plan' all."
        )
    with service.computing("the check of a plan"):
        found: PlannedTest = plan(test, axis=sheet)
    return Outcome("check", "", form, 200, found)


def _sheet(text: str) -> DataSheet:
    with text_files({"axis": text}) as paths:
        return replace(read_axis(paths["axis"]), source="axis.toml")


def _plan_of(texts: Mapping[str, Any]) -> tuple[Plan, DataSheet]:
    """Plan and data sheet by their texts."""
    with text_files({"plan": texts["plan"]}) as paths:
        return replace(read_plan(paths["plan"]), source="plan.toml"), _sheet(texts["sheet"])


def _stored(service: Service, axis: str) -> dict[str, str]:
    """Fields of the form as they are stored."""
    with service.store.read() as session:
        row = find_axis(session, axis)
        texts = setup_texts(session, row.id)
        machine = None if row.machine_id is None else session.get(MachineRow, row.machine_id)
        setup = session.get(Setup, row.id)
        found = {
            "machine": "" if machine is None else machine.name,
            "site": "" if machine is None else machine.site,
            "sheet": texts.get("axis", ""),
            "plan": texts.get("plan", ""),
            "channels": texts.get("channels", ""),
            "period": "",
            "grace": "",
        }
        if setup is not None and setup.period_s is not None:
            found["period"] = f"{setup.period_s / _DAY:g}"
            found["grace"] = f"{(setup.grace_s or 0.0) / _DAY:g}"
            found |= _calendar_words(setup.calendar or {})
    return found


def _calendar_words(calendar: Mapping[str, Any]) -> dict[str, str]:
    """Values of a calendar as the form has them."""
    found = {}
    for name, value in calendar.items():
        found[name] = value if isinstance(value, str) else ", ".join(value) or _NONE
    return found


def _page(
    request: Request, document: dict[str, Any] | None, outcome: Outcome, stored: Mapping[str, str]
) -> HTMLResponse:
    values = dict(stored)
    values.update(outcome.values)
    return render(
        request,
        "setup.html",
        outcome.status,
        axis=None if document is None else document["axis"],
        missing=[] if document is None else document["missing"],
        values=values,
        server=_calendar_words(service_of(request).settings.calendar.to_settings()),
        outcome=outcome,
        dialects=[dialect.name for dialect in DIALECTS],
        done=request.query_params.get("done", ""),
    )
