"""All commands in the order of their use, and the options of those that deal with recordings."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from ballscrew._version import __version__
from ballscrew.cli.model_app import calibrate, monitor, preload, watch
from ballscrew.cli.options import (
    Axis,
    Channels,
    Command,
    CommandGroup,
    Files,
    Json,
    Mass,
    PlanFile,
    Seed,
    TableFile,
    Verbose,
    flag,
    option,
)
from ballscrew.cli.plan_app import plan
from ballscrew.cli.send_app import send
from ballscrew.cli.serve_app import serve, token
from ballscrew.cli.simulate_app import simulate
from ballscrew.cli.store_app import report, reprocess, store
from ballscrew.cli.user_app import user

app = typer.Typer(
    name="ballscrew",
    cls=CommandGroup,
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Detect preload loss in ball screws weeks before backlash appears.\n\n"
    "Start with `ballscrew init FILES…`, which inspects your recordings and writes the files to complete.",
    epilog="Exit status: 0 done; 1 bad measurement, refused; 2 the command or a file is wrong; monitor "
    "--exit-code adds 3 watch, 4 alarm, 5 learning, suspect or not judged; send adds 75 not sent yet.",
)


@app.callback(invoke_without_command=True)
def _main(
    version: Annotated[bool, flag("Print the version and exit.", "--version", "-V")] = False,
    in_process: Annotated[
        bool, flag("Read recordings in this process; for debugging only.", "--in-process")
    ] = False,
) -> None:
    if in_process:
        from ballscrew.recording.readers.process import IN_PROCESS

        os.environ[IN_PROCESS] = "1"
    if version:
        typer.echo(f"ballscrew {__version__}")
        raise typer.Exit


@app.command(cls=Command, epilog="Example: ballscrew init trip1.csv trip2.csv trip3.csv --out x-axis")
def init(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILES…", help="Recordings of one run; the first determines the channels."),
    ],
    out: Annotated[Path, option("Folder for the four files; created if missing.", "DIR")] = Path(),
    force: Annotated[bool, flag("Overwrite existing files.", "--force")] = False,
    as_json: Json = False,
) -> int:
    """Inspect recordings and write axis.toml, plan.toml, channels.toml and run.toml to complete.

    Channels are guessed from names and units; stops, speed, acceleration and dwell are measured. Missing
    values are marked TODO.
    """
    from ballscrew.cli.init import init_command

    return init_command(files, out, force=force, as_json=as_json)


app.command(
    cls=Command, epilog="Example: ballscrew plan plan.toml --axis axis.toml --plot plan.png --gcode fcft.nc"
)(plan)


@app.command(cls=Command, epilog="Example: ballscrew quality run.toml")
def quality(
    files: Files,
    channels: Channels = None,
    axis: Axis = None,
    plan: PlanFile = None,
    mass: Mass = None,
    as_json: Json = False,
) -> int:
    """Assess the quality of a measurement: good, suspect or bad, with reasons.

    With a plan, rates and stops are checked against it; with a data sheet and the load, the equivalent mass.
    """
    from ballscrew.cli.analyze import quality_command

    return quality_command(files, channels=channels, axis=axis, plan=plan, mass=mass, as_json=as_json)


@app.command(
    cls=Command,
    epilog="Example: ballscrew analyze run.toml --plot run.png --json > run.json\n\n"
    "Without RUN.toml: ballscrew analyze trip*.h5 --channels channels.toml --axis axis.toml --plan plan.toml "
    '--mass "100 kg"',
)
def analyze(
    files: Files,
    channels: Channels = None,
    axis: Axis = None,
    plan: PlanFile = None,
    mass: Mass = None,
    measured_at: Annotated[
        str | None,
        option(
            "Time of the measurement, ISO 8601. [default: run.toml's, else the first file's]",
            "2026-01-31T08:00Z",
        ),
    ] = None,
    temperature: Annotated[
        str | None,
        option(
            "Temperature of the axis. [default: run.toml's, else the mean of the recorded one]", '"23 degC"'
        ),
    ] = None,
    method: Annotated[
        str,
        option(
            "joint: one model for all cells of the run, fitted to torque, position and acceleration; "
            "more accurate, and estimates the rotor-held frequency too. paper: peak of each cell's FRF.",
            "joint|paper",
        ),
    ] = "joint",
    response: Annotated[
        str,
        option(
            "Measured response to the torque, with method joint: nut (accelerometers at the nut), motor "
            "(its encoder; no accelerometer needed), or both, as far as the channels allow.",
            "nut|motor|both",
        ),
    ] = "both",
    band: Annotated[
        tuple[float, float] | None,
        option(
            "Search band of the mode, Hz. [default: method joint starts at the data sheet's frequency; "
            "method paper searches ± 25 % around it]",
            "LOW HIGH",
        ),
    ] = None,
    estimator: Annotated[
        str,
        option(
            "FRF estimator: H1 (noise on the acceleration), H2 (noise on the torque) or Hv (their geometric "
            "mean).",
            "H1|H2|Hv",
        ),
    ] = "H1",
    average: Annotated[
        str,
        option(
            "Quantity averaged over repetitions: spectra, or ratios (another reading of the paper).",
            "spectra|ratios",
        ),
    ] = "spectra",
    explain: Annotated[
        str | None,
        option(
            "Explain the result of one cell and how to improve it; with --plot, also in a picture. "
            "Motions are numbered from 0.",
            "45mm:PD[:MOTION]",
        ),
    ] = None,
    verbose: Verbose = False,
    as_json: Json = False,
    plot: Annotated[
        Path | None, option("Plot the run, or the cell of --explain, to a PNG, SVG or PDF file.", "FILE")
    ] = None,
    spectra: Annotated[
        Path | None, option("Write the averaged spectra and FRFs to an HDF5 file.", "FILE.h5")
    ] = None,
    table: TableFile = None,
) -> int:
    """Estimate the axial natural frequency of every stop of one run, with its uncertainty.

    With --verbose, also prints masses, friction and every cell. A cell is one stop and one condition (PA,
    PD, NA, ND: acceleration away from the stop or deceleration towards it, in the positive or negative
    direction).
    """
    from ballscrew.cli.analyze import Output, analyze_command, parse_options
    from ballscrew.modal.job import Job

    options = parse_options(method, response, band, estimator, average)
    job = Job.read(
        files,
        channels=channels,
        axis=axis,
        plan=plan,
        mass=mass,
        measured_at=measured_at,
        temperature=temperature,
    )
    return analyze_command(job, options, Output(explain, as_json, plot, spectra, verbose, table))


app.command(
    cls=Command,
    epilog="Example: ballscrew calibrate run-0kg.json run-50kg.json --axis axis.toml --out model.json",
)(calibrate)
app.command(
    cls=Command,
    epilog="Example: ballscrew preload run.json --model model.json --baseline new.json --plot preload.png",
)(preload)
app.command(
    cls=Command,
    epilog="Example: ballscrew monitor runs/*.json --model model.json --events events.toml --plot axis.png",
)(monitor)
app.command(cls=Command, epilog="Example: ballscrew watch runs --model model.json --exit-code")(watch)


@app.command(cls=Command, epilog="Example: ballscrew amend run.json --measured-at 2026-01-31T08:00Z")
def amend(
    path: Annotated[Path, typer.Argument(metavar="RUN.json", help="Output of analyze --json.")],
    measured_at: Annotated[
        str | None, option("Time of the measurement, ISO 8601. [default: unchanged]", "2026-01-31T08:00Z")
    ] = None,
    mass: Annotated[
        str | None, option("Load on the table; requires --axis. [default: unchanged]", '"100 kg"')
    ] = None,
    axis: Annotated[Path | None, option("Data sheet of the analysis, for --mass.", "AXIS.toml")] = None,
    plan: Annotated[Path | None, option("Plan of the analysis, for --mass.", "PLAN.toml")] = None,
    out: Annotated[Path | None, option("File to write. [default: RUN.json itself]", "FILE.json")] = None,
    as_json: Json = False,
) -> int:
    """Add or correct the time or the load of an analysed run, without the recordings.

    The run gets a new id, which supersedes the old one. A new load is checked as `analyze` checks it, and
    refused if it makes the measurement bad; the frequencies stay as they are.
    """
    from ballscrew.cli.analyze import amend_command

    return amend_command(
        path, measured_at=measured_at, mass=mass, axis=axis, plan=plan, out=out, as_json=as_json
    )


@app.command(
    cls=Command,
    epilog='Example: ballscrew frf noise.csv --input iq --output speed --position "200 mm" --mass "0 kg" '
    "--plot frf.png",
)
def frf(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILES…", help="Recordings; those at one position form one cell.")
    ],
    input_channel: Annotated[str, option("Channel of the torque, or of i_q.", "CHANNEL", "--input")],
    output_channel: Annotated[
        str, option("Channel of the motor's speed or position, or an acceleration.", "CHANNEL", "--output")
    ],
    reference: Annotated[
        str | None,
        option(
            "Channel of the excitation that was added to a set-point; with it, noise fed back by the "
            "controller does not bias the result.",
            "CHANNEL",
        ),
    ] = None,
    quantities: Annotated[
        tuple[str, str] | None,
        option(
            "Quantities of input and output: torque, force, current, acceleration, speed or position. "
            "[default: from the channel map or the names]",
            "INPUT OUTPUT",
        ),
    ] = None,
    channels: Annotated[
        Path | None,
        option("Channel map. [default: none; the units of the channels have no effect]", "CHANNELS.toml"),
    ] = None,
    axis: Annotated[
        Path | None, option("Data sheet of the axis, for its name and the ends of its screw.", "AXIS.toml")
    ] = None,
    position: Annotated[
        list[str] | None,
        option(
            "Position of the table; repeatable, one for each file. [default: mean of the mapped position]",
            '"200 mm"',
        ),
    ] = None,
    mass: Annotated[
        str | None, option("Load on the table; calibrate and preload need it.", '"100 kg"')
    ] = None,
    measured_at: Annotated[
        str | None, option("Time of the measurement, ISO 8601. [default: the file's]", "2026-01-31T08:00Z")
    ] = None,
    band: Annotated[
        tuple[float, float] | None,
        option(
            "Range of frequencies to fit, with resonance and antiresonance, Hz. [default: around "
            "the most prominent peak from 40 to 500 Hz]",
            "LOW HIGH",
        ),
    ] = None,
    as_json: Json = False,
    plot: Annotated[Path | None, option("Plot the responses to a PNG, SVG or PDF file.", "FILE")] = None,
    table: TableFile = None,
) -> int:
    """Estimate resonance and antiresonance of an axis excited by its drive with noise, chirp or sine steps.

    In the response of motor speed to torque, the resonance is the axial mode with the rotor free, and the
    antiresonance is that with the rotor held. The JSON is a run for `calibrate` and `preload`, with a cell
    for each position.
    """
    from ballscrew.cli.frf import frf_command
    from ballscrew.modal.analyze_frf import frf_job
    from ballscrew.modal.excited_record import Signals

    job = frf_job(files, channels, axis, mass, measured_at)
    signals = Signals(input_channel, output_channel, reference, quantities or (None, None))
    return frf_command(job, signals, position or (), band, as_json=as_json, plot=plot, table=table)


@app.command(cls=Command, epilog="Example: ballscrew demo")
def demo(
    out: Annotated[Path, option("Folder for the report and the runs.", "DIR")] = Path("ballscrew-demo"),
    as_json: Json = False,
) -> int:
    """Simulate an axis that wears out, test it throughout its life, and write a report with plots.

    Needs no input and takes two to four minutes.
    """
    from ballscrew.cli.experiments import demo_command

    return demo_command(out, as_json=as_json)


@app.command(cls=Command, epilog="Example: ballscrew reproduce --out paper --quick")
def reproduce(
    out: Annotated[Path, option("Folder for the report and the runs.", "DIR")] = Path("ballscrew-paper"),
    quick: Annotated[
        bool, flag("Three round trips per run instead of thirty; runs every six days; four loads.", "--quick")
    ] = False,
    keep: Annotated[bool, flag("Keep the recordings (about 11 GB).", "--keep")] = False,
    seed: Seed = 0,
    as_json: Json = False,
) -> int:
    """Simulate the paper's two experiments and compare the results with its figures and claims.

    The first has 0 to 50 kg on the table at one preload; the second, 80 days of wear with 100 kg and a run
    every three days. Takes about ten minutes; with --quick, less than three. Recordings are deleted as they
    are analysed.
    """
    from ballscrew.cli.experiments import reproduce_command

    return reproduce_command(out, quick=quick, keep=keep, seed=seed, as_json=as_json)


app.add_typer(simulate, name="simulate")
app.add_typer(store, name="store")
app.command(cls=Command, epilog="Example: ballscrew report --data plant --out plant.pdf")(report)
app.command(cls=Command, epilog="Example: ballscrew serve --data plant")(serve)
app.add_typer(token, name="token")
app.add_typer(user, name="user")
app.command(cls=Command, epilog='Example: ballscrew reprocess "X axis" --store plant --workers 4')(reprocess)
app.command(
    cls=Command,
    epilog="Example: ballscrew send run.toml --to https://plant:8443 --token-file token.txt\n\n"
    'On a machine: ballscrew send --watch D:\\X1 --pattern "{axis}_{run}_trip{trip}.h5" --trips 3 --to https://plant:8443',
)(send)
