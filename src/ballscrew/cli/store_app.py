"""Options of ``ballscrew store``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ballscrew.cli.options import Command, CommandGroup, Json, Seed, flag, option

StoreFolder = Annotated[
    Path | None, option("Data folder of the store.", "DIR", "--store", envvar="BALLSCREW_STORE")
]
Reason = Annotated[str, option("Reason, for the audit.", "TEXT")]
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

    RUN.toml is analysed, and its raw files are stored; of RUN.json only the result is stored.
    """
    from ballscrew.cli.store import add_files, open_store

    return add_files(
        open_store(store), files, axis=axis, machine=machine, site=site, method=method, as_json=as_json
    )


@store.command(cls=Command, name="list", epilog="Example: ballscrew store list --store plant")
def list_axes(store: StoreFolder = None, as_json: Json = False) -> int:
    """List the axes with their states according to the newest assessment."""
    from ballscrew.cli.store import list_store, open_store

    return list_store(open_store(store), as_json=as_json)


@store.command(cls=Command, epilog='Example: ballscrew store show "X axis" --store plant')
def show(
    subject: Annotated[
        str, typer.Argument(metavar="AXIS | RUN", help="Name of an axis; id of a run or its beginning.")
    ],
    store: StoreFolder = None,
    as_json: Json = False,
) -> int:
    """Show an axis, or the provenance of a run's numbers.

    For an axis: its runs and their states, alarms, events, exclusions, corrections and conflicts. For a run:
    its recordings by their hashes, their readers, documents, settings, method and versions.
    """
    from ballscrew.cli.store import open_store, show_store

    return show_store(open_store(store), subject, as_json=as_json)


@store.command(
    cls=Command, epilog="Example: ballscrew store correct 6d0ec71e163e --measured-at 2026-01-31T08:00Z"
)
def correct(
    subject: Annotated[
        str, typer.Argument(metavar="RUN | AXIS", help="Id of a run or its beginning; with --model, an axis.")
    ],
    store: StoreFolder = None,
    measured_at: Annotated[
        str | None, option("Time of the run, ISO 8601. [default: unchanged]", "2026-01-31T08:00Z")
    ] = None,
    mass: Annotated[str | None, option("Load on the table. [default: unchanged]", '"100 kg"')] = None,
    model: Annotated[
        str | None, option("Digest of the model of the axis, or its beginning.", "DIGEST")
    ] = None,
    reason: Reason = "",
    as_json: Json = False,
) -> int:
    """Correct the time or the load of a run, or choose another model of an axis; the old value stays."""
    from ballscrew.cli.store import correct_store, open_store

    return correct_store(
        open_store(store),
        subject,
        measured_at=measured_at,
        mass=mass,
        model=model,
        reason=reason,
        as_json=as_json,
    )


@store.command(cls=Command, epilog='Example: ballscrew store exclude 6d0ec71e163e --reason "loose sensor"')
def exclude(
    subject: Annotated[
        str, typer.Argument(metavar="RUN | EVENT", help="Id of a run or an event, or its beginning.")
    ],
    store: StoreFolder = None,
    reason: Reason = "",
    undo: Annotated[bool, flag("Include it again.", "--undo")] = False,
    as_json: Json = False,
) -> int:
    """Exclude a run or an event from the history of its axis; it stays in the store."""
    from ballscrew.cli.store import exclude_store, open_store

    return exclude_store(open_store(store), subject, reason=reason, undo=undo, as_json=as_json)


@store.command(
    cls=Command, epilog='Example: ballscrew store archive "X axis" --to /mnt/archive --store plant'
)
def archive(
    axis: AxisName,
    to: Annotated[Path, option("Folder for the raw files.", "DIR")],
    store: StoreFolder = None,
    newest: Annotated[int, option("Newest runs whose raw files stay.", "N", min=0)] = 30,
    as_json: Json = False,
) -> int:
    """Move raw files of an axis to another folder; the results stay.

    Raw files of the newest runs, of references and of runs at which an alarm began stay in the store.
    """
    from ballscrew.cli.store import archive_store, open_store

    return archive_store(open_store(store), axis, to, newest=newest, as_json=as_json)


@store.command(cls=Command, epilog='Example: ballscrew store export "X axis" --to x-axis --store plant')
def export(
    axis: AxisName,
    to: Annotated[Path, option("New folder.", "DIR")],
    store: StoreFolder = None,
    raw: Annotated[bool, flag("Write the raw files too.", "--raw")] = False,
    as_json: Json = False,
) -> int:
    """Write the history of an axis as files for the other commands."""
    from ballscrew.cli.store import export_store, open_store

    return export_store(open_store(store), axis, to, raw=raw, as_json=as_json)


@store.command(cls=Command, epilog="Example: ballscrew store verify --store plant")
def verify(store: StoreFolder = None, as_json: Json = False) -> int:
    """Compare every file and row with its hash; a damaged store is read-only from then on."""
    from ballscrew.cli.store import verify_store

    return verify_store(store, as_json=as_json)


@store.command(cls=Command, epilog="Example: ballscrew store backup --to backup-2026-01-31 --store plant")
def backup(
    to: Annotated[Path, option("New folder.", "DIR")], store: StoreFolder = None, as_json: Json = False
) -> int:
    """Copy the store as it is at one moment, even while others add to it; the copy uses SQLite."""
    from ballscrew.cli.store import backup_store, open_store

    return backup_store(open_store(store), to, as_json=as_json)


