"""Preload along the axis and over time, in one map, and the fused preload of every run beside it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.report.canvas import blank, styled
from ballscrew.report.shift_figure import day_edges
from ballscrew.report.style import ANF, HATCH, REFUSED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["PRELOAD_MAP", "draw_preload_map"]

PRELOAD_MAP = "cividis"
_PLACE = "#D55E00"


def draw_preload_map(estimates: Sequence[PreloadEstimate]) -> Figure:
    """Draw P(x, t).

    Parameters
    ----------
    estimates : sequence of PreloadEstimate
        Of several runs of one axis, against one baseline or none of them against any.

    Returns
    -------
    Figure
        Not yet written. Above the ratio of each run with its interval, below the map; a run that was refused
        or does not tell P(x) is grey and hatched, a place that is found locally worn is framed.

    Raises
    ------
    InputError
        If there are fewer than two runs, no run tells P(x), or they have different baselines.
    """
    if len(estimates) < 2:
        raise InputError("a map over time takes two runs or more.")
    if len({one.baseline for one in estimates}) > 1:
        raise InputError("the runs were told against different baselines; a map takes one.")
    days, unit = _days(estimates)
    order = np.argsort(days, kind="stable")
    days, runs = [days[i] for i in order], [estimates[i] for i in order]
    stops = sorted({x for one in runs if one.along is not None for x in one.along.position})
    if not stops:
        raise InputError("no run tells the preload along the axis; there is nothing to draw.")
    values = np.full((len(stops), len(runs)), np.nan)
    for column, one in enumerate(runs):
        if one.along is not None:
            for x, ratio in zip(one.along.position, one.along.ratio, strict=True):
                values[stops.index(x), column] = ratio.value
    with styled():
        figure = blank(8.6, 6.4)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1, 1.5))
        _trend(above, days, runs)
        mesh = _map(below, days, stops, values, runs)
        below.set_xlabel(unit)
        if unit == "run":
            below.set_xticks(days)
        bar = figure.colorbar(mesh, ax=below, aspect=18, pad=0.015)
        bar.set_label("P(x)/P₀" if runs[0].baseline is not None else "P(x) over the model's")
    return figure


def _days(estimates: Sequence[PreloadEstimate]) -> tuple[list[float], str]:
    """Days since the first run; the number of the run where times are missing or the same."""
    try:
        times = [datetime.fromisoformat(one.measured_at or "") for one in estimates]
    except ValueError:
        times = []
    if times:
        aware = [time if time.tzinfo else time.replace(tzinfo=UTC) for time in times]
        days = [(time - min(aware)).total_seconds() / 86400 for time in aware]
        if len(set(days)) == len(days):
            return days, "time (days)"
    return [float(i + 1) for i in range(len(estimates))], "run"


def _trend(axes: Axes, days: Sequence[float], runs: Sequence[PreloadEstimate]) -> None:
    for day, one in zip(days, runs, strict=True):
        ratio = one.relative_to_baseline or one.relative_to_model
        if ratio is None:
            axes.plot(day, 0.0, "x", color="0.3", transform=axes.get_xaxis_transform(), clip_on=False)
            continue
        low, high = ratio.interval
        axes.errorbar(
            day, ratio.value, yerr=[[ratio.value - low], [high - ratio.value]], fmt="o", ms=4.5, capsize=2,
            lw=1.0, color=ANF, mfc=ANF if one.verdict == "good" else "white",
        )  # fmt: skip
    axes.set_ylabel("P/P₀" if runs[0].baseline is not None else "P over the model's")
    axes.set_title("All cells as one, 95 % intervals; open where suspect, × where refused", loc="left")


def _map(
    axes: Axes, days: Sequence[float], stops: Sequence[float], values: Array, runs: Sequence[PreloadEstimate]
) -> Any:
    edges, rows = day_edges(days), np.arange(len(stops) + 1) - 0.5
    axes.grid(visible=False)
    for column in range(len(days)):
        if np.isnan(values[:, column]).all():
            axes.axvspan(
                edges[column], edges[column + 1], fc=REFUSED, ec="0.55", hatch=HATCH, lw=0, zorder=0.5
            )
    mesh = axes.pcolormesh(
        edges, rows, np.ma.masked_invalid(values), cmap=PRELOAD_MAP, rasterized=True, zorder=1
    )
    for column, one in enumerate(runs):
        places = one.along.places if one.along is not None else ()
        if places:
            first, last = stops.index(places[0]) - 0.5, stops.index(places[-1]) + 0.5
            across = [edges[column], edges[column + 1], edges[column + 1], edges[column], edges[column]]
            axes.plot(across, [first, first, last, last, first], color=_PLACE, lw=1.6, zorder=2)
    shown = range(0, len(stops), -(-len(stops) // 12))
    axes.set_yticks(list(shown), [f"{1e3 * stops[row]:.0f}" for row in shown])
    axes.set(xlim=(edges[0], edges[-1]), ylim=(rows[0], rows[-1]), ylabel="position (mm)")
    axes.set_title("Along the axis; framed where wear is local", loc="left")
    return mesh
