"""Options of ``ballscrew plan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ballscrew.cli.options import Json, flag, option

_EXPORT = "Export (of a plan within all limits)"
_OPTIMISE = "Accuracy: optimise the plan, predict the smallest detectable loss"


def plan(
    path: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="Plan of the test.")],
    axis: Annotated[Path, option("Data sheet of the axis.", "AXIS.toml")],
    plot: Annotated[Path | None, option("Plot the plan to a PNG, SVG or PDF file.", "FILE")] = None,
    gcode: Annotated[
        Path | None,
        option(
            "Write the test as G-code, and FILE-dry-run, the same path once at low speed.",
            "FILE",
            rich_help_panel=_EXPORT,
        ),
    ] = None,
    dialect: Annotated[
        str,
        option(
            "G-code dialect: iso (dwell in s), fanuc (in ms) or siemens (G4 F).",
            "iso|fanuc|siemens",
            rich_help_panel=_EXPORT,
        ),
    ] = "iso",
    axis_word: Annotated[
        str,
        option(
            "Axis letter in the G-code: X, Y, Z, U, V or W (fanuc: X, Y or Z; siemens also with a number).",
            "X",
            rich_help_panel=_EXPORT,
        ),
    ] = "X",
    csv: Annotated[
        Path | None,
        option(
            "Write the jerk-limited set-points of all trips as CSV: time, position, speed, acceleration.",
            "FILE",
            rich_help_panel=_EXPORT,
        ),
    ] = None,
    rate: Annotated[
        str, option("Sample rate of the set-points.", '"1 kHz"', rich_help_panel=_EXPORT)
    ] = "1 kHz",
    levels: Annotated[
        Path | None,
        option(
            "Write the plan with the two suggested acceleration levels instead of its motions.",
            "FILE",
            rich_help_panel=_EXPORT,
        ),
    ] = None,
    gentle: Annotated[
        Path | None,
        option("Write the plan with a gentler motion, for a worn nut.", "FILE", rich_help_panel=_EXPORT),
    ] = None,
    trace: Annotated[
        bool,
        flag(
            "Print signals, rate and duration of a trace of the drive, for a test without added sensors.",
            "--trace",
        ),
    ] = False,
    optimize: Annotated[
        bool,
        flag(
            "Choose the stops, loads and preloads with the most information per minute; keep the motions.",
            "--optimize",
            rich_help_panel=_OPTIMISE,
        ),
    ] = False,
    out: Annotated[
        Path | None, option("Write the plan chosen by --optimize.", "PLAN.toml", rich_help_panel=_OPTIMISE)
    ] = None,
    loads: Annotated[
        str | None,
        option(
            "Candidate loads, for --optimize. [default: the plan's]",
            '"0 kg, 50 kg"',
            rich_help_panel=_OPTIMISE,
        ),
    ] = None,
    change: Annotated[
        str | None,
        option(
            "Time to change the load, for --optimize. [default: 10 min]",
            '"10 min"',
            rich_help_panel=_OPTIMISE,
        ),
    ] = None,
    preloads: Annotated[
        str | None,
        option(
            "Candidate preloads of an adjustable nut, for --optimize. [default: the plan's]",
            '"600 N, 300 N"',
            rich_help_panel=_OPTIMISE,
        ),
    ] = None,
    adjust: Annotated[
        str | None,
        option(
            "Time to set another preload, for --optimize. [default: 30 min]",
            '"30 min"',
            rich_help_panel=_OPTIMISE,
        ),
    ] = None,
    capability: Annotated[
        bool,
        flag(
            "Report the smallest detectable loss of preload after 1, 3 and 10 runs.",
            "--capability",
            rich_help_panel=_OPTIMISE,
        ),
    ] = False,
    model: Annotated[
        Path | None,
        option(
            "Calibrated axis, for --optimize or --capability. [default: the data sheet]",
            "MODEL.json",
            rich_help_panel=_OPTIMISE,
        ),
    ] = None,
    baseline: Annotated[
        list[Path] | None,
        option(
            "Run of the new axis, for --capability; repeatable. [default: a typical scatter, 5 runs]",
            "RUN.json",
            rich_help_panel=_OPTIMISE,
        ),
    ] = None,
    as_json: Json = False,
) -> int:
    """Check a test before it is run: cells, duration, torque at the natural frequency, load on the nut.

    Warns of anything that would spoil the measurement. A test that exceeds the travel or a limit of the
    machine is never exported. --optimize and --capability predict the accuracy before anything moves.
    """
    from ballscrew.cli.plan import Export, plan_command
    from ballscrew.cli.plan_accuracy import AccuracyOptions

    export = Export(plot, gcode, csv, levels, dialect, axis_word, rate, gentle, trace)
    accuracy = AccuracyOptions(
        optimize, capability, out, loads, change, model, tuple(baseline or ()), preloads, adjust
    )
    return plan_command(path, axis=axis, export=export, as_json=as_json, accuracy=accuracy)
