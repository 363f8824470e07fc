"""All commands, and the options of those that deal with recordings and plans."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ballscrew._version import __version__
from ballscrew.cli.model_app import calibrate, monitor, preload
from ballscrew.cli.options import Axis, Channels, Files, Json, Mass, PlanFile, Seed
from ballscrew.cli.simulate_app import simulate

app = typer.Typer(
    name="ballscrew",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Detect preload loss in ball screws weeks before backlash appears.\n\n"
    "Start with `ballscrew init FILES…`, which inspects your recordings and writes the files to complete.",
    epilog="Exit status: 0 done; 1 bad measurement, refused; 2 the command or a file is wrong.",
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
        typer.Option(metavar="2026-01-31T08:00Z", help="Time of the measurement. [default: from the file]"),
    ] = None,
    temperature: Annotated[str | None, typer.Option(metavar='"23 degC"', help="Axis temperature.")] = None,
    method: Annotated[
        str,
        typer.Option(
            metavar="joint|paper",
            help="joint: one model for all cells of the run, fitted to torque, position and acceleration; "
            "more accurate, and estimates the rotor-held frequency too. paper: peak of each cell's FRF.",
        ),
    ] = "joint",
    response: Annotated[
        str,
        typer.Option(
            metavar="nut|motor|both",
            help="Measured response to the torque, with method joint: nut (accelerometers at the nut), motor "
            "(its encoder; no accelerometer needed), or both, as far as the channels allow.",
        ),
    ] = "both",
    band: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="LOW HIGH",
            help="Search band of the mode, Hz. [default: method joint starts at the data sheet's frequency; "
            "method paper searches ± 25 % around it]",
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
            help="Quantity averaged over repetitions: spectra, or ratios (another reading of the paper).",
        ),
    ] = "spectra",
    explain: Annotated[
        str | None,
        typer.Option(
            metavar="45mm:PD[:MOTION]",
            help="Explain the result of one cell and how to improve it; with --plot, also in a picture. "
            "Motions are numbered from 0.",
        ),
    ] = None,
    as_json: Json = False,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Plot the run, or the cell of --explain, to a PNG, SVG or PDF file."
        ),
    ] = None,
    spectra: Annotated[
        Path | None,
        typer.Option(metavar="FILE.h5", help="Write the averaged spectra and FRFs to an HDF5 file."),
    ] = None,
) -> None:
    """Estimate the axial natural frequency of every cell of one run, with its uncertainty.

    Reports the quality of the measurement and the masses first. A cell is one stop and one condition (PA,
    PD, NA, ND: acceleration away from the stop or deceleration towards it, in the positive or negative
    direction).
    """
    from ballscrew.cli.analyze import Output, analyze_command, parse_options

    status = analyze_command(
        files,
        channels=channels,
        axis=axis,
        plan=plan,
        mass=mass,
        measured_at=measured_at,
        temperature=temperature,
        options=parse_options(method, response, band, estimator, average),
        output=Output(explain, as_json, plot, spectra),
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
    """Assess the quality of a measurement: good, suspect or bad, with reasons.

    Axis, plan and load allow more checks.
    """
    from ballscrew.cli.analyze import quality_command

    raise typer.Exit(
        quality_command(files, channels=channels, axis=axis, plan=plan, mass=mass, as_json=as_json)
    )


@app.command(epilog="Example: ballscrew init recording.csv")
def init(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILES…", help="Recordings of one run, in any known format.")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the four files.")] = Path(),
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
    as_json: Json = False,
) -> None:
    """Inspect recordings and write axis.toml, plan.toml, channels.toml and run.toml to complete.

    Channels are guessed from names and units; missing values are marked TODO.
    """
    from ballscrew.cli.init import init_command

    raise typer.Exit(init_command(files, out, force=force, as_json=as_json))


app.add_typer(simulate, name="simulate")


@app.command(epilog="Example: ballscrew demo")
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the report.")] = Path("ballscrew-demo"),
    as_json: Json = False,
) -> None:
    """Simulate an axis that wears out, test it throughout its life, and write a report with plots.

    Needs no input and takes about two minutes.
    """
    from ballscrew.cli.experiments import demo_command

    raise typer.Exit(demo_command(out, as_json=as_json))


@app.command(epilog="Example: ballscrew reproduce --out paper --quick")
def reproduce(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the report.")] = Path(
        "ballscrew-paper"
    ),
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Three round trips per run, not thirty; half of the days and loads."),
    ] = False,
    keep: Annotated[bool, typer.Option("--keep", help="Keep the recordings (about 11 GB).")] = False,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Repeat the paper's two experiments on a simulated bench and compare its figures and claims.

    First 0 to 50 kg on the table at one preload, then 80 days of wear with 100 kg, a run every three days.
    Takes about ten minutes; with --quick, under three. Recordings are deleted as they are analysed.
    """
    from ballscrew.cli.experiments import reproduce_command

    raise typer.Exit(reproduce_command(out, quick=quick, keep=keep, seed=seed, as_json=as_json))


