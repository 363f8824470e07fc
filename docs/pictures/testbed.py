"""A schematic of the testbed: five bodies, their springs, and the sensors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from docs.pictures.sketch import arrow, bare, box, spring

from ballscrew.report.canvas import ANF, BACKLASH, blank, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_testbed"]

_TURNS, _SLIDES, _BED = "#E4E1F3", "#DCEBF5", "#E6E6E6"
_TOP, _LOW, _FLOOR = 4.9, 3.1, 1.15


def draw_testbed() -> Figure:
    """Draw motor, screw turning, screw along its axis, table and bed.

    Returns
    -------
    Figure
        Not yet written. Symbols are those of the page *Is the testbed right?*.
    """
    with styled():
        figure = blank(9.4, 5.1)
        axes = figure.subplots()
        bare(axes, 11.0, 5.95)
        _bed(axes)
        _screw(axes)
        _nut_and_table(axes)
        _instruments(axes)
    return figure


def _bed(axes: Axes) -> None:
    from matplotlib.patches import Rectangle

    axes.add_patch(Rectangle((1.5, _FLOOR - 0.35), 8.9, 0.7, fc=_BED, ec="0.3", lw=1.2, zorder=3))
    axes.text(5.95, _FLOOR, "bed on its mounts  $x_b$", ha="center", va="center", fontsize=9.5, zorder=4)
    axes.plot([0.35, 0.35], [_FLOOR - 0.5, _FLOOR + 0.5], color="0.2", lw=1.6)
    for step in range(6):
        y = _FLOOR - 0.5 + 0.2 * step
        axes.plot([0.15, 0.35], [y - 0.15, y], color="0.2", lw=0.9)
    spring(axes, (0.35, _FLOOR), (1.5, _FLOOR))
    axes.text(0.92, _FLOOR - 0.32, "mounts", ha="center", va="top", fontsize=8.5)
    # The bearing's bracket.
    axes.plot([1.9, 1.9], [_FLOOR + 0.35, _LOW + 0.42], color="0.3", lw=5, solid_capstyle="butt", zorder=2.5)
    for wheel in (8.35, 9.55):
        axes.plot(wheel, _FLOOR + 0.5, "o", ms=9, mfc="white", mec="0.3", zorder=3)
    axes.text(
        7.98, _FLOOR + 0.62, "guide: LuGre\nand viscous friction", ha="right", va="center", fontsize=8.5
    )


def _screw(axes: Axes) -> None:
    box(axes, (2.2, _TOP), (1.7, 0.95), "motor\n$u_m$", face=_TURNS, letters=10)
    box(axes, (5.3, _TOP), (1.7, 0.95), "screw turning\n$u_\\varphi$", face=_TURNS, letters=10)
    box(axes, (5.3, _LOW), (1.7, 0.95), "screw along\nits axis  $u_s$", face=_SLIDES, letters=10)
    spring(axes, (3.05, _TOP), (4.45, _TOP))
    spring(axes, (1.95, _LOW), (4.45, _LOW))
    above: Any = {"ha": "center", "va": "bottom", "fontsize": 9, "linespacing": 1.25}
    axes.text(3.75, _TOP + 0.26, "$k_\\theta(x)$", **above)
    axes.text(3.75, _TOP - 0.28, "shaft and\ncoupling, twist", **{**above, "va": "top", "fontsize": 8.5})
    axes.text(3.2, _LOW + 0.26, "$k_a(x)$", **above)
    axes.text(3.2, _LOW - 0.28, "shaft and bearing,\ntension", **{**above, "va": "top", "fontsize": 8.5})


def _nut_and_table(axes: Axes) -> None:
    """Two flanks pressed against each other, and the table that they push and pull."""
    middle = (_TOP + _LOW) / 2
    for y in (_TOP, _LOW):
        axes.plot([6.15, 6.55, 6.55], [y, y, middle], color="0.3", lw=1.4, zorder=2)
    axes.plot([6.55, 6.85], [middle, middle], color="0.3", lw=1.4)
    axes.text(6.63, _LOW + 0.08, "$u_\\varphi + u_s$", fontsize=9.5, ha="left", va="bottom")
    for side in (0.32, -0.32):
        spring(axes, (6.85, middle + side), (8.05, middle + side), colour=BACKLASH, amplitude=0.13)
    axes.plot([6.85, 6.85], [middle - 0.42, middle + 0.42], color="0.3", lw=1.4)
    words = "nut: two Hertz flanks,\npreload or backlash"
    look: Any = {"fontsize": 9, "ha": "center", "va": "bottom", "linespacing": 1.25}
    axes.text(7.4, middle + 0.76, words, color=BACKLASH, **look)
    box(axes, (8.95, 3.2), (1.8, 2.9), "table,\nnut and load\n\n$x_t$", face=_SLIDES, letters=10)
    arrow(axes, (8.35, 4.92), (9.55, 4.92), colour="0.45")
    axes.text(8.95, 5.0, "$x = x_t - x_b$", ha="center", va="bottom", fontsize=9, color="0.35")


def _instruments(axes: Axes) -> None:
    look: Any = {"fontsize": 9, "color": ANF, "fontweight": "bold"}
    arrow(axes, (0.35, _TOP), (1.35, _TOP), colour=ANF, width=1.8)
    axes.text(0.8, _TOP + 0.12, "torque", ha="center", va="bottom", **look)
    axes.text(2.2, _TOP + 0.62, "encoder", ha="center", va="bottom", **look)
    axes.plot([2.2], [_TOP + 0.54], "v", color=ANF, ms=6)
    axes.plot([9.95], [3.6], "s", color=ANF, ms=7, zorder=5)
    axes.text(10.08, 3.6, "accelero-\nmeters", ha="left", va="center", linespacing=1.2, **look)
    arrow(axes, (9.95, 3.1), (10.85, 3.1), colour=ANF, width=1.8)
    axes.text(1.5, 0.4, "Angles are expressed as travel of the table.", fontsize=9, color="0.35", va="center")
