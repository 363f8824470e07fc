"""The lower half of a plan's picture: excitation, nut load and expected frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ballscrew.axis.rigidity import release_ratio
from ballscrew.axis.sheet import DataSheet
from ballscrew.base.arrays import Array
from ballscrew.fcft.concerns import EXCITED
from ballscrew.fcft.conditions import Condition
from ballscrew.fcft.excitation import blow_spectrum, mean_blow_spectrum, nulls
from ballscrew.fcft.expected import ExpectedCell, executed
from ballscrew.fcft.nutload import advised_ratio
from ballscrew.fcft.planned import PlannedTest
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes
from ballscrew.report.plan_trip import LIMIT, frame, motion_name, motion_style

_LOAD_MAP = "cividis"
_LOAD_MARKERS = "osD^vPX"
# Wide and pale below, thin and dark above: of two curves that coincide both are visible.
_MOTION_LINES = (("0.45", 3.2), ("black", 1.7), ("0.3", 2.4), ("0.6", 2.0), ("0.75", 2.8))
_MOST_NAMES = 6
_FEW_LOADS = 4  # with a band each
_MOST_LOADS = 12  # with a name each
_MOST_RINGS = 20  # on distinct nulls
_FEW_GROUPS = 4  # of nut loads, with their numbers
_MOST_GROUPS = 12  # with a name each
_MOST_MARKERS = 40
_AMBER = "#E69F00"
_HALO: dict[str, Any] = {
    "size": 8,
    "bbox": {"boxstyle": "square,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.75},
}


def draw_excitation(figure: Any, test: PlannedTest) -> None:
    r"""Draw \|sinc(f T_j)\| of one blow of each motion, over the expected natural frequencies.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    test : PlannedTest
        The test.
    """
    axes = figure.subplots(gridspec_kw=frame(figure, left=0.72, right=0.12))
    low, high = _load_bands(axes, test)
    jerk_times = np.array([motion.jerk_time for motion in test.plan.motions])
    right = float(np.clip(1.12 / jerk_times.min(), 2 * high, 6 * high))
    axes.axhline(EXCITED, color=LIMIT, lw=1, ls="--")
    for index in range(len(test.plan.motions)):
        _spectrum(axes, test, index, np.linspace(right / 4000, right, 4000))
    _mark_nulls(axes, test, right)
    canvas.note(axes, "expected ANF ± 2 u", (low, 1.04), (2, 0), va="bottom")
    words = "below: no useful excitation"
    canvas.note(
        axes, words, (0.01, EXCITED), (0, 2), coords=canvas.SIDE_EDGE, ha="left", colour=LIMIT, **_HALO
    )
    axes.set(xlim=(0, right), ylim=(0, 1.13), yticks=np.arange(0, 1.01, 0.2))
    axes.set(title="Torque excitation of one jerk phase", xlabel="frequency (Hz)")
    axes.set_ylabel("|sinc(f $T_j$)|, 1 for an instantaneous jerk")
    axes.legend(loc="upper right", bbox_to_anchor=(1, 0.92))


def _load_bands(axes: Axes, test: PlannedTest) -> tuple[float, float]:
    """Shade the expected frequencies of each load, or of many together; the whole band is returned, Hz."""
    masses = sorted(test.plan.masses)
    low, high = _band(test.cells)
    if len(masses) > _FEW_LOADS:
        axes.axvspan(low, high, color="0.82", lw=0, zorder=0)
        return low, high
    for mass in masses:
        band = _band(_of_mass(test, mass))
        axes.axvspan(*band, color=_load_colour(masses, mass), alpha=0.2, lw=0, zorder=0)
    return low, high


def _spectrum(axes: Axes, test: PlannedTest, index: int, frequency: Array) -> None:
    """Draw the spectrum of one motion, and a tick on it at each expected natural frequency."""
    motion = test.plan.motions[index]
    colour, width = _MOTION_LINES[index % len(_MOTION_LINES)]
    style = motion_style(index)
    label = f"{motion_name(test, index)}: $T_j$ = {1e3 * motion.jerk_time:.3g} ms"
    curve = blow_spectrum(frequency, motion)
    if motion.jerk_spread:
        runs = executed(test.plan, index)
        axes.plot(frequency, curve, lw=0.8, color=colour, ls=style)
        curve = mean_blow_spectrum(frequency, runs)
        label += f", rms of {len(runs)} varied by {motion.jerk_spread:g}"
    axes.plot(frequency, curve, lw=width, label=label, color=colour, ls=style)
    modes = dict.fromkeys((cell.frequency, cell.excitation) for cell in test.cells if cell.motion == index)
    for f, height in list(modes)[:: 1 + len(modes) // _MOST_MARKERS]:
        axes.plot([f], [height], "|", color=colour, ms=10, mew=1)


def _mark_nulls(axes: Axes, test: PlannedTest, right: float) -> None:
    """Draw a ring on every k/T_j, and name the first ones where their names do not overlap."""
    named = [-np.inf]
    for motion in test.plan.motions:
        found = nulls(motion, right)
        if len(found) > _MOST_RINGS:
            words = f"nulls every {found[0]:.3g} Hz"
            axes.annotate(words, (0.5, 0.3), xycoords="axes fraction", fontsize=8, color=LIMIT)
            continue
        axes.plot(
            found, np.zeros(len(found)), "o", ms=7, mfc="white", mec=LIMIT, mew=1.6, clip_on=False, zorder=6
        )
        for order, null in enumerate(found[:_MOST_NAMES], start=1):
            distance = np.abs(null - np.array(named)).min()
            if distance > 0.12 * right and null < 0.97 * right:
                _name_null(axes, f"{order}/$T_j$\n{null:.4g} Hz", null)
                named.append(null)


def _name_null(axes: Axes, words: str, null: float) -> None:
    # Above the lobes on either side of the null, which a text would hide.
    axes.annotate(
        words, (null, 0.01), (null, EXCITED + 0.04), ha="center", va="bottom", fontsize=8, color=LIMIT,
        arrowprops={"arrowstyle": "-", "color": LIMIT, "lw": 0.7}, bbox=_HALO["bbox"],
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _NutLoads:
    """Nut load by motion and mass; it is the same at all stops.

    Parameters
    ----------
    motions : ndarray, shape (groups,)
        Number of the motion.
    masses : ndarray, shape (groups,)
        Load on the table, kg.
    forces : dict of Condition to ndarray, shape (groups,)
        Nut load, N; NaN where the condition does not exist.
    """

    motions: Array
    masses: Array
    forces: dict[Condition, Array]

    @classmethod
    def of(cls, cells: Sequence[ExpectedCell]) -> _NutLoads:
        groups = sorted({(cell.motion, cell.mass) for cell in cells})
        motions, masses = np.array(groups).T
        forces = {condition: np.full(len(groups), np.nan) for condition in Condition}
        for cell in cells:
            forces[cell.condition][groups.index((cell.motion, cell.mass))] = cell.nut_load
        return cls(motions, masses, forces)

    @property
    def largest(self) -> Array:
        """Largest magnitude over the conditions, N."""
        return np.asarray(np.nanmax(np.abs(list(self.forces.values())), axis=0))


def draw_nut_load(figure: Any, test: PlannedTest) -> None:
    """Draw the nut load for each motion and load; beneath, the preload at which it is too much.

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
    loads = _NutLoads.of(test.cells)
    _force_bars(force, loads)
    top = 1.2 * max(loads.largest.max(), release_ratio(test.sheet.screw) * preload)
    _limits(force, test.sheet, top)
    force.axhline(0, color="0.3", lw=0.6)
    force.set(ylim=(-top, top), ylabel="nut load F (N)")
    which = "lowest" if test.plan.preloads else "nominal"
    force.set_title(f"Nut load, at the {which} preload P of {preload:.4g} N")
    _remaining_preload(falling, test, loads.largest)
    _name_groups(falling, test, loads)
    falling.set_xlim(-0.6, len(loads.masses) - 0.4)
    for axes in (force, falling):
        axes.grid(axis="x", visible=False)
        for place, (before, after) in enumerate(pairwise(loads.motions)):
            if before != after:
                axes.axvline(place + 0.5, color="0.3", lw=0.8, ls=":")
    figure.align_ylabels([force, falling])


