"""The panels of an explanation that the isolated cell fills."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.modal.evidence import Evidence, Trace
from ballscrew.modal.output_error import Candidate
from ballscrew.report.measured import COVERAGE
from ballscrew.report.style import CONDITION_COLOURS, STAR, no_formula

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["ALONE", "HELD", "PAPER", "draw_acceleration", "draw_left", "draw_models", "draw_ways"]

ALONE, HELD, PAPER = "black", "#332288", "#E69F00"
"""Colours of the isolated cell, of the rotor-held frequency, and of the paper's peak."""
_STRUCTURE = {"prompt": "known delay", "classical": "classical", "general": "any phase"}
_CLEAR: dict[str, Any] = {"fc": "white", "ec": "none", "alpha": 0.8, "pad": 1}
_EDGE = 0.06  # of the record at either end, where the filter of the band rings
_SIZES = (3.0, 8.0)  # points, of a mode of no share and of all the power
_WEAK = 0.005  # share of the power, below which a mode is not worth its mark
_BROAD = 0.25  # damping ratio, above which it is none


def draw_models(axes: Axes, told: Evidence) -> None:
    """Draw the modes of every model of this cell alone, a row a model: the stabilisation.

    Parameters
    ----------
    axes : Axes
        Whose x-axis is the frequency, with its limits.
    told : Evidence
        Of the cell.
    """
    axes.set_title("Stabilisation: modes by model", loc="left")
    alone = told.isolated
    if not alone.candidates:
        _why(axes, alone.reasons)
        axes.set(yticks=[], ylabel="modes in the model (1)")
        return
    axes.set_title(
        "models of this cell alone; BIC behind the likeliest",
        loc="right",
        fontsize=8,
        fontweight="normal",
        color="0.35",
    )
    low, high = axes.get_xlim()
    rows = sorted(alone.candidates, key=lambda model: (model.order, model.structure))
    least = min(model.criterion for model in rows)
    for height, model in enumerate(rows):
        _row(axes, height, model, (low, high), chosen=model is alone.best)
        axes.annotate(
            _STRUCTURE[model.structure], (0, height), (4, 0), va="center", textcoords="offset points",
            xycoords=("axes fraction", "data"), fontsize=8, color="0.35", bbox=_CLEAR,
        )  # fmt: skip
        behind = model.criterion - least
        axes.annotate(
            "likeliest" if behind == 0 else f"+{behind:.0f}", (1, height), (-4, 0), ha="right", va="center",
            xycoords=("axes fraction", "data"), textcoords="offset points", fontsize=8, color="0.35",
            bbox=_CLEAR,
        )  # fmt: skip
    axes.set_yticks(range(len(rows)), [str(model.order) for model in rows])
    axes.set(ylim=(-0.6, len(rows) - 0.4), ylabel="modes in the model (1)")


def _row(axes: Axes, height: int, model: Candidate, limits: tuple[float, float], *, chosen: bool) -> None:
    for mode in model.modes:
        if mode.share < _WEAK or mode.damping > _BROAD or not limits[0] < mode.frequency < limits[1]:
            continue
        size = _SIZES[0] + (_SIZES[1] - _SIZES[0]) * float(np.sqrt(mode.share))
        axes.errorbar(
            [mode.frequency], [height], xerr=[COVERAGE * mode.frequency_uncertainty], fmt="o", ms=size,
            color=ALONE, mfc=ALONE if chosen else "white", mew=1.2, lw=1.3, capsize=2.5, zorder=3,
        )  # fmt: skip


def draw_acceleration(axes: Axes, told: Evidence) -> None:
    """Draw the averaged acceleration in the band, and what the likeliest model of this cell explains of it.

    Parameters
    ----------
    axes : Axes
        To draw in.
    told : Evidence
        Of the cell.
    """
    trace = told.trace
    axes.set_title("Averaged acceleration, and what that model explains", loc="left")
    axes.set(ylabel="acceleration (m/s²)")
    axes.tick_params(labelbottom=False)
    if trace is None:
        _why(axes, told.isolated.reasons)
        axes.set(xticks=[], yticks=[])
        return
    inner = _inner(trace)
    time, colour = 1e3 * trace.time[inner], CONDITION_COLOURS[told.cell.condition]
    band = f"measured, {trace.band[0]:.0f} to {trace.band[1]:.0f} Hz"
    axes.plot(time, trace.measured[inner], color=colour, lw=3.2, alpha=0.7, label=band)
    axes.plot(time, trace.explained[inner], color=ALONE, lw=1.0, label="explained")
    axes.axvline(0, color="0.5", lw=0.8, ls=":", zorder=1)
    axes.annotate(
        "blow next to standstill", (0, 0), (4, 4), xycoords=("data", "axes fraction"),
        textcoords="offset points", fontsize=8.5, color="0.4", bbox=_CLEAR,
    )  # fmt: skip
    axes.set_xlim(time[0], time[-1])
    low, high = axes.get_ylim()
    axes.set_ylim(low - 0.06 * (high - low), high + 0.06 * (high - low))
    axes.legend(
        loc="upper right", fontsize=8.5, handlelength=1.6, frameon=True, framealpha=0.85, edgecolor="none"
    )


