"""The picture of a life: estimated and true preload, and backlash, over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.base.quantity import Quantity
from ballscrew.report.canvas import (
    BACKLASH,
    STATE_COLOURS,
    STATE_MARKERS,
    TOP_EDGE,
    Axes,
    Figure,
    blank,
    note,
    styled,
)
from ballscrew.report.measured import interval_bars

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
        learning, normal, watch, alarm or suspect.
    estimate : Quantity or None
        P/P₀ relative to the baseline; None where the run gives no estimate.
    preload_ratio : float
        True P/P₀.
    backlash_m : float
        True backlash.
    """

    day: float
    state: str
    estimate: Quantity | None
    preload_ratio: float
    backlash_m: float


@styled()
def draw_life(points: Sequence[LifePoint], *, alarm_day: float | None) -> Figure:
    """Draw estimated and true preload, and backlash, over time.

    Parameters
    ----------
    points : sequence of LifePoint
        In the order of time.
    alarm_day : float, optional
        Day of the alarm, which is marked.

    Returns
    -------
    Figure
        Not yet written.
    """
    figure = blank(8.4, 6.4)
    preload, backlash = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
    days = np.array([point.day for point in points])
    true_ratio = np.array([point.preload_ratio for point in points])
    true_backlash = np.array([point.backlash_m for point in points])
    preload.plot(days, 100 * true_ratio, label="true", **_TRUE)
    _estimates(preload, points, days)
    preload.set(ylim=(0, _TOP), ylabel="preload (% of the baseline)")
    preload.set_title("Estimated and true preload, 95 % intervals", loc="left")
    preload.legend(loc="upper right", bbox_to_anchor=(0.94, 0.92), fontsize=9)  # left of the backlash
    backlash.plot(days, 1e6 * true_backlash, "o-", ms=3, color=BACKLASH)
    backlash.set(ylabel="backlash (µm)", xlabel="time (days)")
    backlash.set_title("True backlash", loc="left")
    if alarm_day is not None:
        for axes in (preload, backlash):
            axes.axvline(alarm_day, color=STATE_COLOURS["alarm"], lw=1.2)
        words = f"alarm: day {alarm_day:g}"
        note(preload, words, (alarm_day, 1), (4, -2), coords=TOP_EDGE, colour=STATE_COLOURS["alarm"], size=10)
    if (true_backlash > 0).any():
        first = days[true_backlash > 0][0]
        for axes in (preload, backlash):
            axes.axvline(first, color=BACKLASH, lw=1.1, ls="--")
        note(
            preload,
            f"backlash: day {first:g}",
            (first, 1),
            (-4, -2),
            coords=TOP_EDGE,
            colour=BACKLASH,
            size=10,
        )
    figure.align_ylabels()
    return figure


def _estimates(axes: Axes, points: Sequence[LifePoint], days: np.ndarray) -> None:
    """Draw the estimates by state, and crosses below the scale where there is none."""
    values, lengths = interval_bars(point.estimate for point in points)
    known = np.isfinite(values)
    states = np.array([point.state for point in points])
    for state, colour in STATE_COLOURS.items():
        own = known & (states == state)
        if own.any():
            axes.errorbar(
                days[own], 100 * values[own], yerr=100 * lengths[:, own], fmt=STATE_MARKERS[state], ms=4.5,
                lw=1.2, capsize=2, color=colour, label=f"estimated: {state}",
            )  # fmt: skip
    if not known.all():
        axes.plot(
            days[~known], np.full((~known).sum(), -0.03), "x", color="0.5", clip_on=False,
            transform=axes.get_xaxis_transform(), label="no estimate",
        )  # fmt: skip
