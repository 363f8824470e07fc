"""What schematics are made of: boxes, arrows, springs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["arrow", "bare", "box", "spring"]

Point = tuple[float, float]

_TURNS = 4


def bare(axes: Axes, width: float, height: float) -> None:
    """Make axes a sheet of paper: no scales, one unit as long across as up.

    Parameters
    ----------
    axes : Axes
        To draw on.
    width, height : float
        Of the sheet, from 0.
    """
    axes.set(xlim=(0, width), ylim=(0, height), aspect="equal")
    axes.axis("off")


def box(
    axes: Axes,
    centre: Point,
    size: tuple[float, float],
    text: str,
    *,
    face: Any = "white",
    edge: Any = "0.3",
    letters: float = 9.0,
) -> None:
    """Draw a box with a text in it.

    Parameters
    ----------
    axes : Axes
        To draw on.
    centre : tuple of float
        Of the box.
    size : tuple of float
        Width and height.
    text : str
        In it.
    face, edge : str
        Colours.
    letters : float
        Their size, points.
    """
    from matplotlib.patches import FancyBboxPatch

    (x, y), (width, height) = centre, size
    axes.add_patch(
        FancyBboxPatch(
            (x - width / 2, y - height / 2), width, height, boxstyle="round,pad=0,rounding_size=0.1",
            fc=face, ec=edge, lw=1.2, zorder=3,
        )
    )  # fmt: skip
    axes.text(x, y, text, ha="center", va="center", fontsize=letters, zorder=4, linespacing=1.25)


def arrow(axes: Axes, start: Point, end: Point, *, colour: Any = "0.3", width: float = 1.3) -> None:
    """Draw an arrow.

    Parameters
    ----------
    axes : Axes
        To draw on.
    start, end : tuple of float
        From where to where.
    colour : str
        Of it.
    width : float
        Of its line, points.
    """
    look: Any = {"arrowstyle": "-|>", "color": colour, "lw": width, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=look, zorder=2)


def spring(axes: Axes, start: Point, end: Point, *, colour: Any = "0.2", amplitude: float = 0.16) -> None:
    """Draw a spring.

    Parameters
    ----------
    axes : Axes
        To draw on.
    start, end : tuple of float
        From where to where.
    colour : str
        Of it.
    amplitude : float
        How far its turns reach to either side.
    """
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    along, across = b - a, np.array([a[1] - b[1], b[0] - a[0]]) / np.hypot(*(b - a))
    part = np.concatenate([[0.0], np.linspace(0.2, 0.8, 2 * _TURNS + 1), [1.0]])
    swing = np.concatenate([[0.0, 0.0], np.tile([1.0, -1.0], _TURNS)[: 2 * _TURNS - 1], [0.0, 0.0]])
    points = a + part[:, None] * along + amplitude * swing[:, None] * across
    axes.plot(points[:, 0], points[:, 1], color=colour, lw=1.3, solid_joinstyle="round", zorder=2)
