"""Options of ``ballscrew store``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ballscrew.cli.options import Command, CommandGroup, Json, option

StoreFolder = Annotated[
    Path | None, option("Data folder of the store.", "DIR", "--store", envvar="BALLSCREW_STORE")
]
AxisName = Annotated[str, typer.Argument(metavar="AXIS", help="Name of the axis in its data sheet.")]

store = typer.Typer(
    cls=CommandGroup,
    no_args_is_help=True,
    help="Store the runs of a fleet with their raw files, results, models, events and states.",
)


@store.command(cls=Command, epilog="Example: ballscrew store init plant")
def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Data folder: new, or empty.")],
    database: Annotated[
        str | None,
        option("Empty PostgreSQL database. [default: SQLite in DIR]", "postgresql://user@host/name"),
    ] = None,
    as_json: Json = False,
) -> int:
    """Create an empty store in a folder."""
    from ballscrew.cli.store import init_store

    return init_store(folder, database, as_json=as_json)


@store.command(cls=Command, epilog="Example: ballscrew store add run.toml --store plant")
def add(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILES…",
            help="RUN.toml, RUN.json, MODEL.json, EVENTS.toml or a data sheet, in any order.",
        ),
    ],
    store: StoreFolder = None,
    axis: Annotated[str | None, option("Axis of the events, for EVENTS.toml.", "AXIS")] = None,
    machine: Annotated[str | None, option("Machine of the axis, for a data sheet.", "NAME")] = None,
    site: Annotated[str | None, option("Site of the machine, for a data sheet.", "NAME")] = None,
    method: Annotated[
        str, option("Method of the analysis of RUN.toml, as for `analyze`.", "joint|paper")
    ] = "joint",
    as_json: Json = False,
) -> int:
    """Add runs, models, events and data sheets; the same content counts once.

    RUN.toml is analysed, and its raw files are stored; of RUN.json the result alone is stored.
    """
    from ballscrew.cli.store import add_files, open_store

    return add_files(
        open_store(store), files, axis=axis, machine=machine, site=site, method=method, as_json=as_json
    )


@store.command(cls=Command, name="list", epilog="Example: ballscrew store list --store plant")
def list_axes(store: StoreFolder = None, as_json: Json = False) -> int:
    """List the axes with their states by the newest assessment."""
    from ballscrew.cli.store import list_store, open_store

    return list_store(open_store(store), as_json=as_json)


@store.command(cls=Command, epilog='Example: ballscrew store show "X axis" --store plant')
def show(axis: AxisName, store: StoreFolder = None, as_json: Json = False) -> int:
    """Show an axis: its runs and their states, alarms, events and exclusions."""
    from ballscrew.cli.store import open_store, show_store

    return show_store(open_store(store), axis, as_json=as_json)
