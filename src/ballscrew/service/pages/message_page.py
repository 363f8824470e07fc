"""Page of the messages: recipients with a test, what waits and why, and the log."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from ballscrew.base.errors import BallscrewError
from ballscrew.service.access import AdminCaller, RunningService
from ballscrew.service.message_log import NewTestMessage, log_document, test_message
from ballscrew.service.pages.forms import Outcome, PostedForm, entered, go_to, refusal
from ballscrew.service.pages.rendering import render
from ballscrew.service.serving import Service

router = APIRouter(include_in_schema=False)


@router.get("/messages")
def show_message_page(
    request: Request,
    caller: AdminCaller,  # noqa: ARG001
    service: RunningService,
) -> HTMLResponse:
    """Recipients and messages."""
    return _page(request, service, Outcome())


@router.post("/messages/test")
def post_test(request: Request, form: PostedForm, caller: AdminCaller, service: RunningService) -> Response:
    """Send a test message."""
    try:
        new = entered(NewTestMessage, {"recipient": "The recipient"}, recipient=form.get("recipient", ""))
        found = test_message(new, caller, service)
    except BallscrewError as error:
        return _page(request, service, refusal("test", error, form))
    if found["error"]:
        return _page(request, service, Outcome("test", found["error"], form, 502))
    return go_to("/messages", "test")


def _page(request: Request, service: Service, outcome: Outcome) -> HTMLResponse:
    return render(
        request,
        "messages.html",
        outcome.status,
        outcome=outcome,
        done=request.query_params.get("done", ""),
        **log_document(service),
    )
