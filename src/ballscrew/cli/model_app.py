"""Options of the commands about the model of an axis: ``calibrate``, ``preload``, ``monitor``, ``watch``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ballscrew.calibration.assumptions import BEARING_DAILY_DRIFT
from ballscrew.cli.options import Json, TableFile, Verbose, flag, option

Runs = Annotated[
    list[Path], typer.Argument(metavar="RUN.json…", help="Output of analyze --json, one file per run.")
]
Model = Annotated[Path, option("Model of this axis, written by calibrate.", "MODEL.json")]
Accept = Annotated[
    list[str] | None,
    option("Accept a warning of the calibration after checking its cause; repeatable.", "NAME"),
]
BearingDrift = Annotated[
    float | None,
    option(
        "Largest relative change of the support bearing's rigidity since the baseline (95 %), if known. "
        "By default its preload may have changed by 10 % (standard deviation).",
        "0.02",
        min=0,
        max=1,
    ),
]
Events = Annotated[
    Path | None,
    option(
        "Maintenance and other events, as [[events]] with at, kind (nut replaced, bearing replaced, "
        "maintenance, greased, sensor remounted, note) and text. The first three start a new epoch.",
        "EVENTS.toml",
    ),
]
FalseAlarms = Annotated[float, option("False alarms of a healthy axis per year.", "RATE")]
Repeats = Annotated[
    float,
    option("Same-day repeats requested per year on a healthy axis; 0 for none.", "RATE"),
]
ExitCode = Annotated[
    bool,
    flag(
        "Exit with 3 for watch, 4 for alarm, 5 for learning, suspect or not judged; 0 is a healthy axis.",
        "--exit-code",
    ),
]
Plot = Annotated[Path | None, option("Plot to a PNG, SVG or PDF file.", "FILE", "--plot", "--figure")]


Duty = Annotated[
    str | None,
    option(
        "Travel per day, or a CSV file with date and the machine's counters, revolutions of the screw or "
        "hours of operation; the remaining life is then reported in these too.",
        '"12 km" | FILE.csv',
    ),
]


def calibrate(
    runs: Runs,
    axis: Annotated[Path, option("Data sheet of the axis.", "AXIS.toml")],
    out: Annotated[Path, option("Model to write.", "MODEL.json")],
    known_preload: Annotated[
        list[str] | None,
        option(
            "Known preload of one of the runs, with a standard uncertainty of 2 % or as in 600N±10N; "
            "repeatable.",
            "RUN.json=600N",
        ),
    ] = None,
    bearing_drift: Annotated[
        float,
        option(
            "Largest relative difference of the support bearing's rigidity between runs of different days "
            "(95 %).",
            "0.02",
            min=0,
            max=1,
        ),
    ] = BEARING_DAILY_DRIFT,
    sample: Annotated[
        bool, flag("Check the model with an MCMC sampler; needs ballscrew[sample].", "--sample")
    ] = False,
    verbose: Verbose = False,
    as_json: Json = False,
    plot: Annotated[
        Path | None, option("Plot frequencies, model and residuals to a PNG, SVG or PDF file.", "FILE")
    ] = None,
) -> int:
    """Fit the model of an axis to runs at several loads, and write it to a file.

    Reports which parameters the data determine and which rest on the data sheet. Runs within a day of each
    other, and runs without a time, are assumed to have the same preload. With --verbose, also prints
    the parameters, the goodness of fit, and what determines the parameters.
    """
    from ballscrew.calibration.assumptions import Assumptions
    from ballscrew.cli.calibrate import calibrate_command

    return calibrate_command(
        runs,
        axis=axis,
        out=out,
        known_preloads=known_preload or [],
        assumptions=Assumptions(bearing_drift=bearing_drift),
        with_sampler=sample,
        verbose=verbose,
        as_json=as_json,
        plot=plot,
    )


def preload(
    runs: Runs,
    model: Model,
    baseline: Annotated[
        list[Path] | None,
        option(
            "Reference run, with the same plan and load; without it, the preload is relative to the model. "
            "Repeatable: the first is the baseline, the others determine the effect of temperature.",
            "RUN.json",
        ),
    ] = None,
    bearing_drift: BearingDrift = None,
    trust_torque: Annotated[
        bool,
        flag(
            "Assume that the torque constant does not drift: a change of equivalent mass is then "
            "attributed to the load.",
            "--trust-torque",
        ),
    ] = False,
    accept: Accept = None,
    verbose: Verbose = False,
    as_json: Json = False,
    plot: Plot = None,
    table: TableFile = None,
) -> int:
    """Estimate the preload of the nut in newtons and relative to a baseline, with 95 % intervals.

    With --verbose, also prints the parts of the uncertainty, other possible causes of the change, and local
    wear.
    """
    from ballscrew.calibration.assumptions import Assumptions
    from ballscrew.cli.preload import preload_command

    torque_trusted = True if trust_torque else None
    return preload_command(
        runs,
        model=model,
        baselines=baseline or [],
        assumptions=Assumptions(bearing_drift=bearing_drift, torque_trusted=torque_trusted),
        accept=accept or [],
        verbose=verbose,
        as_json=as_json,
        plot=plot,
        table=table,
    )


def monitor(
    runs: Annotated[
        list[str],
        typer.Argument(
            metavar="RUN.json… | AXIS",
            help="Output of analyze --json, one file per run; or the name of an axis of a store.",
        ),
    ],
    model: Annotated[
        Path | None,
        option("Model of this axis, written by calibrate; required without --store.", "MODEL.json"),
    ] = None,
    store: Annotated[
        Path | None,
        option(
            "Store with the axis's runs, events and model; the result is added to it. "
            "[default: BALLSCREW_STORE, for the name of an axis]",
            "DIR",
        ),
    ] = None,
    events: Events = None,
    false_alarms: FalseAlarms = 0.1,
    repeats: Repeats = 8.0,
    baseline_runs: Annotated[
        int,
        option("Largest number of good runs in the baseline of an epoch; three are enough to begin.", "N"),
    ] = 10,
    end: Annotated[float, option("Fraction of the baseline's preload at which life ends.", "RATIO")] = 0.5,
    largest_load: Annotated[
        str | None, option("Largest load in service: life ends where it unloads the nut.", '"3 kN"')
    ] = None,
    backlash: Annotated[str | None, option("Backlash at which life ends.", '"5 um"')] = None,
    bearing_drift: BearingDrift = None,
    duty: Duty = None,
    accept: Accept = None,
    as_json: Json = False,
    plot: Plot = None,
    table: TableFile = None,
    exit_code: ExitCode = False,
) -> int:
    """Report the health of an axis from its runs: state, alarm, wear stage, likely cause, remaining life.

    The first good runs, three or more, are the baseline; maintenance starts a new one. Every later run is
    compared with it, with thresholds computed for this axis and the stated false-alarm rate.
    """
    from ballscrew.calibration.assumptions import Assumptions
    from ballscrew.cli.monitor import monitor_command
    from ballscrew.monitoring.detection.settings import MonitorSettings

    settings = MonitorSettings(
        false_alarms_per_year=false_alarms,
        repeats_per_year=repeats,
        baseline_runs=baseline_runs,
        assumptions=Assumptions(bearing_drift=bearing_drift),
    )
    return monitor_command(
        runs, model=model, store=store, events=events, settings=settings, end=end, largest_load=largest_load,
        backlash=backlash, duty=duty, accept=accept or [], as_json=as_json, plot=plot, table=table,
        exit_code=exit_code,
    )  # fmt: skip


def watch(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder with the runs, each a RUN.toml, at any depth.")
    ],
    model: Model,
    events: Events = None,
    page: Annotated[
        Path | None, option("Page of the axis to write. [default: axis.html in DIR]", "FILE.html")
    ] = None,
    false_alarms: FalseAlarms = 0.1,
    repeats: Repeats = 8.0,
    bearing_drift: BearingDrift = None,
    duty: Duty = None,
    accept: Accept = None,
    as_json: Json = False,
    exit_code: ExitCode = False,
) -> int:
    """Analyse the runs that are new in a folder, monitor the axis, and write one HTML page.

    Made for a scheduler: each result is written beside its RUN.toml, whole or not at all, and a second call
    changes nothing. A run that cannot be used is reported, and does not stop the others.
    """
    from ballscrew.calibration.assumptions import Assumptions
    from ballscrew.cli.watch import watch_command
    from ballscrew.monitoring.detection.settings import MonitorSettings

    settings = MonitorSettings(
        false_alarms_per_year=false_alarms,
        repeats_per_year=repeats,
        assumptions=Assumptions(bearing_drift=bearing_drift),
    )
    return watch_command(
        folder, model=model, events=events, settings=settings, duty=duty, accept=accept or [],
        page=page, as_json=as_json, exit_code=exit_code,
    )  # fmt: skip
