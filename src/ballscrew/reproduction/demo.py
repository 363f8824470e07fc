"""``ballscrew demo``: a screw wears out, is measured all along, and a report says what was to be seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from ballscrew.axis.hertz import preload_deflection
from ballscrew.axis.model import kappa
from ballscrew.axis.wear import backlash_after_wear, preload_after_wear
from ballscrew.base.errors import InputError
from ballscrew.base.files import Progress, ignore_progress, write_text
from ballscrew.base.jsonfile import write_json
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.calibration import calibrate
from ballscrew.calibration.modelfile import write_model
from ballscrew.prognosis.failure import HALF
from ballscrew.prognosis.monitor import Monitored, monitor
from ballscrew.report.canvas import save_figure
from ballscrew.report.life_figure import LifePoint, draw_life
from ballscrew.report.monitor_figure import draw_monitor
from ballscrew.report.monitor_words import advice, headline
from ballscrew.report.page import html_page
from ballscrew.report.run_figure import draw_run
from ballscrew.report.style import check_drawing
from ballscrew.reproduction.experiment import Measured, measured_runs
from ballscrew.testbed.example import AXIS, LOAD, PLAN, example_rig
from ballscrew.testbed.experiments import PlannedRun

__all__ = ["Demonstration", "demo", "describe"]

_DAYS = (*range(0, 25, 3), 30, *range(36, 97, 12))
_CALIBRATED = 3  # tests that the model of the axis is made of, with the data sheet
_FIRST = 12.0  # day on which wear begins
_GONE = 92.0  # day on which nothing is left of the preload: 80 days later
_REPORTED = 60  # day whose run is drawn beside the first


@dataclass(frozen=True, eq=False)
class Demonstration:
    """What was told, and what was true.

    Parameters
    ----------
    points : tuple of LifePoint
        Every test.
    then : Monitored
        As it was known on the day of the alarm; at the end where there was none.
    alarm_day, backlash_day : float or None
        Of the first test with each.
    """

    points: tuple[LifePoint, ...]
    then: Monitored
    alarm_day: float | None
    backlash_day: float | None

    def to_json(self) -> dict[str, object]:
        """What ``demo --json`` prints."""
        told = self.then.prognosis
        return {
            "schema": 1,
            "alarm_day": self.alarm_day,
            "backlash_day": self.backlash_day,
            "half_day": half_day(),
            "on_the_alarm_day": {
                "rul_days": None if told is None else {f"{p:g}": days for p, days in told.rul_days.items()}
            },
            "tests": [
                asdict(point) | {"told": None if point.told is None else point.told.to_json()}
                for point in self.points
            ],
        }


def demo(out: Path, *, progress: Progress = ignore_progress) -> Demonstration:
    """Wear out the example axis, test it every third day, and leave a report in a folder.

    Parameters
    ----------
    out : path-like
        Folder of the report; made if absent.
    progress : callable, optional
        Called with how many recordings are done, how many there are, and the last one's name.

    Returns
    -------
    Demonstration
        Every test beside the truth, and what was known when the alarm came.

    Raises
    ------
    InputError
        If the folder cannot be written to.
    """
    check_drawing()
    try:
        out.mkdir(parents=True, exist_ok=True)
        tests = list(measured_runs([_planned(float(day)) for day in _DAYS], out, progress))
        model = calibrate([test.run for test in tests[:_CALIBRATED]], AXIS)
        found = judged(tests, model)
        _report(out, tests, model, found)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror or error}).") from None
    return found


def judged(tests: Sequence[Measured], model: CalibratedAxis) -> Demonstration:
    """Watch the axis to the end, and once more with what was known when the alarm came.

    Parameters
    ----------
    tests : sequence of Measured
        In the order of time.
    model : CalibratedAxis
        Of the axis.

    Returns
    -------
    Demonstration
        Told beside true.
    """
    runs = [one.run for one in tests]
    whole = monitor(runs, model)
    first = next((i for i, one in enumerate(whole.state.runs) if one.state == "alarm"), None)
    then = whole if first is None else monitor(runs[: first + 1], model)
    points = tuple(
        LifePoint(
            day=one.planned.day,
            state=state.state,
            told=state.relative,
            preload_ratio=one.planned.rig.machine.preload / AXIS.nominal_preload,
            backlash_m=one.planned.rig.machine.backlash,
        )
        for one, state in zip(tests, whole.state.runs, strict=True)
    )
    return Demonstration(
        points,
        then,
        None if first is None else points[first].day,
        next((point.day for point in points if point.backlash_m > 0), None),
    )


def half_day() -> float:
    """Day on which half of the preload is gone, in truth."""
    left: float = HALF ** (2 / 3)
    return _FIRST + (_GONE - _FIRST) * (1 - left)


def _planned(day: float) -> PlannedRun:
    """One test: a load that does not change wears the flanks evenly with the travel."""
    nominal, nut = AXIS.nominal_preload, kappa(AXIS)
    depth = float(preload_deflection(nominal, nut)) * max(0.0, day - _FIRST) / (_GONE - _FIRST)
    preload = float(preload_after_wear(depth, nominal, nut))
    backlash = float(backlash_after_wear(depth, nominal, nut))
    rig = example_rig(preload, backlash)
    return PlannedRun(f"day-{round(day):02d}", rig, PLAN, LOAD, day, seed=round(day))


def describe(found: Demonstration) -> list[str]:
    """What the demonstration showed, a sentence a line."""
    ends = (
        ""
        if found.backlash_day is None
        else f"; the first test with backlash is on day {found.backlash_day:g}"
    )
    if found.alarm_day is None:
        return [f"No alarm was given{ends}."]
    at = next(point for point in found.points if point.day == found.alarm_day)
    first = (
        f"Alarm on day {at.day:g}: {_share(at.told)} of the preload is left, truly "
        f"{100 * at.preload_ratio:.0f} %. Wear began on day {_FIRST:g}{ends}."
    )
    said = [first]
    told = found.then.prognosis
    middle = None if told is None else told.rul_days[0.5]
    if told is not None and middle is not None:
        low, high = told.rul_days[0.05], told.rul_days[0.95]
        said.append(
            f"Half of the preload was foretold for {middle:.0f} days later ({low or 0:.0f} to "
            f"{'an open number' if high is None else f'{high:.0f}'}, 90 %); truly it took "
            f"{half_day() - at.day:.0f}."
        )
    return said


def _share(told: Quantity | None) -> str:
    if told is None:
        return "an unknown part"
    low, high = told.interval
    return f"{100 * told.value:.0f} % ({100 * low:.0f} to {100 * high:.0f} %)"


def _report(out: Path, tests: Sequence[Measured], model: CalibratedAxis, found: Demonstration) -> None:
    write_model(model, out / "model.json")
    document = write_json(found.then.to_json()) + "\n"
    write_text(out / "monitor.json", document)
    draw_life(found.points, out / "life.png", alarm_day=found.alarm_day)
    save_figure(draw_monitor(found.then), out / "monitor.png")
    draw_run(tests[0].run, out / "new.png")
    worn = next(test for test in tests if test.planned.day == _REPORTED)
    draw_run(worn.run, out / "worn.png")
    screw = AXIS.screw
    simulated = (
        f"Simulated: an axis with a {1e3 * screw.nominal_diameter:g} × {1e3 * screw.lead:g} mm screw and "
        f"{LOAD:g} kg on its table, tested every third day, later less often, with {PLAN.repetitions} round "
        f"trips. From day {_FIRST:g} on it wears, and on day {_GONE:g} nothing is left of its preload. Each "
        "frequency comes from the recordings alone, through ballscrew analyze; the model from the first "
        f"{_CALIBRATED} tests and the data sheet, through ballscrew calibrate; the rest is ballscrew monitor."
    )
    lamp = f"What it said on the day of the alarm: {headline(found.then)}. {' '.join(advice(found.then))}"
    again = (
        f"The same again: ballscrew monitor {out.name}/runs/*.json --model {out.name}/model.json. Not told: "
        "suspect, or the test's own load unloads a nut with so little preload."
    )
    page = html_page(
        "A ball screw loses its preload",
        [*describe(found), lamp, simulated, again],
        [
            ("monitor.png", "What was known on the day of the alarm, and the way on as it was foretold"),
            ("life.png", "Told preload beside the true one, and the backlash that comes at last"),
            ("new.png", "The first run: every cell's frequency response, and the frequency along the axis"),
            ("worn.png", f"The same on day {_REPORTED}"),
        ],
        ["day", "state", "preload told, %", "95 %", "true, %", "backlash, µm"],
        [
            [
                f"{point.day:g}",
                point.state,
                "not told" if point.told is None else f"{100 * point.told.value:.1f}",
                ""
                if point.told is None
                else f"{100 * point.told.interval[0]:.0f} to {100 * point.told.interval[1]:.0f}",
                f"{100 * point.preload_ratio:.1f}",
                f"{1e6 * point.backlash_m:.2f}",
            ]
            for point in found.points
        ],
    )
    write_text(out / "report.html", page)
