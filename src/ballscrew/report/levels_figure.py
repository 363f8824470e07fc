"""FRFs under several loads at two positions, with their stars: Fig. 8 of the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ballscrew.base.errors import InputError
from ballscrew.modal.cell import CellResult
from ballscrew.modal.run import Run
from ballscrew.report import canvas
from ballscrew.report.axis_figures import LOAD_MAP
from ballscrew.report.canvas import Axes, Figure
from ballscrew.report.measured import Response, cell_of, half_width, plain_numbers, response_of, true_at
from ballscrew.report.shift_figure import panel_title

_BEYOND = 0.2  # of the lowest and highest frequency, shown beside them
_DEFAULT_SPAN = (10.0, 400.0)  # Hz, where no frequency is known
_DASHED = (0, (3, 2))


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """One cell under one load.

    Parameters
    ----------
    load : float
        kg.
    cell : CellResult or None
        None where the run has no such cell.
    response : Response or None
        None where the cell has no spectra.
    true : float or None
        True frequency, Hz.
    """

    load: float
    cell: CellResult | None
    response: Response | None
    true: float | None

    @property
    def frequency(self) -> float | None:
        """Measured frequency, Hz; None where refused."""
        if self.cell is None:
            return None
        return self.cell.frequency_Hz


def draw_levels(
    runs: Mapping[float, Run],
    positions: Sequence[float] = (0.0, 0.09),
    condition: str = "ND",
    *,
    truths: Mapping[float, Mapping[float, float]] | None = None,
    motion: int = 0,
) -> Figure:
    """Draw the FRF of each load at some positions, a panel a position.

    Parameters
    ----------
    runs : mapping of float to Run
        By load, kg.
    positions : sequence of float
        Positions of the stops, m.
    condition : str
        PA, PD, NA or ND.
    truths : mapping of float to mapping, optional
        By load, kg: true frequency, Hz, by position, m; a short line in the load's colour.
    motion : int
        Number of the motion, from 0.

    Returns
    -------
    Figure
        Not yet written. The curve of a refused cell is dashed and has no star.

    Raises
    ------
    InputError
        If there is no run, or a run contains no frequency response.
    """
    if not runs or not positions:
        raise InputError("no run or no position was given; the picture needs one of each, or more")
    panels = {}
    for position in positions:
        levels = []
        for load, run in sorted(runs.items()):
            cell = cell_of(run, position, condition, motion)
            response = response_of(run, position, condition, motion)
            true = true_at((truths or {}).get(load), position)
            levels.append(_Level(load, cell, response, true))
        panels[position] = levels
    return _draw(panels, condition, true=bool(truths))


@canvas.styled()
def _draw(panels: Mapping[float, Sequence[_Level]], condition: str, *, true: bool) -> Figure:
    levels = [level for panel in panels.values() for level in panel]
    loads = sorted({level.load for level in levels})
    colours = dict(zip(loads, canvas.colours_of(LOAD_MAP, len(loads), 0.9), strict=True))
    figure = canvas.blank(4.4 * len(panels) + 0.9, 5.0)
    rows: Any = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)
    span = _span(levels)
    for index, (axes, (position, panel)) in enumerate(zip(rows[0], panels.items(), strict=True)):
        for level in panel:
            _level(axes, level, colours[level.load], span)
        _name_refused(axes, panel)
        axes.set_title(panel_title(index, (position, condition)), loc="left")
        axes.set_xlabel("frequency (Hz)")
    units = [level.response.unit for level in levels if level.response is not None]
    rows[0, 0].set_ylabel(f"|FRF| (m/s² per {(*units, 'N m')[0]})")
    rows[0, 0].set_xlim(*span)
    plain_numbers(rows[0, 0])
    refused = any(level.frequency is None for level in levels)
    _legend(figure, colours, refused=refused, true=true)
    return figure


def _span(levels: Sequence[_Level]) -> tuple[float, float]:
    """Frequencies shown: around those measured, true, and in the middle of the bands."""
    known = []
    for level in levels:
        known += [level.frequency, level.true]
        if level.cell is not None and level.cell.band_Hz is not None:
            known.append(sum(level.cell.band_Hz) / 2)
    frequencies = np.array(known, dtype=np.float64)
    if np.isnan(frequencies).all():
        return _DEFAULT_SPAN
    return (1 - _BEYOND) * float(np.nanmin(frequencies)), (1 + _BEYOND) * float(np.nanmax(frequencies))


def _level(axes: Axes, level: _Level, colour: Any, span: tuple[float, float]) -> None:
    response, f = level.response, level.frequency
    if response is not None:
        style: Any = {"lw": 1.6}
        if f is None:
            style = {"lw": 1.0, "ls": _DASHED}
        shown = response.within(*span)
        axes.semilogy(response.frequency[shown], response.magnitude[shown], color=colour, **style)
        if f is not None and level.cell is not None:
            half = half_width(level.cell.standard_uncertainty_Hz)
            axes.errorbar([f], [response.at(f)], xerr=[half], color="black", lw=1.1, capsize=3, zorder=6)
            canvas.draw_star(axes, f, response.at(f))
    if level.true is not None:
        axes.plot(
            [level.true, level.true], [0, 0.09], color=colour, lw=1.6, transform=axes.get_xaxis_transform(),
            zorder=3, label="_true",
        )  # fmt: skip


def _name_refused(axes: Axes, levels: Sequence[_Level]) -> None:
    refused = [f"{level.load:g} kg" for level in levels if level.frequency is None]
    if refused:
        words = f"refused: {', '.join(refused)}"
        axes.text(
            0.98, 0.985, words, transform=axes.transAxes, ha="right", va="top", fontsize=8.5, color="0.35"
        )


def _legend(figure: Figure, colours: Mapping[float, Any], *, refused: bool, true: bool) -> None:
    entries = []
    for load, colour in colours.items():
        entries.append(canvas.legend_line(f"{load:g} kg", color=colour, lw=2.4))
    entries.append(canvas.legend_mark("ANF, 95 %", **canvas.STAR))
    if refused:
        entries.append(canvas.legend_line("refused", color="0.4", lw=1.0, linestyle=_DASHED))
    if true:
        entries.append(canvas.legend_mark("true, below", marker="|", ms=9, mew=1.6, color="0.4"))
    figure.legend(handles=entries, title="load", loc="outside right center", fontsize=9, alignment="left")
