"""``ballscrew init``: what it wrote, what it guessed, what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from ballscrew.base.errors import DONE
from ballscrew.base.jsonfile import SCHEMA
from ballscrew.cli.init import init
from ballscrew.cli.output import console, print_json

__all__ = ["init_command"]


def init_command(files: Sequence[Path], out: Path, *, force: bool, as_json: bool) -> int:
    """Write the four files, tell what was guessed, and return the exit status."""
    result = init(files, out, force=force)
    if as_json:
        print_json(
            {
                "schema": SCHEMA,
                "written": [str(path) for path in result.written],
                "guesses": [asdict(guess) for guess in result.guesses],
                "missing": list(result.missing),
            }
        )
        return DONE
    screen = console()
    table = Table("channel", "quantity", "unit", "why", "sure")
    for guess in result.guesses:
        sure = "yes" if guess.sure else "[yellow]check[/]"
        table.add_row(escape(guess.channel), guess.quantity, escape(guess.unit), escape(guess.why), sure)
    screen.print(table)
    for path in result.written:
        screen.print(f"wrote {path}", markup=False)
    if result.missing:
        screen.print("\n[bold]To fill in:[/]")
        for sentence in result.missing:
            screen.print(f"  • {sentence}", markup=False)
    screen.print("\nThen: ballscrew analyze run.toml", markup=False)
    return DONE
