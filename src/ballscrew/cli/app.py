"""The commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ballscrew._version import __version__
from ballscrew.cli.monitor_app import monitor
from ballscrew.cli.options import Axis, Channels, Files, Json, Mass, PlanFile, Seed
from ballscrew.cli.preload_app import preload
from ballscrew.cli.simulate_app import simulate

__all__ = ["app"]

app = typer.Typer(
    name="ballscrew",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Tells, weeks before backlash appears, that a ball screw is losing its preload.\n\n"
    "Start with `ballscrew init FILES…`, which looks into your recordings and writes the files to fill in.",
    epilog="Exit status: 0 done; 1 the measurement is bad and was refused; 2 the command or a file is wrong.",
)


@app.callback(invoke_without_command=True)
def _main(
    version: Annotated[bool, typer.Option("--version", "-V", help="Print the version and exit.")] = False,
) -> None:
    if version:
        typer.echo(f"ballscrew {__version__}")
        raise typer.Exit


@app.command(
    epilog="Example: ballscrew analyze trip*.h5 --axis axis.toml --plan plan.toml --channels channels.toml "
    '--mass "100 kg"'
)
def analyze(
    files: Files,
    channels: Channels = None,
    axis: Axis = None,
    plan: PlanFile = None,
    mass: Mass = None,
    measured_at: Annotated[
        str | None,
        typer.Option(metavar="2026-01-31T08:00Z", help="When it was measured. [default: as the file says]"),
    ] = None,
    temperature: Annotated[str | None, typer.Option(metavar='"23 degC"', help="Of the axis.")] = None,
    method: Annotated[
        str,
        typer.Option(
            metavar="joint|paper",
            help="joint: one model for all cells of the run, fitted to torque, position and acceleration; "
            "more exact, and gives the rotor-held frequency too. paper: the peak of each cell's own FRF.",
        ),
    ] = "joint",
    response: Annotated[
        str,
        typer.Option(
            metavar="nut|motor|both",
            help="What answers to the torque, by method joint: nut (accelerometers at the nut), motor (its "
            "encoder alone: no accelerometer needed), or both: what the channels allow.",
        ),
    ] = "both",
    band: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="LOW HIGH",
            help="Where to look for the mode, Hz, instead of where the data sheet says. [default: method "
            "joint starts at the data sheet's frequency and may leave it; paper looks ± 25 % around it]",
        ),
    ] = None,
    estimator: Annotated[
        str,
        typer.Option(metavar="H1|H2|Hv", help="H1 (noise on the acceleration), H2 (on the torque) or Hv."),
    ] = "H1",
    average: Annotated[
        str,
        typer.Option(
            metavar="spectra|ratios",
            help="What is averaged over repetitions: spectra, or ratios (the paper's other reading).",
        ),
    ] = "spectra",
    explain: Annotated[
        str | None,
        typer.Option(
            metavar="45mm:PD[:MOTION]",
            help="Say of one cell why its number is what it is, and what would make it better; with --plot, "
            "in one picture too. Motions count from 0.",
        ),
    ] = None,
    as_json: Json = False,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Draw the run, or the cell to --explain, into a PNG, SVG or PDF file."
        ),
    ] = None,
    spectra: Annotated[
        Path | None,
        typer.Option(metavar="FILE.h5", help="Write the averaged spectra and FRFs to an HDF5 file."),
    ] = None,
) -> None:
    """Reads the recordings of one run and tells at what frequency the axis rings, cell by cell, with ±.

    Says first whether the measurement is good, and what the axis weighs. A cell is one stop, reached or left
    in one direction (PA, PD, NA, ND: positive or negative, acceleration or deceleration).
    """
    from ballscrew.cli.analyze import analyze_command

    status = analyze_command(
        files,
        channels=channels,
        axis=axis,
        plan=plan,
        mass=mass,
        measured_at=measured_at,
        temperature=temperature,
        method=method,
        response=response,
        band=band,
        estimator=estimator,
        average=average,
        explain=explain,
        as_json=as_json,
        plot=plot,
        spectra=spectra,
    )
    raise typer.Exit(status)


@app.command(epilog="Example: ballscrew quality trip1.h5 --channels channels.toml")
def quality(
    files: Files,
    channels: Channels = None,
    axis: Axis = None,
    plan: PlanFile = None,
    mass: Mass = None,
    as_json: Json = False,
) -> None:
    """Says whether recordings are a good measurement: good, suspect or bad, with the reasons in words.

    The more is given (axis, plan, load), the more can be checked.
    """
    from ballscrew.cli.quality import quality_command

    raise typer.Exit(
        quality_command(files, channels=channels, axis=axis, plan=plan, mass=mass, as_json=as_json)
    )


@app.command(epilog="Example: ballscrew init recording.csv")
def init(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILES…", help="Recordings of one run, in any known format.")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the four files.")] = Path(),
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that are there.")] = False,
    as_json: Json = False,
) -> None:
    """Looks into recordings and writes axis.toml, plan.toml, channels.toml and run.toml to fill in.

    Channels are guessed from names and units; what is missing is marked TODO.
    """
    from ballscrew.cli.init_report import init_command

    raise typer.Exit(init_command(files, out, force=force, as_json=as_json))


app.add_typer(simulate, name="simulate")


@app.command(epilog="Example: ballscrew demo")
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the report.")] = Path("ballscrew-demo"),
    as_json: Json = False,
) -> None:
    """Wears a simulated axis out, measures it all along, and leaves a report with pictures.

    Needs no input. Takes about two minutes.
    """
    from ballscrew.cli.demo import demo_command

    raise typer.Exit(demo_command(out, as_json=as_json))


@app.command(epilog="Example: ballscrew reproduce --out paper --quick")
def reproduce(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the report.")] = Path(
        "ballscrew-paper"
    ),
    quick: Annotated[
        bool, typer.Option("--quick", help="Three round trips a run, not thirty; half of the days and loads.")
    ] = False,
    keep: Annotated[bool, typer.Option("--keep", help="Keep the recordings: some 11 GB.")] = False,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Runs the paper's two experiments on a simulated bench: its figures, and its claims beside ours.

    First 0 to 50 kg on the table at one preload, then 80 days of wear with 100 kg, a run every three days.
    Takes about ten minutes; with --quick, under three. Recordings are deleted as they are analysed.
    """
    from ballscrew.cli.reproduce import reproduce_command

    raise typer.Exit(reproduce_command(out, quick=quick, keep=keep, seed=seed, as_json=as_json))


