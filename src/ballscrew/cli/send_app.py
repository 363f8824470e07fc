"""``ballscrew send``: its options, and what it prints."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TextIO

import typer

from ballscrew.base.errors import DONE, SPOOLED, WRONG_INPUT, InputError, printable
from ballscrew.base.words import plural
from ballscrew.cli.options import flag, option

if TYPE_CHECKING:
    from ballscrew.sending.outgoing import OutgoingRun, RunRule
    from ballscrew.sending.server import Answer
    from ballscrew.sending.settings import SendSettings

_GIGABYTE = 1e9


def send(
    to: Annotated[str, option("URL of the server.", "https://host:8443")],
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[FILES…]",
            help="RUN.toml or RUN.json files, folders of one run each, or the recordings of one run. Without "
            "them, what is in the spool.",
        ),
    ] = None,
    watch: Annotated[
        Path | None,
        option("Send each run of a folder when it is complete, until interrupted by Ctrl-C.", "DIR"),
    ] = None,
    axis: Annotated[
        str | None,
        option("Name of the axis. [default: the pattern's, else that of RUN.toml's data sheet]", "AXIS"),
    ] = None,
    run: Annotated[
        str | None, option("Key of the run at the server. [default: a hash of its content]", "KEY")
    ] = None,
    pattern: Annotated[
        str | None,
        option(
            'Names of recordings without RUN.toml, such as "{axis}_{run}_trip{trip}.h5": files with the same '
            "{axis} and {run} in a folder are a run; {trip} and * may be anything. With '/', folders too.",
            "PATTERN",
        ),
    ] = None,
    trips: Annotated[
        int | None, option("Files per complete run without RUN.toml. [default: --plan's]", "N", min=1)
    ] = None,
    plan: Annotated[
        Path | None, option("Plan with one file per round trip; sets --trips.", "PLAN.toml")
    ] = None,
    send_incomplete: Annotated[bool, flag("Send runs with fewer files too.", "--send-incomplete")] = False,
    documents: Annotated[
        bool,
        flag(
            "Send data sheet, plan and channel map of RUN.toml too, to be used instead of the server's.",
            "--documents",
        ),
    ] = False,
    settle: Annotated[
        float,
        option("With --watch: a file is complete when unchanged for this long, s.", "SECONDS", min=0),
    ] = 10.0,
    timeout: Annotated[
        float,
        option(
            "With --watch: seconds without new files after which a run counts as incomplete (without "
            "--trips: as complete).",
            "SECONDS",
            min=0,
        ),
    ] = 900.0,
    spool: Annotated[
        Path | None,
        option(
            "Folder for copies of what is not yet sent, for one server. [default: in the user's data folder]",
            "DIR",
        ),
    ] = None,
    spool_limit: Annotated[
        float, option("Largest size of the spool, GB; further runs stay where they are.", "GB", min=0)
    ] = 10.0,
    token_file: Annotated[
        Path | None, option("File with the token. [default: the variable BALLSCREW_TOKEN]", "FILE")
    ] = None,
    allow_plain_http: Annotated[
        bool, flag("Allow http:// to another host, in a trusted network.", "--allow-plain-http")
    ] = False,
    tries: Annotated[
        int, option("Unsuccessful attempts after which the command ends; not with --watch.", "N", min=1)
    ] = 6,
    dry_run: Annotated[
        bool, flag("List what would be sent; nothing is copied or sent.", "--dry-run")
    ] = False,
    as_json: Annotated[
        bool, flag("Print one JSON document at the end; neither with --watch nor --dry-run.", "--json")
    ] = False,
) -> int:
    """Send runs to a server (`ballscrew serve`): none is lost, and none counts twice.

    Each run is copied into a spool on the disk, sent with retries, and removed from the spool when the
    server has acknowledged it. Your files are not changed. The same run may be sent any number of times.

    Runs that the server refuses are moved to `rejected` in the spool, with its answer. Exit status 75 means
    that something is still in the spool; the next call sends it.
    """
    from ballscrew.sending.outgoing import RunRule
    from ballscrew.sending.settings import SendSettings

    if watch is not None and (files or run is not None):
        raise InputError("--watch finds the runs itself; give it without FILES and --run.")
    if as_json and (watch is not None or dry_run):
        raise InputError("--json reports what was sent; give it without --watch and --dry-run.")
    rule = RunRule(axis, pattern, _trips(trips, plan), send_incomplete, documents)
    settings = SendSettings(
        spool=spool,
        spool_limit=spool_limit * _GIGABYTE,
        token_file=token_file,
        plain_http=allow_plain_http,
        tries=tries,
        settle=settle,
        timeout=timeout,
    )
    if dry_run:
        return _list(files or [], watch, to, rule, settings)
    return _send(files or [], watch, to, rule, settings, run, as_json=as_json)


def _trips(trips: int | None, plan: Path | None) -> int | None:
    if trips is not None or plan is None:
        return trips
    from ballscrew.fcft.plan import read_plan

    stated = read_plan(plan)
    return stated.repetitions * len(stated.motions)


def _send(
    files: list[Path],
    watch: Path | None,
    to: str,
    rule: RunRule,
    settings: SendSettings,
    run: str | None,
    *,
    as_json: bool,
) -> int:
    """Send, print a line for each run or a document, and return the exit status."""
    from ballscrew.cli.output import print_json, progress_bar
    from ballscrew.sending.sender import SendHooks, send, send_new

    output = sys.stdout
    with progress_bar("send") as progress:
        # On a terminal, text is printed above the bar; elsewhere the bar must not redirect it.
        report = partial(_report, None if output.isatty() else output, as_json)
        hooks = SendHooks(report, _complain, progress)
        if watch is not None:
            send_new(watch, to, rule=rule, settings=settings, hooks=hooks)
        result = send(files, to, rule=rule, run=run, settings=settings, hooks=hooks)
    if as_json:
        print_json(result.to_json())
    if result.waiting:
        _complain(f"{plural(result.waiting, 'run')} not sent yet: {result.reason}")
        return SPOOLED
    return WRONG_INPUT if result.rejected or result.failures else DONE


def _report(output: TextIO | None, as_json: bool, answer: Answer) -> None:
    if answer.doubt is not None:
        _complain(f"{answer.name}: does not count until its time is corrected: {answer.doubt}")
    if as_json:
        return
    done = answer.status if answer.new else f"was there already, {answer.status}"
    identity = f", id {answer.id[:12]}" if answer.id else ""
    _print(f"{answer.name}: run {answer.run} of {answer.axis}{identity}: {done}.", output)


def _complain(sentence: str) -> None:
    _print(f"ballscrew: {sentence}", sys.stderr)


def _print(sentence: str, output: TextIO | None = None) -> None:
    stream = output or sys.stdout
    stream.write(f"{printable(sentence)}\n")
    stream.flush()


def _list(files: list[Path], watch: Path | None, to: str, rule: RunRule, settings: SendSettings) -> int:
    """Print what would be sent."""
    from ballscrew.sending.outgoing import find_runs
    from ballscrew.sending.settings import check_address, spool_folder
    from ballscrew.sending.spool import Spool
    from ballscrew.sending.watched import WatchedFolder

    place = spool_folder(settings, check_address(to, plain=settings.plain_http))
    spool = None
    if place.is_dir():
        spool = Spool(place, settings.spool_limit)
    found = list(find_runs(files, rule)) if files else []
    if watch is not None:
        found += [run for _, run in WatchedFolder(watch, rule, 0.0, 0.0).scan(0.0)]
    status = DONE
    for run in found:
        if isinstance(run, InputError):
            _complain(str(run))
            status = run.exit_status
        else:
            _print(_line(run, spool.known_state(run) if spool else ""))
    return status


def _line(run: OutgoingRun, state: str) -> str:
    size = sum(path.stat().st_size for path in run.paths)
    line = f"{run.name}: {plural(len(run.paths), 'file')} of {run.axis}, {size / 1e6:.1f} MB"
    return f"{line}; {state} before" if state else line
