"""Speed, torque and axial acceleration of two transients: Fig. 5 of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.report.canvas import blank, styled
from ballscrew.report.style import CONDITION_COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Segment", "draw_segments"]


_ROWS = (
    ("speed", 1e3, "speed (mm/s)"),
    ("torque", 1.0, "torque (N m)"),
    ("acceleration", 1.0, "acceleration (m/s²)"),
)
_ROOM = 0.16  # of a row's height, above the curves
_EDGE: Any = {"color": "0.45", "lw": 0.8, "ls": (0, (2, 2)), "zorder": 1}


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """One transient with what lies around it, to be drawn.

    Parameters
    ----------
    time : ndarray, shape (n,)
        From the start of the acceleration phase, s.
    speed : ndarray, shape (n,)
        Of the table, m/s.
    torque : ndarray, shape (n,)
        Of the motor, N m.
    acceleration : ndarray, shape (n,)
        Of the nut along the axis, m/s².
    start, stop : float
        Of the acceleration phase, s.
    window : tuple of float
        From when to when it is transformed, s.

    Raises
    ------
    InputError
        If the four are not of one length, or a time is not in order.
    """

    time: Array
    speed: Array
    torque: Array
    acceleration: Array
    start: float
    stop: float
    window: tuple[float, float]

    def __post_init__(self) -> None:
        """Refuse what cannot be drawn."""
        sizes = {name: np.shape(getattr(self, name)) for name in ("time", "speed", "torque", "acceleration")}
        if len(set(sizes.values())) != 1 or len(sizes["time"]) != 1 or sizes["time"][0] < 2:
            told = ", ".join(f"{name} {shape}" for name, shape in sizes.items())
            raise InputError(f"a segment has the shapes {told}; they must be one row each, of one length")
        for name, (first, last) in {"phase": (self.start, self.stop), "window": self.window}.items():
            if not first < last:
                raise InputError(f"the {name} goes from {first:g} to {last:g} s; it must end after it starts")


def draw_segments(pa: Segment, nd: Segment) -> Figure:
    """Draw a departure and an arrival, with the window that is transformed.

    Parameters
    ----------
    pa, nd : Segment
        Of the conditions PA and ND.

    Returns
    -------
    Figure
        Not yet written. Standstill, acceleration phase and steady speed are named; over the acceleration
        stands Hann's weight.
    """
    with styled():
        figure = blank(9, 7.2, 0.05)
        rows: Any = figure.subplots(3, 2, sharex="col", sharey="row")
        parts = (("PA", pa, "positive/acceleration"), ("ND", nd, "negative/deceleration"))
        for column, (condition, segment, words) in enumerate(parts):
            colour = CONDITION_COLOURS[condition]
            for row, (name, factor, label) in enumerate(_ROWS):
                axes = rows[row, column]
                _curve(axes, segment, factor * np.asarray(getattr(segment, name)), colour)
                letter = "abcdef"[2 * row + column]
                axes.text(0.012, 0.97, f"({letter})", transform=axes.transAxes, va="top", fontweight="bold")
                if column == 0:
                    axes.set_ylabel(label)
            rows[0, column].set_title(f"{condition}: {words}", color=colour, pad=20)
            rows[2, column].set_xlabel("time from the start of the phase (s)")
            rows[2, column].set_xlim(segment.time[0], segment.time[-1])
        for row in rows[:, 0]:
            low, high = row.get_ylim()
            row.set_ylim(low, high + _ROOM * (high - low))
        for column, segment in enumerate((pa, nd)):
            _names(rows[0, column], segment, leaving=column == 0)
        for column, (condition, segment, _) in enumerate(parts):
            _hann(rows[2, column], segment, CONDITION_COLOURS[condition])
        figure.align_ylabels()
    return figure


def _curve(axes: Axes, segment: Segment, values: Array, colour: str) -> None:
    axes.axvspan(*segment.window, color=colour, alpha=0.12, lw=0, zorder=0)
    for edge in (segment.start, segment.stop):
        axes.axvline(edge, **_EDGE)
    axes.axhline(0, color="0.75", lw=0.8, zorder=0.5)
    axes.plot(segment.time, values, color=colour, lw=1.0)


def _names(axes: Axes, segment: Segment, *, leaving: bool) -> None:
    """Name the three parts of the motion above the first row, and the window below them."""
    before, after = ("standstill", "steady speed") if leaving else ("steady speed", "standstill")
    first, last = float(segment.time[0]), float(segment.time[-1])
    phase = "acceleration" if leaving else "deceleration"
    parts = (
        (first, segment.start, before),
        (segment.start, segment.stop, phase),
        (segment.stop, last, after),
    )
    for left, right, words in parts:
        axes.annotate(
            words, ((left + right) / 2, 1), (0, 5), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", fontsize=8.5, color="0.3",
        )  # fmt: skip
    # At the edge of the shade that lies at standstill, where the speed is drawn lowest or not at all.
    edge, away, side = (segment.window[0], 4, "left") if leaving else (segment.window[1], -4, "right")
    axes.annotate(
        "window", (edge, 1), (away, -4), xycoords=("data", "axes fraction"), textcoords="offset points",
        ha=side, va="top", fontsize=8.5, color="0.3", style="italic",
    )  # fmt: skip


def _hann(axes: Axes, segment: Segment, colour: str) -> None:
    """The weight that each sample gets, 0 at the lower and 1 at the upper end of the row."""
    part = np.linspace(0, 1, 101)
    first, last = segment.window
    axes.plot(
        first + part * (last - first), 0.5 - 0.5 * np.cos(2 * np.pi * part), color=colour, lw=1.0, alpha=0.55,
        ls=(0, (4, 2)), transform=axes.get_xaxis_transform(),
    )  # fmt: skip
    axes.text(
        first + 0.64 * (last - first), 0.9, "Hann", fontsize=8.5, color="0.3",
        transform=axes.get_xaxis_transform(), va="center",
    )  # fmt: skip
