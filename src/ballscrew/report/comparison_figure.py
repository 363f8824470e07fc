"""Measured frequencies beside those from the data sheet, as Figs. 9 and 10 of the paper, and their errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ballscrew.axis.frequency import axial_natural_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.tolerances import with_uncertainty
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.modal.run import Run
from ballscrew.report import canvas
from ballscrew.report.axis_figures import ROTOR_COLOURS
from ballscrew.report.canvas import Axes, Figure
from ballscrew.report.measured import (
    COVERAGE,
    TRUE,
    CellArrays,
    axis_title,
    beside,
    cell_of,
    draw_interval,
    draw_refused,
    draw_true,
    pitch,
    true_at,
)

_POINTS = 121
_DASHED = (0, (5, 2.5))
_HEADROOM = 0.1  # of the height above the curves, for the legends


@dataclass(frozen=True, slots=True, eq=False)
class _Series:
    """Cells of one condition along the picture.

    Parameters
    ----------
    x : ndarray, shape (cells,)
        Position, m, or load, kg.
    cells : CellArrays
        Results.
    """

    x: Array
    cells: CellArrays


@dataclass(frozen=True, slots=True, eq=False)
class _Comparison:
    """Contents of the picture.

    Parameters
    ----------
    series : dict of str to _Series
        By condition.
    theory : callable
        Places to frequency, its standard uncertainty, and frequency with the rotor held, Hz.
    truth : mapping of float to float
        Place to true frequency, Hz; empty where it is unknown.
    label : str
        Name and unit of the places.
    factor : float
        Unit of the places in SI over that of the label.
    """

    series: dict[str, _Series]
    theory: Callable[[Array], tuple[Array, Array, Array]]
    truth: Mapping[float, float]
    label: str
    factor: float

    @property
    def places(self) -> list[float]:
        """All places, ascending."""
        return sorted(set(np.concatenate([series.x for series in self.series.values()]).tolist()))

    def marks(self, condition: str) -> Array:
        """Places of a condition's marks in the unit of the label, beside their place."""
        return self.factor * (self.series[condition].x + beside(self.places, condition))


