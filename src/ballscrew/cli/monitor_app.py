"""The options of ``ballscrew monitor``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ballscrew.cli.options import Json

__all__ = ["monitor"]


def monitor(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN.json…", help="What analyze --json printed: all runs of one axis, in any order."
        ),
    ],
    model: Annotated[
        Path, typer.Option("--model", metavar="MODEL.json", help="What calibrate wrote of this axis.")
    ],
    events: Annotated[
        Path | None,
        typer.Option(
            "--events",
            metavar="EVENTS.toml",
            help="What was done to the axis: [[events]] with at, kind (nut replaced, bearing replaced, "
            "maintenance, greased, sensor remounted, note) and text. The first three begin a new epoch.",
        ),
    ] = None,
    false_alarms: Annotated[
        float,
        typer.Option(
            "--false-alarms", metavar="RATE", help="False alarms that a healthy axis may make in a year."
        ),
    ] = 0.1,
    repeats: Annotated[
        float,
        typer.Option(
            "--repeats",
            metavar="RATE",
            help="How often in a year a healthy axis may be asked for a second run on the same day; "
            "0 for never.",
        ),
    ] = 8.0,
    baseline_runs: Annotated[
        int, typer.Option(help="Good runs of an epoch that make its baseline, at most; 3 begin.")
    ] = 10,
    end: Annotated[
        float, typer.Option("--end", metavar="RATIO", help="Part of the preload at which life ends.")
    ] = 0.5,
    largest_load: Annotated[
        str | None,
        typer.Option(metavar='"3 kN"', help="Largest load of the duty: life ends where it lifts a flank."),
    ] = None,
    backlash: Annotated[
        str | None, typer.Option(metavar='"5 um"', help="Backlash at which life ends.")
    ] = None,
    duty: Annotated[
        str | None,
        typer.Option(metavar='"12 km"', help="Travel of a day: the remaining life is told in travel too."),
    ] = None,
    as_json: Json = False,
    plot: Annotated[
        Path | None,
        typer.Option(
            "--plot", "--figure", metavar="FILE", help="Draw the history into a PNG, SVG or PDF file."
        ),
    ] = None,
) -> None:
    """Watches an axis: whether it is well, since when not, which stage, why, and how long it will last.

    The first three good runs of an epoch make a baseline; from then on every run is judged, at limits that
    are computed for this axis and the runs that it has.
    """
    from ballscrew.cli.monitor import Asked, monitor_command

    asked = Asked(false_alarms, repeats, baseline_runs, end, largest_load, backlash, duty)
    raise typer.Exit(
        monitor_command(runs, model=model, events=events, asked=asked, as_json=as_json, plot=plot)
    )
