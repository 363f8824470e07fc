"""Checks of every request before its route: host, site, caller, form token, and size."""

from __future__ import annotations

import hmac
from collections.abc import Mapping
from urllib.parse import quote, urlsplit

from fastapi import Request
from fastapi.responses import RedirectResponse, Response
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.types import Message as AsgiMessage

from ballscrew.base.errors import BallscrewError
from ballscrew.service.access import LOOPBACK, Caller, find_caller, host_name
from ballscrew.service.pages.help_topics import answer_to, is_of_api
from ballscrew.service.pages.sign_in import is_for_all, local_address
from ballscrew.service.serving import TOO_LARGE, RefusedError, Service

_LONGEST_BODY = 64 << 20  # bytes of any body but a file's: MODEL.json has a few
_LONGEST_PUBLIC_BODY = 1 << 16  # bytes of the forms that anybody and viewers may send
_MOST_DIGITS = 19  # of a number in a header
_OPEN = ("/livez", "/readyz")  # without a token
_READING = ("GET", "HEAD", "OPTIONS")
_FORM = "application/x-www-form-urlencoded"
_TOKEN, _FIELD = "x-csrf-token", b"csrf="
_HEADERS = {
    "Ballscrew-API": "1",  # by which a sender knows that no proxy answers
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
}


class Guard:
    """Checks of every request before its route reads the body.

    Parameters
    ----------
    app : ASGI application
        What is guarded.
    service : Service
        The service.
    """

    def __init__(self, app: ASGIApp, service: Service) -> None:
        self.app = app
        self.service = service

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        answer = self._answering(scope, send)
        try:
            await self._check(scope)
            receive = await _check_form(scope, receive)
        except BallscrewError as error:
            await _refusal(scope, error)(scope, receive, answer)
            return
        if _is_file(scope):
            await self.app(scope, receive, answer)
        else:
            await self._pass_on(scope, _LimitedBody(receive, _body_limit(scope)), answer)

    def _answering(self, scope: Scope, send: Send) -> Send:
        """Send an answer with the headers of all answers."""

        async def answer(message: AsgiMessage) -> None:
            if message["type"] == "http.response.start":
                if message["status"] >= 400:
                    self.service.refusals[message["status"]] += 1
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
                caller = scope.get("state", {}).get("caller")
                if caller is not None and caller.session is not None:
                    headers.setdefault("Cache-Control", "no-store")
            await send(message)

        return answer

    async def _pass_on(self, scope: Scope, body: _LimitedBody, answer: Send) -> None:
        """Answer of the route, unless the body is too large: FastAPI answers that it cannot be parsed."""

        async def answer_of_route(message: AsgiMessage) -> None:
            if not body.is_too_large:
                await answer(message)

        await self.app(scope, body.receive, answer_of_route)
        if body.is_too_large:
            await _refusal(scope, _too_large())(scope, body.receive, answer)

    async def _check(self, scope: Scope) -> None:
        """Check a request by its headers, and note its caller."""
        headers = Headers(scope=scope)
        self._check_host(scope["method"], headers)
        path = scope["path"]
        if path not in _OPEN:
            state = scope.setdefault("state", {})
            is_renewed = "hx-request" in headers or is_of_api(path)  # by a page, and by no person
            is_used = scope["method"] not in _READING or not is_renewed
            try:
                state["caller"] = await run_in_threadpool(
                    find_caller, self.service, Request(scope), is_used=is_used
                )
            except RefusedError as error:
                if error.status != 401 or not is_for_all(path):
                    raise
        if not _is_file(scope) and not _is_short(headers.get("content-length", "0"), _body_limit(scope)):
            raise _too_large()

    def _check_host(self, method: str, headers: Mapping[str, str]) -> None:
        """Refuse a request from another site or to a host that is not allowed."""
        settings = self.service.settings
        allowed = set(settings.allowed_hosts)
        if settings.on_loopback:
            allowed |= {*LOOPBACK, settings.host}
        if allowed and host_name(headers.get("host", "")) not in allowed:
            raise RefusedError(400, "the name of the host is not allowed (allowed_hosts).")
        origin = headers.get("origin")
        is_foreign = origin is not None and not _is_of(origin, headers.get("host"))
        if is_foreign or _is_from_another_site(method, headers):
            raise RefusedError(403, "the request comes from another site.")


