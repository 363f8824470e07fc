"""The picture of one cell that says why its number is what it is."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.modal.evidence import Evidence
from ballscrew.report.canvas import blank, styled
from ballscrew.report.explain_words import headline
from ballscrew.report.measured import COVERAGE, Response, plain_numbers, response_of
from ballscrew.report.style import CONDITION_COLOURS, STAR, no_formula

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_explanation"]

_SHOWN = (40.0, 400.0)  # Hz, where nobody knows where the mode may lie
_LEFT, _RIGHT = 0.55, 1.75  # of the mode's frequency: what is shown of the axis
_SENSOR = "0.72"
HELD, PAPER = "#332288", "#E69F00"
"""Colours of the rotor-held frequency, and of the paper's peak."""
_CLEAR: dict[str, Any] = {"fc": "white", "ec": "none", "alpha": 0.8, "pad": 1}


def draw_explanation(told: Evidence) -> Figure:
    """Draw why the number of a cell is what it is.

    On the left, over one axis of frequencies: the magnitude of the FRF with the star, its 95 % interval, the
    rotor-held frequency and the paper's peak, and the coherence. On the right all estimates of the frequency.

    Parameters
    ----------
    told : Evidence
        Of the cell.

    Returns
    -------
    Figure
        Not yet written. A refused cell is drawn as well, with the reason.

    Raises
    ------
    InputError
        If the run was read from JSON and holds no frequency response.
    """
    cell = told.cell
    response = response_of(told.run, cell.position_m, cell.condition, cell.motion)
    with styled():
        figure = blank(13, 5.4, apart=0.04)
        grid = figure.add_gridspec(2, 2, height_ratios=(2.4, 1), width_ratios=(1.4, 1))
        upper = figure.add_subplot(grid[0, 0])
        lower = figure.add_subplot(grid[1, 0], sharex=upper)
        low, high = _span(told)
        upper.set_xlim(low, high)
        for axes in (upper, lower):
            _lines(axes, told)
        upper.tick_params(labelbottom=False)
        _magnitude(upper, told, response)
        _coherence(lower, told, response)
        lower.set_xlabel("frequency (Hz)")
        _draw_estimates(figure.add_subplot(grid[:, 1]), told)
        figure.align_ylabels()
        figure.suptitle(no_formula(f"{headline(told)}, {cell.verdict}"), fontweight="bold")
    return figure


def _span(told: Evidence) -> tuple[float, float]:
    """What is shown of the axis of frequencies: around the mode, by whatever way it is known."""
    paper = told.paper
    middle = math.sqrt(math.prod(paper.band_Hz)) if paper.band_Hz else None
    centre = told.cell.frequency_Hz or paper.frequency_Hz or middle
    return (_LEFT * centre, _RIGHT * centre) if centre else _SHOWN


def _lines(axes: Axes, told: Evidence) -> None:
    """The frequencies in question, over the whole height."""
    cell = told.cell
    if cell.rotor_held_frequency_Hz is not None:
        axes.axvline(cell.rotor_held_frequency_Hz, color=HELD, lw=1.2, ls=(0, (1, 1.5)), zorder=1)
    if told.paper.frequency_Hz is not None and cell.method != "paper":
        axes.axvline(told.paper.frequency_Hz, color=PAPER, lw=1.1, ls=(0, (5, 2)), zorder=1)
    if cell.frequency_Hz is not None:
        half = COVERAGE * (cell.standard_uncertainty_Hz or 0.0)
        colour = CONDITION_COLOURS[cell.condition]
        axes.axvspan(
            cell.frequency_Hz - half, cell.frequency_Hz + half, color=colour, alpha=0.28, lw=0, zorder=0.5
        )


