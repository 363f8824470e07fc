"""Page of the users and the tokens: invite, change and disable users, create and revoke tokens."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response
from sqlalchemy import select

from ballscrew.base.errors import BallscrewError, InputError
from ballscrew.service.access import ROLES, AdminCaller, RunningService
from ballscrew.service.pages.forms import Outcome, PostedForm, entered_number, go_to, refusal
from ballscrew.service.pages.rendering import render
from ballscrew.service.serving import Service
from ballscrew.service.sessions import open_sessions
from ballscrew.service.tokens import create_token, list_tokens, revoke_token
from ballscrew.service.users import (
    add_user,
    address_of_server,
    change_role,
    disable_user,
    end_sessions_of,
    list_users,
    new_link,
)
from ballscrew.store.tables import MachineRow

router = APIRouter(include_in_schema=False)


@router.get("/users")
def show_users(request: Request, caller: AdminCaller, service: RunningService) -> HTMLResponse:  # noqa: ARG001
    """Users and tokens, with forms."""
    return _page(request, service, Outcome())


@router.post("/users")
def post_user(request: Request, form: PostedForm, caller: AdminCaller, service: RunningService) -> Response:
    """Invite a user, or change one: role, new link, sessions, disabled or enabled."""
    name, do = form.get("name", ""), form.get("do", "")
    store, by = service.store, caller.name
    try:
        link = None
        if do == "invite":
            link = add_user(store, name, form.get("role", ""), by=by)
        elif do == "link":
            link = new_link(store, name, by=by)
        elif do == "role":
            change_role(store, name, form.get("role", ""), by=by)
        elif do == "sessions":
            end_sessions_of(store, name, by=by)
        elif do in ("disable", "enable"):
            disable_user(store, name, undo=do == "enable", by=by)
        else:
            raise InputError("The form states nothing to do.")
    except BallscrewError as error:
        return _page(request, service, refusal("users", error, form))
    if link is None:
        return go_to("/users", do)
    server = f"{request.scope['scheme']}://{request.headers.get('host', '')}"
    if service.settings.public_url is not None:
        server = address_of_server(service.settings)
    result = {"name": name.strip(), "link": f"{server}/link/{link}"}
    return _page(request, service, Outcome("users", result=result))


@router.post("/users/tokens")
def post_token(request: Request, form: PostedForm, caller: AdminCaller, service: RunningService) -> Response:
    """Create a token, which this answer alone contains, or revoke one."""
    try:
        if form.get("do") == "revoke":
            revoke_token(service.store, entered_number(form, "token"), by=caller.name)
            return go_to("/users", "revoke")
        number, text = _create(service, form, caller.name)
    except BallscrewError as error:
        return _page(request, service, refusal("tokens", error, form))
    return _page(request, service, Outcome("tokens", result={"number": number, "token": text}))


def _create(service: Service, form: Mapping[str, Any], by: str) -> tuple[int, str]:
    """Token of a machine, or with a role and a name."""
    machine, role = form.get("machine") or None, form.get("role") or None
    return create_token(service.store, machine, role=role, name=form.get("name", ""), by=by)


def _page(request: Request, service: Service, outcome: Outcome) -> HTMLResponse:
    with service.store.read() as session:
        machines = session.scalars(select(MachineRow.name).distinct().order_by(MachineRow.name)).all()
    return render(
        request,
        "users.html",
        outcome.status,
        users=list_users(service.store),
        sessions=Counter(each.user_id for each in open_sessions(service)),
        tokens=list_tokens(service.store, service.token_uses),
        machines=machines,
        roles=ROLES,
        outcome=outcome,
        done=request.query_params.get("done", ""),
    )
