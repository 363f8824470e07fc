"""Frequencies of all runs with the calibrated model, and what it leaves: Figs. 9 and 10 of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.axis.axial import PARAMETERS, frequency, gradient
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.modal.run import Run
from ballscrew.report.axis_figures import LOAD_MAP
from ballscrew.report.canvas import blank, colours_of, styled
from ballscrew.report.measured import COVERAGE, plain_numbers
from ballscrew.report.style import CONDITION_MARKERS, POSITION_MAP, no_formula

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Point", "draw_calibration", "points", "predicted"]


_CURVE = 81
_STOPS = 4  # shown over the load, spread over the travel
_OFF = 0.012  # of the axis, from one series to the next below
_ZERO: Any = {"color": "0.3", "lw": 1.0, "zorder": 1}


@dataclass(frozen=True, slots=True)
class Point:
    """One cell and what the model says of it.

    Parameters
    ----------
    position, load : float
        m, kg.
    group : int
        Of its preload.
    condition : str
        PA, PD, NA or ND.
    frequency, uncertainty, model : float
        Measured, its standard uncertainty, and by the model, Hz.
    """

    position: float
    load: float
    group: int
    condition: str
    frequency: float
    uncertainty: float
    model: float

    @property
    def left(self) -> float:
        """Measured less model, as a part of the model's."""
        return self.frequency / self.model - 1


def points(calibrated: CalibratedAxis, runs: Sequence[Run]) -> tuple[Point, ...]:
    """Cells of the runs that a model was made of, with what it says of them.

    Parameters
    ----------
    calibrated : CalibratedAxis
        The model.
    runs : sequence of Run
        Those that it was made of; others are passed over.

    Returns
    -------
    tuple of Point
        Refused cells left out.
    """
    used = {run.id: run for run in calibrated.runs}
    found = []
    for run in runs:
        if run.id not in used:
            continue
        group, load = used[run.id].group, used[run.id].load
        for cell in run.cells:
            f, u = cell.frequency_Hz, cell.standard_uncertainty_Hz
            if cell.verdict == "refused" or f is None or u is None:
                continue
            model, _ = predicted(calibrated, np.array(cell.position_m), np.array(load), group)
            found.append(Point(cell.position_m, load, group, cell.condition, f, u, float(model)))
    return tuple(found)


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
        Of the preload.

    Returns
    -------
    frequency, uncertainty : ndarray
        Hz.
    """
    ratio = float(np.exp(calibrated.log_ratios[group]))
    f = frequency(calibrated.model, position, load, ratio)
    slopes = gradient(calibrated.model, position, load, ratio)
    own, size = slopes[..., : len(PARAMETERS)], len(PARAMETERS)
    whole = np.zeros((size + 1, size + 1))
    whole[:size, :size] = calibrated.covariance
    whole[:size, size] = whole[size, :size] = calibrated.cross_covariance[:, group]
    whole[size, size] = calibrated.log_ratio_covariance[group, group]
    rows = np.concatenate([own, slopes[..., size:]], axis=-1)
    variance = np.einsum("...i,ij,...j->...", rows, whole, rows)
    return f, f * np.sqrt(np.maximum(variance, 0.0))


def draw_calibration(calibrated: CalibratedAxis, runs: Sequence[Run]) -> Figure:
    """Draw frequency against position and against load, and below each what the model leaves.

    Parameters
    ----------
    calibrated : CalibratedAxis
        The model.
    runs : sequence of Run
        Those that it was made of.

    Returns
    -------
    Figure
        Not yet written.

    Raises
    ------
    InputError
        If none of the runs belongs to the model.
    """
    cells = points(calibrated, runs)
    if not cells:
        raise InputError("none of the runs belongs to this model; there is nothing to draw")
    with styled():
        figure = blank(10.4, 7.2, 0.05)
        grid: Any = figure.subplots(2, 2, sharex="col", height_ratios=(1.8, 1))
        keys = sorted({(cell.group, cell.load) for cell in cells})
        tints = dict(zip(keys, colours_of(LOAD_MAP, len(keys), 0.85), strict=True))
        x = np.linspace(min(c.position for c in cells), max(c.position for c in cells), _CURVE)
        for index, ((group, load), colour) in enumerate(tints.items()):
            own = [c for c in cells if (c.group, c.load) == (group, load)]
            name = f"{load:g} kg" + (f", preload {group + 1}" if len(calibrated.log_ratios) > 1 else "")
            _curve(grid[0, 0], 1e3 * x, predicted(calibrated, x, np.full_like(x, load), group), colour)
            off = _OFF * 1e3 * np.ptp(x) * (index - (len(tints) - 1) / 2)
            _cells(grid[0, 0], grid[1, 0], [(1e3 * c.position, c) for c in own], colour, name, off)
        stops = sorted({c.position for c in cells if c.group == 0})
        shown = [stops[i] for i in sorted(set(np.linspace(0, len(stops) - 1, _STOPS).astype(int)))]
        loads = np.linspace(0.0, 1.05 * max(c.load for c in cells) or 1.0, _CURVE)
        for index, (stop, colour) in enumerate(zip(shown, colours_of(POSITION_MAP, len(shown)), strict=True)):
            own = [c for c in cells if c.position == stop and c.group == 0]
            _curve(grid[0, 1], loads, predicted(calibrated, np.full_like(loads, stop), loads), colour)
            off = _OFF * loads[-1] * (index - (len(shown) - 1) / 2)
            _cells(grid[0, 1], grid[1, 1], [(c.load, c) for c in own], colour, f"{1e3 * stop:g} mm", off)
        _finish(grid, cells)
        figure.suptitle(
            no_formula(f"{calibrated.axis}: measured, and by the calibrated model"), fontweight="bold"
        )
    return figure


def _curve(axes: Axes, x: Array, curve: tuple[Array, Array], colour: Any) -> None:
    f, u = curve
    axes.fill_between(x, f - COVERAGE * u, f + COVERAGE * u, color=colour, alpha=0.18, lw=0)
    axes.plot(x, f, color=colour, lw=1.4)


def _cells(
    above: Axes, below: Axes, cells: Sequence[tuple[float, Point]], colour: Any, name: str, off: float
) -> None:
    for condition, marker in CONDITION_MARKERS.items():
        own = [(x, c) for x, c in cells if c.condition == condition]
        if not own:
            continue
        x = [place for place, _ in own]
        style: Any = {"ls": "none", "marker": marker, "ms": 3.6, "color": colour, "lw": 0.8}
        label = name if condition == cells[0][1].condition else None
        above.plot(x, [c.frequency for _, c in own], label=label, **style)
        half = [100 * COVERAGE * c.uncertainty / c.model for _, c in own]
        below.errorbar(
            [place + off for place in x],
            [100 * c.left for _, c in own],
            yerr=half,
            elinewidth=0.5,
            alpha=0.8,
            **style,
        )


def _finish(grid: Any, cells: Sequence[Point]) -> None:
    left = 100 * np.array([c.left for c in cells])
    words = f"{np.sqrt(np.mean(left**2)):.2g} % (root mean square)"
    for column, (title, label) in enumerate(
        (("(a) against position: Fig. 9", "position (mm)"), ("(b) against load: Fig. 10", "load (kg)"))
    ):
        above, below = grid[:, column]
        above.set_title(title, loc="left")
        above.legend(loc="best", fontsize=8.5, ncols=2)
        above.set_ylabel("frequency (Hz)")
        below.axhline(0, **_ZERO)
        below.set(xlabel=label, ylabel="measured / model − 1 (%)")
        plain_numbers(above)
    grid[1, 0].set_title(f"what the model leaves: {words}", loc="left")
