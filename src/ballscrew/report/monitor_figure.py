"""The picture for maintenance: preload with its intervals, alarms, evidence, stage, causes and forecast."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from textwrap import fill, shorten
from typing import Any

import numpy as np

from ballscrew.monitoring.state import HealthState, RunState
from ballscrew.prognosis.monitor import Monitored
from ballscrew.prognosis.result import Prognosis
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes, Figure, FigureBase
from ballscrew.report.measured import interval_bars
from ballscrew.report.monitor_words import headline
from ballscrew.report.trend_figure import few_dates

_BANDS = ((0.05, 0.95, 0.16), (0.25, 0.75, 0.28))  # of the forecast: probabilities and opacity
_AHEAD = 1.2  # times the remaining life that is drawn, where it is known
_MOST_AHEAD = 1.0  # times the history, where it is not
_SHORTEST = 30.0  # days: least history for that
_HIGHEST = 100.0  # times the alarm threshold
_TALLEST = 160.0  # %, highest end of an interval that is shown
_MANY = 60  # runs from which on each is drawn thin
_NEAR = 0.16  # of the history: nearer marks are written one below the other
_LINES = 5
_CAUSES = 5
_LETTERS, _MOST_LETTERS = 66, 78  # of a line over a bar; in the wider panel
_PALE = 0.35  # opacity of a bar, over which its words are read
_STAGES = ("preload is being lost", "preload is gone, backlash grows")


@canvas.styled()
def draw_monitor(monitored: Monitored, title: str | None = None) -> Figure:
    """Draw the history of an axis, and the forecast.

    Parameters
    ----------
    monitored : Monitored
        As :func:`ballscrew.prognosis.monitor.monitor` returns it.
    title : str, optional
        Title of the figure; by default the state in one line.

    Returns
    -------
    Figure
        Not yet written. Above P/P₀ of every run with its interval, events, the first alarm of each epoch and
        the remaining life; in the middle the evidence over the alarm threshold; below stage and causes.
    """
    figure = canvas.blank(9.8, 8.2)
    draw_panels(figure, monitored)
    figure.suptitle(
        canvas.escape_dollars(fill(title or headline(monitored), 110)),
        fontsize=10.5,
        x=0.01,
        ha="left",
        fontweight="bold",
    )
    return figure


def draw_panels(
    figure: FigureBase, monitored: Monitored, heights: tuple[float, float, float] = (2.6, 1.0, 1.0)
) -> None:
    """Draw the panels of :func:`draw_monitor` on a figure, or a part of one.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty, with a layout engine.
    monitored : Monitored
        As :func:`ballscrew.prognosis.monitor.monitor` returns it.
    heights : tuple of float
        Of its rows, relative to each other.
    """
    state = monitored.state
    grid = figure.add_gridspec(3, 2, height_ratios=heights, width_ratios=(1, 2.2))
    preload = figure.add_subplot(grid[0, :])
    evidence = figure.add_subplot(grid[1, :], sharex=preload)
    draw_history(preload, monitored)
    preload.tick_params(labelbottom=False)
    _evidence(evidence, state)
    _stage(figure.add_subplot(grid[2, 0]), state)
    _causes(figure.add_subplot(grid[2, 1]), state)


def _when(run: RunState) -> datetime:
    found = datetime.fromisoformat(str(run.reading.measured_at))
    if found.tzinfo is None:
        return found.replace(tzinfo=UTC)
    return found.astimezone(UTC)


def _dates(runs: Sequence[RunState]) -> Any:
    return [_when(run) for run in runs]


def draw_history(axes: Axes, monitored: Monitored) -> None:
    """Draw P/P₀ of every run with its interval, events, alarms and the forecast.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    monitored : Monitored
        As :func:`ballscrew.prognosis.monitor.monitor` returns it.
    """
    state, prognosis = monitored.state, monitored.prognosis
    _nut(axes, state)
    for name in canvas.STATE_COLOURS:
        _points(axes, state, name)
    _limits(axes, state)
    top = _top(state)
    axes.set_ylim(0, top)
    missing = [run for run in state.runs if run.stiffness is None and run.preload_below is None]
    canvas.draw_unestimated(axes, _dates(missing))
    axes.axhline(100, color="0.5", lw=0.8)
    begin = monitored.forecast_at
    if (
        prognosis is not None and begin is not None
        and prognosis.fan.days and prognosis.rul_days.get(0.5) not in (None, 0)
    ):  # fmt: skip
        _forecast(axes, state, prognosis, begin)
    _marks(axes, state, top)
    axes.set_ylabel("P/P₀ (% of the\nepoch’s baseline)")
    axes.set_title("Preload by stiffness, 95 %; grey: nut", loc="left")
    axes.legend(
        ncols=7, fontsize=9, loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0.1, handletextpad=0.3,
        columnspacing=1.1, handlelength=1.4,
    )  # fmt: skip
    few_dates(axes)


def _nut(axes: Axes, state: HealthState) -> None:
    """Draw the intervals of the nut's preload behind those of the stiffness."""
    runs = [run for run in state.runs if run.relative is not None and run.stiffness is not None]
    if runs:
        values, lengths = interval_bars(run.relative for run in runs)
        look: dict[str, Any] = {"fmt": "none", "ecolor": "0.87", "elinewidth": 3.0, "zorder": 0.8}
        axes.errorbar(_dates(runs), 100 * values, yerr=100 * lengths, **look)


