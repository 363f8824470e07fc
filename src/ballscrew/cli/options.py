"""Arguments and options common to several commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Files = Annotated[
    list[Path],
    typer.Argument(metavar="RUN.toml | FILES…", help="One RUN.toml, or the recordings of one run."),
]
Channels = Annotated[
    Path | None,
    typer.Option("--channels", metavar="CHANNELS.toml", help="Meaning of each channel of the files."),
]
Axis = Annotated[Path | None, typer.Option("--axis", metavar="AXIS.toml", help="Data sheet of the axis.")]
PlanFile = Annotated[Path | None, typer.Option("--plan", metavar="PLAN.toml", help="Plan of the test.")]
Mass = Annotated[
    str | None, typer.Option("--mass", metavar='"100 kg"', help="Load on the table. [default: the plan's]")
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON instead of a table.")]
Seed = Annotated[int, typer.Option(min=0, help="Random seed; the same seed gives the same recordings.")]
