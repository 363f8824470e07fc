"""FRF of one cell with the star on its axial natural frequency: Fig. 3 of the paper."""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np

from ballscrew.base.errors import InputError
from ballscrew.base.words import plural
from ballscrew.modal.cell import CellResult
from ballscrew.modal.natural_frequency import NaturalFrequency
from ballscrew.modal.response import FrequencyResponse
from ballscrew.modal.run import Run
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes, Figure
from ballscrew.report.measured import (
    TRUE,
    Response,
    axis_title,
    cell_of,
    half_width,
    plain_numbers,
    response_of,
)

_DEFAULT_SPAN = (10.0, 400.0)  # Hz, where the cell has no band
_LOWEST = 10.0  # Hz
_AROUND = 3.0  # times the frequency, and its inverse, shown of a single mode
_COHERENT = 0.5
_BEYOND = 0.75  # of the band's width, shown on either side
_BAND, _SENSORS = "#F1F1EC", ("#56B4E9", "#E69F00", "#999999")


def draw_frf(
    run: Run, position: float, condition: str, *, truth: float | None = None, motion: int = 0
) -> Figure:
    """Draw magnitude, phase and coherence of one cell, with its band, star and 95 % interval.

    Parameters
    ----------
    run : Run
        As :func:`~ballscrew.modal.analyze.analyze` returns it.
    position : float
        Position of the stop, m.
    condition : str
        PA, PD, NA or ND.
    truth : float, optional
        True frequency, Hz.
    motion : int
        Number of the motion, from 0.

    Returns
    -------
    Figure
        Not yet written. A refused cell is drawn with the reason.

    Raises
    ------
    InputError
        If the run has no such cell, or the cell no frequency response.
    """
    cell = cell_of(run, position, condition, motion)
    response = response_of(run, position, condition, motion)
    if cell is None:
        stops = sorted({c.position_m for c in run.cells})
        raise InputError(
            f"the run has no cell at {1e3 * position:g} mm, {condition}, motion {motion}; it has stops at "
            f"{', '.join(f'{1e3 * x:g}' for x in stops)} mm"
        )
    if response is None:
        why = (*cell.reasons, "nothing was measured")[0]
        raise InputError(f"the cell at {1e3 * position:g} mm, {condition} has no frequency response: {why}")
    figure = _draw(cell, response, truth)
    title = f"{axis_title(run)}: {1e3 * position:g} mm, {condition}, {cell.repetitions} repetitions"
    figure.suptitle(canvas.escape_dollars(title), fontweight="bold")
    return figure


@canvas.styled()
def _draw(cell: CellResult, response: Response, truth: float | None) -> Figure:
    figure = canvas.blank(8, 7.4)
    upper, phase, lower = figure.subplots(3, 1, sharex=True, height_ratios=(2.4, 1, 0.8))
    span = _span(cell, response)
    colour, half = canvas.CONDITION_COLOURS[cell.condition], half_width(cell.standard_uncertainty_Hz)
    for axes in (upper, phase, lower):
        if cell.band_Hz is not None:
            axes.axvspan(*cell.band_Hz, color=_BAND, zorder=0, lw=0)
        if truth is not None:
            axes.axvline(truth, **TRUE)
        if cell.frequency_Hz is not None:
            low, high = cell.frequency_Hz - half, cell.frequency_Hz + half
            axes.axvspan(low, high, color=colour, alpha=0.22, lw=0, zorder=0.5)
    shown = response.within(*span)
    _magnitude(upper, response, shown, colour)
    _phase_and_coherence(phase, lower, response, shown)
    upper.set_xlim(*span)
    plain_numbers(upper)
    figure.align_ylabels()
    figure.draw_without_rendering()  # the words must know the limits
    _words(upper, cell, response, truth)
    return figure


def _span(cell: CellResult, response: Response) -> tuple[float, float]:
    low, high = _DEFAULT_SPAN
    if cell.band_Hz is not None:
        low, high = cell.band_Hz
        low, high = max(_LOWEST, low - _BEYOND * (high - low)), high + _BEYOND * (high - low)
    return max(low, float(response.frequency[0])), min(high, float(response.frequency[-1]))


def _magnitude(axes: Axes, response: Response, shown: Any, colour: str) -> None:
    f = response.frequency[shown]
    if len(response.names) > 1:
        for index, part in enumerate(response.each):
            axes.semilogy(f, np.abs(part[shown]), color=_SENSORS[index % len(_SENSORS)], lw=0.8)
    axes.semilogy(f, response.magnitude[shown], color=colour, lw=1.9)
    axes.set_ylabel(f"|FRF|, {response.estimator} (m/s² per {response.unit})")


