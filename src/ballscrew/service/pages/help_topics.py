"""Help on each page, and pages for a browser in place of refusals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from fastapi import APIRouter, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, Response
from starlette.exceptions import HTTPException

from ballscrew.base.errors import BallscrewError, printable, shown
from ballscrew.service.access import ViewerCaller
from ballscrew.service.pages.rendering import render
from ballscrew.service.serving import UNPROCESSABLE, RefusedError, UnknownAxisError, answer_refusal

router = APIRouter(include_in_schema=False)

_OF_PROGRAMS = ("/livez", "/readyz", "/metrics", "/openapi.json")

TOPICS = (
    "start", "fleet", "axis", "run", "alarms", "actions", "compare", "signals", "findings", "audit", "status",
)  # fmt: skip
"""Topics of the help, each with a template."""


@router.get("/help")
def show_topics(request: Request, caller: ViewerCaller) -> HTMLResponse:
    """The first steps."""
    return show_help(request, TOPICS[0], caller)


@router.get("/help/{topic}")
def show_help(request: Request, topic: str, caller: ViewerCaller) -> HTMLResponse:  # noqa: ARG001
    """Help on a topic."""
    if topic not in TOPICS:
        raise RefusedError(404, f"there is no help on {shown(topic)}.")
    return render(request, f"help_{topic}.html", topic=topic, topics=TOPICS)


def answer_browsers(app: FastAPI) -> None:
    """Answer refusals of page routes with a page where a browser asks; the API answers as before."""
    for kind in (BallscrewError, HTTPException, RequestValidationError):
        app.add_exception_handler(kind, _answering(app.exception_handlers[kind]))


def _answering(before: Any) -> Callable[[Request, Exception], Response]:
    """Handler of an error: a page for a browser, else the answer of the handler before."""

    def answer(request: Request, error: Exception) -> Response:
        if is_of_browser(request):
            return _refusal_page(request, error)
        found: Response = before(request, error)
        return found

    return answer


def answer_to(request: Request, error: BallscrewError) -> Response:
    """Answer to a request that is refused before its route."""
    return _answering(lambda _, refused: answer_refusal(refused))(request, error)


def is_of_api(path: str) -> bool:
    """Whether an address is of the API, or of what measures the server: no page."""
    return path.startswith("/api/") or path in _OF_PROGRAMS


def is_of_browser(request: Request) -> bool:
    """Whether a page is asked for: not the API, and by a client that reads HTML."""
    return not is_of_api(request.scope["path"]) and "text/html" in request.headers.get("accept", "")


def _refusal_page(request: Request, error: Exception) -> HTMLResponse:
    if isinstance(error, UnknownAxisError):
        return render(request, "axis_unknown.html", error.status, axis=error.axis)
    if isinstance(error, HTTPException):
        status, sentence = error.status_code, ""
    elif isinstance(error, RequestValidationError):
        status, sentence = UNPROCESSABLE, printable(f"{error.errors()[0]['msg']}.")
    else:
        found = answer_refusal(cast("BallscrewError", error))
        status, sentence = found.status_code, str(error)
    return render(request, "refusal.html", status, sentence=sentence, status_code=status)
