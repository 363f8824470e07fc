"""Tokens of administrators and machines: created, listed and revoked, by command or over HTTP."""

from __future__ import annotations

import secrets
from typing import Any

from fastapi import APIRouter, Response
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.errors import InputError, shown
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.service.access import AdminCaller, RunningService, digest_of
from ballscrew.service.serving import RefusedError
from ballscrew.store.folder import now
from ballscrew.store.opened import OpenStore, record
from ballscrew.store.tables import MachineRow, Token

router = APIRouter(prefix="/api/v1/tokens")

_BEGIN = "bs_"  # so that a token is recognised where it was pasted by mistake
_BYTES = 32
_LOCAL = "local"  # who uses the command line, in the audit


class NewToken(BaseModel):
    """Owner of a new token: either an administrator or a machine."""

    model_config = ConfigDict(extra="forbid")
    admin: bool = Field(False, description="Of an administrator, who may do everything.")
    machine: str | None = Field(
        None, max_length=200, description="Of the machine of this name, which may only send runs of its axes."
    )


@router.get("")
def show_tokens(caller: AdminCaller, service: RunningService) -> dict[str, Any]:  # noqa: ARG001
    """Tokens with their machines and times, without the tokens themselves."""
    return {"schema": SCHEMA, "tokens": list_tokens(service.store)}


@router.post("", status_code=201)
def add_token(
    new: NewToken, caller: AdminCaller, service: RunningService, response: Response
) -> dict[str, Any]:
    """Create a token; this answer alone contains it."""
    number, text = create_token(service.store, new.machine, admin=new.admin, by=caller.name)
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


def create_token(store: OpenStore, machine: str | None, *, admin: bool, by: str = _LOCAL) -> tuple[int, str]:
    """Create a token, also while a server holds the store.

    Parameters
    ----------
    store : OpenStore
        The store.
    machine : str or None
        Name of the machine; the token may then only send runs of its axes.
    admin : bool
        Whether it is that of an administrator instead.
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
    if admin == (machine is not None):
        raise InputError("a token is that of either an administrator (admin) or a machine (its name).")
    text = _BEGIN + secrets.token_urlsafe(_BYTES)
    with store.write("token create", beside_server=True) as session:
        row = Token(digest=digest_of(text), machine_id=None, created_at=now(), role="admin")
        if machine is not None:
            row.machine_id, row.role = _find_machine(session, machine).id, None
        session.add(row)
        session.flush()
        record(session, "create", f"token {row.id}", machine=machine, by=by)
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


def list_tokens(store: OpenStore) -> list[dict[str, Any]]:
    """Tokens with their machines and times, without the tokens themselves."""
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
                "admin": token.machine_id is None,
                "created_at": token.created_at,
                "revoked_at": token.revoked_at,
            }
        )
    return found


def revoke_token(store: OpenStore, number: int, *, by: str = _LOCAL) -> None:
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
