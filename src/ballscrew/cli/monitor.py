"""``ballscrew monitor``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from ballscrew.base.errors import InputError
from ballscrew.base.units import parse
from ballscrew.calibration.modelfile import read_model
from ballscrew.cli.output import console, count, print_json, say_quality
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import read_events
from ballscrew.monitoring.state import HealthState, RunState
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.monitor import Monitored, monitor
from ballscrew.report.monitor_words import advice, headline

__all__ = ["STATE_STYLE", "Asked", "monitor_command", "say_monitored"]

STATE_STYLE = {
    "learning": "cyan",
    "normal": "green",
    "watch": "yellow",
    "alarm": "bold red",
    "suspect": "bright_black",
}
_SHOWN = 30  # newest runs in the table
_ASIDE = 5  # newest runs that do not count, with their reasons
_CAUSE = 0.05  # probability from which on a cause is listed


@dataclass(frozen=True, slots=True)
class Asked:
    """What was asked for, as it was typed."""

    false_alarms: float
    repeats: float
    baseline_runs: int
    end: float
    largest_load: str | None
    backlash: str | None
    duty: str | None

    def quantity(self, name: str, unit: str) -> float | None:
        """One of the quantities, in SI."""
        text = getattr(self, name)
        if text is None:
            return None
        option = "--" + name.replace("_", "-")
        if not any(letter.isalpha() for letter in text):
            raise InputError(f"{option} is {text!r}; say its unit, such as '10 {unit}'.")
        try:
            value = parse(text, unit)
        except InputError as error:
            raise InputError(f"{option} is {text!r}: {error}.") from None
        if not value > 0:
            raise InputError(f"{option} is {text!r}; it must be more than 0.")
        return value


def monitor_command(
    paths: Sequence[Path],
    *,
    model: Path,
    events: Path | None,
    asked: Asked,
    as_json: bool,
    plot: Path | None,
) -> int:
    """Watch an axis, print and draw it, and return the exit status."""
    if plot is not None:
        from ballscrew.report.canvas import check_target

        check_target(plot)
    settings = MonitorSettings(
        false_alarms_per_year=asked.false_alarms,
        repeats_per_year=asked.repeats,
        baseline_runs=asked.baseline_runs,
    )
    failure = Failure(preload_ratio=asked.end, backlash=asked.quantity("backlash", "m"))
    load, duty = asked.quantity("largest_load", "N"), asked.quantity("duty", "m")
    calibrated = read_model(model)
    runs = [Run.read(path) for path in paths]
    told = monitor(
        runs,
        calibrated,
        events=() if events is None else read_events(events),
        settings=settings,
        failure=failure,
        largest_load=load,
        duty=duty,
    )
    if plot is not None:
        from ballscrew.report.canvas import save_figure
        from ballscrew.report.monitor_figure import draw_monitor

        save_figure(draw_monitor(told), plot)
    if as_json:
        print_json(told.to_json())
    else:
        say_monitored(told)
    return _status(told.state, runs)


def _status(state: HealthState, runs: Sequence[Run]) -> int:
    """1 where the newest run is a bad measurement: its axis is not watched any more."""
    newest = state.runs[-1].reading
    quality = next(run.quality for run in runs if run.id == newest.run)
    return say_quality(quality)


def say_monitored(told: Monitored) -> None:
    """Print the history, the state, the stage, the causes and the remaining life."""
    out, state = console(), told.state
    out.print(_table(state))
    out.print(f"[{STATE_STYLE[state.state]}]{escape(headline(told))}[/]", soft_wrap=True)
    for line in (*advice(told), *state.notes, *_set_aside(state)):
        out.print(f"  → {line}", markup=False, soft_wrap=True)
    for epoch in state.epochs[:-1]:
        if epoch.alarm_at is not None:
            ended = state.epochs[epoch.number + 1].cause
            out.print(f"An earlier epoch alarmed on {epoch.alarm_at[:10]}; it ended with: {ended}.")
    if state.stage is not None:
        out.print(
            f"Stage I (preload is being lost) {state.stage.I:.2f}, stage II (it is gone) "
            f"{state.stage.II:.2f}; from {state.stage.how}.",
            markup=False, soft_wrap=True,
        )  # fmt: skip
    for cause in state.causes:
        if cause.probability >= _CAUSE:
            out.print(
                f"Cause: {cause.cause} {cause.probability:.2f}: {cause.evidence}",
                markup=False,
                soft_wrap=True,
            )
    prognosis = told.prognosis
    if prognosis is None:
        stiffer = "while the newest runs are stiffer than the baseline, which wear does not do"
        why = stiffer if told.state.stiffer else "before there are three good runs"
        out.print(f"Remaining life: not told {why}.")
        return
    for index, line in enumerate(prognosis.statement):
        out.print(f"{'Remaining life. ' if index == 0 else '  '}{line}", markup=False, soft_wrap=True)
    out.print(f"  Confidence {prognosis.confidence}.", markup=False, soft_wrap=True)
    for line in prognosis.assumptions:
        out.print(f"  Assumed: {line}", markup=False, soft_wrap=True)
    for line in prognosis.would_change:
        out.print(f"  Would change it: {line}", markup=False, soft_wrap=True)


def _set_aside(state: HealthState) -> list[str]:
    """Why the newest runs that do not count do not."""
    aside = [one for one in state.runs if one.state == "suspect"][-_ASIDE:]
    return [
        f"Set aside: {str(one.reading.measured_at)[:16]}: {'; '.join(one.reading.reasons) or 'suspect'}."
        for one in aside
    ]


def _table(state: HealthState) -> Table:
    shown = state.runs[-_SHOWN:]
    words = count(len(state.runs), "run")
    table = Table(
        title=words if len(shown) == len(state.runs) else f"the newest {len(shown)} of {words}",
        title_justify="left",
    )
    table.add_column("measured at")
    for heading in ("P/P₀", "95 %", "ramp / limit", "odds / limit"):
        table.add_column(heading, justify="right")
    table.add_column("state")
    many = len(state.epochs) > 1
    if many:
        table.add_column("epoch", justify="right")
    for one in shown:
        row = [
            escape(str(one.reading.measured_at)),
            "–" if one.relative is None else f"{one.relative.value:.3f}",
            "–" if one.relative is None else "{:.3f} to {:.3f}".format(*one.relative.interval),
            _over(one, "ramp"),
            _over(one, "odds"),
            f"[{STATE_STYLE[one.state]}]{one.state}[/]",
        ]
        table.add_row(*row, *([str(one.reading.epoch + 1)] if many else []))
    return table


def _over(one: RunState, name: str) -> str:
    value, limit = getattr(one, name), getattr(one, f"{name}_limit")
    return f"{value:.1f} / {limit:.1f}" if math.isfinite(value) and math.isfinite(limit) else "–"
