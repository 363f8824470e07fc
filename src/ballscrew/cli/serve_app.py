"""``ballscrew serve`` and ``ballscrew token``: options, calls of the service, and tables on the terminal."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from ballscrew.base.errors import DONE, WRONG_INPUT, InputError, printable
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.cli.options import Command, CommandGroup, Json, flag, option
from ballscrew.cli.output import console, print_json, progress_bar

if TYPE_CHECKING:
    from ballscrew.store.opened import OpenStore

DataOption = Annotated[
    Path | None,
    option(
        "Data folder of the store. [default: BALLSCREW_STORE, or in the user's data directory]",
        "DIR",
        "--data",
    ),
]

token = typer.Typer(
    cls=CommandGroup, no_args_is_help=True, help="Create, list and revoke the tokens of the service."
)


def serve(
    data: DataOption = None,
    host: Annotated[str | None, option("Address to listen on. [default: 127.0.0.1]", "ADDRESS")] = None,
    port: Annotated[int | None, option("Port to listen on; 0 for any. [default: 8000]", "N")] = None,
    workers: Annotated[
        int | None,
        option(
            "Number of processes for the analysis. [default: the processor's cores less one, 4 at most]", "N"
        ),
    ] = None,
    config: Annotated[
        Path | None, option("File of settings. [default: server.toml in the data folder]", "SERVER.toml")
    ] = None,
    check: Annotated[
        bool, flag("Print the settings, where each comes from, and what is wrong.", "--check")
    ] = False,
    support_bundle: Annotated[
        Path | None,
        option(
            "Write versions, settings, counts and the log for a fault report, and stop. [default: none]",
            "FILE.zip",
        ),
    ] = None,
    demo: Annotated[
        bool,
        flag("Serve a simulated plant of twelve axes; without --data, it is deleted at the end.", "--demo"),
    ] = False,
    as_json: Annotated[bool, flag("With --check, print the settings as JSON.", "--json")] = False,
) -> int:
    """Serve a store over HTTP: receive and analyse runs, assess axes, answer queries.

    Without options, it serves http://127.0.0.1:8000 for this computer alone. Ctrl-C stops it. With `--demo`,
    a plant is simulated first, in about a minute; `--data` is then a new folder, or that of an earlier demo.
    """
    given = {"host": host, "port": port, "workers": workers}
    options: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    if check:
        return _check(data, config, options, as_json=as_json)
    if support_bundle is not None:
        return _bundle(support_bundle, data, config, options)
    if demo:
        return _serve_demo(data, config, options)
    from ballscrew.service.server import serve as serve_store

    serve_store(data, config=config, **options)
    return DONE


@token.command(cls=Command, epilog='Example: ballscrew token create --machine "mill 4"')
def create(
    data: DataOption = None,
    machine: Annotated[
        str | None, option("For a machine, which may only send and show runs of its axes.", "NAME")
    ] = None,
    read_only: Annotated[
        str | None, option("For a program of this name that only reads, such as a dashboard.", "NAME")
    ] = None,
    role: Annotated[
        str | None, option("For a program with a role: viewer, maintainer or admin.", "ROLE")
    ] = None,
    admin: Annotated[bool, flag("The same as --role admin, which may do everything.", "--admin")] = False,
    name: Annotated[str, option("Purpose of the token.", "NAME")] = "",
    as_json: Json = False,
) -> int:
    """Create a token and print it; it is not stored, and cannot be printed again."""
    given = [each for each in (machine, read_only, role, "admin" if admin else None) if each is not None]
    if len(given) != 1:
        raise InputError("give one of --machine NAME, --read-only NAME, --role ROLE and --admin.")
    if admin:
        role = "admin"
    if read_only is not None:
        role, name = "viewer", read_only
    return _create(data, machine, role, name, as_json=as_json)


@token.command(cls=Command, name="list", epilog="Example: ballscrew token list")
def list_tokens(data: DataOption = None, as_json: Json = False) -> int:
    """List the tokens by their numbers."""
    return _list(data, as_json=as_json)


@token.command(cls=Command, epilog="Example: ballscrew token revoke 2")
def revoke(
    number: Annotated[int, typer.Argument(metavar="NUMBER", help="Number of the token.")],
    data: DataOption = None,
    as_json: Json = False,
) -> int:
    """Revoke a token."""
    return _revoke(data, number, as_json=as_json)


def _serve_demo(data: Path | None, config: Path | None, options: dict[str, Any]) -> int:
    """Make a simulated plant, unless it exists, and serve it."""
    from ballscrew.service.demo_processes import demo_processes

    with ExitStack() as stack:
        with (
            progress_bar("making the simulated plant", as_lines=True) as progress,
            demo_processes(early=data is None) as pool,
        ):
            from ballscrew.service.demo import demo_store
            from ballscrew.service.server import serve as serve_store

            folder = stack.enter_context(demo_store(data, pool, progress))
        serve_store(folder, config=config, **options)
    return DONE


def _bundle(to: Path, data: Path | None, config: Path | None, options: dict[str, Any]) -> int:
    """Write a support bundle, and print its name."""
    from ballscrew.service.settings import default_folder, origins, read_settings
    from ballscrew.service.support import write_bundle

    folder = data or default_folder()
    settings = read_settings(folder, config, options)
    write_bundle(folder, settings, origins(folder, config, options), to)
    console().print(f"Support bundle: {to}", markup=False, soft_wrap=True)
    return DONE


def _check(data: Path | None, config: Path | None, options: dict[str, Any], *, as_json: bool) -> int:
    """Print the settings; status 2 if one is wrong."""
    from ballscrew.service.server import check

    settings, problems = check(data, config=config, **options)
    if as_json:
        document = {}
        for name, (value, origin) in settings.items():
            document[name] = {"value": value, "from": origin}
        print_json({"schema": SCHEMA, "settings": document, "problems": problems})
    else:
        table = Table()
        for heading in ("setting", "value", "from"):
            table.add_column(heading)
        for name, (value, origin) in settings.items():
            table.add_row(name, escape(str(value)), escape(origin))
        console().print(table)
    for problem in problems:
        sys.stderr.write(f"ballscrew: {printable(problem)}\n")
    return WRONG_INPUT if problems else DONE


def open_store(data: Path | None, *, create: bool = False) -> OpenStore:
    """Store of a data folder; created if there is none, where that is asked for."""
    from ballscrew.service.settings import default_folder
    from ballscrew.store.folder import DataFolder
    from ballscrew.store.migrating import create_store
    from ballscrew.store.opened import OpenStore

    folder = data or default_folder()
    if create and not DataFolder(folder).exists():
        create_store(folder)
    return OpenStore(folder)


def _create(data: Path | None, machine: str | None, role: str | None, name: str, *, as_json: bool) -> int:
    """Create a token and print it once."""
    from ballscrew.service.tokens import create_token

    number, text = create_token(open_store(data, create=True), machine, role=role, name=name)
    if as_json:
        print_json({"schema": SCHEMA, "id": number, "machine": machine, "role": role, "token": text})
    else:
        console().print(text, markup=False, soft_wrap=True)
        sys.stderr.write(f"Token {number}; it cannot be printed again.\n")
    return DONE


def _list(data: Path | None, *, as_json: bool) -> int:
    """Print the tokens."""
    from ballscrew.service.tokens import list_tokens

    tokens = list_tokens(open_store(data))
    if as_json:
        print_json({"schema": SCHEMA, "tokens": tokens})
        return DONE
    table = Table()
    for heading in ("number", "of", "name", "created", "revoked"):
        table.add_column(heading)
    for row in tokens:
        table.add_row(
            str(row["id"]),
            str(row["role"]) if row["role"] else f"machine {escape(row['machine'])}",
            escape(row["name"]) or "–",
            row["created_at"],
            row["revoked_at"] or "–",
        )
    console().print(table)
    return DONE


def _revoke(data: Path | None, number: int, *, as_json: bool) -> int:
    """Revoke a token."""
    from ballscrew.service.tokens import revoke_token

    revoke_token(open_store(data), number)
    if as_json:
        print_json({"schema": SCHEMA, "id": number, "revoked": True})
    else:
        console().print(f"Revoked: token {number}.", markup=False)
    return DONE