def _phase_and_coherence(phase: Axes, coherence: Axes, response: Response, shown: Any) -> None:
    f = response.frequency[shown]
    for index, name in enumerate(response.names):
        look: Any = {"color": _SENSORS[index % len(_SENSORS)], "lw": 1.2}
        draw_phase(phase, f, response.each[index, shown], label=canvas.escape_dollars(name), **look)
        coherence.plot(f, response.coherence[index, shown], label=canvas.escape_dollars(name), **look)
    coherence.legend(ncols=3, loc="lower left", fontsize=8.5, handlelength=1.4)
    label_phase_and_coherence(phase, coherence)


def label_phase_and_coherence(phase: Axes, coherence: Axes) -> None:
    """Set limits, ticks and labels of the two panels beneath a magnitude."""
    phase.set(ylim=(-190, 190), yticks=(-180, -90, 0, 90, 180), ylabel="phase (°)")
    coherence.set(ylim=(0, 1.05), ylabel="coherence (1)", xlabel="frequency (Hz)")


def draw_response(axes: Axes, response: FrequencyResponse) -> None:
    """Draw the magnitude of a frequency response; light where the coherence is below a half.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    response : FrequencyResponse
        As :func:`~ballscrew.modal.response.frf` returns it.
    """
    magnitude = np.abs(response.frf)
    axes.loglog(response.frequency, magnitude, color="0.75", lw=0.9)
    coherent = np.where(response.coherence < _COHERENT, np.nan, magnitude)
    axes.loglog(response.frequency, coherent, color=canvas.ANF, lw=1.3)
    axes.set(xlabel="frequency (Hz)", ylabel=f"|FRF|, {response.estimator} (output per input)")
    axes.set_title(f"{plural(response.count, 'record')}; grey: coherence below {_COHERENT:g}", loc="left")


def draw_mode(axes: Axes, found: NaturalFrequency) -> None:
    """Draw the magnitude of the transients' FRF, with the natural frequency and its 95 % interval.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    found : NaturalFrequency
        As :func:`~ballscrew.modal.natural_frequency.natural_frequency` returns it.
    """
    assert found.response is not None  # noqa: S101  natural_frequency gives it
    f, (low, high) = found.frequency.value, found.frequency.interval
    shown = (found.response.frequency > f / _AROUND) & (found.response.frequency < f * _AROUND)
    magnitude = np.abs(found.response.frf)
    axes.axvspan(low, high, color=canvas.ANF, alpha=0.22, lw=0)
    axes.semilogy(found.response.frequency[shown], magnitude[shown], color=canvas.ANF, lw=1.3)
    height = float(np.interp(f, found.response.frequency, magnitude))
    canvas.draw_star(axes, f, height, 14)
    axes.set(xlabel="frequency (Hz)", ylabel="|FRF| (output per input)")
    axes.set_title(f"natural frequency {found.frequency}, 95 % shaded: {found.verdict}", loc="left")


def draw_phase(axes: Axes, frequency: Any, response: Any, **look: Any) -> None:
    """Draw a phase, interrupted where it passes ±180°.

    Parameters
    ----------
    axes : Axes
        Axes to draw in.
    frequency : ndarray, shape (n,)
        Hz.
    response : ndarray, shape (n,)
        Complex FRF.
    **look
        Properties of the line.
    """
    angle = np.degrees(np.angle(response))
    jumps = np.flatnonzero(np.abs(np.diff(angle)) > 180) + 1
    axes.plot(np.insert(frequency, jumps, frequency[jumps]), np.insert(angle, jumps, np.nan), **look)


def _words(axes: Axes, cell: CellResult, response: Response, truth: float | None) -> None:
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.14)  # headroom for the words
    if cell.band_Hz is not None:
        place = (cell.band_Hz[0], 0)
        canvas.note(
            axes, "search band", place, (4, 5), coords=canvas.TOP_EDGE, va="baseline", colour="0.4", size=8.5
        )
    reason = textwrap.fill((*cell.reasons, "no reason given")[0], 40)
    if cell.frequency_Hz is None:
        text = canvas.escape_dollars(f"refused: {reason}")
        axes.text(0.02, 0.95, text, transform=axes.transAxes, va="top", fontsize=9, color=canvas.ERROR_COLOUR)
    else:
        height = response.at(cell.frequency_Hz)
        canvas.draw_star(axes, cell.frequency_Hz, height, 16)
        half = half_width(cell.standard_uncertainty_Hz)
        beside = (cell.frequency_Hz - half, height)
        canvas.note(axes, f"{cell.frequency_Hz:.1f} ± {half:.1f} Hz (95 %)", beside, (-6, 6), size=10)
        if cell.verdict != "good":
            canvas.note(axes, canvas.escape_dollars(f"{cell.verdict}: {reason}"), beside, (-6, -6), size=8.5)
    if truth is not None:
        side = 4
        if cell.frequency_Hz is not None and truth < cell.frequency_Hz:
            side = -4
        canvas.note(
            axes, f"true: {truth:.1f} Hz", (truth, 1), (side, -4), coords=canvas.TOP_EDGE, style="italic"
        )
