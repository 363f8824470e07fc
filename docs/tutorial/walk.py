"""Runs the commands of the tutorial in an empty folder and writes their output into its pages.

Usage: python docs/tutorial/walk.py

The tests compare the outputs. When the output of a command changes, run this script and review the pages.
An output that ends with a line "…" is quoted up to there.
"""

from __future__ import annotations

import contextlib
import io
import re
import runpy
import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ballscrew.cli.shell import run

FOLDER = Path(__file__).parent
PAGES = tuple(FOLDER / name for name in ("first-run.md", "calibrated.md", "remaining-life.md"))
CUT = "…\n"
_FENCE = re.compile(r"^(`{3,})(?:\{(?P<role>[\w-]+)\} *)?(?P<lang>[\w-]*)\n(?P<body>.*?)^\1$", re.M | re.S)
_OPTION = re.compile(r"^:(\w+): *(.*)\n", re.M)


@dataclass(frozen=True)
class Block:
    """A fenced block of a page: its language, the options under its head, and its lines."""

    language: str
    options: dict[str, str]
    body: str


@dataclass(frozen=True)
class Step:
    """Command of the tutorial, its output on the page, as much of its actual output, and its exit status."""

    command: str
    shown: str
    printed: str
    status: int


def blocks(text: str) -> Iterator[Block]:
    """Every fenced block of a page, in order."""
    for match in _FENCE.finditer(text):
        body = match["body"]
        options: dict[str, str] = {}
        while match["role"] and (option := _OPTION.match(body)):
            options[option[1]] = option[2]
            body = body[option.end() :]
        yield Block(match["lang"], options, body)


def write_file(block: Block, folder: Path) -> None:
    """Write a block that is a TOML file."""
    if block.language == "toml" and "caption" in block.options:
        (folder / block.options["caption"]).write_text(block.body, encoding="utf-8")


def walk(text: str, folder: Path) -> Iterator[Step]:
    """Write the TOML files of a page and run its commands."""
    for script in FOLDER.glob("make_*.py"):
        shutil.copy(script, folder)
    for block in blocks(text):
        write_file(block, folder)
        if block.language == "console":
            line, _, shown = block.body.partition("\n")
            yield _step(line.removeprefix("$ "), shown, folder)


def _step(line: str, shown: str, folder: Path) -> Step:
    """Run a command, whose output goes to a file where it ends with one, ``> run.json``."""
    command, _, target = line.partition(" > ")
    status, printed = run_here(command, folder)
    if target:
        (folder / target).write_text(printed, encoding="utf-8")
        printed = ""
    if shown.endswith(CUT):
        lines = printed.splitlines(keepends=True)
        printed = "".join([*lines[: shown.count("\n") - 1], CUT])
    return Step(line, shown, printed, status)


def run_here(line: str, folder: Path) -> tuple[int, str]:
    """Run a command of the tutorial in this process; its exit status, and what it prints."""
    program, *arguments = line.split()
    if program not in ("ballscrew", "python"):
        raise ValueError(f"the tutorial runs {program!r}; it may run ballscrew and python only")
    out, status = io.StringIO(), 0
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        if program == "ballscrew":
            status = run(arguments)
        else:
            _run_script(arguments)
    return status, "".join(f"{row.rstrip()}\n" for row in out.getvalue().splitlines())


def _run_script(arguments: list[str]) -> None:
    own = sys.argv
    sys.argv = arguments
    try:
        runpy.run_path(arguments[0], run_name="__main__")
    finally:
        sys.argv = own


def rewrite() -> None:
    """Write the outputs of the commands into the pages."""
    with tempfile.TemporaryDirectory() as folder:
        for page in PAGES:
            text = page.read_text(encoding="utf-8")
            for step in walk(text, Path(folder)):
                if "Traceback" in step.printed:
                    raise RuntimeError(f"{step.command!r} failed:\n{step.printed}")
                head = f"```console\n$ {step.command}\n"
                text = text.replace(f"{head}{step.shown}```", f"{head}{step.printed}```")
            page.write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    rewrite()
