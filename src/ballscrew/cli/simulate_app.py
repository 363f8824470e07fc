"""The commands of ``ballscrew simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ballscrew.cli.options import Command, CommandGroup, Json, Seed, option

AnyAxis = Annotated[Path | None, option("Data sheet, assumed exact. [default: the example's]", "AXIS.toml")]
AnyPlan = Annotated[
    Path | None, option("Plan; its loads are replaced. [default: the example's]", "PLAN.toml")
]
Repetitions = Annotated[int, option("Round trips per run.", "N", min=1)]

simulate = typer.Typer(
    cls=CommandGroup,
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Simulate recordings of a machine with known true values: the testbed.",
    epilog="Example: ballscrew simulate run plan.toml --axis axis.toml",
)


@simulate.command(
    cls=Command,
    name="run",
    epilog="Example: ballscrew simulate run plan.toml --axis axis.toml --preload 340N --out worn",
)
def simulate_run(
    path: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="Plan of the test.")],
    axis: Annotated[Path, option("Data sheet, assumed exact.", "AXIS.toml")],
    out: Annotated[Path, option("Folder for the files; created if missing.", "DIR")] = Path("simulated"),
    preload: Annotated[
        str | None, option("Preload of the nut. [default: the data sheet's]", '"340 N"')
    ] = None,
    backlash: Annotated[str, option("Backlash of a nut whose preload is 0 N.", '"1 um"')] = "0 um",
    mass: Annotated[str | None, option("Load on the table. [default: the plan's]", '"100 kg"')] = None,
    warmer: Annotated[
        str, option("Temperature of the screw above that of the nut, which increases the preload.", '"5 K"')
    ] = "0 K",
    seed: Seed = 0,
    as_json: Json = False,
) -> int:
    """Simulate a test on a machine and write the recordings of its instruments.

    Also writes the four TOML files that `analyze` needs, and truth.json.
    """
    from ballscrew.cli.simulate import simulate_run_command

    return simulate_run_command(
        path,
        axis=axis,
        out=out,
        preload=preload,
        backlash=backlash,
        mass=mass,
        warmer=warmer,
        seed=seed,
        as_json=as_json,
    )


@simulate.command(
    cls=Command,
    name="multi-level-mass",
    epilog='Example: ballscrew simulate multi-level-mass --loads "0kg, 25kg, 50kg" --out masses',
)
def simulate_multi_level_mass(
    loads: Annotated[
        str, option("Loads on the table, one run each.", '"0 kg, 50 kg"')
    ] = "0 kg, 10 kg, 20 kg, 30 kg, 40 kg, 50 kg",
    axis: AnyAxis = None,
    plan: AnyPlan = None,
    repetitions: Repetitions = 30,
    out: Annotated[Path, option("Folder for the runs.", "DIR")] = Path("multi-level-mass"),
    seed: Seed = 0,
    as_json: Json = False,
) -> int:
    """Simulate the paper's first experiment: one preload, several loads on the table.

    Prints the required disk space first, and stops if less is free.
    """
    from ballscrew.cli.simulate import simulate_multi_level_mass_command

    return simulate_multi_level_mass_command(
        loads, axis=axis, plan=plan, repetitions=repetitions, out=out, seed=seed, as_json=as_json
    )


@simulate.command(
    cls=Command,
    name="run-to-failure",
    epilog="Example: ballscrew simulate run-to-failure --repetitions 3 --out life",
)
def simulate_run_to_failure(
    mass: Annotated[str, option("Load on the table.", '"100 kg"')] = "100 kg",
    days: Annotated[float, option("Length of the experiment, days.", "N")] = 80.0,
    every: Annotated[float, option("Days between runs; the first is on day 0.", "N")] = 3.0,
    axis: AnyAxis = None,
    plan: AnyPlan = None,
    repetitions: Repetitions = 30,
    out: Annotated[Path, option("Folder for the runs.", "DIR")] = Path("run-to-failure"),
    seed: Seed = 0,
    as_json: Json = False,
) -> int:
    """Simulate the paper's second experiment: the screw wears until its nut has backlash.

    With 30 round trips per run it writes about 9 GB.
    """
    from ballscrew.cli.simulate import simulate_run_to_failure_command

    return simulate_run_to_failure_command(
        mass,
        axis=axis,
        plan=plan,
        repetitions=repetitions,
        days=days,
        every=every,
        out=out,
        seed=seed,
        as_json=as_json,
    )
