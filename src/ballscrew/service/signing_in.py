"""Signing in: by a password, or by a link on which one is chosen; attempts wait longer and longer."""

from __future__ import annotations

import ipaddress
import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated

from fastapi import Depends, Request
from sqlalchemy.orm import Session
from starlette.requests import HTTPConnection

from ballscrew.base.errors import InputError
from ballscrew.service.passwords import hash_password, is_outdated, is_password
from ballscrew.service.serving import TOO_MANY, RefusedError, Service
from ballscrew.service.sessions import address_of_client, begin_session, cookie_of, end_sessions, origin_of
from ballscrew.service.users import choose_password, find_user, invited_user, normal_name
from ballscrew.store.opened import record
from ballscrew.store.service_tables import User, UserSession

_FREE = {"name": 5, "address": 20}  # attempts without a pause
_LONGEST = {"name": 60.0, "address": 900.0}  # s; a name longer would lock out its owner
_FORGOTTEN = 900.0  # s after a pause
_MOST = 10_000  # names and addresses

_WRONG = "The name or the password is wrong."
_ENDED = "This link is not valid: it was used, replaced, or is older than a day."


class Throttle:
    """Attempts to sign in by name and by address; after some that fail, each waits twice as long.

    Parameters
    ----------
    clock : callable, optional
        Time in s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._turn = threading.Lock()
        self._known: dict[tuple[str, str], tuple[int, float]] = {}  # failures, and end of the pause

    def begin(self, name: str, address: str) -> None:
        """Count an attempt, as one that fails until it succeeds.

        Raises
        ------
        RefusedError
            429 during a pause.
        """
        at = self._clock()
        with self._turn:
            keys = _keys(name, address)
            pause = max(self._known.get(key, (0, at))[1] - at for key in keys)
            if pause > 0:
                seconds = math.ceil(pause)
                message = f"Too many attempts to sign in: try again in {seconds} s."
                raise RefusedError(TOO_MANY, message, {"Retry-After": str(seconds)})
            for key in keys:
                self._count(key, at)

    def succeed(self, name: str, address: str) -> None:
        """Forget the attempts of a name, and the last one of an address."""
        by_name, by_address = _keys(name, address)
        with self._turn:
            self._known.pop(by_name, None)
            failures, _ = self._known.get(by_address, (1, 0.0))
            self._known[by_address] = failures - 1, self._clock()

    def _count(self, key: tuple[str, str], at: float) -> None:
        kind = key[0]
        failures, until = self._known.pop(key, (0, at))
        if at > until + _FORGOTTEN:
            failures = 0
        failures += 1
        over = min(failures - _FREE[kind], 32)
        if over > 0:
            at += min(2.0**over, _LONGEST[kind])
        self._known[key] = failures, at
        if len(self._known) > _MOST:
            del self._known[next(iter(self._known))]  # the one that is oldest


def _keys(name: str, address: str) -> tuple[tuple[str, str], tuple[str, str]]:
    """Keys of an attempt; an address of version 6 stands for its network."""
    with suppress(ValueError):
        found = ipaddress.ip_address(address)
        if isinstance(found, ipaddress.IPv6Address) and found.ipv4_mapped is None:
            address = str(ipaddress.ip_network((found, 64), strict=False))
    return ("name", normal_name(name).casefold()), ("address", address)


def throttle_of(request: Request) -> Throttle:
    """The throttle of the service."""
    found: Throttle = request.app.state.throttle
    return found


RunningThrottle = Annotated[Throttle, Depends(throttle_of)]


def sign_in(
    service: Service, throttle: Throttle, connection: HTTPConnection, name: str, password: str
) -> str:
    """Begin a session by name and password.

    Parameters
    ----------
    service : Service
        The service.
    throttle : Throttle
        Its throttle.
    connection : HTTPConnection
        The request, whose session is replaced.
    name, password : str
        As they were entered.

    Returns
    -------
    str
        Secret of the new session.

    Raises
    ------
    RefusedError
        401 if they are wrong, 429 after too many attempts.
    """
    address = address_of_client(connection)
    throttle.begin(name, address)
    with service.store.read() as session:
        row = find_user(session, name)
        subject, number, stored = "somebody unknown", 0, None  # what is no name may be a password
        if row is not None:
            subject, number = f"user {row.name}", row.id
            if row.disabled_at is None:
                stored = row.password
    if not is_password(password, stored) or stored is None:
        with service.store.write("sign in") as session:
            record(session, "refuse sign-in", subject, address=address)
        raise RefusedError(401, _WRONG)
    throttle.succeed(name, address)
    hashed = hash_password(password) if is_outdated(stored) else stored
    with service.store.write("sign in") as session:
        user = session.get_one(User, number)
        if user.password != stored or user.disabled_at is not None:  # changed meanwhile
            raise RefusedError(401, _WRONG)
        user.password = hashed
        return _begin(session, service, user, connection, "sign in")


def user_of_link(service: Service, link: str) -> tuple[str, str]:
    """Name and role of the user of a link; the first administrator has no name yet.

    Raises
    ------
    RefusedError
        404 if the link is not valid.
    """
    with service.store.read() as session:
        user = invited_user(session, link)
        if user is None:
            raise RefusedError(404, _ENDED)
        return user.name, user.role


def follow_link(
    service: Service, connection: HTTPConnection, link: str, name: str, password: str, again: str
) -> str:
    """Store the password that was chosen on a link, and begin a session.

    Parameters
    ----------
    service : Service
        The service.
    connection : HTTPConnection
        The request.
    link : str
        Secret of the link.
    name : str
        Name that the first administrator chooses; of others without effect.
    password, again : str
        The password, twice.

    Returns
    -------
    str
        Secret of the session.

    Raises
    ------
    RefusedError
        404 if the link is not valid any more.
    InputError
        If name or password is refused.
    """
    user_of_link(service, link)
    _check_same(password, again)
    hashed = hash_password(password)
    with service.store.write("password") as session:
        user = invited_user(session, link)
        if user is None:
            raise RefusedError(404, _ENDED)
        choose_password(session, user, name, hashed)
        return _begin(session, service, user, connection, "choose password")


def change_password(
    service: Service,
    throttle: Throttle,
    connection: HTTPConnection,
    user: int,
    old: str,
    new: tuple[str, str],
) -> str:
    """Change the password of a user, whose sessions end.

    Parameters
    ----------
    service : Service
        The service.
    throttle : Throttle
        Its throttle.
    connection : HTTPConnection
        The request.
    user : int
        Number of the user.
    old : str
        The password so far.
    new : tuple of str
        The new one, twice.

    Returns
    -------
    str
        Secret of a new session.

    Raises
    ------
    InputError
        If one is wrong.
    """
    with service.store.read() as session:
        row = session.get_one(User, user)
        name, stored = row.name, row.password
    address = address_of_client(connection)
    throttle.begin(name, address)
    if not is_password(old, stored):
        raise InputError("The present password is wrong.")
    throttle.succeed(name, address)
    _check_same(*new)
    hashed = hash_password(new[0])
    with service.store.write("password") as session:
        row = session.get_one(User, user)
        if row.password != stored or row.disabled_at is not None:  # changed meanwhile
            raise InputError("The present password is wrong.")
        row.password = hashed
        end_sessions(session, UserSession.user_id == user)
        return _begin(session, service, row, connection, "change password")


def _check_same(password: str, again: str) -> None:
    if password != again:
        raise InputError("The two passwords differ.")


def _begin(session: Session, service: Service, user: User, connection: HTTPConnection, action: str) -> str:
    """Begin a session, with a row of the audit."""
    record(session, action, f"user {user.name}", by=user.name, address=address_of_client(connection))
    return begin_session(session, user, origin_of(connection), service.settings, cookie_of(connection))
