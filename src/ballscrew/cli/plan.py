"""``ballscrew plan``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from ballscrew.base.errors import DONE, WRONG_INPUT, InputError
from ballscrew.base.files import check_folder
from ballscrew.base.units import parse_named
from ballscrew.base.words import duration, plural
from ballscrew.cli.output import (
    check_outputs,
    console,
    print_json,
    right_aligned,
)
from ballscrew.cli.plan_accuracy import (
    AccuracyOptions,
    predict_accuracy,
    print_calibration,
    print_prediction,
    write_optimised,
)
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.dialect import find_dialect
from ballscrew.fcft.expected import ExpectedCell
from ballscrew.fcft.gcode import dry_run_path
from ballscrew.fcft.plan import Motion
from ballscrew.fcft.planned import PlannedTest, plan
from ballscrew.fcft.set_points_csv import check_rate
from ballscrew.fcft.trace import TraceSettings
from ballscrew.report.canvas import check_target, save_figure

_MOST_ROWS = 24  # of the table; longer plans are abbreviated


@dataclass(frozen=True, slots=True)
class Export:
    """Files to write and their settings.

    Parameters
    ----------
    plot, gcode, csv, levels, gentle : Path, optional
        Files.
    dialect, axis_word : str
        Dialect and axis letter of the G-code.
    rate : str
        Sample rate of the set-points.
    trace : bool
        Whether to print the settings of a trace by the drive.
    """

    plot: Path | None = None
    gcode: Path | None = None
    csv: Path | None = None
    levels: Path | None = None
    dialect: str = "iso"
    axis_word: str = "X"
    rate: str = "1 kHz"
    gentle: Path | None = None
    trace: bool = False

    @property
    def exports(self) -> tuple[Path | None, ...]:
        """Files that are not written for a plan that breaks a limit."""
        return self.gcode, self.csv, self.levels, self.gentle


def plan_command(
    path: Path, *, axis: Path, export: Export, as_json: bool, accuracy: AccuracyOptions | None = None
) -> int:
    """Check a plan, print it, write the files, and return the exit status."""
    accuracy = accuracy or AccuracyOptions()
    accuracy.check()
    inputs = [path, axis, *accuracy.baseline]
    if accuracy.model is not None:
        inputs.append(accuracy.model)
    _check_names(export, inputs, accuracy.out)
    rate = check_rate(parse_named("--rate", export.rate, "Hz"))
    find_dialect(export.dialect).axis_word(export.axis_word)
    test = plan(path, axis=axis)
    if not test.broken:
        _check_motions(export, test)
    prediction = predict_accuracy(accuracy, test)
    if as_json:
        print_json(test.to_json() | prediction.to_json())
    else:
        _print(test)
        if export.trace:
            _print_trace(test.trace, siemens=export.dialect == "siemens")
        print_prediction(prediction)
    if export.plot is not None:
        from ballscrew.report.plan_figure import draw_plan

        save_figure(draw_plan(test), export.plot)
    for sentence in test.broken:
        sys.stderr.write(f"ballscrew: {sentence}\n")
    if test.broken:
        if any((*export.exports, accuracy.out)):
            sys.stderr.write("ballscrew: nothing was exported.\n")
        return WRONG_INPUT
    report = _discard if as_json else console().print
    _export(test, export, rate, report)
    write_optimised(accuracy, prediction, report)
    return DONE


def _check_motions(export: Export, test: PlannedTest) -> None:
    """Check that the motions exist whose plan is to be written."""
    levels, gentle = test.levels, test.gentle
    if export.levels is not None and not levels.motions:
        raise InputError(
            f"{export.levels}: cannot be written: there are no two suitable acceleration levels, since "
            f"{levels.reason}."
        )
    if export.gentle is not None and gentle.motion is None:
        raise InputError(f"{export.gentle}: cannot be written: no motion is gentler, since {gentle.reason}.")


def _check_names(export: Export, inputs: Sequence[Path], optimised: Path | None) -> None:
    """Check before the work that its files can be written after it, and overwrite no input."""
    outputs = [file for file in (export.plot, *export.exports, optimised) if file is not None]
    for file in outputs:
        check_folder(file)
    if export.gcode is not None:
        outputs.append(dry_run_path(export.gcode))
    check_outputs(outputs, inputs)
    if export.plot is not None:
        check_target(export.plot)


def _export(test: PlannedTest, export: Export, rate: float, report: Callable[..., Any]) -> None:
    if export.gcode is not None:
        from ballscrew.fcft.gcode import write_gcode

        written, dry_run = write_gcode(
            test.plan,
            test.sheet,
            export.gcode,
            dialect=export.dialect,  # type: ignore[arg-type]  # it checks
            axis_word=export.axis_word,
        )
        report(
            f"G-code: {escape(str(written))}; run {escape(str(dry_run))} first, the same path at low speed."
        )
    if export.csv is not None:
        from ballscrew.fcft.set_points_csv import write_set_points

        write_set_points(test.plan, test.sheet, export.csv, rate=rate)
        report(f"Set-points: {escape(str(export.csv))}")
    if export.levels is not None:
        _write_plan(test, export.levels, test.levels.motions)
        report(f"Plan with two acceleration levels: {escape(str(export.levels))}")
    if export.gentle is not None and test.gentle.motion is not None:
        _write_plan(test, export.gentle, (test.gentle.motion,))
        report(f"Plan with a gentler motion: {escape(str(export.gentle))}")


def _write_plan(test: PlannedTest, path: Path, motions: tuple[Motion, ...]) -> None:
    from ballscrew.base.files import write_texts
    from ballscrew.fcft.planfile import plan_toml

    write_texts([(path, [plan_toml(replace(test.plan, motions=motions))])])


def _discard(*_: object) -> None:
    """Print nothing: with --json, standard output contains only the document."""


def _print(test: PlannedTest) -> None:
    screen, plan = console(), test.plan
    stops, loads = plural(len(plan.positions), "stop"), plural(len(plan.masses), "load")
    if plan.preloads:
        loads += f", {plural(len(plan.preloads), 'preload')}"
    screen.print(
        f"[bold]{escape(test.sheet.name)}[/], {stops} from {1e3 * plan.positions[0]:g} to "
        f"{1e3 * plan.positions[-1]:g} mm, {loads}, {plural(len(plan.motions), 'motion')}: "
        f"[bold]{plural(len(test.cells), 'cell')}[/]"
    )
    screen.print(_duration_line(test))
    for index, motion_times in enumerate(test.motions):
        motion = motion_times.motion
        screen.print(
            f"Motion {index}: {1e3 * motion.speed:.4g} mm/s, {motion.peak_acceleration:.3g} m/s², "
            f"{motion.jerk:.4g} m/s³ (jerk time {1e3 * motion.jerk_time:.3g} ms, torque nulls at "
            f"{_list(motion_times.nulls)} Hz), dwell {1e3 * motion.dwell:.4g} ms; one trip "
            f"{motion_times.trip_s:.2f} s, torque up to {motion_times.torque:.3g} N m"
        )
    screen.print(_table(test))
    screen.print(
        "Relative torque: spectrum of the torque at the frequency; 1 for a jerk of no duration, 0 in a null."
    )
    _print_levels(test)
    screen.print(_gentle_line(test), markup=False)
    if test.calibration is not None:
        print_calibration(test.plan, test.calibration)
    for sentence in (*test.broken, *test.warnings):
        screen.print("[bold yellow]Warning:[/]", end=" ")
        screen.print(sentence, markup=False)
    if not (test.broken or test.warnings):
        screen.print("[green]No problems found.[/]")
    for sentence in test.notes:
        screen.print(f"  • {sentence}", markup=False)


def _print_trace(trace: TraceSettings, *, siemens: bool) -> None:
    """Print what the drive has to record, without added sensors."""
    interval = "no usual interval of a drive is short enough"
    if trace.interval is not None:
        interval = f"such as an interval of {1e3 * trace.interval:g} ms"
    seconds = " or ".join(f"{duration:.0f} s" for duration in dict.fromkeys(trace.durations))
    signals = (
        "actual torque or torque-producing current, position by the motor's encoder; where that is slower"
        " than the torque, the motor's actual speed too"
    )
    rate = (
        f"{trace.rate:.0f} Hz or more of torque and of position or speed, for up to {trace.frequency:.0f} Hz"
    )
    lines = [
        "Trace by the drive, without added sensors:",
        f"  • signals: {signals}",
        f"  • rate: {rate}: {interval}",
        f"  • duration: {seconds}, a round trip with a second before and after it; one file for each",
    ]
    if siemens:
        lines.append(
            "  • start: $AA_SCTRACE[X]=1 in the part program triggers the servo trace of the axis X"
            " (SINUMERIK 840D, Programming Guide Advanced 04.00, 15.2.51)"
        )
    for line in lines:
        console().print(line, markup=False)


def _duration_line(test: PlannedTest) -> str:
    line = plural(test.trip_count, "round trip")
    if test.plan.warm_up:
        line += f", {test.plan.warm_up} of them to warm up"
    line += f": [bold]{duration(test.duration_s)}[/]"
    runs = test.plan.run_count
    if test.plan.preloads:
        line += f" a run, {duration(test.duration_s * runs)} in {plural(runs, 'run')}"
    elif runs > 1:
        line += f" with each load, {duration(test.duration_s * runs)} in all"
    return line


def _table(test: PlannedTest) -> Table:
    """Row per stop; preloads, several loads and several motions have columns."""
    title = "Prediction for each stop, rotor free"
    leading = [("preload\nN", "preload")] if test.plan.preloads else []  # heading and field of a cell
    if len(test.plan.masses) > 1:
        leading.append(("load\nkg", "mass"))
    else:
        title += f", load {test.plan.masses[0]:g} kg"
    if len(test.plan.motions) > 1:
        leading.append(("motion", "motion"))
    headings = [heading for heading, _ in leading]
    headings += ["position\nmm", "conditions", "frequency\nHz", "relative\ntorque"]
    headings += ["nut load N\n(of preload)", "shift by\nload, Hz"]
    table = right_aligned(headings, title=title)
    for cells in _abbreviated(_rows(test.cells)):
        if cells is None:
            table.add_row(*["…"] * len(headings))
            continue
        worst = max(cells, key=lambda cell: cell.nut_load_ratio)
        table.add_row(
            *(f"{getattr(worst, field):g}" for _, field in leading),
            f"{1e3 * worst.position:.1f}",
            " ".join(cell.condition for cell in cells),
            f"{worst.frequency:.1f} ± {worst.standard_uncertainty:.1f}",
            f"{worst.excitation:.2f}",
            f"{abs(worst.nut_load):.0f} ({worst.nut_load_ratio:.2f})",
            f"{worst.nut_load_shift:.2f}",
        )
    return table


def _rows(cells: tuple[ExpectedCell, ...]) -> list[list[ExpectedCell]]:
    """Cells grouped by preload, load, motion and stop."""
    rows: dict[tuple[float, float, int, float], list[ExpectedCell]] = {}
    for cell in cells:
        rows.setdefault((cell.preload, cell.mass, cell.motion, cell.position), []).append(cell)
    return list(rows.values())


def _abbreviated(rows: list[list[ExpectedCell]]) -> list[list[ExpectedCell] | None]:
    """All rows; of a long plan the first and last ones, with None between."""
    if len(rows) <= _MOST_ROWS:
        return list(rows)
    half = _MOST_ROWS // 2
    return [*rows[:half], None, *rows[-half:]]


def _print_levels(test: PlannedTest) -> None:
    screen, levels = console(), test.levels
    if not levels.motions:
        screen.print(f"No two acceleration levels are suitable: {levels.reason}.", markup=False)
        return
    low, high = (
        f"{motion.acceleration:.3g} m/s² to {1e3 * motion.speed:.3g} mm/s ({_loads(ratios)})"
        for motion, ratios in zip(levels.motions, levels.nut_load_ratio, strict=True)
    )
    screen.print(
        f"Two acceleration levels would determine the preload in newtons: {low} and {high}, "
        f"{levels.shift:.2f} Hz different at the first stop; --levels FILE writes that plan.",
        markup=False,
    )


def _loads(ratios: Mapping[Condition, float]) -> str:
    """Nut load of the departures in words, as a part of the preload."""
    sizes = {condition: f"{abs(ratio):.2g}" for condition, ratio in ratios.items()}
    first, second = sizes
    if sizes[first] == sizes[second]:
        return f"nut load {sizes[first]} of the preload in {first} and {second}"
    return f"nut load {sizes[first]} of the preload in {first}, {sizes[second]} in {second}"


def _gentle_line(test: PlannedTest) -> str:
    gentle = test.gentle
    which = "its lowest preload" if test.plan.preloads else "its preload"
    line = f"The load of the test unloads the nut below {100 * gentle.own_unloads_below:.2g} % of {which}"
    if gentle.motion is None:
        return f"{line}; no motion is gentler: {gentle.reason}."
    return (
        f"{line}. A gentler motion, {gentle.motion.acceleration:.3g} m/s² to "
        f"{1e3 * gentle.motion.speed:.3g} mm/s, measures down to {100 * gentle.unloads_below:.2g} %, with "
        f"{gentle.excitation:.2g} of the torque at the mode: the same noise takes {gentle.repetitions:.0f} "
        "times the repetitions. --gentle FILE writes that plan; measure the baseline with both."
    )


def _list(nulls: tuple[float, ...]) -> str:
    few = ", ".join(f"{null:.4g}" for null in nulls[:4])
    return few if len(nulls) <= 4 else f"{few}, …"