@app.command(
    epilog="Example: ballscrew plan plan.toml --axis axis.toml --plot plan.png --gcode fcft.nc",
)
def plan(
    path: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="Plan of the test.")],
    axis: Annotated[Path, typer.Option("--axis", metavar="AXIS.toml", help="Data sheet of the axis.")],
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Plot the plan to a PNG, SVG or PDF file.")
    ] = None,
    gcode: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the test as G-code, with a slow dry run beside it."),
    ] = None,
    dialect: Annotated[
        str,
        typer.Option(
            metavar="iso|fanuc|siemens",
            help="G-code dialect: iso (dwell in s), fanuc (in ms) or siemens (G4 F).",
        ),
    ] = "iso",
    axis_word: Annotated[str, typer.Option(metavar="X", help="Axis letter in the G-code.")] = "X",
    csv: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the jerk-limited set-points as CSV.")
    ] = None,
    rate: Annotated[str, typer.Option(metavar='"1 kHz"', help="Sample rate of the set-points.")] = "1 kHz",
    levels: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the plan with the two suggested acceleration levels."),
    ] = None,
    optimize: Annotated[
        bool,
        typer.Option("--optimize", help="Choose the stops and loads with the most information per minute."),
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="PLAN.toml", help="Write the plan chosen by --optimize.")
    ] = None,
    loads: Annotated[
        str | None,
        typer.Option(metavar='"0 kg, 50 kg"', help="Candidate loads, for --optimize. [default: the plan's]"),
    ] = None,
    change: Annotated[
        str | None,
        typer.Option(metavar='"10 min"', help="Time to change the load, for --optimize. [default: 10 min]"),
    ] = None,
    capability: Annotated[
        bool, typer.Option("--capability", help="Report the smallest detectable loss of preload.")
    ] = False,
    model: Annotated[
        Path | None,
        typer.Option(metavar="MODEL.json", help="Calibrated axis, instead of the data sheet."),
    ] = None,
    baseline: Annotated[
        list[Path] | None,
        typer.Option(metavar="RUN.json", help="Run of the new axis, for --capability; repeatable."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Check a test before it is run: cells, duration, torque at the natural frequency, load on the nut.

    Warns of anything that would spoil the measurement. A test that exceeds the travel or a limit of the
    machine is never exported. --optimize and --capability predict the accuracy before anything moves.
    """
    from ballscrew.cli.plan import Export, plan_command
    from ballscrew.cli.plan_accuracy import AccuracyOptions

    export = Export(plot, gcode, csv, levels, dialect, axis_word, rate)
    accuracy = AccuracyOptions(optimize, capability, out, loads, change, model, tuple(baseline or ()))
    raise typer.Exit(plan_command(path, axis=axis, export=export, as_json=as_json, accuracy=accuracy))


app.command(
    epilog="Example: ballscrew calibrate run-0kg.json run-50kg.json --axis axis.toml --out model.json"
)(calibrate)
app.command(
    epilog="Example: ballscrew preload run.json --model model.json --baseline new.json --plot preload.png"
)(preload)
app.command(
    epilog="Example: ballscrew monitor runs/*.json --model model.json --events events.toml --plot axis.png"
)(monitor)
