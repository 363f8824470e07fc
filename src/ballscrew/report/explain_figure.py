"""The picture that explains the result of one cell."""

from __future__ import annotations

import math
import textwrap
from typing import Any

import numpy as np

from ballscrew.modal.evidence import Evidence
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes, Figure
from ballscrew.report.explain_words import headline
from ballscrew.report.measured import Response, half_width, plain_numbers, response_of

_DEFAULT_SPAN = (40.0, 400.0)  # Hz, where no method finds the mode
_BELOW, _ABOVE = 0.55, 1.75  # of the mode's frequency: span of the frequency axis
_SENSOR = "0.72"
_ROTOR_HELD, _PAPER = "#332288", "#E69F00"
_ROTOR_HELD_LINE: Any = {"color": _ROTOR_HELD, "lw": 1.2, "ls": (0, (1, 1.5))}
_CLEAR: dict[str, Any] = {"fc": "white", "ec": "none", "alpha": 0.8, "pad": 1}
_LEGEND: dict[str, Any] = {
    "loc": "upper right",
    "fontsize": 8.5,
    "handlelength": 1.6,
    "frameon": True,
    "framealpha": 0.85,
    "edgecolor": "none",
}


@canvas.styled()
def draw_explanation(evidence: Evidence) -> Figure:
    """Draw the evidence for the result of a cell.

    On the left, over one frequency axis: the magnitude of the FRF with the star, its 95 % interval, the
    rotor-held frequency and the paper's peak, and the coherence. On the right all estimates of the frequency.

    Parameters
    ----------
    evidence : Evidence
        Evidence for the cell.

    Returns
    -------
    Figure
        Not yet written. A refused cell is drawn as well, with the reason.

    Raises
    ------
    InputError
        If the run was read from JSON and contains no frequency response.
    """
    cell = evidence.cell
    response = response_of(evidence.run, cell.position_m, cell.condition, cell.motion)
    figure = canvas.blank(13, 5.4, spacing=0.04)
    grid = figure.add_gridspec(2, 2, height_ratios=(2.4, 1), width_ratios=(1.4, 1))
    upper = figure.add_subplot(grid[0, 0])
    lower = figure.add_subplot(grid[1, 0], sharex=upper)
    upper.set_xlim(*_span(evidence))
    for axes in (upper, lower):
        _frequency_lines(axes, evidence)
    upper.tick_params(labelbottom=False)
    _magnitude(upper, evidence, response)
    _coherence(lower, evidence, response)
    lower.set_xlabel("frequency (Hz)")
    _estimates(figure.add_subplot(grid[:, 1]), evidence)
    figure.align_ylabels()
    figure.suptitle(canvas.escape_dollars(f"{headline(evidence)}, {cell.verdict}"), fontweight="bold")
    return figure


def _span(evidence: Evidence) -> tuple[float, float]:
    """Span of the frequency axis: around the mode, by whatever method it is known."""
    paper = evidence.paper
    centre = evidence.cell.frequency_Hz or paper.frequency_Hz
    if centre is None and paper.band_Hz is not None:
        centre = math.sqrt(math.prod(paper.band_Hz))
    if not centre:
        return _DEFAULT_SPAN
    return _BELOW * centre, _ABOVE * centre


def _paper_peak(evidence: Evidence) -> float | None:
    """Peak of the FRF, Hz; None where it is the result itself, or refused."""
    if evidence.cell.method == "paper":
        return None
    return evidence.paper.frequency_Hz


def _frequency_lines(axes: Axes, evidence: Evidence) -> None:
    """Draw the frequencies over the whole height."""
    cell, peak = evidence.cell, _paper_peak(evidence)
    if cell.rotor_held_frequency_Hz is not None:
        axes.axvline(cell.rotor_held_frequency_Hz, zorder=1, **_ROTOR_HELD_LINE)
    if peak is not None:
        axes.axvline(peak, color=_PAPER, lw=1.1, ls=(0, (5, 2)), zorder=1)
    _interval(axes, evidence, alpha=0.28)


