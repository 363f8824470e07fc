"""The picture of a life: estimated and true preload, and backlash, against time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballscrew.base.quantity import Quantity
from ballscrew.report.canvas import save_figure, styled
from ballscrew.report.style import BACKLASH, STATE_COLOURS, check_target

__all__ = ["LifePoint", "draw_life"]

_TRUE = "0.35"


@dataclass(frozen=True, slots=True)
class LifePoint:
    """One test in the life of an axis.

    Parameters
    ----------
    day : float
        When.
    state : str
        learning, normal, watch, alarm or suspect.
    estimate : Quantity or None
        P/P₀ against the baseline; None where the run gives none.
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


def draw_life(points: Sequence[LifePoint], path: Path, *, alarm_day: float | None) -> None:
    """Draw the estimated beside the true preload.

    Parameters
    ----------
    points : sequence of LifePoint
        In the order of time.
    path : path-like
        PNG, SVG or PDF.
    alarm_day : float, optional
        Marked.

    Raises
    ------
    InputError
        If the picture cannot be written.
    """
    check_target(path)
    with styled():
        save_figure(_figure(points, alarm_day), path)


def _figure(points: Sequence[LifePoint], alarm_day: float | None):  # type: ignore[no-untyped-def]
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 6.4), dpi=150)
    preload, backlash = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
    days = [point.day for point in points]
    true = {"color": _TRUE, "lw": 1.2, "ls": "--", "marker": ".", "ms": 4, "zorder": 1}
    preload.plot(days, [100 * p.preload_ratio for p in points], label="true", **true)
    for state, colour in STATE_COLOURS.items():
        mine = [point for point in points if point.state == state and point.estimate is not None]
        if mine:
            value = np.array([p.estimate.value for p in mine if p.estimate])
            ends = np.array([p.estimate.interval for p in mine if p.estimate])
            preload.errorbar(
                [p.day for p in mine], 100 * value,
                yerr=100 * np.stack([value - ends[:, 0], ends[:, 1] - value]),
                fmt="o", ms=4.5, lw=1.2, capsize=2, color=colour, label=f"estimated: {state}",
            )  # fmt: skip
    lost = [point.day for point in points if point.estimate is None]
    preload.set_ylim(0, 118)
    if lost:
        preload.plot(lost, [2] * len(lost), "x", color="0.5", clip_on=False, label="no estimate")
    preload.set_ylabel("preload, % of the baseline")
    preload.set_title("Told from the recordings, with 95 % intervals, and true")
    preload.legend(loc="lower left", fontsize=9)
    backlash.plot(days, [1e6 * p.backlash_m for p in points], "o-", ms=3, color=BACKLASH)
    backlash.set_ylabel("backlash (µm)")
    backlash.set_title("True: backlash, which everybody sees at last")
    backlash.set_xlabel("time (days)")
    first = next((point.day for point in points if point.backlash_m > 0), None)
    for axes in (preload, backlash):
        if alarm_day is not None:
            axes.axvline(alarm_day, color=STATE_COLOURS["alarm"], lw=1.2)
        if first is not None:
            axes.axvline(first, color=BACKLASH, lw=1.1, ls="--")
    if alarm_day is not None:
        preload.annotate(
            f"alarm: day {alarm_day:g}", (alarm_day, 118), xytext=(4, -12), textcoords="offset points",
            color=STATE_COLOURS["alarm"],
        )  # fmt: skip
    if first is not None:
        preload.annotate(
            f"backlash: day {first:g}", (first, 118), xytext=(-4, -12), textcoords="offset points",
            ha="right", color=BACKLASH,
        )  # fmt: skip
    figure.subplots_adjust(left=0.1, right=0.965, top=0.945, bottom=0.08, hspace=0.25)
    return figure
