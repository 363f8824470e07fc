"""The demonstration: a screw wears out and is tested again and again; a report shows the results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from ballscrew.axis.hertz import preload_deflection
from ballscrew.axis.model import kappa
from ballscrew.axis.wear import backlash_after_wear, preload_after_wear
from ballscrew.base.errors import InputError
from ballscrew.base.files import Progress, ignore_progress, write_text
from ballscrew.base.jsonfile import SCHEMA, write_json
from ballscrew.base.quantity import Quantity
from ballscrew.calibration.calibrated_axis import CalibratedAxis, Doubt
from ballscrew.calibration.calibration import calibrate
from ballscrew.calibration.modelfile import write_model
from ballscrew.prognosis.failure import HALF
from ballscrew.prognosis.monitor import Monitored, monitor
from ballscrew.report.canvas import check_drawing, save_figure
from ballscrew.report.life_figure import LifePoint, draw_life
from ballscrew.report.monitor_figure import draw_monitor
from ballscrew.report.monitor_words import advice, headline
from ballscrew.report.page import html_page, state_words
from ballscrew.report.run_figure import draw_run
from ballscrew.reproduction.experiment import Measured, measured_runs
from ballscrew.reproduction.preload_claims import forecast, last_lines
from ballscrew.testbed.example import AXIS, LOAD, PLAN, example_rig
from ballscrew.testbed.experiments import PlannedRun

_DAYS = (*range(0, 25, 3), 30, *range(36, 97, 12))
_CALIBRATION_RUNS = 3  # tests from which the model of the axis is fitted, with the data sheet
_WEAR_BEGINS = 12.0  # day
_PRELOAD_LOST = 92.0  # day: 80 days later, as in the paper
_WORN_DAY = 60  # day whose run is drawn beside the first


@dataclass(frozen=True, eq=False)
class Demonstration:
    """Estimates beside the truth.

    Parameters
    ----------
    points : tuple of LifePoint
        Every test.
    at_alarm : Monitored
        Result on the day of the alarm; at the end if there was none.
    alarm_day, backlash_day : float or None
        Day of the first test with each.
    doubts : tuple of Doubt
        Reasons why the calibration is suspect.
    ending : tuple of str
        What ``monitor`` prints first on the days of the last tests.
    """

    points: tuple[LifePoint, ...]
    at_alarm: Monitored
    alarm_day: float | None
    backlash_day: float | None
    doubts: tuple[Doubt, ...] = ()
    ending: tuple[str, ...] = ()

    def to_json(self) -> dict[str, object]:
        """The document that ``demo --json`` prints."""
        prognosis = self.at_alarm.prognosis
        rul_days = None
        if prognosis is not None:
            rul_days = {f"{p:g}": days for p, days in prognosis.rul_days.items()}
        tests = []
        for point in self.points:
            estimate = None if point.estimate is None else point.estimate.to_json()
            tests.append(asdict(point) | {"estimate": estimate})
        return {
            "schema": SCHEMA,
            "alarm_day": self.alarm_day,
            "backlash_day": self.backlash_day,
            "half_day": half_day(),
            "calibration": {
                "verdict": "suspect" if self.doubts else "good",
                "reasons": [asdict(doubt) for doubt in self.doubts],
            },
            "on_the_alarm_day": {"rul_days": rul_days},
            "at_the_end": list(self.ending),
            "tests": tests,
        }


def demo(out: str | Path, *, progress: Progress = ignore_progress) -> Demonstration:
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
        Every test beside the truth, and the result on the day of the alarm.

    Raises
    ------
    InputError
        If the folder cannot be written to.
    """
    check_drawing()
    out = Path(out)
    planned = [_planned_test(float(day)) for day in _DAYS]
    try:
        out.mkdir(parents=True, exist_ok=True)
        tests = list(measured_runs(planned, out, progress))
        model = calibrate([test.run for test in tests[:_CALIBRATION_RUNS]], AXIS)
        found = monitor_tests(tests, model)
        _write_report(out, tests, model, found)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror or error}).") from None
    return found


def monitor_tests(tests: Sequence[Measured], model: CalibratedAxis) -> Demonstration:
    """Monitor the axis to the end, and once more up to the day of the alarm.

    Parameters
    ----------
    tests : sequence of Measured
        In the order of time.
    model : CalibratedAxis
        Model of the axis.

    Returns
    -------
    Demonstration
        Estimates beside the truth.
    """
    runs = [test.run for test in tests]
    life = monitor(runs, model)
    points = []
    for test, state in zip(tests, life.state.runs, strict=True):
        machine = test.planned.rig.machine
        point = LifePoint(
            day=test.planned.day,
            state=state.state,
            estimate=state.stiffness,
            preload_ratio=machine.preload / AXIS.nominal_preload,
            backlash_m=machine.backlash,
            below=state.preload_below,
        )
        points.append(point)
    alarm_day = next((point.day for point in points if point.state == "alarm"), None)
    backlash_day = next((point.day for point in points if point.backlash_m > 0), None)
    at_alarm = life
    if alarm_day is not None:
        at_alarm = monitor([test.run for test in tests if test.planned.day <= alarm_day], model)
    ending = tuple(last_lines(tests, model))
    return Demonstration(tuple(points), at_alarm, alarm_day, backlash_day, model.reasons, ending)


