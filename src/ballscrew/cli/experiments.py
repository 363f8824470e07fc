"""``ballscrew demo`` and ``ballscrew reproduce``: experiments on the testbed, with a report each."""

from __future__ import annotations

import time
from pathlib import Path

from ballscrew.base.errors import DONE
from ballscrew.cli.output import console, print_json, progress_bar
from ballscrew.report.canvas import check_drawing
from ballscrew.reproduction.demo import demo, describe
from ballscrew.reproduction.reproduce import end_of_life, reproduce, reproduction_json


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


def reproduce_command(out: Path, *, quick: bool, keep: bool, seed: int, as_json: bool) -> int:
    """Run both experiments, print the claims beside the results, and return the exit status."""
    check_drawing()
    started = time.monotonic()
    screen = console()
    announce = None if as_json else screen.print
    with progress_bar("both experiments") as progress:
        experiments, claims = reproduce(
            out, quick=quick, keep=keep, seed=seed, announce=announce, progress=progress
        )
    if as_json:
        print_json(reproduction_json(experiments, claims))
        return DONE
    for claim in claims:
        screen.print(f"{claim.holds:>7}  {claim.paper}", markup=False, soft_wrap=True)
    for line in end_of_life(experiments):
        screen.print(line, markup=False, soft_wrap=True)
    minutes, seconds = divmod(round(time.monotonic() - started), 60)
    screen.print(f"Done in {minutes} min {seconds} s.")
    screen.print(f"Look at {(out / 'report.html').resolve()}", markup=False, soft_wrap=True)
    return DONE
