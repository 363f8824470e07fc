"""Arguments and options common to several commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer


def option(description: str, metavar: str | None = None, *names: str, **limits: Any) -> Any:
    """Option with a value; by default it has the name of its parameter."""
    return typer.Option(*names, metavar=metavar, help=description, **limits)


def flag(description: str, *names: str) -> Any:
    """Option without a value."""
    return typer.Option(*names, help=description)


Files = Annotated[
    list[Path],
    typer.Argument(metavar="RUN.toml | FILES…", help="One RUN.toml, or the recordings of one run."),
]
Channels = Annotated[Path | None, option("Meaning of each channel of the files.", "CHANNELS.toml")]
Axis = Annotated[Path | None, option("Data sheet of the axis.", "AXIS.toml")]
PlanFile = Annotated[Path | None, option("Plan of the test.", "PLAN.toml")]
Mass = Annotated[str | None, option("Load on the table. [default: the plan's]", '"100 kg"')]
Json = Annotated[bool, flag("Print the result as JSON instead of a table.", "--json")]
Seed = Annotated[int, option("Random seed; the same seed gives the same recordings.", min=0)]
