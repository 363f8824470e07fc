"""``ballscrew demo``: a screw wears out, is measured all along, and a report says what was to be seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import mean, stdev

import numpy as np

from ballscrew.axis.hertz import preload_deflection
from ballscrew.axis.model import kappa
from ballscrew.axis.wear import backlash_after_wear, preload_after_wear
from ballscrew.base.errors import DONE, InputError
from ballscrew.cli.experiment import measured_runs
from ballscrew.cli.output import console, print_json, progress_bar
from ballscrew.modal.run import Run
from ballscrew.report.life_figure import LifePoint, draw_life
from ballscrew.report.page import html_page
from ballscrew.report.run_figure import draw_run
from ballscrew.report.style import check_drawing
from ballscrew.testbed.example import AXIS, LOAD, PLAN, example_rig
from ballscrew.testbed.experiments import PlannedRun

__all__ = ["alarm_day", "demo", "demo_command", "life_points"]

_DAYS = (*range(0, 25, 3), 30, *range(36, 97, 12))
_BASELINE = 5  # tests before the wear begins
_FIRST = 12.0  # day on which it does
_GONE = 92.0  # day on which nothing is left of the preload: 80 days later
_SURE = 4.0  # times the baseline's scatter
_REPORTED = 60  # day whose run is drawn beside the first


@dataclass(frozen=True, slots=True)
class Test:
    """A run of the demonstration, with the truth of its day."""

    day: float
    run: Run
    preload: float
    backlash: float


def demo_command(out: Path, *, as_json: bool) -> int:
    """Run the demonstration, say what it found, and return the exit status."""
    check_drawing()
    points, alarm = demo(out)
    first = next(point.day for point in points if point.backlash_m > 0)
    if as_json:
        print_json(
            {"schema": 1, "alarm_day": alarm, "backlash_day": first, "tests": [asdict(p) for p in points]}
        )
    else:
        said = console()
        said.print(_message(points, alarm))
        said.print(f"Look at {(out / 'report.html').resolve()}", markup=False, soft_wrap=True)
    return DONE


def demo(out: Path) -> tuple[tuple[LifePoint, ...], float | None]:
    """Wear out the example axis, test it every third day, and leave a report in a folder.

    Parameters
    ----------
    out : path-like
        Folder of the report; made where it is not there.

    Returns
    -------
    points : tuple of LifePoint
        Every test.
    alarm : float or None
        Day on which the change was sure.

    Raises
    ------
    InputError
        If the folder cannot be written to.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        with progress_bar("wearing an axis out") as report:
            runs = measured_runs([_planned(float(day)) for day in _DAYS], out, report)
            tests = [
                Test(
                    one.planned.day,
                    one.run,
                    one.planned.rig.machine.preload,
                    one.planned.rig.machine.backlash,
                )
                for one in runs
            ]
            points = life_points(tests)
            alarm = alarm_day(points)
            _report(out, tests, points, alarm)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror or error}).") from None
    return points, alarm


def life_points(tests: Sequence[Test]) -> tuple[LifePoint, ...]:
    """Mean change of all cells against the first tests, with the uncertainty that their scatter tells."""
    base = [_good(test.run) for test in tests[:_BASELINE]]
    level = {cell: mean(one[cell] for one in base) for cell in base[0] if all(cell in one for one in base)}
    shifts = [_shift(_good(test.run), level) for test in tests]
    known = [shift for shift, _ in shifts[:_BASELINE] if shift is not None]
    scatter = stdev(known) if len(known) > 1 else float("nan")
    return tuple(
        LifePoint(
            day=test.day,
            shift_Hz=shift,
            standard_uncertainty_Hz=scatter,
            cells=count,
            preload_ratio=test.preload / AXIS.screw.dynamic_load_rating,
            backlash_m=test.backlash,
        )
        for test, (shift, count) in zip(tests, shifts, strict=True)
    )


def alarm_day(points: Sequence[LifePoint]) -> float | None:
    """Day of the second test in a row whose change is four times the baseline's scatter."""
    below = [
        point.shift_Hz is not None and point.shift_Hz < -_SURE * point.standard_uncertainty_Hz
        for point in points
    ]
    for index in range(_BASELINE, len(points)):
        if below[index] and below[index - 1]:
            return points[index].day
    return None