def _force_bars(axes: Axes, loads: _NutLoads) -> None:
    width = 0.8 / len(Condition)
    for order, condition in enumerate(Condition):
        x = np.arange(len(loads.masses)) + (order - 1.5) * width
        values = loads.forces[condition]
        axes.bar(x, values, 0.9 * width, color=canvas.CONDITION_COLOURS[condition])
        if len(loads.masses) > _FEW_GROUPS:
            continue
        for at, value in zip(x, values, strict=True):
            # On the other side of zero, where no limit is.
            offset = 3
            if value > 0:
                offset = -3
            canvas.note(axes, condition, (at, 0), (0, offset), zorder=5, **_HALO)


def _limits(axes: Axes, sheet: DataSheet, top: float) -> None:
    preload, limit, release = sheet.nominal_preload, advised_ratio(sheet.screw), release_ratio(sheet.screw)
    advised = f"{limit:g} P: beyond, the frequency reads low"
    released = f"{release:.2f} P: beyond, the nut is unloaded"
    if top > 4 * release * preload:  # the names would overlap
        advised, released = "", f"{limit:g} P and {released}"
    for ratio, words, style in ((limit, advised, "--"), (release, released, "-")):
        for sign in (1, -1):
            axes.axhline(sign * ratio * preload, color=LIMIT, lw=1.2, ls=style)
        place = (0.01, ratio * preload)
        canvas.note(axes, words, place, (0, 2), coords=canvas.SIDE_EDGE, ha="left", colour=LIMIT, **_HALO)


