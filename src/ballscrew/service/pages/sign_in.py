"""Pages for people without a session: sign in, and choose a password on a link."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from ballscrew.base.errors import BallscrewError
from ballscrew.service.access import RunningService, SignedInCaller, needs_sign_in
from ballscrew.service.pages.forms import Outcome, PostedForm, refusal
from ballscrew.service.pages.rendering import render
from ballscrew.service.passwords import SHORTEST
from ballscrew.service.serving import RefusedError, Service
from ballscrew.service.sessions import end_sessions, give_cookie, take_cookie
from ballscrew.service.signing_in import RunningThrottle, follow_link, sign_in, user_of_link
from ballscrew.store.opened import record
from ballscrew.store.service_tables import UserSession

router = APIRouter(include_in_schema=False)

_FOR_ALL = ("/link/", "/static/")


def is_for_all(path: str) -> bool:
    """Whether a page is also for those who have not signed in."""
    return path == "/sign-in" or path.startswith(_FOR_ALL)


def local_address(text: str) -> str:
    """An address of this server; the first page in place of any other."""
    is_plain = text.isprintable() and "\\" not in text
    if not is_plain or not text.startswith("/") or text.startswith("//"):
        return "/"
    return text


@router.get("/sign-in")
def show_sign_in(request: Request, service: RunningService) -> Response:
    """Form of name and password; who is admitted already goes on."""
    address = local_address(request.query_params.get("next", "/"))
    if getattr(request.state, "caller", None) is not None:
        return RedirectResponse(address, 303)
    return _sign_in_page(request, service, Outcome(values={"next": address}))


@router.post("/sign-in")
def post_sign_in(
    request: Request, form: PostedForm, service: RunningService, throttle: RunningThrottle
) -> Response:
    """Sign in, and go on to the page that was asked for."""
    try:
        secret = sign_in(service, throttle, request, form.get("name", ""), form.get("password", ""))
    except RefusedError as error:
        answer = _sign_in_page(request, service, refusal("sign in", error, form))
        answer.headers.update(error.headers)
        return answer
    return _signed_in(request, secret, local_address(form.get("next", "/")))


@router.post("/sign-out")
def post_sign_out(request: Request, caller: SignedInCaller, service: RunningService) -> Response:
    """End the session."""
    with service.store.write("sign out") as session:
        end_sessions(session, UserSession.id == caller.session)
        record(session, "sign out", f"user {caller.name}", by=caller.name)
    answer = RedirectResponse("/sign-in", 303)
    take_cookie(answer, request)
    return answer


@router.get("/link/{link}")
def show_link(request: Request, link: str, service: RunningService) -> HTMLResponse:
    """Form on which the user of a link chooses a password, and the first administrator a name."""
    return _link_page(request, link, service, Outcome())


@router.post("/link/{link}")
def post_link(request: Request, link: str, form: PostedForm, service: RunningService) -> Response:
    """Store the password, and sign in."""
    name, password, again = (form.get(each, "") for each in ("name", "password", "again"))
    try:
        secret = follow_link(service, request, link, name, password, again)
    except RefusedError:
        raise
    except BallscrewError as error:
        return _link_page(request, link, service, refusal("link", error, {"name": name}))
    return _signed_in(request, secret, "/")


def _signed_in(request: Request, secret: str, address: str) -> Response:
    answer = RedirectResponse(address, 303)
    give_cookie(answer, request, secret)
    return answer


def _sign_in_page(request: Request, service: Service, outcome: Outcome) -> HTMLResponse:
    is_new = not service.settings.require_login and not needs_sign_in(service)
    return render(request, "sign_in.html", outcome.status, outcome=outcome, is_new=is_new)


def _link_page(request: Request, link: str, service: Service, outcome: Outcome) -> HTMLResponse:
    name, role = user_of_link(service, link)
    return render(
        request, "link.html", outcome.status, link=link, name=name, role=role, shortest=SHORTEST,
        outcome=outcome,
    )  # fmt: skip