def _planned(day: float) -> PlannedRun:
    """One test: a load that does not change wears the flanks evenly with the travel."""
    nominal, nut = AXIS.nominal_preload, kappa(AXIS)
    depth = float(preload_deflection(nominal, nut)) * max(0.0, day - _FIRST) / (_GONE - _FIRST)
    preload = float(preload_after_wear(depth, nominal, nut))
    backlash = float(backlash_after_wear(depth, nominal, nut))
    rig = example_rig(preload, backlash)
    return PlannedRun(f"day-{round(day):02d}", rig, PLAN, LOAD, day, seed=round(day))


def _good(run: Run) -> dict[tuple[float, str], float]:
    return {
        (cell.position_m, cell.condition): cell.frequency_Hz
        for cell in run.cells
        if cell.verdict == "good" and cell.frequency_Hz is not None
    }


def _shift(
    cells: dict[tuple[float, str], float], level: dict[tuple[float, str], float]
) -> tuple[float | None, int]:
    common = [cell for cell in cells if cell in level]
    if not common or len(common) < len(level) / 2:
        return None, len(common)
    return float(np.mean([cells[cell] - level[cell] for cell in common])), len(common)


def _message(points: Sequence[LifePoint], alarm: float | None) -> str:
    first = next(point.day for point in points if point.backlash_m > 0)
    if alarm is None:
        return f"The loss of preload was not seen before day {first:g}, when backlash begins."
    at = next(point for point in points if point.day == alarm)
    lost = 100 - 100 * at.preload_ratio / points[0].preload_ratio
    return (
        f"Sure on day {alarm:g}: the natural frequency has fallen by {-(at.shift_Hz or 0):.1f} Hz, and "
        f"{lost:.0f} % of the preload is gone. Backlash, which anybody can see, begins on day {first:g}: "
        f"{first - alarm:g} days later."
    )


def _report(out: Path, tests: Sequence[Test], points: Sequence[LifePoint], alarm: float | None) -> None:
    draw_life(points, out / "life.png", alarm_day=alarm)
    draw_run(tests[0].run, out / "new.png")
    worn = next(test for test in tests if test.day == _REPORTED)
    draw_run(worn.run, out / "worn.png")
    screw = AXIS.screw
    simulated = (
        f"Simulated: an axis with a {1e3 * screw.nominal_diameter:g} × {1e3 * screw.lead:g} mm screw and "
        f"{LOAD:g} kg on its table, tested every third day, later less often, with {PLAN.repetitions} round "
        f"trips. From day {_FIRST:g} on it wears, and on day {_GONE:g} nothing is left of its preload. Each "
        "frequency comes from the recordings alone, through ballscrew analyze."
    )
    sure = (
        f"Sure means: {_SURE:g} times the scatter of the first {_BASELINE} tests, twice in a row. It is a "
        "plain rule, whose false alarms nobody has counted yet. The ± is that scatter alone. Not told: "
        "fewer than half of the cells are good, for the test's own load unloads a nut with so little preload."
    )
    page = html_page(
        "A ball screw loses its preload",
        [_message(points, alarm), simulated, sure],
        [
            ("life.png", "Measured change of the natural frequency above the true preload and backlash"),
            ("new.png", "The first run: every cell's frequency response, and the frequency along the axis"),
            ("worn.png", f"The same on day {_REPORTED}"),
        ],
        ["day", "change, Hz", "± 95 % of scatter", "cells", "preload, % of Ca", "backlash, µm"],
        [
            [
                f"{point.day:g}",
                "not told" if point.shift_Hz is None else f"{point.shift_Hz:+.2f}",
                "" if point.shift_Hz is None else f"± {1.96 * point.standard_uncertainty_Hz:.2f}",
                str(point.cells),
                f"{100 * point.preload_ratio:.2f}",
                f"{1e6 * point.backlash_m:.2f}",
            ]
            for point in points
        ],
    )
    (out / "report.html").write_text(page, encoding="utf-8", newline="\n")