def _interval(axes: Axes, evidence: Evidence, alpha: float) -> None:
    """Shade the 95 % interval of the result."""
    cell = evidence.cell
    if cell.frequency_Hz is not None:
        half, colour = half_width(cell.standard_uncertainty_Hz), canvas.CONDITION_COLOURS[cell.condition]
        low, high = cell.frequency_Hz - half, cell.frequency_Hz + half
        axes.axvspan(low, high, color=colour, alpha=alpha, lw=0, zorder=0.5)


def _magnitude(axes: Axes, evidence: Evidence, response: Response | None) -> None:
    cell = evidence.cell
    axes.set_title("Frequency response", loc="left")
    if response is None:
        _nothing(axes, evidence)
        return
    shown = response.within(*axes.get_xlim())
    f = response.frequency[shown]
    if len(response.names) > 1:
        for part in response.each:
            axes.semilogy(f, np.abs(part[shown]), color=_SENSOR, lw=0.9, label="each response")
    colour = canvas.CONDITION_COLOURS[cell.condition]
    axes.semilogy(f, response.magnitude[shown], color=colour, lw=2.0, label=_name(response))
    _mark_frequencies(axes, evidence, response)
    axes.set_ylabel(f"|FRF| (m/s² per {response.unit})")
    plain_numbers(axes)
    headroom = 0.08
    if cell.frequency_Hz is None:
        headroom = 0.3  # for the reason of the refusal
        reason = f"refused: {(*cell.reasons, 'no reason given')[0]}"
        axes.text(
            0.015, 0.97, canvas.escape_dollars(textwrap.fill(reason, 30)), transform=axes.transAxes, va="top",
            fontsize=9, color=canvas.ERROR_COLOUR, bbox={"fc": "white", "ec": "none", "alpha": 0.85},
        )  # fmt: skip
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top * (top / bottom) ** headroom)
    handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    axes.legend(handles.values(), handles.keys(), **_LEGEND)


def _mark_frequencies(axes: Axes, evidence: Evidence, response: Response) -> None:
    """Mark the result and the paper's peak on the FRF, and name them and the rotor-held frequency."""
    cell, peak = evidence.cell, _paper_peak(evidence)
    if peak is not None:
        axes.plot(
            [peak], [response.at(peak)], "D", ms=7.5, mfc="none", mec=_PAPER, mew=1.8, zorder=4,
            label=f"peak of the FRF (paper), {peak:.1f} Hz",
        )  # fmt: skip
    if cell.frequency_Hz is not None:
        half = half_width(cell.standard_uncertainty_Hz)
        label = f"rotor free, {cell.frequency_Hz:.1f} ± {half:.1f} Hz (95 %)"
        canvas.draw_star(axes, cell.frequency_Hz, response.at(cell.frequency_Hz), 15, label)
    if cell.rotor_held_frequency_Hz is not None:
        half = half_width(cell.rotor_held_standard_uncertainty_Hz)
        label = f"rotor held, {cell.rotor_held_frequency_Hz:.1f} ± {half:.1f} Hz (95 %)"
        axes.plot([], [], label=label, **_ROTOR_HELD_LINE)


def _name(response: Response) -> str:
    """Name of the curve; many sensors are counted."""
    sensors = ", ".join(response.names)
    if len(response.names) > 2:
        sensors = f"{len(response.names)} responses"
    return canvas.escape_dollars(f"FRF ({response.estimator}), {sensors}")


