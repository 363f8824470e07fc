"""``ballscrew monitor``."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ballscrew.base.errors import ALARM, DONE, UNASSESSED, WATCH, InputError
from ballscrew.base.quantity import quantity_numbers
from ballscrew.base.result import check_export
from ballscrew.base.units import parse_named
from ballscrew.base.words import form, interval_words, plural, without_repeats
from ballscrew.calibration.modelfile import read_model
from ballscrew.cli.output import (
    STATE_STYLE,
    TIME_WIDTH,
    check_outputs,
    console,
    print_json,
    report_quality,
)
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import read_events
from ballscrew.monitoring.state import HealthState
from ballscrew.prognosis.duty import DutyRecord, read_duty
from ballscrew.prognosis.failure import Failure
from ballscrew.prognosis.monitor import Monitored, monitor
from ballscrew.report.canvas import check_target, save_figure
from ballscrew.report.monitor_words import advice, headline

_SHOWN_RUNS = 30  # newest runs in the table
_WHOLE = 100  # from which on an evidence is printed without a decimal
_SUSPECT_RUNS = 5  # reasons of suspect runs that are printed
_LISTED_PROBABILITY = 0.05  # from which on a cause is printed


def _parse_positive(option: str, text: str | None, unit: str) -> float | None:
    """Value of an option in SI; None where it was not given."""
    if text is None:
        return None
    if not any(letter.isalpha() for letter in text):
        raise InputError(f"{option} is {text!r}; give its unit, such as '10 {unit}'.")
    value = parse_named(option, text, unit)
    if not value > 0:
        raise InputError(f"{option} is {text!r}; it must be more than 0.")
    return value


def parse_duty(text: str | None) -> float | DutyRecord | None:
    """Counters of a file, or travel of a day, m, by the text of ``--duty``."""
    if text is None or not (text.lower().endswith(".csv") or Path(text).is_file()):
        return _parse_positive("--duty", text, "m")
    return read_duty(text)


def monitor_command(  # noqa: PLR0913  as many as options
    given: Sequence[str],
    *,
    model: Path | None,
    store: Path | None = None,
    events: Path | None,
    settings: MonitorSettings,
    end: float,
    largest_load: str | None,
    backlash: str | None,
    duty: str | None,
    accept: Sequence[str],
    as_json: bool,
    plot: Path | None,
    table: Path | None = None,
    exit_code: bool = False,
) -> int:
    """Monitor an axis, print and plot the result, and return the exit status."""
    if plot is not None:
        check_target(plot)
    if table is not None:
        check_export(table)
    check_outputs((plot, table), (model, events, Path(duty or ""), *map(Path, given)))
    stated = {
        "settings": settings,
        "failure": Failure(preload_ratio=end, backlash=_parse_positive("--backlash", backlash, "m")),
        "largest_load": _parse_positive("--largest-load", largest_load, "N"),
        "duty": parse_duty(duty),
        "accept": accept,
    }
    store = store or _default_store(given, model, events)
    if store is None:
        monitored, runs = _monitor_files(given, model, events, **stated)
    elif model is not None or events is not None or len(given) != 1:
        raise InputError("with --store, give the name of one axis; its model and events are in the store.")
    else:
        monitored, runs = _monitor_stored(store, given[0], **stated)
    if plot is not None:
        from ballscrew.report.monitor_figure import draw_monitor

        save_figure(draw_monitor(monitored), plot)
    if table is not None:
        monitored.export(table)
    if as_json:
        print_json(monitored.to_json())
    else:
        print_monitored(monitored)
    status = report_newest(monitored.state, runs)
    return health_status(monitored.state, status) if exit_code else status


def _default_store(given: Sequence[str], model: Path | None, events: Path | None) -> Path | None:
    """Store of the environment, where the name of an axis is given and no file."""
    folder = os.environ.get("BALLSCREW_STORE")
    of_files = model is not None or events is not None or len(given) != 1 or Path(given[0]).is_file()
    if of_files or not folder:
        return None
    return Path(folder)


def _monitor_files(
    given: Sequence[str], model: Path | None, events: Path | None, **stated: Any
) -> tuple[Monitored, Sequence[Run]]:
    """Monitor an axis by RUN.json files."""
    if model is None:
        raise InputError(
            "no model of the axis is given (--model); 'ballscrew calibrate' writes it. An axis of a store "
            "needs --store or BALLSCREW_STORE."
        )
    axis = read_model(model)
    runs = [Run.read(path) for path in given]
    known = () if events is None else read_events(events)
    return monitor(runs, axis, events=known, **stated), runs


def _monitor_stored(store: Path, axis: str, **stated: Any) -> tuple[Monitored, Sequence[Run]]:
    """Monitor an axis by a store; sentences about runs that are no part of the history on standard error."""
    from ballscrew.cli.store import open_store
    from ballscrew.store.assessing import monitor_axis

    assessed = monitor_axis(open_store(store), axis, **stated)
    for note in assessed.notes:
        sys.stderr.write(f"ballscrew: {note}\n")
    return assessed.monitored, [assessed.newest]


def health_status(state: HealthState, status: int = DONE) -> int:
    """Exit status of ``--exit-code``.

    Parameters
    ----------
    state : HealthState
        Of the axis.
    status : int
        Exit status without the option; an alarm and a watch have precedence over it.

    Returns
    -------
    int
        4 alarm, 3 watch, 5 learning, suspect or not judged, else ``status``.
    """
    if state.state == "alarm":
        return ALARM
    if state.state == "watch":
        return WATCH
    if status == DONE and (state.urgency == "unknown" or state.verdict != "good"):
        return UNASSESSED
    return status


def report_newest(state: HealthState, runs: Sequence[Run]) -> int:
    """Status 1 if the newest run is a bad measurement: the axis is then no longer monitored."""
    newest = state.runs[-1].reading.run
    quality = next(run.quality for run in runs if run.id == newest)
    return report_quality(quality)


def print_headline(monitored: Monitored) -> None:
    """Print the state of the axis in one line; on a terminal, as wide as that."""
    style, screen = STATE_STYLE[monitored.state.state], console()
    screen.print(f"[{style}]{escape(headline(monitored))}[/]", soft_wrap=not screen.is_terminal)


def print_monitored(monitored: Monitored) -> None:
    """Print the state first, then the history, the stage, the causes and the remaining life."""
    screen, state = console(), monitored.state
    print_headline(monitored)
    screen.print(_run_table(state))
    lines = [f"  • suspect: {reason}" for reason in state.reasons]
    lines += [f"  • the nut's preload is suspect: {reason}" for reason in state.nut_reasons]
    lines += [f"  → {line}" for line in (*advice(monitored), *state.notes, *_suspect_runs(state))]
    for line in without_repeats(lines):
        screen.print(line, markup=False)
    for epoch in state.epochs[:-1]:
        if epoch.alarm_at is not None:
            end = state.epochs[epoch.number + 1].cause
            text = f"An earlier epoch had an alarm on {epoch.alarm_at[:10]}; it ended with: {end}."
            screen.print(text, markup=False)
    if state.stage is not None:
        text = f"Stage I (preload is being lost) {state.stage.I:.2f}, stage II (no preload left) "
        screen.print(f"{text}{state.stage.II:.2f}; from {state.stage.how}.", markup=False)
    for cause in state.causes:
        if cause.probability >= _LISTED_PROBABILITY:
            screen.print(f"Cause: {cause.cause} {cause.probability:.2f}: {cause.evidence}", markup=False)
    _print_prognosis(screen, monitored)


def _print_prognosis(screen: Console, monitored: Monitored) -> None:
    prognosis = monitored.prognosis
    if prognosis is None:
        reason = "there are fewer than three good runs"
        if monitored.state.stiffer:
            reason = "the newest runs are stiffer than the baseline, which wear cannot explain"
        screen.print(f"Remaining life: no forecast, because {reason}.", markup=False)
        return
    first, *others = prognosis.statement
    runs = monitored.state.epoch_runs
    newest = next((run for run in reversed(runs) if run.stiffness is not None), runs[-1])
    by = ""
    if newest is not runs[-1]:
        by = f", by the runs up to {newest.reading.measured_at[:10]}"
    screen.print(f"Remaining life{by}. {first}", markup=False)
    for line in others:
        screen.print(f"  {line}", markup=False)
    screen.print(f"  Confidence {prognosis.confidence}.", markup=False)
    for line in prognosis.assumptions:
        screen.print(f"  Assumed: {line}", markup=False)
    for line in prognosis.would_change:
        screen.print(f"  What would change the forecast: {line}", markup=False)


def _suspect_runs(state: HealthState) -> list[str]:
    """Sentences on the newest suspect runs, with the reasons why they do not count; each reason once."""
    alike: dict[str, list[tuple[str, str]]] = {}
    for run in state.runs:
        if run.state == "suspect":
            reasons = "; ".join(run.reading.reasons) or "suspect"
            time = str(run.reading.measured_at)[:TIME_WIDTH]
            alike.setdefault(form(reasons), []).append((time, reasons))
    sentences = []
    for runs in alike.values():
        time, reasons = runs[-1]
        which = "Suspect run" if len(runs) == 1 else f"{len(runs)} suspect runs, the newest"
        sentences.append(f"{which} {time}: {reasons}")
    return sentences[-_SUSPECT_RUNS:]


def _run_table(state: HealthState) -> Table:
    shown = state.runs[-_SHOWN_RUNS:]
    title = plural(len(state.runs), "run")
    if len(shown) < len(state.runs):
        title = f"the newest {len(shown)} of {title}"
    if shown[0].reading.epoch != shown[-1].reading.epoch:
        title += ", a line between two epochs"
    table = Table(title=title, title_justify="left")
    table.add_column("measured at")
    for heading in ("stiffness\nas P/P₀ (95 %)", "nut (95 %)", "slow wear\n/ limit", "recent wear\n/ limit"):
        table.add_column(heading, justify="right")
    table.add_column("state")
    for run, following in zip(shown, (*shown[1:], shown[-1]), strict=True):
        row = [escape(str(run.reading.measured_at)[:TIME_WIDTH])]
        row += [interval_words(quantity_numbers(quantity)) for quantity in (run.stiffness, run.relative)]
        row += [_with_limit(run.ramp, run.ramp_limit), _with_limit(run.odds, run.odds_limit)]
        row.append(f"[{STATE_STYLE[run.state]}]{run.state}[/]")
        table.add_row(*row, end_section=following.reading.epoch != run.reading.epoch)
    return table


def _with_limit(value: float, limit: float) -> str:
    if not (math.isfinite(value) and math.isfinite(limit)):
        return "–"
    decimals = 0 if value >= _WHOLE else 1
    return f"{value:.{decimals}f} / {limit:.1f}"
