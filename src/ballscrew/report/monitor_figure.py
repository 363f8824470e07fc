"""What a maintenance engineer reads: preload with its band, alarm, stage, epochs, and how it goes on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.monitoring.state import HealthState, RunState
from ballscrew.prognosis.monitor import Monitored
from ballscrew.prognosis.result import Prognosis
from ballscrew.report.canvas import blank, styled
from ballscrew.report.monitor_words import headline
from ballscrew.report.style import ANF, REFUSED, STATE_COLOURS, no_formula

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_monitor"]

_BANDS = ((0.05, 0.95, 0.16), (0.25, 0.75, 0.28))  # of the fan: between, and how dark
_AHEAD = 1.2  # times the remaining life that is drawn, where it is known
_MOST_AHEAD = 1.0  # times the history
_HIGHEST = 100.0  # times the limit of alarm
_MANY = 60  # runs from which on each is drawn thin
_NEAR = 0.16  # of the history: marks closer than that are written one below the other
_LINES = 5
_CAUSES = 5
_LETTERS = 72  # in a bar over the whole width
_STAGES = ("preload is being lost", "preload is gone, backlash grows")


def draw_monitor(told: Monitored) -> Figure:
    """Draw the history of an axis, and what is foretold.

    Parameters
    ----------
    told : Monitored
        As :func:`ballscrew.prognosis.monitor.monitor` makes it.

    Returns
    -------
    Figure
        Not yet written. Above P/P₀ of every run with its interval, events, the first alarm of each epoch and
        the remaining life; in the middle the evidence over its limit; below stage and causes.
    """
    state = told.state
    with styled():
        figure = blank(9.8, 8.2)
        grid = figure.add_gridspec(3, 2, height_ratios=(2.6, 1.0, 1.0), width_ratios=(1, 1.6))
        course = figure.add_subplot(grid[0, :])
        evidence = figure.add_subplot(grid[1, :], sharex=course)
        _course(course, state, told.prognosis)
        _evidence(evidence, state)
        _stage(figure.add_subplot(grid[2, 0]), state)
        _causes(figure.add_subplot(grid[2, 1]), state)
        figure.suptitle(no_formula(headline(told)), fontsize=10.5, x=0.01, ha="left", fontweight="bold")
    return figure


def _when(one: RunState) -> datetime:
    found = datetime.fromisoformat(str(one.reading.measured_at))
    return found.replace(tzinfo=UTC) if found.tzinfo is None else found.astimezone(UTC)


def _course(axes: Axes, state: HealthState, prognosis: Prognosis | None) -> None:
    for name, colour in STATE_COLOURS.items():
        mine = [one for one in state.runs if one.state == name and one.relative is not None]
        if mine:
            _points(axes, mine, name, colour, many=len(state.runs) > _MANY)
    lost = [_when(one) for one in state.runs if one.relative is None]
    top = _top(state)
    axes.set_ylim(0, top)
    if lost:
        axes.plot(
            lost, [0.02 * top] * len(lost), "x", color="0.35", ms=5, clip_on=False, label="set aside"  # type: ignore[arg-type]
        )  # fmt: skip
    axes.axhline(100, color="0.5", lw=0.8)
    if prognosis is not None and prognosis.fan.days and prognosis.rul_days.get(0.5) not in (None, 0):
        _fan(axes, state, prognosis)
    _marks(axes, state, top)
    axes.set_ylabel("preload, % of the\nepoch's baseline")
    axes.set_title("How much preload is left, with 95 % intervals", loc="left")
    axes.legend(ncols=6, fontsize=9, loc="lower left", bbox_to_anchor=(0, 0.04))
    axes.tick_params(labelbottom=False)


def _points(axes: Axes, runs: Sequence[RunState], name: str, colour: str, *, many: bool) -> None:
    """Runs with their intervals; of many runs thin ones, so that they stay apart."""
    values = np.array([one.relative.value for one in runs if one.relative])
    ends = np.array([one.relative.interval for one in runs if one.relative])
    axes.errorbar(
        [_when(one) for one in runs],  # type: ignore[arg-type]
        100 * values,
        yerr=100 * np.stack([values - ends[:, 0], ends[:, 1] - values]),
        fmt="o", ms=2.0 if many else 4.5, lw=0.8, elinewidth=0.4 if many else 1.0, capsize=0 if many else 2,
        ecolor=(colour, 0.35) if many else colour, color=colour, label=name,
    )  # fmt: skip


def _top(state: HealthState) -> float:
    highest = [100 * one.relative.interval[1] for one in state.runs if one.relative is not None]
    return 1.08 * min(max([110.0, *highest]), 160.0)


def _fan(axes: Axes, state: HealthState, prognosis: Prognosis) -> None:
    newest = state.epochs[-1].number
    good = [one for one in state.runs if one.reading.epoch == newest and one.relative is not None]
    begin = _when(good[0]) + timedelta(days=prognosis.at_day)
    days = np.array(prognosis.fan.days)
    history = max((begin - _when(state.runs[0])).total_seconds() / 86400, 30.0)
    last = prognosis.rul_days.get(0.95) or prognosis.rul_days.get(0.5)
    far = _MOST_AHEAD * history if last is None else min(_AHEAD * last, 2 * history)
    kept = days <= max(far, 1.0)
    dates: Any = [begin + timedelta(days=float(day)) for day in days[kept]]
    ratio = 100 * np.array(prognosis.fan.ratio)[kept]
    at = prognosis.fan.probabilities
    for lower, upper, dark in _BANDS:
        axes.fill_between(
            dates, ratio[:, at.index(lower)], ratio[:, at.index(upper)], color=ANF, alpha=dark, lw=0
        )
    axes.plot(dates, ratio[:, at.index(0.5)], color=ANF, lw=1.5, label="foretold")
    first, middle, high = (prognosis.rul_days.get(p) for p in (0.05, 0.5, 0.95))
    if prognosis.failure_mode == "preload" and middle is not None and first is not None and first > 0:
        end = _failing(prognosis)
        ends: Any = [begin + timedelta(days=d) for d in (first, min(high or far, 2 * history))]
        axes.plot(ends, [end, end], color="black", lw=3, solid_capstyle="butt")
        axes.annotate(
            f"end of life: {middle:.0f} days ({first:.0f} to {'open' if high is None else f'{high:.0f}'})",
            (ends[1], end), xytext=(0, 6), textcoords="offset points", fontsize=9, ha="right",
            bbox={"fc": "white", "ec": "none", "alpha": 0.75, "pad": 1.0},
        )  # fmt: skip


def _failing(prognosis: Prognosis) -> float:
    """Where the median of the fan is at the median of the remaining life, %."""
    middle = prognosis.rul_days[0.5]
    column = prognosis.fan.probabilities.index(0.5)
    return 100 * float(
        np.interp(float(middle or 0), prognosis.fan.days, [row[column] for row in prognosis.fan.ratio])
    )


def _marks(axes: Axes, state: HealthState, top: float) -> None:
    """Events, and the first alarm of each epoch; what lies close together is written one below the other."""
    begin, end = _when(state.runs[0]), _when(state.runs[-1])
    near = max((end - begin) * _NEAR, timedelta(days=1))
    marks = [(event.when, event.kind, "0.35") for epoch in state.epochs for event in epoch.events]
    for epoch in state.epochs:
        if epoch.alarm_at is not None:
            alarm = next(one for one in state.runs if one.reading.measured_at == epoch.alarm_at)
            marks.append((_when(alarm), f"alarm {_when(alarm):%Y-%m-%d}", STATE_COLOURS["alarm"]))
    line, last = 0, None
    for when, words, colour in sorted(marks, key=lambda mark: mark[0]):
        loud = words.startswith("alarm")
        moment: Any = when
        axes.axvline(moment, color=colour, lw=1.3 if loud else 0.9, ls="-" if loud else ":")
        line = line + 1 if last is not None and when - last < near else 0
        last = when
        late = when > end - near
        axes.annotate(
            no_formula(words), (moment, top), xytext=(-4 if late else 4, -12 - 12 * (line % _LINES)),
            textcoords="offset points", fontsize=9, color=colour, fontweight="bold" if loud else "normal",
            ha="right" if late else "left",
        )  # fmt: skip


def _evidence(axes: Axes, state: HealthState) -> None:
    for epoch in state.epochs:
        mine = [one for one in state.runs if one.reading.epoch == epoch.number and math.isfinite(one.ramp)]
        dates: Any = [_when(one) for one in mine]
        for values, style, name in (
            ([_part(one.ramp, one.ramp_limit) for one in mine], "-", "ramp"),
            ([_part(one.odds, one.odds_limit) for one in mine], "--", "odds"),
        ):
            axes.plot(
                dates, values, style, color=ANF, lw=1.3, marker="o", ms=2.5,
                label=name if epoch.number == 0 else None,
            )  # fmt: skip
    axes.axhline(1.0, color=STATE_COLOURS["alarm"], lw=1.2)
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_ylim(0, _HIGHEST)
    axes.set_yticks([0, 1, 10, 100], ["0", "1", "10", "100"])
    axes.annotate(
        "limit of alarm", (0, 1), xycoords=("axes fraction", "data"), xytext=(4, 3),
        textcoords="offset points", fontsize=8.5, color=STATE_COLOURS["alarm"],
    )  # fmt: skip
    axes.set_ylabel("over its limit")
    axes.set_title("Evidence that wear has begun", loc="left")
    axes.legend(ncols=2, fontsize=9, loc="upper left")
    axes.tick_params(axis="x", rotation=0)
    _few_dates(axes)


def _few_dates(axes: Axes) -> None:
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    locator = AutoDateLocator(minticks=4, maxticks=9)  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]


def _part(value: float, limit: float) -> float:
    """Of the limit; 0 while nothing is judged."""
    return min(max(value / limit, 0.0), _HIGHEST) if math.isfinite(limit) and limit > 0 else 0.0


def _stage(axes: Axes, state: HealthState) -> None:
    axes.set_title("Stage", loc="left")
    if state.stage is None:
        axes.text(0, 0.5, "not told: no loss is seen", color="0.4")
        axes.set_axis_off()
        return
    names = ("I", "II")
    _bars(axes, names, (state.stage.I, state.stage.II), (ANF, ANF), _STAGES)


def _causes(axes: Axes, state: HealthState) -> None:
    axes.set_title("What has changed the frequencies", loc="left")
    if not state.causes:
        axes.text(0, 0.5, "nothing has changed that is worth a cause", color="0.4")
        axes.set_axis_off()
        return
    shown = state.causes[:_CAUSES]
    colours = [ANF if one.probability > 0.05 else REFUSED for one in shown]
    _bars(
        axes, [one.cause for one in shown], [one.probability for one in shown], colours,
        [one.evidence.split(";")[0] for one in shown],
    )  # fmt: skip


def _bars(
    axes: Axes,
    names: Sequence[str],
    values: Sequence[float],
    colours: Sequence[str],
    words: Sequence[str],
) -> None:
    axes.barh(list(names)[::-1], list(values)[::-1], color=list(colours)[::-1])
    axes.set(xlim=(0, 1), xlabel="probability")
    axes.grid(visible=False, axis="y")
    for row, (value, said) in enumerate(zip(list(values)[::-1], list(words)[::-1], strict=True)):
        inside = value > 0.6
        fits = fill(said, int(_LETTERS * value)) if inside else said
        axes.text(
            0.015 if inside else value + 0.015, row, fits, va="center", linespacing=0.95,
            fontsize=6.5 if "\n" in fits else 8,
            color="white" if inside else "0.25",
        )  # fmt: skip
