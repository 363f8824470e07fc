"""Page of the alarms: those that stand first, what was done about them, and those that ended."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from ballscrew.base.errors import BallscrewError, InputError
from ballscrew.monitoring.epochs import KINDS
from ballscrew.service.access import MaintainerCaller, RunningService, ViewerCaller
from ballscrew.service.alarms import Action, act
from ballscrew.service.pages.forms import Outcome, PostedForm, entered, go_to, refusal, time_of
from ballscrew.service.pages.rendering import render
from ballscrew.service.serving import RefusedError, Service
from ballscrew.store.alarms import ENDED, alarm_documents

router = APIRouter(include_in_schema=False)

_MOST = 200  # that have ended on the page
_LABELS = {
    "action": "The action", "until": "The end of the shelving", "text": "The text",
    "finding": "What was found", "cause": "The other cause", "at": "The time", "kind": "The kind",
}  # fmt: skip


@router.get("/alarms")
def show_alarms(
    request: Request,
    caller: ViewerCaller,  # noqa: ARG001
    service: RunningService,
) -> HTMLResponse:
    """Alarms and troubles; ``?show=`` and ``?axis=`` select among them."""
    return _page(request, service, Outcome())


@router.post("/alarms/{alarm}")
def post_action(
    request: Request, alarm: str, form: PostedForm, caller: MaintainerCaller, service: RunningService
) -> Response:
    """Acknowledge, shelve, close or reopen an alarm."""
    try:
        action = entered(
            Action,
            _LABELS,
            action=form.get("action", ""),
            until=form.get("until") or None,
            text=form.get("text", ""),
            finding=form.get("finding") or None,
            cause=form.get("cause", ""),
            maintenance=_maintenance(form),
        )
        if action.action == "close" and alarm.startswith("alarm-") and action.finding is None:
            raise InputError("What was found must be chosen.")
        act(alarm, action, caller, service)
    except RefusedError:
        raise
    except BallscrewError as error:
        return _page(request, service, refusal(alarm, error, form))
    return go_to("/alarms", action.action)


def _maintenance(form: Mapping[str, Any]) -> dict[str, Any] | None:
    """What was done, if a kind is chosen."""
    if not form.get("kind"):
        return None
    return {"at": time_of(form), "kind": form["kind"], "text": form.get("done", "")}


def _page(request: Request, service: Service, outcome: Outcome) -> HTMLResponse:
    axis = request.query_params.get("axis", "")
    with service.store.read() as session:
        documents = alarm_documents(session)
    if axis:
        documents = [each for each in documents if each["axis"] == axis]
    chosen = request.query_params.get("show", "")
    if chosen not in ENDED:
        chosen = ""
    standing: list[dict[str, Any]] = []
    ended: list[dict[str, Any]] = []
    for document in documents:
        if document["state"] not in ENDED:
            standing.append(document)
        elif chosen in ("", document["state"]):
            ended.append(document)
    standing.sort(key=_by_urgency)
    return render(
        request,
        "alarm_list.html",
        outcome.status,
        standing=standing,
        ended=ended[:_MOST],
        number=len(ended),
        chosen=chosen,
        axis=axis,
        states=ENDED,
        kinds=KINDS,
        outcome=outcome,
        done=request.query_params.get("done", ""),
    )


def _by_urgency(document: dict[str, Any]) -> tuple[bool, bool]:
    """Alarms before troubles, and what nobody has acknowledged or shelved before the others."""
    return document["kind"] != "axis", document["state"] != "raised"