def _coherence(axes: Axes, evidence: Evidence, response: Response | None) -> None:
    axes.set(ylim=(0, 1.05), yticks=(0, 0.5, 1), ylabel="coherence (1)")
    if response is None:
        return
    shown = response.within(*axes.get_xlim())
    f = response.frequency[shown]
    if len(response.names) > 1:
        for part in response.coherence:
            axes.plot(f, part[shown], color=_SENSOR, lw=0.9)
    colour = canvas.CONDITION_COLOURS[evidence.cell.condition]
    axes.plot(f, response.coherence.mean(axis=0)[shown], color=colour, lw=1.6)
    count = evidence.cell.repetitions
    if count < 1:
        return
    axes.axhline(1 / count, color="0.45", lw=0.8, ls=":")
    words, offset = "unrelated signals", (-4, 2)
    if count == 1:
        words, offset = "one repetition: always 1", (-4, -12)
    canvas.note(
        axes, words, (1, 1 / count), offset, coords=canvas.SIDE_EDGE, va="bottom", size=8, colour="0.4"
    )


def _nothing(axes: Axes, evidence: Evidence) -> None:
    """Write why a cell has no frequency response."""
    reason = (*evidence.cell.reasons, "nothing was measured")[0]
    text = canvas.escape_dollars(textwrap.fill(f"no frequency response: {reason}", 60))
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes, color=canvas.ERROR_COLOUR)
    axes.set(yticks=[], ylabel="|FRF| (m/s² per input)")


Row = tuple[str, float | None, float | None, dict[str, Any]]


def _rows(evidence: Evidence) -> list[Row]:
    """Name, frequency, standard uncertainty and look of each estimate, the result first."""
    cell, paper = evidence.cell, evidence.paper
    colour = canvas.CONDITION_COLOURS[cell.condition]
    name = "the run, by the peak of the FRF (paper)"
    if cell.method == "joint":
        name = "the run, one model of all cells"
    rows: list[Row] = [
        (name, cell.frequency_Hz, cell.standard_uncertainty_Hz, {"color": colour, "fmt": "none"})
    ]
    if cell.frequency_Hz is not None and cell.deviation_Hz is not None:
        own = cell.frequency_Hz + cell.deviation_Hz
        # Noise alone would make the bar shorter than the scatter of the cells of one run.
        spread = max(cell.deviation_standard_uncertainty_Hz or 0.0, evidence.scatter or 0.0)
        look = {"color": colour, "fmt": "s", "mfc": "white", "ms": 6}
        rows.append(("this cell's data in that model", own, spread, look))
    if cell.method != "paper":
        look = {"color": _PAPER, "fmt": "D", "mfc": "none", "mew": 1.8, "ms": 6.5}
        rows.append(("peak of the FRF (paper)", paper.frequency_Hz, paper.standard_uncertainty_Hz, look))
    return rows


def _estimates(axes: Axes, evidence: Evidence) -> None:
    """Draw every estimate of the frequency with its 95 % interval."""
    axes.set_title("Estimates of the frequency, 95 % intervals", loc="left")
    rows = _rows(evidence)
    for height, row in enumerate(reversed(rows)):
        _estimate(axes, height, row)
    _interval(axes, evidence, alpha=0.14)
    if evidence.cell.frequency_Hz is not None:
        canvas.draw_star(axes, evidence.cell.frequency_Hz, len(rows) - 1, 14)
    elif not any(frequency for _, frequency, _, _ in rows):
        axes.set_xticks([])
    axes.set(ylim=(-0.5, len(rows) - 0.25), yticks=[], xlabel="frequency (Hz)")
    axes.margins(x=0.12)


def _estimate(axes: Axes, height: int, row: Row) -> None:
    name, frequency, uncertainty, look = row
    text, colour = "refused", canvas.ERROR_COLOUR
    if frequency is not None:
        half = half_width(uncertainty)
        axes.errorbar([frequency], [height], xerr=[half], lw=1.6, capsize=3.5, zorder=3, **look)
        text, colour = f"{frequency:.1f} ± {half:.1f} Hz", "black"
    label: dict[str, Any] = {"coords": canvas.SIDE_EDGE, "va": "baseline", "bbox": _CLEAR, "zorder": 2}
    canvas.note(axes, name, (0, height), (4, 7), **label)
    canvas.note(axes, text, (1, height), (-4, 7), colour=colour, **label)
