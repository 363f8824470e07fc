"""The lower half of a plan's picture: what is excited, what the nut bears, what is to be expected."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ballscrew.fcft.concerns import EXCITED
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.excitation import blow_spectrum, mean_blow_spectrum, nulls
from ballscrew.fcft.expected import ExpectedCell, executed
from ballscrew.fcft.nutload import ADVISED, RELEASE
from ballscrew.fcft.planned import PlannedTest
from ballscrew.report.plan_trip import frame, motion_name, motion_style
from ballscrew.report.style import CONDITION_COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_along", "draw_excitation", "draw_nut_load"]

_LOAD_MAP = "cividis"
_LOAD_MARKERS = "osD^vPX"
# Wide and pale below, thin and dark above: of two curves that fall together both are seen.
_MOTION_LINES = (("0.45", 3.2), ("black", 1.7), ("0.3", 2.4), ("0.6", 2.0), ("0.75", 2.8))
_MOST_NAMES = 6
_FEW_LOADS = 4  # with a band each
_MOST_LOADS = 12  # with a name each
_MOST_RINGS = 20  # that can be told apart
_FEW_GROUPS = 4  # of nut loads, with their numbers
_MOST_GROUPS = 12  # with a name each
_MOST_MARKERS = 40
_LIMIT, _AMBER = "#A00000", "#E69F00"
_HALO: dict[str, Any] = {"bbox": {"boxstyle": "square,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.75}}


def draw_excitation(figure: Any, test: PlannedTest) -> None:
    r"""\|sinc(f T_j)\| of one blow of each motion, over the expected natural frequencies.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    test : PlannedTest
        The test.
    """
    axes = figure.subplots(gridspec_kw=frame(figure, left=0.72, right=0.12))
    masses = sorted(test.plan.masses)
    bands = {mass: _band([cell for cell in test.cells if cell.mass == mass]) for mass in masses}
    low, high = min(band[0] for band in bands.values()), max(band[1] for band in bands.values())
    firsts = [1 / motion.jerk_time for motion in test.plan.motions]
    right = min(max(2 * high, *(1.12 * first for first in firsts)), 6 * high)
    frequency = np.linspace(right / 4000, right, 4000)
    if len(masses) > _FEW_LOADS:
        axes.axvspan(low, high, color="0.82", lw=0, zorder=0)
    else:
        for mass, band in bands.items():
            axes.axvspan(*band, color=_load_colour(masses, mass), alpha=0.2, lw=0, zorder=0)
    axes.axhline(EXCITED, color=_LIMIT, lw=1, ls="--")
    for index, motion in enumerate(test.plan.motions):
        colour, width = _MOTION_LINES[index % len(_MOTION_LINES)]
        look: dict[str, Any] = {"color": colour, "ls": motion_style(index)}
        label = f"{motion_name(test, index)}: $T_j$ = {1e3 * motion.jerk_time:.3g} ms"
        curve = blow_spectrum(frequency, motion)
        if motion.jerk_spread:
            runs = executed(test.plan, index)
            axes.plot(frequency, curve, lw=0.8, **look)
            curve = mean_blow_spectrum(frequency, runs)
            label += f", rms of {len(runs)} varied by {motion.jerk_spread:g}"
        axes.plot(frequency, curve, lw=width, label=label, **look)
        modes = dict.fromkeys((c.frequency, c.excitation) for c in test.cells if c.motion == index)
        own = list(modes)[:: 1 + len(modes) // _MOST_MARKERS]
        axes.plot([f for f, _ in own], [height for _, height in own], "|", color=colour, ms=10, mew=1)
    _mark_nulls(axes, test, right)
    axes.annotate(
        "expected ANF ± 2 u", (low, 1.04), (2, 0), textcoords="offset points", va="bottom", fontsize=9
    )
    axes.annotate("below: as good as a null", (0.01, EXCITED), (0, 2), xycoords=("axes fraction", "data"),
                  textcoords="offset points", va="bottom", fontsize=8, color=_LIMIT, **_HALO)  # fmt: skip
    axes.set(xlim=(0, right), ylim=(0, 1.13))
    axes.set_yticks(np.arange(0, 1.01, 0.2))
    axes.set_title("Torque excitation of one blow")
    axes.set_xlabel("frequency (Hz)")
    axes.set_ylabel("|sinc(f $T_j$)|, 1 for a jerk without duration")
    axes.legend(loc="upper right", bbox_to_anchor=(1, 0.92))


def _mark_nulls(axes: Axes, test: PlannedTest, right: float) -> None:
    """A ring on every k/T_j, the first ones named where there is room for it."""
    taken: list[float] = []
    for motion in test.plan.motions:
        found = nulls(motion, right)
        if not found:
            continue
        if len(found) > _MOST_RINGS:
            axes.annotate(f"nulls every {found[0]:.3g} Hz", (0.5, 0.3), xycoords="axes fraction", fontsize=8,
                          color=_LIMIT)  # fmt: skip
            continue
        axes.plot(found, np.zeros(len(found)), "o", ms=7, mfc="white", mec=_LIMIT, mew=1.6, clip_on=False,
                  zorder=6)  # fmt: skip
        for order, null in enumerate(found[:_MOST_NAMES], start=1):
            if all(abs(null - other) > 0.12 * right for other in taken) and null < 0.97 * right:
                words = f"{order}/$T_j$\n{null:.4g} Hz"
                # Above the arms of the null, which a text would hide.
                axes.annotate(
                    words, (null, 0.01), (null, EXCITED + 0.04), ha="center", va="bottom", fontsize=8,
                    color=_LIMIT, arrowprops={"arrowstyle": "-", "color": _LIMIT, "lw": 0.7}, **_HALO,
                )  # fmt: skip
                taken.append(null)


def draw_nut_load(figure: Any, test: PlannedTest) -> None:
    """Nut load of the conditions for each motion and load; beneath, the preload at which it is too much.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    test : PlannedTest
        The test.
    """
    force, falling = figure.subplots(
        2, 1, height_ratios=(1.25, 1), sharex=True, gridspec_kw=frame(figure, left=0.85, right=0.68, gap=0.42)
    )
    preload = test.sheet.nominal_preload
    groups = _groups(test.cells)
    loads = list(groups.values())
    width = 0.8 / len(Condition)
    for order, condition in enumerate(Condition):
        x = np.arange(len(groups)) + (order - 1.5) * width
        values = [load.get(condition, np.nan) for load in loads]
        force.bar(x, values, 0.9 * width, color=CONDITION_COLOURS[condition])
        if len(groups) <= _FEW_GROUPS:
            for at, value in zip(x, values, strict=True):
                # On the other side of zero, where no limit is.
                force.annotate(condition, (at, 0), (0, -3 if value > 0 else 3), ha="center", fontsize=8,
                               textcoords="offset points", va="top" if value > 0 else "bottom", zorder=5,
                               **_HALO)  # fmt: skip
    hardest = [max(abs(value) for value in load.values()) for load in loads]
    top = 1.2 * max(*hardest, RELEASE * preload)
    _limits(force, preload, top)
    force.axhline(0, color="0.3", lw=0.6)
    force.set_ylim(-top, top)
    force.set_ylabel("nut load F (N)")
    force.set_title(f"Nut load, at the nominal preload P of {preload:.4g} N")
    _preload_left(falling, test, hardest)
    _name_groups(falling, test, list(groups))
    falling.set_xlim(-0.6, len(groups) - 0.4)
    for axes in (force, falling):
        axes.grid(axis="x", visible=False)
        for place, (before, after) in enumerate(pairwise(groups)):
            if before[0] != after[0]:
                axes.axvline(place + 0.5, color="0.3", lw=0.8, ls=":")
    figure.align_ylabels([force, falling])


def _limits(axes: Axes, preload: float, top: float) -> None:
    close = top > 4 * RELEASE * preload  # their names would lie on each other
    for ratio, words, style in (
        (ADVISED, "" if close else f"{ADVISED:g} P: beyond, the frequency reads low", "--"),
        (RELEASE, f"{ADVISED:g} P and " * close + f"{RELEASE:.2f} P: beyond, the nut is unloaded", "-"),
    ):
        for sign in (1, -1):
            axes.axhline(sign * ratio * preload, color=_LIMIT, lw=1.2, ls=style)
        if words:
            axes.annotate(words, (0.01, ratio * preload), (0, 2), xycoords=("axes fraction", "data"),
                          textcoords="offset points", va="bottom", fontsize=8, color=_LIMIT,
                          **_HALO)  # fmt: skip


def _preload_left(axes: Axes, test: PlannedTest, hardest: Sequence[float]) -> None:
    """How far the preload may fall under each nut load."""
    preload, rating = test.sheet.nominal_preload, test.sheet.screw.dynamic_load_rating
    x = np.arange(len(hardest))
    advised, released = np.array(hardest) / ADVISED, np.array(hardest) / RELEASE
    axes.bar(x, released, 0.6, color=_LIMIT, alpha=0.6, lw=0, label=f"F > {RELEASE:.2f} P: unloaded")
    axes.bar(x, advised - released, 0.6, bottom=released, color=_AMBER, alpha=0.6, lw=0,
             label=f"F > {ADVISED:g} P: reads low")  # fmt: skip
    axes.axhline(preload, color="black", lw=1.3)
    axes.annotate("P nominal", (0.01, preload), (0, 2), xycoords=("axes fraction", "data"), va="bottom",
                  textcoords="offset points", fontsize=8, **_HALO)  # fmt: skip
    if len(hardest) <= _FEW_GROUPS:
        for at, first, second in zip(x, advised, released, strict=True):
            words = f"{first:.0f} and {second:.0f} N"
            if len(hardest) == 1:
                words = (
                    f"{first:.0f} N ({first / rating:.2%} of Ca) and {second:.0f} N ({second / rating:.2%})"
                )
            axes.annotate(words, (at, first), (0, 2), ha="center", textcoords="offset points", va="bottom",
                          fontsize=8, **_HALO)  # fmt: skip
    axes.set_ylim(0, 1.42 * max(preload, advised.max()))
    axes.set_ylabel("preload P (N)")
    axes.set_title("As the preload falls", fontsize=10)
    axes.legend(loc="upper right", ncols=2, borderaxespad=0.1, columnspacing=1.2, handlelength=1.4)
    percent = rating / 100

    def to_percent(force: Any) -> Any:
        return force / percent

    def to_force(part: Any) -> Any:
        return part * percent

    right = axes.secondary_yaxis("right", functions=(to_percent, to_force))
    right.set_ylabel("P (% of Ca)")


def _name_groups(axes: Axes, test: PlannedTest, groups: Sequence[tuple[int, float]]) -> None:
    """The load beneath each group, and the motion beneath those."""
    every = -(-len(groups) // _MOST_GROUPS)
    names = ["" if place % every else f"{mass:g}" for place, (_, mass) in enumerate(groups)]
    axes.set_xticks(range(len(groups)), names)
    axes.set_xlabel("load (kg)")
    if len(test.plan.motions) == 1 or len(test.plan.motions) > _MOST_NAMES:
        return
    axes.set_xlabel("load (kg), of each motion")
    for index in range(len(test.plan.motions)):
        places = [place for place, (motion, _) in enumerate(groups) if motion == index]
        axes.annotate(
            motion_name(test, index), ((places[0] + places[-1]) / 2, 0), (0, 3), ha="center", va="bottom",
            xycoords=("data", "axes fraction"), textcoords="offset points", fontsize=8, **_HALO,
        )  # fmt: skip


def draw_along(figure: Any, test: PlannedTest) -> None:
    """The natural frequency that the data sheet predicts along the axis, a line a load.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    test : PlannedTest
        The test.
    """
    axes = figure.subplots(gridspec_kw=frame(figure, left=0.72, right=0.15))
    masses = sorted(test.plan.masses)
    every = -(-len(masses) // _MOST_LOADS)
    for order, mass in enumerate(masses):
        colour = _load_colour(masses, mass)
        stops = {cell.position: cell for cell in test.cells if cell.mass == mass}
        x = 1e3 * np.array(list(stops))
        f = np.array([cell.frequency for cell in stops.values()])
        u = np.array([cell.standard_uncertainty for cell in stops.values()])
        axes.fill_between(x, f - 2 * u, f + 2 * u, color=colour, alpha=min(0.2, 1 / len(masses)), lw=0)
        marker = _LOAD_MARKERS[order % len(_LOAD_MARKERS)] if len(x) <= _MOST_MARKERS else ""
        axes.plot(x, f, color=colour, lw=1.8, marker=marker, ms=5,
                  label=None if order % every else f"{mass:g} kg")  # fmt: skip
    low, high = axes.get_ylim()
    _null_lines(axes, test, low, high)
    columns = min(3, -(-len(masses) // _FEW_LOADS))
    rows = -(-min(len(masses), _MOST_LOADS) // columns)
    room = 0.06 * (1.5 + rows) if columns > 1 else 0.0
    axes.set_ylim(low, high + room * (high - low))
    axes.legend(loc="upper right", title="load", ncols=columns)
    axes.set_title("Expected axial natural frequency ± 2 u")
    axes.set_xlabel("position (mm)")
    axes.set_ylabel("ANF, rotor free (Hz)")
    axes.annotate("u: from the data sheet's tolerances", (0.02, 0.02), xycoords="axes fraction", fontsize=8,
                  color="0.3")  # fmt: skip


def _null_lines(axes: Axes, test: PlannedTest, low: float, high: float) -> None:
    for index, motion in enumerate(test.plan.motions):
        inside = [(order, null) for order, null in enumerate(nulls(motion, high), start=1) if null > low]
        if len(inside) > _MOST_NAMES:
            words = f"nulls of {motion_name(test, index)} every {1 / motion.jerk_time:.3g} Hz"
            axes.annotate(words, (0.02, 0.07), xycoords="axes fraction", fontsize=8, color=_LIMIT)
            continue
        for order, null in inside:
            axes.axhline(null, color=_LIMIT, lw=1.2, ls=motion_style(index))
            axes.annotate(
                f"null {order}/$T_j$ of {motion_name(test, index)}", (0.01, null), (0, 2), va="bottom",
                xycoords=("axes fraction", "data"), textcoords="offset points", fontsize=8, color=_LIMIT,
                **_HALO,
            )  # fmt: skip


def _load_colour(masses: Sequence[float], mass: float) -> Any:
    from matplotlib import colormaps

    return colormaps[_LOAD_MAP](0.85 * masses.index(mass) / max(1, len(masses) - 1))


def _band(cells: Sequence[ExpectedCell]) -> tuple[float, float]:
    return (
        max(0.0, min(cell.frequency - 2 * cell.standard_uncertainty for cell in cells)),
        max(cell.frequency + 2 * cell.standard_uncertainty for cell in cells),
    )


def _groups(cells: Sequence[ExpectedCell]) -> dict[tuple[int, float], dict[Condition, float]]:
    """Nut load by condition, for each motion and mass: it is the same at all stops."""
    groups: dict[tuple[int, float], dict[Condition, float]] = {}
    for cell in sorted(cells, key=lambda cell: (cell.motion, cell.mass)):
        groups.setdefault((cell.motion, cell.mass), {})[cell.condition] = cell.nut_load
    return groups