def draw_against_position(
    run: Run, sheet: DataSheet, *, truth: Mapping[float, float] | None = None, motion: int = 0
) -> Figure:
    """Draw frequency against position: Fig. 9.

    Parameters
    ----------
    run : Run
        Run with one load.
    sheet : DataSheet
        Data sheet with its nominal preload and its tolerances, which may differ from the axis.
    truth : mapping of float to float, optional
        Position, m, to true frequency, Hz. A third panel shows the errors.
    motion : int
        Number of the motion, from 0.

    Returns
    -------
    Figure
        Not yet written.

    Raises
    ------
    InputError
        If the run has no cell of that motion, or states no load.
    """
    if run.mass_kg is None:
        raise InputError(f"the run {run.id[:12]} states no load; the theory needs one")
    load = run.mass_kg
    series = {}
    for condition in canvas.CONDITION_COLOURS:
        cells = CellArrays.of(c for c in run.cells if (c.condition, c.motion) == (condition, motion))
        series[condition] = _Series(cells.position, cells)

    def theory(x: Array) -> tuple[Array, Array, Array]:
        free = with_uncertainty(sheet, x, load)
        return free.value, free.standard_uncertainty, axial_natural_frequency(sheet, x, load, rotor="held")

    return _draw(_Comparison(series, theory, truth or {}, "position (mm)", 1e3), axis_title(run))


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
        Data sheet.
    position : float
        Position of the stop, m.
    truth : mapping of float to float, optional
        Load, kg, to true frequency at that stop, Hz.
    motion : int
        Number of the motion, from 0.

    Returns
    -------
    Figure
        Not yet written.

    Raises
    ------
    InputError
        If no run has a cell there.
    """
    series = {}
    for condition in canvas.CONDITION_COLOURS:
        found = {}
        for load in sorted(runs):
            cell = cell_of(runs[load], position, condition, motion)
            if cell is not None:
                found[load] = cell
        series[condition] = _Series(np.array(list(found), dtype=np.float64), CellArrays.of(found.values()))

    def theory(load: Array) -> tuple[Array, Array, Array]:
        free = with_uncertainty(sheet, position, load)
        fixed = axial_natural_frequency(sheet, position, load, rotor="held")
        return free.value, free.standard_uncertainty, fixed

    title = f"{sheet.name or 'axis'}, at {1e3 * position:g} mm"
    return _draw(_Comparison(series, theory, truth or {}, "load (kg)", 1.0), title)


@canvas.styled()
def _draw(comparison: _Comparison, title: str) -> Figure:
    if not comparison.places:
        raise InputError("no run has a cell of that stop and motion; there is nothing to draw")
    if comparison.truth:
        figure = canvas.blank(9.4, 7.6, 0.04)
        grid = figure.add_gridspec(2, 2, height_ratios=(1.7, 1))
    else:
        figure = canvas.blank(9.4, 5.0, 0.04)
        grid = figure.add_gridspec(1, 2)
    measured = figure.add_subplot(grid[0, 0])
    predicted = figure.add_subplot(grid[0, 1], sharex=measured, sharey=measured)
    _compare(measured, predicted, comparison)
    if comparison.truth:
        errors = figure.add_subplot(grid[1, :])
        _errors(errors, comparison)
        errors.set_xlim(measured.get_xlim())
    figure.suptitle(canvas.escape_dollars(title), fontweight="bold")
    return figure


def _compare(measured: Axes, predicted: Axes, comparison: _Comparison) -> None:
    places, factor = comparison.places, comparison.factor
    _theory(predicted, comparison)
    for condition, series in comparison.series.items():
        draw_interval(measured, comparison.marks(condition), series.cells, condition)
    if comparison.truth:
        x, f = np.array(sorted(comparison.truth.items())).T
        draw_true(measured, factor * x, f)
        draw_true(predicted, factor * x, f)
    reach = 0.3 * pitch(places)
    measured.set_xlim(factor * (places[0] - reach), factor * (places[-1] + reach))
    low, high = measured.get_ylim()
    measured.set_ylim(low, high + _HEADROOM * (high - low))
    measured.set(ylabel="frequency (Hz)", xlabel=comparison.label)
    predicted.set_xlabel(comparison.label)
    predicted.tick_params(labelleft=False)
    measured.set_title("(a) measured, 95 % intervals", loc="left")
    predicted.set_title("(b) theory, from the data sheet", loc="left")
    refused = _crosses(measured, comparison)
    _legend(measured, refused=refused, true=bool(comparison.truth))
    predicted.legend(loc="upper right", fontsize=8.5)


def _theory(axes: Axes, comparison: _Comparison) -> None:
    places = comparison.places
    x = np.linspace(places[0], places[-1], _POINTS)
    free, uncertainty, fixed = comparison.theory(x)
    shown, half = comparison.factor * x, COVERAGE * uncertainty
    colour = ROTOR_COLOURS["free"]
    axes.fill_between(
        shown, free - half, free + half, color=colour, alpha=0.16, lw=0, label="tolerances, 95 %"
    )
    axes.plot(shown, free, color=colour, lw=2, label="rotor free, torsion of the shaft included")
    label = "rotor held: Eq. (3) of the paper"
    axes.plot(shown, fixed, color=ROTOR_COLOURS["held"], lw=1.7, ls=_DASHED, label=label)


def _crosses(axes: Axes, comparison: _Comparison) -> bool:
    """Draw a cross in its condition's colour for each refused cell; whether there is one."""
    some = False
    for condition, series in comparison.series.items():
        refused = comparison.marks(condition)[series.cells.refused]
        draw_refused(axes, refused, canvas.CONDITION_COLOURS[condition])
        some = some or refused.size > 0
    return some


def _legend(axes: Axes, *, refused: bool, true: bool) -> None:
    handles = []
    for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
        if name in canvas.CONDITION_COLOURS:
            handles.append(handle)
    if refused:
        handles.append(canvas.legend_mark("refused", marker="x", mew=1.3, ms=5, color="0.35"))
    if true:
        handles.append(canvas.legend_line("true", marker="o", ms=2.2, **TRUE))
    axes.legend(handles=handles, loc="upper right", fontsize=8.5, ncols=2)


def _errors(axes: Axes, comparison: _Comparison) -> None:
    """Draw measured less true frequencies, and count the intervals that contain the true value."""
    axes.axhline(0, **TRUE)
    errors, halves, count = [np.zeros(0)], [np.zeros(0)], 0
    for condition, series in comparison.series.items():
        known = np.array([true_at(comparison.truth, x) for x in series.x], dtype=np.float64)
        draw_interval(axes, comparison.marks(condition), series.cells, condition, reference=known)
        errors.append(series.cells.frequency - known)
        halves.append(series.cells.half)
        count += len(series.x)
    low, high = axes.get_ylim()
    axes.set_ylim(low - 0.06 * (high - low), high + 0.06 * (high - low))
    axes.set(xlabel=comparison.label, ylabel="measured − true (Hz)")
    _crosses(axes, comparison)
    axes.set_title(_error_title(np.concatenate(errors), np.concatenate(halves), count), loc="left")


def _error_title(error: Array, half: Array, count: int) -> str:
    known = np.isfinite(error)
    if not known.any():
        return "(c) every cell is refused"
    inside = np.sum(np.abs(error[known]) <= half[known])
    words = (
        f"(c) error: {known.sum()} of {count} cells, median {np.median(error[known]):+.1f} Hz; "
        f"{inside} of {known.sum()} intervals contain the true value"
    )
    return words.replace("-", "−")
