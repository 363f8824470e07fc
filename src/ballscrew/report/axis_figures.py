"""Pictures of what Eq. (3) says: frequency against position, preload and load, support and rotor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.axis.frequency import Rotor, axial_natural_frequency
from ballscrew.axis.sheet import SUPPORTS, DataSheet
from ballscrew.base.arrays import Array
from ballscrew.report.canvas import blank, colours_of, label_ends, note, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["LOAD_MAP", "PRELOAD_MAP", "ROTOR_COLOURS", "draw_supports", "draw_theory"]

PRELOAD_MAP = "plasma"
LOAD_MAP = "cividis"
ROTOR_COLOURS: dict[Rotor, str] = {"free": "#332288", "held": "#B8860B"}
_SUPPORT_WORDS = {
    "fixed-free": "one end carries the thrust; the other hangs free",
    "fixed-supported": "one end carries; the other is guided and may slide: the same",
    "fixed-fixed": "both ends carry, with a thrust bearing each; dashed: one end",
}
_POINTS = 181
_STEEL = "0.35"


@dataclass(frozen=True, slots=True)
class _Column:
    """What is varied: its label, its values as they are shown, and position, load and preload in SI."""

    label: str
    shown: Array
    arguments: tuple[Any, Any, Any]


def draw_theory(
    sheet: DataSheet, *, preload_ratios: Sequence[float], loads: Sequence[float], travel: tuple[float, float]
) -> Figure:
    """Draw Fig. 2 of the paper: frequency against position for (a) several preloads, (b) several loads.

    The upper row holds the rotor, as Eq. (3) prints it; in the lower one it is free.

    Parameters
    ----------
    sheet : DataSheet
        The axis; its nominal preload in (b), no load in (a).
    preload_ratios : sequence of float
        P/Ca, each above 0.
    loads : sequence of float
        kg.
    travel : tuple of float
        From and to which position, m.

    Returns
    -------
    Figure
        Not yet written.
    """
    x = np.linspace(*travel, _POINTS)
    preloads = [part * sheet.screw.dynamic_load_rating for part in preload_ratios]
    with styled():
        figure = blank(8, 6.6)
        rows: Any = figure.subplots(2, 2, sharex=True, sharey="row")
        rotors: tuple[Rotor, ...] = ("held", "free")
        for row, rotor in zip(rows, rotors, strict=True):
            words = "held, Eq. (3)" if rotor == "held" else "free"
            row[0].set_ylabel(f"frequency, rotor {words} (Hz)")
            for axes, levels, name in ((row[0], preloads, PRELOAD_MAP), (row[1], loads, LOAD_MAP)):
                colours = colours_of(name, len(levels), 0.75)
                for level, colour in zip(levels, colours, strict=True):
                    load, preload = (0.0, level) if axes is row[0] else (level, None)
                    f = axial_natural_frequency(sheet, x, load, preload, rotor)
                    axes.plot(1e3 * x, f, color=colour, lw=1.7)
            row[0].set_xlim(1e3 * travel[0], 1e3 * travel[1])
        for axes in rows[1]:
            axes.set_xlabel("position (mm)")
        rows[0, 0].set_title("(a) preload, % of $C_a$; no load", loc="left")
        rows[0, 1].set_title(f"(b) load; preload {100 * sheet.screw.preload_ratio:g} %", loc="left")
        figure.draw_without_rendering()  # labels must know how large the axes are
        names = [f"{100 * part:g} %" for part in preload_ratios], [f"{load:g} kg" for load in loads]
        for row in rows:
            for axes, texts in zip(row, names, strict=True):
                lines = axes.get_lines()
                ends = [float(np.asarray(line.get_ydata())[-1]) for line in lines]
                label_ends(axes, ends, texts, [line.get_color() for line in lines])
    return figure


def draw_supports(
    sheet: DataSheet, *, travel: tuple[float, float], heaviest: float, preload_ratios: tuple[float, float]
) -> Figure:
    """Draw frequency against position, preload and load, for each support, rotor free and held.

    Parameters
    ----------
    sheet : DataSheet
        The axis; its own support is replaced by each.
    travel : tuple of float
        Lowest and highest position of the table, m; shaded in the first column. Preload and load are varied
        in its middle.
    heaviest : float
        Load, kg.
    preload_ratios : tuple of float
        Lowest and highest P/Ca.

    Returns
    -------
    Figure
        Not yet written.
    """
    middle = (travel[0] + travel[1]) / 2
    x = np.linspace(-sheet.screw.bearing_to_zero, sheet.travel_limit, _POINTS)
    ratios = np.linspace(*preload_ratios, _POINTS)
    loads = np.linspace(0.0, heaviest, _POINTS)
    columns = (
        _Column("position (mm)", 1e3 * x, (x, 0.0, None)),
        _Column(
            "preload (% of $C_a$)", 1e2 * ratios, (middle, 0.0, ratios * sheet.screw.dynamic_load_rating)
        ),
        _Column("load (kg)", loads, (middle, loads, None)),
    )
    with styled():
        figure = blank(8.4, 8.2, 0.07)
        grid = figure.add_gridspec(6, 3, height_ratios=(0.26, 1) * 3)
        shared: Any = None
        for number, support in enumerate(SUPPORTS):
            lowest = number == len(SUPPORTS) - 1
            for index, column in enumerate(columns):
                axes = figure.add_subplot(grid[2 * number + 1, index], sharey=shared)
                shared = shared or axes
                _curves(axes, column, replace(sheet, support=support), along=index == 0)
                axes.tick_params(labelleft=index == 0, labelbottom=lowest)
                axes.set_xlabel(column.label if lowest else "")
                axes.set_ylabel("" if index else "frequency (Hz)")
                if index == 0:
                    axes.axvspan(1e3 * travel[0], 1e3 * travel[1], color="0.93", zorder=0, lw=0)
                    _sketch(figure.add_subplot(grid[2 * number, 0], sharex=axes), sheet, support, travel)
            words = figure.add_subplot(grid[2 * number, 1:])
            words.axis("off")
            words.text(0, 0.75, support, fontweight="bold", fontsize=10.5, va="center")
            words.text(0, 0.15, _SUPPORT_WORDS[support], fontsize=9, va="center")
        along, _, first, second = figure.axes[:4]
        for line, rotor, offset in zip(along.get_lines(), ROTOR_COLOURS, ((4, 3), (-4, -3)), strict=True):
            at = _POINTS // 2
            point = float(np.asarray(line.get_xdata())[at]), float(np.asarray(line.get_ydata())[at])
            note(along, f"rotor {rotor}", point, offset, colour=ROTOR_COLOURS[rotor])
        for axes, text in ((first, "no load"), (second, f"P = {100 * sheet.screw.preload_ratio:g} %")):
            where = f"at {1e3 * middle:g} mm,\n{text}"
            axes.text(0.97, 0.97, where, transform=axes.transAxes, ha="right", va="top", fontsize=8.5)
    return figure


def _curves(axes: Axes, column: _Column, sheet: DataSheet, *, along: bool) -> None:
    one_end = replace(sheet, support=SUPPORTS[0])
    for rotor, colour in ROTOR_COLOURS.items():
        f = axial_natural_frequency(sheet, *column.arguments, rotor)
        axes.plot(column.shown, f, color=colour, lw=1.9)
        if sheet.support == "fixed-fixed":
            held_once = axial_natural_frequency(one_end, *column.arguments, rotor)
            axes.plot(column.shown, held_once, color=colour, lw=0.9, ls=(0, (3, 2)))
            if along:
                low = int(np.argmin(f))
                axes.plot(column.shown[low], f[low], "o", color=colour, ms=4)
    axes.set_xlim(column.shown[0], column.shown[-1])


def _sketch(axes: Axes, sheet: DataSheet, support: str, travel: tuple[float, float]) -> None:
    """The screw above the positions of its nut: thrust bearings black, a bearing that lets it slide white."""
    from matplotlib.patches import Rectangle

    near, far = -1e3 * sheet.screw.bearing_to_zero, 1e3 * sheet.travel_limit
    width = 0.028 * (far - near)
    axes.plot([near, far], [0, 0], color=_STEEL, lw=3.5, solid_capstyle="butt", clip_on=False)
    ends = {near: "black"}
    if support != "fixed-free":
        ends[far] = "black" if support == "fixed-fixed" else "white"
    for place, face in ends.items():
        for side in (0.28, -0.95):
            axes.add_patch(
                Rectangle((place - width / 2, side), width, 0.67, fc=face, ec="black", lw=0.9, clip_on=False)
            )  # fmt: skip
    nut = 1e3 * sum(travel) / 2
    block = Rectangle((nut - 1.6 * width, -0.62), 3.2 * width, 1.24, fc="0.6", ec="black", lw=0.9, zorder=3)
    axes.add_patch(block)
    axes.set_ylim(-1.2, 1.2)
    axes.axis("off")
