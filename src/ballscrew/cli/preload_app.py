"""The options of ``ballscrew preload``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ballscrew.cli.options import Json

__all__ = ["preload"]


def preload(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN.json…", help="What analyze --json printed, one run or several."),
    ],
    model: Annotated[
        Path, typer.Option("--model", metavar="MODEL.json", help="What calibrate wrote of this axis.")
    ],
    baseline: Annotated[
        list[Path] | None,
        typer.Option(
            "--baseline",
            metavar="RUN.json",
            help="A run that the preload is told relative to: the same plan and load. Several may be given: "
            "the first counts, the others teach what the temperature does.",
        ),
    ] = None,
    bearing_drift: Annotated[
        float,
        typer.Option(min=0, max=1, help="By what part the bearing's rigidity may have drifted since, 95 %."),
    ] = 0.01,
    trust_torque: Annotated[
        bool,
        typer.Option(
            "--trust-torque", help="The torque constant is known not to drift with the motor's heat."
        ),
    ] = False,
    as_json: Json = False,
    plot: Annotated[
        Path | None,
        typer.Option(
            "--plot",
            "--figure",
            metavar="FILE",
            help="Draw the run, or of several runs the preload along the axis, into a PNG, SVG or PDF file.",
        ),
    ] = None,
) -> None:
    """Tells how much preload is left, in newtons and against a baseline, each with its interval.

    Says what of the uncertainty is random, what else may have changed the frequencies, and whether wear is
    local.
    """
    from ballscrew.calibration.assumptions import Assumptions
    from ballscrew.cli.preload import preload_command

    assumptions = Assumptions(bearing_drift=bearing_drift, torque_trusted=True if trust_torque else None)
    raise typer.Exit(
        preload_command(
            runs,
            model=model,
            baselines=baseline or [],
            assumptions=assumptions,
            as_json=as_json,
            plot=plot,
        )
    )
