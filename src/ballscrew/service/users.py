"""Users: added, listed, changed and disabled, and the links by which they choose a password."""

from __future__ import annotations

import time
import unicodedata
from pathlib import Path
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError, shown
from ballscrew.service.access import ROLES
from ballscrew.service.sessions import digest_of, end_sessions, new_secret
from ballscrew.service.settings import ServerSettings
from ballscrew.store.folder import now
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.service_tables import Invitation, User, UserSession

LOCAL = "local"
"""Who uses this computer before there is a user, and the command line, in the audit."""

ADDRESS_FILE = "store.address"
"""File in the data folder with the address at which it was served last."""

LINK_HOURS = 24
"""Time for which a link is valid."""

_LONGEST_NAME = 80
_UNNAMED = ""  # the first administrator, until the name is chosen


def check_role(role: str) -> str:
    """A role, if it is known."""
    if role not in ROLES:
        raise InputError(f"the role is {shown(role)}; it must be one of {', '.join(ROLES)}.")
    return role


def normal_name(name: str) -> str:
    """A name with each letter in one form, as names are compared; empty where it is far too long for one."""
    if len(name) > 4 * _LONGEST_NAME:  # in whose normal form it would be too long as well
        return ""
    return unicodedata.normalize("NFC", name).strip()


def check_name(name: str) -> str:
    """Name of a user as it is stored.

    Raises
    ------
    InputError
        If it is empty, too long, has signs that cannot be printed, or is that of another kind of caller.
    """
    text = normal_name(name)
    if not 0 < len(text) <= _LONGEST_NAME or not text.isprintable():
        raise InputError(f"A name must have 1 to {_LONGEST_NAME} printable characters.")
    if text.casefold() == LOCAL or text.casefold().startswith("token "):
        raise InputError(f"{shown(text)} cannot be the name of a user: the audit uses it for other callers.")
    return text


def find_user(session: Session, name: str) -> User | None:
    """User of a name, in any case of its letters."""
    wanted = normal_name(name).casefold()
    for row in session.scalars(select(User)):
        if row.name.casefold() == wanted:
            return row
    return None


def add_user(store: OpenStore, name: str, role: str, *, by: str = LOCAL) -> str:
    """Add a user, also while a server holds the store.

    Parameters
    ----------
    store : OpenStore
        The store.
    name : str
        Name, which no other user has.
    role : str
        One of :data:`ROLES`; the first user is an administrator.
    by : str
        Who adds the user, for the audit.

    Returns
    -------
    str
        Secret of the link by which the user chooses a password; it is not stored.

    Raises
    ------
    InputError
        If the name or the role is wrong.
    """
    text, role = check_name(name), check_role(role)
    with store.write("user add", beside_server=True) as session:
        if find_user(session, text) is not None:
            raise InputError(f"there is a user {shown(text)} already.")
        if role != ROLES[-1] and not _has_other_admin(session, None):
            raise InputError("the first user must be an administrator (role admin).")
        row = User(name=text, role=role, password=None, created_at=now(), disabled_at=None)
        session.add(row)
        session.flush()
        record(session, "create", f"user {text}", role=role, by=by)
        return _add_link(session, row, by)


def first_link(store: OpenStore) -> str | None:
    """Secret of a new link for the first administrator, who chooses a name too; None if there is another."""
    with store.write("first user") as session:
        row = None
        for user in session.scalars(select(User)):
            if user.password is not None or (user.name != _UNNAMED and user.role == ROLES[-1]):
                return None
            if user.name == _UNNAMED:
                row = user
        if row is None:
            row = User(name=_UNNAMED, role=ROLES[-1], password=None, created_at=now(), disabled_at=None)
            session.add(row)
            session.flush()
        return _add_link(session, row, LOCAL)


def new_link(store: OpenStore, name: str, *, by: str = LOCAL) -> str:
    """Secret of a new link for a user, such as one who forgot the password; earlier links end."""
    with store.write("user link", beside_server=True) as session:
        row = _need(session, name)
        if row.disabled_at is not None:
            raise InputError(
                f"the user {shown(row.name)} is disabled; 'ballscrew user disable --undo' enables it."
            )
        return _add_link(session, row, by)


def change_role(store: OpenStore, name: str, role: str, *, by: str = LOCAL) -> None:
    """Change the role of a user, whose sessions end."""
    check_role(role)
    with store.write("user role", beside_server=True) as session:
        row = _need(session, name)
        if row.role == role:
            return
        _check_not_last(session, row)
        record(session, "change role", f"user {row.name}", old=row.role, new=role, by=by)
        row.role = role
        end_sessions(session, UserSession.user_id == row.id)


