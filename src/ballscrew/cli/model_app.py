"""Options of the commands about the model of an axis: ``calibrate``, ``preload`` and ``monitor``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ballscrew.cli.options import Json

Runs = Annotated[
    list[Path],
    typer.Argument(metavar="RUN.json…", help="Output of analyze --json, one file per run."),
]
Model = Annotated[
    Path, typer.Option("--model", metavar="MODEL.json", help="Model of this axis, written by calibrate.")
]
Plot = Annotated[
    Path | None,
    typer.Option("--plot", "--figure", metavar="FILE", help="Plot to a PNG, SVG or PDF file."),
]


def calibrate(
    runs: Runs,
    axis: Annotated[Path, typer.Option("--axis", metavar="AXIS.toml", help="Data sheet of the axis.")],
    out: Annotated[Path, typer.Option(metavar="MODEL.json", help="Model to write.")],
    known_preload: Annotated[
        list[str] | None,
        typer.Option(
            metavar="RUN.json=600N",
            help="Known preload of one of the runs, ± 2 % or as in 600N±10N; repeatable.",
        ),
    ] = None,
    bearing_drift: Annotated[
        float,
        typer.Option(
            min=0,
            max=1,
            help="Largest relative difference of the bearing's rigidity between days (95 %).",
        ),
    ] = 0.01,
    sample: Annotated[
        bool, typer.Option("--sample", help="Check the model with a sampler; needs ballscrew[sample].")
    ] = False,
    as_json: Json = False,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Plot frequencies, model and residuals to a PNG, SVG or PDF file."),
    ] = None,
) -> None:
    """Fit the model of an axis to runs at several loads.

    Reports which parameters the data determine and which rest on the data sheet. Runs within a day of each
    other, and runs without a time, are assumed to have the same preload.
    """
    from ballscrew.calibration.assumptions import Assumptions
    from ballscrew.cli.calibrate import calibrate_command

    status = calibrate_command(
        runs,
        axis=axis,
        out=out,
        known_preloads=known_preload or [],
        assumptions=Assumptions(bearing_drift=bearing_drift),
        with_sampler=sample,
        as_json=as_json,
        plot=plot,
    )
    raise typer.Exit(status)


def preload(
    runs: Runs,
    model: Model,
    baseline: Annotated[
        list[Path] | None,
        typer.Option(
            "--baseline",
            metavar="RUN.json",
            help="Reference run, with the same plan and load. Repeatable: the first is "
            "the baseline, the others determine the effect of temperature.",
        ),
    ] = None,
    bearing_drift: Annotated[
        float,
        typer.Option(
            min=0,
            max=1,
            help="Largest relative drift of the bearing's rigidity since the baseline (95 %).",
        ),
    ] = 0.01,
    trust_torque: Annotated[
        bool,
        typer.Option(
            "--trust-torque", help="Assume that the torque constant does not drift with temperature."
        ),
    ] = False,
    as_json: Json = False,
    plot: Plot = None,
) -> None:
    """Estimate the remaining preload, in newtons and relative to a baseline, with 95 % intervals.

    Reports the random part of the uncertainty, other possible causes of the change, and local wear.
    """
    from ballscrew.calibration.assumptions import Assumptions
    from ballscrew.cli.preload import preload_command

    torque_trusted = True if trust_torque else None
    status = preload_command(
        runs,
        model=model,
        baselines=baseline or [],
        assumptions=Assumptions(bearing_drift=bearing_drift, torque_trusted=torque_trusted),
        as_json=as_json,
        plot=plot,
    )
    raise typer.Exit(status)


def monitor(
    runs: Runs,
    model: Model,
    events: Annotated[
        Path | None,
        typer.Option(
            "--events",
            metavar="EVENTS.toml",
            help="Maintenance and other events: [[events]] with at, kind (nut replaced, bearing replaced, "
            "maintenance, greased, sensor remounted, note) and text. The first three start a new epoch.",
        ),
    ] = None,
    false_alarms: Annotated[
        float,
        typer.Option("--false-alarms", metavar="RATE", help="False alarms of a healthy axis per year."),
    ] = 0.1,
    repeats: Annotated[
        float,
        typer.Option(
            "--repeats",
            metavar="RATE",
            help="Requests per year for a second run on the same day of a healthy axis; 0 for none.",
        ),
    ] = 8.0,
    baseline_runs: Annotated[
        int, typer.Option(help="Largest number of good runs in the baseline of an epoch; it starts with 3.")
    ] = 10,
    end: Annotated[
        float, typer.Option("--end", metavar="RATIO", help="Preload ratio at which life ends.")
    ] = 0.5,
    largest_load: Annotated[
        str | None,
        typer.Option(metavar='"3 kN"', help="Largest load in service: life ends where it unloads the nut."),
    ] = None,
    backlash: Annotated[
        str | None, typer.Option(metavar='"5 um"', help="Backlash at which life ends.")
    ] = None,
    duty: Annotated[
        str | None,
        typer.Option(metavar='"12 km"', help="Travel per day, to report the remaining life as travel too."),
    ] = None,
    as_json: Json = False,
    plot: Plot = None,
) -> None:
    """Report the health of an axis from its runs: state, alarm, wear stage, likely cause, remaining life.

    The first three good runs of an epoch start its baseline. Every later run is compared with it, with
    thresholds that are computed for this axis and the stated false-alarm rate.
    """
    from ballscrew.cli.monitor import MonitorOptions, monitor_command

    options = MonitorOptions(false_alarms, repeats, baseline_runs, end, largest_load, backlash, duty)
    status = monitor_command(runs, model=model, events=events, options=options, as_json=as_json, plot=plot)
    raise typer.Exit(status)
