"""``ballscrew demo``: a screw wears out, is measured all along, and a report shows what was found."""

from __future__ import annotations

from pathlib import Path

from ballscrew.base.errors import DONE
from ballscrew.cli.output import console, print_json, progress_bar
from ballscrew.report.canvas import check_drawing
from ballscrew.reproduction.demo import demo, describe

__all__ = ["demo_command"]


def demo_command(out: Path, *, as_json: bool) -> int:
    """Run the demonstration, print what it found, and return the exit status."""
    check_drawing()
    with progress_bar("wearing an axis out") as progress:
        found = demo(out, progress=progress)
    if as_json:
        print_json(found.to_json())
        return DONE
    screen = console()
    for line in describe(found):
        screen.print(line, markup=False, soft_wrap=True)
    screen.print(f"Look at {(out / 'report.html').resolve()}", markup=False, soft_wrap=True)
    return DONE
