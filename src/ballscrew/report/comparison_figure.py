"""Measured frequencies beside those of the theory: Figs. 9 and 10 of the paper, and their errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.axis.frequency import axial_natural_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.tolerances import with_uncertainty
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.modal.run import CellResult, Run
from ballscrew.report.axis_figures import ROTOR_COLOURS
from ballscrew.report.canvas import blank, styled
from ballscrew.report.measured import (
    COVERAGE,
    TRUE,
    beside,
    cell_of,
    draw_interval,
    draw_refused,
    draw_true,
    pitch,
    true_at,
    true_curve,
)
from ballscrew.report.style import CONDITION_COLOURS, no_formula

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_against_load", "draw_against_position"]

Rows = Mapping[str, tuple[tuple[float, CellResult], ...]]

_POINTS = 121
_DASHED = (0, (5, 2.5))
_ROOM = 0.1  # above the curves, for the legends


def draw_against_position(
    run: Run, sheet: DataSheet, *, truth: Mapping[float, float] | None = None, motion: int = 0
) -> Figure:
    """Draw frequency against position: Fig. 9.

    Parameters
    ----------
    run : Run
        One load.
    sheet : DataSheet
        As it is told, not as the axis is: its nominal preload and its tolerances.
    truth : mapping of float to float, optional
        Position, m, to true frequency, Hz. A third panel tells measured less true.
    motion : int
        Which motion, from 0.

    Returns
    -------
    Figure
        Not yet written.

    Raises
    ------
    InputError
        If the run has no cell of that motion, or says no load.
    """
    if run.mass_kg is None:
        raise InputError(f"the run {run.id[:12]} says no load; the theory needs one")
    load = run.mass_kg
    rows = {
        condition: tuple(
            (cell.position_m, cell)
            for cell in run.cells
            if (cell.condition, cell.motion) == (condition, motion)
        )
        for condition in CONDITION_COLOURS
    }

    def theory(x: Array) -> tuple[Array, Array, Array]:
        free = with_uncertainty(sheet, x, load)
        return free.value, free.standard_uncertainty, axial_natural_frequency(sheet, x, load, rotor="held")

    title = f"{run.axis or 'axis'}, load {load:g} kg"
    return _draw(rows, theory, truth, ("position (mm)", 1e3), title)


def draw_against_load(
    runs: Mapping[float, Run],
    sheet: DataSheet,
    position: float = 0.0,
    *,
    truth: Mapping[float, float] | None = None,
    motion: int = 0,
) -> Figure:
    """Draw frequency against load at one stop: Fig. 10.

    Parameters
    ----------
    runs : mapping of float to Run
        By load, kg.
    sheet : DataSheet
        As it is told.
    position : float
        Of the stop, m.
    truth : mapping of float to float, optional
        Load, kg, to true frequency at that stop, Hz.
    motion : int
        Which motion, from 0.

    Returns
    -------
    Figure
        Not yet written.

    Raises
    ------
    InputError
        If no run has a cell there.
    """
    rows: dict[str, tuple[tuple[float, CellResult], ...]] = {}
    for condition in CONDITION_COLOURS:
        found = ((load, cell_of(runs[load], position, condition, motion)) for load in sorted(runs))
        rows[condition] = tuple((load, cell) for load, cell in found if cell is not None)

    def theory(load: Array) -> tuple[Array, Array, Array]:
        free = with_uncertainty(sheet, position, load)
        held = axial_natural_frequency(sheet, position, load, rotor="held")
        return free.value, free.standard_uncertainty, held

    return _draw(rows, theory, truth, ("load (kg)", 1.0), f"{sheet.name or 'axis'}, at {1e3 * position:g} mm")


def _draw(
    rows: Rows,
    theory: Callable[[Array], tuple[Array, Array, Array]],
    truth: Mapping[float, float] | None,
    scale: tuple[str, float],
    title: str,
) -> Figure:
    label, factor = scale
    places = sorted({place for cells in rows.values() for place, _ in cells})
    if not places:
        raise InputError("no run has a cell of that stop and motion; there is nothing to draw")
    reach = 0.3 * pitch(places)
    with styled():
        figure = blank(9.4, 7.6 if truth else 5.0, 0.04)
        grid = figure.add_gridspec(2 if truth else 1, 2, height_ratios=(1.7, 1) if truth else (1,))
        left = figure.add_subplot(grid[0, 0])
        right = figure.add_subplot(grid[0, 1], sharex=left, sharey=left)
        right.tick_params(labelleft=False)
        _theory(right, np.linspace(places[0], places[-1], _POINTS), theory, factor)
        _measured(left, rows, places, factor)
        if truth:
            x, f = true_curve(truth)
            draw_true(left, factor * x, f)
            draw_true(right, factor * x, f)
        left.set(ylabel="frequency (Hz)", xlabel=label)
        left.set_xlim(factor * (places[0] - reach), factor * (places[-1] + reach))
        right.set_xlabel(label)
        low, high = left.get_ylim()
        left.set_ylim(low, high + _ROOM * (high - low))
        left.set_title("(a) measured, with 95 %", loc="left")
        right.set_title("(b) theory, from the data sheet", loc="left")
        refused = _crosses(left, rows, places, factor)
        _legend(left, refused=refused, true=truth is not None)
        right.legend(loc="upper right", fontsize=8.5)
        if truth:
            below = figure.add_subplot(grid[1, :])
            _residual(below, rows, places, truth, factor)
            below.set(xlabel=label, ylabel="measured − true (Hz)")
            below.set_xlim(left.get_xlim())
        figure.suptitle(no_formula(title), fontweight="bold")
    return figure


def _theory(
    axes: Axes, x: Array, theory: Callable[[Array], tuple[Array, Array, Array]], factor: float
) -> None:
    free, uncertainty, held = theory(x)
    shown, half = factor * x, COVERAGE * uncertainty
    colour = ROTOR_COLOURS["free"]
    axes.fill_between(
        shown, free - half, free + half, color=colour, alpha=0.16, lw=0, label="its tolerances, 95 %"
    )
    axes.plot(shown, free, color=colour, lw=2, label="rotor free, shaft’s twist included")
    axes.plot(
        shown,
        held,
        color=ROTOR_COLOURS["held"],
        lw=1.7,
        ls=_DASHED,
        label="rotor held: Eq. (3) as the paper has it",
    )


def _measured(axes: Axes, rows: Rows, places: Sequence[float], factor: float) -> None:
    for condition, cells in rows.items():
        off = beside(places, condition)
        draw_interval(axes, [factor * (x + off) for x, _ in cells], [cell for _, cell in cells], condition)


def _crosses(axes: Axes, rows: Rows, places: Sequence[float], factor: float) -> bool:
    """A cross in its condition's colour for each cell that was refused."""
    some = False
    for condition, cells in rows.items():
        off = beside(places, condition)
        refused = [factor * (x + off) for x, cell in cells if cell.frequency_Hz is None]
        draw_refused(axes, refused, CONDITION_COLOURS[condition])
        some = some or bool(refused)
    return some


