"""The picture of a life: estimated and true preload, and backlash, over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ballscrew.base.quantity import Quantity
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes, Figure
from ballscrew.report.measured import draw_bars, interval_bars

_TRUE = {"color": "0.35", "lw": 1.2, "ls": "--", "marker": ".", "ms": 4, "zorder": 1}
_TOP = 118  # % of the baseline


@dataclass(frozen=True, slots=True)
class LifePoint:
    """One test in the life of an axis.

    Parameters
    ----------
    day : float
        Day of the test.
    state : str
        learning, normal, watch, alarm, unloaded or suspect.
    estimate : Quantity or None
        P/P₀ relative to the baseline; None where the run gives no estimate.
    preload_ratio : float
        True P/P₀.
    backlash_m : float
        True backlash.
    below : float or None
        Upper limit of the nut's P/P₀, where the test's own load unloads it.
    """

    day: float
    state: str
    estimate: Quantity | None
    preload_ratio: float
    backlash_m: float
    below: float | None = None


@canvas.styled()
def draw_life(points: Sequence[LifePoint], *, alarm_day: float | None, title: str = "") -> Figure:
    """Draw estimated and true preload, and backlash, over time.

    Parameters
    ----------
    points : sequence of LifePoint
        In the order of time.
    alarm_day : float, optional
        Day of the alarm, which is marked.
    title : str
        Title of the figure: axis and dates.

    Returns
    -------
    Figure
        Not yet written.
    """
    figure = canvas.blank(8.4, 6.4)
    upper: Any = {"coords": canvas.TOP_EDGE, "size": 10}
    preload, backlash = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
    days = np.array([point.day for point in points])
    true_ratio = np.array([point.preload_ratio for point in points])
    true_backlash = np.array([point.backlash_m for point in points])
    preload.plot(days, 100 * true_ratio, label="true", **_TRUE)
    _estimates(preload, points, days)
    preload.set(ylim=(0, _TOP), ylabel="preload (% of the baseline)")
    preload.set_title("Estimated and true preload, 95 % intervals", loc="left")
    preload.legend(loc="upper right", bbox_to_anchor=(0.94, 0.92), fontsize=9)  # left of the backlash
    backlash.plot(days, 1e6 * true_backlash, "o-", ms=3, color=canvas.BACKLASH)
    backlash.set(ylabel="backlash (µm)", xlabel="time (days)")
    backlash.set_title("True backlash", loc="left")
    if alarm_day is not None:
        for axes in (preload, backlash):
            axes.axvline(alarm_day, color=canvas.STATE_COLOURS["alarm"], lw=1.2)
        colour = canvas.STATE_COLOURS["alarm"]
        canvas.note(preload, f"alarm: day {alarm_day:g}", (alarm_day, 1), (4, -2), colour=colour, **upper)
    if (true_backlash > 0).any():
        first = days[true_backlash > 0][0]
        for axes in (preload, backlash):
            axes.axvline(first, color=canvas.BACKLASH, lw=1.1, ls="--")
        canvas.note(
            preload, f"backlash: day {first:g}", (first, 1), (-4, -2), colour=canvas.BACKLASH, **upper
        )
    figure.align_ylabels()
    if title:
        figure.suptitle(canvas.escape_dollars(title), fontsize=10.5, x=0.01, ha="left", fontweight="bold")
    return figure


def _estimates(axes: Axes, points: Sequence[LifePoint], days: np.ndarray) -> None:
    """Draw the estimates by state, and crosses below the scale where there is none."""
    values, lengths = interval_bars(point.estimate for point in points)
    known = np.isfinite(values)
    states = np.array([point.state for point in points])
    for state, colour in canvas.STATE_COLOURS.items():
        own = known & (states == state)
        if own.any():
            look = {"color": colour, "label": f"estimated: {state}"}
            draw_bars(
                axes, days[own], 100 * values[own], 100 * lengths[:, own], canvas.STATE_MARKERS[state], **look
            )
    limited = ~known & np.array([point.below is not None for point in points])
    if limited.any():
        limits = 100 * np.array([point.below or np.nan for point in points])[limited]
        axes.errorbar(
            days[limited], limits, yerr=0.6 * limits, uplims=True, fmt="_", ms=9, lw=1.3,
            color=canvas.STATE_COLOURS["unloaded"], label="nut below, 95 %",
        )  # fmt: skip
        known = known | limited
    canvas.draw_unestimated(axes, days[~known])