def _limits(axes: Axes, state: HealthState) -> None:
    """Draw the upper limits of runs whose own load unloads the nut, as arrows downwards."""
    runs = [run for run in state.runs if run.stiffness is None and run.preload_below is not None]
    if runs:
        limits = [100 * (run.preload_below or 0.0) for run in runs]
        colour: Any = canvas.STATE_COLOURS["unloaded"]
        axes.errorbar(
            _dates(runs), limits, yerr=0.6 * np.array(limits), uplims=True, fmt="_", ms=9, color=colour,
            lw=1.3, label="nut below",
        )  # fmt: skip


def _points(axes: Axes, state: HealthState, name: str) -> None:
    """Draw the runs of one state with their intervals; thin where there are many runs."""
    runs = [run for run in state.runs if run.state == name and run.stiffness is not None]
    if not runs:
        return
    values, lengths = interval_bars(run.stiffness for run in runs)
    colour: Any = canvas.STATE_COLOURS[name]
    look: dict[str, Any] = {"ms": 4.5, "elinewidth": 1.0, "capsize": 2, "ecolor": colour}
    if len(state.runs) > _MANY:
        look = {"ms": 2.5, "elinewidth": 0.4, "capsize": 0, "ecolor": (colour, 0.35)}
    axes.errorbar(
        _dates(runs), 100 * values, yerr=100 * lengths, fmt=canvas.STATE_MARKERS[name], lw=0.8, color=colour,
        label=name, **look,
    )  # fmt: skip


def _top(state: HealthState) -> float:
    """Upper end of the scale, %."""
    values, lengths = interval_bars(run.stiffness for run in state.runs)
    highest = 100 * np.nan_to_num(values + lengths[1]).max(initial=1.1)
    return float(1.08 * min(highest, _TALLEST))


def _forecast(axes: Axes, state: HealthState, prognosis: Prognosis, begin: datetime) -> None:
    """Draw the forecast as a fan, and the remaining life."""
    history = max((begin - _when(state.runs[0])).total_seconds() / 86400, _SHORTEST)
    last = prognosis.rul_days.get(0.95) or prognosis.rul_days.get(0.5)
    reach = _MOST_AHEAD * history
    if last is not None:
        reach = min(_AHEAD * last, 2 * history)
    days = np.array(prognosis.fan.days)
    shown = days <= max(reach, 1.0)
    dates: Any = [begin + timedelta(days=float(day)) for day in days[shown]]
    ratio = 100 * np.array(prognosis.fan.ratio)[shown]
    column = prognosis.fan.probabilities.index
    for lower, upper, opacity in _BANDS:
        low, high = ratio[:, column(lower)], ratio[:, column(upper)]
        axes.fill_between(dates, low, high, color=canvas.ANF, alpha=opacity, lw=0)
    axes.plot(dates, ratio[:, column(0.5)], color=canvas.ANF, lw=1.5, label="forecast")
    if prognosis.failure_mode == "preload":
        _end_of_life(axes, prognosis, begin, reach, 2 * history)


def _end_of_life(axes: Axes, prognosis: Prognosis, begin: datetime, reach: float, most: float) -> None:
    """Draw the interval of the remaining life as a bar at the preload at which life ends."""
    days = prognosis.rul_days
    low, middle, high = days.get(0.05), days.get(0.5), days.get(0.95)
    if middle is None or not low:
        return
    column = prognosis.fan.probabilities.index(0.5)
    end = 100 * float(np.interp(middle, prognosis.fan.days, np.array(prognosis.fan.ratio)[:, column]))
    upper, last = "open", reach
    if high is not None:
        upper = f"{high:.0f}"
        last = high or reach
    ends: Any = [begin + timedelta(days=low), begin + timedelta(days=min(last, most))]
    axes.plot(ends, [end, end], color="black", lw=3, solid_capstyle="butt")
    words = f"end of life: {middle:.0f} days ({low:.0f} to {upper})"
    clear = {"fc": "white", "ec": "none", "alpha": 0.75, "pad": 1.0}
    canvas.note(axes, words, (ends[1], end), (0, 6), ha="right", va="baseline", bbox=clear)


