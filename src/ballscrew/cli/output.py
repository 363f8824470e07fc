"""Output common to all commands: console, JSON, progress, and the verdict on a measurement."""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.segment import Segment
from rich.table import Table

from ballscrew.base import files
from ballscrew.base.errors import DONE, REFUSED, InputError, printable
from ballscrew.base.jsonfile import write_json
from ballscrew.recording.quality.finding import Quality

TIME_WIDTH = 16  # characters of a run's time, to the minute
_ID_LENGTH = 12  # characters of a run's id in messages
_ID = re.compile(rf"[0-9a-f]{{{_ID_LENGTH}}}")
STATE_STYLE = {
    "learning": "cyan",
    "normal": "green",
    "watch": "yellow",
    "alarm": "bold red",
    "unloaded": "bold red",
    "suspect": "bright_black",
}
VERDICT_STYLE = {"good": "green", "suspect": "yellow", "refused": "red", "bad": "red"}


def styled_verdict(verdict: str) -> str:
    """Mark up a verdict with its colour, by its last word."""
    return f"[{VERDICT_STYLE[verdict.split()[-1]]}]{verdict}[/]"


class _SafeConsole(Console):
    """Console on which a name in a file cannot act on the terminal, and sentences are indented."""

    def print(self, *objects: Any, **options: Any) -> None:
        """As :meth:`rich.console.Console.print`; a plain text is wrapped with its lines below each other."""
        if options.get("markup") is False and not options.get("soft_wrap"):
            objects = tuple(_wrapped(text, self.width) for text in objects)
        super().print(*objects, **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterator[Segment]:
        """Segments, with control characters other than ends of lines escaped."""
        for segment in super().render(renderable, options):
            lines = segment.text.split("\n")
            yield segment if segment.control else segment._replace(text="\n".join(map(printable, lines)))


def _wrapped(text: str, width: int) -> str:
    """Lines of a text, wrapped at words and indented as the first word after a bullet."""
    lines = []
    for line in text.split("\n"):
        indent = len(line) - len(line.lstrip(" •→"))
        wrapped = [line]
        if len(line) > width:
            wrapped = textwrap.wrap(
                line, width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False
            )
        lines += wrapped
    return "\n".join(lines)


def console() -> Console:
    """Console of standard output; 100 columns wide where it is not a terminal."""
    return _SafeConsole(highlight=False, width=None if sys.stdout.isatty() else 100)


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[Path | None]) -> None:
    """Check before the work that no file to write is an input or another file to write.

    Parameters
    ----------
    outputs, inputs : iterable of Path or None
        None for an option that was not given.
    """
    written = [path for path in outputs if path is not None]
    read = [path for path in inputs if path is not None]
    for index, path in enumerate(written):
        if any(_is_same(path, other) for other in written[:index]):
            raise InputError("two of the files to write have the same name; give each its own.")
        if any(_is_same(path, other) for other in read):
            raise InputError(f"{path}: is an input and would be overwritten; give another name.")


def _is_same(path: Path, other: Path) -> bool:
    """Whether two paths are one file: by a link or another case of letters too."""
    try:
        return path.samefile(other)
    except (OSError, ValueError):  # one of them does not exist
        return path.resolve() == other.resolve()


def name_runs(text: str, names: Mapping[str, str]) -> str:
    """Text with runs named by their files.

    Parameters
    ----------
    text : str
        With the beginnings of ids, ``"run 6d0ec71e163e is suspect"``.
    names : mapping of str to str
        Id of each run to its file.
    """
    for run, name in names.items():
        if _ID.match(run):
            text = text.replace(f"run {run[:_ID_LENGTH]}", name).replace(run[:_ID_LENGTH], name)
    return text


def right_aligned(headings: Iterable[str], *texts: str, title: str | None = None) -> Table:
    """Table with columns of numbers, and after them columns of text."""
    table = Table(title=title, title_justify="left")
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for heading in texts:
        table.add_column(heading)
    return table


def print_json(document: dict[str, Any]) -> None:
    """Print a result as JSON on standard output."""
    sys.stdout.write(write_json(document) + "\n")


@contextmanager
def progress_bar(task: str, *, as_lines: bool = False) -> Iterator[files.Progress]:
    """Progress bar on standard error, shown on a terminal only and removed when the work is done.

    Parameters
    ----------
    task : str
        What is done.
    as_lines : bool
        Elsewhere than on a terminal, print a line for each part.
    """
    if as_lines and not sys.stderr.isatty():
        print_progress = partial(_print_progress, task)
        print_progress(0, 0, "")
        yield print_progress
        return
    columns = (
        SpinnerColumn(),
        TextColumn(task),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.description}"),
        TimeRemainingColumn(),
    )
    with Progress(
        *columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()
    ) as bar:
        bar_id = bar.add_task("", total=None)
        yield lambda done, total, name: bar.update(bar_id, completed=done, total=total, description=name)


def _print_progress(task: str, done: int, total: int, name: str) -> None:
    text = f"{task}: {done} of {total}, {name}" if total else f"{task} …"
    sys.stderr.write(f"{printable(text)}\n")
    sys.stderr.flush()


def report_quality(quality: Quality) -> int:
    """Print the reasons against a bad measurement on standard error, and return the exit status."""
    if quality.verdict == "bad":
        for reason in quality.reasons:
            sys.stderr.write(f"ballscrew: bad measurement: {printable(reason)}\n")
        return REFUSED
    return DONE
