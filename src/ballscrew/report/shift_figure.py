"""How the FRF and its natural frequency go with the preload: Fig. 11 of the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.modal.run import CellResult, Run
from ballscrew.report.canvas import blank, styled
from ballscrew.report.measured import COVERAGE, cell_of, draw_refused, plain_numbers, response_of, true_at
from ballscrew.report.style import BACKLASH, CONDITION_COLOURS, FRF_MAP, HATCH, REFUSED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["check_days", "day_edges", "draw_shift", "mark_backlash"]

Cell = tuple[float, str]

_AROUND = 0.35  # of the frequency, shown on either side of it
_POINT: Any = {"mfc": "#F0E442", "mec": "black", "mew": 0.6, "ms": 8, "ecolor": "white"}


def draw_shift(
    days: Sequence[float],
    runs: Sequence[Run],
    cells: Sequence[Cell],
    *,
    truths: Sequence[Mapping[float, float]] | None = None,
    backlash_day: float | None = None,
    motion: int = 0,
) -> Figure:
    """Draw the magnitude of the FRF as a colour against day and frequency, a panel a cell.

    Parameters
    ----------
    days : sequence of float
        Of the runs, ascending.
    runs : sequence of Run
        One a day.
    cells : sequence of (float, str)
        Position, m, and condition of each panel.
    truths : sequence of mapping, optional
        One a day: position, m, to true frequency, Hz; empty where a nut without preload has none.
    backlash_day : float, optional
        Day on which backlash begins; marked.
    motion : int
        Which motion, from 0.

    Returns
    -------
    Figure
        Not yet written. A cell that was refused on a day has a cross there; one without FRF is hatched.

    Raises
    ------
    InputError
        If the numbers of days, runs and truths differ, days do not ascend, a run holds no frequency
        response, or no run has one for a cell.
    """
    check_days(days, runs, truths)
    if not cells:
        raise InputError("no cell was given; the picture needs one or more")
    panels = [_panel_data(runs, cell, motion, truths) for cell in cells]
    seen = np.concatenate([values[np.isfinite(values)] for _, _, values, _ in panels])
    low, high = np.percentile(seen, (2, 99.8))
    columns = min(2, len(cells))
    lines = -(-len(cells) // columns)
    with styled():
        from matplotlib.colors import LogNorm

        figure = blank(9.4 if columns == 2 else 6.2, 3.4 * lines + 0.9, 0.05)
        grid: Any = figure.subplots(lines, columns, sharex=True, squeeze=False)
        norm, mesh = LogNorm(low, high), None
        for index, (axes, cell, panel) in enumerate(zip(grid.flat, cells, panels, strict=False)):
            mesh = _panel(axes, days, panel, norm)
            axes.set_title(
                f"({'abcdefgh'[index % 8]}) {1e3 * cell[0]:g} mm, {cell[1]}", loc="left",
                color=CONDITION_COLOURS[cell[1]],
            )  # fmt: skip
            if index % columns == 0:
                axes.set_ylabel("frequency (Hz)")
            if index + columns >= len(cells):
                axes.set_xlabel("time (days)")
                axes.tick_params(labelbottom=True)
            if backlash_day is not None:
                mark_backlash(axes, backlash_day, named=index == 0)
        for spare in list(grid.flat)[len(cells) :]:
            spare.remove()
        assert mesh is not None  # noqa: S101  there is a cell
        unit = next(part[3] for part in panels)
        bar = figure.colorbar(mesh, ax=list(figure.axes), aspect=35, pad=0.015, extend="both")
        bar.set_label(f"|FRF| (m/s² per {unit})")
        plain_numbers(bar.ax)
        _legend(figure, panels, true=truths is not None)
    return figure


def check_days(
    days: Sequence[float], runs: Sequence[Run], truths: Sequence[Mapping[float, float]] | None = None
) -> None:
    """Refuse days that do not belong to the runs.

    Parameters
    ----------
    days, runs, truths
        As in :func:`draw_shift`.

    Raises
    ------
    InputError
        If their numbers differ, there are fewer than two, or the days do not ascend.
    """
    if len(days) != len(runs) or (truths is not None and len(truths) != len(days)):
        told = "" if truths is None else f" and {len(truths)} truths"
        raise InputError(f"{len(days)} days, {len(runs)} runs{told} were given; there must be one a day")
    if len(days) < 2 or not np.all(np.diff(days) > 0):
        raise InputError(
            f"{len(days)} days were given; there must be 2 or more, and each later than the last"
        )


def day_edges(days: Sequence[float]) -> Array:
    """Where one day's colour ends and the next one's starts: half-way.

    Parameters
    ----------
    days : sequence of float
        Ascending, n of them.

    Returns
    -------
    ndarray, shape (n + 1,)
        Days.
    """
    at = np.asarray(days, dtype=np.float64)
    middle = (at[1:] + at[:-1]) / 2
    return np.concatenate([[2 * at[0] - middle[0]], middle, [2 * at[-1] - middle[-1]]])


def mark_backlash(axes: Axes, day: float, *, named: bool) -> None:
    """Mark the day on which backlash begins: a line from edge to edge, and its name above it.

    Parameters
    ----------
    axes : Axes
        Days go across.
    day : float
        When.
    named : bool
        Whether it is written.
    """
    axes.axvline(day, color="white", lw=2.6, zorder=3)
    axes.axvline(day, color=BACKLASH, lw=1.3, zorder=3.1)
    if named:
        axes.annotate(
            f"backlash: day {day:g}", (day, 1), (0, 3), xycoords=("data", "axes fraction"), ha="center",
            textcoords="offset points", color=BACKLASH, fontsize=8.5, fontweight="bold",
        )  # fmt: skip


Panel = tuple[Array, list[tuple[CellResult | None, float | None]], Array, str]


def _panel_data(
    runs: Sequence[Run], cell: Cell, motion: int, truths: Sequence[Mapping[float, float]] | None
) -> Panel:
    """Frequencies, what was found and what is true on each day, magnitudes (day × frequency), unit."""
    responses = [response_of(run, *cell, motion) for run in runs]
    known = [part for part in responses if part is not None]
    if not known:
        raise InputError(f"no run has a frequency response at {1e3 * cell[0]:g} mm, {cell[1]}")
    found = [cell_of(run, *cell, motion) for run in runs]
    true = [None if truths is None else true_at(day, cell[0]) for day in truths or [{}] * len(runs)]
    seen = [c.frequency_Hz for c in found if c is not None and c.frequency_Hz is not None]
    seen = seen or [f for f in true if f is not None]
    seen = seen or [sum(c.band_Hz) / 2 for c in found if c is not None and c.band_Hz is not None]
    centre = float(np.median(seen)) if seen else float(known[0].frequency.mean())
    grid = known[0].frequency
    grid = grid[(grid >= (1 - _AROUND) * centre) & (grid <= (1 + _AROUND) * centre)]
    values = np.full((len(runs), len(grid)), np.nan)
    for row, part in zip(values, responses, strict=True):
        if part is not None:
            row[:] = np.interp(grid, part.frequency, part.magnitude, left=np.nan, right=np.nan)
    return grid, list(zip(found, true, strict=True)), values, known[0].unit


def _panel(axes: Axes, days: Sequence[float], panel: Panel, norm: Any) -> Any:
    grid, rows, values, _ = panel
    step = (grid[1] - grid[0]) / 2
    axes.grid(visible=False)
    axes.set_facecolor(REFUSED)
    edges = day_edges(days)
    heights = np.append(grid - step, grid[-1] + step)
    missing = np.isnan(values).all(axis=1)
    for left, right in zip(edges[:-1][missing], edges[1:][missing], strict=True):
        axes.axvspan(left, right, fc=REFUSED, ec="0.5", hatch=HATCH, lw=0, zorder=0.5)
    mesh = axes.pcolormesh(
        edges, heights, np.ma.masked_invalid(values).T, norm=norm, cmap=FRF_MAP, rasterized=True, zorder=1
    )
    true = [np.nan if f is None else f for _, f in rows]
    if np.isfinite(true).any():
        axes.plot(days, true, color="black", lw=2.8, zorder=3, label="_halo")
        axes.plot(days, true, color="white", lw=1.2, zorder=3, label="true")
    read = [(day, c) for day, (c, _) in zip(days, rows, strict=True) if c and c.frequency_Hz is not None]
    if read:
        half = [COVERAGE * (c.standard_uncertainty_Hz or 0.0) for _, c in read]
        at = [c.frequency_Hz or np.nan for _, c in read]
        x = [day for day, _ in read]
        # Dark around light, since what lies below may be either.
        axes.errorbar(x, at, yerr=half, fmt="none", elinewidth=2.6, ecolor="black", zorder=3.8)
        axes.errorbar(x, at, yerr=half, fmt="*", elinewidth=1.2, zorder=4, label="ANF", **_POINT)
    axes.set(xlim=(edges[0], edges[-1]), ylim=(heights[0], heights[-1]))
    refused = [day for day, (c, _) in zip(days, rows, strict=True) if c is None or c.frequency_Hz is None]
    draw_refused(axes, refused, "0.2")
    return mesh


def _legend(figure: Figure, panels: Sequence[Panel], *, true: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    look = {key: value for key, value in _POINT.items() if key != "ecolor"}
    entries: list[Any] = [Line2D([], [], linestyle="none", marker="*", label="ANF, 95 %", **look)]
    if true:
        entries.append(_outlined())
    if any(c is None or c.frequency_Hz is None for _, rows, _, _ in panels for c, _ in rows):
        entries.append(Line2D([], [], linestyle="none", marker="x", color="0.2", mew=1.3, label="refused"))
    if any(np.isnan(values).all(axis=1).any() for _, _, values, _ in panels):
        entries.append(Patch(fc=REFUSED, ec="0.5", hatch=HATCH, lw=0, label="no FRF"))
    figure.legend(handles=entries, loc="outside upper right", ncols=len(entries), fontsize=9)


def _outlined() -> Any:
    from matplotlib.lines import Line2D
    from matplotlib.patheffects import Normal, Stroke

    edge = [Stroke(linewidth=2.8, foreground="black"), Normal()]
    return Line2D([], [], color="white", lw=1.2, label="true", path_effects=edge)
