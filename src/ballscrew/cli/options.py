"""Arguments and options common to several commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup


class Command(TyperCommand):
    """Command whose help names no type of an option without a value."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Arguments and options, with ``--help``."""
        return _without_types(super().get_params(ctx))


class CommandGroup(TyperGroup):
    """Group of such commands."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Arguments and options, with ``--help``."""
        return _without_types(super().get_params(ctx))


def _without_types(parameters: list[Any]) -> list[Any]:
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
    return parameters


def option(description: str, metavar: str | None = None, *names: str, **limits: Any) -> Any:
    """Option with a value; by default it has the name of its parameter."""
    return typer.Option(*names, metavar=metavar, help=description, **limits)


def flag(description: str, *names: str, **look: Any) -> Any:
    """Option without a value."""
    return typer.Option(*names, help=description, **look)


Files = Annotated[
    list[Path],
    typer.Argument(metavar="RUN.toml | FILES…", help="One RUN.toml, or the recordings of one run."),
]
Channels = Annotated[Path | None, option("Meaning of each channel of the files.", "CHANNELS.toml")]
Axis = Annotated[Path | None, option("Data sheet of the axis.", "AXIS.toml")]
PlanFile = Annotated[Path | None, option("Plan of the test.", "PLAN.toml")]
Mass = Annotated[str | None, option("Load on the table. [default: the plan's]", '"100 kg"')]
Verbose = Annotated[bool, flag("Print all details.", "--verbose")]
Json = Annotated[bool, flag("Print the result as JSON instead of a table.", "--json")]
TableFile = Annotated[
    Path | None, option("Write the table of the result to a CSV or Parquet file.", "FILE.csv", "--export")
]
Seed = Annotated[int, option("Random seed; the same seed gives the same recordings.", min=0)]
