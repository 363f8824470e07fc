"""``ballscrew plan``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from ballscrew.base.errors import DONE, WRONG_INPUT, InputError
from ballscrew.base.units import parse
from ballscrew.cli.output import check_folder, console, count, print_json
from ballscrew.cli.plan_ask import Ask, answer, check_ask, print_answers, write_optimised
from ballscrew.fcft.dialect import find_dialect
from ballscrew.fcft.expected import ExpectedCell
from ballscrew.fcft.gcode import dry_run_path
from ballscrew.fcft.planned import PlannedTest, plan
from ballscrew.fcft.set_points_csv import check_rate

__all__ = ["Export", "plan_command"]

_MOST_ROWS = 24


@dataclass(frozen=True, slots=True)
class Export:
    """What is written besides what is printed.

    Parameters
    ----------
    plot, gcode, csv, levels : Path, optional
        Files.
    dialect, axis_word : str
        Of the G-code.
    rate : str
        Of the set-points.
    """

    plot: Path | None = None
    gcode: Path | None = None
    csv: Path | None = None
    levels: Path | None = None
    dialect: str = "iso"
    axis_word: str = "X"
    rate: str = "1 kHz"


def plan_command(path: Path, *, axis: Path, export: Export, as_json: bool, ask: Ask | None = None) -> int:
    """Check a plan, print it, write what was asked for, and return the exit status."""
    ask = Ask() if ask is None else ask
    check_ask(ask)
    _check_names(export, (path, axis, *ask.baseline, *([ask.model] if ask.model else [])), ask.out)
    rate = check_rate(_rate(export.rate))
    find_dialect(export.dialect).axis_word(export.axis_word)
    test = plan(path, axis=axis)
    if export.levels is not None and not test.levels.motions and not test.broken:
        raise InputError(
            f"{export.levels}: cannot be written: two acceleration levels cannot be had, since "
            f"{test.levels.reason}."
        )
    answers = answer(ask, test)
    if as_json:
        print_json(test.to_json() | answers.to_json())
    else:
        _print(test)
        print_answers(answers)
    if export.plot is not None:
        from ballscrew.report.canvas import save_figure
        from ballscrew.report.plan_figure import draw_plan

        save_figure(draw_plan(test), export.plot)
    for sentence in test.broken:
        sys.stderr.write(f"ballscrew: {sentence}\n")
    if test.broken:
        if export.gcode or export.csv or export.levels or ask.out:
            sys.stderr.write("ballscrew: nothing was exported.\n")
        return WRONG_INPUT
    tell = _tell_nothing if as_json else console().print
    _export(test, export, rate, tell)
    write_optimised(ask, answers, tell)
    return DONE


def _rate(given: str) -> float:
    try:
        return parse(given, "Hz")
    except InputError as error:
        raise InputError(f'--rate is {given!r}; it must be a rate, such as "1 kHz" ({error}).') from None


def _check_names(export: Export, inputs: Sequence[Path], optimised: Path | None) -> None:
    """Find out before the work whether its files can be written after it, and lose nothing by it."""
    asked = (export.plot, export.gcode, export.csv, export.levels, optimised)
    files = [file for file in asked if file is not None]
    for file in files:
        check_folder(file)
    names = [*files, *([dry_run_path(export.gcode)] if export.gcode is not None else [])]
    taken = [path.resolve() for path in names]
    if len(set(taken)) < len(taken):
        raise InputError("two of the files to write have the same name; give each its own.")
    for name, path in zip(names, taken, strict=True):
        if path in {one.resolve() for one in inputs}:
            raise InputError(f"{name}: is what is read, and would be overwritten; give another name.")
    if export.plot is not None:
        from ballscrew.report.canvas import check_target

        check_target(export.plot)


def _export(test: PlannedTest, export: Export, rate: float, tell: Callable[..., Any]) -> None:
    if export.gcode is not None:
        from ballscrew.fcft.gcode import write_gcode

        written, dry_run = write_gcode(
            test.plan,
            test.sheet,
            export.gcode,
            dialect=export.dialect,  # type: ignore[arg-type]  # it checks
            axis_word=export.axis_word,
        )
        tell(f"G-code: {escape(str(written))}; first run {escape(str(dry_run))}, the same way slowly.")
    if export.csv is not None:
        from ballscrew.fcft.set_points_csv import write_set_points

        write_set_points(test.plan, test.sheet, export.csv, rate=rate)
        tell(f"Set-points: {escape(str(export.csv))}")
    if export.levels is not None:
        _write_levels(test, export.levels, tell)


def _write_levels(test: PlannedTest, path: Path, tell: Callable[..., Any]) -> None:
    from ballscrew.base.files import write_texts
    from ballscrew.fcft.planfile import plan_toml

    write_texts([(path, [plan_toml(replace(test.plan, motions=test.levels.motions))])])
    tell(f"Plan with two acceleration levels: {escape(str(path))}")


def _tell_nothing(*_: object) -> None:
    """With --json, standard output holds the document alone."""


def _print(test: PlannedTest) -> None:
    out, plan = console(), test.plan
    stops, loads = count(len(plan.positions), "stop"), count(len(plan.masses), "load")
    out.print(
        f"[bold]{escape(test.sheet.name)}[/], {stops} from {1e3 * plan.positions[0]:g} to "
        f"{1e3 * plan.positions[-1]:g} mm, {loads}, {count(len(plan.motions), 'motion')}: "
        f"[bold]{count(len(test.cells), 'cell')}[/]"
    )
    warm = f", {plan.warm_up} of them to warm up" if plan.warm_up else ""
    out.print(f"{count(test.trip_count, 'round trip')}{warm}: [bold]{_time(test.duration_s)}[/]", end="")
    several = len(plan.masses) > 1
    out.print(f" with each load, {_time(test.duration_s * len(plan.masses))} in all" if several else "")
    for index, one in enumerate(test.motions):
        motion = one.motion
        out.print(
            f"Motion {index}: {1e3 * motion.speed:.4g} mm/s, {motion.peak_acceleration:.3g} m/s², "
            f"{motion.jerk:.4g} m/s³ (jerk time {1e3 * motion.jerk_time:.3g} ms, torque nulls at "
            f"{_list(one.nulls)} Hz), dwell {1e3 * motion.dwell:.4g} ms; one trip {one.trip_s:.2f} s, "
            f"torque up to {one.torque:.3g} N m"
        )
    out.print(_table(test))
    out.print("Torque at it: of one blow at that frequency, 1 as a jerk without duration, 0 in a null.")
    _print_levels(test)
    for sentence in (*test.broken, *test.warnings):
        out.print("[bold yellow]Warning:[/]", end=" ")
        out.print(sentence, markup=False)
    if not (test.broken or test.warnings):
        out.print("[green]Nothing speaks against it.[/]")
    for sentence in test.notes:
        out.print(f"  • {sentence}", markup=False)


def _table(test: PlannedTest) -> Table:
    table = Table(title="Expected of each stop, rotor free", title_justify="left")
    for heading in (
        "load\nkg",
        "motion",
        "position\nmm",
        "conditions",
        "frequency\nHz",
        "standard\nunc., Hz",
        "torque\nat it",
        "nut load\nN",
        "part of\npreload",
        "shift\nby it, Hz",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    rows = _rows(test.cells)
    for cells in _shortened(rows):
        if cells is None:
            table.add_row(*["…"] * 10)
            continue
        one = max(cells, key=lambda cell: cell.nut_load_ratio)
        table.add_row(
            f"{one.mass:g}",
            str(one.motion),
            f"{1e3 * one.position:.1f}",
            " ".join(cell.condition for cell in cells),
            f"{one.frequency:.1f}",
            f"{one.standard_uncertainty:.1f}",
            f"{one.excitation:.2f}",
            f"{abs(one.nut_load):.0f}",
            f"{one.nut_load_ratio:.2f}",
            f"{one.nut_load_shift:.2f}",
        )
    return table


def _rows(cells: tuple[ExpectedCell, ...]) -> list[list[ExpectedCell]]:
    """The cells of one stop, load and motion together."""
    rows: dict[tuple[float, int, float], list[ExpectedCell]] = {}
    for cell in cells:
        rows.setdefault((cell.mass, cell.motion, cell.position), []).append(cell)
    return list(rows.values())


def _shortened(rows: list[list[ExpectedCell]]) -> list[list[ExpectedCell] | None]:
    """All rows, or the first and last ones of a long plan; the JSON has all."""
    if len(rows) <= _MOST_ROWS:
        return list(rows)
    half = _MOST_ROWS // 2
    return [*rows[:half], None, *rows[-half:]]


def _print_levels(test: PlannedTest) -> None:
    out, levels = console(), test.levels
    if not levels.motions:
        out.print(f"Two acceleration levels cannot be offered: {levels.reason}.", markup=False)
        return
    low, high = levels.motions
    out.print(
        f"Two acceleration levels tie the preload to newtons: {low.acceleration:.3g} m/s² to "
        f"{1e3 * low.speed:.3g} mm/s (nut load 0.5 of the preload in PA and NA) and "
        f"{high.acceleration:.3g} m/s² to {1e3 * high.speed:.3g} mm/s (1.5), {levels.shift:.2f} Hz apart at "
        "the first stop; --levels FILE writes that plan.",
        markup=False,
    )


def _list(nulls: tuple[float, ...]) -> str:
    few = ", ".join(f"{null:.4g}" for null in nulls[:4])
    return few if len(nulls) <= 4 else f"{few}, …"


def _time(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.1f} s"
    minutes = seconds / 60
    return f"{minutes:.1f} min" if minutes < 120 else f"{minutes / 60:.1f} h"
