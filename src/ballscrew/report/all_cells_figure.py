"""Change of every cell's natural frequency since the first run: a map a condition, position × day."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.modal.run import Run
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes, Figure
from ballscrew.report.measured import CellArrays, cell_of
from ballscrew.report.shift_figure import check_days, day_edges, mark_backlash, position_ticks


def changes(runs: Sequence[Run], condition: str, positions: Sequence[float], motion: int = 0) -> Array:
    """Change of each cell's frequency since its first value.

    Parameters
    ----------
    runs : sequence of Run
        In the order of time.
    condition : str
        PA, PD, NA or ND.
    positions : sequence of float
        Positions of the stops, m.
    motion : int
        Number of the motion, from 0.

    Returns
    -------
    ndarray, shape (positions, runs)
        Hz; NaN where refused; −inf where no run has such a cell.
    """
    found = np.full((len(positions), len(runs)), np.nan)
    for row, position in zip(found, positions, strict=True):
        cells = CellArrays.of(cell_of(run, position, condition, motion) for run in runs)
        known = np.flatnonzero(~cells.refused)
        if known.size:
            row[:] = cells.frequency - cells.frequency[known[0]]
        elif not cells.condition.any():
            row[:] = -np.inf
    return found


def draw_all_cells(
    days: Sequence[float], runs: Sequence[Run], *, backlash_day: float | None = None, motion: int = 0
) -> Figure:
    """Draw the change of the natural frequency of every cell.

    Parameters
    ----------
    days : sequence of float
        Days of the runs, ascending.
    runs : sequence of Run
        One a day.
    backlash_day : float, optional
        Day on which backlash begins; marked.
    motion : int
        Number of the motion, from 0.

    Returns
    -------
    Figure
        Not yet written. Refused cells are grey and hatched, cells that the plan lacks are white; a dot marks
        the first value of a cell, its reference.

    Raises
    ------
    InputError
        If the numbers of days and runs differ, days do not ascend, or no run has a cell.
    """
    check_days(days, runs)
    stops: set[float] = set()
    for run in runs:
        stops.update(cell.position_m for cell in run.cells if cell.motion == motion)
    if not stops:
        raise InputError(f"no run has a cell of motion {motion}; there is nothing to draw")
    positions = sorted(stops)
    maps = np.array([changes(runs, condition, positions, motion) for condition in canvas.CONDITION_COLOURS])
    return _draw(days, positions, maps, backlash_day)


@canvas.styled()
def _draw(
    days: Sequence[float], positions: Sequence[float], maps: Array, backlash_day: float | None
) -> Figure:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    known = maps[np.isfinite(maps)]
    most = float(np.abs(known).max(initial=0.0)) or 1.0
    scale = ScalarMappable(Normalize(-most, most), canvas.CHANGE_MAP)
    figure = canvas.blank(9.4, 7.4, 0.04)
    grid: Any = figure.subplots(2, 2, sharex=True, sharey=True)
    for index, (axes, condition, values) in enumerate(
        zip(grid.flat, canvas.CONDITION_COLOURS, maps, strict=True)
    ):
        _map(axes, days, values, scale.norm)
        position_ticks(axes, positions)
        axes.set_title(condition, color=canvas.CONDITION_COLOURS[condition], loc="left")
        if backlash_day is not None:
            mark_backlash(axes, backlash_day, named=index == 0)
    for axes in grid[:, 0]:
        axes.set_ylabel("position (mm)")
    for axes in grid[-1]:
        axes.set_xlabel("time (days)")
    bar = figure.colorbar(scale, ax=list(grid.flat), aspect=35, pad=0.015)
    # Equal colours for equal changes up and down; the scale shows only those that exist.
    low, high = known.min(initial=0.0), known.max(initial=0.0)
    bar.ax.set_ylim(min(low, -0.1 * most), max(high, 0.1 * most))
    bar.set_label("change of the ANF since its first value (Hz)")
    _legend(figure)
    return figure


def _map(axes: Axes, days: Sequence[float], values: Array, norm: Any) -> None:
    edges, rows = day_edges(days), np.arange(len(values) + 1) - 0.5
    axes.grid(visible=False)
    for row, line in enumerate(values):
        _hatch(axes, edges, row, np.isnan(line))
        known = np.flatnonzero(np.isfinite(line))
        if known.size:
            axes.plot(days[known[0]], row, "o", color="0.25", ms=2.4, zorder=2)
    axes.pcolormesh(
        edges,
        rows,
        np.ma.masked_invalid(values),
        norm=norm,
        cmap=canvas.CHANGE_MAP,
        rasterized=True,
        zorder=1,
    )
    axes.set(xlim=(edges[0], edges[-1]), ylim=(rows[0], rows[-1]))


def _hatch(axes: Axes, edges: Array, row: int, refused: Array) -> None:
    """Hatch the refused cells of one stop; a patch for each group of days, as hatching needs patches."""
    turns = np.flatnonzero(np.diff(np.concatenate([[0], refused.astype(int), [0]])))
    for first, last in turns.reshape(-1, 2):
        days = (edges[first], edges[last] - edges[first])
        axes.broken_barh([days], (row - 0.5, 1), ec="0.55", zorder=0.5, **canvas.REFUSED_LOOK)


def _legend(figure: Figure) -> None:
    entries = [
        canvas.legend_mark("first value", marker="o", ms=2.4, color="0.25"),
        canvas.legend_patch("refused", ec="0.55", **canvas.REFUSED_LOOK),
        canvas.legend_patch("not in the plan", fc="white", ec="0.7", lw=0.6),
    ]
    figure.legend(handles=entries, loc="outside upper right", ncols=3, fontsize=9)
