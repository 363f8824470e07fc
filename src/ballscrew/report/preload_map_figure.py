"""Preload along the axis and over time as a map, and the preload of every run above it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes, Figure
from ballscrew.report.measured import draw_bars, draw_refused, interval_bars
from ballscrew.report.shift_figure import day_edges, position_ticks

PRELOAD_MAP = "cividis"
_WORN_PLACE = "#D55E00"


@canvas.styled()
def draw_preload_map(estimates: Sequence[PreloadEstimate]) -> Figure:
    """Draw P(x, t).

    Parameters
    ----------
    estimates : sequence of PreloadEstimate
        Estimates of several runs of one axis, all relative to one baseline, or all without a baseline.

    Returns
    -------
    Figure
        Not yet written. Above the ratio of each run with its interval, below the map; a run that was refused
        or has no P(x) is grey and hatched, a place that is locally worn is framed.

    Raises
    ------
    InputError
        If there are fewer than two runs, no run has P(x), or they have different baselines.
    """
    if len(estimates) < 2:
        raise InputError("a map over time takes two runs or more.")
    if len({estimate.baseline for estimate in estimates}) > 1:
        raise InputError("the runs have different baselines; a map takes a single one.")
    days, unit = _days(estimates)
    order = np.argsort(days, kind="stable")
    days, runs = days[order], [estimates[i] for i in order]
    stops, values = _along(runs)
    reference = "P over the model’s"
    if runs[0].baseline is not None:
        reference = "P/P₀"
    figure = canvas.blank(8.6, 6.6)
    figure.suptitle(canvas.escape_dollars(_title(runs)), fontsize=11.5, x=0.01, ha="left", fontweight="bold")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1, 1.5))
    _trend(above, days, runs)
    above.set_ylabel(reference)
    mesh = _map(below, days, stops, values)
    _frame_worn_places(below, days, stops, runs)
    below.set_xlabel(unit)
    if unit == "run":
        below.set_xticks(days)
    bar = figure.colorbar(mesh, ax=below, aspect=18, pad=0.015)
    bar.set_label(reference.replace("P", "P(x)", 1))
    return figure


def _title(runs: Sequence[PreloadEstimate]) -> str:
    """Axis and dates, ``"bench, 2026-01-05 to 2026-01-25"``."""
    dates = [str(run.measured_at)[:10] for run in runs if run.measured_at]
    name = runs[0].axis or "axis"
    return f"{name}, {min(dates)} to {max(dates)}" if dates else name


def _days(estimates: Sequence[PreloadEstimate]) -> tuple[Array, str]:
    """Days since the first run; the number of the run where times are missing or equal."""
    numbers = np.arange(1.0, len(estimates) + 1)
    times = []
    for estimate in estimates:
        try:
            time = datetime.fromisoformat(estimate.measured_at or "")
        except ValueError:
            return numbers, "run"
        if time.tzinfo is None:
            time = time.replace(tzinfo=UTC)
        times.append(time.timestamp())
    days = (np.array(times) - min(times)) / 86400
    if len(np.unique(days)) < len(days):
        return numbers, "run"
    return days, "time (days)"


def _along(runs: Sequence[PreloadEstimate]) -> tuple[list[float], Array]:
    """Stops, and P(x) of each run there; NaN where a run has none."""
    stops: set[float] = set()
    for run in runs:
        if run.profile is not None:
            stops.update(run.profile.position)
    if not stops:
        raise InputError("no run has the preload along the axis; there is nothing to draw.")
    places = sorted(stops)
    values = np.full((len(places), len(runs)), np.nan)
    for column, run in zip(values.T, runs, strict=True):
        if run.profile is not None:
            column[np.searchsorted(places, run.profile.position)] = [
                ratio.value for ratio in run.profile.ratio
            ]
    return places, values


def _trend(axes: Axes, days: Array, runs: Sequence[PreloadEstimate]) -> None:
    nut, nut_lengths = interval_bars(run.relative_to_baseline or run.relative_to_model for run in runs)
    axes.errorbar(days, nut, yerr=nut_lengths, fmt="none", ecolor="0.8", elinewidth=4.0, zorder=1)
    values, lengths = interval_bars(
        run.stiffness_relative_to_baseline or run.relative_to_model for run in runs
    )
    good = np.array([run.verdict == "good" for run in runs])
    known = np.isfinite(values)
    for chosen, face in ((known & good, canvas.ANF), (known & ~good, "white")):
        half = lengths[:, chosen]
        draw_bars(axes, days[chosen], values[chosen], half, "o", lw=1.0, color=canvas.ANF, mfc=face)
    draw_refused(axes, days[~known], "0.3")
    title = "Axial stiffness as P/P₀, and the nut's preload (grey), 95 %; open: suspect, ×: refused"
    axes.set_title(title, loc="left")


def _map(axes: Axes, days: Array, stops: Sequence[float], values: Array) -> Any:
    edges, rows = day_edges(days), np.arange(len(stops) + 1) - 0.5
    axes.grid(visible=False)
    for column in np.flatnonzero(np.isnan(values).all(axis=0)):
        axes.axvspan(edges[column], edges[column + 1], ec="0.55", zorder=0.5, **canvas.REFUSED_LOOK)
    mesh = axes.pcolormesh(
        edges, rows, np.ma.masked_invalid(values), cmap=PRELOAD_MAP, rasterized=True, zorder=1
    )
    position_ticks(axes, stops)
    axes.set(xlim=(edges[0], edges[-1]), ylim=(rows[0], rows[-1]), ylabel="position (mm)")
    axes.set_title("Preload along the axis; framed: locally worn", loc="left")
    return mesh


def _frame_worn_places(
    axes: Axes, days: Array, stops: Sequence[float], runs: Sequence[PreloadEstimate]
) -> None:  # fmt: skip
    edges = day_edges(days)
    for column, run in enumerate(runs):
        if run.profile is None or not run.profile.places:
            continue
        places = run.profile.places
        first, last = stops.index(places[0]) - 0.5, stops.index(places[-1]) + 0.5
        left, right = edges[column], edges[column + 1]
        axes.plot(
            [left, right, right, left, left], [first, first, last, last, first], color=_WORN_PLACE, lw=1.6,
            zorder=2,
        )  # fmt: skip
