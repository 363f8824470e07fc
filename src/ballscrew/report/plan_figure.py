"""The picture of a plan: round trip, excitation, nut load and expected frequencies."""

from __future__ import annotations

import math
import textwrap
from dataclasses import replace
from typing import Any

from ballscrew.axis.rigidity import at_preload
from ballscrew.base.words import duration, plural
from ballscrew.fcft.plan import Motion
from ballscrew.fcft.planned import PlannedTest
from ballscrew.report import canvas
from ballscrew.report.canvas import Figure
from ballscrew.report.plan_panels import draw_along, draw_excitation, draw_nut_load
from ballscrew.report.plan_trip import LIMIT, draw_conditions, draw_phases, draw_trip

_LOOK: Any = {"axes.titlelocation": "left", "axes.titlesize": 11, "legend.fontsize": 8.5}
_HEIGHT, _TITLE, _STRIP, _LINE = 10.5, 0.62, 0.34, 0.165  # inches: the whole, and parts of it
_MOST_SENTENCES = 4
_LONGEST_NAME = 50


@canvas.styled()
def draw_plan(test: PlannedTest) -> Figure:
    """Draw a plan on an axis.

    Above, one round trip: position and speed, and the acceleration around a standstill. Below, how a jerk
    excites the expected natural frequencies, the nut load and the preload at which it is too much, and the
    expected natural frequency along the axis; of a plan with preloads, at the lowest. Warnings and broken
    limits stand beneath.

    Parameters
    ----------
    test : PlannedTest
        As :func:`~ballscrew.fcft.planned.plan` returns it.

    Returns
    -------
    Figure
        Not yet written.
    """
    import matplotlib as mpl

    if test.plan.preloads:
        test = _at_lowest_preload(test)
    with mpl.rc_context(_LOOK):
        figure = canvas.blank(15, _HEIGHT, constrained=False)
        _fill(figure, test)
    return figure


def _at_lowest_preload(test: PlannedTest) -> PlannedTest:
    """Part of a plan with the lowest preload, where the nut load softens the nut most."""
    lowest = min(test.plan.preloads)
    cells = tuple(cell for cell in test.cells if math.isclose(cell.preload, lowest))
    return replace(test, sheet=at_preload(test.sheet, lowest), cells=cells)


def _fill(figure: Any, test: PlannedTest) -> None:
    sentences = _sentences(test)
    lines = sum(text.count("\n") + 1 for text, _ in sentences)
    foot_height = _LINE * lines + 0.12  # inches
    remaining = _HEIGHT - _TITLE - _STRIP - foot_height
    title, upper, strip, lower, foot = figure.subfigures(
        5, 1, height_ratios=(_TITLE, 0.48 * remaining, _STRIP, 0.52 * remaining, foot_height), hspace=0
    )
    title.text(0.5, 0.68, _headline(test), ha="center", va="center", fontsize=15, fontweight="bold")
    title.text(0.5, 0.2, _details(test), ha="center", va="center", fontsize=10.5, color="0.25")
    trip, phases = upper.subfigures(1, 2, width_ratios=(1.9, 1), wspace=0)
    draw_trip(trip, test)
    draw_phases(phases, test)
    draw_conditions(strip)
    excitation, load, along = lower.subfigures(1, 3, width_ratios=(1.08, 1.08, 1), wspace=0)
    draw_excitation(excitation, test)
    draw_nut_load(load, test)
    draw_along(along, test)
    height = 1.0
    for text, colour in sentences:
        foot.text(0.012, height, text, va="top", fontsize=9, color=colour)
        height -= (text.count("\n") + 1) * _LINE / foot_height


def _headline(test: PlannedTest) -> str:
    plan = test.plan
    trips, time = plural(test.trip_count, "round trip"), duration(test.duration_s)
    if plan.run_count > 1:
        each = "run" if plan.preloads else "load"
        trips += f" per {each}"
        time += f" per {each}, {duration(plan.run_count * test.duration_s)} in all"
    if plan.warm_up:
        trips += f" ({plan.warm_up} to warm up)"
    return f"Plan for {name(test.sheet.name)}: {plural(len(test.cells), 'cell')}, {trips}, {time}"


def _details(test: PlannedTest) -> str:
    plan = test.plan
    first, last = 1e3 * plan.positions[0], 1e3 * plan.positions[-1]
    load = f"{len(plan.masses)} loads"
    if len(plan.masses) == 1:
        load = f"load {plan.masses[0]:g} kg"
    if len(plan.motions) == 1:
        moves = _motion(plan.motions[0])
    elif len(plan.motions) == 2:
        moves = f"motion 0: {_motion(plan.motions[0])};  motion 1: {_motion(plan.motions[1])}"
    else:
        moves = f"{len(plan.motions)} motions"
    return f"{len(plan.positions)} stops from {first:g} to {last:g} mm;  {load};  {moves}"


def _motion(motion: Motion) -> str:
    return (
        f"{1e3 * motion.speed:.4g} mm/s, {motion.acceleration:.4g} m/s², {motion.jerk:.4g} m/s³, "
        f"dwell {1e3 * motion.dwell:.4g} ms"
    )


def name(text: str) -> str:
    """Name from a file, fit to be drawn: printable, not too long, no formula."""
    shown = _printable(text)
    if len(shown) > _LONGEST_NAME:
        shown = shown[: _LONGEST_NAME - 1] + "…"
    return canvas.escape_dollars(shown)


def _sentences(test: PlannedTest) -> list[tuple[str, str]]:
    """Broken limits and warnings, wrapped, each with its colour."""
    found = [(f"Limit broken: {text}", LIMIT) for text in test.broken]
    found += [(f"Warning: {text}", "black") for text in test.warnings]
    shown = []
    for text, colour in found[:_MOST_SENTENCES]:
        wrapped = textwrap.fill(_printable(text), 235, max_lines=3, placeholder=" …")
        shown.append((canvas.escape_dollars(wrapped), colour))
    if len(found) > _MOST_SENTENCES:
        shown.append((f"… and {len(found) - _MOST_SENTENCES} more.", "black"))
    return shown


def _printable(text: str) -> str:
    return "".join(sign if sign.isprintable() else " " for sign in text)
