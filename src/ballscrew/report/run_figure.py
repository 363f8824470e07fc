"""The picture of one run: the FRF of each cell with its star, and the natural frequency along the axis."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from ballscrew.modal.run import Run
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes, Figure
from ballscrew.report.measured import (
    CellArrays,
    Response,
    axis_title,
    cell_of,
    draw_bars,
    draw_refused,
    response_of,
)

_DEFAULT_SPAN = (10.0, 300.0)  # Hz, where no cell has a band
_LOWEST = 5.0  # Hz
_MARGIN = 0.3  # of the band, shown beside it
_BELOW, _ABOVE = 0.45, 1.9  # of the frequencies found, where one model is fitted to a far wider band
_WORDS = {
    "PA": "positive acceleration",
    "PD": "positive deceleration",
    "NA": "negative acceleration",
    "ND": "negative deceleration",
}


@canvas.styled()
def draw_run(run: Run) -> Figure:
    """Draw a run.

    The upper rows show the magnitude of the FRF and the coherence of each condition, a curve a stop, with a
    star on the axial natural frequency; below, the frequency against the position with its 95 % interval.
    Where all cells were identified by one model, that is a curve, and markers show each cell's own data.

    Parameters
    ----------
    run : Run
        As :func:`~ballscrew.modal.analyze.analyze` returns it.

    Returns
    -------
    Figure
        Not yet written.
    """
    figure = canvas.blank(13, 9.5)
    grid = figure.add_gridspec(3, 4, height_ratios=(3, 1.2, 3))
    first: Any = None
    for column, condition in enumerate(canvas.CONDITION_COLOURS):
        upper = figure.add_subplot(grid[0, column], sharey=first)
        lower = figure.add_subplot(grid[1, column], sharex=upper)
        first = first or upper
        _condition(upper, lower, run, condition)
        _label(upper, lower, run, first=column == 0)
    _colour_bar(figure, run)
    draw_frequencies(figure.add_subplot(grid[2, :]), run)
    title = axis_title(run)
    if run.measured_at:
        title += f", {run.measured_at}"
    figure.suptitle(canvas.escape_dollars(f"{title}: measurement {run.quality.verdict}"), fontweight="bold")
    return figure


def _positions(run: Run) -> tuple[float, float]:
    places = CellArrays.of(run.cells).position
    return float(places.min(initial=np.inf)), float(places.max(initial=-np.inf))


def _colour(run: Run, position: float) -> Any:
    from matplotlib import colormaps

    low, high = _positions(run)
    if high <= low:
        return colormaps[canvas.POSITION_MAP](0.0)
    return colormaps[canvas.POSITION_MAP](0.92 * (position - low) / (high - low))


def _label(upper: Axes, lower: Axes, run: Run, *, first: bool) -> None:
    lower.set(xlabel="frequency (Hz)", ylim=(0, 1.03))
    upper.tick_params(labelbottom=False, labelleft=first)
    lower.tick_params(labelleft=first)
    if first:
        unit = "N m"
        if run.frequency_response is not None:
            unit = run.frequency_response.attrs["input_unit"]
        upper.set_ylabel(f"|FRF| (m/s² per {unit})")
        lower.set_ylabel("coherence")


def _condition(upper: Axes, lower: Axes, run: Run, condition: str) -> None:
    """Draw FRF and coherence of one condition."""
    upper.set_title(f"{condition}: {_WORDS[condition]}", color=canvas.CONDITION_COLOURS[condition])
    low, high = _span(run)
    lower.set_xlim(low, high)
    table = run.frequency_response
    if table is None:
        upper.text(0.5, 0.5, "no spectra", transform=upper.transAxes, ha="center")
        return
    rows = table["condition"].values == condition
    places, motions = table["position_m"].values[rows], table["motion"].values[rows]
    for position, motion in zip(places, motions, strict=True):
        response = response_of(run, position, condition, motion)
        if response is not None:
            _response(upper, lower, response, _colour(run, position), (low, high))
            cell = cell_of(run, position, condition, motion)
            if cell is not None and cell.frequency_Hz is not None:
                canvas.draw_star(upper, cell.frequency_Hz, response.at(cell.frequency_Hz), 9)


def _response(
    upper: Axes, lower: Axes, response: Response, colour: Any, span: tuple[float, float]
) -> None:  # fmt: skip
    shown = response.within(*span)
    f = response.frequency[shown]
    upper.semilogy(f, response.magnitude[shown], color=colour, lw=1.1)
    lower.plot(f, response.coherence.mean(axis=0)[shown], color=colour, lw=0.8)


def _span(run: Run) -> tuple[float, float]:
    """Frequencies shown: around those of the model of all cells, else around the bands that were searched."""
    joint = _joint(run).frequency
    if joint.size:
        return max(_LOWEST, _BELOW * joint.min()), _ABOVE * joint.max()
    bands = np.array([cell.band_Hz for cell in run.cells if cell.band_Hz is not None])
    if not bands.size:
        return _DEFAULT_SPAN
    low, high = float(bands[:, 0].min()), float(bands[:, 1].max())
    margin = _MARGIN * (high - low)
    return max(_LOWEST, low - margin), high + margin


def _joint(run: Run) -> CellArrays:
    """Cells whose frequency comes from one model of all cells."""
    cells = CellArrays.of(cell for cell in run.cells if cell.method == "joint")
    return cells.select(~cells.refused)


def _colour_bar(figure: Figure, run: Run) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    low, high = _positions(run)
    if high <= low:
        return
    colours = [_colour(run, position) for position in np.linspace(low, high, 64)]
    scale = ScalarMappable(
        Normalize(1e3 * low, 1e3 * high), LinearSegmentedColormap.from_list("position", colours)
    )
    figure.colorbar(
        scale, ax=figure.axes, label="position (mm)", aspect=40, shrink=0.9, location="right", pad=0.01
    )


def draw_frequencies(axes: Axes, run: Run) -> None:
    """Draw the natural frequency against the position, a marker a cell, with 95 % intervals.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    run : Run
        Analysed run.
    """
    cells, joint = CellArrays.of(run.cells), _joint(run)
    axes.set(xlabel="position (mm)", ylabel="frequency (Hz)")
    title = "Axial natural frequency along the axis, 95 % intervals"
    if joint.frequency.size:
        title += "; markers: each cell's own data"
        _curve(axes, joint)
    axes.set_title(title, loc="left")
    if cells.refused.all():
        why = canvas.escape_dollars(_why_nothing(run))
        axes.text(0.5, 0.5, why, transform=axes.transAxes, ha="center", va="center", wrap=True)
        axes.set(xticks=[], yticks=[])
        return
    _markers(axes, cells, joint=joint.frequency.size > 0)
    refused = 1e3 * cells.position[cells.refused]
    if refused.size:
        axes.set_ylim(bottom=axes.get_ylim()[0])
        draw_refused(axes, refused, "0.4")
        axes.plot([], [], "x", color="0.4", label="refused")
    axes.legend(ncols=6, loc="upper right")


def _markers(axes: Axes, cells: CellArrays, *, joint: bool) -> None:
    pitch = 1e3 * min(np.diff(np.unique(cells.position)), default=0.0)
    for order, (condition, colour) in enumerate(canvas.CONDITION_COLOURS.items()):
        own = cells.select((cells.condition == condition) & ~cells.refused)
        if not own.frequency.size:
            continue
        # Side by side, so that the bars of one stop do not overlap; beside a curve that would mislead.
        offset, half = (order - 1.5) * 0.06 * pitch, own.half
        if joint:
            offset, half = 0.0, np.zeros(own.half.size)
        look = {"color": colour, "capsize": 2.5, "ms": 5, "lw": 1.1, "label": condition}
        x, y = 1e3 * own.position + offset, own.frequency + own.deviation
        draw_bars(axes, x, y, half, canvas.CONDITION_MARKERS[condition], **look)


def _curve(axes: Axes, cells: CellArrays) -> None:
    """Draw the reported frequency of the model of all cells."""
    _, last = np.unique(cells.position[::-1], return_index=True)
    stops = cells.select(len(cells.position) - 1 - last)
    x, f = 1e3 * stops.position, stops.frequency
    axes.fill_between(x, f - stops.half, f + stops.half, color=canvas.ANF, alpha=0.18, lw=0)
    axes.plot(x, f, color=canvas.ANF, lw=1.5, label="model of all cells")


def _why_nothing(run: Run) -> str:
    """The commonest reason, where every cell is refused."""
    reasons = Counter(cell.reasons[0] for cell in run.cells if cell.reasons)
    if not reasons:
        return "no cell was found"
    ((reason, _),) = reasons.most_common(1)
    return f"{len(run.cells)} cells, all refused:\n{reason}"
