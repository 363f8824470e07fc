"""The picture of one cell's FRF with the star on its axial natural frequency: Fig. 3 of the paper."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.base.errors import InputError
from ballscrew.modal.run import CellResult, Run
from ballscrew.report.canvas import blank, note, styled
from ballscrew.report.measured import COVERAGE, TRUE, Response, cell_of, plain_numbers, response_of
from ballscrew.report.style import CONDITION_COLOURS, STAR, no_formula

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_frf"]

_SHOWN = (10.0, 400.0)  # Hz, where the cell has no band
_BEYOND = 0.75  # of the band's width, shown on either side
_BAND, _SENSORS = "#F1F1EC", ("#56B4E9", "#E69F00", "#999999")


def draw_frf(
    run: Run, position: float, condition: str, *, truth: float | None = None, motion: int = 0
) -> Figure:
    """Draw magnitude, phase and coherence of one cell, with its band, star and 95 % interval.

    Parameters
    ----------
    run : Run
        As :func:`~ballscrew.modal.analyze.analyze` gives it.
    position : float
        Of the stop, m.
    condition : str
        PA, PD, NA or ND.
    truth : float, optional
        True frequency, Hz.
    motion : int
        Which motion, from 0.

    Returns
    -------
    Figure
        Not yet written. Where the cell was refused, it says why.

    Raises
    ------
    InputError
        If the run has no such cell, or the cell no frequency response.
    """
    cell = cell_of(run, position, condition, motion)
    response = response_of(run, position, condition, motion)
    if cell is None:
        raise InputError(
            f"the run has no cell at {1e3 * position:g} mm, {condition}, motion {motion}; it has stops at "
            f"{', '.join(f'{1e3 * x:g}' for x in sorted({c.position_m for c in run.cells}))} mm"
        )
    if response is None:
        why = cell.reasons[0] if cell.reasons else "nothing was measured"
        raise InputError(f"the cell at {1e3 * position:g} mm, {condition} has no frequency response: {why}")
    colour = CONDITION_COLOURS[condition]
    with styled():
        figure = blank(8, 7.4)
        upper, phase, lower = figure.subplots(3, 1, sharex=True, height_ratios=(2.4, 1, 0.8))
        low, high = _span(cell, response)
        shown = (response.frequency >= low) & (response.frequency <= high)
        for axes in (upper, phase, lower):
            if cell.band_Hz is not None:
                axes.axvspan(*cell.band_Hz, color=_BAND, zorder=0, lw=0)
            if truth is not None:
                axes.axvline(truth, **TRUE)
            if cell.frequency_Hz is not None:
                half = COVERAGE * (cell.standard_uncertainty_Hz or 0.0)
                left, right = cell.frequency_Hz - half, cell.frequency_Hz + half
                axes.axvspan(left, right, color=colour, alpha=0.22, lw=0, zorder=0.5)
        _magnitude(upper, response, shown, colour)
        _each(phase, lower, response, shown)
        upper.set_xlim(low, high)
        plain_numbers(upper)
        figure.align_ylabels()
        figure.draw_without_rendering()  # what is written must know the limits
        _words(upper, cell, response, truth)
        load = "" if run.mass_kg is None else f", load {run.mass_kg:g} kg"
        what = f"{1e3 * position:g} mm, {condition}{load}, {cell.repetitions} repetitions"
        figure.suptitle(no_formula(f"{run.axis or 'axis'}: {what}"), fontweight="bold")
    return figure


def _span(cell: CellResult, response: Response) -> tuple[float, float]:
    if cell.band_Hz is None:
        low, high = _SHOWN
    else:
        low, high = cell.band_Hz
        low, high = max(10.0, low - _BEYOND * (high - low)), high + _BEYOND * (high - low)
    return max(low, float(response.frequency[0])), min(high, float(response.frequency[-1]))


def _magnitude(axes: Axes, response: Response, shown: Any, colour: str) -> None:
    f = response.frequency[shown]
    if len(response.names) > 1:
        for index, part in enumerate(response.each):
            axes.semilogy(f, np.abs(part[shown]), color=_SENSORS[index % len(_SENSORS)], lw=0.8)
    axes.semilogy(f, response.magnitude[shown], color=colour, lw=1.9)
    axes.set_ylabel(f"|FRF|, {response.estimator} (m/s² per {response.unit})")


def _each(phase: Axes, coherence: Axes, response: Response, shown: Any) -> None:
    """Phase and coherence of each response; a phase that passes ±180° is not joined across the picture."""
    f = response.frequency[shown]
    for index, name in enumerate(response.names):
        look: Any = {"color": _SENSORS[index % len(_SENSORS)], "lw": 1.2}
        angle = np.degrees(np.angle(response.each[index, shown]))
        jumps = np.flatnonzero(np.abs(np.diff(angle)) > 180) + 1
        phase.plot(
            np.insert(f, jumps, f[jumps]), np.insert(angle, jumps, np.nan), label=no_formula(name), **look
        )
        coherence.plot(f, response.coherence[index, shown], label=no_formula(name), **look)
    phase.set(ylim=(-190, 190), yticks=(-180, -90, 0, 90, 180), ylabel="phase (°)")
    coherence.legend(ncols=3, loc="lower left", fontsize=8.5, handlelength=1.4)
    coherence.set(ylim=(0, 1.05), ylabel="coherence (1)", xlabel="frequency (Hz)")


def _words(axes: Axes, cell: CellResult, response: Response, truth: float | None) -> None:
    low, high = axes.get_ylim()
    top = high * (high / low) ** 0.14  # room for the words
    axes.set_ylim(low, top)
    if cell.band_Hz is not None:
        above: Any = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
        axes.annotate(
            "band that is searched", (cell.band_Hz[0], 0), (4, 5), color="0.4", fontsize=8.5, **above
        )
    if cell.frequency_Hz is not None:
        height = response.at(cell.frequency_Hz)
        axes.plot([cell.frequency_Hz], [height], linestyle="none", zorder=5, **{**STAR, "markersize": 16})
        half = COVERAGE * (cell.standard_uncertainty_Hz or 0.0)
        text = f"{cell.frequency_Hz:.1f} ± {half:.1f} Hz (95 %)"
        note(axes, text, (cell.frequency_Hz - half, height), (-6, 6), size=10)
        if cell.verdict != "good":
            note(
                axes,
                no_formula(f"{cell.verdict}: {_short(cell)}"),
                (cell.frequency_Hz - half, height),
                (-6, -6),
                size=8.5,
            )
    else:
        text = no_formula(f"refused: {_short(cell)}")
        axes.text(
            0.02, 0.95, text, transform=axes.transAxes, va="top", fontsize=9, color="#8B1A1A",
        )  # fmt: skip
    if truth is not None:
        side = 4 if cell.frequency_Hz is None or truth >= cell.frequency_Hz else -4
        beside: Any = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
        axes.annotate(
            f"true: {truth:.1f} Hz", (truth, 1), (side, -4), va="top", ha="left" if side > 0 else "right",
            fontsize=9, style="italic", **beside,
        )  # fmt: skip


def _short(cell: CellResult) -> str:
    return textwrap.fill(cell.reasons[0] if cell.reasons else "no reason was given", 40)
