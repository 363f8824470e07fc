"""What the pictures of measurements share: a cell of a run, its FRF, its interval, the mark of a refusal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.modal.run import CellResult, Run
from ballscrew.report.style import CONDITION_COLOURS, CONDITION_MARKERS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "COVERAGE",
    "TRUE",
    "Response",
    "beside",
    "cell_of",
    "draw_interval",
    "draw_refused",
    "draw_true",
    "pitch",
    "plain_numbers",
    "response_of",
    "true_at",
    "true_curve",
]


COVERAGE = 1.96
"""Standard uncertainties on either side of a value that 95 % lie within."""
TRUE: Mapping[str, Any] = {"color": "black", "lw": 0.9, "zorder": 2.5}
_SAME = 1e-6  # m, within which two positions are one stop
_BESIDE = 0.13  # of the way from one place to the next, between two conditions


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """The FRF of one cell.

    Parameters
    ----------
    frequency : ndarray, shape (n,)
        Hz.
    each : ndarray, shape (responses, n)
        FRF of each response, m/s² per input.
    coherence : ndarray, shape (responses, n)
        Of each.
    names : tuple of str
        Of the responses.
    unit : str
        Of the input.
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
        """Root mean square over the responses: what the mode is sought in."""
        return np.asarray(np.sqrt((np.abs(self.each) ** 2).mean(axis=0)))

    def at(self, frequency: float) -> float:
        """Its magnitude at a frequency."""
        return float(np.interp(frequency, self.frequency, self.magnitude))


def cell_of(run: Run, position: float, condition: str, motion: int = 0) -> CellResult | None:
    """One cell of a run.

    Parameters
    ----------
    run : Run
        The run.
    position : float
        Of the stop, m.
    condition : str
        PA, PD, NA or ND.
    motion : int
        Which motion, from 0.

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
        If the run has frequencies and yet holds no frequency response, as one that was read from JSON.
    """
    table = run.frequency_response
    if table is None and all(cell.frequency_Hz is None for cell in run.cells):
        return None  # a bad measurement has none
    if table is None:
        raise InputError(
            f"the run {run.id[:12]} holds no frequency response, which the picture needs; "
            "analyze gives it, JSON does not keep it"
        )
    same = (table["condition"].values == condition) & (table["motion"].values == motion)
    rows = np.flatnonzero(same & (np.abs(table["position_m"].values - position) < _SAME))
    if not rows.size:
        return None
    row, estimator = int(rows[0]), str(run.made.settings.get("estimator", "H1"))
    if estimator not in table:
        raise InputError(f"the run's estimator is {estimator!r}; its frequency response holds no such one")
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
        Where.

    Returns
    -------
    float or None
        Hz.
    """
    for known, frequency in (truth or {}).items():
        if abs(known - place) < _SAME and np.isfinite(frequency):
            return float(frequency)
    return None


def true_curve(truth: Mapping[float, float]) -> tuple[Array, Array]:
    """Places, ascending, and true frequencies.

    Parameters
    ----------
    truth : mapping of float to float
        As in :func:`true_at`.

    Returns
    -------
    places, frequencies : ndarray
        Of the same length.
    """
    places = sorted(truth)
    return np.array(places), np.array([truth[place] for place in places])


def draw_true(axes: Axes, x: Iterable[float], y: Iterable[float]) -> None:
    """Draw the truth: a thin black line with a dot where it is known.

    Parameters
    ----------
    axes : Axes
        To draw in.
    x, y : iterable of float
        Of the line; NaN where there is no truth.
    """
    axes.plot(list(x), list(y), label="true", marker="o", ms=2.2, **TRUE)


def beside(places: Sequence[float], condition: str) -> float:
    """By how much a condition's marks stand beside their place, so that the four can be told apart.

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
    return (list(CONDITION_COLOURS).index(condition) - 1.5) * _BESIDE * pitch(places)


def pitch(places: Sequence[float]) -> float:
    """Smallest way from one place to the next.

    Parameters
    ----------
    places : sequence of float
        One or more.

    Returns
    -------
    float
        In their unit; of a single place a tenth of it, or 1 where that is 0.
    """
    known = sorted(set(places))
    return float(min(np.diff(known), default=abs(known[0]) / 10 or 1.0))


def draw_interval(
    axes: Axes, x: Sequence[float], cells: Sequence[CellResult], condition: str, *, less: Sequence[float] = ()
) -> None:
    """Draw measured frequencies of one condition with their 95 % intervals; the refused are left out.

    Parameters
    ----------
    axes : Axes
        To draw in.
    x : sequence of float
        Where each cell stands.
    cells : sequence of CellResult
        All that were measured.
    condition : str
        Theirs: colour, marker and name.
    less : sequence of float, optional
        What is subtracted from each.
    """
    off = list(less) or [0.0] * len(cells)
    rows = [
        (place, cell.frequency_Hz - base, COVERAGE * (cell.standard_uncertainty_Hz or 0.0))
        for place, cell, base in zip(x, cells, off, strict=True)
        if cell.frequency_Hz is not None and np.isfinite(base)
    ]
    if rows:
        place, height, half = zip(*rows, strict=True)
        axes.errorbar(
            place, height, yerr=half, fmt=CONDITION_MARKERS[condition], color=CONDITION_COLOURS[condition],
            ms=4.5, lw=1.0, capsize=2, label=condition,
        )  # fmt: skip


def draw_refused(axes: Axes, x: Sequence[float], colour: Any, size: float = 5.0) -> None:
    """Mark what was refused: a cross on the lower edge of the axes, whatever their limits.

    Parameters
    ----------
    axes : Axes
        To draw in.
    x : sequence of float
        Where.
    colour : str
        Of the crosses.
    size : float
        Of the crosses, points.
    """
    if not len(x):
        return
    place: Any = {
        "transform": axes.get_xaxis_transform(),
        "clip_on": False,
        "linestyle": "none",
        "marker": "x",
    }
    axes.plot(x, [0.0] * len(x), ms=size + 1.2, mew=3.2, color="white", zorder=6, label="_halo", **place)
    axes.plot(x, [0.0] * len(x), ms=size, mew=1.3, color=colour, zorder=6.1, label="_refused", **place)


def plain_numbers(axes: Axes) -> None:
    """Number a logarithmic axis 1, 2, 5, 10, without powers of ten.

    Parameters
    ----------
    axes : Axes
        Logarithmic upwards.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
