"""Page of what people do on an axis: events, a new baseline, exclusions, and uploads."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from ballscrew.base.errors import BallscrewError
from ballscrew.monitoring.epochs import BEGINS, KINDS, STEPS
from ballscrew.service import axes
from ballscrew.service.access import MaintainerCaller, RunningService, ViewerCaller
from ballscrew.service.axes import Kind, NewEvent, NewExclusion
from ballscrew.service.pages.forms import Outcome, PostedForm, entered, go_to, refusal, time_of
from ballscrew.service.pages.rendering import address_of, render
from ballscrew.service.reading import axis_document
from ballscrew.service.serving import Service

router = APIRouter(include_in_schema=False)

_SECTIONS = {"runs": "run", "events": "events"}
_LABELS = {"at": "The time", "kind": "The kind", "text": "The text", "reason": "The reason"}


@router.get("/axes/{axis}/actions")
def show_actions(
    request: Request,
    axis: str,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
) -> HTMLResponse:
    """Forms of an axis; ``?run=`` chooses a run to exclude."""
    chosen = {"subject": request.query_params.get("run", "")}
    return _page(request, axis, service, Outcome("run", values=chosen))


@router.post("/axes/{axis}/actions/events")
def post_event(
    request: Request, axis: str, form: PostedForm, caller: MaintainerCaller, service: RunningService
) -> Response:
    """Add an event, also one that begins a new baseline, or show first how it would change the state."""
    section = "baseline" if form.get("section") == "baseline" else "event"
    is_preview = form.get("do") == "preview"
    try:
        event = entered(
            NewEvent, _LABELS, at=time_of(form), kind=form.get("kind", ""), text=form.get("text", "")
        )
        answer = axes.add_axis_events(axis, [event], caller, service, preview=is_preview)
    except BallscrewError as error:
        return _page(request, axis, service, refusal(section, error, form))
    if is_preview:
        return _page(request, axis, service, Outcome(section, "", form, 200, answer))
    return go_to(address_of(axis, "actions"), section)


@router.post("/axes/{axis}/actions/exclusions")
def post_exclusion(
    request: Request, axis: str, form: PostedForm, caller: MaintainerCaller, service: RunningService
) -> Response:
    """Exclude a run or an event with a reason, or include it again."""
    subject = form.get("subject", "")
    kind: Kind = "runs"
    if form.get("of") == "event":
        kind = "events"
    try:
        if form.get("do") == "include":
            axes.include_subject(axis, kind, subject, caller, service)
            return go_to(address_of(axis, "actions"), "include")
        body = entered(NewExclusion, _LABELS, reason=form.get("reason", "").strip())
        axes.exclude_subject(axis, kind, subject, body, caller, service)
    except BallscrewError as error:
        return _page(request, axis, service, refusal(_SECTIONS[kind], error, form))
    return go_to(address_of(axis, "actions"), "exclude")


def _page(request: Request, axis: str, service: Service, outcome: Outcome) -> HTMLResponse:
    document = axis_document(service, axis)
    standing = [each for each in document["exclusions"] if each["ended_at"] is None]
    return render(
        request,
        "actions.html",
        outcome.status,
        axis=document["axis"],
        document=document,
        runs=document["runs"][::-1],
        excluded_runs=[each for each in standing if each["run"] is not None],
        excluded_events={each["event"]: each for each in standing if each["event"] is not None},
        times={run["run"]: run["measured_at"] for run in document["runs"]},
        kinds={"event": (*STEPS, KINDS[-1], *BEGINS), "baseline": BEGINS},
        outcome=outcome,
        done=request.query_params.get("done", ""),
    )
