"""The upper half of a plan's picture: how it moves."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.fcft.concerns import QUIET, RINGING
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.expected import executed
from ballscrew.fcft.plan import Motion
from ballscrew.fcft.planned import PlannedTest
from ballscrew.fcft.profile import planned_transients, profile, set_points
from ballscrew.report.style import CONDITION_COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "MOTION_STYLES",
    "draw_conditions",
    "draw_phases",
    "draw_trip",
    "frame",
    "motion_name",
    "motion_style",
]


MOTION_STYLES = ("-", (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.4, 1.2, 1.4)))
_MOST_MOTIONS = 4  # in one panel
_MOST_MOVES = 48  # whose speeds can be told apart
_FEW = 6  # moves beside the turn, where they are more
_MOST_STOPS = 31  # with a line each
_STEP = 9  # points a piece of constant jerk
_MOST_VARIED = 12


def motion_style(index: int) -> Any:
    """The line of a motion, the same in all panels."""
    return MOTION_STYLES[index % len(MOTION_STYLES)]


def motion_name(test: PlannedTest, index: int) -> str:
    """What a motion is called."""
    return "the motion" if len(test.plan.motions) == 1 else f"motion {index}"


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
    """Where the panels of a figure's part stand, as matplotlib takes it.

    Fixed, and not by a layout engine: that solves equations, whose last digits differ from run to run, and
    the same plan shall give the same bytes.

    Parameters
    ----------
    figure : Figure or SubFigure
        The part.
    left, right, bottom, top : float
        Margins, inches.
    gap : float
        Between two panels, inches.
    beside : bool
        Whether these stand side by side and not one above the other.

    Returns
    -------
    dict
        For ``gridspec_kw``.
    """  # fmt: skip
    width, height = figure.bbox.width / figure.dpi, figure.bbox.height / figure.dpi
    room = width - left - right if beside else height - bottom - top
    return {
        "left": left / width,
        "right": 1 - right / width,
        "bottom": bottom / height,
        "top": 1 - top / height,
        "wspace" if beside else "hspace": 2 * gap / (room - gap),
    }


def draw_conditions(figure: Any) -> None:
    """The colours of the four conditions, once for all panels."""
    from matplotlib.lines import Line2D

    figure.legend(
        handles=[
            Line2D([], [], color=CONDITION_COLOURS[condition], lw=4, label=f"{condition}  {condition.words}")
            for condition in Condition
        ],
        loc="center",
        ncols=4,
        fontsize=9.5,
    )


def draw_trip(figure: Any, test: PlannedTest) -> None:
    """Position and speed against time: every motion once, as one repetition runs them.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    test : PlannedTest
        The test.
    """
    plan = test.plan
    shown = plan.motions[:_MOST_MOTIONS]
    many = 2 * (len(plan.positions) - 1) * len(shown) > _MOST_MOVES
    place, speed = figure.subplots(
        2, 1, height_ratios=(1.35, 1),
        gridspec_kw=frame(
            figure, left=0.86, right=0.12, gap=0.6 if many else 0.16, top=0.52 if len(shown) > 1 else 0.33
        ),
    )  # fmt: skip
    start = 0.0
    for index, motion in enumerate(shown):
        moved = profile(plan, motion)
        time = _dense(moved.time)
        points = set_points(moved, time)
        place.plot(start + time, 1e3 * points.position, color="0.55", lw=1.1)
        if not (many and index):
            speed.plot(start + time, 1e3 * points.speed, color="0.55", lw=1.1)
        for condition, colour in CONDITION_COLOURS.items():
            inside = _inside(test, motion, time, condition)
            width = {"lw": 2.6, "color": colour, "solid_capstyle": "butt"}
            place.plot(start + time, np.where(inside, 1e3 * points.position, np.nan), **width)
            if not (many and index):
                speed.plot(start + time, np.where(inside, 1e3 * points.speed, np.nan), **width)
        if len(plan.motions) > 1:
            middle = start + moved.duration / 2
            label = motion_name(test, index)
            place.annotate(
                label,
                (middle, 1.01),
                xycoords=("data", "axes fraction"),
                ha="center",
                fontsize=9,
                va="bottom",
            )
        start += moved.duration
        if index < len(shown) - 1:
            for axes in (place, speed):
                axes.axvline(start, color="0.3", lw=0.8, ls=":")
    place.set_xlim(0, start)
    _stops(place, test)
    speed.set_xlim(place.get_xlim())
    if many:
        _around_the_turn(place, speed, test)
    else:
        place.tick_params(labelbottom=False)
    _limit_speed(speed, test)
    speed.axhline(0, color="0.3", lw=0.6)
    what = "One round trip" if len(plan.motions) == 1 else "One repetition: a round trip of every motion"
    if len(plan.motions) > _MOST_MOTIONS:
        what += f" (the first {_MOST_MOTIONS} of {len(plan.motions)})"
    place.set_title(f"{what}, and its stops", pad=18 if len(plan.motions) > 1 else 6)
    place.set_ylabel("position (mm)")
    speed.set_ylabel("speed (mm/s)")
    speed.set_xlabel("time (s)")
    figure.align_ylabels([place, speed])


def _dense(time: Array) -> Array:
    """Points enough to draw each piece of a profile, its ends among them."""
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
    stops = [1e3 * position for position in test.plan.positions]
    if len(stops) <= _MOST_STOPS:
        axes.grid(axis="y", visible=False)
        for stop in stops:
            axes.axhline(stop, color="0.82", lw=0.7, zorder=0)
    low, high = stops[0], stops[-1]
    margin = 0.06 * (high - low)
    limits = test.sheet.limits
    bounds = (
        (limits.lowest_position, "lowest position", -1),
        (limits.highest_position, "highest position", 1),
    )
    bottom, top = low - margin, high + margin
    for bound, words, side in bounds:
        if bound is None:
            continue
        at = 1e3 * bound
        if side < 0 and at > low - 4 * margin:
            bottom = min(bottom, at - margin)
        elif side > 0 and at < high + 4 * margin:
            top = max(top, at + margin)
        else:
            continue
        far = bottom - margin if side < 0 else top + margin
        axes.axhspan(at, far, color="0.5", alpha=0.25, lw=0, hatch="//", zorder=0)
        axes.annotate(
            f"limit: {words} {at:g} mm", (0.995, at), xycoords=("axes fraction", "data"), ha="right",
            va="top" if side < 0 else "bottom", fontsize=8, color="#A00000",
        )  # fmt: skip
    axes.set_ylim(bottom, top)


def _around_the_turn(place: Axes, speed: Axes, test: PlannedTest) -> None:
    """Where there are too many moves to tell their speeds apart: those beside the last stop."""
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
        axes.axhline(sign * 1e3 * limit, color="#A00000", lw=1, ls="--")
    axes.annotate(
        f"limit {1e3 * limit:g} mm/s", (0.995, 1e3 * limit), xycoords=("axes fraction", "data"), ha="right",
        va="bottom", fontsize=8, color="#A00000",
    )  # fmt: skip


def draw_phases(figure: Any, test: PlannedTest) -> None:
    """The acceleration before and after a standstill, with what a window needs of it.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    test : PlannedTest
        The test.
    """
    plan = test.plan
    place = frame(figure, left=0.86, right=0.15, gap=0.22, beside=True)
    arrive, leave = figure.subplots(1, 2, sharey=True, gridspec_kw=place)
    lowest = min(cell.frequency for cell in test.cells)
    after, before = 1e3 * RINGING / lowest, 1e3 * QUIET / lowest
    longest = 1e3 * max(motion.acceleration_time for motion in plan.motions)
    for axes, low, high in ((arrive, 0.0, after), (leave, -before, 0.0)):
        axes.axvspan(low, high, color="0.9", lw=0, zorder=0)
        axes.axvline(0, color="0.3", lw=0.8)
        axes.axhline(0, color="0.3", lw=0.6)
    for index in range(min(len(plan.motions), _MOST_MOTIONS)):
        runs = list(dict.fromkeys(replace(run, dwell=0.0) for run in executed(plan, index)))[:_MOST_VARIED]
        for run in reversed(runs):
            look = {"ls": motion_style(index), "lw": 1.9 if run == runs[0] else 0.7}
            time, acceleration = _phase(run)
            for condition, colour in CONDITION_COLOURS.items():
                kind = Condition(condition)
                rising = kind in (Condition.PA, Condition.ND)
                shift = 0.0 if kind.accelerating else run.acceleration_time
                axes = leave if kind.accelerating else arrive
                axes.plot(
                    1e3 * (time - shift), acceleration if rising else -acceleration, color=colour, **look
                )
    arrive.set_xlim(-1.12 * longest, 1.08 * after)
    leave.set_xlim(-1.08 * before, 1.12 * longest)
    shortest = 1e3 * min(motion.dwell for motion in plan.motions)
    if shortest < after:
        arrive.axvline(shortest, color="#A00000", lw=1.2, ls="--")
        arrive.annotate(
            "next move", (shortest, 0.75), xycoords=("data", "axes fraction"), rotation=90, ha="right",
            va="center", fontsize=8, color="#A00000",
        )  # fmt: skip
    top = max(motion.peak_acceleration for motion in plan.motions)
    arrive.set_ylim(-1.45 * top, 1.45 * top)
    for axes, x, words, side in (
        (arrive, after, f"{RINGING:g} periods to ring", "right"),
        (leave, -before, f"{QUIET:g} quiet", "left"),
    ):
        axes.annotate(words, (x, 1.3 * top), ha=side, va="bottom", fontsize=8.5, color="0.25")
    arrive.set_title("Into a stop")
    leave.set_title("Out of it")
    arrive.set_ylabel("acceleration (m/s²)")
    arrive.set_xlabel("time from standstill (ms)")
    leave.set_xlabel("time from the start (ms)")
    if len(plan.motions) > 1:
        _motion_lines(arrive, test)


def _phase(motion: Motion) -> tuple[Array, Array]:
    """Time and acceleration of one phase; it has corners only, so they are enough."""
    rise, whole = motion.jerk_time, motion.acceleration_time
    peak = motion.peak_acceleration
    return np.array([0.0, rise, whole - rise, whole]), np.array([0.0, peak, peak, 0.0])


def _motion_lines(axes: Axes, test: PlannedTest) -> None:
    from matplotlib.lines import Line2D

    lines = [
        Line2D([], [], color="0.2", ls=motion_style(index), label=motion_name(test, index))
        for index in range(min(len(test.plan.motions), _MOST_MOTIONS))
    ]
    axes.legend(handles=lines, loc="lower right")
