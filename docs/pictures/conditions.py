"""The picture of the four conditions: Fig. 4 and Table 1 of the paper, from a plan's own set-points."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.base.errors import InputError
from ballscrew.fcft.conditions import Condition, conditions_at
from ballscrew.fcft.plan import Plan
from ballscrew.fcft.profile import MotionProfile, PlannedTransient, planned_transients, profile, set_points
from ballscrew.report.canvas import CONDITION_COLOURS, blank, note, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_conditions"]

_POINTS = 400
_WIDE = 4.5
_BEFORE = 0.09  # s, that are shown before and after the two phases of a stop


def draw_conditions(plan: Plan) -> Figure:
    """Draw a round trip, a stop of it in both directions, and which conditions exist where.

    Parameters
    ----------
    plan : Plan
        With 3 stops or more; its first motion is drawn.

    Returns
    -------
    Figure
        Not yet written.

    Raises
    ------
    InputError
        If no stop lies between two others.
    """
    stops = plan.positions
    if len(stops) < 3:
        raise InputError(
            f"the plan has {len(stops)} stops; the picture needs one between two others, so 3 or more"
        )
    motion = plan.motions[0]
    trip, phases = profile(plan, motion), planned_transients(plan, motion)
    inner = stops[len(stops) // 2]
    with styled():
        figure = blank(8.4, 8.2)
        grid = figure.add_gridspec(4, 2, height_ratios=(1.35, 0.75, 0.75, 0.8))
        whole = figure.add_subplot(grid[0, :])
        _trip(whole, trip, phases, stops)
        shared: Any = [None, None]
        for column, (direction, words) in enumerate(((1, "positive"), (-1, "negative"))):
            here = [p for p in phases if p.position == inner and p.condition.direction == direction]
            for row, what in enumerate(("position", "speed")):
                axes = figure.add_subplot(grid[1 + row, column], sharey=shared[row])
                shared[row] = shared[row] or axes
                _stop(axes, trip, here, what, inner)
                axes.tick_params(labelleft=column == 0, labelbottom=row == 1)
                if column == 0:
                    axes.set_ylabel("position (mm)" if row == 0 else "speed (mm/s)")
                if row == 0:
                    axes.set_title(f"Stop at {1e3 * inner:g} mm, {words} direction", loc="left")
                else:
                    axes.set_xlabel("time from arrival (s)")
        _table(figure.add_subplot(grid[3, :]))
    return figure


def _piece(trip: MotionProfile, phase: PlannedTransient) -> Any:
    return set_points(trip, np.linspace(phase.start_s, phase.stop_s, _POINTS))


def _trip(
    axes: Axes, trip: MotionProfile, phases: tuple[PlannedTransient, ...], stops: tuple[float, ...]
) -> None:  # fmt: skip
    every = set_points(trip, np.linspace(0.0, trip.duration, 20 * _POINTS))
    axes.plot(every.time, 1e3 * every.position, color="0.6", lw=1.4)
    for phase in phases:
        points = _piece(trip, phase)
        axes.plot(
            points.time, 1e3 * points.position, color=CONDITION_COLOURS[phase.condition], lw=_WIDE,
            solid_capstyle="butt",
        )  # fmt: skip
    axes.set(xlabel="time (s)", ylabel="position (mm)", xlim=(0, trip.duration))
    axes.set_yticks([1e3 * stop for stop in stops])
    axes.set_title("One round trip: every stop in both directions", loc="left")


def _stop(axes: Axes, trip: MotionProfile, here: list[PlannedTransient], what: str, inner: float) -> None:
    arrival, departure = here
    start, end = arrival.start_s - _BEFORE, departure.stop_s + _BEFORE
    every = set_points(trip, np.linspace(start, end, 4 * _POINTS))
    axes.plot(every.time - arrival.stop_s, 1e3 * getattr(every, what), color="0.6", lw=1.4)
    for phase, side in ((arrival, "right"), (departure, "left")):
        points = _piece(trip, phase)
        colour = CONDITION_COLOURS[phase.condition]
        time, values = points.time - arrival.stop_s, 1e3 * getattr(points, what)
        axes.plot(time, values, color=colour, lw=_WIDE, solid_capstyle="butt")
        if what == "speed":
            where = float(time[0] if side == "left" else time[-1])
            away = -9 if side == "left" else 9
            up = 7 * phase.condition.direction
            note(axes, f"$\\bf{{{phase.condition.value}}}$", (where, 0.0), (away, up), colour=colour, size=11)
        else:
            axes.axhline(1e3 * inner, color="0.8", lw=0.8, zorder=0)
    axes.set_xlim(start - arrival.stop_s, end - arrival.stop_s)


def _table(axes: Axes) -> None:
    """Table 1: a chip for each condition that exists."""
    from matplotlib.patches import FancyBboxPatch

    axes.set(xlim=(0, 3), ylim=(0, 1))
    axes.axis("off")
    axes.set_title("Table 1: conditions at each stop", loc="left")
    for column, (name, index) in enumerate((("first stop", 0), ("inner stops", 1), ("last stop", 2))):
        axes.text(column + 0.44, 0.9, name, ha="center", va="center")
        for place, condition in enumerate(Condition):
            there = condition in conditions_at(index, 3)
            left = column + 0.02 + 0.21 * place
            chip = FancyBboxPatch(
                (left, 0.4),
                0.19,
                0.3,
                boxstyle="round,pad=0,rounding_size=0.03",
                mutation_aspect=2,
                fc=CONDITION_COLOURS[condition] if there else "0.92",
                ec="none",
            )
            axes.add_patch(chip)
            look: Any = {"color": "white" if there else "0.7", "fontweight": "bold"}
            axes.text(left + 0.095, 0.55, condition.value, ha="center", va="center", **look)
    for place, condition in enumerate(Condition):
        words = f"{condition.value}: {condition.words}"
        colour = CONDITION_COLOURS[condition]
        axes.text(0.02 + 0.75 * place, 0.08, words, fontsize=9, va="center", color=colour)
