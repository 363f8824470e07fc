"""Tokens of machines, and of programs with a role: created, listed and revoked, by command or over HTTP."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fastapi import APIRouter, Response
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError, shown
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.service.access import ROLES, AdminCaller, RunningService
from ballscrew.service.serving import RefusedError
from ballscrew.service.sessions import digest_of, new_secret
from ballscrew.service.users import LOCAL, check_role
from ballscrew.store.folder import now
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.service_tables import Token
from ballscrew.store.tables import MachineRow

router = APIRouter(prefix="/api/v1/tokens")

_BEGIN = "bs_"  # so that a token is recognised where it was pasted by mistake
_LONGEST_NAME = 200


class NewToken(BaseModel):
    """Owner of a new token: either a machine, or a program with a role."""

    model_config = ConfigDict(extra="forbid")
    admin: bool = Field(False, description="With the role admin, which may do everything.")
    role: str | None = Field(None, max_length=20, description="With this role: viewer, maintainer or admin.")
    name: str = Field("", max_length=200, description="What it is for.")
    machine: str | None = Field(
        None, max_length=200, description="Of the machine of this name, which may only send runs of its axes."
    )


@router.get("")
def show_tokens(caller: AdminCaller, service: RunningService) -> dict[str, Any]:  # noqa: ARG001
    """Tokens with their owners and times, without the tokens themselves."""
    return {"schema": SCHEMA, "tokens": list_tokens(service.store, service.token_uses)}


@router.post("", status_code=201)
def add_token(
    new: NewToken, caller: AdminCaller, service: RunningService, response: Response
) -> dict[str, Any]:
    """Create a token; this answer alone contains it."""
    role = new.role
    if new.admin:
        if role not in (None, ROLES[-1]):
            raise InputError("a token has either admin or another role.")
        role = ROLES[-1]
    number, text = create_token(service.store, new.machine, role=role, name=new.name, by=caller.name)
    response.headers["Cache-Control"] = "no-store"
    return {"schema": SCHEMA, "id": number, "machine": new.machine, "token": text}


@router.delete("/{token}")
def remove_token(token: int, caller: AdminCaller, service: RunningService) -> dict[str, Any]:
    """Revoke a token by its number; it stays in the list."""
    try:
        revoke_token(service.store, token, by=caller.name)
    except InputError as error:
        raise RefusedError(404, str(error)) from None
    return {"schema": SCHEMA, "id": token, "revoked": True}


def create_token(
    store: OpenStore, machine: str | None, *, role: str | None = None, name: str = "", by: str = LOCAL
) -> tuple[int, str]:
    """Create a token, also while a server holds the store.

    Parameters
    ----------
    store : OpenStore
        The store.
    machine : str or None
        Name of the machine; the token may then only send runs of its axes.
    role : str, optional
        Instead, what a program may do: one of :data:`ROLES`.
    name : str
        What the token is for.
    by : str
        Who creates it, for the audit.

    Returns
    -------
    tuple of int and str
        Its number, and the token itself, which is not stored.

    Raises
    ------
    InputError
        If both or neither are given, there is no such machine, or several have this name.
    """
    if (role is None) == (machine is None):
        raise InputError("a token has either a role (--admin, --read-only) or a machine (its name).")
    name = name.strip()
    if not name.isprintable() or len(name) > _LONGEST_NAME:
        raise InputError(f"the name of a token must have {_LONGEST_NAME} printable characters or fewer.")
    text = _BEGIN + new_secret()
    with store.write("token create", beside_server=True) as session:
        row = Token(digest=digest_of(text), machine_id=None, created_at=now(), name=name or None)
        if role is not None:
            row.role = check_role(role)
        if machine is not None:
            row.machine_id = _find_machine(session, machine).id
        session.add(row)
        session.flush()
        record(session, "create", f"token {row.id}", machine=machine, role=role, name=name, by=by)
        return row.id, text


def _find_machine(session: Session, name: str) -> MachineRow:
    rows = session.scalars(select(MachineRow).where(MachineRow.name == name)).all()
    if len(rows) != 1:
        number = "several machines" if rows else "no machine"
        raise InputError(
            f"the store has {number} of the name {shown(name)}; a machine is named with the data sheet of an "
            "axis: 'ballscrew store add axis.toml --machine NAME'."
        )
    return rows[0]


def list_tokens(store: OpenStore, uses: Mapping[int, str] | None = None) -> list[dict[str, Any]]:
    """Tokens with their owners and times, without the tokens themselves.

    Parameters
    ----------
    store : OpenStore
        The store.
    uses : mapping of int to str, optional
        Time of the last use by the number of the token.

    Returns
    -------
    list of dict
        By their numbers.
    """
    with store.read() as session:
        rows = session.execute(
            select(Token, MachineRow.name)
            .outerjoin(MachineRow, MachineRow.id == Token.machine_id)
            .order_by(Token.id)
        ).all()
    found = []
    for token, machine in rows:
        found.append(
            {
                "id": token.id,
                "machine": machine,
                "role": token.role,
                "name": token.name or "",
                "admin": token.role == ROLES[-1],
                "used_at": (uses or {}).get(token.id),
                "created_at": token.created_at,
                "revoked_at": token.revoked_at,
            }
        )
    return found


def revoke_token(store: OpenStore, number: int, *, by: str = LOCAL) -> None:
    """Revoke a token, also while a server holds the store.

    Parameters
    ----------
    store : OpenStore
        The store.
    number : int
        Number of the token.
    by : str
        Who revokes it, for the audit.

    Raises
    ------
    InputError
        If there is none of this number.
    """
    with store.write("token revoke", beside_server=True) as session:
        row = session.get(Token, number) if 0 < number < 1 << 31 else None
        if row is None:
            raise InputError(f"there is no token {number}; 'ballscrew token list' lists them.")
        if row.revoked_at is None:
            row.revoked_at = now()
            record(session, "revoke", f"token {number}", by=by)
