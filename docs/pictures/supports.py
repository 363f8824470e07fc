"""Natural frequency by Eq. (3) against position, preload and load, for each support and rotor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.axis.frequency import axial_natural_frequency
from ballscrew.axis.sheet import SUPPORTS, DataSheet
from ballscrew.base.arrays import Array
from ballscrew.report.axis_figures import ROTOR_COLOURS
from ballscrew.report.canvas import blank, note, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SUPPORT_WORDS = {
    "fixed-free": "thrust bearing at one end; the other end is free",
    "fixed-supported": "thrust bearing at one end; the other end may slide: the same",
    "fixed-fixed": "thrust bearings at both ends; dashed: at one end only",
}
_FAR_END = {"fixed-free": None, "fixed-supported": "white", "fixed-fixed": "black"}
_POINTS = 181
_STEEL = "0.35"


@dataclass(frozen=True, slots=True)
class _Column:
    """Quantity that is varied: label, values as shown, and position, load and preload in SI."""

    label: str
    shown: Array
    arguments: tuple[Any, Any, Any]


@styled()
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
    columns = _columns(sheet, travel, heaviest, preload_ratios)
    figure = blank(8.4, 8.2, 0.07)
    grid = figure.add_gridspec(6, 3, height_ratios=(0.26, 1) * 3)
    shared: Any = None
    panels = np.empty((len(SUPPORTS), len(columns)), dtype=object)
    for number, support in enumerate(SUPPORTS):
        for index, column in enumerate(columns):
            axes = figure.add_subplot(grid[2 * number + 1, index], sharey=shared)
            shared = shared or axes
            panels[number, index] = axes
            _curves(axes, column, replace(sheet, support=support), along=index == 0)
            axes.tick_params(labelleft=index == 0, labelbottom=support == SUPPORTS[-1])
        along = panels[number, 0]
        along.set_ylabel("frequency (Hz)")
        along.axvspan(1e3 * travel[0], 1e3 * travel[1], color="0.93", zorder=0, lw=0)
        _sketch(figure.add_subplot(grid[2 * number, 0], sharex=along), sheet, support, travel)
        words = figure.add_subplot(grid[2 * number, 1:])
        words.axis("off")
        words.text(0, 0.75, support, fontweight="bold", fontsize=10.5, va="center")
        words.text(0, 0.15, _SUPPORT_WORDS[support], fontsize=9, va="center")
    for axes, column in zip(panels[-1], columns, strict=True):
        axes.set_xlabel(column.label)
    _name_rotors(panels[0, 0])
    at = f"at {5e2 * sum(travel):g} mm,"
    _state(panels[0, 1], f"{at}\nno load")
    _state(panels[0, 2], f"{at}\nP = {100 * sheet.screw.preload_ratio:g} %")
    return figure


def _columns(
    sheet: DataSheet, travel: tuple[float, float], heaviest: float, preload_ratios: tuple[float, float]
) -> tuple[_Column, ...]:
    middle = sum(travel) / 2
    x = np.linspace(-sheet.screw.bearing_to_zero, sheet.travel_limit, _POINTS)
    ratios = np.linspace(*preload_ratios, _POINTS)
    loads = np.linspace(0.0, heaviest, _POINTS)
    preloads = ratios * sheet.screw.dynamic_load_rating
    return (
        _Column("position (mm)", 1e3 * x, (x, 0.0, None)),
        _Column("preload (% of $C_a$)", 1e2 * ratios, (middle, 0.0, preloads)),
        _Column("load (kg)", loads, (middle, loads, None)),
    )


def _name_rotors(axes: Axes) -> None:
    at = _POINTS // 2
    for line, rotor, offset in zip(axes.get_lines(), ROTOR_COLOURS, ((4, 3), (-4, -3)), strict=True):
        point = float(np.asarray(line.get_xdata())[at]), float(np.asarray(line.get_ydata())[at])
        note(axes, f"rotor {rotor}", point, offset, colour=ROTOR_COLOURS[rotor])


def _state(axes: Axes, text: str) -> None:
    axes.text(0.97, 0.97, text, transform=axes.transAxes, ha="right", va="top", fontsize=8.5)


def _curves(axes: Axes, column: _Column, sheet: DataSheet, *, along: bool) -> None:
    fixed_free = replace(sheet, support=SUPPORTS[0])
    for rotor, colour in ROTOR_COLOURS.items():
        f = axial_natural_frequency(sheet, *column.arguments, rotor)
        axes.plot(column.shown, f, color=colour, lw=1.9)
        if sheet.support == "fixed-fixed":
            single = axial_natural_frequency(fixed_free, *column.arguments, rotor)
            axes.plot(column.shown, single, color=colour, lw=0.9, ls=(0, (3, 2)))
            if along:
                low = int(np.argmin(f))
                axes.plot(column.shown[low], f[low], "o", color=colour, ms=4)
    axes.set_xlim(column.shown[0], column.shown[-1])


def _sketch(axes: Axes, sheet: DataSheet, support: str, travel: tuple[float, float]) -> None:
    """Draw the screw above the positions of its nut: thrust bearings black, a sliding bearing white."""
    from matplotlib.patches import Rectangle

    near, far = -1e3 * sheet.screw.bearing_to_zero, 1e3 * sheet.travel_limit
    width = 0.028 * (far - near)
    axes.plot([near, far], [0, 0], color=_STEEL, lw=3.5, solid_capstyle="butt", clip_on=False)
    ends = {near: "black", far: _FAR_END[support]}
    for place, face in ends.items():
        if face is None:
            continue
        for side in (0.28, -0.95):
            axes.add_patch(
                Rectangle((place - width / 2, side), width, 0.67, fc=face, ec="black", lw=0.9, clip_on=False)
            )  # fmt: skip
    nut = 1e3 * sum(travel) / 2
    block = Rectangle((nut - 1.6 * width, -0.62), 3.2 * width, 1.24, fc="0.6", ec="black", lw=0.9, zorder=3)
    axes.add_patch(block)
    axes.set_ylim(-1.2, 1.2)
    axes.axis("off")
