"""Smallest detectable loss, accuracy of an optimised plan, and the verdict on a measurement."""

from __future__ import annotations

import math
import textwrap
from typing import Any

import numpy as np
import pandas as pd

from ballscrew.base.words import plural
from ballscrew.fcft.optimise import Optimised
from ballscrew.monitoring.capability import Capability
from ballscrew.recording.quality.finding import Quality
from ballscrew.report import canvas
from ballscrew.report.axis_figures import LOAD_MAP
from ballscrew.report.canvas import Axes

_OFF = 0.06  # between the marks of neighbouring loads, of the distance of two numbers of runs
_WIDTH = 95  # characters of a line of a reason
_MOST_LINES = 14  # of reasons, on a panel of usual height
_LOOKS: dict[str, dict[str, Any]] = {
    "before": {"marker": "|", "color": "#888888", "ms": 12},
    "after": {"marker": "o", "color": "#0072B2", "ms": 11, "mfc": "none"},
    "chosen": {"marker": "D", "color": "#D55E00", "ms": 5},
}
_VERDICT_COLOURS = {"good": "#009E73", "suspect": "#E69F00", "bad": canvas.ERROR_COLOUR}


def draw_smallest_loss(axes: Axes, capability: Capability) -> None:
    """Draw the smallest detectable loss of each load against the number of runs, with 95 % intervals.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    capability : Capability
        A load without a detectable loss is named in the legend.
    """
    table = capability.to_dataframe()
    numbers = sorted(set(table.runs))
    loads = list(table.groupby("load_kg"))
    colours = canvas.colours_of(LOAD_MAP, len(loads), 0.85)
    for index, (load, rows) in enumerate(loads):
        known = rows.dropna(subset="loss")
        x = np.searchsorted(numbers, known.runs) + _OFF * (index - (len(loads) - 1) / 2)
        ends = np.reshape(known.interval95.tolist(), (-1, 2)).T
        bars = 100 * np.abs(ends - known.loss.to_numpy())
        name = f"{load:g} kg"
        if known.empty:
            name += ": no loss is detectable"
        look = {"fmt": "o-", "ms": 5, "capsize": 3, "color": colours[index], "label": name}
        axes.errorbar(x, 100 * known.loss.astype(float), bars, **look)
    axes.set_xticks(range(len(numbers)), list(map(str, numbers)))
    axes.set_xlim(-0.5, len(numbers) - 0.5)
    axes.set_ylim(bottom=0)
    axes.set(xlabel="runs since the loss", ylabel="smallest detectable loss (% of the preload)")
    power, false_alarm = 100 * capability.power, 100 * capability.false_alarm
    baseline = plural(capability.baseline_runs, "baseline run")
    axes.set_title(f"power {power:g} %, false alarms {false_alarm:g} % of the tests, {baseline}", loc="left")
    axes.legend(title="load")


def draw_information(axes: Axes, optimised: Optimised) -> None:
    """Draw the expected uncertainty of each parameter by the data sheet, the given and the chosen plan.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    optimised : Optimised
        Plan with the most information per minute.
    """
    given, chosen = pd.DataFrame(optimised.given.accuracy), pd.DataFrame(optimised.chosen.accuracy)
    table = given.assign(chosen=chosen.after)[given.before > 0].iloc[::-1]
    y = np.arange(len(table))
    names = {
        "before": optimised.known_from,
        "after": f"given plan, {optimised.given.minutes:.0f} min",
        "chosen": f"chosen plan, {optimised.chosen.minutes:.0f} min",
    }
    for column, label in names.items():
        axes.plot(100 * table[column], y, ls="", mew=1.5, label=label, **_LOOKS[column])
    axes.hlines(y, 100 * table.chosen, 100 * table.before, color="#CCCCCC", zorder=0)
    axes.set_yticks(y, table["name"])
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set(xlabel="expected relative standard uncertainty (%)", ylabel="parameter of the axis")
    title = "the given plan does not determine all parameters"
    if math.isfinite(optimised.ratio):
        title = f"chosen plan: {optimised.ratio:.3g} times the information per minute"
    axes.set_title(title, loc="left")
    axes.legend()


def draw_quality(axes: Axes, quality: Quality) -> None:
    """Write the verdict on a measurement and its reasons, the causes first.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    quality : Quality
        Verdict and reasons.
    """
    colour = _VERDICT_COLOURS[quality.verdict]
    lines: list[str] = []
    for reason in map(canvas.escape_dollars, quality.reasons):
        lines += textwrap.wrap(reason, _WIDTH, initial_indent="•  ", subsequent_indent="    ")
    if len(lines) > _MOST_LINES:
        lines = [*lines[: _MOST_LINES - 1], "…"]
    axes.plot([0, 0], [0, 1], color=colour, lw=8, solid_capstyle="butt", clip_on=False)
    axes.text(0.03, 0.98, "\n".join(lines or ["no fault was found"]), va="top", linespacing=1.5)
    axes.set(xlim=(0, 1), ylim=(0, 1))
    axes.set_axis_off()
    axes.set_title(f"measurement: {quality.verdict}", loc="left", color=colour)