def half_day() -> float:
    """Day on which half of the preload is truly lost: wear is even, and preload ∝ (1 − wear)^(3/2)."""
    remaining_depth: float = HALF ** (2 / 3)
    return _WEAR_BEGINS + (_PRELOAD_LOST - _WEAR_BEGINS) * (1 - remaining_depth)


def describe(found: Demonstration) -> list[str]:
    """Sentences on what the demonstration showed."""
    backlash = ""
    if found.backlash_day is not None:
        backlash = f"; the first test with backlash is on day {found.backlash_day:g}"
    if found.alarm_day is None:
        return [f"No alarm was raised{backlash}.", *found.ending]
    alarm = next(point for point in found.points if point.day == found.alarm_day)
    assessed = found.at_alarm.state.assessed
    estimate = None if assessed is None else assessed.stiffness
    result = (
        f"Alarm on day {alarm.day:g}: {_percent(estimate)} of the preload remains, true value "
        f"{100 * alarm.preload_ratio:.0f} %. Wear began on day {_WEAR_BEGINS:g}{backlash}."
    )
    prognosis = found.at_alarm.prognosis
    if prognosis is None or prognosis.rul_days[0.5] is None:
        return [result, *found.ending]
    remaining = f"{forecast(prognosis)}; true value {half_day() - alarm.day:.0f}"
    return [result, f"Forecast on that day: {remaining}.", *found.ending]


def _planned_test(day: float) -> PlannedRun:
    """One test: a constant load wears the flanks in proportion to the travel."""
    nominal, nut = AXIS.nominal_preload, kappa(AXIS)
    worn_part = max(0.0, day - _WEAR_BEGINS) / (_PRELOAD_LOST - _WEAR_BEGINS)
    depth = float(preload_deflection(nominal, nut)) * worn_part
    preload = float(preload_after_wear(depth, nominal, nut))
    backlash = float(backlash_after_wear(depth, nominal, nut))
    rig = example_rig(preload, backlash)
    return PlannedRun(f"day-{round(day):02d}", rig, PLAN, LOAD, day, seed=round(day))


def _percent(ratio: Quantity | None) -> str:
    if ratio is None:
        return "an unknown part"
    low, high = ratio.interval
    return f"{100 * ratio.value:.0f} % ({100 * low:.0f} to {100 * high:.0f} %)"


def _write_report(out: Path, tests: Sequence[Measured], model: CalibratedAxis, found: Demonstration) -> None:
    write_model(model, out / "model.json")
    write_text(out / "monitor.json", write_json(found.at_alarm.to_json()) + "\n")
    title = f"{AXIS.name}, simulated: tests from {tests[0].planned.measured_at[:10]} on"
    save_figure(draw_life(found.points, alarm_day=found.alarm_day, title=title), out / "life.png")
    save_figure(draw_monitor(found.at_alarm), out / "monitor.png")
    save_figure(draw_run(tests[0].run), out / "new.png")
    worn = next(test for test in tests if test.planned.day == _WORN_DAY)
    save_figure(draw_run(worn.run), out / "worn.png")
    write_text(out / "report.html", _report_page(out, found))


def _report_page(out: Path, found: Demonstration) -> str:
    screw = AXIS.screw
    simulated = (
        f"Simulated: an axis with a {1e3 * screw.nominal_diameter:g} × {1e3 * screw.lead:g} mm screw and "
        f"{LOAD:g} kg on its table, tested every third day, later less often, with {PLAN.repetitions} round "
        f"trips. It wears from day {_WEAR_BEGINS:g} on; on day {_PRELOAD_LOST:g} no preload remains. All "
        "frequencies are estimated from the recordings alone, by ballscrew analyze; the model comes from the "
        f"first {_CALIBRATION_RUNS} tests and the data sheet, by ballscrew calibrate; the rest is the output "
        "of ballscrew monitor."
    )
    state = f"On the day of the alarm: {headline(found.at_alarm)}. {' '.join(advice(found.at_alarm))}"
    command = (
        f"To repeat it: ballscrew monitor {out.name}/runs/*.json --model {out.name}/model.json. A test "
        "without an estimate is suspect; where its load unloads the nut, the preload has a limit alone."
    )
    conclusion, *sentences = describe(found)
    return html_page(
        "A ball screw loses its preload",
        [*sentences, state, simulated, command],
        [
            ("monitor.png", "Result on the day of the alarm, with the forecast"),
            ("life.png", "Estimated and true preload, and the backlash that follows"),
            ("new.png", "The first run: frequency response of every cell, and frequency along the axis"),
            ("worn.png", f"The same on day {_WORN_DAY}"),
        ],
        ["day", "state", "estimated preload, %", "95 % interval", "true, %", "backlash, µm"],
        [_table_row(point) for point in found.points],
        conclusion=conclusion,
        lamp="normal" if found.alarm_day is None else "alarm",
    )


def _table_row(point: LifePoint) -> list[str]:
    estimate, interval = "no estimate", ""
    if point.below is not None:
        estimate = f"nut below {100 * point.below:.0f}"
    if point.estimate is not None:
        low, high = point.estimate.interval
        estimate = f"{100 * point.estimate.value:.1f}"
        interval = f"{100 * low:.0f} to {100 * high:.0f}"
    return [
        f"{point.day:g}",
        state_words(point.state),
        estimate,
        interval,
        f"{100 * point.preload_ratio:.1f}",
        f"{1e6 * point.backlash_m:.2f}",
    ]
