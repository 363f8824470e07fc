"""What all commands share: where words go, and how long work shows."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeRemainingColumn,
)

from ballscrew.base.errors import DONE, REFUSED, InputError
from ballscrew.base.files import Progress as Report
from ballscrew.base.jsonfile import write_json
from ballscrew.recording.quality.finding import Quality

__all__ = [
    "VERDICT_STYLE",
    "check_folder",
    "console",
    "count",
    "print_json",
    "progress_bar",
    "say_quality",
]

VERDICT_STYLE = {"good": "green", "suspect": "yellow", "refused": "red", "bad": "red"}


def console() -> Console:
    """The console of standard output, as wide as a table needs where it is no terminal."""
    return Console(highlight=False, width=None if sys.stdout.isatty() else 110)


def check_folder(path: Path) -> None:
    """Find out before the work whether a file can be written after it."""
    if path.is_dir() or not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written; it must be a file in a folder that is there.")


def count(number: int, what: str) -> str:
    """A number of things, in the singular where there is one."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def print_json(document: dict[str, Any]) -> None:
    """Print a result as JSON on standard output."""
    sys.stdout.write(write_json(document) + "\n")


@contextmanager
def progress_bar(what: str) -> Iterator[Report]:
    """A progress bar on standard error, where someone looks; it goes when the work is done."""
    columns = (
        SpinnerColumn(),
        TextColumn(what),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.description}"),
        TimeRemainingColumn(),
    )
    with Progress(
        *columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()
    ) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total, name: bar.update(task, completed=done, total=total, description=name)


def say_quality(quality: Quality) -> int:
    """Tell reasons against a measurement on standard error, and return the exit status that they mean."""
    if quality.verdict == "bad":
        for reason in quality.reasons:
            sys.stderr.write(f"ballscrew: bad measurement: {reason}\n")
        return REFUSED
    return DONE