async def _check_form(scope: Scope, receive: Receive) -> Receive:
    """Refuse a change that a browser sends otherwise than by a page of this server.

    Returns
    -------
    callable
        By which the body is received: it is read here where the token is a field of the form.
    """
    caller: Caller | None = scope.get("state", {}).get("caller")
    if scope["method"] in _READING:
        return receive
    headers = Headers(scope=scope)
    if is_for_all(scope["path"]):
        _check_origin(headers)
        return receive
    if caller is None or caller.session is None:
        return receive
    _check_origin(headers)
    given = headers.get(_TOKEN, "").encode()
    if not given and headers.get("content-type", "").startswith(_FORM):
        content = await _read(_LimitedBody(receive, _LONGEST_BODY).receive)
        given = _token_of(content)
        receive = _again(content, receive)
    if not hmac.compare_digest(given, caller.form_token.encode()):
        raise RefusedError(403, "the form is from an earlier session: reload the page.")
    return receive


def _check_origin(headers: Headers) -> None:
    """Refuse a change that does not state its site; that of another site is refused before."""
    if "origin" not in headers and headers.get("sec-fetch-site") != "same-origin":
        raise RefusedError(403, "the request has no Origin header.")


def _token_of(form: bytes) -> bytes:
    """Token that a form contains."""
    for field in form.split(b"&"):
        if field.startswith(_FIELD):
            return field.removeprefix(_FIELD)
    return b""


async def _read(receive: Receive) -> bytes:
    """Whole body of a request."""
    content, is_complete = bytearray(), False
    while not is_complete:
        message = await receive()
        content += message.get("body", b"")
        is_complete = not message.get("more_body", False)
    return bytes(content)


def _again(content: bytes, receive: Receive) -> Receive:
    """Receive a body that was read, and then what follows it."""
    waiting = [content]

    async def receive_again() -> AsgiMessage:
        if waiting:
            return {"type": "http.request", "body": waiting.pop(), "more_body": False}
        return await receive()

    return receive_again


def _refusal(scope: Scope, error: BallscrewError) -> Response:
    """Answer to a request that is refused; to a page without a caller, the page on which to sign in."""
    headers = Headers(scope=scope)
    is_anonymous = isinstance(error, RefusedError) and error.status == 401
    if not is_anonymous or is_of_api(scope["path"]) or "authorization" in headers:
        return answer_to(Request(scope), error)
    if "hx-request" in headers:
        sign_in = _sign_in_address(headers.get("hx-current-url", ""))
        return Response(status_code=401, headers={"HX-Redirect": sign_in})
    if scope["method"] not in _READING:
        return RedirectResponse(_sign_in_address("/"), 303)
    raw = scope.get("raw_path") or quote(scope["path"]).encode()
    return RedirectResponse(_sign_in_address((raw + b"?" + scope["query_string"]).decode("latin-1")), 303)


def _sign_in_address(address: str) -> str:
    """Address on which to sign in, and to go on to the page of an address."""
    try:
        parts = urlsplit(address)
    except ValueError:
        return "/sign-in"
    page = local_address(f"{parts.path}?{parts.query}".removesuffix("?"))
    return f"/sign-in?next={quote(page, safe='')}"


def _is_file(scope: Scope) -> bool:
    """Whether the body is a file, whose size its route limits."""
    return scope["method"] == "PUT" and "/files/" in scope["path"]


def _is_of(origin: str, host: str | None) -> bool:
    """Whether a page of an origin is of a host."""
    try:
        return urlsplit(origin).netloc == host
    except ValueError:
        return False


def _is_from_another_site(method: str, headers: Mapping[str, str]) -> bool:
    """Whether a page of another site causes a request, other than by a link that a person follows."""
    if headers.get("sec-fetch-site") != "cross-site":
        return False
    link = (headers.get("sec-fetch-mode"), headers.get("sec-fetch-dest"))
    return method != "GET" or link != ("navigate", "document")


def _body_limit(scope: Scope) -> int:
    """Bytes that the body of a request may have, unless it is a file.

    FastAPI parses a body before the route refuses its caller: that of one who may only read stays small.
    """
    caller: Caller | None = scope.get("state", {}).get("caller")
    is_reader = caller is not None and caller.role == "viewer"
    return _LONGEST_PUBLIC_BODY if is_reader or is_for_all(scope["path"]) else _LONGEST_BODY


def _is_short(length: str, most: int) -> bool:
    """Whether a body of a Content-Length may be received."""
    return length.isdecimal() and len(length) < _MOST_DIGITS and int(length) <= most


def _too_large() -> RefusedError:
    return RefusedError(TOO_LARGE, "the body is too large.")


class _LimitedBody:
    """Body of a request, whose reading ends with an error once it is too large."""

    def __init__(self, receive: Receive, most: int) -> None:
        self._receive = receive
        self._most = most
        self._size = 0

    @property
    def is_too_large(self) -> bool:
        return self._size > self._most

    async def receive(self) -> AsgiMessage:
        message = await self._receive()
        self._size += len(message.get("body", b""))
        if self.is_too_large:
            raise _too_large()
        return message
