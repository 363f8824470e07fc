"""The picture of a plan: its round trip, what it excites, what it asks of the nut, what is to be expected."""

from __future__ import annotations

import textwrap
import warnings
from pathlib import Path
from typing import Any

from ballscrew.base.files import replacing
from ballscrew.fcft.plan import Motion
from ballscrew.fcft.planned import PlannedTest
from ballscrew.report.plan_panels import draw_along, draw_excitation, draw_nut_load
from ballscrew.report.plan_trip import draw_conditions, draw_phases, draw_trip
from ballscrew.report.style import RC, check_target, no_formula

__all__ = ["draw_plan"]

_RC: Any = {**RC, "axes.titlelocation": "left", "axes.titlesize": 11, "legend.fontsize": 8.5}
_HEIGHT, _TITLE, _STRIP, _LINE = 10.5, 0.62, 0.34, 0.165  # inches: the whole, and parts of it
_MOST_SENTENCES = 4
_LONGEST_NAME = 50
_ALARM = "#A00000"


def draw_plan(test: PlannedTest, path: Path) -> None:
    """Draw a plan on an axis.

    Above, one round trip: position and speed, and the acceleration around a standstill. Below, how a blow
    excites the expected natural frequencies, the nut load and the preload at which it is too much, and the
    expected natural frequency along the axis. Warnings and broken limits stand beneath.

    Parameters
    ----------
    test : PlannedTest
        As :func:`~ballscrew.fcft.planned.plan` gives it.
    path : Path
        PNG, SVG or PDF file. The same test gives the same bytes.

    Raises
    ------
    InputError
        If the picture cannot be written.
    """
    path = Path(path)
    check_target(path)
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_RC), warnings.catch_warnings():
        # A name may hold signs that the font has not; they are drawn as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure = Figure(figsize=(15, _HEIGHT))
        _fill(figure, test)
        ending = path.suffix.lower()
        undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
        with replacing(path) as temporary:
            figure.savefig(temporary, dpi=130, metadata=undated.get(ending))


def _fill(figure: Any, test: PlannedTest) -> None:
    sentences = _sentences(test)
    lines = sum(text.count("\n") + 1 for text, _ in sentences)
    note = _LINE * lines + 0.12  # inches
    room = _HEIGHT - _TITLE - _STRIP - note
    title, upper, strip, lower, foot = figure.subfigures(
        5, 1, height_ratios=(_TITLE, 0.48 * room, _STRIP, 0.52 * room, note), hspace=0
    )
    headline, details = _title(test)
    title.text(0.5, 0.68, headline, ha="center", va="center", fontsize=15, fontweight="bold")
    title.text(0.5, 0.2, details, ha="center", va="center", fontsize=10.5, color="0.25")
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
        height -= (text.count("\n") + 1) * _LINE / note


def _title(test: PlannedTest) -> tuple[str, str]:
    plan = test.plan
    stops, loads = len(plan.positions), len(plan.masses)
    trips = _count(test.trip_count, "round trip") + (" a load" if loads > 1 else "")
    trips += f" ({plan.warm_up} to warm up)" if plan.warm_up else ""
    time = _time(test.duration_s) + (f" a load, {_time(loads * test.duration_s)} in all" if loads > 1 else "")
    first, last = 1e3 * plan.positions[0], 1e3 * plan.positions[-1]
    load = f"load {plan.masses[0]:g} kg" if loads == 1 else f"{loads} loads"
    moves = [_motion(motion) for motion in plan.motions]
    if len(moves) > 1:
        moves = [f"motion {index}: {words}" for index, words in enumerate(moves)]
    if len(moves) > 2:
        moves = [f"{len(moves)} motions"]
    return (
        f"Plan for {name(test.sheet.name)}: {_count(len(test.cells), 'cell')}, {trips}, {time}",
        f"{stops} stops from {first:g} to {last:g} mm;  {load};  " + ";  ".join(moves),
    )


def _motion(motion: Motion) -> str:
    return (
        f"{1e3 * motion.speed:.4g} mm/s, {motion.acceleration:.4g} m/s², {motion.jerk:.4g} m/s³, "
        f"dwell {1e3 * motion.dwell:.4g} ms"
    )


def name(text: str) -> str:
    """A name from a file, fit to be drawn: printable, not too long, no formula."""
    shown = _printable(text)
    return no_formula(shown if len(shown) <= _LONGEST_NAME else shown[: _LONGEST_NAME - 1] + "…")


def _sentences(test: PlannedTest) -> list[tuple[str, str]]:
    """What speaks against the plan, wrapped, each with its colour."""
    all_of_them = [(f"Limit broken: {text}", _ALARM) for text in test.broken]
    all_of_them += [(f"Warning: {text}", "black") for text in test.warnings]
    shown = all_of_them[:_MOST_SENTENCES]
    rest = len(all_of_them) - len(shown)
    if rest:
        shown.append((f"… and {rest} more.", "black"))
    return [
        (no_formula(textwrap.fill(_printable(text), 235, max_lines=3, placeholder=" …")), colour)
        for text, colour in shown
    ]


def _printable(text: str) -> str:
    return "".join(sign if sign.isprintable() else " " for sign in text)


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _time(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.1f} s"
    minutes = seconds / 60
    return f"{minutes:.1f} min" if minutes < 120 else f"{minutes / 60:.1f} h"