def _remaining_preload(axes: Axes, test: PlannedTest, hardest: Array) -> None:
    """Draw how far the preload may fall under each nut load."""
    preload, rating = test.sheet.nominal_preload, test.sheet.screw.dynamic_load_rating
    x = np.arange(len(hardest))
    limit, release = advised_ratio(test.sheet.screw), release_ratio(test.sheet.screw)
    advised, released = hardest / limit, hardest / release
    axes.bar(x, released, 0.6, color=LIMIT, alpha=0.6, lw=0, label=f"F > {release:.2f} P: unloaded")
    axes.bar(
        x, advised - released, 0.6, bottom=released, color=_AMBER, alpha=0.6, lw=0,
        label=f"F > {limit:g} P: reads low",
    )  # fmt: skip
    axes.axhline(preload, color="black", lw=1.3)
    canvas.note(axes, "P nominal", (0.01, preload), (0, 2), coords=canvas.SIDE_EDGE, ha="left", **_HALO)
    if len(hardest) == 1:
        first, second = advised[0], released[0]
        words = f"{first:.0f} N ({first / rating:.2%} of Ca) and {second:.0f} N ({second / rating:.2%})"
        canvas.note(axes, words, (0, first), (0, 2), **_HALO)
    elif len(hardest) <= _FEW_GROUPS:
        for at, first, second in zip(x, advised, released, strict=True):
            canvas.note(axes, f"{first:.0f} and {second:.0f} N", (at, first), (0, 2), **_HALO)
    axes.set(ylim=(0, 1.42 * max(preload, advised.max())), ylabel="preload P (N)")
    axes.set_title("As the preload falls", fontsize=10)
    axes.legend(loc="upper right", ncols=2, borderaxespad=0.1, columnspacing=1.2, handlelength=1.4)
    canvas.second_scale(axes, 100 / rating, "P (% of Ca)")


