"""Natural frequency and backlash against the operating time: Fig. 12 of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.report.canvas import blank, note, styled
from ballscrew.report.measured import COVERAGE, TRUE, draw_refused, draw_true
from ballscrew.report.style import ANF, BACKLASH, STAGES, STATE_COLOURS, no_formula

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_backlash"]


def draw_backlash(
    days: Sequence[float],
    frequency: Sequence[float | None],
    standard_uncertainty: Sequence[float | None],
    backlash: Sequence[float],
    backlash_uncertainty: Sequence[float],
    *,
    resolution: float | None = None,
    backlash_day: float | None = None,
    alarm_day: float | None = None,
    truth: Sequence[float] | None = None,
    true_backlash: Sequence[float] | None = None,
    cell: str = "",
    what: str = "backlash",
) -> Figure:
    """Draw the frequency of one cell above the backlash, stage I and stage II shaded.

    Parameters
    ----------
    days : sequence of float
        Of the runs, ascending.
    frequency, standard_uncertainty : sequence of float or None
        Of the cell on each day, Hz; None where it was refused.
    backlash, backlash_uncertainty : sequence of float
        As the probe reads it, with its standard uncertainty, m.
    resolution : float, optional
        Of the probe, m; shaded, since a backlash below it cannot be seen.
    backlash_day : float, optional
        Day on which backlash begins and stage II with it.
    alarm_day : float, optional
        Day of the alarm.
    truth : sequence of float, optional
        True frequency on each day, Hz; NaN where a nut without preload has none.
    true_backlash : sequence of float, optional
        On each day, m.
    cell : str
        Which cell, for the title.
    what : str
        What the probe reads: backlash alone, or lost motion with the axis' own give in it.

    Returns
    -------
    Figure
        Not yet written.

    Raises
    ------
    InputError
        If what is given is not of one length, or the days do not ascend.
    """
    given: dict[str, Sequence[Any] | None] = {
        "days": days, "frequency": frequency, "standard_uncertainty": standard_uncertainty,
        "backlash": backlash, "backlash_uncertainty": backlash_uncertainty, "truth": truth,
        "true_backlash": true_backlash,
    }  # fmt: skip
    sizes = {name: len(values) for name, values in given.items() if values is not None}
    if len(set(sizes.values())) != 1 or len(days) < 2 or not np.all(np.diff(days) > 0):
        told = ", ".join(f"{name} {size}" for name, size in sizes.items())
        raise InputError(f"given were: {told}; there must be one of each a day, 2 days or more, ascending")
    f = np.array([np.nan if value is None else value for value in frequency], dtype=np.float64)
    u = np.array([0.0 if value is None else value for value in standard_uncertainty], dtype=np.float64)
    with styled():
        figure = blank(8, 6.4)
        rows: Any = figure.subplots(2, 1, sharex=True, height_ratios=(1.5, 1))
        margin = 0.02 * (days[-1] - days[0])
        first, last = days[0] - margin, days[-1] + margin
        border = last if backlash_day is None else min(max(backlash_day, first), last)
        for axes in rows:
            axes.axvspan(first, border, color=STAGES[0], zorder=0, lw=0)
            axes.axvspan(border, last, color=STAGES[1], zorder=0, lw=0)
            if backlash_day is not None:
                axes.axvline(backlash_day, color=BACKLASH, lw=1.2, ls=(0, (5, 2.5)), zorder=1)
            if alarm_day is not None:
                axes.axvline(alarm_day, color=STATE_COLOURS["alarm"], lw=1.4, zorder=1)
            axes.set_xlim(first, last)
        _stages(rows[0], first, border, last)
        _alarm(rows[0], alarm_day, backlash_day)
        _frequency(rows[0], np.asarray(days, dtype=np.float64), f, u, truth, backlash_day)
        _backlash(
            rows[1], days, backlash, backlash_uncertainty, true_backlash, resolution, backlash_day, what
        )
        rows[1].set_xlabel("operating time (days)")
        figure.align_ylabels()
        if cell:
            figure.suptitle(no_formula(cell), fontweight="bold")
    return figure


def _stages(axes: Axes, first: float, border: float, last: float) -> None:
    above: Any = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
    parts = ((first, border, "Stage I: the preload goes"), (border, last, "Stage II: backlash"))
    for left, right, words in parts:
        if right - left > 0.1 * (last - first):
            narrow = right - left < 0.3 * (last - first)
            where, side = (right, "right") if narrow else ((left + right) / 2, "center")
            axes.annotate(words, (where, 1), (0, 6), ha=side, fontweight="bold", **above)


def _alarm(axes: Axes, day: float | None, backlash_day: float | None) -> None:
    if day is None:
        return
    lead = "" if backlash_day is None else f",\n{backlash_day - day:g} days before backlash"
    axes.annotate(
        f"alarm: day {day:g}{lead}", (day, 0.45), (5, 0), xycoords=("data", "axes fraction"),
        textcoords="offset points", va="center", color=STATE_COLOURS["alarm"], fontweight="bold", fontsize=9,
    )  # fmt: skip


def _frequency(
    axes: Axes, days: Array, f: Array, u: Array, truth: Sequence[float] | None, backlash_day: float | None
) -> None:
    read = np.isfinite(f)
    axes.errorbar(
        days[read], f[read], yerr=COVERAGE * u[read], fmt="o", ms=4.5, lw=1.2, capsize=2, color=ANF,
        label="measured, with 95 %",
    )  # fmt: skip
    if truth is not None:
        draw_true(axes, days, truth)
    axes.set_ylabel("frequency (Hz)")
    if read.any():
        # The truth dives where nothing can be read of it any more; it may leave the picture there.
        low, high = float((f - COVERAGE * u)[read].min()), axes.get_ylim()[1]
        axes.set_ylim(max(axes.get_ylim()[0], low - 0.45 * (high - low)), high)
    early = read if backlash_day is None else read & (days < backlash_day)
    if early.sum() > 1:
        start, end = np.flatnonzero(early)[[0, -1]]
        beside = days[end] + 0.015 * (days[-1] - days[0])  # not over the interval
        axes.plot([days[start], beside], [f[start]] * 2, color=ANF, lw=0.8, ls=":")
        look: Any = {"arrowstyle": "->", "color": ANF, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (beside, f[end]), (beside, f[start]), arrowprops=look)
        fall = f"{f[end] - f[start]:+.1f} Hz".replace("-", "−")
        words = f"{fall} before any backlash" if backlash_day is not None else fall
        note(axes, words, (beside, f[start]), (-2, 4), colour=ANF)
    _refused(axes, days[~read])
    _legend(axes, "lower left")


def _refused(axes: Axes, days: Array) -> None:
    draw_refused(axes, list(days), "0.3")
    if days.size:
        axes.plot([], [], linestyle="none", marker="x", mew=1.3, ms=5, color="0.3", label="refused")


def _backlash(
    axes: Axes,
    days: Sequence[float],
    backlash: Sequence[float],
    uncertainty: Sequence[float],
    true: Sequence[float] | None,
    resolution: float | None,
    backlash_day: float | None,
    what: str,
) -> None:
    micro = 1e6 * np.asarray(backlash, dtype=np.float64)
    half = 1e6 * COVERAGE * np.asarray(uncertainty, dtype=np.float64)
    if resolution is not None:
        axes.axhspan(
            -1e6 * resolution, 1e6 * resolution, color="0.55", alpha=0.3, lw=0,
            label=f"the probe’s resolution, ± {1e6 * resolution:g} µm",
        )  # fmt: skip
    axes.errorbar(
        days, micro, yerr=half, fmt="s", ms=4, lw=1.2, capsize=2, color=BACKLASH, label=f"{what}, with 95 %"
    )
    if true is not None:
        axes.plot(
            days, 1e6 * np.asarray(true, dtype=np.float64), label="true backlash", marker="o", ms=2.2, **TRUE
        )
    axes.set_ylabel(f"{what} (µm)")
    _legend(axes, "upper left")
    if backlash_day is not None:
        axes.annotate(
            f"backlash: day {backlash_day:g}", (backlash_day, 0.5), (-4, 0),
            xycoords=("data", "axes fraction"), textcoords="offset points", ha="right", va="center",
            color=BACKLASH,
        )  # fmt: skip


def _legend(axes: Axes, where: Any) -> None:
    """What was measured first."""
    pairs = sorted(zip(*axes.get_legend_handles_labels(), strict=True), key=lambda p: "95 %" not in p[1])
    axes.legend([handle for handle, _ in pairs], [name for _, name in pairs], loc=where, fontsize=9)