@store.command(cls=Command, epilog="Example: ballscrew store restore backup-2026-01-31 --to plant")
def restore(
    folder: Annotated[Path, typer.Argument(metavar="BACKUP", help="Folder of the backup.")],
    to: Annotated[Path, option("New folder of the store.", "DIR")],
    database: Annotated[
        str | None,
        option("Empty PostgreSQL database. [default: SQLite in DIR]", "postgresql://user@host/name"),
    ] = None,
    as_json: Json = False,
) -> int:
    """Verify a backup and restore it to a new folder."""
    from ballscrew.cli.store import restore_store

    return restore_store(folder, to, database, as_json=as_json)


@store.command(cls=Command, epilog="Example: ballscrew store migrate --store plant")
def migrate(store: StoreFolder = None, as_json: Json = False) -> int:
    """Migrate a store of an earlier version to the schema of this version; make a backup first."""
    from ballscrew.cli.store import migrate_store

    return migrate_store(store, as_json=as_json)


@store.command(cls=Command, epilog="Example: ballscrew store gc --dry-run --store plant")
def gc(
    store: StoreFolder = None,
    dry_run: Annotated[bool, flag("List the files only.", "--dry-run")] = False,
    as_json: Json = False,
) -> int:
    """Remove files that no row refers to: those of interrupted additions, and archived ones."""
    from ballscrew.cli.store import gc_store, open_store

    return gc_store(open_store(store), dry_run=dry_run, as_json=as_json)


@store.command(cls=Command, epilog="Example: ballscrew store retain --days 365 --dry-run --store plant")
def retain(
    store: StoreFolder = None,
    days: Annotated[
        float | None,
        option("Age of the raw files that are deleted. [default: retention_days of server.toml]", "DAYS"),
    ] = None,
    newest: Annotated[
        int | None,
        option(
            "Newest runs of an axis whose raw files stay. [default: retention_newest of server.toml, or 30]",
            "N",
        ),
    ] = None,
    dry_run: Annotated[bool, flag("List the files only.", "--dry-run")] = False,
    as_json: Json = False,
) -> int:
    """Delete old raw files; the results stay.

    Raw files of baselines, of runs at which an alarm began and of the newest runs stay, as do all raw files
    of an axis that has not been assessed since its last change.
    """
    from ballscrew.cli.store import open_store, retain_store

    return retain_store(open_store(store), days, newest, dry_run=dry_run, as_json=as_json)


@store.command(
    cls=Command,
    name="simulate-fleet",
    epilog="Example: ballscrew store simulate-fleet --axes 10 --store test",
)
def simulate_fleet(
    store: StoreFolder = None,
    axes: Annotated[int, option("Number of axes.", "N", min=1)] = 300,
    years: Annotated[float, option("Length of their histories.", "YEARS")] = 5.0,
    runs_per_week: Annotated[float, option("Runs of each axis per week.", "N")] = 1.0,
    cells: Annotated[int, option("Cells of each run.", "N", min=1)] = 40,
    seed: Seed = 0,
    as_json: Json = False,
) -> int:
    """Add the rows of a synthetic fleet to a store for scale tests; nothing is analysed."""
    from ballscrew.cli.store import open_store, simulate_fleet_store

    return simulate_fleet_store(
        open_store(store),
        axes=axes,
        years=years,
        runs_per_week=runs_per_week,
        cells=cells,
        seed=seed,
        as_json=as_json,
    )


def reprocess(
    axes: Annotated[
        list[str] | None, typer.Argument(metavar="[AXIS…]", help="Names of axes; by default all.")
    ] = None,
    store: StoreFolder = None,
    method: Annotated[str, option("Method of the analysis, as for `analyze`.", "joint|paper")] = "joint",
    workers: Annotated[int, option("Number of processes for the analysis.", "N", min=1)] = 1,
    scheduler: Annotated[
        str | None,
        option(
            "Dask scheduler whose workers analyse the runs; TLS if on another computer. [default: none]",
            "tcp://127.0.0.1:PORT",
        ),
    ] = None,
    switch: Annotated[bool, flag("Make the new results the whole history of each axis.", "--switch")] = False,
    as_json: Json = False,
) -> int:
    """Analyse stored raw files with this version, and show how the results differ from the old ones.

    The new results are stored beside the old; the history changes only with --switch.
    """
    from ballscrew.cli.store import open_store, reprocess_store

    return reprocess_store(
        open_store(store),
        axes or [],
        method=method,
        workers=workers,
        scheduler=scheduler,
        switch=switch,
        as_json=as_json,
    )


def report(
    out: Annotated[Path, option("File to write.", "FILE.html|FILE.pdf")],
    axis: Annotated[
        str | None, typer.Argument(metavar="[AXIS]", help="Name of an axis; by default all.")
    ] = None,
    data: Annotated[
        Path | None, option("Data folder of the store.", "DIR", "--data", envvar="BALLSCREW_STORE")
    ] = None,
    as_json: Json = False,
) -> int:
    """Write the state of an axis, or of all axes with the worst first, as one HTML or PDF file.

    The numbers are those of `store show`. The store is only read, and may be served meanwhile.
    """
    from ballscrew.cli.store import open_store, report_store

    return report_store(open_store(data, "--data"), axis, out, as_json=as_json)