def draw_left(axes: Axes, told: Evidence) -> None:
    """Draw what the likeliest model of this cell leaves of the averaged acceleration, to a scale of its own.

    Parameters
    ----------
    axes : Axes
        To draw in.
    told : Evidence
        Of the cell.
    """
    axes.set(xlabel="time from the blow (ms)", ylabel="left (m/s²)")
    trace = told.trace
    if trace is None:
        axes.set(xticks=[], yticks=[])
        return
    inner = _inner(trace)
    missed = (trace.measured - trace.explained)[inner]
    axes.plot(1e3 * trace.time[inner], missed, color="0.35", lw=0.9)
    axes.axvline(0, color="0.5", lw=0.8, ls=":", zorder=1)
    reach = 1.5 * max(float(np.abs(missed).max()), 1e-12)
    axes.set_ylim(-reach, reach)
    axes.annotate(
        f"left: {100 * trace.left:.1f} % of the acceleration (rms); note the scale", (0, 1), (4, -3),
        xycoords="axes fraction", textcoords="offset points", va="top", fontsize=8.5, color="0.3",
        bbox=_CLEAR,
    )  # fmt: skip


def _inner(trace: Trace) -> slice:
    edge = round(_EDGE * len(trace.time))
    return slice(edge, len(trace.time) - edge)


def draw_ways(axes: Axes, told: Evidence) -> None:
    """Draw the number by each way to it, with its 95 % interval.

    Parameters
    ----------
    axes : Axes
        To draw in.
    told : Evidence
        Of the cell.
    """
    cell, paper, alone = told.cell, told.paper, told.isolated
    colour = CONDITION_COLOURS[cell.condition]
    first = "the run, all cells as one" if cell.method == "ml" else "the run, by the paper's peak"
    rows: list[tuple[str, float | None, float | None, dict[str, Any]]] = [
        (first, cell.frequency_Hz, cell.standard_uncertainty_Hz, {"color": colour, "fmt": "none"})
    ]
    if cell.frequency_Hz is not None and cell.deviation_Hz is not None:
        own = cell.frequency_Hz + cell.deviation_Hz
        look = {"color": colour, "fmt": "s", "mfc": "white", "ms": 6}
        # Noise alone would make the bar shorter than cells of one run lie apart.
        spread = max(cell.deviation_standard_uncertainty_Hz or 0.0, told.scatter or 0.0)
        rows.append(("this cell's part of it", own, spread, look))
    rows.append(
        ("this cell alone", alone.frequency, alone.uncertainty, {"color": ALONE, "fmt": "o", "ms": 6})
    )
    if cell.method != "paper":
        look = {"color": PAPER, "fmt": "D", "mfc": "none", "mew": 1.8, "ms": 6.5}
        rows.append(("the paper's peak", paper.frequency_Hz, paper.standard_uncertainty_Hz, look))
    axes.set_title("The number by each way to it, with its 95 % interval", loc="left")
    for height, (name, frequency, deviation, look) in enumerate(reversed(rows)):
        text = "refused"
        if frequency is not None:
            half = COVERAGE * (deviation or 0.0)
            axes.errorbar([frequency], [height], xerr=[half], lw=1.6, capsize=3.5, zorder=3, **look)
            text = f"{frequency:.1f} ± {half:.1f} Hz"
        for side, words in ((0, name), (1, text)):
            axes.annotate(
                words, (side, height), (4 - 8 * side, 7), xycoords=("axes fraction", "data"), fontsize=9,
                textcoords="offset points", ha=("left", "right")[side], bbox=_CLEAR, zorder=2,
                color="#8B1A1A" if side and frequency is None else "black",
            )  # fmt: skip
    if cell.frequency_Hz is not None:
        half = COVERAGE * (cell.standard_uncertainty_Hz or 0.0)
        axes.axvspan(cell.frequency_Hz - half, cell.frequency_Hz + half, color=colour, alpha=0.14, lw=0)
        star: Any = {**STAR, "markersize": 14}
        axes.plot([cell.frequency_Hz], [len(rows) - 1], linestyle="none", zorder=5, **star)
    elif all(frequency is None for _, frequency, _, _ in rows):
        axes.set_xticks([])
    axes.set(ylim=(-0.5, len(rows) - 0.25), yticks=[], xlabel="frequency (Hz)")
    axes.margins(x=0.12)


def _why(axes: Axes, reasons: tuple[str, ...]) -> None:
    text = f"refused: {reasons[0]}" if reasons else "refused"
    axes.text(
        0.5, 0.5, no_formula(textwrap.fill(text, 60)), transform=axes.transAxes, ha="center", va="center",
        fontsize=9, color="#8B1A1A",
    )  # fmt: skip