def disable_user(store: OpenStore, name: str, *, undo: bool = False, by: str = LOCAL) -> None:
    """Disable a user, whose sessions and links end, or enable one again."""
    with store.write("user disable", beside_server=True) as session:
        row = _need(session, name)
        if (row.disabled_at is None) == undo:
            return
        if undo:
            row.disabled_at = None
            record(session, "enable", f"user {row.name}", by=by)
            return
        _check_not_last(session, row)
        row.disabled_at = now()
        end_sessions(session, UserSession.user_id == row.id)
        _end_links(session, row)
        record(session, "disable", f"user {row.name}", by=by)


def end_sessions_of(store: OpenStore, name: str, *, by: str) -> None:
    """End all sessions of a user."""
    with store.write("user sessions") as session:
        row = _need(session, name)
        number = end_sessions(session, UserSession.user_id == row.id)
        record(session, "end sessions", f"user {row.name}", number=number, by=by)


def list_users(store: OpenStore) -> list[dict[str, Any]]:
    """Users by their names, without hashes; ``link`` is whether one is still valid."""
    with store.read() as session:
        linked = set(session.scalars(select(Invitation.user_id).where(*_valid_links())))
        query = select(User).where(User.name != _UNNAMED).order_by(func.lower(User.name), User.id)
        rows = session.scalars(query).all()
    return [_document(row, linked) for row in rows]


def _document(row: User, linked: set[int]) -> dict[str, Any]:
    return {
        "id": row.id,
        "name": row.name,
        "role": row.role,
        "password": row.password is not None,
        "link": row.id in linked,
        "created_at": row.created_at,
        "disabled_at": row.disabled_at,
    }


def invited_user(session: Session, secret: str) -> User | None:
    """User of a link that is valid."""
    return session.scalar(
        select(User)
        .join(Invitation, Invitation.user_id == User.id)
        .where(Invitation.digest == digest_of(secret), User.disabled_at.is_(None), *_valid_links())
    )


def choose_password(session: Session, user: User, name: str, hashed: str) -> None:
    """Store the hash of the password of a user who has a link, and the name of the first one.

    Links and sessions of the user end, and the link of a first administrator who is not needed any more.

    Raises
    ------
    InputError
        If the name is refused.
    """
    if user.name == _UNNAMED:
        text = check_name(name)
        if find_user(session, text) is not None:
            raise InputError(f"there is a user {shown(text)} already.")
        user.name = text
    user.password = hashed
    end_sessions(session, UserSession.user_id == user.id)
    for row in session.scalars(select(User).where(User.name.in_((user.name, _UNNAMED)))):
        _end_links(session, row)


def address_of_server(settings: ServerSettings, port: int | None = None) -> str:
    """Beginning of the addresses of a server: public_url, or what its other settings state."""
    if settings.public_url is not None:
        return settings.public_url.rstrip("/")
    scheme = "http" if settings.certificate is None else "https"
    host = settings.host
    if host in ("0.0.0.0", "::") and settings.allowed_hosts:  # noqa: S104  compared
        host = settings.allowed_hosts[0]
    if ":" in host:
        host = f"[{host}]"
    return f"{scheme}://{host}:{port or settings.port}"


def address_last_served(folder: Path, settings: ServerSettings) -> str:
    """Address of the server of a data folder as it was started last; by the settings, if it never was."""
    try:
        started = (folder / ADDRESS_FILE).read_text(encoding="utf-8").strip()
    except (OSError, ValueError):
        started = ""
    if settings.public_url is not None or not started.startswith(("http://", "https://")):
        return address_of_server(settings)
    return started


def _need(session: Session, name: str) -> User:
    row = find_user(session, name)
    if row is None:
        raise InputError(f"there is no user {shown(name)}; 'ballscrew user list' lists them.")
    return row


def _has_other_admin(session: Session, user: User | None) -> bool:
    """Whether there is an administrator besides a user: with a password, where the user has one."""
    for row in session.scalars(select(User).where(User.role == ROLES[-1], User.disabled_at.is_(None))):
        if user is None or (row.id != user.id and (row.password is not None or user.password is None)):
            return True
    return False


def _check_not_last(session: Session, user: User) -> None:
    if user.role == ROLES[-1] and user.disabled_at is None and not _has_other_admin(session, user):
        raise InputError(f"{shown(user.name)} is the last administrator; add another one first.")


def _add_link(session: Session, user: User, by: str) -> str:
    """A new link of a user, in place of those before."""
    _end_links(session, user)
    secret = new_secret()
    expires = time.time() + 3600.0 * LINK_HOURS
    session.add(Invitation(digest=digest_of(secret), user_id=user.id, expires=expires, used_at=None))
    record(session, "link", f"user {user.name}", by=by)
    return secret


def _end_links(session: Session, user: User) -> None:
    query = select(Invitation).where(Invitation.user_id == user.id, Invitation.used_at.is_(None))
    for row in session.scalars(query):
        row.used_at = now()


def _valid_links() -> tuple[Any, ...]:
    return Invitation.used_at.is_(None), Invitation.expires > time.time()
