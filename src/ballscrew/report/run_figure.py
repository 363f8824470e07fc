"""The picture of one run: an FRF a cell with its star, and the natural frequency along the axis."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.base.files import replacing
from ballscrew.modal.run import CellResult, Run
from ballscrew.report.style import (
    ANF,
    CONDITION_COLOURS,
    CONDITION_MARKERS,
    POSITION_MAP,
    RC,
    STAR,
    check_target,
    no_formula,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["check_target", "draw_run"]

_DEFAULT_SPAN = (10.0, 300.0)  # Hz, where no cell has a band
_MARGIN = 0.3  # of the band, shown beside it
_BELOW, _ABOVE = 0.45, 1.9  # of the frequencies found, where one model is fitted to a far wider band


def draw_run(run: Run, path: str | Path) -> None:
    """Draw a run.

    The upper rows hold the magnitude of the FRF and the coherence of each condition, a curve a stop, with a
    star on the axial natural frequency; below, the frequency against the position with its 95 % interval.
    Where all cells were identified as one, that is a curve, and a marker shows where a cell's own data lie.

    Parameters
    ----------
    run : Run
        As :func:`~ballscrew.modal.analyze.analyze` gives it.
    path : path-like
        PNG, SVG or PDF file.

    Raises
    ------
    InputError
        If the picture cannot be written.
    """
    path = Path(path)
    check_target(path)
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    with plt.rc_context(RC):
        figure = plt.figure(figsize=(13, 9.5), layout="constrained")
        grid = figure.add_gridspec(3, 4, height_ratios=(3, 1.2, 3))
        first: Any = None
        for column, condition in enumerate(CONDITION_COLOURS):
            upper = figure.add_subplot(grid[0, column], sharey=first)
            lower = figure.add_subplot(grid[1, column], sharex=upper)
            first = first or upper
            _condition(upper, lower, run, condition, labelled=column == 0)
        _colour_bar(figure, run)
        _along(figure.add_subplot(grid[2, :]), run)
        figure.suptitle(no_formula(_title(run)), fontweight="bold")
        try:
            with replacing(path) as temporary:
                undated = {"Date": None} if path.suffix.lower() == ".svg" else None
                figure.savefig(temporary, dpi=130, metadata=undated)
        finally:
            plt.close(figure)


def _title(run: Run) -> str:
    load = "" if run.mass_kg is None else f", load {run.mass_kg:g} kg"
    when = f", {run.measured_at}" if run.measured_at else ""
    return f"{run.axis or 'axis'}{load}{when}: measurement {run.quality.verdict}"


def _positions(run: Run) -> tuple[float, float]:
    places = [cell.position_m for cell in run.cells] or [0.0]
    return min(places), max(places)


def _colour(run: Run, position: float) -> Any:
    from matplotlib import colormaps

    low, high = _positions(run)
    return colormaps[POSITION_MAP](0.92 * (position - low) / (high - low) if high > low else 0.0)


def _condition(upper: Axes, lower: Axes, run: Run, condition: str, *, labelled: bool) -> None:
    """FRF and coherence of one condition."""
    table = run.frequency_response
    words = {"P": "positive", "N": "negative", "A": "acceleration", "D": "deceleration"}
    upper.set_title(
        f"{condition}: {words[condition[0]]} {words[condition[1]]}", color=CONDITION_COLOURS[condition]
    )
    lower.set_xlabel("frequency (Hz)")
    lower.set_ylim(0, 1.03)
    low, high = _span(run.cells)
    lower.set_xlim(low, high)
    upper.tick_params(labelbottom=False)
    if labelled:
        unit = table.attrs["input_unit"] if table is not None else "N m"
        upper.set_ylabel(f"|FRF| (m/s² per {unit})")
        lower.set_ylabel("coherence")
    else:
        upper.tick_params(labelleft=False)
        lower.tick_params(labelleft=False)
    if table is None:
        upper.text(0.5, 0.5, "no spectra", transform=upper.transAxes, ha="center")
        return
    estimator = str(run.made.settings.get("estimator", "H1"))
    frequency = table["frequency"].values
    shown = (frequency >= low) & (frequency <= high)
    rows = np.flatnonzero(table["condition"].values == condition)
    for row in rows:
        position, motion = float(table["position_m"].values[row]), int(table["motion"].values[row])
        curve = np.sqrt((np.abs(table[estimator].values[row]) ** 2).mean(axis=0))
        colour = _colour(run, position)
        upper.semilogy(frequency[shown], curve[shown], color=colour, lw=1.1)
        lower.plot(frequency[shown], table["coherence"].values[row].mean(axis=0)[shown], color=colour, lw=0.8)
        for cell in run.cells:
            same = (cell.position_m, cell.condition, cell.motion) == (position, condition, motion)
            if same and cell.frequency_Hz is not None:
                height = float(np.interp(cell.frequency_Hz, frequency, curve))
                upper.plot([cell.frequency_Hz], [height], linestyle="none", zorder=5, **STAR)


def _span(cells: Sequence[CellResult]) -> tuple[float, float]:
    joint = [cell.frequency_Hz for cell in cells if cell.method == "joint" and cell.frequency_Hz is not None]
    if joint:
        return max(5.0, _BELOW * min(joint)), _ABOVE * max(joint)
    bands = [cell.band_Hz for cell in cells if cell.band_Hz is not None]
    if not bands:
        return _DEFAULT_SPAN
    low, high = min(b[0] for b in bands), max(b[1] for b in bands)
    margin = _MARGIN * (high - low)
    return max(5.0, low - margin), high + margin


def _colour_bar(figure: Any, run: Run) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    low, high = (1e3 * place for place in _positions(run))
    if high <= low:
        return
    colours = [_colour(run, (low + (high - low) * part) / 1e3) for part in np.linspace(0, 1, 64)]
    scale = ScalarMappable(Normalize(low, high), LinearSegmentedColormap.from_list("position", colours))
    figure.colorbar(
        scale, ax=figure.axes, label="position (mm)", aspect=40, shrink=0.9, location="right", pad=0.01
    )


def _along(axes: Axes, run: Run) -> None:
    """Natural frequency against position, a marker a cell."""
    places = sorted({cell.position_m for cell in run.cells})
    pitch = 1e3 * min(np.diff(places), default=0.0)
    joint = [cell for cell in run.cells if cell.method == "joint" and cell.frequency_Hz is not None]
    if joint:
        _curve(axes, joint)
    for order, (condition, colour) in enumerate(CONDITION_COLOURS.items()):
        found = [c for c in run.cells if c.condition == condition and c.frequency_Hz is not None]
        if found:
            # Side by side, so that the bars of one stop can be told apart; beside a curve that would mislead.
            apart = 0.0 if joint else (order - 1.5) * 0.06 * pitch
            x = [1e3 * c.position_m + apart for c in found]
            axes.errorbar(
                x,
                [(c.frequency_Hz or np.nan) + (c.deviation_Hz or 0.0) for c in found],
                yerr=None if joint else [1.96 * (c.standard_uncertainty_Hz or 0.0) for c in found],
                fmt=CONDITION_MARKERS[condition],
                color=colour,
                capsize=2.5,
                ms=5,
                lw=1.1,
                label=condition,
            )
    own = "; markers: each cell's own data" if joint else ""
    axes.set_title(f"Axial natural frequency along the axis, with its 95 % interval{own}", loc="left")
    axes.set_xlabel("position (mm)")
    axes.set_ylabel("frequency (Hz)")
    refused = [1e3 * c.position_m for c in run.cells if c.frequency_Hz is None]
    if len(refused) == len(run.cells):
        why = no_formula(_why_nothing(run))
        axes.text(0.5, 0.5, why, transform=axes.transAxes, ha="center", va="center", wrap=True)
        axes.set(xticks=[], yticks=[])
        return
    bottom = axes.get_ylim()[0]
    if refused:
        axes.plot(refused, [bottom] * len(refused), "x", color="0.4", clip_on=False, label="refused")
    axes.set_ylim(bottom=bottom)
    axes.legend(ncols=6, loc="upper right")


def _curve(axes: Axes, cells: Sequence[CellResult]) -> None:
    """What is reported where all cells were identified as one; markers beside it are cells' own data."""
    stops = {cell.position_m: cell for cell in cells}
    place = sorted(stops)
    f = np.array([stops[x].frequency_Hz for x in place], dtype=np.float64)
    half = np.array([1.96 * (stops[x].standard_uncertainty_Hz or 0.0) for x in place])
    x = [1e3 * each for each in place]
    axes.fill_between(x, f - half, f + half, color=ANF, alpha=0.18, lw=0)
    axes.plot(x, f, color=ANF, lw=1.5, label="all cells as one")


def _why_nothing(run: Run) -> str:
    """The commonest reason, where every cell is refused."""
    reasons = [cell.reasons[0] for cell in run.cells if cell.reasons]
    if not reasons:
        return "no cell was found"
    reason = max(dict.fromkeys(reasons), key=reasons.count)
    return f"{len(run.cells)} cells, all refused:\n{reason}"
