"""Response of torque to motion with its resonance and antiresonance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ballscrew.modal.resonance_verdicts import EstimatedMode
from ballscrew.modal.resonances import Resonances
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes, Figure
from ballscrew.report.frf_figure import draw_phase, label_phase_and_coherence

_WIDEST = 4  # responses in a picture
_BEYOND = 1.15  # of the fitted band, shown on either side
_COLOURS = {"resonance": canvas.ANF, "antiresonance": canvas.BACKLASH}


@canvas.styled()
def draw_responses(cells: Sequence[tuple[float, Resonances]]) -> Figure:
    """Draw magnitude, phase and coherence of each response, with 95 % intervals.

    Parameters
    ----------
    cells : sequence of (float, Resonances)
        Position (m) and result; the first four are drawn.

    Returns
    -------
    Figure
        Not yet written.
    """
    cells = cells[:_WIDEST]
    figure = canvas.blank(max(8.0, 4.5 * len(cells)), 7.4)
    grid = figure.subplots(3, len(cells), sharex="col", squeeze=False, height_ratios=(2.4, 1, 0.8))
    for (upper, phase, lower), (position, found) in zip(grid.T, cells, strict=True):
        draw_resonances(upper, found)
        upper.set_title(f"{1e3 * position:g} mm", loc="left", fontweight="bold")
        upper.set_xlabel("")
        shown = _shown(found)
        f = found.response.frequency[shown]
        draw_phase(phase, f, found.response.frf[shown], color="0.6", lw=1.0)
        if found.model is not None:
            draw_phase(phase, found.model.frequency, found.model.frf, color=canvas.ANF, lw=1.2)
        lower.plot(f, found.response.coherence[shown], color="0.4", lw=1.2)
        label_phase_and_coherence(phase, lower)
        for axes in (phase, lower):
            _draw_intervals(axes, found)
    figure.align_ylabels()
    return figure


def draw_resonances(axes: Axes, found: Resonances) -> None:
    """Draw the magnitude of a response, measured and fitted, with both frequencies.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    found : Resonances
        As :func:`~ballscrew.modal.resonances.resonances` returns it.
    """
    shown = _shown(found)
    response = found.response
    axes.loglog(
        response.frequency[shown],
        np.abs(response.frf[shown]),
        color="0.6",
        lw=1.2,
        label=f"mean of {response.count} segments",
    )
    if found.model is not None:
        model = found.model
        axes.loglog(model.frequency, np.abs(model.frf), color=canvas.ANF, lw=1.4, label="model")
    _draw_intervals(axes, found)
    for name, mode in _modes(found):
        label = f"{name}: refused"
        if mode.frequency is not None:
            low, high = mode.frequency.interval
            half = (high - low) / 2
            label = f"{name} {mode.frequency.value:.1f} ± {half:.1f} Hz (95 %), {mode.verdict}"
        axes.plot([], [], color=_COLOURS[name], lw=6, alpha=0.4, label=label)
    axes.legend(loc="best", fontsize=8.5)
    axes.xaxis.set_minor_formatter("{x:g}")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.tick_params(axis="x", which="minor", labelsize=7.5)
    axes.set(xlabel="frequency (Hz)", ylabel="|FRF| (output per input)")


def _modes(found: Resonances) -> tuple[tuple[str, EstimatedMode], ...]:
    return ("resonance", found.resonance), ("antiresonance", found.antiresonance)


def _draw_intervals(axes: Axes, found: Resonances) -> None:
    for name, mode in _modes(found):
        if mode.frequency is not None:
            low, high = mode.frequency.interval
            axes.axvspan(low, high, color=_COLOURS[name], alpha=0.3, lw=0)
            axes.axvline(mode.frequency.value, color=_COLOURS[name], lw=0.8)


def _shown(found: Resonances) -> Any:
    f, (low, high) = found.response.frequency, found.band
    return (f >= low / _BEYOND) & (f <= high * _BEYOND)