def _magnitude(axes: Axes, told: Evidence, response: Response | None) -> None:
    cell = told.cell
    axes.set_title("Frequency response, and where each number lies on it", loc="left")
    if response is None:
        _nothing(axes, told)
        return
    low, high = axes.get_xlim()
    shown = (response.frequency >= low) & (response.frequency <= high)
    f = response.frequency[shown]
    if len(response.names) > 1:
        for index, part in enumerate(response.each):
            name = "each response" if index == 0 else None
            axes.semilogy(f, np.abs(part[shown]), color=_SENSOR, lw=0.9, label=name)
    colour = CONDITION_COLOURS[cell.condition]
    axes.semilogy(f, response.magnitude[shown], color=colour, lw=2.0, label=_name(response))
    paper = told.paper.frequency_Hz
    if paper is not None and cell.method != "paper":
        axes.plot(
            [paper], [response.at(paper)], "D", ms=7.5, mfc="none", mec=PAPER, mew=1.8, zorder=4,
            label=f"the paper's peak, {paper:.1f} Hz",
        )  # fmt: skip
    if cell.frequency_Hz is not None:
        star: Any = {**STAR, "markersize": 15}
        half = COVERAGE * (cell.standard_uncertainty_Hz or 0.0)
        axes.plot(
            [cell.frequency_Hz], [response.at(cell.frequency_Hz)], linestyle="none", zorder=5,
            label=f"rotor free, {cell.frequency_Hz:.1f} ± {half:.1f} Hz (95 %)", **star,
        )  # fmt: skip
    if cell.rotor_held_frequency_Hz is not None:
        half = COVERAGE * (cell.rotor_held_standard_uncertainty_Hz or 0.0)
        axes.plot(
            [], [], color=HELD, lw=1.2, ls=(0, (1, 1.5)),
            label=f"rotor held, {cell.rotor_held_frequency_Hz:.1f} ± {half:.1f} Hz (95 %)",
        )  # fmt: skip
    axes.set_ylabel(f"|FRF| (m/s² per {response.unit})")
    plain_numbers(axes)
    bottom, top = axes.get_ylim()
    room = 0.08 if cell.frequency_Hz is not None else 0.3  # for the reason of a refusal
    axes.set_ylim(bottom, top * (top / bottom) ** room)
    axes.legend(
        loc="upper right", fontsize=8.5, handlelength=1.6, frameon=True, framealpha=0.85, edgecolor="none"
    )
    if cell.frequency_Hz is None:
        reason = cell.reasons[0] if cell.reasons else "no reason was given"
        axes.text(
            0.015, 0.97, no_formula(textwrap.fill(f"refused: {reason}", 30)), transform=axes.transAxes,
            va="top", fontsize=9, color="#8B1A1A", bbox={"fc": "white", "ec": "none", "alpha": 0.85},
        )  # fmt: skip


def _name(response: Response) -> str:
    """What the curve is of; a long list of sensors is counted."""
    what = ", ".join(response.names) if len(response.names) < 3 else f"{len(response.names)} responses"
    return no_formula(f"FRF ({response.estimator}), {what}")


def _coherence(axes: Axes, told: Evidence, response: Response | None) -> None:
    axes.set(ylim=(0, 1.05), yticks=(0, 0.5, 1), ylabel="coherence (1)")
    if response is None:
        return
    low, high = axes.get_xlim()
    shown = (response.frequency >= low) & (response.frequency <= high)
    colour = CONDITION_COLOURS[told.cell.condition]
    f = response.frequency[shown]
    if len(response.names) > 1:
        for part in response.coherence:
            axes.plot(f, part[shown], color=_SENSOR, lw=0.9)
    axes.plot(f, response.coherence.mean(axis=0)[shown], color=colour, lw=1.6)
    count = told.cell.repetitions
    if count > 0:
        # Of a single repetition it is 1 whatever the record holds.
        axes.axhline(1 / count, color="0.45", lw=0.8, ls=":")
        words, low = ("by chance alone", 2) if count > 1 else ("one repetition: always 1", -12)
        axes.annotate(
            words, (1, 1 / count), (-4, low), xycoords=("axes fraction", "data"),
            textcoords="offset points", ha="right", va="bottom", fontsize=8, color="0.4",
        )  # fmt: skip


def _nothing(axes: Axes, told: Evidence) -> None:
    """What stands where a cell has no frequency response."""
    reason = told.cell.reasons[0] if told.cell.reasons else "nothing was measured"
    axes.text(
        0.5, 0.5, no_formula(textwrap.fill(f"no frequency response: {reason}", 60)), ha="center", va="center",
        transform=axes.transAxes, color="#8B1A1A",
    )  # fmt: skip
    axes.set(yticks=[], ylabel="|FRF| (m/s² per input)")


def _draw_estimates(axes: Axes, told: Evidence) -> None:
    """Draw every estimate of the frequency with its 95 % interval."""
    cell, paper = told.cell, told.paper
    colour = CONDITION_COLOURS[cell.condition]
    first = "the run, all cells as one" if cell.method == "joint" else "the run, by the paper's peak"
    rows: list[tuple[str, float | None, float | None, dict[str, Any]]] = [
        (first, cell.frequency_Hz, cell.standard_uncertainty_Hz, {"color": colour, "fmt": "none"})
    ]
    if cell.frequency_Hz is not None and cell.deviation_Hz is not None:
        own = cell.frequency_Hz + cell.deviation_Hz
        look = {"color": colour, "fmt": "s", "mfc": "white", "ms": 6}
        # Noise alone would make the bar shorter than cells of one run lie apart.
        spread = max(cell.deviation_standard_uncertainty_Hz or 0.0, told.scatter or 0.0)
        rows.append(("this cell's part of it", own, spread, look))
    if cell.method != "paper":
        look = {"color": PAPER, "fmt": "D", "mfc": "none", "mew": 1.8, "ms": 6.5}
        rows.append(("the paper's peak", paper.frequency_Hz, paper.standard_uncertainty_Hz, look))
    axes.set_title("Estimates with their 95 % intervals", loc="left")
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
