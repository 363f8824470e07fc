"""FRFs under several loads at two positions, with their stars: Fig. 8 of the paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ballscrew.base.errors import InputError
from ballscrew.modal.run import Run
from ballscrew.report.axis_figures import LOAD_MAP
from ballscrew.report.canvas import blank, colours_of, styled
from ballscrew.report.measured import COVERAGE, cell_of, plain_numbers, response_of, true_at
from ballscrew.report.style import STAR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_levels"]

_BEYOND = 0.2  # of the lowest and highest frequency, shown beside them
_DASHED = (0, (3, 2))


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
        Of the stops, m.
    condition : str
        PA, PD, NA or ND.
    truths : mapping of float to mapping, optional
        By load, kg: true frequency, Hz, by position, m. A short line in the load's colour stands there.
    motion : int
        Which motion, from 0.

    Returns
    -------
    Figure
        Not yet written. The curve of a cell that was refused is dashed and has no star.

    Raises
    ------
    InputError
        If there is no run, or a run holds no frequency response.
    """
    if not runs or not positions:
        raise InputError("no run or no position was given; the picture needs one of each, or more")
    loads = sorted(runs)
    colours = dict(zip(loads, colours_of(LOAD_MAP, len(loads), 0.9), strict=True))
    with styled():
        figure = blank(4.4 * len(positions) + 0.9, 5.0)
        rows: Any = figure.subplots(1, len(positions), sharex=True, sharey=True, squeeze=False)
        low, high = _span(runs, positions, condition, truths, motion)
        for index, (axes, position) in enumerate(zip(rows[0], positions, strict=True)):
            unit = _panel(axes, runs, colours, (position, condition, motion), truths, (low, high))
            axes.set_title(f"({'abcdefgh'[index % 8]}) {1e3 * position:g} mm, {condition}", loc="left")
            axes.set_xlabel("frequency (Hz)")
            if index == 0:
                axes.set_ylabel(f"|FRF| (m/s² per {unit})")
        rows[0, 0].set_xlim(low, high)
        plain_numbers(rows[0, 0])
        _legend(figure, colours, refused=_refused(runs, positions, condition, motion), true=bool(truths))
    return figure


def _refused(runs: Mapping[float, Run], positions: Sequence[float], condition: str, motion: int) -> bool:
    found = [cell_of(run, x, condition, motion) for run in runs.values() for x in positions]
    return any(cell is None or cell.frequency_Hz is None for cell in found)


def _span(
    runs: Mapping[float, Run],
    positions: Sequence[float],
    condition: str,
    truths: Mapping[float, Mapping[float, float]] | None,
    motion: int,
) -> tuple[float, float]:
    """From somewhat below the lowest frequency to somewhat above the highest; else what the bands hold."""
    cells = [cell_of(run, x, condition, motion) for run in runs.values() for x in positions]
    found = [c.frequency_Hz for c in cells if c is not None and c.frequency_Hz is not None]
    known = [true_at((truths or {}).get(load), x) for load in runs for x in positions]
    found += [f for f in known if f is not None]
    found += [sum(c.band_Hz) / 2 for c in cells if c is not None and c.band_Hz is not None]
    if not found:
        return 10.0, 400.0
    return (1 - _BEYOND) * min(found), (1 + _BEYOND) * max(found)


def _panel(
    axes: Axes,
    runs: Mapping[float, Run],
    colours: Mapping[float, Any],
    where: tuple[float, str, int],
    truths: Mapping[float, Mapping[float, float]] | None,
    span: tuple[float, float],
) -> str:
    """One position; returns the input's unit."""
    unit, refused = "N m", []
    for load, colour in colours.items():
        cell, response = cell_of(runs[load], *where), response_of(runs[load], *where)
        found = None if cell is None else cell.frequency_Hz
        if found is None:
            refused.append(f"{load:g} kg")
        if response is not None:
            unit = response.unit
            shown = (response.frequency >= span[0]) & (response.frequency <= span[1])
            style: Any = {"lw": 1.0, "ls": _DASHED} if found is None else {"lw": 1.6}
            axes.semilogy(response.frequency[shown], response.magnitude[shown], color=colour, **style)
        if found is not None and cell is not None and response is not None:
            half = COVERAGE * (cell.standard_uncertainty_Hz or 0.0)
            height = response.at(found)
            axes.errorbar([found], [height], xerr=[half], color="black", lw=1.1, capsize=3, zorder=6)
            axes.plot([found], [height], linestyle="none", zorder=5, **{**STAR, "markersize": 11})
        known = true_at((truths or {}).get(load), where[0])
        if known is not None:
            axes.plot(
                [known, known], [0, 0.09], color=colour, lw=1.6, transform=axes.get_xaxis_transform(),
                zorder=3, label="_true",
            )  # fmt: skip
    if refused:
        words = f"refused: {', '.join(refused)}"
        axes.text(
            0.98, 0.985, words, transform=axes.transAxes, ha="right", va="top", fontsize=8.5, color="0.35"
        )
    return unit


def _legend(figure: Figure, colours: Mapping[float, Any], *, refused: bool, true: bool) -> None:
    from matplotlib.lines import Line2D

    entries: list[Any] = [
        Line2D([], [], color=colour, lw=2.4, label=f"{load:g} kg") for load, colour in colours.items()
    ]
    entries.append(Line2D([], [], linestyle="none", label="ANF, 95 %", **STAR))
    if refused:
        entries.append(Line2D([], [], color="0.4", lw=1.0, ls=_DASHED, label="refused"))
    if true:
        entries.append(
            Line2D([], [], linestyle="none", marker="|", ms=9, mew=1.6, color="0.4", label="true, below")
        )
    figure.legend(handles=entries, title="load", loc="outside right center", fontsize=9, alignment="left")
