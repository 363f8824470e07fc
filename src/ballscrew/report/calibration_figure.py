"""Frequencies of all runs beside the calibrated model, and the residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ballscrew.axis.axial import PARAMETERS, frequency, gradient
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.words import plural
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.modal.run import Run
from ballscrew.report import canvas
from ballscrew.report.axis_figures import LOAD_MAP
from ballscrew.report.canvas import Axes, Figure
from ballscrew.report.measured import COVERAGE, CellArrays, draw_bars, plain_numbers

_CURVE = 81
_LOAD = 100.0  # kg, to which a model without runs is drawn
_STOPS = 4  # shown over the load, spread over the travel
_OFF = 0.012  # of the axis, from one series to the next in the panel of the residuals
_ZERO: Any = {"color": "0.3", "lw": 1.0, "zorder": 1}


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Measured cells and the model's frequency for each, as arrays of shape (cells,).

    Parameters
    ----------
    cells : CellArrays
        Measured, none refused.
    load : ndarray
        Load on the table, kg.
    group : ndarray
        Number of the preload.
    model : ndarray
        Frequency by the model, Hz.
    """

    cells: CellArrays
    load: Array
    group: Array
    model: Array

    def select(self, chosen: Any) -> Points:
        """Points chosen by a mask."""
        return Points(
            self.cells.select(chosen), self.load[chosen], self.group[chosen], self.model[chosen]
        )  # fmt: skip

    @property
    def residual(self) -> Array:
        """Measured over model less 1."""
        return self.cells.frequency / self.model - 1


def points(calibrated: CalibratedAxis, runs: Sequence[Run]) -> Points:
    """Cells of the runs that a model was calibrated with, beside the model.

    Parameters
    ----------
    calibrated : CalibratedAxis
        The model.
    runs : sequence of Run
        Runs that the model was calibrated with; others are ignored.

    Returns
    -------
    Points
        Without refused cells.
    """
    used = {run.id: run for run in calibrated.runs}
    listed, loads, groups, models = [], [], [], []
    for run in runs:
        if run.id not in used:
            continue
        group, load = used[run.id].group, used[run.id].load
        for cell in run.cells:
            if cell.verdict == "refused" or None in (cell.frequency_Hz, cell.standard_uncertainty_Hz):
                continue
            model, _ = predicted(calibrated, np.array(cell.position_m), np.array(load), group)
            listed.append(cell)
            loads.append(load)
            groups.append(group)
            models.append(float(model))
    return Points(CellArrays.of(listed), np.array(loads), np.array(groups), np.array(models))


def predicted(
    calibrated: CalibratedAxis, position: Array, load: Array, group: int = 0
) -> tuple[Array, Array]:
    """Frequency by the model, and its standard uncertainty.

    Parameters
    ----------
    calibrated : CalibratedAxis
        The model.
    position, load : ndarray
        m, kg.
    group : int
        Number of the preload.

    Returns
    -------
    frequency, uncertainty : ndarray
        Hz.
    """
    ratio = float(np.exp(calibrated.log_ratios[group]))
    f = frequency(calibrated.model, position, load, ratio)
    slopes = gradient(calibrated.model, position, load, ratio)
    own, size = slopes[..., : len(PARAMETERS)], len(PARAMETERS)
    covariance = np.zeros((size + 1, size + 1))
    covariance[:size, :size] = calibrated.covariance
    covariance[:size, size] = covariance[size, :size] = calibrated.cross_covariance[:, group]
    covariance[size, size] = calibrated.log_ratio_covariance[group, group]
    rows = np.concatenate([own, slopes[..., size:]], axis=-1)
    variance = np.einsum("...i,ij,...j->...", rows, covariance, rows)
    return f, f * np.sqrt(np.maximum(variance, 0.0))


@canvas.styled()
def draw_calibration(calibrated: CalibratedAxis, runs: Sequence[Run]) -> Figure:
    """Draw frequency against position and against load, and below each the residuals of the model.

    Parameters
    ----------
    calibrated : CalibratedAxis
        The model.
    runs : sequence of Run
        Runs that it was calibrated with.

    Returns
    -------
    Figure
        Not yet written.

    Raises
    ------
    InputError
        If none of the runs belongs to the model.
    """
    measured = points(calibrated, runs)
    if not measured.load.size:
        raise InputError("none of the runs belongs to this model; there is nothing to draw")
    figure = canvas.blank(10.4, 7.2, 0.05)
    grid: Any = figure.subplots(2, 2, sharex="col", height_ratios=(1.8, 1))
    _against_position(grid[:, 0], calibrated, measured)
    _against_load(grid[:, 1], calibrated, measured)
    for column, label in enumerate(("position (mm)", "load (kg)")):
        above, below = grid[:, column]
        above.legend(loc="best", fontsize=8.5, ncols=2)
        above.set_ylabel("frequency (Hz)")
        plain_numbers(above)
        below.axhline(0, **_ZERO)
        below.set(xlabel=label, ylabel="measured / model − 1 (%)")
    grid[0, 0].set_title("Frequency along the axis, model with 95 % band", loc="left")
    grid[0, 1].set_title("Frequency against load, at some stops", loc="left")
    rms = 100 * np.sqrt(np.mean(measured.residual**2))
    grid[1, 0].set_title(f"residuals: {rms:.2g} % (root mean square)", loc="left")
    suspect = ""
    if calibrated.reasons:
        suspect = f" (suspect for {plural(len(calibrated.reasons), 'reason')})"
    dates = [run.measured_at[:10] for run in calibrated.runs if run.measured_at]
    when = f", {min(dates)} to {max(dates)}" if dates else ""
    title = f"{calibrated.axis}{when}: measured frequencies and calibrated model{suspect}"
    figure.suptitle(canvas.escape_dollars(title), fontweight="bold")
    return figure


