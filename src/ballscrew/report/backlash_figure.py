"""Natural frequency and backlash against the operating time: Fig. 12 of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.quantity import Quantity
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes, Figure
from ballscrew.report.measured import COVERAGE, TRUE, draw_bars, draw_refused, draw_true, interval_bars

_GENTLE: dict[str, Any] = {
    "color": "#0072B2",
    "mfc": "white",
    "ms": 4.5,
    "label": "by a gentler motion, 95 %",
}
_NARROW, _TOO_NARROW = 0.3, 0.1  # of the time shown: a stage named at its end, and one without a name


@dataclass(frozen=True, slots=True)
class WornAxis:
    """What is known of the axis where the test unloads its nut, one value a day.

    Parameters
    ----------
    peak : sequence of float or None
        Peak of the FRF on days without frequency, Hz; it depends on the amplitude of the test.
    gentle : sequence of (float or None, float or None)
        Frequency and standard uncertainty by a gentler motion, Hz.
    ratio, gentle_ratio : sequence of Quantity or None
        P/P₀ by the test and by the gentler motion; an interval that begins at 0 is an upper limit.
    true_ratio : sequence of float
        True P/P₀.
    """

    peak: Sequence[float | None]
    gentle: Sequence[tuple[float | None, float | None]]
    ratio: Sequence[Quantity | None]
    gentle_ratio: Sequence[Quantity | None]
    true_ratio: Sequence[float]


@dataclass(frozen=True, slots=True)
class _Days:
    """Time axis.

    Parameters
    ----------
    first, last : float
        Limits.
    backlash, alarm : float or None
        Day of each.
    """

    first: float
    last: float
    backlash: float | None
    alarm: float | None

    @property
    def border(self) -> float:
        """End of stage I within the limits."""
        if self.backlash is None:
            return self.last
        return min(max(self.backlash, self.first), self.last)


def draw_backlash(
    days: Sequence[float],
    frequency: Sequence[float | None],
    standard_uncertainty: Sequence[float | None],
    backlash: Sequence[float],
    backlash_uncertainty: Sequence[float],
    *,
    backlash_day: float | None = None,
    alarm_day: float | None = None,
    truth: Sequence[float] | None = None,
    true_backlash: Sequence[float] | None = None,
    cell: str = "",
    what: str = "backlash",
    worn: WornAxis | None = None,
) -> Figure:
    """Draw the frequency of one cell above the backlash, stage I and stage II shaded.

    Parameters
    ----------
    days : sequence of float
        Days of the runs, ascending.
    frequency, standard_uncertainty : sequence of float or None
        Frequency of the cell on each day, Hz; None where it was refused.
    backlash, backlash_uncertainty : sequence of float
        Reading of the probe, with its standard uncertainty, m.
    backlash_day : float, optional
        Day on which backlash begins and stage II with it.
    alarm_day : float, optional
        Day of the alarm.
    truth : sequence of float, optional
        True frequency on each day, Hz; NaN where a nut without preload has none.
    true_backlash : sequence of float, optional
        On each day, m.
    cell : str
        Name of the cell, for the title.
    what : str
        Quantity that the probe reads: backlash alone, or lost motion, which includes elastic deformation.
    worn : WornAxis, optional
        Drawn with the frequency, and its P/P₀ between frequency and backlash.

    Returns
    -------
    Figure
        Not yet written.

    Raises
    ------
    InputError
        If the series differ in length, or the days do not ascend.
    """
    given: dict[str, Sequence[Any] | None] = {
        "days": days, "frequency": frequency, "standard_uncertainty": standard_uncertainty,
        "backlash": backlash, "backlash_uncertainty": backlash_uncertainty, "truth": truth,
        "true_backlash": true_backlash,
    }  # fmt: skip
    if worn is not None:
        given["peak"], given["true_ratio"] = worn.peak, worn.true_ratio
        given["gentle"], given["gentle_uncertainty"] = zip(*worn.gentle, strict=True)
    series = _checked(given)
    margin = 0.02 * (days[-1] - days[0])
    time = _Days(days[0] - margin, days[-1] + margin, backlash_day, alarm_day)
    return _draw(series, time, cell, what, worn)


def _checked(given: dict[str, Sequence[Any] | None]) -> dict[str, Array]:
    """Series as arrays, NaN where a value is missing; those that are not given are left out."""
    series = {
        name: np.array(values, dtype=np.float64) for name, values in given.items() if values is not None
    }
    counts = {values.size for values in series.values()}
    if len(counts) > 1 or series["days"].size < 2 or not np.all(np.diff(series["days"]) > 0):
        sizes = ", ".join(f"{name} {values.size}" for name, values in series.items())
        raise InputError(
            f"the lengths are: {sizes}; there must be one value a day, 2 days or more, ascending"
        )
    return series


@canvas.styled()
def _draw(series: dict[str, Array], time: _Days, cell: str, what: str, worn: WornAxis | None) -> Figure:
    if worn is None:
        figure = canvas.blank(8, 6.4)
        rows: Any = figure.subplots(2, 1, sharex=True, height_ratios=(1.5, 1))
    else:
        figure = canvas.blank(8, 8.6)
        rows = figure.subplots(3, 1, sharex=True, height_ratios=(1.5, 1, 1))
        _preload(rows[1], series, worn)
    for axes in rows:
        shade_stages(axes, time.first, time.border, time.last)
        if time.backlash is not None:
            axes.axvline(time.backlash, color=canvas.BACKLASH, lw=1.2, ls=(0, (5, 2.5)), zorder=1)
        if time.alarm is not None:
            axes.axvline(time.alarm, color=canvas.STATE_COLOURS["alarm"], lw=1.4, zorder=1)
    above, below = rows[0], rows[-1]
    _name_stages(above, time)
    _alarm(above, time)
    _frequency(above, series, time)
    _backlash(below, series, time, what)
    below.set_xlabel("operating time (days)")
    figure.align_ylabels()
    if cell:
        figure.suptitle(canvas.escape_dollars(cell), fontweight="bold")
    return figure


def shade_stages(axes: Axes, first: float, border: float, last: float) -> None:
    """Shade stage I and stage II, and set the limits of the time.

    Parameters
    ----------
    axes : Axes
        Axes with the time along x.
    first, border, last : float
        Beginning of stage I, of stage II, and its end.
    """
    axes.axvspan(first, border, color=canvas.STAGES[0], zorder=0, lw=0)
    axes.axvspan(border, last, color=canvas.STAGES[1], zorder=0, lw=0)
    axes.set_xlim(first, last)


def name_stage(axes: Axes, where: float, text: str, side: str = "center") -> None:
    """Write the name of a stage above the axes.

    Parameters
    ----------
    axes : Axes
        Axes with the time along x.
    where : float
        Time.
    text : str
        Name.
    side : str
        Alignment.
    """
    canvas.note(
        axes,
        text,
        (where, 1),
        (0, 6),
        coords=canvas.TOP_EDGE,
        ha=side,
        va="baseline",
        size=10,
        fontweight="bold",
    )


def _name_stages(axes: Axes, time: _Days) -> None:
    whole = time.last - time.first
    stages = (
        (time.first, time.border, "Stage I: preload decreases"),
        (time.border, time.last, "Stage II: backlash"),
    )
    for begin, end, words in stages:
        if end - begin > _NARROW * whole:
            name_stage(axes, (begin + end) / 2, words)
        elif end - begin > _TOO_NARROW * whole:
            name_stage(axes, end, words, "right")


def _alarm(axes: Axes, time: _Days) -> None:
    if time.alarm is None:
        return
    words = f"alarm: day {time.alarm:g}"
    if time.backlash is not None:
        words += f",\n{time.backlash - time.alarm:g} days before backlash"
    colour = canvas.STATE_COLOURS["alarm"]
    canvas.note(
        axes, words, (time.alarm, 0.45), (5, 0), coords=canvas.TOP_EDGE, colour=colour, fontweight="bold"
    )


def _frequency(axes: Axes, series: dict[str, Array], time: _Days) -> None:
    days, f = series["days"], series["frequency"]
    half = COVERAGE * np.nan_to_num(series["standard_uncertainty"])
    known = np.isfinite(f)
    draw_bars(axes, days[known], f[known], half[known], "o", color=canvas.ANF, label="measured, 95 %")
    if "gentle" in series:
        further, spread = series["gentle"], COVERAGE * np.nan_to_num(series["gentle_uncertainty"])
        own = np.isfinite(further)
        draw_bars(axes, days[own], further[own], spread[own], "D", **_GENTLE)
        known |= own
    if "peak" in series:
        label = "FRF’s peak after departures: depends on amplitude"
        axes.plot(days, series["peak"], "o", ms=5, mfc="none", color="0.45", label=label)
    if "truth" in series:
        draw_true(axes, days, series["truth"])
    axes.set_ylabel("frequency (Hz)")
    if known.any():
        # The true frequency falls to 0 where none can be measured; it may leave the picture there.
        bottom, top = axes.get_ylim()
        measured = [f - half, series.get("gentle", f), series.get("peak", f)]
        low = float(np.nanmin(np.concatenate(measured)))
        axes.set_ylim(max(bottom, low - 0.45 * (top - low)), top)
    _fall(axes, days, f, time)
    if not known.all():
        draw_refused(axes, days[~known], "0.3")
        axes.plot([], [], linestyle="none", marker="x", mew=1.3, ms=5, color="0.3", label="refused")
    _legend(axes, "lower left")


def _preload(axes: Axes, given: dict[str, Array], worn: WornAxis) -> None:
    """Draw P/P₀ with its intervals, and upper limits as arrows downwards."""
    days = given["days"]
    series: tuple[tuple[Sequence[Quantity | None], dict[str, Any], str], ...] = (
        (worn.ratio, {"color": canvas.ANF, "label": "as axial stiffness, 95 %"}, "o"),
        (worn.gentle_ratio, _GENTLE, "D"),
    )
    for quantities, look, marker in series:
        values, lengths = interval_bars(quantities)
        limit = np.isclose(values, lengths[0])
        known = np.isfinite(values) & ~limit
        if known.any():
            draw_bars(axes, days[known], 100 * values[known], 100 * lengths[:, known], marker, **look)
        ends = 100 * (values + lengths[1])[limit]
        if len(ends):
            words: dict[str, Any] = {"color": look["color"], "label": "below, 95 %"}
            axes.errorbar(days[limit], ends, yerr=0.5 * ends, uplims=True, fmt="_", ms=8, **words)
    axes.plot(days, 100 * given["true_ratio"], label="true, mean of the stops", marker="o", ms=2.2, **TRUE)
    axes.set(ylabel="P/P₀ (%)", yscale="log")
    axes.set_yticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"])
    axes.minorticks_off()
    _legend(axes, "lower left")


def _fall(axes: Axes, days: Array, f: Array, time: _Days) -> None:
    """Draw an arrow for the fall of the frequency before backlash."""
    early, after = np.isfinite(f), ""
    if time.backlash is not None:
        early, after = early & (days < time.backlash), " before any backlash"
    if early.sum() < 2:
        return
    start, end = np.flatnonzero(early)[[0, -1]]
    beside = days[end] + 0.015 * (days[-1] - days[0])  # not over the interval
    axes.plot([days[start], beside], [f[start]] * 2, color=canvas.ANF, lw=0.8, ls=":")
    look: Any = {"arrowstyle": "->", "color": canvas.ANF, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (beside, f[end]), (beside, f[start]), arrowprops=look)
    words = f"{f[end] - f[start]:+.1f} Hz{after}".replace("-", "−")
    canvas.note(axes, words, (beside, f[start]), (-2, 4), colour=canvas.ANF)


def _backlash(axes: Axes, series: dict[str, Array], time: _Days, what: str) -> None:
    days, reading = series["days"], 1e6 * series["backlash"]
    half = 1e6 * COVERAGE * series["backlash_uncertainty"]
    draw_bars(axes, days, reading, half, "s", ms=4, color=canvas.BACKLASH, label=f"{what}, 95 %")
    if "true_backlash" in series:
        axes.plot(days, 1e6 * series["true_backlash"], label="true backlash", marker="o", ms=2.2, **TRUE)
    axes.set_ylabel(f"{what} (µm)")
    _legend(axes, "upper left")
    if time.backlash is not None:
        words = f"backlash: day {time.backlash:g}"
        canvas.note(
            axes,
            words,
            (time.backlash, 0.5),
            (-4, 0),
            coords=canvas.TOP_EDGE,
            colour=canvas.BACKLASH,
            size=10,
        )


def _legend(axes: Axes, where: Any) -> None:
    """Legend with the measured series first."""
    pairs = sorted(zip(*axes.get_legend_handles_labels(), strict=True), key=lambda p: "95 %" not in p[1])
    axes.legend(*zip(*pairs, strict=True), loc=where, fontsize=9)
