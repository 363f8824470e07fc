"""Arguments and options common to several commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup


class Command(TyperCommand):
    """Command whose help names the values of arguments and options, and no Python types."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Arguments and options, with ``--help``."""
        return _without_types(super().get_params(ctx))

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: ARG002  as in typer
        """Words of the line of usage: options, then each argument as its help names it."""
        arguments = [str(each.metavar) for each in self.params if each.param_type_name == "argument"]
        return ["[OPTIONS]", *arguments]


class CommandGroup(TyperGroup):
    """Group of such commands."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Arguments and options, with ``--help``."""
        return _without_types(super().get_params(ctx))


def _without_types(parameters: list[Any]) -> list[Any]:
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
        elif parameter.param_type_name == "argument":
            parameter.display_type_rich = _no_type
    return parameters


def _no_type(ctx: Any) -> str:  # noqa: ARG001  as in typer
    return ""


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
Channels = Annotated[
    Path | None,
    option("Channel map: what each channel of the files measures. [default: run.toml's]", "CHANNELS.toml"),
]
Axis = Annotated[Path | None, option("Data sheet of the axis. [default: run.toml's]", "AXIS.toml")]
PlanFile = Annotated[Path | None, option("Plan of the test. [default: run.toml's]", "PLAN.toml")]
Mass = Annotated[str | None, option("Load on the table. [default: run.toml's, else the plan's]", '"100 kg"')]
Verbose = Annotated[bool, flag("Print all details.", "--verbose")]
Json = Annotated[bool, flag("Print the result as JSON, for programs.", "--json")]
TableFile = Annotated[
    Path | None, option("Write the table of the result to a .csv or .parquet file.", "FILE.csv", "--export")
]
Seed = Annotated[int, option("Random seed; the same seed gives the same recordings.", "N", min=0)]