@app.command(
    epilog="Example: ballscrew calibrate run-0kg.json run-50kg.json --axis axis.toml --out model.json"
)
def calibrate(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN.json…", help="What analyze --json printed, a run each.")
    ],
    axis: Annotated[Path, typer.Option("--axis", metavar="AXIS.toml", help="The data sheet of the axis.")],
    out: Annotated[Path, typer.Option(metavar="MODEL.json", help="Where the model goes.")],
    known_preload: Annotated[
        list[str] | None,
        typer.Option(
            metavar="RUN.json=600N", help="Preload of one of the runs, ± 2 % or as in 600N±10N; repeatable."
        ),
    ] = None,
    bearing_drift: Annotated[
        float,
        typer.Option(min=0, max=1, help="By what part the bearing's rigidity may differ between days, 95 %."),
    ] = 0.01,
    sample: Annotated[
        bool, typer.Option("--sample", help="Check the model with a sampler; needs ballscrew[sample].")
    ] = False,
    as_json: Json = False,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw frequencies and model into a PNG, SVG or PDF file."),
    ] = None,
) -> None:
    """Fits the model of an axis to runs at several loads, and says what they tell and what only the sheet.

    Runs of one day, and runs without a time, are taken to have one preload.
    """
    from ballscrew.calibration.assumptions import Assumptions
    from ballscrew.cli.calibrate import calibrate_command

    raise typer.Exit(
        calibrate_command(
            runs,
            axis=axis,
            out=out,
            known=known_preload or [],
            assumptions=Assumptions(bearing_drift=bearing_drift),
            sampled=sample,
            as_json=as_json,
            plot=plot,
        )
    )


@app.command(
    epilog="Example: ballscrew plan plan.toml --axis axis.toml --plot plan.png --gcode fcft.nc",
)
def plan(
    path: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="The test.")],
    axis: Annotated[Path, typer.Option("--axis", metavar="AXIS.toml", help="The data sheet of the axis.")],
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the plan into a PNG, SVG or PDF file.")
    ] = None,
    gcode: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the test as G-code, and a slow dry run of it beside."),
    ] = None,
    dialect: Annotated[
        str,
        typer.Option(
            metavar="iso|fanuc|siemens",
            help="Whose G-code: iso (dwell in s), fanuc (in ms) or siemens (G4 F).",
        ),
    ] = "iso",
    axis_word: Annotated[str, typer.Option(metavar="X", help="The axis's letter in the G-code.")] = "X",
    csv: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the jerk-limited set-points as CSV.")
    ] = None,
    rate: Annotated[str, typer.Option(metavar='"1 kHz"', help="Of the set-points.")] = "1 kHz",
    levels: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the plan with the two acceleration levels offered."),
    ] = None,
    optimize: Annotated[
        bool, typer.Option("--optimize", help="Choose the stops and loads that tell the most per minute.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="PLAN.toml", help="Write the plan that --optimize chooses.")
    ] = None,
    loads: Annotated[
        str | None,
        typer.Option(
            metavar='"0 kg, 50 kg"', help="Loads that --optimize may choose from. [default: the plan's]"
        ),
    ] = None,
    change: Annotated[
        str | None,
        typer.Option(metavar='"10 min"', help="Time to change the load, for --optimize. [default: 10 min]"),
    ] = None,
    capability: Annotated[
        bool, typer.Option("--capability", help="Tell the smallest loss of preload that this axis can show.")
    ] = False,
    model: Annotated[
        Path | None,
        typer.Option(metavar="MODEL.json", help="The calibrated axis, in place of what its sheet knows."),
    ] = None,
    baseline: Annotated[
        list[Path] | None,
        typer.Option(metavar="RUN.json", help="A run of the new axis, for --capability; once for each."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Checks a test before it is run: cells, duration, torque at the natural frequency, load on the nut.

    Warns of what would spoil the measurement. A test that leaves the screw, or a limit of the machine, is
    never exported. --optimize and --capability say what accuracy to expect before anything moves.
    """
    from ballscrew.cli.plan import Export, plan_command
    from ballscrew.cli.plan_ask import Ask

    export = Export(plot, gcode, csv, levels, dialect, axis_word, rate)
    ask = Ask(optimize, capability, out, loads, change, model, tuple(baseline or ()))
    raise typer.Exit(plan_command(path, axis=axis, export=export, as_json=as_json, ask=ask))


app.command(
    epilog="Example: ballscrew preload run.json --model model.json --baseline new.json --plot preload.png"
)(preload)
app.command(
    epilog="Example: ballscrew monitor runs/*.json --model model.json --events events.toml --plot axis.png"
)(monitor)
