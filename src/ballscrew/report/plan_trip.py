"""The upper half of a plan's picture: the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.fcft.concerns import QUIET, RINGING
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.expected import executed
from ballscrew.fcft.plan import Motion
from ballscrew.fcft.planned import PlannedTest
from ballscrew.fcft.profile import planned_transients, profile, set_points
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes

MOTION_STYLES = ("-", (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.4, 1.2, 1.4)))
LIMIT = "#A00000"
"""Colour of limits and of what breaks them."""
_MOST_MOTIONS = 4  # in one panel
_MOST_MOVES = 48  # whose speeds are legible
_FEW = 6  # moves beside the turn, where there are more
_MOST_STOPS = 31  # with a line each
_STEP = 9  # points on a piece of constant jerk
_MOST_VARIED = 12
_FAR_LIMIT = 4.0  # margins from the outermost stop, beyond which a limit is not shown
_ZERO: Any = {"color": "0.3", "lw": 0.6}


def motion_style(index: int) -> Any:
    """Line style of a motion, the same in all panels."""
    return MOTION_STYLES[index % len(MOTION_STYLES)]


def motion_name(test: PlannedTest, index: int) -> str:
    """Name of a motion."""
    if len(test.plan.motions) == 1:
        return "the motion"
    return f"motion {index}"


def frame(
    figure: Any,
    *,
    left: float,
    right: float,
    bottom: float = 0.52,
    top: float = 0.33,
    gap: float = 0.0,
    beside: bool = False,
) -> dict[str, float]:
    """Place of the panels of a figure's part, as matplotlib takes it.

    Fixed, without a layout engine: that solves equations, whose last digits differ from run to run, and the
    same plan must give the same bytes.

    Parameters
    ----------
    figure : Figure or SubFigure
        Part of the figure.
    left, right, bottom, top : float
        Margins, inches.
    gap : float
        Distance of two panels, inches.
    beside : bool
        Whether the panels stand side by side, not one above the other.

    Returns
    -------
    dict
        For ``gridspec_kw``.
    """  # fmt: skip
    width, height = figure.bbox.width / figure.dpi, figure.bbox.height / figure.dpi
    place = {
        "left": left / width,
        "right": 1 - right / width,
        "bottom": bottom / height,
        "top": 1 - top / height,
    }
    if beside:
        place["wspace"] = 2 * gap / (width - left - right - gap)
    else:
        place["hspace"] = 2 * gap / (height - bottom - top - gap)
    return place


def draw_conditions(figure: Any) -> None:
    """Draw the legend of the four conditions, once for all panels."""
    handles = []
    for condition in Condition:
        colour = canvas.CONDITION_COLOURS[condition]
        handles.append(canvas.legend_line(f"{condition}  {condition.words}", color=colour, lw=4))
    figure.legend(handles=handles, loc="center", ncols=4, fontsize=9.5)


def draw_trip(figure: Any, test: PlannedTest) -> None:
    """Draw position and speed against time: every motion once, as one repetition runs them.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    test : PlannedTest
        The test.
    """
    plan = test.plan
    shown = plan.motions[:_MOST_MOTIONS]
    crowded = 2 * (len(plan.positions) - 1) * len(shown) > _MOST_MOVES
    gap, top = 0.16, 0.33
    if crowded:
        gap = 0.6
    if len(shown) > 1:
        top = 0.52
    place, speed = figure.subplots(
        2, 1, height_ratios=(1.35, 1), gridspec_kw=frame(figure, left=0.86, right=0.12, gap=gap, top=top)
    )
    start = 0.0
    for index, motion in enumerate(shown):
        panels = {"position": place}
        if index == 0 or not crowded:
            panels["speed"] = speed
        duration = _motion(panels, test, motion, start)
        if len(plan.motions) > 1:
            middle = start + duration / 2
            canvas.note(
                place, motion_name(test, index), (middle, 1.01), (0, 0), coords=canvas.TOP_EDGE, va="bottom"
            )
        start += duration
        if index < len(shown) - 1:
            for axes in (place, speed):
                axes.axvline(start, color="0.3", lw=0.8, ls=":")
    place.set_xlim(0, start)
    _stops(place, test)
    speed.set_xlim(place.get_xlim())
    if crowded:
        _around_the_turn(place, speed, test)
    else:
        place.tick_params(labelbottom=False)
    _limit_speed(speed, test)
    speed.axhline(0, **_ZERO)
    _trip_title(place, test)
    place.set_ylabel("position (mm)")
    speed.set(ylabel="speed (mm/s)", xlabel="time (s)")
    figure.align_ylabels([place, speed])


def _motion(panels: dict[str, Axes], test: PlannedTest, motion: Motion, start: float) -> float:
    """Draw one round trip from a time on; its duration is returned, s."""
    moved = profile(test.plan, motion)
    time = _dense(moved.time)
    points = set_points(moved, time)
    for name, axes in panels.items():
        values = 1e3 * getattr(points, name)
        axes.plot(start + time, values, color="0.55", lw=1.1)
        for condition, colour in canvas.CONDITION_COLOURS.items():
            inside = _inside(test, motion, time, condition)
            axes.plot(
                start + time, np.where(inside, values, np.nan), color=colour, lw=2.6, solid_capstyle="butt"
            )
    return moved.duration


def _trip_title(axes: Axes, test: PlannedTest) -> None:
    count = len(test.plan.motions)
    title, pad = "One round trip", 6
    if count > 1:
        title, pad = "One repetition: a round trip of every motion", 18
    if count > _MOST_MOTIONS:
        title += f" (the first {_MOST_MOTIONS} of {count})"
    axes.set_title(f"{title}, and its stops", pad=pad)


def _dense(time: Array) -> Array:
    """Times that resolve each piece of a profile, its ends included."""
    part = np.linspace(0, 1, _STEP)[:-1]
    return np.append((time[:-1, None] + np.diff(time)[:, None] * part).ravel(), time[-1])


def _inside(test: PlannedTest, motion: Motion, time: Array, condition: str) -> NDArray[np.bool_]:
    found = np.zeros(len(time), dtype=bool)
    for phase in planned_transients(test.plan, motion):
        if phase.condition == condition:
            first = np.searchsorted(time, phase.start_s - 1e-9)
            found[first : np.searchsorted(time, phase.stop_s + 1e-9)] = True
    return found


def _stops(axes: Axes, test: PlannedTest) -> None:
    """Draw a line at each stop, and the limits of position that lie near the outermost ones."""
    stops = 1e3 * np.array(test.plan.positions)
    if len(stops) <= _MOST_STOPS:
        axes.grid(axis="y", visible=False)
        for stop in stops:
            axes.axhline(stop, color="0.82", lw=0.7, zorder=0)
    low, high = float(stops[0]), float(stops[-1])
    margin = 0.06 * (high - low)
    bottom, top = low - margin, high + margin
    limits = test.sheet.limits
    if limits.lowest_position is not None:
        at = 1e3 * limits.lowest_position
        if at > low - _FAR_LIMIT * margin:
            bottom = min(bottom, at - margin)
            _limit_position(axes, at, bottom - margin, f"limit: lowest position {at:g} mm", "top")
    if limits.highest_position is not None:
        at = 1e3 * limits.highest_position
        if at < high + _FAR_LIMIT * margin:
            top = max(top, at + margin)
            _limit_position(axes, at, top + margin, f"limit: highest position {at:g} mm", "bottom")
    axes.set_ylim(bottom, top)


def _limit_position(axes: Axes, at: float, far: float, words: str, side: str) -> None:
    axes.axhspan(at, far, color="0.5", alpha=0.25, lw=0, hatch="//", zorder=0)
    canvas.note(
        axes, words, (0.995, at), (0, 0), coords=canvas.SIDE_EDGE, ha="right", va=side, size=8, colour=LIMIT
    )


def _around_the_turn(place: Axes, speed: Axes, test: PlannedTest) -> None:
    """Show only the moves beside the last stop, where the speeds of all would not be legible."""
    motion = test.plan.motions[0]
    phases = planned_transients(test.plan, motion)
    middle = len(phases) // 2
    near = phases[max(0, middle - _FEW) : middle + _FEW]
    begin, end = near[0].start_s - motion.dwell / 2, near[-1].stop_s + motion.dwell / 2
    speed.set_xlim(begin, end)
    place.axvspan(begin, end, color="0.85", lw=0, zorder=0)
    speed.set_facecolor("0.96")
    speed.set_title(
        f"{len(near) // 2} moves around the turn (shaded above)", fontsize=9.5, fontweight="normal"
    )


def _limit_speed(axes: Axes, test: PlannedTest) -> None:
    limit, fastest = test.sheet.limits.speed, max(motion.speed for motion in test.plan.motions)
    if limit is None or limit > 1.5 * fastest:
        return
    for sign in (1, -1):
        axes.axhline(sign * 1e3 * limit, color=LIMIT, lw=1, ls="--")
    words = f"limit {1e3 * limit:g} mm/s"
    place = (0.995, 1e3 * limit)
    canvas.note(
        axes, words, place, (0, 0), coords=canvas.SIDE_EDGE, ha="right", va="bottom", size=8, colour=LIMIT
    )


def draw_phases(figure: Any, test: PlannedTest) -> None:
    """Draw the acceleration before and after a standstill, with the times that a window needs.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    test : PlannedTest
        The test.
    """
    motions = test.plan.motions
    place = frame(figure, left=0.86, right=0.15, gap=0.22, beside=True)
    arrive, leave = figure.subplots(1, 2, sharey=True, gridspec_kw=place)
    lowest = min(cell.frequency for cell in test.cells)
    after, before = 1e3 * RINGING / lowest, 1e3 * QUIET / lowest
    longest = 1e3 * max(motion.acceleration_time for motion in motions)
    for axes, low, high in ((arrive, 0.0, after), (leave, -before, 0.0)):
        axes.axvspan(low, high, color="0.9", lw=0, zorder=0)
        axes.axvline(0, color="0.3", lw=0.8)
        axes.axhline(0, **_ZERO)
    for index in range(min(len(motions), _MOST_MOTIONS)):
        _accelerations(arrive, leave, test, index)
    arrive.set_xlim(-1.12 * longest, 1.08 * after)
    leave.set_xlim(-1.08 * before, 1.12 * longest)
    shortest = 1e3 * min(motion.dwell for motion in motions)
    if shortest < after:
        arrive.axvline(shortest, color=LIMIT, lw=1.2, ls="--")
        look: Any = {"rotation": 90, "ha": "right", "size": 8, "colour": LIMIT}
        canvas.note(arrive, "next move", (shortest, 0.75), (0, 0), coords=canvas.TOP_EDGE, **look)
    top = max(motion.peak_acceleration for motion in motions)
    arrive.set_ylim(-1.45 * top, 1.45 * top)
    words: dict[str, Any] = {"va": "bottom", "size": 8.5, "colour": "0.25"}
    canvas.note(arrive, f"{RINGING:g} periods to ring", (after, 1.3 * top), (0, 0), ha="right", **words)
    canvas.note(leave, f"{QUIET:g} quiet", (-before, 1.3 * top), (0, 0), ha="left", **words)
    arrive.set_title("Arriving at a stop")
    leave.set_title("Leaving it")
    arrive.set(ylabel="acceleration (m/s²)", xlabel="time from standstill (ms)")
    leave.set_xlabel("time from the start (ms)")
    if len(motions) > 1:
        _motion_lines(arrive, test)


def _accelerations(arrive: Axes, leave: Axes, test: PlannedTest, index: int) -> None:
    """Draw the phases of one motion, those of its varied repetitions thinner."""
    runs = _distinct(executed(test.plan, index))
    for number, run in reversed(list(enumerate(runs))):
        width = 0.7
        if number == 0:
            width = 1.9
        time, acceleration = _phase(run)
        for condition in Condition:
            axes, shift, sign = arrive, run.acceleration_time, -condition.direction
            if condition.accelerating:
                axes, shift, sign = leave, 0.0, condition.direction
            axes.plot(
                1e3 * (time - shift), sign * acceleration, color=canvas.CONDITION_COLOURS[condition],
                ls=motion_style(index), lw=width,
            )  # fmt: skip


def _distinct(runs: Sequence[Motion]) -> list[Motion]:
    """Motions that differ in more than their dwell."""
    distinct = dict.fromkeys(replace(run, dwell=0.0) for run in runs)
    return list(distinct)[:_MOST_VARIED]


def _phase(motion: Motion) -> tuple[Array, Array]:
    """Time and acceleration at the corners of one phase, which is linear between them."""
    rise, whole = motion.jerk_time, motion.acceleration_time
    peak = motion.peak_acceleration
    return np.array([0.0, rise, whole - rise, whole]), np.array([0.0, peak, peak, 0.0])


def _motion_lines(axes: Axes, test: PlannedTest) -> None:
    lines: list[Any] = []
    for index in range(min(len(test.plan.motions), _MOST_MOTIONS)):
        lines += [canvas.legend_line(motion_name(test, index), color="0.2", linestyle=motion_style(index))]
    axes.legend(handles=lines, loc="lower right")
