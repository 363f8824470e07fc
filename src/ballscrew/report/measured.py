"""Shared parts of pictures of measurements: cells as arrays, their FRFs, intervals and marks of a refusal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.quantity import NORMAL_95, Quantity
from ballscrew.modal.cell import CellResult
from ballscrew.modal.run import Run
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes

COVERAGE = NORMAL_95
"""Standard uncertainties from a value to either end of its 95 % interval."""
TRUE: Mapping[str, Any] = {"color": "black", "lw": 0.9, "zorder": 2.5}
_SAME = 1e-6  # m, within which two positions are one stop
_BESIDE = 0.13  # of the distance between two places, from one condition's marks to the next


@dataclass(frozen=True, slots=True, eq=False)
class CellArrays:
    """Results of cells as arrays, each of shape (cells,).

    Parameters
    ----------
    position : ndarray
        Position of the stop, m.
    condition : ndarray of str
        PA, PD, NA or ND.
    frequency : ndarray
        Axial natural frequency, Hz; NaN where refused.
    uncertainty : ndarray
        Its standard uncertainty, Hz; 0 where the cell has none.
    deviation : ndarray
        Deviation of the cell's own data from the curve of all cells, Hz; 0 where there is none.
    """

    position: Array
    condition: NDArray[np.str_]
    frequency: Array
    uncertainty: Array
    deviation: Array

    @classmethod
    def of(cls, cells: Iterable[CellResult | None]) -> CellArrays:
        """Arrays of some cells; None is a refused cell without a place."""
        listed = list(cells)
        numbers = np.full((len(listed), 4), np.nan)
        conditions = []
        for row, cell in zip(numbers, listed, strict=True):
            if cell is None:
                conditions.append("")
                continue
            conditions.append(cell.condition)
            row[:] = (
                cell.position_m, cell.frequency_Hz, cell.standard_uncertainty_Hz, cell.deviation_Hz,
            )  # fmt: skip
        return cls(
            position=numbers[:, 0],
            condition=np.array(conditions, dtype=np.str_),
            frequency=numbers[:, 1],
            uncertainty=np.nan_to_num(numbers[:, 2]),
            deviation=np.nan_to_num(numbers[:, 3]),
        )

    def select(self, chosen: NDArray[Any]) -> CellArrays:
        """Cells chosen by a mask or by their numbers."""
        numbers = np.stack([self.position, self.frequency, self.uncertainty, self.deviation])[:, chosen]
        position, frequency, uncertainty, deviation = numbers
        return CellArrays(position, self.condition[chosen], frequency, uncertainty, deviation)

    @property
    def refused(self) -> NDArray[np.bool_]:
        """Cells without a frequency, as a mask."""
        return np.isnan(self.frequency)

    @property
    def half(self) -> Array:
        """Half of each 95 % interval, Hz."""
        return COVERAGE * self.uncertainty


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """FRF of one cell.

    Parameters
    ----------
    frequency : ndarray, shape (n,)
        Hz.
    each : ndarray, shape (responses, n)
        FRF of each response, m/s² per input.
    coherence : ndarray, shape (responses, n)
        Coherence of each response.
    names : tuple of str
        Names of the responses.
    unit : str
        Unit of the input.
    estimator : str
        H1, H2 or Hv.
    """

    frequency: Array
    each: NDArray[np.complex128]
    coherence: Array
    names: tuple[str, ...]
    unit: str
    estimator: str

    @property
    def magnitude(self) -> Array:
        """Root mean square over the responses, in which the mode is sought."""
        return np.asarray(np.sqrt((np.abs(self.each) ** 2).mean(axis=0)))

    def at(self, frequency: float) -> float:
        """Magnitude at a frequency."""
        return float(np.interp(frequency, self.frequency, self.magnitude))

    def within(self, low: float, high: float) -> NDArray[np.bool_]:
        """Mask of the frequencies from ``low`` to ``high``."""
        return (self.frequency >= low) & (self.frequency <= high)


def axis_title(run: Run) -> str:
    """Name of the axis and load of a run, ``"bench, load 100 kg"``."""
    title = run.axis or "axis"
    if run.mass_kg is not None:
        title += f", load {run.mass_kg:g} kg"
    return title


def half_width(uncertainty: float | None) -> float:
    """Half of a 95 % interval, in the unit of the standard uncertainty; 0 without one."""
    return COVERAGE * (uncertainty or 0.0)


def cell_of(run: Run, position: float, condition: str, motion: int = 0) -> CellResult | None:
    """One cell of a run.

    Parameters
    ----------
    run : Run
        The run.
    position : float
        Position of the stop, m.
    condition : str
        PA, PD, NA or ND.
    motion : int
        Number of the motion, from 0.

    Returns
    -------
    CellResult or None
        None where the run has no such cell.
    """
    for cell in run.cells:
        same = cell.condition == condition and cell.motion == motion
        if same and abs(cell.position_m - position) < _SAME:
            return cell
    return None


def response_of(run: Run, position: float, condition: str, motion: int = 0) -> Response | None:
    """FRF of one cell of a run.

    Parameters
    ----------
    run, position, condition, motion
        As in :func:`cell_of`.

    Returns
    -------
    Response or None
        None where the cell has no spectra, as in a bad measurement.

    Raises
    ------
    InputError
        If the run has frequencies but no frequency response, as one read from JSON.
    """
    table = run.frequency_response
    if table is None:
        if CellArrays.of(run.cells).refused.all():
            return None  # a bad measurement has no spectra
        raise InputError(
            f"the run {run.id[:12]} contains no frequency response, which the picture needs; "
            "analyze returns it, JSON does not store it"
        )
    same = (table["condition"].values == condition) & (table["motion"].values == motion)
    rows = np.flatnonzero(same & (np.abs(table["position_m"].values - position) < _SAME))
    if not rows.size:
        return None
    row, estimator = int(rows[0]), str(run.made.settings.get("estimator", "H1"))
    if estimator not in table:
        raise InputError(f"the run's estimator is {estimator!r}; its frequency response has no such estimate")
    return Response(
        frequency=np.asarray(table["frequency"].values, dtype=np.float64),
        each=np.asarray(table[estimator].values[row], dtype=np.complex128),
        coherence=np.asarray(table["coherence"].values[row], dtype=np.float64),
        names=tuple(str(name).removeprefix("acceleration:") for name in table["response"].values),
        unit=str(table.attrs["input_unit"]),
        estimator=estimator,
    )


def true_at(truth: Mapping[float, float] | None, place: float) -> float | None:
    """True frequency at a position or load, where it is known.

    Parameters
    ----------
    truth : mapping of float to float, optional
        Position, m, or load, kg, to frequency, Hz.
    place : float
        Position or load.

    Returns
    -------
    float or None
        Hz.
    """
    for known, frequency in (truth or {}).items():
        if abs(known - place) < _SAME and np.isfinite(frequency):
            return float(frequency)
    return None


def draw_true(axes: Axes, x: Iterable[float], y: Iterable[float]) -> None:
    """Draw true values: a thin black line with a dot at each.

    Parameters
    ----------
    axes : Axes
        Axes to draw in.
    x, y : iterable of float
        Points of the line; NaN where no true value exists.
    """
    axes.plot(list(x), list(y), label="true", marker="o", ms=2.2, **TRUE)


def beside(places: Sequence[float], condition: str) -> float:
    """Offset of a condition's marks from their place, so that the four do not cover each other.

    Parameters
    ----------
    places : sequence of float
        All places along the picture.
    condition : str
        PA, PD, NA or ND.

    Returns
    -------
    float
        In the unit of the places.
    """
    return (list(canvas.CONDITION_COLOURS).index(condition) - 1.5) * _BESIDE * pitch(places)


def pitch(places: Sequence[float]) -> float:
    """Smallest distance of two neighbouring places.

    Parameters
    ----------
    places : sequence of float
        One or more.

    Returns
    -------
    float
        In their unit; for a single place a tenth of it, or 1 where that is 0.
    """
    known = sorted(set(places))
    return float(min(np.diff(known), default=abs(known[0]) / 10 or 1.0))


def draw_bars(axes: Axes, x: Any, y: Array, half: Array, marker: str, **look: Any) -> None:
    """Draw values with vertical error bars.

    Parameters
    ----------
    axes : Axes
        Axes to draw in.
    x, y : array_like, shape (n,)
        Points.
    half : ndarray, shape (n,) or (2, n)
        Length of each bar downwards and upwards.
    marker : str
        Marker of the points.
    **look
        Colour and label, and what differs from the usual sizes.
    """
    axes.errorbar(x, y, yerr=half, fmt=marker, **({"ms": 4.5, "lw": 1.2, "capsize": 2} | look))


def draw_interval(
    axes: Axes, x: Array, cells: CellArrays, condition: str, *, reference: Array | float = 0.0
) -> None:
    """Draw measured frequencies of one condition with their 95 % intervals, without the refused ones.

    Parameters
    ----------
    axes : Axes
        Axes to draw in.
    x : ndarray, shape (cells,)
        Place of each cell in the picture.
    cells : CellArrays
        Cells of the condition.
    condition : str
        Gives colour, marker and name.
    reference : ndarray or float, optional
        Subtracted from each frequency, Hz; NaN leaves the cell out.
    """
    height = cells.frequency - reference
    known = np.isfinite(height)
    if known.any():
        colour, marker = canvas.CONDITION_COLOURS[condition], canvas.CONDITION_MARKERS[condition]
        half = cells.half[known]
        draw_bars(axes, x[known], height[known], half, marker, color=colour, lw=1.0, label=condition)


def interval_bars(quantities: Iterable[Quantity | None]) -> tuple[Array, Array]:
    """Values and 95 % intervals as error bars take them.

    Parameters
    ----------
    quantities : iterable of Quantity or None
        n quantities; None becomes NaN.

    Returns
    -------
    values : ndarray, shape (n,)
        Best estimates.
    lengths : ndarray, shape (2, n)
        Lengths of the bars downwards and upwards.
    """
    rows = []
    for quantity in quantities:
        if quantity is None:
            rows.append((np.nan, np.nan, np.nan))
        else:
            rows.append((quantity.value, *quantity.interval))
    values, low, high = np.array(rows, dtype=np.float64).reshape(-1, 3).T
    return values, np.stack([values - low, high - values])


def draw_refused(axes: Axes, x: Sequence[float] | Array, colour: Any, size: float = 5.0) -> None:
    """Mark refused cells: a cross on the lower edge of the axes, whatever their limits.

    Parameters
    ----------
    axes : Axes
        Axes to draw in.
    x : sequence of float
        Places.
    colour : str
        Colour of the crosses.
    size : float
        Size of the crosses, points.
    """
    if not len(x):
        return
    edge: Any = {"transform": axes.get_xaxis_transform(), "clip_on": False}
    zeros = np.zeros(len(x))
    axes.plot(x, zeros, "x", ms=size + 1.2, mew=3.2, color="white", zorder=6, label="_halo", **edge)
    axes.plot(x, zeros, "x", ms=size, mew=1.3, color=colour, zorder=6.1, label="_refused", **edge)


def plain_numbers(axes: Axes) -> None:
    """Number a logarithmic axis 1, 2, 5, 10, without powers of ten.

    Parameters
    ----------
    axes : Axes
        Axes with a logarithmic y-axis.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
