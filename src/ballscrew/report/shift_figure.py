"""Change of the FRF and its natural frequency with the preload: Fig. 11 of the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.modal.cell import CellResult
from ballscrew.modal.paper.peak import first_peak
from ballscrew.modal.run import Run
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes, Figure
from ballscrew.report.measured import (
    CellArrays,
    Response,
    cell_of,
    draw_refused,
    plain_numbers,
    response_of,
    true_at,
)

Cell = tuple[float, str]

_AROUND = 0.35  # of the frequency, shown on either side
_POINT: Any = {"mfc": "#F0E442", "mec": "black", "mew": 0.6, "ms": 8}
_GENTLE: Any = {"mfc": "#56B4E9", "mec": "black", "mew": 0.6, "ms": 5.5}
_PEAK: Any = {"mfc": "none", "mec": "white", "mew": 1.2, "ms": 5}
_MOST_STOPS = 12  # with a label each


@dataclass(frozen=True, slots=True, eq=False)
class _Panel:
    """One cell on all days.

    Parameters
    ----------
    frequency : ndarray, shape (n,)
        Frequencies shown, Hz.
    magnitude : ndarray, shape (days, n)
        Magnitude of the FRF; NaN on a day without one.
    cells : CellArrays
        Result of each day.
    true : ndarray, shape (days,)
        True frequency, Hz; NaN where it is unknown.
    unit : str
        Unit of the input.
    peak : ndarray, shape (days,)
        Peak of the FRF on a day without a natural frequency, Hz; else NaN.
    gentle : CellArrays
        Result of each day with a gentler motion.
    """

    frequency: Array
    magnitude: Array
    cells: CellArrays
    true: Array
    unit: str
    peak: Array
    gentle: CellArrays

    @property
    def missing(self) -> NDArray[np.bool_]:
        """Days without an FRF, as a mask."""
        return np.asarray(np.isnan(self.magnitude).all(axis=1))


def draw_shift(
    days: Sequence[float],
    runs: Sequence[Run],
    cells: Sequence[Cell],
    *,
    truths: Sequence[Mapping[float, float]] | None = None,
    backlash_day: float | None = None,
    motion: int = 0,
    gentle: Mapping[float, Run] | None = None,
) -> Figure:
    """Draw the magnitude of the FRF as a colour against day and frequency, a panel a cell.

    Parameters
    ----------
    days : sequence of float
        Days of the runs, ascending.
    runs : sequence of Run
        One a day.
    cells : sequence of (float, str)
        Position, m, and condition of each panel.
    truths : sequence of mapping, optional
        One a day: position, m, to true frequency, Hz; empty where a nut without preload has none.
    backlash_day : float, optional
        Day on which backlash begins; marked.
    motion : int
        Number of the motion, from 0.
    gentle : mapping of float to Run, optional
        Runs with a gentler motion by day.

    Returns
    -------
    Figure
        Not yet written. Where no natural frequency was measured, the peak of the FRF is marked, which depends
        on the amplitude of the test. A cell that was refused on a day by all motions has a cross there; one
        without FRF is hatched.

    Raises
    ------
    InputError
        If the numbers of days, runs and truths differ, days do not ascend, a run contains no frequency
        response, or no run has one for a cell.
    """
    check_days(days, runs, truths)
    if not cells:
        raise InputError("no cell was given; the picture needs one or more")
    further = [(gentle or {}).get(day) for day in days]
    panels = [_panel(runs, further, cell, motion, truths) for cell in cells]
    return _draw(days, cells, panels, backlash_day, true=truths is not None)


@canvas.styled()
def _draw(
    days: Sequence[float],
    cells: Sequence[Cell],
    panels: Sequence[_Panel],
    backlash_day: float | None,
    *,
    true: bool,
) -> Figure:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    columns = min(2, len(cells))
    lines = -(-len(cells) // columns)
    figure = canvas.blank((6.2, 9.4)[columns - 1], 3.4 * lines + 0.9, 0.05)
    grid: Any = figure.subplots(lines, columns, sharex=True, squeeze=False)
    magnitudes = np.concatenate([panel.magnitude.ravel() for panel in panels])
    scale = ScalarMappable(LogNorm(*np.nanpercentile(magnitudes, (2, 99.8))), canvas.FRF_MAP)
    for index, (axes, cell, panel) in enumerate(zip(grid.flat, cells, panels, strict=False)):
        _magnitudes(axes, days, panel, scale.norm)
        _frequencies(axes, np.asarray(days, dtype=np.float64), panel)
        axes.set_title(panel_title(index, cell), loc="left", color=canvas.CONDITION_COLOURS[cell[1]])
        if backlash_day is not None:
            mark_backlash(axes, backlash_day, named=index == 0)
    for axes in grid[:, 0]:
        axes.set_ylabel("frequency (Hz)")
    for axes in grid.flat[len(cells) - columns : len(cells)]:
        axes.set_xlabel("time (days)")
        axes.tick_params(labelbottom=True)
    for spare in grid.flat[len(cells) :]:
        spare.remove()
    bar = figure.colorbar(scale, ax=list(figure.axes), aspect=35, pad=0.015, extend="both")
    bar.set_label(f"|FRF| (m/s² per {panels[0].unit})")
    plain_numbers(bar.ax)
    _legend(figure, panels, true=true)
    return figure


def panel_title(index: int, cell: Cell) -> str:
    """Letter and cell of a panel, ``"(a) 90 mm, ND"``."""
    return f"({'abcdefgh'[index % 8]}) {1e3 * cell[0]:g} mm, {cell[1]}"


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
    counts = f"{len(days)} days, {len(runs)} runs"
    same = len(days) == len(runs)
    if truths is not None:
        counts += f" and {len(truths)} truths"
        same = same and len(truths) == len(days)
    if not same:
        raise InputError(f"{counts} were given; there must be one a day")
    if len(days) < 2 or not np.all(np.diff(days) > 0):
        raise InputError(
            f"{len(days)} days were given; there must be 2 or more, and each later than the last"
        )


def day_edges(days: Sequence[float] | Array) -> Array:
    """Edges between the colours of neighbouring days: half-way.

    Parameters
    ----------
    days : sequence of float
        n days, ascending.

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
        Axes with days along x.
    day : float
        The day.
    named : bool
        Whether the name is written.
    """
    axes.axvline(day, color="white", lw=2.6, zorder=3)
    axes.axvline(day, color=canvas.BACKLASH, lw=1.3, zorder=3.1)
    if named:
        words = f"backlash: day {day:g}"
        canvas.note(
            axes,
            words,
            (day, 1),
            (0, 3),
            coords=canvas.TOP_EDGE,
            colour=canvas.BACKLASH,
            size=8.5,
            fontweight="bold",
        )


def position_ticks(axes: Axes, positions: Sequence[float]) -> None:
    """Label the rows of a map with their positions, at most a dozen of them.

    Parameters
    ----------
    axes : Axes
        Axes with a row of the map at each integer.
    positions : sequence of float
        Position of each row, m.
    """
    rows = np.arange(0, len(positions), -(-len(positions) // _MOST_STOPS))
    axes.set_yticks(rows, [f"{1e3 * position:g}" for position in np.asarray(positions)[rows]])


def _panel(
    runs: Sequence[Run],
    gentle: Sequence[Run | None],
    cell: Cell,
    motion: int,
    truths: Sequence[Mapping[float, float]] | None,
) -> _Panel:
    position, condition = cell
    responses = [response_of(run, position, condition, motion) for run in runs]
    results = [cell_of(run, position, condition, motion) for run in runs]
    true = np.full(len(runs), np.nan)
    if truths is not None:
        true[:] = np.array([true_at(truth, position) for truth in truths], dtype=np.float64)
    first = next((response for response in responses if response is not None), None)
    if first is None:
        raise InputError(f"no run has a frequency response at {1e3 * position:g} mm, {condition}")
    cells = CellArrays.of(results)
    centre = _centre(cells, true, results, first)
    frequency = first.frequency[first.within((1 - _AROUND) * centre, (1 + _AROUND) * centre)]
    magnitude = np.full((len(runs), len(frequency)), np.nan)
    for row, response in zip(magnitude, responses, strict=True):
        if response is not None:
            row[:] = np.interp(
                frequency, response.frequency, response.magnitude, left=np.nan, right=np.nan
            )  # fmt: skip
    further = [None if run is None else cell_of(run, position, condition) for run in gentle]
    peak = np.full(len(runs), np.nan)
    for day in np.flatnonzero(cells.refused):
        found = first_peak(frequency, magnitude[day])
        if found is not None:
            peak[day] = found.frequency
    return _Panel(frequency, magnitude, cells, true, first.unit, peak, CellArrays.of(further))


def _centre(
    cells: CellArrays, true: Array, results: Sequence[CellResult | None], response: Response
) -> float:
    """Middle of the frequencies shown: measured, else true, else of the bands, Hz."""
    bands = np.array([cell.band_Hz for cell in results if cell is not None and cell.band_Hz is not None])
    for frequencies in (cells.frequency, true, bands.reshape(-1, 2).mean(axis=1)):
        known = frequencies[np.isfinite(frequencies)]
        if known.size:
            return float(np.median(known))
    return float(response.frequency.mean())


def _magnitudes(axes: Axes, days: Sequence[float], panel: _Panel, norm: Any) -> None:
    """Draw the map of the FRF."""
    step = (panel.frequency[1] - panel.frequency[0]) / 2
    axes.grid(visible=False)
    axes.set_facecolor(canvas.REFUSED)
    edges = day_edges(days)
    heights = np.append(panel.frequency - step, panel.frequency[-1] + step)
    for day in np.flatnonzero(panel.missing):
        axes.axvspan(edges[day], edges[day + 1], ec="0.5", zorder=0.5, **canvas.REFUSED_LOOK)
    magnitude = np.ma.masked_invalid(panel.magnitude).T
    axes.pcolormesh(edges, heights, magnitude, norm=norm, cmap=canvas.FRF_MAP, rasterized=True, zorder=1)
    axes.set(xlim=(edges[0], edges[-1]), ylim=(heights[0], heights[-1]))


def _frequencies(axes: Axes, days: Array, panel: _Panel) -> None:
    """Draw true and measured natural frequencies, and crosses where it was refused."""
    if np.isfinite(panel.true).any():
        axes.plot(days, panel.true, color="black", lw=2.8, zorder=3, label="_halo")
        axes.plot(days, panel.true, color="white", lw=1.2, zorder=3, label="true")
    measured = ~panel.cells.refused
    if measured.any():
        x, f, half = days[measured], panel.cells.frequency[measured], panel.cells.half[measured]
        # Dark around light, since the map below may be either.
        axes.errorbar(x, f, yerr=half, fmt="none", elinewidth=2.6, ecolor="black", zorder=3.8)
        axes.errorbar(
            x, f, yerr=half, fmt="*", elinewidth=1.2, ecolor="white", zorder=4, label="ANF", **_POINT
        )  # fmt: skip
    gentle = ~panel.gentle.refused & ~measured
    if gentle.any():
        x, f, half = days[gentle], panel.gentle.frequency[gentle], panel.gentle.half[gentle]
        axes.errorbar(x, f, yerr=half, fmt="none", elinewidth=2.6, ecolor="black", zorder=3.8)
        axes.errorbar(
            x, f, yerr=half, fmt="D", elinewidth=1.2, ecolor="white", zorder=4, label="gentle", **_GENTLE
        )  # fmt: skip
    axes.plot(days, panel.peak, "o", zorder=3.6, label="peak", **_PEAK)
    draw_refused(axes, days[~measured & ~gentle], "0.2")


def _legend(figure: Figure, panels: Sequence[_Panel], *, true: bool) -> None:
    from matplotlib.patheffects import Normal, Stroke

    entries = [canvas.legend_mark("ANF, 95 %", marker="*", **_POINT)]
    if not np.concatenate([panel.gentle.refused for panel in panels]).all():
        entries.append(canvas.legend_mark("by a gentler motion", marker="D", **_GENTLE))
    if np.isfinite(np.concatenate([panel.peak for panel in panels])).any():
        look = _PEAK | {"mec": "0.2"}
        entries.append(canvas.legend_mark("FRF’s peak: depends on amplitude", marker="o", **look))
    if true:
        edge = [Stroke(linewidth=2.8, foreground="black"), Normal()]
        entries.append(canvas.legend_line("true", color="white", lw=1.2, path_effects=edge))
    if np.concatenate([panel.cells.refused for panel in panels]).any():
        entries.append(canvas.legend_mark("refused", marker="x", color="0.2", mew=1.3))
    if np.concatenate([panel.missing for panel in panels]).any():
        entries.append(canvas.legend_patch("no FRF", ec="0.5", **canvas.REFUSED_LOOK))
    figure.legend(handles=entries, loc="outside upper right", ncols=len(entries), fontsize=9)