def _legend(axes: Axes, *, refused: bool, true: bool) -> None:
    from matplotlib.lines import Line2D

    handles, names = axes.get_legend_handles_labels()
    kept: list[Any] = [
        (handle, name) for handle, name in zip(handles, names, strict=True) if name in CONDITION_COLOURS
    ]
    if refused:
        kept.append((Line2D([], [], linestyle="none", marker="x", mew=1.3, ms=5, color="0.35"), "refused"))
    if true:
        kept.append((Line2D([], [], **TRUE, marker="o", ms=2.2), "true"))
    shown = [handle for handle, _ in kept]
    axes.legend(shown, [name for _, name in kept], loc="upper right", fontsize=8.5, ncols=2)


def _residual(
    axes: Axes, rows: Rows, places: Sequence[float], truth: Mapping[float, float], factor: float
) -> None:
    """Measured less true, and how many intervals hold the truth."""
    axes.axhline(0, **TRUE)
    errors, inside = [], 0
    for condition, cells in rows.items():
        known = [(x, cell, true_at(truth, x)) for x, cell in cells]
        off = beside(places, condition)
        base = [np.nan if f is None else f for _, _, f in known]
        x = [factor * (place + off) for place, _, _ in known]
        draw_interval(axes, x, [cell for _, cell, _ in known], condition, less=base)
        for _, cell, f in known:
            if f is not None and cell.frequency_Hz is not None:
                errors.append(cell.frequency_Hz - f)
                inside += abs(errors[-1]) <= COVERAGE * (cell.standard_uncertainty_Hz or 0.0)
    low, high = axes.get_ylim()
    axes.set_ylim(low - 0.06 * (high - low), high + 0.06 * (high - low))
    _crosses(axes, rows, places, factor)
    count = sum(len(cells) for cells in rows.values())
    words = "(c) every cell is refused"
    if errors:
        words = (
            f"(c) measured less true: {len(errors)} of {count} cells, median {np.median(errors):+.1f} Hz; "
            f"{inside} of {len(errors)} intervals hold the truth"
        ).replace("-", "−")
    axes.set_title(words, loc="left")
