"""``ballscrew store``: calls of the store, and its tables on the terminal."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.table import Table

from ballscrew.base.errors import DONE, WRONG_INPUT, InputError, printable
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.base.words import interval_words, life_words, percent, plural
from ballscrew.cli.output import STATE_STYLE, console, print_json, progress_bar, right_aligned
from ballscrew.report.stored_words import changes, exclusions, stored_headline, utc_minute

if TYPE_CHECKING:
    from ballscrew.store.inserting import Added
    from ballscrew.store.opened import OpenStore

_SHOWN_RUNS = 30  # newest runs in the table


def open_store(path: Path | None, name: str = "--store") -> OpenStore:
    """The store of an option.

    Raises
    ------
    InputError
        If none is given, or it is none.
    """
    from ballscrew.store.opened import OpenStore

    return OpenStore(given_folder(path, name))


def init_store(path: Path, database: str | None, *, as_json: bool) -> int:
    """Create a store."""
    from ballscrew.store.migrating import create_store

    store = create_store(path, database=database)
    if as_json:
        print_json({"schema": SCHEMA, "store": str(store.path)})
    else:
        console().print(f"Store: {store.path}", markup=False, soft_wrap=True)
    return DONE


def add_files(
    store: OpenStore,
    files: Sequence[Path],
    *,
    axis: str | None,
    machine: str | None,
    site: str | None,
    method: str,
    as_json: bool,
) -> int:
    """Add files; one that cannot be added is named and does not stop the others."""
    from ballscrew.store.adding import add

    if site is not None and machine is None:
        raise InputError("a site is that of a machine; give it too (--machine).")
    added, status = [], DONE
    for path in files:
        try:
            with progress_bar(path.name) as progress:
                found = add(
                    store, path, axis=axis, machine=machine, site=site, method=method, progress=progress
                )
        except InputError as error:
            if len(files) == 1:
                raise
            sys.stderr.write(f"ballscrew: {error}\n")
            status = error.exit_status
            continue
        added.append((path, found))
        if not as_json:
            _print_added(path, found)
    if as_json:
        print_json({"schema": SCHEMA, "added": [_added_document(path, found) for path, found in added]})
    return status


def _added_document(path: Path, added: Added) -> dict[str, Any]:
    return {
        "file": str(path),
        "kind": added.kind,
        "id": added.subject,
        "axis": added.axis,
        "new": added.is_new,
        "notes": list(added.notes),
    }


def _print_added(path: Path, added: Added) -> None:
    what = added.kind if added.kind == "events" else f"{added.kind} {added.subject[:12]}"
    done = "added" if added.is_new else "was there already"
    screen = console()
    screen.print(f"{path}: {what} of {added.axis}: {done}.", markup=False, soft_wrap=True)
    for note in added.notes:
        screen.print(f"  • {note}", markup=False)


def list_store(store: OpenStore, *, as_json: bool) -> int:
    """Print the fleet."""
    from ballscrew.store.reading import list_axes

    document = list_axes(store)
    if as_json:
        print_json(document)
        return DONE
    table = Table()
    for heading in ("site", "machine", "axis"):
        table.add_column(heading)
    for heading in ("runs", "stiffness\nas P/P₀ (95 %)", "remaining\nlife, days"):
        table.add_column(heading, justify="right")
    for heading in ("state", "newest run"):
        table.add_column(heading)
    for row in document["axes"]:
        place = [escape(row[name] or "–") for name in ("site", "machine", "axis")]
        newest = utc_minute(row["newest_at"])
        numbers = [str(row["runs"]), interval_words(row["stiffness"]), life_words(row["rul_days"])]
        table.add_row(*place, *numbers, _state(row["state"]), newest)
    console().print(table)
    return DONE


def _state(state: str) -> str:
    style = STATE_STYLE.get(state, "bright_black")
    return f"[{style}]{state}[/]"


def show_store(store: OpenStore, subject: str, *, as_json: bool) -> int:
    """Print an axis with all that belongs to it, or a run with what its numbers come from."""
    from ballscrew.store.showing import show

    document = show(store, subject)
    if as_json:
        print_json(document)
    elif "recordings" in document:
        for line in _provenance(document):
            console().print(printable(line), markup=False)
    else:
        _print_axis(document)
    return DONE


def _print_axis(document: dict[str, Any]) -> None:
    screen = console()
    screen.print(stored_headline(document), markup=False)
    for action in document["to_do"]:
        screen.print(f"→ {action['text']}", markup=False)
    for trouble in document["measurement"]["troubles"]:
        screen.print(printable(f"Measurement: {trouble['text']}"), markup=False)
    screen.print(_runs(document["runs"]))
    for alarm in document["alarms"]:
        text = f"Alarm since {utc_minute(alarm['began_at'])}, raised {utc_minute(alarm['raised_at'])}"
        if alarm["retracted_at"]:
            text += f", retracted {utc_minute(alarm['retracted_at'])}"
        elif alarm["over_at"]:
            text += f", over since {utc_minute(alarm['over_at'])}"
        screen.print(f"{text}.", markup=False)
    for event in document["events"]:
        name = "Event" if event["digest"] is None else f"Event {event['digest'][:12]}"
        text = f"{name}, {utc_minute(event['at'])}: {event['kind']}"
        screen.print(printable(f"{text}: {event['text']}" if event["text"] else text), markup=False)
    for line in (*exclusions(document), *changes(document)):
        screen.print(printable(line), markup=False)


def _provenance(document: dict[str, Any]) -> Iterator[str]:
    """Lines on a run, its recordings and its results."""
    load = "no load stated" if document["mass_kg"] is None else f"{document['mass_kg']:g} kg"
    time = document["measured_at"] or "no time"
    yield f"Run {document['run']} of {document['axis']}: {time}, {load}"
    if not document["counts"]:
        yield "It does not count: it was corrected or excluded, or another correction was added later."
    if document["supersedes"]:
        yield f"Correction of the run {document['supersedes']}"
    for run in document["corrected_as"]:
        yield f"Corrected as the run {run}"
    yield from _origins(document)
    state = document["state"]
    if state is not None:
        epoch = f"epoch {state['epoch']} from {state['begins'] or 'the first run'}"
        yield f"State {state['state']}, {epoch}, relative to the run {state['reference'] or '–'}"
        yield f"  by the model {state['model_digest']}, ballscrew {state['version']}, {state['made_at']}"


def _origins(document: dict[str, Any]) -> Iterator[str]:
    """Lines on the recordings, documents and results of a run."""
    for file in document["recordings"]:
        yield f"Recording {file['name']}: SHA-256 {file['sha256']}"
        yield f"  reader {file['reader'] or 'not stated'}; {_place(file)}"
    for kind, key in sorted(document["documents"].items()):
        yield f"{kind}: digest {key}"
    for result in document["results"]:
        text = f"Result by {result['method']}, revision {result['revision']}, ballscrew {result['version']}"
        history = ", part of the history" if result["history"] else ""
        yield f"{text}: {result['quality']}{history}; digest {result['digest']}"
        yield f"  settings {json.dumps(result['settings'], sort_keys=True)}"


def _place(file: dict[str, Any]) -> str:
    """Where the content of a recording is."""
    if file["stored"]:
        return "in the store"
    if file["deleted_at"] is not None:
        return f"deleted by policy at {utc_minute(file['deleted_at'])}"
    return file["archived_to"] or "not in the store"


def _runs(runs: Sequence[dict[str, Any]]) -> Table:
    shown = runs[-_SHOWN_RUNS:]
    title = plural(len(runs), "run")
    if len(shown) < len(runs):
        title = f"the newest {len(shown)} of {title}"
    table = Table(title=title, title_justify="left")
    for heading in ("run", "measured at", "load, kg", "measurement"):
        table.add_column(heading)
    table.add_column("stiffness\nas P/P₀ (95 %)", justify="right")
    table.add_column("state")
    for run in shown:
        load = "–" if run["mass_kg"] is None else f"{run['mass_kg']:g}"
        row = [escape(run["run"][:12]), utc_minute(run["measured_at"]), load]
        row += [run["quality"] or "no result", interval_words(run["stiffness"])]
        table.add_row(*row, _state(run["state"] if run["counts"] else "does not count"))
    return table


def correct_store(
    store: OpenStore,
    subject: str,
    *,
    measured_at: str | None,
    mass: str | None,
    model: str | None,
    reason: str,
    as_json: bool,
) -> int:
    """Correct a run, or choose the model of an axis."""
    from ballscrew.store.changing import choose_model, correct_run

    if model is None:
        found = correct_run(store, subject, measured_at=measured_at, mass=mass, reason=reason)
        return _report({"run": found, "supersedes": subject}, f"Corrected; its id is now {found}.", as_json)
    if measured_at is not None or mass is not None:
        raise InputError("--model is for an axis, --measured-at and --mass are for a run; give one of them.")
    found = choose_model(store, subject, model, reason=reason)
    return _report({"axis": subject, "model": found}, f"Model of {subject}: {found}.", as_json)


def _report(document: dict[str, Any], sentence: str, as_json: bool) -> int:
    """Print what was done."""
    if as_json:
        print_json({"schema": SCHEMA} | document)
    else:
        console().print(sentence, markup=False, soft_wrap=True)
    return DONE


def exclude_store(store: OpenStore, subject: str, *, reason: str, undo: bool, as_json: bool) -> int:
    """Exclude a run or an event, or include it again."""
    from ballscrew.store.changing import exclude

    found = exclude(store, subject, reason=reason, undo=undo)
    done = "Included" if undo else "Excluded"
    return _report({"id": found, "excluded": not undo}, f"{done}: {found}.", as_json)


def archive_store(store: OpenStore, axis: str, to: Path, *, newest: int, as_json: bool) -> int:
    """Move raw files of an axis to another folder."""
    from ballscrew.store.copying import archive

    document = archive(store, axis, to, newest=newest)
    return _report(document, "Archived: {files} files, {bytes} bytes, to {to}.".format_map(document), as_json)


def export_store(store: OpenStore, axis: str, to: Path, *, raw: bool, as_json: bool) -> int:
    """Write the history of an axis as files."""
    from ballscrew.store.copying import export

    folder = export(store, axis, to, raw=raw)
    return _report({"axis": axis, "to": str(folder)}, f"Exported: {folder}", as_json)


def verify_store(path: Path | None, *, as_json: bool) -> int:
    """Verify a store; status 2 if it is damaged."""
    from ballscrew.store.checking import verify

    found = verify(given_folder(path))
    if as_json:
        print_json(found.to_json())
    else:
        screen = console()
        text = f"{found.rows} rows and {found.files} raw files verified: {len(found.faults)} faults."
        if found.orphans:
            text += f" {len(found.orphans)} files belong to no run; 'ballscrew store gc' removes them."
        screen.print(text, markup=False)
    for fault in found.faults:
        sys.stderr.write(f"ballscrew: damaged: {printable(fault)}\n")
    return WRONG_INPUT if found.faults else DONE


def given_folder(path: Path | None, name: str = "--store") -> Path:
    """Folder of an option."""
    if path is None:
        raise InputError(f"no store is given: give its folder ({name} DIR), or set BALLSCREW_STORE.")
    return path


def backup_store(store: OpenStore, to: Path, *, as_json: bool) -> int:
    """Copy the store."""
    from ballscrew.store.copying import backup

    folder = backup(store, to)
    return _report({"backup": str(folder)}, f"Backup: {folder}", as_json)


def restore_store(folder: Path, to: Path, database: str | None, *, as_json: bool) -> int:
    """Restore a backup."""
    from ballscrew.store.copying import restore

    store = restore(folder, to, database=database)
    return _report({"store": str(store.path)}, f"Store: {store.path}", as_json)


def migrate_store(path: Path | None, *, as_json: bool) -> int:
    """Migrate a store to the schema of this version."""
    from ballscrew.store.migrating import migrate
    from ballscrew.store.tables import SCHEMA as TABLES

    folder = given_folder(path)
    found = migrate(folder)
    sentence = f"{folder}: schema {found} migrated to {TABLES}."
    if found == TABLES:
        sentence = f"{folder}: has schema {TABLES} already."
    return _report({"store": str(folder), "from": found, "to": TABLES}, sentence, as_json)


def gc_store(store: OpenStore, *, dry_run: bool, as_json: bool) -> int:
    """Remove files that no row refers to."""
    from ballscrew.store.checking import gc

    document = gc(store, dry_run=dry_run)
    done = "To be removed" if dry_run else "Removed"
    return _report(document, f"{done}: {len(document['removed'])} files, {document['bytes']} bytes.", as_json)


def retain_store(
    store: OpenStore, days: float | None, newest: int | None, *, dry_run: bool, as_json: bool
) -> int:
    """Delete raw files by a policy."""
    from ballscrew.store.retention import RetentionPolicy, retain

    settings = _server_settings(store.path)
    if days is None:
        days = getattr(settings, "retention_days", None)
    if newest is None:
        newest = getattr(settings, "retention_newest", 30)
    if days is None:
        raise InputError("no policy is given: state an age (--days), or retention_days in server.toml.")
    document = retain(store, RetentionPolicy(days, newest), dry_run=dry_run)
    number = sum(len(axis["files"]) for axis in document["axes"])
    done = "To be deleted" if dry_run else "Deleted"
    sentence = f"{done}: {plural(number, 'raw file')}, {document['bytes']} bytes."
    return _report(document, sentence, as_json)


def _server_settings(folder: Path) -> Any:
    """Settings of the server of a store; None where it has no server.toml."""
    if not (folder / "server.toml").is_file():
        return None
    from ballscrew.service.settings import read_settings

    return read_settings(folder, None, {})


def reprocess_store(
    store: OpenStore,
    axes: Sequence[str],
    *,
    method: str,
    workers: int,
    scheduler: str | None,
    switch: bool,
    as_json: bool,
) -> int:
    """Analyse stored raw files again, and print the differences of each axis."""
    from ballscrew.store.reprocessing import reprocess

    with progress_bar("reprocess") as progress:
        document = reprocess(
            store, axes, method=method, workers=workers, scheduler=scheduler, switch=switch, progress=progress
        )
    for failure in document["failures"]:
        sys.stderr.write(f"ballscrew: {printable(failure)}\n")
    if as_json:
        print_json(document)
    else:
        table = right_aligned(
            ("runs", "without", "median change", "largest change", "other verdict"), "axis", "history"
        )
        for axis in document["axes"]:
            numbers = [str(axis["runs"]), str(axis["missing"])]
            numbers += [_part(axis["median_change"]), _part(axis["largest_change"])]
            history = "new results" if axis["switched"] else "old results"
            table.add_row(*numbers, str(axis["verdict_changes"]), escape(axis["axis"]), history)
        console().print(table)
        for axis in document["axes"]:
            if axis["without_files"]:
                console().print(_describe_change(axis), markup=False)
    return WRONG_INPUT if document["failures"] else DONE


def _part(number: float | None) -> str:
    return "–" if number is None else percent(number)


def _describe_change(axis: dict[str, Any]) -> str:
    """What a switch does, or did, to an axis with runs whose raw files are gone."""
    from ballscrew.store.methods import describe_step

    text = f"{printable(axis['axis'])}: {plural(axis['without_files'], 'run')} without raw files"
    step = axis["step"]
    if step is None:
        return f"{text}; the step to the new results cannot be estimated."
    size = describe_step(step["value"], step["standard_uncertainty"])
    what = f"{text} keep their results, with an event of the step"
    if not axis["switched"]:
        what = f"{text}: by --switch they keep their results, with an event of the step"
    return f"{what}: {size}, by {step['runs']} runs with both."


def simulate_fleet_store(store: OpenStore, *, as_json: bool, **numbers: Any) -> int:
    """Add the rows of a synthetic fleet."""
    from ballscrew.store.fleet import simulate_fleet

    with progress_bar("simulate-fleet") as progress:
        document = simulate_fleet(store, progress=progress, **numbers)
    return _report(document, "Added: {axes} axes, {runs} runs, {cells} cells.".format_map(document), as_json)


def report_store(store: OpenStore, axis: str | None, out: Path, *, as_json: bool) -> int:
    """Write a report, and print its name."""
    from ballscrew.store.reporting import report

    settings = _server_settings(store.path)
    calendar = {} if settings is None else {"calendar": settings.calendar}
    with progress_bar(out.name) as progress:
        document = report(store, axis, out=out, progress=progress, **calendar)
    if as_json:
        print_json(document)
    else:
        console().print(f"Report: {out}", markup=False, soft_wrap=True)
    return DONE
