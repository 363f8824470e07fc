"""Who may do what: callers by token, by session or at this computer, and their roles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import Depends, Request
from sqlalchemy import select
from sqlalchemy.orm import Session
from starlette.requests import HTTPConnection

from ballscrew.base.errors import shown
from ballscrew.service.serving import (
    RefusedError,
    Service,
    UnknownAxisError,
    service_of,
)
from ballscrew.service.sessions import cookie_of, digest_of, find_session, is_session_open
from ballscrew.service.settings import ServerSettings
from ballscrew.store.folder import now
from ballscrew.store.service_tables import Token, User
from ballscrew.store.tables import Axis

ROLES = ("viewer", "maintainer", "admin")
"""Each may do what those before it may."""

LOOPBACK = ("localhost", "127.0.0.1", "::1")
"""Names of this computer."""

_FORWARDED = ("forwarded", "via", "x-forwarded", "x-real-ip", "x-client-ip", "true-client-ip", "cf-")
"""Beginnings of the headers that proxies add."""

_CHALLENGE = {"WWW-Authenticate": "Bearer"}


@dataclass(frozen=True, slots=True)
class Caller:
    """Who sends a request.

    Parameters
    ----------
    name : str
        For the audit.
    machine : int or None
        Number of the only machine for which the caller may send.
    role : str or None
        One of :data:`ROLES`; None for a machine.
    session : int, optional
        Number of the session of a user.
    user : int, optional
        Number of the user.
    form_token : str, optional
        What each form of the session contains.
    token : int, optional
        Number of the token.
    """

    name: str
    machine: int | None
    role: str | None
    session: int | None = None
    user: int | None = None
    form_token: str = ""
    token: int | None = None

    def may(self, role: str) -> bool:
        """Whether the caller has a role, or one that may do more."""
        return self.role is not None and ROLES.index(self.role) >= ROLES.index(role)


def find_caller(service: Service, connection: HTTPConnection, *, is_used: bool) -> Caller:
    """Who sends a request: by its token, else its session, else the administrator at this computer.

    Parameters
    ----------
    service : Service
        The service.
    connection : HTTPConnection
        The request.
    is_used : bool
        Whether a person asks, so that the session lasts longer.

    Returns
    -------
    Caller
        With the role.

    Raises
    ------
    RefusedError
        401 without a token or a session that is valid.
    """
    given = connection.headers.get("authorization")
    if given is not None:
        return _owner_of(service, given)
    secret = cookie_of(connection)
    if secret is not None:
        found = find_session(service, secret, is_used=is_used)
        if found is not None:
            return Caller(found.name, None, found.role, found.id, found.user, found.form_token)
    if _is_local(service.settings, connection.headers) and not needs_sign_in(service):
        return Caller("local", None, ROLES[-1])
    raise RefusedError(401, "a token is needed: Authorization: Bearer TOKEN.", _CHALLENGE)


def _owner_of(service: Service, authorization: str) -> Caller:
    """Machine or holder of a token."""
    scheme, _, text = authorization.partition(" ")
    with service.store.read() as session:
        row = session.scalar(select(Token).where(Token.digest == digest_of(text.strip())))
    is_owned = row is not None and (row.machine_id is None) == (row.role in ROLES)
    if scheme.lower() != "bearer" or row is None or row.revoked_at is not None or not is_owned:
        raise RefusedError(401, "the token is not valid, or was revoked.", _CHALLENGE)
    service.token_uses[row.id] = now()
    return Caller(f"token {row.id}", row.machine_id, row.role, token=row.id)


def _is_local(settings: ServerSettings, headers: Mapping[str, str]) -> bool:
    """Whether a request comes from this computer, and not through a proxy on it."""
    if not settings.on_loopback or any(name.startswith(_FORWARDED) for name in headers):
        return False
    return host_name(headers.get("host", "")) in (*LOOPBACK, settings.host)


def host_name(host: str) -> str:
    """Name in a Host header, without its port."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def needs_sign_in(service: Service) -> bool:
    """Whether requests from this computer too need a session or a token: after the first user."""
    if service.settings.require_login:
        return True
    with service.store.read() as session:
        return session.scalar(select(User.id).where(User.password.is_not(None)).limit(1)) is not None


def is_admitted(service: Service, caller: Caller) -> bool:
    """Whether a caller who was admitted still is: by session, by token, or at this computer."""
    if caller.session is not None:
        return is_session_open(service, caller.session)
    if caller.token is None:
        return not needs_sign_in(service)
    with service.store.read() as session:
        return session.get_one(Token, caller.token).revoked_at is None


def caller_of(request: Request) -> Caller:
    """Who sends a request, as the guard found.

    Raises
    ------
    RefusedError
        401 where anybody is admitted.
    """
    found: Caller | None = getattr(request.state, "caller", None)
    if found is None:
        raise RefusedError(401, "sign in first.", _CHALLENGE)
    return found


AnyCaller = Annotated[Caller, Depends(caller_of)]


def _caller_with(role: str) -> Callable[[Caller], Caller]:
    """Dependency of routes that need a role."""

    def find(caller: AnyCaller) -> Caller:
        if caller.machine is not None:
            raise RefusedError(403, "the token of a machine may only send runs.")
        return _check_role(caller, role)

    return find


def _check_role(caller: Caller, role: str) -> Caller:
    """A caller who has a role, or one that may do more."""
    if not caller.may(role):
        raise RefusedError(403, f"this needs the role {role}; {shown(caller.name)} has {caller.role}.")
    return caller


ViewerCaller = Annotated[Caller, Depends(_caller_with("viewer"))]
MaintainerCaller = Annotated[Caller, Depends(_caller_with("maintainer"))]
AdminCaller = Annotated[Caller, Depends(_caller_with("admin"))]
RunningService = Annotated[Service, Depends(service_of)]


def find_sender(caller: AnyCaller) -> Caller:
    """A machine, or a maintainer who uploads for it.

    Raises
    ------
    RefusedError
        403 for a viewer.
    """
    return caller if caller.machine is not None else _check_role(caller, "maintainer")


def find_signed_in(caller: AnyCaller) -> Caller:
    """A user with a session.

    Raises
    ------
    RefusedError
        403 for a token, and at this computer before there is a user.
    """
    if caller.session is None:
        raise RefusedError(403, "this is for people who have signed in.")
    return caller


SendingCaller = Annotated[Caller, Depends(find_sender)]
SignedInCaller = Annotated[Caller, Depends(find_signed_in)]


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
