"""Page of a user's own account: password and sessions."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from ballscrew.base.errors import BallscrewError
from ballscrew.service.access import Caller, RunningService, SignedInCaller
from ballscrew.service.pages.forms import Outcome, PostedForm, entered_number, go_to, refusal
from ballscrew.service.pages.rendering import render
from ballscrew.service.passwords import SHORTEST
from ballscrew.service.serving import Service
from ballscrew.service.sessions import end_sessions, give_cookie, open_sessions
from ballscrew.service.signing_in import RunningThrottle, change_password
from ballscrew.store.opened import record
from ballscrew.store.service_tables import UserSession

router = APIRouter(include_in_schema=False)


@router.get("/account")
def show_account(request: Request, caller: SignedInCaller, service: RunningService) -> HTMLResponse:
    """Name and role, sessions, and a form of the password."""
    return _page(request, caller, service, Outcome())


@router.post("/account/password")
def post_password(
    request: Request,
    form: PostedForm,
    caller: SignedInCaller,
    service: RunningService,
    throttle: RunningThrottle,
) -> Response:
    """Change the password; all other sessions end."""
    new = form.get("password", ""), form.get("again", "")
    try:
        secret = change_password(service, throttle, request, caller.user or 0, form.get("old", ""), new)
    except BallscrewError as error:
        return _page(request, caller, service, refusal("password", error, {}))
    answer = go_to("/account", "password")
    give_cookie(answer, request, secret)
    return answer


@router.post("/account/sessions")
def post_sessions(
    request: Request, form: PostedForm, caller: SignedInCaller, service: RunningService
) -> Response:
    """End another session of the user, or all others."""
    conditions = [UserSession.user_id == caller.user, UserSession.id != caller.session]
    try:
        if form.get("do") != "all":
            conditions.append(UserSession.id == entered_number(form, "session"))
        with service.store.write("sessions") as session:
            number = end_sessions(session, *conditions)
            record(session, "end sessions", f"user {caller.name}", number=number, by=caller.name)
    except BallscrewError as error:
        return _page(request, caller, service, refusal("sessions", error, {}))
    return go_to("/account", "sessions")


def _page(request: Request, caller: Caller, service: Service, outcome: Outcome) -> HTMLResponse:
    return render(
        request,
        "account.html",
        outcome.status,
        role=caller.role,
        session=caller.session,
        sessions=open_sessions(service, caller.user),
        shortest=SHORTEST,
        outcome=outcome,
        done=request.query_params.get("done", ""),
    )