def _marks(axes: Axes, state: HealthState, top: float) -> None:
    """Mark events and the first alarm of each epoch; near ones are written one below the other."""
    begin, end = _when(state.runs[0]), _when(state.runs[-1])
    near = max((end - begin) * _NEAR, timedelta(days=1))
    alarm_look: dict[str, Any] = {"color": canvas.STATE_COLOURS["alarm"], "lw": 1.3, "ls": "-"}
    event_look: dict[str, Any] = {"color": "0.35", "lw": 0.9, "ls": ":"}
    marks = []
    for epoch in state.epochs:
        marks += [(event.when, event.kind, event_look) for event in epoch.events]
        if epoch.alarm_at is not None:
            when = _alarm_time(state, epoch.alarm_at)
            marks.append((when, f"alarm {when:%Y-%m-%d}", alarm_look))
    line, last = 0, datetime.min.replace(tzinfo=UTC)
    for when, words, look in sorted(marks, key=lambda mark: mark[0]):
        moment: Any = when
        axes.axvline(moment, **look)
        line += 1
        if when - last >= near:
            line = 0
        last = when
        side = 4
        if when > end - near:
            side = -4
        weight = "normal"
        if look is alarm_look:
            weight = "bold"
        offset = (side, -12 - 12 * (line % _LINES))
        canvas.note(
            axes, canvas.escape_dollars(words), (moment, top), offset, va="baseline", fontweight=weight,
            colour=look["color"],
        )  # fmt: skip


def _alarm_time(state: HealthState, alarm_at: str) -> datetime:
    return next(_when(run) for run in state.runs if run.reading.measured_at == alarm_at)


def _evidence(axes: Axes, state: HealthState) -> None:
    for epoch in state.epochs:
        runs = [run for run in state.runs if run.reading.epoch == epoch.number and math.isfinite(run.ramp)]
        gradual, recent = "slow wear", "wear within the last five runs"
        if epoch.number > 0:
            gradual, recent = "_slow", "_recent"
        look: dict[str, Any] = {"color": canvas.ANF, "lw": 1.3, "marker": "o", "ms": 2.5}
        ramp, odds = [], []
        for run in runs:
            ramp.append(_relative(run.ramp, run.ramp_limit))
            odds.append(_relative(run.odds, run.odds_limit))
        axes.plot(_dates(runs), ramp, "-", label=gradual, **look)
        axes.plot(_dates(runs), odds, "--", label=recent, **look)
    axes.axhline(1.0, color=canvas.STATE_COLOURS["alarm"], lw=1.2)
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_ylim(0, _HIGHEST)
    axes.set_yticks([0, 1, 10, 100], ["0", "1", "10", "100"])
    colour = canvas.STATE_COLOURS["alarm"]
    canvas.note(axes, "alarm threshold", (0, 1), (4, 3), coords=canvas.SIDE_EDGE, size=8.5, colour=colour)
    axes.set_ylabel("relative to the\nalarm threshold")
    axes.set_title("Evidence of wear", loc="left")
    axes.legend(ncols=2, fontsize=9, loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0.1)
    axes.tick_params(axis="x", rotation=0)


def _relative(value: float, threshold: float) -> float:
    """Statistic over its threshold; 0 while there is no threshold."""
    if not math.isfinite(threshold) or threshold <= 0:
        return 0.0
    return min(max(value / threshold, 0.0), _HIGHEST)


def _stage(axes: Axes, state: HealthState) -> None:
    axes.set_title("Wear stage", loc="left")
    if state.stage is None:
        _empty(axes, "not judged" if state.why_unassessed else "no loss of preload detected")
        return
    labelled_bars(axes, ("I", "II"), (state.stage.I, state.stage.II), (canvas.ANF, canvas.ANF), _STAGES)


def _causes(axes: Axes, state: HealthState) -> None:
    axes.set_title("Likely cause of the change", loc="left")
    if not state.causes:
        _empty(axes, "not judged" if state.why_unassessed else "no significant change")
        return
    names, values, colours, words = [], [], [], []
    for cause in state.causes[:_CAUSES]:
        names.append(cause.cause)
        values.append(cause.probability)
        words.append(shorten(cause.evidence.split(";")[0], _MOST_LETTERS, placeholder=" …"))
        colours.append(canvas.REFUSED)
        if cause.probability > 0.05:
            colours[-1] = canvas.ANF
    labelled_bars(axes, names, values, colours, words, _MOST_LETTERS)


def _empty(axes: Axes, words: str) -> None:
    axes.text(0, 0.5, words, color="0.4")
    axes.set_axis_off()


def labelled_bars(
    axes: Axes,
    names: Sequence[str],
    values: Sequence[float],
    colours: Sequence[str],
    words: Sequence[str],
    letters: int = _LETTERS,
) -> None:
    """Draw probabilities as bars from top to bottom, each with its words over it.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    names, words : sequence of str
        Name and explanation of each bar.
    values : sequence of float
        Probabilities, 0 to 1.
    colours : sequence of str
        Colour of each bar.
    letters : int
        Of a line; longer words are smaller, in two lines.
    """
    axes.barh(names, values, color=colours, alpha=_PALE)
    axes.invert_yaxis()
    axes.set(xlim=(0, 1), xlabel="probability")
    axes.grid(visible=False, axis="y")
    for row, text in enumerate(words):
        lines, size = text, 8.0
        if len(text) > letters:
            lines, size = fill(text, letters), 6.5
        axes.text(0.01, row, lines, va="center", linespacing=0.95, fontsize=size, color="0.1")
