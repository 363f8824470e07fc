"""``ballscrew user``: users of the service, also beside a running server."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from ballscrew.base.errors import DONE
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.cli.options import Command, CommandGroup, Json, flag, option
from ballscrew.cli.output import console, print_json
from ballscrew.cli.serve_app import DataOption, open_store

NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="Name of the user.")]

user = typer.Typer(
    cls=CommandGroup, no_args_is_help=True, help="Add, list, change and disable the users of the service."
)


@user.command(cls=Command, epilog="Example: ballscrew user add anna --role admin")
def add(
    name: NameArgument,
    role: Annotated[
        str, option("What the user may do: viewer, maintainer or admin; the first must be admin.", "ROLE")
    ] = "viewer",
    data: DataOption = None,
    as_json: Json = False,
) -> int:
    """Add a user and print a link to choose a password, valid once and for a day."""
    from ballscrew.service.users import add_user

    address = _address(data)
    link = address + add_user(open_store(data, create=True), name, role)
    return _print_link(name, link, as_json=as_json)


@user.command(cls=Command, name="list", epilog="Example: ballscrew user list")
def list_all(data: DataOption = None, as_json: Json = False) -> int:
    """List the users."""
    from ballscrew.service.users import list_users

    users = list_users(open_store(data))
    if as_json:
        print_json({"schema": SCHEMA, "users": users})
        return DONE
    table = Table()
    for heading in ("name", "role", "state", "since"):
        table.add_column(heading)
    for row in users:
        state = "active" if row["password"] else "invited"
        if row["disabled_at"]:
            state = "disabled"
        table.add_row(escape(row["name"]), row["role"], state, row["created_at"])
    console().print(table)
    return DONE


@user.command(cls=Command, epilog="Example: ballscrew user role anna admin")
def role(
    name: NameArgument,
    new: Annotated[str, typer.Argument(metavar="ROLE", help="viewer, maintainer or admin.")],
    data: DataOption = None,
    as_json: Json = False,
) -> int:
    """Change the role of a user; the user's sessions end."""
    from ballscrew.service.users import change_role

    change_role(open_store(data), name, new)
    return _print_done({"name": name, "role": new}, f"{name}: {new}.", as_json=as_json)


@user.command(cls=Command, epilog="Example: ballscrew user disable anna")
def disable(
    name: NameArgument,
    undo: Annotated[bool, flag("Enable the user again.", "--undo")] = False,
    data: DataOption = None,
    as_json: Json = False,
) -> int:
    """Disable a user; the user's sessions and links expire."""
    from ballscrew.service.users import disable_user

    disable_user(open_store(data), name, undo=undo)
    state = "Enabled" if undo else "Disabled"
    return _print_done({"name": name, "disabled": not undo}, f"{state}: {name}.", as_json=as_json)


@user.command(cls=Command, epilog="Example: ballscrew user link anna")
def link(name: NameArgument, data: DataOption = None, as_json: Json = False) -> int:
    """Print a new link for a user, for example after a forgotten password; earlier links expire."""
    from ballscrew.service.users import new_link

    address = _address(data)
    return _print_link(name, address + new_link(open_store(data), name), as_json=as_json)


def _address(data: Path | None) -> str:
    """Beginning of the address of a link; read before anything is changed."""
    from ballscrew.service.settings import default_folder, read_settings
    from ballscrew.service.users import address_last_served

    folder = data or default_folder()
    return f"{address_last_served(folder, read_settings(folder, None, {}))}/link/"


def _print_link(name: str, address: str, *, as_json: bool) -> int:
    """Print a link."""
    from ballscrew.service.users import LINK_HOURS

    if as_json:
        print_json({"schema": SCHEMA, "name": name, "link": address})
    else:
        console().print(address, markup=False, soft_wrap=True)
        sys.stderr.write(f"Valid once, for {LINK_HOURS} h; it cannot be printed again.\n")
    return DONE


def _print_done(document: dict[str, object], sentence: str, *, as_json: bool) -> int:
    if as_json:
        print_json({"schema": SCHEMA, **document})
    else:
        console().print(sentence, markup=False)
    return DONE