def _name_groups(axes: Axes, test: PlannedTest, loads: _NutLoads) -> None:
    """Write the load beneath each group, and the motion beneath those."""
    ticks = np.arange(0, len(loads.masses), -(-len(loads.masses) // _MOST_GROUPS))
    axes.set_xticks(ticks, [f"{mass:g}" for mass in loads.masses[ticks]])
    axes.set_xlabel("load (kg)")
    motions = range(len(test.plan.motions))
    if not 1 < len(motions) <= _MOST_NAMES:
        return
    axes.set_xlabel("load (kg), of each motion")
    for index in motions:
        middle = np.flatnonzero(loads.motions == index).mean()
        canvas.note(axes, motion_name(test, index), (middle, 0), (0, 3), coords=canvas.TOP_EDGE, **_HALO)


def draw_along(figure: Any, test: PlannedTest) -> None:
    """Draw the natural frequency that the data sheet predicts along the axis, a line a load.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    test : PlannedTest
        The test.
    """
    draw_expected(figure.subplots(gridspec_kw=frame(figure, left=0.72, right=0.15)), test)


def draw_expected(axes: Axes, test: PlannedTest) -> None:
    """Draw the same on axes.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    test : PlannedTest
        The test.
    """
    masses = sorted(test.plan.masses)
    every = -(-len(masses) // _MOST_LOADS)
    for order, mass in enumerate(masses):
        label = None
        if order % every == 0:
            label = f"{mass:g} kg"
        _expected(axes, test, mass, _LOAD_MARKERS[order % len(_LOAD_MARKERS)], label)
    low, high = axes.get_ylim()
    _null_lines(axes, test, low, high)
    columns = min(3, -(-len(masses) // _FEW_LOADS))
    if columns > 1:
        rows = -(-min(len(masses), _MOST_LOADS) // columns)
        high += 0.06 * (1.5 + rows) * (high - low)  # room for the legend
    axes.set_ylim(low, high)
    axes.legend(loc="upper right", title="load", ncols=columns)
    axes.set(title="Expected axial natural frequency ± 2 u", xlabel="position (mm)")
    axes.set_ylabel("ANF, rotor free (Hz)")
    words = "u: from the data sheet's tolerances"
    axes.annotate(words, (0.02, 0.02), xycoords="axes fraction", fontsize=8, color="0.3")


def _expected(axes: Axes, test: PlannedTest, mass: float, marker: str, label: str | None) -> None:
    """Draw the expected frequencies under one load."""
    masses = sorted(test.plan.masses)
    colour = _load_colour(masses, mass)
    stops = {cell.position: (cell.frequency, cell.standard_uncertainty) for cell in _of_mass(test, mass)}
    x = 1e3 * np.array(list(stops))
    f, u = np.array(list(stops.values())).T
    axes.fill_between(x, f - 2 * u, f + 2 * u, color=colour, alpha=min(0.2, 1 / len(masses)), lw=0)
    if len(x) > _MOST_MARKERS:
        marker = ""
    axes.plot(x, f, color=colour, lw=1.8, marker=marker, ms=5, label=label)


def _null_lines(axes: Axes, test: PlannedTest, low: float, high: float) -> None:
    for index, motion in enumerate(test.plan.motions):
        inside = {order: f for order, f in enumerate(nulls(motion, high), start=1) if f > low}
        name = motion_name(test, index)
        if len(inside) > _MOST_NAMES:
            words = f"nulls of {name} every {1 / motion.jerk_time:.3g} Hz"
            axes.annotate(words, (0.02, 0.07), xycoords="axes fraction", fontsize=8, color=LIMIT)
            continue
        for order, null in inside.items():
            axes.axhline(null, color=LIMIT, lw=1.2, ls=motion_style(index))
            words = f"null {order}/$T_j$ of {name}"
            canvas.note(
                axes, words, (0.01, null), (0, 2), coords=canvas.SIDE_EDGE, ha="left", colour=LIMIT, **_HALO
            )


def _load_colour(masses: Sequence[float], mass: float) -> Any:
    from matplotlib import colormaps

    return colormaps[_LOAD_MAP](0.85 * masses.index(mass) / max(1, len(masses) - 1))


def _of_mass(test: PlannedTest, mass: float) -> list[ExpectedCell]:
    return [cell for cell in test.cells if cell.mass == mass]


def _band(cells: Sequence[ExpectedCell]) -> tuple[float, float]:
    """Lowest and highest expected frequency, 2 u beyond."""
    f, u = np.array([(cell.frequency, cell.standard_uncertainty) for cell in cells]).T
    return max(0.0, float((f - 2 * u).min())), float((f + 2 * u).max())
