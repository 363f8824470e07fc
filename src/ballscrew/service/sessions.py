"""Sessions of users: their cookies, how long they last, and the token of their forms."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from fastapi.responses import Response
from sqlalchemy import delete, select
from sqlalchemy.orm import Session
from starlette.requests import HTTPConnection

from ballscrew.base.errors import BallscrewError, printable
from ballscrew.service.serving import Service
from ballscrew.service.settings import ServerSettings
from ballscrew.store.folder import now
from ballscrew.store.service_tables import User, UserSession

_BYTES = 32
_HOUR, _DAY = 3600.0, 86400.0  # s
_LEAST = 60.0  # s after which the time of the last use is written again
_LONGEST_ORIGIN = 200  # characters


@dataclass(frozen=True, slots=True)
class OpenSession:
    """A session that lasts, and its user.

    Parameters
    ----------
    id : int
        Its number.
    user : int
        Number of the user.
    name, role : str
        Of the user.
    form_token : str
        What each form of its pages contains.
    """

    id: int
    user: int
    name: str
    role: str
    form_token: str


def digest_of(secret: str) -> str:
    """Hash of a token, a cookie or a link, as it is stored."""
    return hashlib.sha256(secret.encode()).hexdigest()


def new_secret() -> str:
    """A token, a cookie or a link that cannot be guessed."""
    return secrets.token_urlsafe(_BYTES)


def origin_of(connection: HTTPConnection) -> str:
    """Address and browser of a request."""
    browser = printable(connection.headers.get("user-agent", ""))[:_LONGEST_ORIGIN]
    return f"{address_of_client(connection)} {browser}".strip()


def address_of_client(connection: HTTPConnection) -> str:
    """Address that a request comes from."""
    return "unknown" if connection.client is None else connection.client.host


def cookie_of(connection: HTTPConnection) -> str | None:
    """Secret of the session of a request; None without one."""
    return connection.cookies.get(_cookie_name(connection))


def _cookie_name(connection: HTTPConnection) -> str:
    """Under TLS, a name by which a browser accepts the cookie from this host alone."""
    return "__Host-ballscrew" if _is_encrypted(connection) else "ballscrew"


def _is_encrypted(connection: HTTPConnection) -> bool:
    """Whether the browser uses TLS: to this server, or to the proxy that ``public_url`` names."""
    public_url = connection.app.state.service.settings.public_url or ""
    return connection.scope.get("scheme") == "https" or public_url.startswith("https:")


def give_cookie(answer: Response, connection: HTTPConnection, secret: str) -> None:
    """Add the cookie of a session to an answer; the browser removes it when it is closed."""
    answer.set_cookie(_cookie_name(connection), secret, **_attributes(connection))


def take_cookie(answer: Response, connection: HTTPConnection) -> None:
    """Remove the cookie of a session."""
    answer.delete_cookie(_cookie_name(connection), **_attributes(connection))


def _attributes(connection: HTTPConnection) -> dict[str, Any]:
    return {"path": "/", "httponly": True, "samesite": "lax", "secure": _is_encrypted(connection)}


def begin_session(
    session: Session, user: User, origin: str, settings: ServerSettings, replaced: str | None
) -> str:
    """Begin a session, and end the one that the browser had.

    Parameters
    ----------
    session : Session
        Of the database.
    user : User
        Who signs in.
    origin : str
        Address and browser.
    settings : ServerSettings
        How long sessions last; those that ended long ago are removed.
    replaced : str or None
        Secret of the session before.

    Returns
    -------
    str
        Its secret, for the cookie; its hash is stored.
    """
    at = time.time()
    if replaced is not None:
        end_sessions(session, UserSession.digest == digest_of(replaced))
    session.execute(delete(UserSession).where(UserSession.begun < at - _DAY * settings.session_days))
    secret = new_secret()
    session.add(UserSession(digest=digest_of(secret), user_id=user.id, begun=at, used=at, origin=origin))
    return secret


def end_sessions(session: Session, *conditions: Any) -> int:
    """End the sessions that fulfil conditions; their number."""
    rows = session.scalars(select(UserSession).where(UserSession.revoked_at.is_(None), *conditions)).all()
    for row in rows:
        row.revoked_at = now()
    return len(rows)


def find_session(service: Service, secret: str, *, is_used: bool) -> OpenSession | None:
    """Session of a cookie.

    Parameters
    ----------
    service : Service
        The service.
    secret : str
        Value of the cookie.
    is_used : bool
        Whether a person asks, so that the session lasts longer; not a page that renews itself.

    Returns
    -------
    OpenSession or None
        None if there is none, it has ended, or its user is disabled.
    """
    with service.store.read() as session:
        row = session.execute(
            select(UserSession, User)
            .join(User, User.id == UserSession.user_id)
            .where(UserSession.digest == digest_of(secret), *_is_open(service.settings))
        ).first()
        if row is None:
            return None
        found, user = row
        key = hmac.digest(secret.encode(), b"ballscrew form", "sha256").hex()
        answer = OpenSession(found.id, user.id, user.name, user.role, key)
        is_written = is_used and time.time() - found.used > _LEAST
    if is_written:
        with suppress(BallscrewError), service.store.write("session") as session:  # what is damaged is read
            session.get_one(UserSession, answer.id).used = time.time()
    return answer


def is_session_open(service: Service, number: int) -> bool:
    """Whether a session still lasts."""
    with service.store.read() as session:
        query = select(UserSession.id).join(User, User.id == UserSession.user_id)
        return session.scalar(query.where(UserSession.id == number, *_is_open(service.settings))) is not None


def open_sessions(service: Service, user: int | None = None) -> list[UserSession]:
    """Sessions that last, of one user or of all, the newest first."""
    with service.store.read() as session:
        query = select(UserSession).join(User, User.id == UserSession.user_id)
        query = query.where(*_is_open(service.settings))
        if user is not None:
            query = query.where(UserSession.user_id == user)
        return list(session.scalars(query.order_by(UserSession.used.desc())))


def _is_open(settings: ServerSettings) -> tuple[Any, ...]:
    """Conditions under which a session lasts."""
    at = time.time()
    return (
        UserSession.revoked_at.is_(None),
        User.disabled_at.is_(None),
        UserSession.used > at - _HOUR * settings.session_idle_h,
        UserSession.begun > at - _DAY * settings.session_days,
    )
