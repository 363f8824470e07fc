"""Natural frequency by Eq. (3) against position, for several preloads and loads: Fig. 2 of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ballscrew.axis.frequency import Rotor, axial_natural_frequency
from ballscrew.axis.sheet import DataSheet
from ballscrew.report import canvas
from ballscrew.report.canvas import Axes, Figure

PRELOAD_MAP = "plasma"
LOAD_MAP = "cividis"
ROTOR_COLOURS: dict[Rotor, str] = {"free": "#332288", "held": "#B8860B"}
_POINTS = 181


@canvas.styled()
def draw_theory(
    sheet: DataSheet, *, preload_ratios: Sequence[float], loads: Sequence[float], travel: tuple[float, float]
) -> Figure:
    """Draw Fig. 2 of the paper: frequency against position for (a) several preloads, (b) several loads.

    In the upper row the rotor is held, as in Eq. (3); in the lower one it is free.

    Parameters
    ----------
    sheet : DataSheet
        The axis; its nominal preload in (b), no load in (a).
    preload_ratios : sequence of float
        P/Ca, each above 0.
    loads : sequence of float
        kg.
    travel : tuple of float
        Lowest and highest position, m.

    Returns
    -------
    Figure
        Not yet written.
    """
    x = np.linspace(*travel, _POINTS)
    preloads = sheet.screw.dynamic_load_rating * np.asarray(preload_ratios)
    figure = canvas.blank(8, 6.6)
    rows: Any = figure.subplots(2, 2, sharex=True, sharey="row")
    rotors: tuple[Rotor, ...] = ("held", "free")
    for (by_preload, by_load), rotor in zip(rows, rotors, strict=True):
        for preload, colour in zip(
            preloads, canvas.colours_of(PRELOAD_MAP, len(preloads), 0.75), strict=True
        ):
            f = axial_natural_frequency(sheet, x, 0.0, preload, rotor)
            by_preload.plot(1e3 * x, f, color=colour, lw=1.7)
        for load, colour in zip(loads, canvas.colours_of(LOAD_MAP, len(loads), 0.75), strict=True):
            f = axial_natural_frequency(sheet, x, load, None, rotor)
            by_load.plot(1e3 * x, f, color=colour, lw=1.7)
        by_preload.set_xlim(1e3 * travel[0], 1e3 * travel[1])
    rows[0, 0].set_ylabel("frequency, rotor held, Eq. (3) (Hz)")
    rows[1, 0].set_ylabel("frequency, rotor free (Hz)")
    for axes in rows[1]:
        axes.set_xlabel("position (mm)")
    rows[0, 0].set_title("(a) preload, % of $C_a$; no load", loc="left")
    rows[0, 1].set_title(f"(b) load; preload {100 * sheet.screw.preload_ratio:g} %", loc="left")
    figure.draw_without_rendering()  # the labels must know the size of the axes
    names = [f"{100 * ratio:g} %" for ratio in preload_ratios], [f"{load:g} kg" for load in loads]
    for row in rows:
        for axes, texts in zip(row, names, strict=True):
            _name_curves(axes, texts)
    return figure


def _name_curves(axes: Axes, texts: Sequence[str]) -> None:
    ends, colours = [], []
    for line in axes.get_lines():
        ends.append(float(np.asarray(line.get_ydata())[-1]))
        colours.append(line.get_color())
    canvas.label_ends(axes, ends, texts, colours)
