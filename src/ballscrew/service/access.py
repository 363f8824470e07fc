"""Who may do what: hosts and sites, and the callers to whom tokens belong."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import Depends, Request
from fastapi.responses import JSONResponse
from sqlalchemy import select
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.types import Message as AsgiMessage

from ballscrew.base.errors import BallscrewError, shown
from ballscrew.service.serving import (
    TOO_LARGE,
    RefusedError,
    Service,
    UnknownAxisError,
    answer_refusal,
    service_of,
)
from ballscrew.service.settings import ServerSettings
from ballscrew.store.tables import Axis, Token

_LONGEST_BODY = 64 << 20  # bytes of any body but a file's: MODEL.json has a few
_MOST_DIGITS = 19  # of a number in a header
_OPEN = ("/livez", "/readyz")  # without a token
_FORWARDED = frozenset({"forwarded", "via", "x-forwarded-for", "x-forwarded-host", "x-real-ip"})
_LOOPBACK = ("localhost", "127.0.0.1", "::1")
_HEADERS = {
    "Ballscrew-API": "1",  # by which a sender knows that no proxy answers
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
}


@dataclass(frozen=True, slots=True)
class Caller:
    """Who sends a request.

    Parameters
    ----------
    name : str
        For the audit.
    machine : int or None
        Number of the only machine for which the caller may send; None for an administrator.
    """

    name: str
    machine: int | None


def digest_of(token: str) -> str:
    """Hash of a token, as it is stored."""
    return hashlib.sha256(token.encode()).hexdigest()


def find_caller(service: Service, headers: Mapping[str, str]) -> Caller:
    """Who sends a request, by its token; without one, the administrator at this computer.

    Raises
    ------
    RefusedError
        401 without a token that is valid.
    """
    challenge = {"WWW-Authenticate": "Bearer"}
    given = headers.get("authorization")
    if given is None:
        if _is_local(service.settings, headers):
            return Caller("local", None)
        raise RefusedError(401, "a token is needed: Authorization: Bearer TOKEN.", challenge)
    scheme, _, text = given.partition(" ")
    with service.store.read() as session:
        row = session.scalar(select(Token).where(Token.digest == digest_of(text.strip())))
    if scheme.lower() != "bearer" or row is None or row.revoked_at is not None:
        raise RefusedError(401, "the token is not valid, or was revoked.", challenge)
    return Caller(f"token {row.id}", row.machine_id)


def _is_local(settings: ServerSettings, headers: Mapping[str, str]) -> bool:
    """Whether a request comes from this computer, and not through a proxy on it."""
    if not settings.on_loopback or not _FORWARDED.isdisjoint(headers.keys()):
        return False
    return _name(headers.get("host", "")) in (*_LOOPBACK, settings.host)


def caller_of(request: Request) -> Caller:
    """Who sends a request, as :class:`Guard` found."""
    found: Caller = request.state.caller
    return found


AnyCaller = Annotated[Caller, Depends(caller_of)]


def find_admin(caller: AnyCaller) -> Caller:
    """The administrator that sends a request.

    Raises
    ------
    RefusedError
        403 for the token of a machine.
    """
    if caller.machine is not None:
        raise RefusedError(403, "the token of a machine may only send runs.")
    return caller


AdminCaller = Annotated[Caller, Depends(find_admin)]
RunningService = Annotated[Service, Depends(service_of)]


def find_sent_axis(session: Session, name: str, caller: Caller) -> Axis:
    """Row of the axis that a caller sends for.

    Raises
    ------
    RefusedError
        404 if there is no such axis; 403 for the token of another machine, even if there is no such axis.
    """
    row = session.scalar(select(Axis).where(Axis.name == name))
    if caller.machine is not None and (row is None or row.machine_id != caller.machine):
        raise RefusedError(403, f"the token does not belong to the machine of an axis {shown(name)}.")
    if row is None:
        raise UnknownAxisError(name, f"there is no axis {shown(name)}; PUT /api/v1/axes/NAME adds it.")
    return row


class Guard:
    """Checks of every request before its body is read: Host, Origin, token, and size.

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
        answer = self._answering(send)
        refusal = await self._refusal(scope)
        if refusal is not None:
            await refusal(scope, receive, answer)
        elif _is_file(scope):
            await self.app(scope, receive, answer)
        else:
            await self._pass_on(scope, _LimitedBody(receive), answer)

    def _answering(self, send: Send) -> Send:
        """Send an answer with the headers of all answers."""

        async def answer(message: AsgiMessage) -> None:
            if message["type"] == "http.response.start":
                if message["status"] >= 400:
                    self.service.refusals[message["status"]] += 1
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        return answer

    async def _pass_on(self, scope: Scope, body: _LimitedBody, answer: Send) -> None:
        """Answer of the route, unless the body is too large: FastAPI answers that it cannot be parsed."""

        async def answer_of_route(message: AsgiMessage) -> None:
            if not body.is_too_large:
                await answer(message)

        await self.app(scope, body.receive, answer_of_route)
        if body.is_too_large:
            await _too_large()(scope, body.receive, answer)

    async def _refusal(self, scope: Scope) -> JSONResponse | None:
        """Refusal of a request by its headers; None if its route answers."""
        headers = Headers(scope=scope)
        refusal = self._wrong_host(scope["method"], headers)
        if refusal is not None:
            return refusal
        if scope["path"] not in _OPEN:
            try:
                caller = await run_in_threadpool(find_caller, self.service, headers)
            except BallscrewError as error:
                return answer_refusal(error)
            scope.setdefault("state", {})["caller"] = caller
        if not _is_file(scope) and not _is_short(headers.get("content-length", "0")):
            return _too_large()
        return None

    def _wrong_host(self, method: str, headers: Mapping[str, str]) -> JSONResponse | None:
        """Refusal of a request from another site or to a host that is not allowed; else None."""
        settings = self.service.settings
        allowed = set(settings.allowed_hosts)
        if settings.on_loopback:
            allowed |= {*_LOOPBACK, settings.host}
        host = _name(headers.get("host", ""))
        if allowed and host not in allowed:
            return JSONResponse({"detail": "the name of the host is not allowed (allowed_hosts)."}, 400)
        origin = headers.get("origin")
        is_foreign = origin is not None and not _is_of(origin, headers.get("host"))
        if is_foreign or _is_from_another_site(method, headers):
            return JSONResponse({"detail": "the request comes from another site."}, 403)
        return None


def _name(host: str) -> str:
    """Name in a Host header, without its port."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


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


def _is_short(length: str) -> bool:
    """Whether a body of a Content-Length may be received."""
    return length.isdecimal() and len(length) < _MOST_DIGITS and int(length) <= _LONGEST_BODY


def _too_large() -> JSONResponse:
    return JSONResponse({"detail": "the body is too large."}, TOO_LARGE)


class _LimitedBody:
    """Body of a request, whose reading ends with an error once it is too large."""

    def __init__(self, receive: Receive) -> None:
        self._receive = receive
        self._size = 0

    @property
    def is_too_large(self) -> bool:
        return self._size > _LONGEST_BODY

    async def receive(self) -> AsgiMessage:
        message = await self._receive()
        self._size += len(message.get("body", b""))
        if self.is_too_large:
            raise RefusedError(TOO_LARGE, "the body is too large.")
        return message
