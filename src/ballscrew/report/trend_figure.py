"""Axial stiffness of the runs of an axis as a store has them, with events and alarms."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import numpy as np

from ballscrew.monitoring.epochs import moment
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes

_TALLEST = 160.0  # %, highest end of an interval that is shown
_LINES = 4  # on which marks are written


def draw_trend(axes: Axes, document: dict[str, Any]) -> None:
    """Draw P/P₀ of every run that counts, by the stored states.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    document : dict
        As ``store show --json`` prints it, with a run that has a stiffness.
    """
    runs = [run for run in document["runs"] if run["counts"] and run["stiffness"]]
    for state in canvas.STATE_COLOURS:
        _points(axes, state, [run for run in runs if run["state"] == state])
    highest = max(100 * run["stiffness"][2] for run in runs)
    top = 1.08 * min(highest, _TALLEST)
    axes.set_ylim(0, top)
    axes.axhline(100, color="0.5", lw=0.8)
    for number, (when, words, colour) in enumerate(sorted(_marks(document))):
        x: Any = when
        axes.axvline(x, color=colour, lw=0.9, ls=":")
        offset = (4, -12 - 12 * (number % _LINES))
        canvas.note(axes, canvas.escape_dollars(words), (x, top), offset, va="baseline", colour=colour)
    axes.set_ylabel("P/P₀ (% of the\nepoch’s baseline)")
    axes.set_title("Preload by stiffness, 95 %", loc="left")
    axes.legend(ncols=6, fontsize=9, loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0.1)
    few_dates(axes)


def _points(axes: Axes, state: str, runs: list[dict[str, Any]]) -> None:
    """Draw the runs of one state with their intervals."""
    if not runs:
        return
    dates: Any = [moment(run["measured_at"], "a run") for run in runs]
    values, low, high = 100 * np.array([run["stiffness"] for run in runs]).T
    look: dict[str, Any] = {"fmt": canvas.STATE_MARKERS[state], "ms": 4, "capsize": 2, "lw": 0.8}
    lengths = (values - low, high - values)
    axes.errorbar(dates, values, yerr=lengths, color=canvas.STATE_COLOURS[state], label=state, **look)


def _marks(document: dict[str, Any]) -> list[tuple[datetime, str, str]]:
    """Time, words and colour of the events, and of the alarms that were not retracted."""
    marks = [(moment(each["at"], "an event"), each["kind"], "0.35") for each in document["events"]]
    for alarm in document["alarms"]:
        if alarm["retracted_at"] is None:
            began = moment(alarm["began_at"], "an alarm")
            marks.append((began, f"alarm {began:%Y-%m-%d}", canvas.STATE_COLOURS["alarm"]))
    return marks


def few_dates(axes: Axes) -> None:
    """Mark few dates on the time axis, without repeating year and month."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    locator = AutoDateLocator(minticks=4, maxticks=9)  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
