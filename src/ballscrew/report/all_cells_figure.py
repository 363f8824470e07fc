"""How every cell's natural frequency has changed since the first run: a map a condition, position × day."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.modal.run import Run
from ballscrew.report.canvas import blank, styled
from ballscrew.report.measured import cell_of
from ballscrew.report.shift_figure import check_days, day_edges, mark_backlash
from ballscrew.report.style import CHANGE_MAP, CONDITION_COLOURS, HATCH, REFUSED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["changes", "draw_all_cells"]


def changes(runs: Sequence[Run], condition: str, positions: Sequence[float], motion: int = 0) -> Array:
    """Change of each cell's frequency since it was first read.

    Parameters
    ----------
    runs : sequence of Run
        In the order of time.
    condition : str
        PA, PD, NA or ND.
    positions : sequence of float
        Of the stops, m.
    motion : int
        Which motion, from 0.

    Returns
    -------
    ndarray, shape (positions, runs)
        Hz; NaN where refused; −inf where no run has such a cell.
    """
    found = np.full((len(positions), len(runs)), np.nan)
    for row, position in zip(found, positions, strict=True):
        cells = [cell_of(run, position, condition, motion) for run in runs]
        if all(cell is None for cell in cells):
            row[:] = -np.inf
            continue
        f = [np.nan if c is None or c.frequency_Hz is None else c.frequency_Hz for c in cells]
        known = np.flatnonzero(np.isfinite(f))
        if known.size:
            row[:] = np.asarray(f) - f[known[0]]
    return found


def draw_all_cells(
    days: Sequence[float], runs: Sequence[Run], *, backlash_day: float | None = None, motion: int = 0
) -> Figure:
    """Draw the change of the natural frequency of every cell.

    Parameters
    ----------
    days : sequence of float
        Of the runs, ascending.
    runs : sequence of Run
        One a day.
    backlash_day : float, optional
        Day on which backlash begins; marked.
    motion : int
        Which motion, from 0.

    Returns
    -------
    Figure
        Not yet written. Refused cells are grey and hatched, those that the plan lacks are white; a dot
        stands on the reading that a cell is compared with, the first that it has.

    Raises
    ------
    InputError
        If the numbers of days and runs differ, days do not ascend, or no run has a cell.
    """
    check_days(days, runs)
    positions = sorted({cell.position_m for run in runs for cell in run.cells if cell.motion == motion})
    if not positions:
        raise InputError(f"no run has a cell of motion {motion}; there is nothing to draw")
    maps = {name: changes(runs, name, positions, motion) for name in CONDITION_COLOURS}
    most = max((np.abs(part[np.isfinite(part)]).max(initial=0.0) for part in maps.values()), default=0.0)
    with styled():
        from matplotlib.colors import Normalize

        figure = blank(9.4, 7.4, 0.04)
        grid: Any = figure.subplots(2, 2, sharex=True, sharey=True)
        mesh = None
        for index, (axes, (condition, values)) in enumerate(zip(grid.flat, maps.items(), strict=True)):
            mesh = _map(axes, days, positions, values, Normalize(-(most or 1.0), most or 1.0))
            axes.set_title(condition, color=CONDITION_COLOURS[condition], loc="left")
            if index > 1:
                axes.set_xlabel("time (days)")
            if index % 2 == 0:
                axes.set_ylabel("position (mm)")
            if backlash_day is not None:
                mark_backlash(axes, backlash_day, named=index == 0)
        assert mesh is not None  # noqa: S101  there are four conditions
        bar = figure.colorbar(mesh, ax=list(grid.flat), aspect=35, pad=0.015)
        # Equal colours for equal changes up and down; only what there is of them is told.
        bar.ax.set_ylim(*_told(maps.values(), most or 1.0))
        bar.set_label("change of the ANF since its first reading (Hz)")
        _legend(figure)
    return figure


def _told(maps: Iterable[Array], most: float) -> tuple[float, float]:
    """From the largest fall to the largest rise, and a little of the other side."""
    seen = np.concatenate([part[np.isfinite(part)] for part in maps])
    low, high = seen.min(initial=0.0), seen.max(initial=0.0)
    return min(low, -0.1 * most), max(high, 0.1 * most)


def _map(axes: Axes, days: Sequence[float], positions: Sequence[float], values: Array, norm: Any) -> Any:
    edges, rows = day_edges(days), np.arange(len(positions) + 1) - 0.5
    axes.grid(visible=False)
    refused = np.isnan(values)
    # Hatching needs a patch, one a run of days.
    for row in range(len(positions)):
        turns = np.flatnonzero(np.diff(np.concatenate([[0], refused[row].astype(int), [0]])))
        for first, last in zip(turns[::2], turns[1::2], strict=True):
            axes.broken_barh(
                [(edges[first], edges[last] - edges[first])], (row - 0.5, 1), fc=REFUSED, ec="0.55",
                hatch=HATCH, lw=0, zorder=0.5,
            )  # fmt: skip
    mesh = axes.pcolormesh(
        edges, rows, np.ma.masked_invalid(values), norm=norm, cmap=CHANGE_MAP, rasterized=True, zorder=1
    )
    for row, line in enumerate(values):
        known = np.flatnonzero(np.isfinite(line))
        if known.size:
            axes.plot(days[known[0]], row, "o", color="0.25", ms=2.4, zorder=2)
    axes.set(xlim=(edges[0], edges[-1]), ylim=(rows[0], rows[-1]))
    shown = range(0, len(positions), -(-len(positions) // 12))
    axes.set_yticks(list(shown), [f"{1e3 * positions[row]:g}" for row in shown])
    return mesh


def _legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries = [
        Line2D([], [], linestyle="none", marker="o", ms=2.4, color="0.25", label="first reading"),
        Patch(fc=REFUSED, ec="0.55", hatch=HATCH, lw=0, label="refused"),
        Patch(fc="white", ec="0.7", lw=0.6, label="no such cell"),
    ]
    figure.legend(handles=entries, loc="outside upper right", ncols=3, fontsize=9)