def draw_levels(axes: Axes, calibrated: CalibratedAxis) -> None:
    """Draw the frequency in the middle of the stops against the load, with the mean level of each run.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    calibrated : CalibratedAxis
        The model.
    """
    heaviest = max((run.load for run in calibrated.runs), default=0.0)
    loads = np.linspace(0.0, 1.05 * heaviest or _LOAD, _CURVE)
    groups = len(calibrated.log_ratios)
    place = np.array(calibrated.model.centre)
    for group, colour in enumerate(canvas.colours_of(LOAD_MAP, groups, 0.85)):
        name = f", preload {group + 1}" if groups > 1 else ""
        _curve(axes, loads, predicted(calibrated, np.full_like(loads, place), loads, group), colour)
        axes.lines[-1].set_label(f"model, 95 %{name}")
        own = [run for run in calibrated.runs if run.group == group]
        x = np.array([run.load for run in own])
        level = np.exp([run.level for run in own])
        f = predicted(calibrated, np.full_like(x, place), x, group)[0] * level
        axes.plot(x, f, "o", ms=5, color=colour, label=f"runs{name}")
    axes.set(xlabel="load (kg)", ylabel="frequency (Hz)")
    title = f"{calibrated.axis}: frequency at {1e3 * calibrated.model.centre:g} mm"
    axes.set_title(canvas.escape_dollars(title), loc="left")
    axes.legend()


def _against_position(panels: Any, calibrated: CalibratedAxis, measured: Points) -> None:
    """Draw a curve for each preload and load."""
    place = measured.cells.position
    x = np.linspace(place.min(), place.max(), _CURVE)
    keys = sorted(set(zip(measured.group.tolist(), measured.load.tolist(), strict=True)))
    for index, (group, load) in enumerate(keys):
        colour = canvas.colours_of(LOAD_MAP, len(keys), 0.85)[index]
        name = f"{load:g} kg"
        if len(calibrated.log_ratios) > 1:
            name += f", preload {group + 1}"
        own = measured.select((measured.group == group) & (measured.load == load))
        _curve(panels[0], 1e3 * x, predicted(calibrated, x, np.full_like(x, load), group), colour)
        off = _OFF * 1e3 * np.ptp(x) * (index - (len(keys) - 1) / 2)
        _marks(panels, own, 1e3 * own.cells.position, off, colour, name)


def _against_load(panels: Any, calibrated: CalibratedAxis, measured: Points) -> None:
    """Draw a curve for each of some stops, at the first preload."""
    first = measured.select(measured.group == 0)
    stops = np.unique(first.cells.position)
    shown = stops[np.unique(np.linspace(0, len(stops) - 1, _STOPS).astype(int))]
    loads = np.linspace(0.0, 1.05 * measured.load.max() or _LOAD, _CURVE)
    for index, (stop, colour) in enumerate(
        zip(shown, canvas.colours_of(canvas.POSITION_MAP, len(shown)), strict=True)
    ):
        own = first.select(first.cells.position == stop)
        _curve(panels[0], loads, predicted(calibrated, np.full_like(loads, stop), loads), colour)
        off = _OFF * loads[-1] * (index - (len(shown) - 1) / 2)
        _marks(panels, own, own.load, off, colour, f"{1e3 * stop:g} mm")


def _curve(axes: Axes, x: Array, curve: tuple[Array, Array], colour: Any) -> None:
    f, u = curve
    axes.fill_between(x, f - COVERAGE * u, f + COVERAGE * u, color=colour, alpha=0.18, lw=0)
    axes.plot(x, f, color=colour, lw=1.4)


def _marks(panels: Any, own: Points, x: Array, off: float, colour: Any, name: str) -> None:
    """Draw measured frequencies, and beneath their residuals; a marker a condition, named once."""
    above, below = panels
    label: str | None = name
    half = 100 * own.cells.half / own.model
    look = {"ms": 3.6, "color": colour, "lw": 0.8, "elinewidth": 0.5, "capsize": 0, "alpha": 0.8}
    for condition, marker in canvas.CONDITION_MARKERS.items():
        mask = own.cells.condition == condition
        if mask.any():
            above.plot(x[mask], own.cells.frequency[mask], marker, ms=3.6, color=colour, label=label)
            draw_bars(below, x[mask] + off, 100 * own.residual[mask], half[mask], marker, **look)
            label = None
