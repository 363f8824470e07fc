"""Speed, torque and axial acceleration of two transients: Fig. 5 of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes, Figure

_LABELS = ("speed (mm/s)", "torque (N m)", "acceleration (m/s²)")
_HEADROOM = 0.16  # of a row's height, above the curves
_EDGE: Any = {"color": "0.45", "lw": 0.8, "ls": (0, (2, 2)), "zorder": 1}


@dataclass(frozen=True, slots=True, eq=False)
class TransientSignals:
    """Signals of one transient and of the time around it.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Time from the start of the acceleration phase, s.
    speed : ndarray, shape (n,)
        Speed of the table, m/s.
    torque : ndarray, shape (n,)
        Torque of the motor, N m.
    acceleration : ndarray, shape (n,)
        Acceleration of the nut along the axis, m/s².
    start, stop : float
        Ends of the acceleration phase, s.
    window : tuple of float
        Ends of the window that is transformed, s.

    Raises
    ------
    InputError
        If the signals differ in length, or a time is not in order.
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
        shapes = [np.shape(each) for each in (self.time, self.speed, self.torque, self.acceleration)]
        if len(set(shapes)) > 1 or len(shapes[0]) != 1 or shapes[0][0] < 2:
            listed = ", ".join(map(str, shapes))
            raise InputError(
                f"time, speed, torque and acceleration have the shapes {listed}; they must be one row each, "
                "of one length"
            )
        for name, (first, last) in {"phase": (self.start, self.stop), "window": self.window}.items():
            if not first < last:
                raise InputError(f"the {name} goes from {first:g} to {last:g} s; it must end after it starts")


@canvas.styled()
def draw_segments(pa: TransientSignals, nd: TransientSignals) -> Figure:
    """Draw a departure and an arrival, with the window that is transformed.

    Parameters
    ----------
    pa, nd : TransientSignals
        Transients of the conditions PA and ND.

    Returns
    -------
    Figure
        Not yet written. Standstill, acceleration phase and steady speed are named; the Hann window is drawn
        over the acceleration.
    """
    figure = canvas.blank(9, 7.2, 0.05)
    rows: Any = figure.subplots(3, 2, sharex="col", sharey="row")
    _column(rows[:, 0], pa, "PA", "ace")
    _column(rows[:, 1], nd, "ND", "bdf")
    for axes, label in zip(rows[:, 0], _LABELS, strict=True):
        axes.set_ylabel(label)
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + _HEADROOM * (high - low))
    rows[0, 0].set_title("PA: positive/acceleration", color=canvas.CONDITION_COLOURS["PA"], pad=20)
    rows[0, 1].set_title("ND: negative/deceleration", color=canvas.CONDITION_COLOURS["ND"], pad=20)
    _names(rows[0, 0], pa, leaving=True)
    _names(rows[0, 1], nd, leaving=False)
    _hann(rows[2, 0], pa, canvas.CONDITION_COLOURS["PA"])
    _hann(rows[2, 1], nd, canvas.CONDITION_COLOURS["ND"])
    figure.align_ylabels()
    return figure


def _column(panels: Any, signals: TransientSignals, condition: str, letters: str) -> None:
    values = (1e3 * np.asarray(signals.speed), signals.torque, signals.acceleration)
    for axes, curve, letter in zip(panels, values, letters, strict=True):
        _curve(axes, signals, curve, canvas.CONDITION_COLOURS[condition])
        axes.text(0.012, 0.97, f"({letter})", transform=axes.transAxes, va="top", fontweight="bold")
    panels[-1].set_xlabel("time from the start of the phase (s)")
    panels[-1].set_xlim(signals.time[0], signals.time[-1])


def _curve(axes: Axes, signals: TransientSignals, values: Array, colour: str) -> None:
    axes.axvspan(*signals.window, color=colour, alpha=0.12, lw=0, zorder=0)
    for edge in (signals.start, signals.stop):
        axes.axvline(edge, **_EDGE)
    axes.axhline(0, color="0.75", lw=0.8, zorder=0.5)
    axes.plot(signals.time, values, color=colour, lw=1.0)


def _names(axes: Axes, signals: TransientSignals, *, leaving: bool) -> None:
    """Name the three parts of the motion above the first row, and the window in it."""
    names = ("steady speed", "deceleration", "standstill")
    # At the edge of the window that lies at standstill, where the speed is lowest.
    edge, offset = signals.window[1], (-4, -4)
    if leaving:
        names = ("standstill", "acceleration", "steady speed")
        edge, offset = signals.window[0], (4, -4)
    times = np.array([signals.time[0], signals.start, signals.stop, signals.time[-1]])
    for middle, words in zip((times[1:] + times[:-1]) / 2, names, strict=True):
        canvas.note(
            axes, words, (middle, 1), (0, 5), coords=canvas.TOP_EDGE, va="baseline", size=8.5, colour="0.3"
        )
    canvas.note(
        axes, "window", (edge, 1), offset, coords=canvas.TOP_EDGE, size=8.5, colour="0.3", style="italic"
    )


def _hann(axes: Axes, signals: TransientSignals, colour: str) -> None:
    """Draw the weight of each sample, from 0 at the lower to 1 at the upper end of the row."""
    part = np.linspace(0, 1, 101)
    first, last = signals.window
    axes.plot(
        first + part * (last - first), 0.5 - 0.5 * np.cos(2 * np.pi * part), color=colour, lw=1.0, alpha=0.55,
        ls=(0, (4, 2)), transform=axes.get_xaxis_transform(),
    )  # fmt: skip
    axes.text(
        first + 0.64 * (last - first), 0.9, "Hann", fontsize=8.5, color="0.3",
        transform=axes.get_xaxis_transform(), va="center",
    )  # fmt: skip
